"""Threads that share what is to be done for a frame."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from typing import TypeVar

T = TypeVar("T")


class Crew:
    """So many threads, `workers`: whoever calls works too where that is one."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._pool = ThreadPoolExecutor(workers) if workers > 1 else None

    def on_all(self, work: Callable[[int], T], workers: int) -> list[T]:
        """What `work` gives for 0, 1, … at the same time, for as many as `workers`."""
        if self._pool is None or workers == 1:
            return [work(index) for index in range(workers)]
        return list(self._pool.map(work, range(workers)))

    def by_turns(
        self, work: Callable[[int], T], parts: range, workers: int | None = None
    ) -> list[T]:
        """What `work` gives for each part, in order: whichever thread is free takes the next.
        `workers`: how many may be at it, by default all."""
        turn = count()
        found: dict[int, T] = {}

        def take(_: int) -> None:
            while (index := next(turn)) < len(parts):
                found[index] = work(parts[index])

        self.on_all(take, min(workers or self.workers, len(parts)))
        return [found[index] for index in range(len(parts))]

    def in_bands(
        self, window: tuple[int, int, int, int], work: Callable[[tuple[int, int, int, int]], T]
    ) -> list[T]:
        """What `work` gives for each band of a window's rows, one per thread. Windows are columns
        and rows of an image, (x0, x1, y0, y1), x1 and y1 excluded."""
        x0, x1, y0, y1 = window
        bands = max(1, min(self.workers, y1 - y0))
        edges = [y0 + (y1 - y0) * band // bands for band in range(bands + 1)]
        return self.on_all(lambda band: work((x0, x1, edges[band], edges[band + 1])), bands)

    def close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown()
