"""Compiled loops of the ray engines: rays, what a hit means, and samples decided in float64.

Samples are flat indices y * width + x. Along a sample's ray a triangle's plane lies at view
depth t = numerator / denominator, where n = (v1 - v0) x (v2 - v0), p = v0 - e and

    perspective    t = n . p / n . (F + a R + b U)
    orthographic   t = n . (p - a R - b U) / n . F

A denominator below zero is a front face (counter-clockwise seen from the eye); zero is a
triangle edge-on or degenerate, which covers nothing.

A float32 ray library names the nearest triangle and no more. What it cannot filter (near and
far on float64 depth, one-sided triangles from behind, masked and blended layers) `splat` and
`layers` decide by testing each triangle against the samples under it: the same rays and the same
closed triangles, in float64, so that no layer hides another.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.visibility import BACKGROUND

# In a visibility buffer between `resolve` and `splat`: the library's hit does not count.
PENDING = -2

# Rounding of numerator and denominator, as a multiple of the sums of absolute products that
# make them up, u = 2^-53. Edges and p are one rounding per component; a
# component of n is two products of two edges and a difference: 2 + 1 + 1 = 4 u. Numerator:
# p (1; orthographic: a R, its sum with b U, the difference: 4), the product 1, two sums 2:
# 4 + 4 + 3 = 11 u. Denominator: d (a R, the sum, F's sum: 3), likewise 4 + 3 + 3 = 10 u.
# 16 u also holds the second-order terms.
PLANE_ROUNDING = 16.0 * 2.0**-53

# A vertex's pixel is computed with a relative error of some 2^-49 |p| / depth, in pixels
# times the image's side: below one pixel unless |p| / depth exceeds 2^28 on the widest image.
# Outward: too large a rectangle only costs time.
RECTANGLE_MARGIN_PX = 1.0


class Triangles(NamedTuple):
    """What the loops read of a `Scene`, world space."""

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    one_sided: NDArray[np.bool_]
    object_of_triangle: NDArray[np.int32]


class SampleGrid(NamedTuple):
    """A camera's samples. `axes`: (7, 3) float64, rows e, F, R, U and the duals of F, R, U,
    with which p - e = (p - e)·F* F + (p - e)·R* R + (p - e)·U* U; the first is view depth.

    `clips`: whether a hit at depth t counts only where clip[0] + a clip[1] + b clip[2] +
    t (clip[3] + a clip[4] + b clip[5]) >= 0, (6,) float64. `scattered` makes it no grid but single
    points of the image, (column_a[i], row_b[i]) each: the flat index is i.
    """

    axes: NDArray[np.float64]
    perspective: bool
    near: float
    far: float
    column_a: NDArray[np.float64]
    row_b: NDArray[np.float64]
    scattered: bool = False
    clips: bool = False
    clip: NDArray[np.float64] = np.zeros(6)


@njit(inline="always")
def dot(x, y):  # type: ignore[no-untyped-def]
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@njit(inline="always")
def cross(x, y):  # type: ignore[no-untyped-def]
    return (
        x[1] * y[2] - x[2] * y[1],
        x[2] * y[0] - x[0] * y[2],
        x[0] * y[1] - x[1] * y[0],
    )


@njit(inline="always")
def minus(x, y):  # type: ignore[no-untyped-def]
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


@njit(inline="always")
def _magnitude(x, y):  # type: ignore[no-untyped-def]
    return abs(x[0] * y[0]) + abs(x[1] * y[1]) + abs(x[2] * y[2])


@njit(inline="always")
def point(vertices, v):  # type: ignore[no-untyped-def]
    """Vertex v in float64."""
    return np.float64(vertices[v, 0]), np.float64(vertices[v, 1]), np.float64(vertices[v, 2])


@njit(inline="always")
def corner(mesh, t, k):  # type: ignore[no-untyped-def]
    return point(mesh.vertices, mesh.triangles[t, k])


@njit(inline="always")
def _offset(grid, a, b):  # type: ignore[no-untyped-def]
    """a R + b U."""
    m = grid.axes
    return (
        a * m[2, 0] + b * m[3, 0],
        a * m[2, 1] + b * m[3, 1],
        a * m[2, 2] + b * m[3, 2],
    )


@njit(inline="always")
def counts(grid, z, a, b):  # type: ignore[no-untyped-def]
    """Whether a hit at view depth z lies within the range, and before the clip plane."""
    if not (z >= grid.near and z <= grid.far):
        return False
    if not grid.clips:
        return True
    c = grid.clip
    return c[0] + a * c[1] + b * c[2] + z * (c[3] + a * c[4] + b * c[5]) >= 0.0


@njit(inline="always")
def corners_from(eye, mesh, t):  # type: ignore[no-untyped-def]
    """The corners of a triangle, relative to the eye."""
    p0, p1, p2 = corner(mesh, t, 0), corner(mesh, t, 1), corner(mesh, t, 2)
    return minus(p0, eye), minus(p1, eye), minus(p2, eye)


@njit(inline="always")
def facet_of(mesh, grid, t):  # type: ignore[no-untyped-def]
    """What a triangle's plane has in common for all rays: n, the sums of absolute products
    that n's rounding is relative to, and p."""
    m = grid.axes
    v0 = corner(mesh, t, 0)
    u, v = minus(corner(mesh, t, 1), v0), minus(corner(mesh, t, 2), v0)
    size = (
        abs(u[1] * v[2]) + abs(u[2] * v[1]),
        abs(u[2] * v[0]) + abs(u[0] * v[2]),
        abs(u[0] * v[1]) + abs(u[1] * v[0]),
    )
    return cross(u, v), size, minus(v0, m[0])


