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
def _dot(x, y):  # type: ignore[no-untyped-def]
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@njit(inline="always")
def _cross(x, y):  # type: ignore[no-untyped-def]
    return (
        x[1] * y[2] - x[2] * y[1],
        x[2] * y[0] - x[0] * y[2],
        x[0] * y[1] - x[1] * y[0],
    )


@njit(inline="always")
def _minus(x, y):  # type: ignore[no-untyped-def]
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


@njit(inline="always")
def _magnitude(x, y):  # type: ignore[no-untyped-def]
    return abs(x[0] * y[0]) + abs(x[1] * y[1]) + abs(x[2] * y[2])


@njit(inline="always")
def _corner(mesh, t, k):  # type: ignore[no-untyped-def]
    v = mesh.triangles[t, k]
    return (
        np.float64(mesh.vertices[v, 0]),
        np.float64(mesh.vertices[v, 1]),
        np.float64(mesh.vertices[v, 2]),
    )


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
def _counts(grid, z, a, b):  # type: ignore[no-untyped-def]
    """Whether a hit at view depth z lies within the range, and before the clip plane."""
    if not (z >= grid.near and z <= grid.far):
        return False
    if not grid.clips:
        return True
    c = grid.clip
    return c[0] + a * c[1] + b * c[2] + z * (c[3] + a * c[4] + b * c[5]) >= 0.0


@njit(inline="always")
def _facet(mesh, grid, t):  # type: ignore[no-untyped-def]
    """What a triangle's plane has in common for all rays: n, the sums of absolute products
    that n's rounding is relative to, and p."""
    m = grid.axes
    v0 = _corner(mesh, t, 0)
    u, v = _minus(_corner(mesh, t, 1), v0), _minus(_corner(mesh, t, 2), v0)
    size = (
        abs(u[1] * v[2]) + abs(u[2] * v[1]),
        abs(u[2] * v[0]) + abs(u[0] * v[2]),
        abs(u[0] * v[1]) + abs(u[1] * v[0]),
    )
    return _cross(u, v), size, _minus(v0, m[0])


@njit(inline="always")
def _plane(facet, grid, a, b):  # type: ignore[no-untyped-def]
    """Numerator and denominator of the plane's view depth along a ray."""
    n, _, p = facet
    m = grid.axes
    side = _offset(grid, a, b)
    if grid.perspective:
        return _dot(n, p), _dot(n, (m[1, 0] + side[0], m[1, 1] + side[1], m[1, 2] + side[2]))
    return _dot(n, _minus(p, side)), _dot(n, m[1])


@njit(inline="always")
def _depth_interval(facet, grid, a, b):  # type: ignore[no-untyped-def]
    """View depth of a triangle's plane along a ray, and a bound of its rounding error."""
    numerator, denominator = _plane(facet, grid, a, b)
    _, size, p = facet
    m = grid.axes
    side = (
        abs(a * m[2, 0]) + abs(b * m[3, 0]),
        abs(a * m[2, 1]) + abs(b * m[3, 1]),
        abs(a * m[2, 2]) + abs(b * m[3, 2]),
    )
    if grid.perspective:
        above = _magnitude(size, p)
        below = _magnitude(size, m[1]) + _dot(size, side)
    else:
        above = _magnitude(size, p) + _dot(size, side)
        below = _magnitude(size, m[1])
    depth = numerator / denominator
    room = abs(denominator) - PLANE_ROUNDING * below
    if not room > 0.0:
        return depth, np.inf
    return depth, PLANE_ROUNDING * (above + abs(depth) * below) / room


@njit()
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


