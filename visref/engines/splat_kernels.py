"""Compiled loops of the ray engines that need no library: triangles tested in float64 against the
samples under them (see `visref.engines.ray_kernels`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines.ray_kernels import (
    RECTANGLE_MARGIN_PX,
    SampleGrid,
    Triangles,
    corners_from,
    counts,
    cross,
    depth_interval,
    dot,
    facet_of,
    minus,
    plane,
)


@njit(inline="always")
def edge(grid, pi, pj):  # type: ignore[no-untyped-def]
    """The edge's function of (a, b): (constant, a's, b's). Its sign says on which side of the
    edge a ray passes. Exactly antisymmetric in pi and pj, so that no sample slips between
    two triangles that share an edge."""
    m = grid.axes
    if grid.perspective:
        q = cross(pi, pj)
        return dot(q, m[1]), dot(q, m[2]), dot(q, m[3])
    q = cross(m[1], minus(pj, pi))
    return dot(cross(pi, pj), m[1]), dot(q, m[2]), dot(q, m[3])


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
            a, b = dot(p, m[5]), dot(p, m[6])
            low_a, high_a = min(low_a, a), max(high_a, a)
            low_b, high_b = min(low_b, b), max(high_b, b)
            continue
        z, z_next = dot(p, m[4]), dot(q, m[4])
        if z >= clip:
            a, b = dot(p, m[5]) / z, dot(p, m[6]) / z
            low_a, high_a = min(low_a, a), max(high_a, a)
            low_b, high_b = min(low_b, b), max(high_b, b)
        if (z >= clip) != (z_next >= clip):
            w = (clip - z) / (z_next - z)
            a = ((1.0 - w) * dot(p, m[5]) + w * dot(q, m[5])) / clip
            b = ((1.0 - w) * dot(p, m[6]) + w * dot(q, m[6])) / clip
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
def at_sample(edges, a, b):  # type: ignore[no-untyped-def]
    """The values of a triangle's three edge functions."""
    e0, e1, e2 = edges
    s0 = e0[0] + (a * e0[1] + b * e0[2])
    s1 = e1[0] + (a * e1[1] + b * e1[2])
    s2 = e2[0] + (a * e2[1] + b * e2[2])
    return s0, s1, s2


@njit(inline="always")
def meets(sides, facet, mesh, grid, t, a, b):  # type: ignore[no-untyped-def]
    """Whether a ray meets the closed triangle, from a side that counts, given the values of its
    edge functions there."""
    s0, s1, s2 = sides
    if min(s0, s1, s2) < 0.0 and max(s0, s1, s2) > 0.0:
        return False
    denominator = plane(facet, grid, a, b)[1]
    return denominator < 0.0 or (denominator > 0.0 and not mesh.one_sided[t])


@njit(inline="always")
def window_of(grid, corners, window):  # type: ignore[no-untyped-def]
    """`_rectangle`, cut to `window`."""
    x0, x1, y0, y1 = _rectangle(grid, corners)
    return max(x0, window[0]), min(x1, window[1]), max(y0, window[2]), min(y1, window[3])


@njit(error_model="numpy", makes_arrays=False)
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
        p0, p1, p2 = corners_from(eye, mesh, t)
        x0, x1, y0, y1 = window_of(grid, (p0, p1, p2), window)
        if x0 >= x1 or y0 >= y1:
            continue
        edges = (edge(grid, p0, p1), edge(grid, p1, p2), edge(grid, p2, p0))
        facet = facet_of(mesh, grid, t)
        for y in range(y0, y1):
            b = grid.row_b[y]
            for x in range(x0, x1):
                s = y * width + x
                a = grid.column_a[x]
                if not mark[s]:
                    continue
                if not meets(at_sample(edges, a, b), facet, mesh, grid, t, a, b):
                    continue
                z = depth_interval(facet, grid, a, b)[0]
                if z < depth[s] and counts(grid, z, a, b):
                    triangle[s] = t
                    depth[s] = z


