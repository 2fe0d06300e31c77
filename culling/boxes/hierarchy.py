"""A bounding-volume hierarchy over units: which meet the view, and in what order.

Boxes are sorted along a Morton curve through their centres; eight neighbours at a time make a
node of the level above. There are no pointers: node i of a level has the children 8i ... 8i + 7
of the level below, so building and descending are whole-array operations.
"""

from __future__ import annotations

import numpy as np

from visref.scene import Float64, Int64
from visref_culling.boxes.conservative import inflated, meets_frustum
from visref_culling.gl.view import View

FAN_OUT = 8
MORTON_BITS = 10  # per axis; only the tree's quality hangs on it


class BoxTree:
    """Over `bounds`: (n, 2, 3) float64 world boxes, (+inf, -inf) for an empty unit, which is
    never found. `ids`: the units in tree order; `levels[0]` their boxes, `levels[-1]` the root.
    """

    def __init__(self, bounds: Float64) -> None:
        filled = np.flatnonzero(bounds[:, 0, 0] <= bounds[:, 1, 0])
        self.ids: Int64 = filled[np.argsort(_morton(bounds[filled]), kind="stable")]
        self.levels = levels_over(bounds[self.ids])

    def in_frustum(self, view: View) -> Int64:
        """(k,) int64: the units whose inflated boxes meet the view, ascending."""
        nodes = np.arange(len(self.levels[-1]))
        for depth in range(len(self.levels) - 1, -1, -1):
            boxes = self.levels[depth]
            nodes = nodes[meets_frustum(view, inflated(view, boxes[nodes]))]
            if depth:
                children = (nodes[:, None] * FAN_OUT + np.arange(FAN_OUT)).reshape(-1)
                nodes = children[children < len(self.levels[depth - 1])]
        return np.sort(self.ids[nodes])


def levels_over(leaves: Float64) -> list[Float64]:
    """The boxes of each level, (n, 2, 3) float64: those of the leaves, (k, 2, 3), first, of the
    root last."""
    levels = [leaves]
    while len(levels[-1]) > 1:
        below = levels[-1]
        starts = np.arange(0, len(below), FAN_OUT)
        low = np.minimum.reduceat(below[:, 0], starts, axis=0)
        high = np.maximum.reduceat(below[:, 1], starts, axis=0)
        levels.append(np.stack([low, high], axis=1))
    return levels


def front_to_back(ids: Int64, nearest_depth: Float64) -> Int64:
    """Indices into `ids`, (k,) int64, by the view depth of the nearest corner, (k,) float64;
    equals by id."""
    return np.lexsort((ids, nearest_depth))


def _morton(bounds: Float64) -> Int64:
    """(k,) int64 keys of the boxes' centres on a curve over their common box."""
    if not len(bounds):
        return np.zeros(0, np.int64)
    # Halved first: the sum of two float32 maxima is finite, a median of such sums need not be.
    centres = 0.5 * bounds[:, 0] + 0.5 * bounds[:, 1]
    order = np.argsort(np.argsort(centres, axis=0, kind="stable"), axis=0, kind="stable")
    # By rank, not by position: one stray box far away must not squeeze all others into a cell.
    cells = order * (1 << MORTON_BITS) // len(bounds)
    keys = np.zeros(len(bounds), np.int64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            keys |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return keys
