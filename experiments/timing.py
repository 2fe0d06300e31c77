"""Timing of small jobs on GL."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from visref_culling.gl.device import device


def quickest_ms(*jobs: Callable[[], object], rounds: int) -> list[float]:
    """Each job's quickest round in milliseconds, with all that it left to GL done; whatever else
    the machine does only adds to it. Jobs take turns, so that all meet the same disturbances; a
    first turn warms up."""
    finish = device().context.finish
    best = [math.inf] * len(jobs)
    for turn in range(rounds + 1):
        for place, job in enumerate(jobs):
            finish()
            started = time.perf_counter()
            job()
            finish()
            if turn:
                best[place] = min(best[place], 1e3 * (time.perf_counter() - started))
    return best