@njit(inline="always")
def plane(facet, grid, a, b):  # type: ignore[no-untyped-def]
    """Numerator and denominator of the plane's view depth along a ray."""
    n, _, p = facet
    m = grid.axes
    side = _offset(grid, a, b)
    if grid.perspective:
        return dot(n, p), dot(n, (m[1, 0] + side[0], m[1, 1] + side[1], m[1, 2] + side[2]))
    return dot(n, minus(p, side)), dot(n, m[1])


@njit(inline="always")
def depth_interval(facet, grid, a, b):  # type: ignore[no-untyped-def]
    """View depth of a triangle's plane along a ray, and a bound of its rounding error."""
    numerator, denominator = plane(facet, grid, a, b)
    _, size, p = facet
    m = grid.axes
    side = (
        abs(a * m[2, 0]) + abs(b * m[3, 0]),
        abs(a * m[2, 1]) + abs(b * m[3, 1]),
        abs(a * m[2, 2]) + abs(b * m[3, 2]),
    )
    if grid.perspective:
        above = _magnitude(size, p)
        below = _magnitude(size, m[1]) + dot(size, side)
    else:
        above = _magnitude(size, p) + dot(size, side)
        below = _magnitude(size, m[1])
    depth = numerator / denominator
    room = abs(denominator) - PLANE_ROUNDING * below
    if not room > 0.0:
        return depth, np.inf
    return depth, PLANE_ROUNDING * (above + abs(depth) * below) / room


@njit(makes_arrays=False)
def fill_rays(
    rays: NDArray[Any],
    start: int,
    count: int,
    grid: SampleGrid,
    origin: NDArray[Any],
    scale: float,
    start_depth: float,
) -> None:
    """Origins and directions of `count` samples from `start` on, into `rays` (n, 6) float32.

    Computed in float64 and rounded once. Origins are relative to the scene's own `origin`,
    times `scale`, a power of two, and lie on the rays at view depth `start_depth`.
    """
    m = grid.axes
    width = len(grid.column_a)
    y, x = start // width, start % width
    eye = (m[0, 0] - origin[0], m[0, 1] - origin[1], m[0, 2] - origin[2])
    for k in range(count):
        side = _offset(grid, grid.column_a[x], grid.row_b[x if grid.scattered else y])
        for i in range(3):
            if grid.perspective:
                d = m[1, i] + side[i]
                o = eye[i] + start_depth * d
            else:
                d = m[1, i]
                o = eye[i] + (side[i] + start_depth * d)
            rays[k, i] = np.float32(scale * o)
            rays[k, 3 + i] = np.float32(d)
        x += 1
        if x == width:
            x = 0
            y += 1


@njit(inline="always")
def hit_of(mesh, grid, t, depth_slack):  # type: ignore[no-untyped-def]
    """What a triangle has in common for all rays that the library says meet it: its facet, between
    which depths its plane may be met, and whether it is one-sided."""
    m = grid.axes
    eye = (m[0, 0], m[0, 1], m[0, 2])
    forward_dual = (m[4, 0], m[4, 1], m[4, 2])
    facet = facet_of(mesh, grid, t)
    z0 = dot(facet[2], forward_dual)
    z1 = dot(minus(corner(mesh, t, 1), eye), forward_dual)
    z2 = dot(minus(corner(mesh, t, 2), eye), forward_dual)
    low = min(z0, z1, z2) - depth_slack
    high = max(z0, z1, z2) + depth_slack
    return facet, low, high, mesh.one_sided[t]


