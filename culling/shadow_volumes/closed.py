"""Which triangles of a soup bound solids: of those, the lit ones alone cast the whole shadow.

On a ray from the light a solid is entered before it is left. So whatever its unlit faces cut off,
a lit face has cut off before, and the volume of the lit faces, with sides along the silhouette,
is the solid's shadow (F. Crow, Shadow Algorithms for Computer Graphics, SIGGRAPH 1977). That is so
of a set of triangles, connected by edges, where

- every edge has two triangles, which run along it in opposite directions: the set has no rim, and
  a ray that goes in comes out;
- no two triangles meet but in the corners that they share: else a part of it might be inside out,
  and be left before it is entered;
- its volume is positive: the triangles face outward.

Which way it errs: a set of which any of this is not certain is no solid, and all its triangles
cast as sheets do. That costs fragments and loses nothing.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Float32, Float64, Int32, Int64

# Differences of float32 coordinates, a cross product of two, and its product with a third: at most
# 16 roundings of 2^-53 on the sum of absolute products, as in `visref.effects.shadow_truth`.
ROUNDING = 16.0 * 2.0**-53

# A volume sums one such product per triangle, and as many additions. Outward.
VOLUME_ROUNDING = 2.0**-40

CORNERS = 3


def bounds_a_solid(vertex_world: Float32, triangles: Int32) -> NDArray[np.bool_]:
    """(t,) bool: the triangles, (t, 3) int32 rows of (v, 3) float32 points, that bound a solid
    for certain. Corners are the same where their indices are."""
    count = len(triangles)
    if not count:
        return np.zeros(0, np.bool_)
    part, rimless = _connected(triangles, len(vertex_world))
    points = vertex_world.astype(np.float64)
    solid = rimless & _outward(points, triangles, part, len(rimless))
    order = np.argsort(part, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(part, minlength=len(solid)))])
    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    for one in np.flatnonzero(solid):
        faces = order[offsets[one] : offsets[one + 1]]
        # Along x, so that those which overlap there come one after the other.
        faces = faces[np.argsort(low[faces, 0], kind="stable")]
        solid[one] = _embedded(points, triangles[faces], low[faces], high[faces])
    return solid[part]


def _connected(triangles: Int32, points: int) -> tuple[Int64, NDArray[np.bool_]]:
    """The part that each triangle belongs to, (t,) int64 dense, connected along edges; and which
    parts have no rim, (parts,) bool."""
    start, end = triangles.astype(np.int64), triangles[:, [1, 2, 0]].astype(np.int64)
    key = (np.minimum(start, end) * points + np.maximum(start, end)).reshape(-1)
    _, edge, uses = np.unique(key, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    # +1 where it is run along from the lower corner, -1 the other way.
    way = np.where(start < end, 1, np.where(start > end, -1, 3)).reshape(-1)
    paired = (uses == 2) & (np.bincount(edge, way, len(uses)) == 0)
    root = _joined(edge, len(triangles), len(uses))
    _, part = np.unique(root, return_inverse=True)
    part = part.reshape(-1)
    alone = ~paired[edge].reshape(-1, CORNERS).all(axis=1)
    return part, np.bincount(part, alone) == 0


def _outward(points: Float64, triangles: Int32, part: Int64, parts: int) -> NDArray[np.bool_]:
    """(parts,) bool: whose triangles face outward, for certain."""
    # From a corner of its own, so that no product grows with the distance from the origin.
    first = np.full(parts, len(triangles))
    np.minimum.at(first, part, np.arange(len(triangles)))
    a, b, c = (points[triangles[:, i]] - points[triangles[first[part], 0]] for i in range(CORNERS))
    volume = np.bincount(part, (a * np.cross(b, c)).sum(axis=1), parts)
    size = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) * np.linalg.norm(c, axis=1)
    result: NDArray[np.bool_] = volume > VOLUME_ROUNDING * np.bincount(part, size, parts)
    return result


@njit()
def _joined(edge: NDArray[Any], triangles: int, edges: int) -> NDArray[Any]:
    """(t,) int64: one triangle of each connected set, for all of its triangles."""
    root = np.arange(triangles)
    last = np.full(edges, -1)
    for place in range(len(edge)):
        one, other = place // 3, last[edge[place]]
        last[edge[place]] = one
        if other < 0:
            continue
        while root[one] != one:
            root[one] = root[root[one]]
            one = root[one]
        while root[other] != other:
            root[other] = root[root[other]]
            other = root[other]
        root[max(one, other)] = min(one, other)
    for one in range(triangles):
        root[one] = root[root[one]]
    return root


@njit()
def _embedded(
    points: NDArray[Any], faces: NDArray[Any], low: NDArray[Any], high: NDArray[Any]
) -> bool:
    """Whether no two faces, (k, 3) and sorted by `low[:, 0]`, meet but in corners they share."""
    for i in range(len(faces)):
        for j in range(i + 1, len(faces)):
            if low[j, 0] > high[i, 0]:
                break
            if (
                low[j, 1] > high[i, 1]
                or high[j, 1] < low[i, 1]
                or low[j, 2] > high[i, 2]
                or high[j, 2] < low[i, 2]
            ):
                continue
            if not _apart(points, faces[i], faces[j]):
                return False
    return True


@njit()
def _apart(points: NDArray[Any], p: NDArray[Any], q: NDArray[Any]) -> bool:
    """Whether two triangles meet in no point but the corners and the edge that they share."""
    one, other = np.empty(3, np.int64), np.empty(3, np.int64)
    shared = 0
    # Shared corners first, in the same order in both.
    for i in range(3):
        for j in range(3):
            if p[i] == q[j]:
                one[shared], other[shared] = p[i], q[j]
                shared += 1
    for corners, mine in ((p, one), (q, other)):
        at = shared
        for i in range(3):
            known = False
            for k in range(shared):
                known = known or mine[k] == corners[i]
            if not known:
                if at == 3:
                    return False  # a corner twice
                mine[at] = corners[i]
                at += 1
    if shared > 2:
        return False
    if shared == 2:
        return bool(_unfolded(points, one, other))
    # All ways from one triangle to the other: none where their hull holds no origin. Of two that
    # share a corner, both continued from there as cones.
    ways = np.empty((9, 3))
    count = 0
    for i in range(shared, 3):
        for j in range(shared, 3):
            if shared == 0:
                ways[count] = points[other[j]] - points[one[i]]
                count += 1
    if shared == 1:
        count = 4
        for k in range(2):
            ways[k] = points[one[0]] - points[one[1 + k]]
            ways[2 + k] = points[other[1 + k]] - points[other[0]]
    return bool(_on_one_side(ways[:count]))


@njit()
def _on_one_side(ways: NDArray[Any]) -> bool:
    """Whether some direction has a positive product with all vectors, (k, 3), for certain.

    If any has, then so has the way to the point of their hull that is nearest to the origin. It
    lies on a corner of the hull, on a side or on a face: all of them are tried.
    """
    count = len(ways)
    for k in range(count):
        length = math.sqrt((ways[k] ** 2).sum())
        if length == 0.0:
            return False
        ways[k] /= length
    way = np.empty(3)
    for a in range(count):
        if _is_positive(ways, ways[a]):
            return True
        for b in range(a):
            side = ways[b] - ways[a]
            square = (side**2).sum()
            if square == 0.0:
                continue
            way[:] = ways[a] - (ways[a] * side).sum() / square * side
            if _is_positive(ways, way):
                return True
            for c in range(b):
                other = ways[c] - ways[a]
                for i in range(3):
                    j, k = (i + 1) % 3, (i + 2) % 3
                    way[i] = side[j] * other[k] - side[k] * other[j]
                if (way * ways[a]).sum() < 0.0:
                    way *= -1.0
                if _is_positive(ways, way):
                    return True
    return False


@njit()
def _is_positive(ways: NDArray[Any], direction: NDArray[Any]) -> bool:
    for k in range(len(ways)):
        value = size = 0.0
        for i in range(3):
            value += direction[i] * ways[k, i]
            size += abs(direction[i] * ways[k, i])
        if value <= ROUNDING * size:
            return False
    return True


@njit()
def _across(points: NDArray[Any], a: int, b: int, c: int, d: int, out: NDArray[Any]) -> None:
    """The cross product of b - a and d - c, and the sums of its absolute products, (2, 3)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        x = (points[b, j] - points[a, j]) * (points[d, k] - points[c, k])
        y = (points[b, k] - points[a, k]) * (points[d, j] - points[c, j])
        out[0, i], out[1, i] = x - y, abs(x) + abs(y)


