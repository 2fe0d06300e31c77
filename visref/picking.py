"""Some of many: evenly picked, or each once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


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