@njit(error_model="numpy")
def resolve(
    primitives: NDArray[Any],
    start: int,
    count: int,
    grid: SampleGrid,
    mesh: Triangles,
    triangle_of_primitive: NDArray[Any],
    depth_slack: float,
    triangle: NDArray[Any],
    depth: NDArray[Any],
) -> int:
    """Turn the library's nearest primitives (-1 for none) into owners and view depths.

    `primitives`: (count,) integers, one per sample from `start` on. `triangle_of_primitive`:
    (p,) int32 triangle ids, one per primitive. `triangle`, (samples,) int32, and `depth`,
    (samples,) float64, are the frame's flat buffers, changed in place.
    A hit that does not count (before near, a one-sided triangle from behind, edge-on) may hide one
    that does, and one whose plane is met off the triangle by more than the library's error
    `depth_slack` is a false hit on a grazing triangle: they become `PENDING`. A hit beyond far
    hides nothing, unless by less than `depth_slack`. Returns how many are pending.
    """
    m = grid.axes
    eye = (m[0, 0], m[0, 1], m[0, 2])
    forward_dual = (m[4, 0], m[4, 1], m[4, 2])
    width = len(grid.column_a)
    y, x = start // width, start % width
    pending = 0
    last, facet, low, high, one_sided = -1, _facet(mesh, grid, 0), 0.0, 0.0, False
    for k in range(count):
        s = start + k
        triangle[s] = BACKGROUND
        depth[s] = np.inf
        if primitives[k] >= 0:
            t = triangle_of_primitive[primitives[k]]
            # Neighbouring samples mostly share their triangle.
            if t != last:
                last = t
                facet = _facet(mesh, grid, t)
                z0 = _dot(facet[2], forward_dual)
                z1 = _dot(_minus(_corner(mesh, t, 1), eye), forward_dual)
                z2 = _dot(_minus(_corner(mesh, t, 2), eye), forward_dual)
                low = min(z0, z1, z2) - depth_slack
                high = max(z0, z1, z2) + depth_slack
                one_sided = mesh.one_sided[t]
            b = grid.row_b[x if grid.scattered else y]
            numerator, denominator = _plane(facet, grid, grid.column_a[x], b)
            z = numerator / denominator
            covers = denominator < 0.0 or (denominator > 0.0 and not one_sided)
            true_hit = covers and z >= low and z <= high
            if true_hit and _counts(grid, z, grid.column_a[x], b):
                triangle[s] = t
                depth[s] = z
            elif not (true_hit and z > grid.far + depth_slack):
                triangle[s] = PENDING
                pending += 1
        x += 1
        if x == width:
            x = 0
            y += 1
    return pending


@njit(error_model="numpy")
def least_depths(which: NDArray[Any], mesh: Triangles, grid: SampleGrid) -> NDArray[np.float64]:
    """The least view depth, but for rounding, at which point i of a scattered grid meets the plane
    of triangle `which[i]`, (k,) int32 (`BACKGROUND`: infinity): (k,) float64."""
    result = np.empty(len(which))
    for i in range(len(which)):
        result[i] = np.inf
        if which[i] >= 0:
            facet = _facet(mesh, grid, which[i])
            depth, error = _depth_interval(facet, grid, grid.column_a[i], grid.row_b[i])
            # An edge-on plane may be met anywhere.
            result[i] = depth - error if error < np.inf else -np.inf
    return result


@njit(inline="always")
def _edge(grid, pi, pj):  # type: ignore[no-untyped-def]
    """The edge's function of (a, b): (constant, a's, b's). Its sign says on which side of the
    edge a ray passes. Exactly antisymmetric in pi and pj, so that no sample slips between
    two triangles that share an edge."""
    m = grid.axes
    if grid.perspective:
        q = _cross(pi, pj)
        return _dot(q, m[1]), _dot(q, m[2]), _dot(q, m[3])
    q = _cross(m[1], _minus(pj, pi))
    return _dot(_cross(pi, pj), m[1]), _dot(q, m[2]), _dot(q, m[3])


@njit(inline="always")
def _extent(grid, corners):  # type: ignore[no-untyped-def]
    """Bounds low_a, high_a, low_b, high_b of what a triangle may cover."""
    m = grid.axes
    # Half of near: far from any rounding of a depth that counts.
    clip = 0.5 * grid.near
    low_a, high_a, low_b, high_b = np.inf, -np.inf, np.inf, -np.inf
    for k in range(3):
        p, q = corners[k], corners[(k + 1) % 3]
        if not grid.perspective:
            a, b = _dot(p, m[5]), _dot(p, m[6])
            low_a, high_a = min(low_a, a), max(high_a, a)
            low_b, high_b = min(low_b, b), max(high_b, b)
            continue
        z, z_next = _dot(p, m[4]), _dot(q, m[4])
        if z >= clip:
            a, b = _dot(p, m[5]) / z, _dot(p, m[6]) / z
            low_a, high_a = min(low_a, a), max(high_a, a)
            low_b, high_b = min(low_b, b), max(high_b, b)
        if (z >= clip) != (z_next >= clip):
            w = (clip - z) / (z_next - z)
            a = ((1.0 - w) * _dot(p, m[5]) + w * _dot(q, m[5])) / clip
            b = ((1.0 - w) * _dot(p, m[6]) + w * _dot(q, m[6])) / clip
            low_a, high_a = min(low_a, a), max(high_a, a)
            low_b, high_b = min(low_b, b), max(high_b, b)
    return low_a, high_a, low_b, high_b


