"""Reports from run folders alone: a page, a JUnit file for CI, a Markdown summary, and the words in
which a terminal says it. All say what `verdict.json` says; nothing is judged again here.
"""
