"""Some of many, evenly picked: one rule wherever not all frames or units can be looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def evenly_picked(count: int, at_most: int) -> NDArray[np.int64]:
    """Ascending int64 positions below `count`: all of them, or `at_most` evenly spread ones,
    the first and (of two or more) the last among them."""
    size = min(count, at_most)
    return np.unique(np.linspace(0, count - 1, size).astype(np.int64))
