"""How many threads there are to use: one answer for rays, exact arithmetic and reports."""

from __future__ import annotations

import os


def available_threads() -> int:
    """How many threads this process may run at once: what `taskset` or a container leaves it."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
