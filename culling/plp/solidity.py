"""How much of the light through a cell its triangles stop: the solidity of PLP's cells.

Klosowski, Silva 2001, section 2.1, takes a cell's solidity from the number of its primitives
(`by_count`). A wall of two triangles stops more light than a bush of two thousand, so by default it
is their area here (`by_area`):

- Let the triangles of a cell, cut to it, cover the area A of the cell's face across an axis when
  they are projected along that axis. A ray along the axis through the face of area F then
  crosses A / F surfaces on average.
- Things have a front and a back: a ray that meets one crosses two surfaces. So the solidity along
  the axis is A / 2F, the things met; a wall across the cell has 1, a wall along the axis 0.
- Where things lie at random, a ray meets none with the probability exp(-solidity).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Float64, Scene
from visref_culling.plp.octree import Octree

# A convex polygon gains a corner with each of six planes: nine. Where rounding dents one, a plane
# may cut it in several places, but leaves at most half as many corners again: 28.
MOST_CORNERS = 28


def by_count(octree: Octree) -> Float64:
    """(n,) float64 in 0...1: each cell's triangles as a share of the fullest cell's. What follows
    compares solidities and their sums, so any common factor would do; the paper prints none."""
    sizes = octree.units.sizes
    return sizes / max(1, int(sizes.max(initial=0)))


def by_area(scene: Scene, octree: Octree) -> Float64:
    """(n, 3) float64, 0 or more: the things that a ray along each axis meets in each cell, on
    average."""
    surfaces = np.zeros((octree.leaf_count, 3))
    units = octree.units
    _surfaces(
        scene.vertices.astype(np.float64),
        scene.triangles,
        units.offsets,
        units.triangles,
        octree.bounds,
        surfaces,
    )
    return surfaces / 2.0


@njit()
def _surfaces(
    corners: NDArray[Any],
    triangles: NDArray[Any],
    offsets: NDArray[Any],
    members: NDArray[Any],
    bounds: NDArray[Any],
    surfaces: NDArray[Any],
) -> None:
    """Add up the projected areas of the cells' triangles, in units of the cells' faces."""
    polygon = np.empty((MOST_CORNERS, 3))
    cut = np.empty((MOST_CORNERS, 3))
    for cell in range(len(surfaces)):
        width = bounds[cell, 1, 0] - bounds[cell, 0, 0]
        for k in range(offsets[cell], offsets[cell + 1]):
            for i in range(3):
                for axis in range(3):
                    world = corners[triangles[members[k], i], axis]
                    # The cell is the unit cube: coordinates near 1 multiply without overflow.
                    polygon[i, axis] = (world - bounds[cell, 0, axis]) / width
            count = 3
            for axis in range(3):
                count = _cut(polygon, count, axis, 0.0, 1.0, cut)
                count = _cut(cut, count, axis, 1.0, -1.0, polygon)
            for i in range(2, count):
                e, f = polygon[i - 1] - polygon[0], polygon[i] - polygon[0]
                surfaces[cell, 0] += 0.5 * abs(e[1] * f[2] - e[2] * f[1])
                surfaces[cell, 1] += 0.5 * abs(e[2] * f[0] - e[0] * f[2])
                surfaces[cell, 2] += 0.5 * abs(e[0] * f[1] - e[1] * f[0])


@njit()
def _cut(
    polygon: NDArray[Any], count: int, axis: int, limit: float, sign: float, result: NDArray[Any]
) -> int:
    """The part of a convex polygon where sign * (coordinate - limit) >= 0; its corners."""
    made = 0
    for i in range(count):
        j = (i + 1) % count
        here, there = sign * (polygon[i, axis] - limit), sign * (polygon[j, axis] - limit)
        if here >= 0.0:
            for k in range(3):
                result[made, k] = polygon[i, k]
            made += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            part = here / (here - there)
            for k in range(3):
                result[made, k] = polygon[i, k] + part * (polygon[j, k] - polygon[i, k])
            made += 1
    return made
