"""The hierarchy whose nodes are remembered: over the same units for good, its boxes refitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.scene import Float64, Int64
from visref_culling.boxes.hierarchy import FAN_OUT, levels_over

INNER = -1
NO_PARENT = -1

# Boxes below a node stand for its own while their surfaces are at most this part of its own: more
# boxes are more to rasterise.
MOST_SURFACE = 1.4


class Nodes:
    """All nodes over some units, level after level: the leaves first, in the units' order, the root
    last.

    `order`: (k,) int64, the units of the leaves, neighbours beside each other. `tight`: how many
    levels below a node its tight boxes may lie.

    `unit`: (n,) int64, `INNER` for a node that is no leaf; `parent`: (n,) int64, `NO_PARENT` for
    the root; `first_child`, `end_child`: (n,) int64, a range of nodes. Of `refit`: `boxes`: (n, 2,
    3) float64 in world space; `there`: (n,) bool, whether a node holds anything (the box of one
    that does not is a point); `first_tight`, `end_tight`: (n,) int64, a range of nodes whose boxes
    together hold all that the node holds.
    """

    def __init__(self, order: Int64, tight: int = 0) -> None:
        self.order, self.tight = order, tight
        sizes = [len(order)] if len(order) else []
        while sizes and sizes[-1] > 1:
            sizes.append(-(-sizes[-1] // FAN_OUT))
        self.starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self.count = int(self.starts[-1])
        self.unit = np.full(self.count, INNER, np.int64)
        self.unit[: len(order)] = order
        self.parent = np.full(self.count, NO_PARENT, np.int64)
        self.first_child, self.end_child = np.zeros((2, self.count), np.int64)
        for level in range(1, len(sizes)):
            within, first, end = self._ranges(level, 1)
            self.first_child[within], self.end_child[within] = first, end
            below = np.arange(sizes[level - 1])
            self.parent[self.starts[level - 1] + below] = within.start + below // FAN_OUT

    def refit(self, bounds: Float64) -> None:
        """Boxes of the units as they stand now, (u, 2, 3) float64 in world space, (+inf, -inf) for
        one that is absent."""
        levels = levels_over(bounds[self.order]) if self.count else [np.zeros((0, 2, 3))]
        self.boxes: Float64 = np.concatenate(levels)
        self.there: NDArray[np.bool_] = self.boxes[:, 0, 0] <= self.boxes[:, 1, 0]
        for level in range(len(levels) - 1, -1, -1):
            empty = np.arange(self.starts[level], self.starts[level] + len(levels[level]))
            empty = empty[~self.there[empty]]
            above = self.parent[empty]
            corner = np.where(above[:, None] == NO_PARENT, 0.0, self.boxes[above, 0])
            self.boxes[empty] = corner[:, None]
        self._find_tight()

    def _find_tight(self) -> None:
        """The deepest boxes of so many levels whose surfaces together are small enough."""
        self.first_tight = np.arange(self.count)
        self.end_tight = self.first_tight + 1
        x, y, z = (self.boxes[:, 1] - self.boxes[:, 0]).T
        surface = 2.0 * (x * y + y * z + z * x)
        for level in range(1, len(self.starts) - 1):
            for depth in range(1, min(self.tight, level) + 1):
                within, first, end = self._ranges(level, depth)
                below = surface[self.starts[level - depth] : self.starts[level - depth + 1]]
                together = np.add.reduceat(below, np.arange(0, len(below), FAN_OUT**depth))
                small = together <= MOST_SURFACE * surface[within]
                self.first_tight[within][small] = first[small]
                self.end_tight[within][small] = end[small]

    def _ranges(self, level: int, depth: int) -> tuple[slice, Int64, Int64]:
        """The nodes of a level, and of each the first and the end of those `depth` levels below."""
        start, end = int(self.starts[level]), int(self.starts[level + 1])
        below, end_below = self.starts[level - depth], self.starts[level - depth + 1]
        first = below + np.arange(end - start) * FAN_OUT**depth
        return slice(start, end), first, np.minimum(first + FAN_OUT**depth, end_below)