@njit(inline="always")
def _rectangle(grid, corners):  # type: ignore[no-untyped-def]
    """Pixel bounds x0, x1, y0, y1 (x1 and y1 excluded) of what a triangle may cover."""
    low_a, high_a, low_b, high_b = _extent(grid, corners)
    width, height = len(grid.column_a), len(grid.row_b)
    x0 = (low_a - grid.column_a[0]) / 2.0 - RECTANGLE_MARGIN_PX
    x1 = (high_a - grid.column_a[0]) / 2.0 + RECTANGLE_MARGIN_PX
    y0 = (grid.row_b[0] - high_b) / 2.0 - RECTANGLE_MARGIN_PX
    y1 = (grid.row_b[0] - low_b) / 2.0 + RECTANGLE_MARGIN_PX
    return (
        int(min(max(x0, 0.0), np.float64(width))),
        int(min(max(x1 + 1.0, 0.0), np.float64(width))),
        int(min(max(y0, 0.0), np.float64(height))),
        int(min(max(y1 + 1.0, 0.0), np.float64(height))),
    )


@njit(inline="always")
def _meets(edges, facet, mesh, grid, t, a, b):  # type: ignore[no-untyped-def]
    """Whether a ray meets the closed triangle, from a side that counts."""
    e0, e1, e2 = edges
    s0 = e0[0] + (a * e0[1] + b * e0[2])
    s1 = e1[0] + (a * e1[1] + b * e1[2])
    s2 = e2[0] + (a * e2[1] + b * e2[2])
    if min(s0, s1, s2) < 0.0 and max(s0, s1, s2) > 0.0:
        return False
    denominator = _plane(facet, grid, a, b)[1]
    return denominator < 0.0 or (denominator > 0.0 and not mesh.one_sided[t])


@njit(inline="always")
def _window_of(grid, corners, window):  # type: ignore[no-untyped-def]
    """`_rectangle`, cut to `window`."""
    x0, x1, y0, y1 = _rectangle(grid, corners)
    return max(x0, window[0]), min(x1, window[1]), max(y0, window[2]), min(y1, window[3])


@njit(error_model="numpy")
def splat(
    which: NDArray[Any],
    mesh: Triangles,
    grid: SampleGrid,
    window: tuple[int, int, int, int],
    mark: NDArray[Any],
    triangle: NDArray[Any],
    depth: NDArray[Any],
) -> None:
    """Test the triangles `which` (ascending ids) against the samples of `window` (x0, x1, y0,
    y1; x1, y1 excluded): where `mark`, the nearest becomes the owner. Closed triangles, closed
    range; one-sided ones from behind do not count. `mark`, `triangle`, `depth`: (samples,)."""
    m = grid.axes
    eye = (m[0, 0], m[0, 1], m[0, 2])
    width = len(grid.column_a)
    for t in which:
        p0 = _minus(_corner(mesh, t, 0), eye)
        p1 = _minus(_corner(mesh, t, 1), eye)
        p2 = _minus(_corner(mesh, t, 2), eye)
        x0, x1, y0, y1 = _window_of(grid, (p0, p1, p2), window)
        if x0 >= x1 or y0 >= y1:
            continue
        edges = (_edge(grid, p0, p1), _edge(grid, p1, p2), _edge(grid, p2, p0))
        facet = _facet(mesh, grid, t)
        for y in range(y0, y1):
            b = grid.row_b[y]
            for x in range(x0, x1):
                s = y * width + x
                a = grid.column_a[x]
                if not mark[s] or not _meets(edges, facet, mesh, grid, t, a, b):
                    continue
                z = _depth_interval(facet, grid, a, b)[0]
                if z < depth[s] and _counts(grid, z, a, b):
                    triangle[s] = t
                    depth[s] = z


