"""Timing of small jobs on GL."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from visref_culling.gl.device import device


def quickest_ms(*jobs: Callable[[], object], rounds: int) -> list[float]:
    """Each job's quickest round in milliseconds, with all that it left to GL done; whatever else
    the machine does only adds to it. Jobs take turns, so that all meet the same disturbances. In
    its turn a job runs twice and is timed the second time: caches, state and what a driver puts
    off are then its own, and not those of the job before."""
    finish = device().context.finish
    best = [math.inf] * len(jobs)
    for _ in range(rounds):
        for place, job in enumerate(jobs):
            job()
            finish()
            started = time.perf_counter()
            job()
            finish()
            best[place] = min(best[place], 1e3 * (time.perf_counter() - started))
    return best
