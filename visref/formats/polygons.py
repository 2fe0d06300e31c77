"""Polygons become triangles that cover what the polygon covers, once.

A polygon whose first corner sees all of it (a convex one, say) becomes the fan from that corner;
a quad is cut along the diagonal that lies inside; any other polygon has its ears clipped by
mapbox_earcut (Held, "FIST: Fast Industrial-Strength Triangulation of Polygons", 2001, describes
the family). A polygon need not be planar: what counts is its projection on the plane of its
Newell normal (Newell, in Sutherland, Sproull, Schumacker 1974). Every triangulation is checked:
its triangles' areas add up to the polygon's own, or the polygon crosses itself and is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import mapbox_earcut
import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.scene import Float64, Int64

# Corners looked at together: bounds the scratch memory to some 100 MB.
_BLOCK_CORNERS = 1 << 19
# Beyond this a vertex is refused or dropped later (`flatten`), and no area needs to be right.
_FINITE = float(np.finfo(np.float32).max)
# Clipping ears takes time with the square of the corners, in the worst case: seconds at this many.
_MAX_CLIPPED = 20_000
_ROUNDING = 2.0**-53


def triangulated(
    positions: NDArray[Any], corners: Int64, counts: Int64, place: Callable[[int], str]
) -> tuple[Int64, Int64]:
    """Triangles of polygons.

    `positions`: (v, 3) floats. `corners`: int64 vertex ids, every one below v, polygon after
    polygon; `counts`: (p,) int64, corners of each. `place` says where a polygon stands, by its
    number. Returns (t, 3) int64 triangles with the polygons' winding, n - 2 for n corners (none
    for fewer than three), and (t,) int64, the polygon of each, ascending.

    Raises InputError for a polygon that crosses itself.
    """
    starts = np.cumsum(counts) - counts
    sizes = np.maximum(counts - 2, 0)
    owner = np.repeat(np.arange(len(counts)), sizes)
    rows = np.cumsum(sizes) - sizes
    step = np.arange(len(owner)) - rows[owner]
    first = starts[owner]
    # As places in `corners` until the end; fans unless something better is found below.
    triangles = np.stack([first, first + step + 1, first + step + 2], axis=1)
    for polygons, points in _blocks(positions, corners, counts, starts):
        fans, normals = _fans(points)
        # Where rounding alone could make the normal, its signs say nothing.
        sure = np.abs(normals).max(axis=1) > _bound(points)
        wrong = ~(sure & _covered_by_fan(points, fans, normals))
        count = points.shape[1]
        if count == 4:
            other = wrong & sure & _covered_by_other_diagonal(points, normals)
            at = rows[polygons[other]]
            triangles[at] = starts[polygons[other], None] + np.array([0, 1, 3])
            triangles[at + 1] = starts[polygons[other], None] + np.array([1, 2, 3])
            wrong &= ~other
        for index in np.flatnonzero(wrong):
            polygon = polygons[index]
            if count > _MAX_CLIPPED:
                raise InputError(
                    f"the polygon of {count} corners is not convex",
                    place=place(int(polygon)),
                    fix=f"cut it into polygons of at most {_MAX_CLIPPED} corners",
                )
            clipped = _clipped(points[index])
            if clipped is None:
                raise InputError(
                    f"the polygon of {count} corners crosses itself",
                    place=place(int(polygon)),
                    fix="mend it, or triangulate the mesh in the program that made it",
                )
            triangles[rows[polygon] : rows[polygon] + count - 2] = starts[polygon] + clipped
    return corners[triangles], owner


def _blocks(
    positions: NDArray[Any], corners: Int64, counts: Int64, starts: Int64
) -> Iterator[tuple[Int64, Float64]]:
    """Polygons of more than three corners, those of one count together: their numbers (k,), and
    their corners (k, n, 3) float64 relative to the first. Those with a vertex that is not
    finite are left out."""
    for count in np.unique(counts[counts > 3]).tolist():
        same = np.flatnonzero(counts == count)
        block = max(1, _BLOCK_CORNERS // count)
        for at in range(0, len(same), block):
            polygons = same[at : at + block]
            points = positions[corners[starts[polygons, None] + np.arange(count)]]
            points = points.astype(np.float64)
            finite = (np.abs(points) <= _FINITE).all(axis=(1, 2))
            points = points[finite]
            yield polygons[finite], points - points[:, :1]


def _fans(points: Float64) -> tuple[Float64, Float64]:
    """Twice the vector areas of the fan's triangles, (k, n - 2, 3), and their sums (k, 3), which
    are along the Newell normals."""
    fans = np.cross(points[:, 1:-1], points[:, 2:])
    normals = np.zeros((len(points), 3))
    # In one order on every machine, be it by one call for each corner or for each polygon.
    if len(points) > fans.shape[1]:
        for i in range(fans.shape[1]):
            normals += fans[:, i]
    else:
        for i, fan in enumerate(fans):
            normals[i] += np.cumsum(fan, axis=0)[-1]
    return fans, normals


def _dot(a: Float64, b: Float64) -> Float64:
    result: Float64 = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return result


def _covered_by_fan(points: Float64, fans: Float64, normals: Float64) -> NDArray[np.bool_]:
    """(k,) bool: seen from the first corner the others come in turn, within half a turn, so that
    no two triangles of the fan overlap."""
    normals = normals[:, None]
    turn = _dot(fans, normals)
    onward = _dot(points[:, 1:-1], points[:, 2:]) > 0.0
    in_turn = ((turn > 0.0) | ((turn == 0.0) & onward)).all(axis=1)
    half = (_dot(np.cross(points[:, 1:2], points[:, 2:]), normals) >= 0.0).all(axis=1)
    result: NDArray[np.bool_] = in_turn & half
    return result


def _covered_by_other_diagonal(points: Float64, normals: Float64) -> NDArray[np.bool_]:
    """(k,) bool, of quads: no triangle beside the diagonal from corner 1 to 3 is turned over."""
    a, b, c, d = (points[:, i] for i in range(4))
    one, other = np.cross(c - b, d - b), np.cross(d - b, a - b)
    result: NDArray[np.bool_] = (_dot(one, normals) >= 0.0) & (_dot(other, normals) >= 0.0)
    return result


def _clipped(points: Float64) -> Int64 | None:
    """(n - 2, 3) triangles of one polygon, as its own corners' numbers, by clipping ears; None
    where no set of triangles covers it once. `points` is (n, 3), the first at the origin."""
    count = len(points)
    fans, normals = _fans(points[None])
    normal = normals[0]
    if np.abs(normal).max() <= _bound(points):
        # No area: a line, which any triangles cover, or a figure of eight.
        flat = np.abs(fans).max() <= _bound(points)
        return np.arange(count - 2)[:, None] + np.array([0, 1, 2]) if flat else None
    for plane in _planes(points, normal):
        area = _area(plane[1:-1] - plane[0], plane[2:] - plane[0]).sum()
        ears = mapbox_earcut.triangulate_float64(plane, np.array([count], np.uint32))
        triangles = _with_all_corners(ears.reshape(-1, 3).astype(np.int64), plane)
        a, b, c = (plane[triangles[:, k]] for k in range(3))
        turned = _area(b - a, c - a)
        if abs(np.abs(turned).sum() - area) > _bound(plane):
            continue
        over = turned < 0.0
        triangles[over] = triangles[over][:, ::-1]
        return triangles
    return None


def _bound(points: Float64) -> Any:
    """How far two sums of cross products over n corners may differ by rounding alone, of
    polygons (…, n, 2 or 3).

    A cross product of differences up to 2 s, s the greatest coordinate, errs by 32 s² roundings
    (three in each of two products up to 4 s², one in their difference); adding n of them, up to
    8 s² each, errs by n more roundings of a sum below 8 n s².
    """
    count, size = points.shape[-2], np.abs(points).max(axis=(-2, -1))
    return 2.0 * (32.0 * count + 8.0 * count * count) * _ROUNDING * size * size


def _planes(points: Float64, normal: Float64) -> Iterator[Float64]:
    """The polygon in two dimensions, (n, 2), counter-clockwise: first without the axis that is
    most across it, which rounds nothing, then along its normal."""
    axis = int(np.argmax(np.abs(normal)))
    u, v = (axis + 1) % 3, (axis + 2) % 3
    if normal[axis] < 0.0:
        u, v = v, u
    yield np.ascontiguousarray(points[:, [u, v]])
    normal = normal / np.sqrt(_dot(normal, normal))
    across = np.zeros(3)
    across[u] = 1.0
    right = across - _dot(across, normal) * normal
    right /= np.sqrt(_dot(right, right))
    up = np.cross(normal, right)
    yield np.stack([_dot(points, right), _dot(points, up)], axis=1)


def _area(a: Float64, b: Float64) -> Float64:
    """Twice the signed areas of triangles, by two of their sides (k, 2)."""
    result: Float64 = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return result


def _with_all_corners(triangles: Int64, plane: Float64) -> Int64:
    """The clipper leaves out corners on straight edges and at the tips of spikes: they get
    triangles without area in the projection, so that every edge of the polygon is one of a
    triangle and meets what its neighbours have there. (n - 2, 3) in all, with triangles of one
    corner thrice in place of those that it left out where the polygon touches itself."""
    count = len(plane)
    kept = np.unique(triangles)
    added = []
    for a, b in zip(kept.tolist(), np.roll(kept, -1).tolist(), strict=True):
        run = [(a + k) % count for k in range((b - a) % count + 1)]
        while len(run) > 2:
            # One whose neighbours are in line with it, as the clipper found it.
            p, q, r = (plane[run[k : len(run) - 2 + k]] for k in range(3))
            at = int(np.argmin(np.abs(_area(q - p, r - p))))
            added.append(run[at : at + 3])
            del run[at + 1]
    missing = count - 2 - len(triangles) - len(added)
    return np.array([*triangles.tolist(), *added, *[[0, 0, 0]] * missing], np.int64).reshape(-1, 3)
