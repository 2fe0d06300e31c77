"""Memory for truths that may be held side by side, without new pages for each."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Lender:
    """Lends arrays. What was lent is used again once nobody holds the array, or a view of it: pages
    that are there already cost nothing, new ones a twentieth of a cast. Any thread may ask."""

    def __init__(self) -> None:
        # By size: a power of two, so that what is lent fits what is asked for, though never the
        # same. Pages that nobody writes to are not there.
        self._free: dict[int, list[NDArray[np.uint8]]] = {}

    def lend(self, size: int, dtype: Any = np.int32) -> NDArray[Any]:
        """(size,) of that dtype, with anything in it."""
        kind = np.dtype(dtype)
        room = 1 << max(size * kind.itemsize - 1, 0).bit_length()
        free = self._free.setdefault(room, [])
        try:
            memory = free.pop()
        except IndexError:
            memory = np.empty(room, np.uint8)
        # Views of an array over something else keep that array alive, and not just the memory.
        lent = np.frombuffer(memory.data, kind, size)
        weakref.finalize(lent, free.append, memory).atexit = False
        return lent

    @property
    def unused(self) -> list[int]:
        """The sizes of what nobody holds, in bytes."""
        return [room for room, free in self._free.items() for _ in free]
