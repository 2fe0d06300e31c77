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
    corners = scene.vertices[scene.triangles[units.triangles]].astype(np.float64)
    low, high = corners.min(axis=1), corners.max(axis=1)
    unit = np.repeat(np.arange(units.count), units.sizes)
    bounds = scene.bounds_of(units)[unit]
    extent = bounds[:, 1] - bounds[:, 0]
    at = (0.5 * low + 0.5 * high - bounds[:, 0]) / np.where(extent > 0.0, extent, 1.0)
    at[extent < 0.0] = 0.0  # an absent unit's triangles are somewhere, and its box is nowhere
    cell = np.minimum((at * cells).astype(np.int64), cells - 1)
    key = unit * cells**3 + (cell[:, 0] * cells + cell[:, 1]) * cells + cell[:, 2]
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    if not len(starts):
        return np.zeros((0, 2, 3)), np.zeros(units.count + 1, np.int64)
    boxes = np.stack(
        [
            np.minimum.reduceat(low[order], starts, axis=0),
            np.maximum.reduceat(high[order], starts, axis=0),
        ],
        axis=1,
    )
    offsets = np.searchsorted(unit[order][starts], np.arange(units.count + 1))
    return boxes, offsets
