"""The few compiled loops over samples that NumPy would make several passes of."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True, nogil=True)
def gather_objects(
    triangle: NDArray[Any],
    depth: NDArray[Any],
    decided: NDArray[Any],
    tie_sample: NDArray[Any],
    tie_triangle: NDArray[Any],
    object_of_triangle: NDArray[Any],
    pixels: NDArray[Any],
    alone: NDArray[Any],
    alone_sample: NDArray[Any],
    tied_sample: NDArray[Any],
    nearest: NDArray[Any],
) -> None:
    """Per object, all changed in place: samples owned, those of them owned alone, the first of
    either kind (alone, tied), the least depth. Ties are sorted by sample, then triangle; since
    triangles are grouped by object, those of one object at a sample stand together."""
    k = 0
    for s in range(triangle.size):
        start = k
        while k < tie_sample.size and tie_sample[k] == s:
            k += 1
        t = triangle[s]
        if t < 0 or not decided[s]:
            continue
        owner = object_of_triangle[t]
        others, last = 0, owner
        for j in range(start, k):
            o = object_of_triangle[tie_triangle[j]]
            if o in (owner, last):
                continue
            others, last = others + 1, o
            pixels[o] += 1
            nearest[o] = min(nearest[o], depth[s])
            if tied_sample[o] < 0:
                tied_sample[o] = s
        pixels[owner] += 1
        nearest[owner] = min(nearest[owner], depth[s])
        if others == 0:
            alone[owner] += 1
            if alone_sample[owner] < 0:
                alone_sample[owner] = s
        elif tied_sample[owner] < 0:
            tied_sample[owner] = s


@numba.njit(cache=True, nogil=True)
def owned_triangles(triangle: NDArray[Any], decided: NDArray[Any], owns: NDArray[Any]) -> None:
    """Mark in `owns` every triangle that owns a decided sample."""
    for s in range(triangle.size):
        if triangle[s] >= 0 and decided[s]:
            owns[triangle[s]] = True


@numba.njit(cache=True, nogil=True)
def undrawn_samples(
    triangle: NDArray[Any], decided: NDArray[Any], drawn: NDArray[Any]
) -> NDArray[np.int64]:
    """Flat indices, ascending, of the decided samples whose owner was not drawn."""
    count = 0
    for s in range(triangle.size):
        if triangle[s] >= 0 and decided[s] and not drawn[triangle[s]]:
            count += 1
    result = np.empty(count, np.int64)
    count = 0
    for s in range(triangle.size):
        if triangle[s] >= 0 and decided[s] and not drawn[triangle[s]]:
            result[count] = s
            count += 1
    return result


@numba.njit(cache=True, nogil=True)
def judge_samples(
    triangle: NDArray[Any],
    decided: NDArray[Any],
    tie_sample: NDArray[Any],
    tie_triangle: NDArray[Any],
    drawn: NDArray[Any],
    object_of_triangle: NDArray[Any],
    shows: NDArray[Any],
    lost: NDArray[Any],
    lost_sample: NDArray[Any],
) -> int:
    """One pass over a frame's samples; returns how many are missed.

    `shows[o]` becomes True where a sample owned by object o has o's triangle drawn;
    `lost[o]` counts o's samples at which nothing at the nearest depth was drawn, and
    `lost_sample[o]` is the first of them. Ties are sorted by sample.
    """
    missed = 0
    k = 0
    for s in range(triangle.size):
        start = k
        while k < tie_sample.size and tie_sample[k] == s:
            k += 1
        t = triangle[s]
        if t < 0 or not decided[s]:
            continue
        shown = drawn[t]
        for j in range(start, k):
            shown = shown or drawn[tie_triangle[j]]
        if not shown:
            missed += 1
        for j in range(start - 1, k):
            u = t if j < start else tie_triangle[j]
            o = object_of_triangle[u]
            if drawn[u]:
                shows[o] = True
            elif not shown:
                if lost_sample[o] < 0:
                    lost_sample[o] = s
                # Samples arrive in order, so this counts each sample once an object.
                repeated = False
                for i in range(start - 1, j):
                    earlier = t if i < start else tie_triangle[i]
                    repeated = repeated or object_of_triangle[earlier] == o
                if not repeated:
                    lost[o] += 1
    return missed


@numba.njit(cache=True, nogil=True)
def unit_bounds(
    vertices: NDArray[Any],
    triangles: NDArray[Any],
    offsets: NDArray[Any],
    unit_triangles: NDArray[Any],
    bounds: NDArray[Any],
) -> None:
    """Fill in each unit's least and greatest corner, (u, 2, 3); (+inf, -inf) if it is empty."""
    for unit in range(len(offsets) - 1):
        for axis in range(3):
            bounds[unit, 0, axis], bounds[unit, 1, axis] = np.inf, -np.inf
        for k in range(offsets[unit], offsets[unit + 1]):
            for corner in range(3):
                vertex = triangles[unit_triangles[k], corner]
                for axis in range(3):
                    value = vertices[vertex, axis]
                    bounds[unit, 0, axis] = min(bounds[unit, 0, axis], value)
                    bounds[unit, 1, axis] = max(bounds[unit, 1, axis], value)
