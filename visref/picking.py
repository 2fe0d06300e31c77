"""Some of many: evenly picked, or each once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Shard:
    """One of several contiguous parts of a run: the `number`-th, from 1, of `count`. Parts differ
    by one frame at most."""

    number: int
    count: int

    def of(self, frames: Sequence[int]) -> Sequence[int]:
        """The frames of this part; none where there are more parts than frames."""
        start, stop = (len(frames) * n // self.count for n in (self.number - 1, self.number))
        return frames[start:stop]

    @property
    def begins(self) -> bool:
        """Whether no frame of the run is before it."""
        return self.number == 1

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


@dataclass(frozen=True)
class Stretch:
    """A contiguous part of a run: its frames from the place `start`, from 0, to before `stop`."""

    start: int
    stop: int

    def of(self, frames: Sequence[int]) -> Sequence[int]:
        """The frames of this part."""
        return frames[self.start : self.stop]

    @property
    def begins(self) -> bool:
        """Whether no frame of the run is before it."""
        return self.start == 0

    def __str__(self) -> str:
        return f"{self.start}:{self.stop}"


def stretches(places: Sequence[int]) -> list[Stretch]:
    """The fewest stretches that these places make, ascending and each once."""
    found: list[Stretch] = []
    for place in places:
        if found and found[-1].stop == place:
            found[-1] = Stretch(found[-1].start, place + 1)
        else:
            found.append(Stretch(place, place + 1))
    return found


def evenly_picked(count: int, at_most: int) -> NDArray[np.int64]:
    """(k,) int64, ascending positions below `count`: all of them, or `at_most` evenly spread ones,
    the first and (of two or more) the last among them."""
    size = min(count, at_most)
    return np.unique(np.linspace(0, count - 1, size).astype(np.int64))


def distinct(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """The values, (k,) int64, ascending and each once. By sorting: `np.unique` hashes integers,
    which takes many times as long on the millions of samples of a frame."""
    ordered = np.sort(values)
    fresh = np.ones(len(ordered), np.bool_)
    fresh[1:] = ordered[1:] != ordered[:-1]
    return ordered[fresh]
