"""Speed against error: what each engine and each density costs, and what it gets wrong.

Everything but the times is deterministic.
"""

from __future__ import annotations

from visref.bench.output import write_bench
from visref.bench.timing import Bench, BenchRun
from visref.report.bench_folder import MARKER

__all__ = ["MARKER", "Bench", "BenchRun", "write_bench"]
