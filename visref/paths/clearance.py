"""How near the triangles are: to a point, to a segment, and to every cell of a grid, in float64.

A point's nearest point of a triangle: its foot on the plane where that lies inside, else the
nearest of the three edges'. A segment's least distance is zero where it passes through the
triangle, and else that of one of its ends to the triangle or of it to an edge.
"""

from __future__ import annotations

import math

import numpy as np

from visref.compiled import njit
from visref.scene import Float64, Scene


def distance_to_triangles(
    scene: Scene, start: Float64, end: Float64, limit: float = math.inf
) -> tuple[float, int]:
    """The least distance of a segment from `start` to `end`, (3,) float64 in the scene's own space
    (less its origin), to what is there of the scene, and the triangle; beyond `limit` it may be
    told as (inf, -1)."""
    distance, triangle = _nearest(
        scene.vertices, scene.triangles, np.ascontiguousarray(scene.present), start, end, limit
    )
    return float(distance), int(triangle)


# In the kernels below a vector is a tuple of three floats, which costs no allocation.


@njit()
def cell_distances(vertices, triangles, present, low, size, reach, result):  # type: ignore[no-untyped-def]
    """Write into `result`, (ny, nz, nx) float32 filled with `reach`, each cell's distance from its
    centre to the nearest triangle where that is less; the first cell's centre is `low`, (3,)
    float64, and cells are cubes of side `size`."""
    count = (result.shape[2], result.shape[0], result.shape[1])
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for triangle in range(len(triangles)):
        if not present[triangle]:
            continue
        a = _corner(vertices, triangles[triangle, 0])
        b = _corner(vertices, triangles[triangle, 1])
        c = _corner(vertices, triangles[triangle, 2])
        empty = False
        for axis in range(3):
            least, most = min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis])
            # As floats, within the grid: what lies far out is beyond any whole number.
            start = np.ceil((least - reach - low[axis]) / size)
            stop = np.floor((most + reach - low[axis]) / size)
            first[axis] = min(max(start, 0.0), float(count[axis]))
            last[axis] = max(min(stop, count[axis] - 1.0), -1.0)
            empty = empty or first[axis] > last[axis]
        if empty:
            continue
        middle = _plus(_plus(a, _less(b, a), 1.0 / 3.0), _less(c, a), 1.0 / 3.0)
        radius = max(_point_segment(middle, a, a), _point_segment(middle, b, b))
        # A little more than it is: the middle is rounded.
        radius = max(radius, _point_segment(middle, c, c)) * (1.0 + 1e-9)
        for y in range(first[1], last[1] + 1):
            for z in range(first[2], last[2] + 1):
                for x in range(first[0], last[0] + 1):
                    point = (low[0] + x * size, low[1] + y * size, low[2] + z * size)
                    known = result[y, z, x]
                    # What is farther from the sphere around it is farther from the triangle.
                    away = _less(point, middle)
                    if _dot(away, away) > (known + radius) * (known + radius):
                        continue
                    distance = _point_triangle(point, a, b, c)
                    if distance < known:
                        result[y, z, x] = distance


@njit()
def _nearest(vertices, triangles, present, start, end, limit):  # type: ignore[no-untyped-def]
    best, found = limit, -1
    p, q = (start[0], start[1], start[2]), (end[0], end[1], end[2])
    for triangle in range(len(triangles)):
        if not present[triangle]:
            continue
        a = _corner(vertices, triangles[triangle, 0])
        b = _corner(vertices, triangles[triangle, 1])
        c = _corner(vertices, triangles[triangle, 2])
        outside = False
        for axis in range(3):
            least = min(a[axis], b[axis], c[axis]) - best
            most = max(a[axis], b[axis], c[axis]) + best
            outside = outside or max(p[axis], q[axis]) < least or min(p[axis], q[axis]) > most
        if outside:
            continue
        away = _segment_triangle(p, q, a, b, c)
        if away < best or (found < 0 and away <= best):
            best, found = away, triangle
    return (best, found) if found >= 0 else (math.inf, -1)


