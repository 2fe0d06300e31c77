"""Shapes cut into parts with boxes of their own: what a drawn shape marks."""

from __future__ import annotations

import numpy as np

from visref.scene import Float64, Int64, Scene, Units

# Of a shape's grid, a side; finer ones cost more to mark than their queries do.
MOST_CELLS = 32


def parts_of(scene: Scene, units: Units, cells: int) -> tuple[Float64, Int64]:
    """Cut each unit into boxes of its triangles, by the cell of a grid over the unit's box that
    a triangle's middle lies in, `cells` per side. Returns bounds (m, 2, 3) float64 and offsets
    (u + 1,) int64; together a unit's boxes hold all of it."""
    triangles = scene.triangles[units.triangles]
    bounds = scene.bounds_of(units)
    unit = np.repeat(np.arange(units.count), units.sizes)
    # An axis at a time: memory is then read in order.
    low, high = np.empty((2, 3, len(triangles)))
    key = unit
    for axis in range(3):
        along = np.ascontiguousarray(scene.vertices[:, axis])
        a, b, c = (along[triangles[:, corner]] for corner in range(3))
        low[axis], high[axis] = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        first, extent = bounds[:, 0, axis], bounds[:, 1, axis] - bounds[:, 0, axis]
        at = 0.5 * low[axis] + 0.5 * high[axis] - first[unit]
        at /= np.where(extent > 0.0, extent, 1.0)[unit]
        # An absent unit's triangles are somewhere, and its box is nowhere.
        at[extent[unit] < 0.0] = 0.0
        key = key * cells + np.minimum((at * cells).astype(np.int64), cells - 1)
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    boxes = np.empty((len(starts), 2, 3))
    if len(starts):
        for axis in range(3):
            boxes[:, 0, axis] = np.minimum.reduceat(low[axis][order], starts)
            boxes[:, 1, axis] = np.maximum.reduceat(high[axis][order], starts)
    offsets = np.searchsorted(unit[order][starts], np.arange(units.count + 1))
    return boxes, offsets