@njit()
def _side(points: NDArray[Any], across: NDArray[Any], origin: int, at: int) -> int:
    """On which side of the plane through `origin` a point lies: 1, -1, or 0 where that is open."""
    value = size = 0.0
    for i in range(3):
        way = points[at, i] - points[origin, i]
        value += across[0, i] * way
        size += across[1, i] * abs(way)
    if abs(value) <= ROUNDING * size:
        return 0
    return 1 if value > 0.0 else -1


@njit()
def _unfolded(points: NDArray[Any], one: NDArray[Any], other: NDArray[Any]) -> bool:
    """Whether two triangles that share an edge, their first two corners, meet there alone."""
    across = np.empty((2, 3))
    _across(points, one[0], one[1], one[0], one[2], across)
    if _side(points, across, one[0], other[2]) != 0:
        return True
    # In one plane, as far as is certain: on different sides of the edge. Both third corners are
    # compared along the way across the edge; it is no product of two differences, but of three.
    value = np.zeros(2)
    size = np.zeros(2)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        edge_j, edge_k = (
            points[one[1], j] - points[one[0], j],
            points[one[1], k] - points[one[0], k],
        )
        way = across[0, j] * edge_k - across[0, k] * edge_j
        doubt = across[1, j] * abs(edge_k) + across[1, k] * abs(edge_j)
        for at, corner in enumerate((one[2], other[2])):
            step = points[corner, i] - points[one[0], i]
            value[at] += way * step
            size[at] += doubt * abs(step)
    for at in range(2):
        if abs(value[at]) <= 2.0 * ROUNDING * size[at]:
            return False
    return bool(value[0] * value[1] < 0.0)
