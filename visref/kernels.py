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
    object_of_triangle: NDArray[Any],
    pixels: NDArray[Any],
    sample: NDArray[Any],
    nearest: NDArray[Any],
) -> None:
    """Per object: samples owned, the first of them, the least depth (all changed in place)."""
    for s in range(triangle.size):
        t = triangle[s]
        if t < 0 or not decided[s]:
            continue
        o = object_of_triangle[t]
        pixels[o] += 1
        if sample[o] < 0:
            sample[o] = s
        nearest[o] = min(nearest[o], depth[s])


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
