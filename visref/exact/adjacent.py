"""Whether one triangle goes on where another ends, as seen from the eye: what a patch grows by."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.exact.filters import View


@njit(error_model="numpy")
def _side(p: NDArray[Any], i: int, view: View) -> tuple[float, float]:
    """On which side of the plane through the eye and edge i (orthographic: along the view)
    the opposite corner lies, with a bound of the error: the sign is certain above it."""
    w = np.empty((3, 3))
    size = 0.0
    for corner in range(3):
        for k in range(3):
            w[corner, k] = np.float64(p[3 * ((i + corner) % 3) + k]) - view.e[k]
            size = max(size, abs(w[corner, k]))
    if view.perspective:
        ax, ay, az = w[0]
        bx, by, bz = w[1]
        cx, cy, cz = w[2]
    else:
        ax, ay, az = w[1] - w[0]
        bx, by, bz = view.f
        cx, cy, cz = w[2] - w[0]
    value = cx * (ay * bz - az * by) + cy * (az * bx - ax * bz) + cz * (ax * by - ay * bx)
    # As filters.PERSPECTIVE_SIGN, with differences of w up to twice its size; far outward.
    return value, 2.0**-44 * size * size * (size if view.perspective else view.f_norm)


@njit(error_model="numpy")
def _same_point(p: NDArray[Any], i: int, q: NDArray[Any], j: int) -> bool:
    same: bool = (
        p[3 * i] == q[3 * j] and p[3 * i + 1] == q[3 * j + 1] and p[3 * i + 2] == q[3 * j + 2]
    )
    return same


@njit(error_model="numpy")
def continues(p: NDArray[Any], edge: int, q: NDArray[Any], view: View) -> bool:
    """Whether triangle q shares p's edge and lies on its other side on the screen. Triangles:
    (9,) float32 corners; edge 0 is a -> b, 1 b -> c, 2 c -> a."""
    start, end = edge, (edge + 1) % 3
    for j in range(3):
        k = (j + 1) % 3
        same = _same_point(p, start, q, j) and _same_point(p, end, q, k)
        turned = _same_point(p, start, q, k) and _same_point(p, end, q, j)
        if same or turned:
            mine, my_error = _side(p, edge, view)
            other, other_error = _side(q, j, view)
            if abs(mine) <= my_error or abs(other) <= other_error:
                return False
            # Opposite sides of the edge taken in one direction.
            opposite: bool = ((mine > 0.0) == (other > 0.0)) == turned
            return opposite
    return False
