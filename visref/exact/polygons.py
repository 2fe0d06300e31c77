"""A triangle on the screen, and distances in pixels to it: geometry for the margins.

A polygon is the first `count` rows of an (n, 3) float64 array of corners (x, y, q): pixel
coordinates, in which a sample stands at integers, and the key of `visref.exact.filters`, which is
affine on the screen.
`tags` say which edge of the triangle starts at each corner: 0 for a -> b, 1 for b -> c, 2 for
c -> a, `CLIPPED` for the near clip's own edge.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.exact.filters import PIXEL_SLACK, PROJECT, PROJECT_CLIPPED, View
from visref.exact.screen import CLIP_SLACK

CLIPPED = 3
# A triangle clipped by one plane has at most four corners; one more plane (two keys' order)
# and three edges of another triangle's at most four, each add one.
MOST_CORNERS = 12


@njit(error_model="numpy")
def screen_polygon(
    p: NDArray[Any], view: View, polygon: NDArray[Any], tags: NDArray[Any]
) -> tuple[int, float]:
    """Project (9,) float32 corners: (how many corners, how far in pixels each may be off).

    Written: `polygon`, (4, 3) float64, and `tags`, (4,) int8. Zero corners where nothing lies
    behind the near clip. A triangle so far out that its projection is not bounded gets an infinite
    error.
    """
    x, y, z = np.empty(3), np.empty(3), np.empty(3)
    size = 0.0
    for i in range(3):
        wx = np.float64(p[3 * i]) - view.e[0]
        wy = np.float64(p[3 * i + 1]) - view.e[1]
        wz = np.float64(p[3 * i + 2]) - view.e[2]
        size = max(size, max(abs(wx), max(abs(wy), abs(wz))))
        x[i] = view.x_dual[0] * wx + view.x_dual[1] * wy + view.x_dual[2] * wz
        y[i] = view.y_dual[0] * wx + view.y_dual[1] * wy + view.y_dual[2] * wz
        z[i] = view.z_dual[0] * wx + view.z_dual[1] * wy + view.z_dual[2] * wz
    middle_x = 0.5 * (view.width - 1) - view.shift_x_px
    middle_y = 0.5 * (view.height - 1) - view.shift_y_px
    x_error = PROJECT_CLIPPED * view.x_norm * size
    y_error = PROJECT_CLIPPED * view.y_norm * size
    if not view.perspective:
        for i in range(3):
            polygon[i, 0] = 0.5 * x[i] + middle_x
            polygon[i, 1] = middle_y - 0.5 * y[i]
            polygon[i, 2] = -z[i]
            tags[i] = i
        return 3, max(x_error, y_error) + PIXEL_SLACK
    z_error = PROJECT * view.z_norm * size
    clip = view.near * (1.0 - CLIP_SLACK)
    count = 0
    error = 0.0 if z_error < view.near * (0.5 * CLIP_SLACK) else np.inf
    for i in range(3):
        j = i + 1 if i < 2 else 0
        for step in range(2):
            if step == 0:
                if z[i] < clip:
                    continue
                a, b, depth, tag = x[i], y[i], z[i], i
            else:
                if (z[i] >= clip) == (z[j] >= clip):
                    continue
                part = (clip - z[i]) / (z[j] - z[i])
                a, b, depth = x[i] + part * (x[j] - x[i]), y[i] + part * (y[j] - y[i]), clip
                # Going out, the clip's own edge starts here; coming in, the rest of edge i.
                tag = CLIPPED if z[i] >= clip else i
            inverse = 1.0 / depth
            a, b = a * inverse, b * inverse
            polygon[count, 0] = 0.5 * a + middle_x
            polygon[count, 1] = middle_y - 0.5 * b
            polygon[count, 2] = inverse
            tags[count] = tag
            count += 1
            error = max(error, (x_error + abs(a) * z_error) * inverse)
            error = max(error, (y_error + abs(b) * z_error) * inverse)
    return count, error + PIXEL_SLACK


@njit(error_model="numpy")
def distance_to_segment(x: float, y: float, x0: float, y0: float, x1: float, y1: float) -> float:
    dx, dy = x1 - x0, y1 - y0
    length = dx * dx + dy * dy
    part = 0.0
    if length > 0.0:
        part = ((x - x0) * dx + (y - y0) * dy) / length
        part = min(1.0, max(0.0, part))
    return math.hypot(x0 + part * dx - x, y0 + part * dy - y)


@njit(error_model="numpy")
def distance_to_polygon(x: float, y: float, polygon: NDArray[Any], count: int) -> float:
    """Zero inside a convex polygon, (n, 3), of either winding, else the pixels to its rim; inf
    for none."""
    if count == 0:
        return np.inf
    left = right = False
    nearest = np.inf
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        x0, y0, x1, y1 = polygon[i, 0], polygon[i, 1], polygon[j, 0], polygon[j, 1]
        side = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)
        left = left or side > 0.0
        right = right or side < 0.0
        nearest = min(nearest, distance_to_segment(x, y, x0, y0, x1, y1))
    return 0.0 if left != right else nearest


@njit(error_model="numpy")
def clip_polygon(
    polygon: NDArray[Any], count: int, a: float, b: float, c: float, out: NDArray[Any]
) -> int:
    """The part of a convex polygon, (n, 3), where a x + b y + c >= 0, into `out`, which has room
    for one corner more: (n + 1, 3). Returns how many corners."""
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here = a * polygon[i, 0] + b * polygon[i, 1] + c
        there = a * polygon[j, 0] + b * polygon[j, 1] + c
        if here >= 0.0:
            for k in range(3):
                out[kept, k] = polygon[i, k]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            part = here / (here - there)
            for k in range(3):
                out[kept, k] = polygon[i, k] + part * (polygon[j, k] - polygon[i, k])
            kept += 1
    return kept


@njit(error_model="numpy")
def key_plane(polygon: NDArray[Any], count: int) -> tuple[bool, float, float, float]:
    """The key's plane over the screen, q = c + gx x + gy y, of a polygon (n, 3): (whether it has
    area, c, gx, gy)."""
    # The corner triple with the greatest area, which conditions the gradient best.
    best, bi = 0.0, 1
    for i in range(1, count - 1):
        ux, uy = polygon[i, 0] - polygon[0, 0], polygon[i, 1] - polygon[0, 1]
        vx, vy = polygon[i + 1, 0] - polygon[0, 0], polygon[i + 1, 1] - polygon[0, 1]
        area = ux * vy - uy * vx
        if abs(area) > abs(best):
            best, bi = area, i
    if best == 0.0:
        return False, 0.0, 0.0, 0.0
    ux, uy = polygon[bi, 0] - polygon[0, 0], polygon[bi, 1] - polygon[0, 1]
    vx, vy = polygon[bi + 1, 0] - polygon[0, 0], polygon[bi + 1, 1] - polygon[0, 1]
    du, dv = polygon[bi, 2] - polygon[0, 2], polygon[bi + 1, 2] - polygon[0, 2]
    gx, gy = (du * vy - dv * uy) / best, (dv * ux - du * vx) / best
    return True, polygon[0, 2] - gx * polygon[0, 0] - gy * polygon[0, 1], gx, gy


@njit(error_model="numpy")
def key_range(
    x: float, y: float, radius: float, polygon: NDArray[Any], count: int
) -> tuple[float, float]:
    """Bounds of the key over the part of a polygon, (n, 3), within `radius` pixels of a point: the
    plane's over the disc, cut to the corners' (a sliver's plane may rise without limit)."""
    least, greatest = np.inf, -np.inf
    for i in range(count):
        least, greatest = min(least, polygon[i, 2]), max(greatest, polygon[i, 2])
    flat, c, gx, gy = key_plane(polygon, count)
    if flat:
        middle, reach = c + gx * x + gy * y, math.hypot(gx, gy) * radius
        least, greatest = max(least, middle - reach), min(greatest, middle + reach)
    return least, greatest


@njit(error_model="numpy")
def distance_to_hiding(
    x: float,
    y: float,
    near_one: NDArray[Any],
    near_count: int,
    far_one: NDArray[Any],
    far_count: int,
    scratch: NDArray[Any],
) -> float:
    """Pixels from a point to where the first polygon lies over the second and no farther.

    `near_one`, `far_one`: (n, 3); `scratch`: (2, MOST_CORNERS, 3) float64, overwritten.
    """
    a, b = scratch[0], scratch[1]
    for i in range(near_count):
        for k in range(3):
            a[i, k] = near_one[i, k]
    count = near_count
    # Which way the second winds, so that its inside is positive.
    area = 0.0
    for i in range(1, far_count - 1):
        area += (far_one[i, 0] - far_one[0, 0]) * (far_one[i + 1, 1] - far_one[0, 1])
        area -= (far_one[i, 1] - far_one[0, 1]) * (far_one[i + 1, 0] - far_one[0, 0])
    turn = 1.0 if area > 0.0 else -1.0
    for i in range(far_count):
        j = i + 1 if i + 1 < far_count else 0
        nx = -turn * (far_one[j, 1] - far_one[i, 1])
        ny = turn * (far_one[j, 0] - far_one[i, 0])
        count = clip_polygon(a, count, nx, ny, -(nx * far_one[i, 0] + ny * far_one[i, 1]), b)
        a, b = b, a
    has_near, c0, gx0, gy0 = key_plane(near_one, near_count)
    has_far, c1, gx1, gy1 = key_plane(far_one, far_count)
    if has_near and has_far:
        count = clip_polygon(a, count, gx0 - gx1, gy0 - gy1, c0 - c1, b)
        a, b = b, a
    distance: float = distance_to_polygon(x, y, a, count)
    return distance


@njit(error_model="numpy")
def distance_out_of_range(
    x: float, y: float, polygon: NDArray[Any], count: int, view: View, scratch: NDArray[Any]
) -> float:
    """Pixels from a point to where a polygon, (n, 3), lies beyond far or the clip plane.

    `scratch`: (2, MOST_CORNERS, 3) float64, overwritten.
    """
    has_area, c, gx, gy = key_plane(polygon, count)
    if not has_area:
        return np.inf
    far = 1.0 / view.far if view.perspective else -view.far
    beyond = clip_polygon(polygon, count, -gx, -gy, far - c, scratch[0])
    distance: float = distance_to_polygon(x, y, scratch[0], beyond)
    if view.clips:
        # `View.clip` with the key's plane and a, b in pixels; its bound, outward.
        of_key, fixed, of_a, of_b, per_key, bound = view.clip
        size = 0.0
        for i in range(count):
            size = max(size, abs(polygon[i, 2]))
        fixed -= of_a * (view.width - 1 - 2.0 * view.shift_x_px)
        fixed += of_b * (view.height - 1 - 2.0 * view.shift_y_px)
        beyond = clip_polygon(
            polygon,
            count,
            -(of_key * gx + 2.0 * of_a),
            -(of_key * gy - 2.0 * of_b),
            -(of_key * c + fixed) + per_key * size + bound,
            scratch[0],
        )
        distance = min(distance, distance_to_polygon(x, y, scratch[0], beyond))
    return distance
