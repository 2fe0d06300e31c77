"""Speed against error: what each engine and each density costs, and what it gets wrong.

Everything but the times is deterministic.
"""

from __future__ import annotations

from visref.bench.measure import Bench, Measurement
from visref.bench.output import write_bench
from visref.report.bench_record import MARKER

__all__ = ["MARKER", "Bench", "Measurement", "write_bench"]
