"""Compiled loops that look through masked triangles, front to back, as far as anything shows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines.ray_kernels import SampleGrid, Triangles, corner
from visref.engines.splat_kernels import Hits
from visref.masks.hits import state_at
from visref.masks.lookup import BETWEEN, HOLE, SOLID
from visref.masks.store import MaskArrays


@njit()
def front_to_back(
    hits: Hits, window: tuple[int, int, int, int], width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The hits of a window (`splat_kernels.splat`) in order: by sample, depth, then triangle; and
    where each of the window's samples begins among them. (h,) and (samples of the window + 1,)
    int64, its samples row by row; `width` is the image's."""
    sample, triangle, depth, _ = hits
    x0, x1, y0, y1 = window
    across = x1 - x0
    starts = np.zeros(across * (y1 - y0) + 1, np.int64)
    place = np.empty(len(sample), np.int64)
    for k in range(len(sample)):
        place[k] = (sample[k] // width - y0) * across + sample[k] % width - x0
        starts[place[k] + 1] += 1
    for i in range(len(starts) - 1):
        starts[i + 1] += starts[i]
    order, filled = np.empty(len(sample), np.int64), starts[:-1].copy()
    for k in range(len(sample)):
        order[filled[place[k]]] = k
        filled[place[k]] += 1
    for i in range(len(starts) - 1):
        begin, end = starts[i], starts[i + 1]
        # Shell's method: a sample has a few hits, rarely hundreds.
        gap = (end - begin) // 2
        while gap > 0:
            for j in range(begin + gap, end):
                k, at = order[j], j
                while at - gap >= begin:
                    other = order[at - gap]
                    if depth[other] < depth[k] or (
                        depth[other] == depth[k] and triangle[other] < triangle[k]
                    ):
                        break
                    order[at] = other
                    at -= gap
                order[at] = k
            gap //= 2
    return order, starts


@njit(error_model="numpy", makes_arrays=False)
def states(
    masks: MaskArrays,
    row_of_triangle: NDArray[Any],
    axes: NDArray[Any],
    mesh: Triangles,
    grid: SampleGrid,
    hits: Hits,
    order: NDArray[Any],
    starts: NDArray[Any],
    behind: NDArray[Any],
    state: NDArray[Any],
) -> None:
    """SOLID, HOLE or BETWEEN of hits in order (`front_to_back`), into `state`, (h,) uint8: as far
    as the first that is SOLID and before the owner, and what rounding may put before that. What
    lies further back counts for nothing, and is a HOLE.

    `row_of_triangle`: (t,) int, which of `masks` a triangle has, negative where that is not known:
    then it is BETWEEN. `axes`: (4, 3) float64, e, F, R, U. `behind`: one float64 per sample of the
    window, its owner's depth.
    """
    sample, triangle, depth, bound = hits
    width = len(grid.column_a)
    perspective = grid.perspective
    for i in range(len(starts) - 1):
        limit, solid = np.inf, False
        for j in range(starts[i], starts[i + 1]):
            k = order[j]
            state[k] = HOLE
            if depth[k] - bound[k] > limit:
                continue
            t = triangle[k]
            row = row_of_triangle[t]
            found = BETWEEN
            if row >= 0:
                found = state_at(
                    masks,
                    row,
                    axes,
                    grid.column_a[sample[k] % width],
                    grid.row_b[sample[k] // width],
                    perspective,
                    corner(mesh, t, 0),
                    corner(mesh, t, 1),
                    corner(mesh, t, 2),
                )
            state[k] = found
            if found == SOLID and not solid:
                solid = True
                if depth[k] < behind[i]:
                    limit = depth[k] + bound[k]
