"""Things of different scenes measured at once, each worker on cores of its own.

What stands beside each other in a table is measured by one process, one thing after the other, so a
worker has cores that no other one has, and as many threads; what hangs on the whole machine is
measured alone (`visref.tables.plan.side_by_side`). A worker takes the next group of tasks whenever
it has done one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

from visref.errors import InputError
from visref.forked import Tell, Work, at_work
from visref.memory import default_budget
from visref.tables.plan import Task
from visref.tables.progress import Progress
from visref.threads import available_threads

# What a worker holds at most: the largest scenes have a few million triangles.
WORKER_BYTES = 3 << 30

# Does tasks with so many threads (None: as many as there are), and says what failed and why, by
# `PAPER/KEY`.
Measure = Callable[[Sequence[Task], Progress, int | None], dict[str, str]]
Wait = Callable[[Progress], dict[str, str]]


def default_workers() -> int:
    """One per core, where memory allows."""
    if not hasattr(os, "fork"):
        return 1
    return max(1, min(available_threads(), default_budget() // WORKER_BYTES))


@contextmanager
def measuring_at_once(
    measure: Measure, groups: Sequence[Sequence[Task]], workers: int
) -> Iterator[Wait]:
    """Workers do the groups while the block lasts; what it yields waits for them, and says what
    failed. To be entered before this process has threads of its own. Raises InputError where the
    system cannot copy a process; the waiting raises RuntimeError where a worker broke down."""
    if not hasattr(os, "fork"):
        raise InputError("--workers: this system cannot copy a process", fix="leave it out")
    following = get_context("fork").Value("q", 0)

    def work_on(cores: Sequence[int]) -> Work:
        def work(tell: Tell) -> None:
            if cores:
                os.sched_setaffinity(0, cores)
            threads = len(cores) or 1
            os.environ.setdefault("LP_NUM_THREADS", str(threads))
            while True:
                with following.get_lock():
                    number = following.value
                    following.value += 1
                if number >= len(groups):
                    return
                tell({"failed": measure(groups[number], _Telling(tell), threads)})

        return work

    shares = cores_of(min(workers, len(groups)))
    with at_work([work_on(cores) for cores in shares]) as copies:

        def wait(progress: Progress) -> dict[str, str]:
            failures: dict[str, str] = {}

            def on_told(told: dict[str, Any]) -> None:
                if "task" in told:
                    progress.task(told["task"])
                if "steps" in told:
                    progress.advance(told["steps"])
                failures.update(told.get("failed", {}))

            copies.wait(on_told)
            return failures

        yield wait


def cores_of(workers: int) -> list[list[int]]:
    """For each worker the cores that are its own; none where there are not enough, or where the
    system does not say which there are."""
    if not hasattr(os, "sched_getaffinity"):
        return [[] for _ in range(workers)]
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < workers:
        return [[] for _ in range(workers)]
    return [
        cores[number * len(cores) // workers : (number + 1) * len(cores) // workers]
        for number in range(workers)
    ]


class _Telling:
    """The progress of a worker, told to who waits for it."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell

    def begin(self, steps: int) -> None:
        raise AssertionError("who waits says what there is to do")

    def task(self, label: str) -> None:
        self._tell({"task": label})

    def advance(self, steps: float) -> None:
        self._tell({"steps": steps})