@njit(inline="always")
def owner_at(hit, grid, t, a, b, depth_slack):  # type: ignore[no-untyped-def]
    """Who owns a sample whose nearest hit is triangle t, `hit` in short: t, nobody or `PENDING`.

    A hit that does not count (before near, a one-sided triangle from behind, edge-on) may hide one
    that does, and one whose plane is met off the triangle by more than the library's error
    `depth_slack` is a false hit on a grazing triangle: they become `PENDING`. A hit beyond far
    hides nothing, unless by less than `depth_slack`.
    """
    facet, low, high, one_sided = hit
    numerator, denominator = plane(facet, grid, a, b)
    z = numerator / denominator
    covers = denominator < 0.0 or (denominator > 0.0 and not one_sided)
    true_hit = covers and z >= low and z <= high
    if true_hit and counts(grid, z, a, b):
        return t
    return BACKGROUND if true_hit and z > grid.far + depth_slack else PENDING


@njit(error_model="numpy", makes_arrays=False)
def resolve(
    primitives: NDArray[Any],
    start: int,
    count: int,
    grid: SampleGrid,
    mesh: Triangles,
    triangle_of_primitive: NDArray[Any],
    depth_slack: float,
    triangle: NDArray[Any],
) -> int:
    """Turn the library's nearest primitives (-1 for none) into owners, as `owner_at` says.

    `primitives`: (count,) integers, one per sample from `start` on. `triangle_of_primitive`:
    (p,) int32 triangle ids, one per primitive. `triangle`, (samples,) int32, is the frame's flat
    buffer, changed in place. Returns how many are pending.
    """
    width = len(grid.column_a)
    y, x = start // width, start % width
    pending = 0
    last, hit = 0, hit_of(mesh, grid, 0, depth_slack)
    for k in range(count):
        owner = BACKGROUND
        if primitives[k] >= 0:
            t = triangle_of_primitive[primitives[k]]
            # Neighbouring samples mostly share their triangle.
            if t != last:
                last, hit = t, hit_of(mesh, grid, t, depth_slack)
            b = grid.row_b[x if grid.scattered else y]
            owner = owner_at(hit, grid, t, grid.column_a[x], b, depth_slack)
            if owner == PENDING:
                pending += 1
        triangle[start + k] = owner
        x += 1
        if x == width:
            x = 0
            y += 1
    return pending


@njit(error_model="numpy", makes_arrays=False)
def owner_depths(
    triangle: NDArray[Any],
    samples: NDArray[Any],
    everywhere: bool,
    mesh: Triangles,
    grid: SampleGrid,
    depth: NDArray[Any],
) -> None:
    """The view depths of the owners `triangle`, (k,) int32, at the flat samples `samples`, (k,)
    int64, or `everywhere`, in the samples' order: into `depth`, (k,) float64, inf for none."""
    width = len(grid.column_a)
    last, facet = 0, facet_of(mesh, grid, 0)
    x, y = 0, 0
    for k in range(len(triangle)):
        if not everywhere:
            x, y = samples[k] % width, samples[k] // width
        t = triangle[k]
        z = np.inf
        if t >= 0:
            if t != last:
                last, facet = t, facet_of(mesh, grid, t)
            b = grid.row_b[x if grid.scattered else y]
            numerator, denominator = plane(facet, grid, grid.column_a[x], b)
            z = numerator / denominator
        depth[k] = z
        x += 1
        if x == width:
            x, y = 0, y + 1


@njit(error_model="numpy")
def least_depths(which: NDArray[Any], mesh: Triangles, grid: SampleGrid) -> NDArray[np.float64]:
    """The least view depth, but for rounding, at which point i of a scattered grid meets the plane
    of triangle `which[i]`, (k,) int32 (`BACKGROUND`: infinity): (k,) float64."""
    result = np.empty(len(which))
    for i in range(len(which)):
        result[i] = np.inf
        if which[i] >= 0:
            facet = facet_of(mesh, grid, which[i])
            depth, error = depth_interval(facet, grid, grid.column_a[i], grid.row_b[i])
            # An edge-on plane may be met anywhere.
            result[i] = depth - error if error < np.inf else -np.inf
    return result
