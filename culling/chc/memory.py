"""What a view remembers of a hierarchy's nodes from one frame to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.scene import Int64

NEVER = -2  # before the frame before the first

_MIX = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1))
_STEP = 0x9E3779B97F4A7C15
_WORD = (1 << 64) - 1


class Memory:
    """Of (n) nodes, in one view's frames.

    `frame`: int, of the frame that is being decided. `visible`: (n,) bool, found visible when last
    looked at; `looked`: (n,) int64, the frame of that; `due`: (n,) int64, the frame from which on a
    visible leaf is asked again, 0 before its first answer; `hidden_for`: (n,) int64, how often in
    a row it was found hidden.
    """

    def __init__(self, nodes: int) -> None:
        self.frame = 0
        self.visible: NDArray[np.bool_] = np.zeros(nodes, np.bool_)
        self.looked: Int64 = np.full(nodes, NEVER, np.int64)
        self.due: Int64 = np.zeros(nodes, np.int64)
        self.hidden_for: Int64 = np.zeros(nodes, np.int64)

    def looked_last(self, node: int) -> bool:
        """Whether the node was looked at in the frame before."""
        return bool(self.looked[node] == self.frame - 1)


def drawn_by_lot(node: int, frame: int, below: int) -> int:
    """A number from 0 to `below` - 1 that looks random, the same for the same node and frame
    (G. L. Steele Jr., D. Lea, C. H. Flood: Fast Splittable Pseudorandom Number Generators. OOPSLA
    2014)."""
    word = (node * _STEP + frame) * _STEP & _WORD
    for shift, factor in _MIX:
        word = (word ^ (word >> shift)) * factor & _WORD
    return word % below
