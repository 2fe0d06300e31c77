"""The newest lot: reports of what is asked of depth, and of what hides."""
