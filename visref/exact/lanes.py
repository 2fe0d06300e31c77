"""A cluster's triangles side by side: projected and set up a vector of them at a time.

All rows lie in one array, the workspace, `LANE_ROWS` of `LANE_STRIDE` float64: loops over lanes
that read and write one array at fixed distances are made into vector instructions. A lane is a
triangle. `CORNER` has nine rows, its corners; `BOX` four, its first and last pixel column and row
within a tile; `NEAREST` an upper bound of its key; `RANGED` is not 0 where the depth range must be
checked at each sample; `FUNCTION` has the rows of `visref.exact.filters.set_up`, in its layout;
`ORIENTED` is not 0 where the orientation is certain.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.exact.clusters import CLUSTER
from visref.exact.filters import (
    BOUND_0,
    KEY_PLANE,
    PIXEL_SLACK,
    PROJECT,
    PROJECT_CLIPPED,
    SET_UP_SIZE,
    Three,
    U,
    axes_of,
    functions,
)

CORNER, BOX, NEAREST, RANGED, FUNCTION = 0, 9, 13, 14, 15
ORIENTED = FUNCTION + SET_UP_SIZE
LANE_ROWS = ORIENTED + 1
# Not a power of two, so that the rows do not meet in the same lines of the cache.
LANE_STRIDE = CLUSTER + 8


@njit(error_model="numpy", inline="always")
def _less(x: float, y: float, z: float) -> float:
    smaller = x if x < y else y
    return smaller if smaller < z else z


@njit(error_model="numpy", inline="always")
def _more(x: float, y: float, z: float) -> float:
    greater = x if x > y else y
    return greater if greater > z else z


@njit(error_model="numpy")
def load(corners: NDArray[Any], start: int, count: int, work: NDArray[Any]) -> None:
    """Rows `CORNER` of some triangles in a row of `corners`, (t, 9) float32."""
    for i in range(count):
        for k in range(9):
            work[(CORNER + k) * LANE_STRIDE + i] = corners[start + i, k]


@njit(error_model="numpy")
def move(work: NDArray[Any], here: int, there: int) -> None:
    """Put a lane's corners, box and range in the place of another's."""
    for k in range(FUNCTION):
        work[k * LANE_STRIDE + there] = work[k * LANE_STRIDE + here]


@njit(error_model="numpy")
def project(
    work: NDArray[Any],
    count: int,
    size: float,
    perspective: bool,
    axes: tuple[Three, Three, Three, Three, Three],
    image: tuple[float, float, float, float],
    tile: tuple[float, float, float, float],
) -> None:
    """Rows `BOX`, `NEAREST` and `RANGED` of the first lanes; a box is empty where the triangle
    certainly owns nothing in the tile.

    `size`: at least the max-norm of any corner less the eye. `axes`: e, the dual vectors of x, y
    and z, and their 1-norms. `image`: the middle of it in pixels, near and far. `tile`: first and
    last column and row.

    For clusters that `visref.exact.screen.cluster_depths` gave a rectangle: in perspective every
    corner's view depth is above 2^11 times the error of one, and nothing overflows. Roundings as
    in `visref.exact.filters.PROJECT`. With depths Z, z and x-coordinates X, x, true and computed,
    X/Z is off x/z by at most (|x - X| + |X/Z| |z - Z|) / z, and |X/Z| is at most 1 + 2^-10 times
    |x/z| and what |x - X| adds: the factor 2 holds that, and the roundings of x/z itself, which
    are within `PROJECT_CLIPPED`, four times `PROJECT`.
    """
    e, dx, dy, dz, norms = axes
    middle_x, middle_y, near, far = image
    left, right, top, bottom = tile
    x_error, y_error = PROJECT_CLIPPED * norms[0] * size, PROJECT_CLIPPED * norms[1] * size
    z_error = PROJECT * norms[2] * size
    upward = 1.0 + 4.0 * U
    for i in range(count):
        px = work[i] - e[0]
        py = work[LANE_STRIDE + i] - e[1]
        pz = work[2 * LANE_STRIDE + i] - e[2]
        x0 = dx[0] * px + dx[1] * py + dx[2] * pz
        y0 = dy[0] * px + dy[1] * py + dy[2] * pz
        z0 = dz[0] * px + dz[1] * py + dz[2] * pz
        px = work[3 * LANE_STRIDE + i] - e[0]
        py = work[4 * LANE_STRIDE + i] - e[1]
        pz = work[5 * LANE_STRIDE + i] - e[2]
        x1 = dx[0] * px + dx[1] * py + dx[2] * pz
        y1 = dy[0] * px + dy[1] * py + dy[2] * pz
        z1 = dz[0] * px + dz[1] * py + dz[2] * pz
        px = work[6 * LANE_STRIDE + i] - e[0]
        py = work[7 * LANE_STRIDE + i] - e[1]
        pz = work[8 * LANE_STRIDE + i] - e[2]
        x2 = dx[0] * px + dx[1] * py + dx[2] * pz
        y2 = dy[0] * px + dy[1] * py + dy[2] * pz
        z2 = dz[0] * px + dz[1] * py + dz[2] * pz
        z_least, z_greatest = _less(z0, z1, z2) - z_error, _more(z0, z1, z2) + z_error
        ex0 = ex1 = ex2 = x_error
        ey0 = ey1 = ey2 = y_error
        if perspective:
            z0, z1, z2 = 1.0 / z0, 1.0 / z1, 1.0 / z2
            x0, x1, x2 = x0 * z0, x1 * z1, x2 * z2
            y0, y1, y2 = y0 * z0, y1 * z1, y2 * z2
            ex0 = 2.0 * (x_error + abs(x0) * z_error) * z0
            ex1 = 2.0 * (x_error + abs(x1) * z_error) * z1
            ex2 = 2.0 * (x_error + abs(x2) * z_error) * z2
            ey0 = 2.0 * (y_error + abs(y0) * z_error) * z0
            ey1 = 2.0 * (y_error + abs(y1) * z_error) * z1
            ey2 = 2.0 * (y_error + abs(y2) * z_error) * z2
        low = 0.5 * _less(x0 - ex0, x1 - ex1, x2 - ex2) + middle_x - PIXEL_SLACK
        high = 0.5 * _more(x0 + ex0, x1 + ex1, x2 + ex2) + middle_x + PIXEL_SLACK
        above = middle_y - 0.5 * _more(y0 + ey0, y1 + ey1, y2 + ey2) - PIXEL_SLACK
        below = middle_y - 0.5 * _less(y0 - ey0, y1 - ey1, y2 - ey2) + PIXEL_SLACK
        first, last = np.ceil(low), np.floor(high)
        out = (z_greatest < near) | (z_least > far)
        last = last if last < right else right
        work[BOX * LANE_STRIDE + i] = first if first > left else left
        work[(BOX + 1) * LANE_STRIDE + i] = -1.0 if out else last
        first, last = np.ceil(above), np.floor(below)
        work[(BOX + 2) * LANE_STRIDE + i] = first if first > top else top
        work[(BOX + 3) * LANE_STRIDE + i] = last if last < bottom else bottom
        closest = z_least if z_least > near else near
        # A hit has t >= near too. Two roundings of normal numbers; 4 u is upward.
        work[NEAREST * LANE_STRIDE + i] = (1.0 / closest) * upward if perspective else -z_least
        work[RANGED * LANE_STRIDE + i] = 0.0 if (z_least > near) & (z_greatest < far) else 1.0


@njit(error_model="numpy")
def set_up_lanes(work: NDArray[Any], count: int, perspective: bool, lens: NDArray[Any]) -> None:
    """Rows `FUNCTION` and `ORIENTED` of the first lanes; `lens`: the View's."""
    e, f, r, u, rest = axes_of(lens)
    for i in range(count):
        corners = (
            work[i],
            work[LANE_STRIDE + i],
            work[2 * LANE_STRIDE + i],
            work[3 * LANE_STRIDE + i],
            work[4 * LANE_STRIDE + i],
            work[5 * LANE_STRIDE + i],
            work[6 * LANE_STRIDE + i],
            work[7 * LANE_STRIDE + i],
            work[8 * LANE_STRIDE + i],
        )
        edges, key, bounds, certain = functions(corners, perspective, e, f, r, u, rest)
        # Written out: numba does not unroll a loop over a tuple, and what holds one is not made
        # into vector instructions.
        work[(FUNCTION + 0) * LANE_STRIDE + i] = edges[0]
        work[(FUNCTION + 1) * LANE_STRIDE + i] = edges[1]
        work[(FUNCTION + 2) * LANE_STRIDE + i] = edges[2]
        work[(FUNCTION + 3) * LANE_STRIDE + i] = edges[3]
        work[(FUNCTION + 4) * LANE_STRIDE + i] = edges[4]
        work[(FUNCTION + 5) * LANE_STRIDE + i] = edges[5]
        work[(FUNCTION + 6) * LANE_STRIDE + i] = edges[6]
        work[(FUNCTION + 7) * LANE_STRIDE + i] = edges[7]
        work[(FUNCTION + 8) * LANE_STRIDE + i] = edges[8]
        work[(FUNCTION + KEY_PLANE + 0) * LANE_STRIDE + i] = key[0]
        work[(FUNCTION + KEY_PLANE + 1) * LANE_STRIDE + i] = key[1]
        work[(FUNCTION + KEY_PLANE + 2) * LANE_STRIDE + i] = key[2]
        work[(FUNCTION + BOUND_0 + 0) * LANE_STRIDE + i] = bounds[0]
        work[(FUNCTION + BOUND_0 + 1) * LANE_STRIDE + i] = bounds[1]
        work[(FUNCTION + BOUND_0 + 2) * LANE_STRIDE + i] = bounds[2]
        work[(FUNCTION + BOUND_0 + 3) * LANE_STRIDE + i] = bounds[3]
        work[(FUNCTION + BOUND_0 + 4) * LANE_STRIDE + i] = bounds[4]
        work[(FUNCTION + BOUND_0 + 5) * LANE_STRIDE + i] = bounds[5]
        work[ORIENTED * LANE_STRIDE + i] = 1.0 if certain else 0.0