class Hits(NamedTuple):
    """Sample, triangle, view depth and a bound of its error, (h,) each."""

    sample: NDArray[np.int64]
    triangle: NDArray[np.int32]
    depth: NDArray[np.float64]
    bound: NDArray[np.float64]


def layers(
    which: NDArray[np.int32],
    mesh: Triangles,
    grid: SampleGrid,
    window: tuple[int, int, int, int],
    owner: NDArray[np.int32],
    doubtful: bool,
) -> Hits:
    """Every hit of the triangles `which` that lies before its sample's `owner`, (samples,), in
    `window` as `splat`.

    Depths whose error bounds overlap count with `doubtful`, and do not without.
    """
    parts: list[Hits] = []
    begin, room = 0, 1 << 14
    while True:
        hits = Hits(
            np.empty(room, np.int64), np.empty(room, np.int32), np.empty(room), np.empty(room)
        )
        begin, count = _layers(which, begin, mesh, grid, window, owner, doubtful, hits)
        parts.append(Hits._make(column[:count] for column in hits))
        if begin == len(which):
            break
        # A triangle may have a hit at each sample of the window.
        room = max(2 * room, (window[1] - window[0]) * (window[3] - window[2]))
    return Hits._make(np.concatenate(column) for column in zip(*parts, strict=True))


@njit(error_model="numpy", makes_arrays=False)
def _layers(
    which: NDArray[Any],
    begin: int,
    mesh: Triangles,
    grid: SampleGrid,
    window: tuple[int, int, int, int],
    owner: NDArray[Any],
    doubtful: bool,
    hits: Hits,
) -> tuple[int, int]:
    """`layers` of the triangles from `begin` on, into `hits`, as far as there is room: the index
    of the first triangle that is left, and how many hits there are."""
    m = grid.axes
    eye = (m[0, 0], m[0, 1], m[0, 2])
    width = len(grid.column_a)
    count = 0
    for index in range(begin, len(which)):
        t = which[index]
        p0, p1, p2 = corners_from(eye, mesh, t)
        x0, x1, y0, y1 = window_of(grid, (p0, p1, p2), window)
        if x0 >= x1 or y0 >= y1:
            continue
        if count + (x1 - x0) * (y1 - y0) > len(hits.sample):
            return index, count
        edges = (edge(grid, p0, p1), edge(grid, p1, p2), edge(grid, p2, p0))
        facet = facet_of(mesh, grid, t)
        for y in range(y0, y1):
            b = grid.row_b[y]
            for x in range(x0, x1):
                a = grid.column_a[x]
                if not meets(at_sample(edges, a, b), facet, mesh, grid, t, a, b):
                    continue
                z, error = depth_interval(facet, grid, a, b)
                if not counts(grid, z, a, b):
                    continue
                s = y * width + x
                if owner[s] >= 0:
                    behind, slack = depth_interval(facet_of(mesh, grid, owner[s]), grid, a, b)
                    sure = z + error < behind - slack
                    if not (sure or (doubtful and z - error <= behind + slack)):
                        continue
                hits.sample[count], hits.triangle[count] = s, t
                hits.depth[count], hits.bound[count] = z, error
                count += 1
    return len(which), count


@njit(inline="always")
def _covers(mesh, grid, t, corners, a, b):  # type: ignore[no-untyped-def]
    """Whether a ray meets the closed triangle, from a side that counts."""
    low, high = np.inf, -np.inf
    for k in range(3):
        e = edge(grid, corners[k], corners[(k + 1) % 3])
        s = e[0] + (a * e[1] + b * e[2])
        low, high = min(low, s), max(high, s)
    denominator = plane(facet_of(mesh, grid, t), grid, a, b)[1]
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
        p0, p1, p2 = corners_from(eye, mesh, t)
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
            z = depth_interval(facet_of(mesh, grid, t), grid, a, b)[0]
            if z < depth[i] and counts(grid, z, a, b):
                triangle[i] = t
                depth[i] = z
