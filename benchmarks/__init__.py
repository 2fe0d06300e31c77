"""Benchmarks: `python -m benchmarks [NAME …]`. Figures are ratios within one run.

Every module here has a `TITLE` and a `run()` that returns the rows of a small table, one
`dict` from column heading to text each.
"""
