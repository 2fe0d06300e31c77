"""The newest lot: reports of late answers, lists, levels, views and what moves."""
