"""Benchmarks, on pytest-benchmark: `make bench`, or `python -m benchmarks --only NAME`.

Every figure is a ratio within one run: whatever is compared takes turns, round by round, so that
all meet the same machine (`benchmarks.measuring`). Peers that are not installed are skipped, and
said to be. A run leaves a JSON file in `benchmarks/history`, and `docs/benchmarks.md` is made of
all that are there (`benchmarks.page`).
"""