@njit()
def _corner(vertices, index):  # type: ignore[no-untyped-def]
    return (
        np.float64(vertices[index, 0]),
        np.float64(vertices[index, 1]),
        np.float64(vertices[index, 2]),
    )


@njit()
def _segment_triangle(p, q, a, b, c):  # type: ignore[no-untyped-def]
    if _crosses(p, q, a, b, c):
        return 0.0
    away = min(_point_triangle(p, a, b, c), _point_triangle(q, a, b, c))
    away = min(away, _segment_segment(p, q, a, b))
    away = min(away, _segment_segment(p, q, b, c))
    return min(away, _segment_segment(p, q, c, a))


@njit()
def _crosses(p, q, a, b, c):  # type: ignore[no-untyped-def]
    """Whether the segment's ends lie on two sides of the plane and its point there in the triangle.
    Rounding may say no for what touches an edge, and the distance to the edge says zero then."""
    normal = _cross(_less(b, a), _less(c, a))
    above, below = _dot(normal, _less(p, a)), _dot(normal, _less(q, a))
    if (above > 0.0) == (below > 0.0) or above == below:
        return False
    return _inside(_plus(p, _less(q, p), above / (above - below)), a, b, c, normal)


@njit()
def _inside(p, a, b, c, normal):  # type: ignore[no-untyped-def]
    return (
        _dot(_cross(_less(b, a), _less(p, a)), normal) >= 0.0
        and _dot(_cross(_less(c, b), _less(p, b)), normal) >= 0.0
        and _dot(_cross(_less(a, c), _less(p, c)), normal) >= 0.0
    )


@njit()
def _point_triangle(p, a, b, c):  # type: ignore[no-untyped-def]
    normal = _cross(_less(b, a), _less(c, a))
    squared = _dot(normal, normal)
    if squared > 0.0 and _inside(p, a, b, c, normal):
        return abs(_dot(normal, _less(p, a))) / math.sqrt(squared)
    away = min(_point_segment(p, a, b), _point_segment(p, b, c))
    return min(away, _point_segment(p, c, a))


@njit()
def _point_segment(p, a, b):  # type: ignore[no-untyped-def]
    along = _less(b, a)
    squared = _dot(along, along)
    share = 0.0
    if squared > 0.0:
        share = min(1.0, max(0.0, _dot(_less(p, a), along) / squared))
    away = _less(p, _plus(a, along, share))
    return math.sqrt(_dot(away, away))


@njit()
def _segment_segment(p, q, a, b):  # type: ignore[no-untyped-def]
    """The least distance is at an end of one of the two, or where the common normal meets both."""
    away = min(_point_segment(p, a, b), _point_segment(q, a, b))
    away = min(away, min(_point_segment(a, p, q), _point_segment(b, p, q)))
    u, v, w = _less(q, p), _less(b, a), _less(p, a)
    uu, uv, vv = _dot(u, u), _dot(u, v), _dot(v, v)
    wu, wv = _dot(w, u), _dot(w, v)
    det = uu * vv - uv * uv
    if det > 0.0:
        s, t = (uv * wv - vv * wu) / det, (uu * wv - uv * wu) / det
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            between = _plus(_plus(w, u, s), v, -t)
            away = min(away, math.sqrt(_dot(between, between)))
    return away


@njit()
def _less(u, v):  # type: ignore[no-untyped-def]
    return (u[0] - v[0], u[1] - v[1], u[2] - v[2])


@njit()
def _plus(u, v, factor):  # type: ignore[no-untyped-def]
    return (u[0] + v[0] * factor, u[1] + v[1] * factor, u[2] + v[2] * factor)


@njit()
def _cross(u, v):  # type: ignore[no-untyped-def]
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


@njit()
def _dot(u, v):  # type: ignore[no-untyped-def]
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