@njit(error_model="numpy")
def layers(
    which: NDArray[Any],
    mesh: Triangles,
    grid: SampleGrid,
    window: tuple[int, int, int, int],
    owner: NDArray[Any],
    doubtful: bool,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """Every hit of the triangles `which` that lies before its sample's `owner`, (samples,), in
    `window` as `splat`: sample, triangle, view depth and a bound of its error, (h,) each.

    Depths whose error bounds overlap count with `doubtful`, and do not without.
    """
    m = grid.axes
    eye = (m[0, 0], m[0, 1], m[0, 2])
    width = len(grid.column_a)
    sample, triangle = np.empty(1024, np.int64), np.empty(1024, np.int32)
    depth, bound = np.empty(1024), np.empty(1024)
    count = 0
    for t in which:
        p0 = _minus(_corner(mesh, t, 0), eye)
        p1 = _minus(_corner(mesh, t, 1), eye)
        p2 = _minus(_corner(mesh, t, 2), eye)
        x0, x1, y0, y1 = _window_of(grid, (p0, p1, p2), window)
        if x0 >= x1 or y0 >= y1:
            continue
        edges = (_edge(grid, p0, p1), _edge(grid, p1, p2), _edge(grid, p2, p0))
        facet = _facet(mesh, grid, t)
        for y in range(y0, y1):
            b = grid.row_b[y]
            for x in range(x0, x1):
                a = grid.column_a[x]
                if not _meets(edges, facet, mesh, grid, t, a, b):
                    continue
                z, error = _depth_interval(facet, grid, a, b)
                if not _counts(grid, z, a, b):
                    continue
                s = y * width + x
                if owner[s] >= 0:
                    behind, slack = _depth_interval(_facet(mesh, grid, owner[s]), grid, a, b)
                    sure = z + error < behind - slack
                    if not (sure or (doubtful and z - error <= behind + slack)):
                        continue
                if count == len(sample):
                    sample = np.concatenate((sample, np.empty(count, np.int64)))
                    triangle = np.concatenate((triangle, np.empty(count, np.int32)))
                    depth = np.concatenate((depth, np.empty(count)))
                    bound = np.concatenate((bound, np.empty(count)))
                sample[count], triangle[count] = s, t
                depth[count], bound[count] = z, error
                count += 1
    return (
        sample[:count].copy(),
        triangle[:count].copy(),
        depth[:count].copy(),
        bound[:count].copy(),
    )


@njit(inline="always")
def _covers(mesh, grid, t, corners, a, b):  # type: ignore[no-untyped-def]
    """Whether a ray meets the closed triangle, from a side that counts."""
    low, high = np.inf, -np.inf
    for k in range(3):
        e = _edge(grid, corners[k], corners[(k + 1) % 3])
        s = e[0] + (a * e[1] + b * e[2])
        low, high = min(low, s), max(high, s)
    denominator = _plane(_facet(mesh, grid, t), grid, a, b)[1]
    one_side = low >= 0.0 or high <= 0.0
    return one_side and (denominator < 0.0 or (denominator > 0.0 and not mesh.one_sided[t]))


@njit(error_model="numpy")
def settle_points(
    which: NDArray[Any],
    mesh: Triangles,
    grid: SampleGrid,
    by_a: NDArray[Any],
    triangle: NDArray[Any],
    depth: NDArray[Any],
) -> None:
    """`splat`'s OWN for some points of a scattered grid: `by_a` are their indices, sorted by a.

    `which`: (t,) int32 triangle ids. `by_a`: (k,) int64. `triangle`, int32, and `depth`,
    float64: (samples,) each, one per point of the grid, changed in place. Ties go to the least
    id, so `which` is in ascending order.
    """
    m = grid.axes
    eye = (m[0, 0], m[0, 1], m[0, 2])
    sorted_a = grid.column_a[by_a]
    margin = 2.0 * RECTANGLE_MARGIN_PX
    for t in which:
        p0 = _minus(_corner(mesh, t, 0), eye)
        p1 = _minus(_corner(mesh, t, 1), eye)
        p2 = _minus(_corner(mesh, t, 2), eye)
        low_a, high_a, low_b, high_b = _extent(grid, (p0, p1, p2))
        first = np.searchsorted(sorted_a, low_a - margin)
        for k in range(first, len(by_a)):
            if sorted_a[k] > high_a + margin:
                break
            i = by_a[k]
            a, b = grid.column_a[i], grid.row_b[i]
            if b < low_b - margin or b > high_b + margin:
                continue
            if not _covers(mesh, grid, t, (p0, p1, p2), a, b):
                continue
            z = _depth_interval(_facet(mesh, grid, t), grid, a, b)[0]
            if z < depth[i] and _counts(grid, z, a, b):
                triangle[i] = t
                depth[i] = z
