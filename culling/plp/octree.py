"""An octree whose leaves are the cells of PLP: convex, disjoint, and filling their root.

Klosowski, Silva: "Efficient Conservative Visibility Culling Using the Prioritized-Layered
Projection Algorithm", TVCG 7(4), 2001, section 2.1: cells shrink where primitives are dense, and
only the leaves matter once they are made. The root is a cube from the scene's least corner on.

A triangle is in every leaf that it meets, leaves being closed: it is left out of one only where
an axis separates the two for certain. A leaf has fewer triangles than the limit, except where
halving no longer tells triangles apart (see `MAX_GROWTH` and `MAX_DEPTH`).

A leaf's sides are whole numbers on a grid of 2**MAX_DEPTH steps, so that neighbours of any size
share exactly the same coordinate at their common face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.frozen import frozen
from visref.scene import Float64, Int32, Int64, Scene, Units

MAX_DEPTH = 16
STEPS = 1 << MAX_DEPTH

# A node is not split once its ancestors' splits have multiplied the triangles' copies by this:
# in a pile of coincident or crossing triangles every child gets nearly all of them, and the
# limit can never be met. All leaves together then hold at most 8 times this many copies.
MAX_GROWTH = 8.0

# A box is grown by this part of the greatest coordinate before it is compared with a triangle.
# The box's sides (2 roundings), the corners relative to its centre (1), two products and two
# sums of a projection on an axis (4) err by less than 8 units of 2**-53 of the triangle's and
# the root's coordinates, which are up to 4 times the greatest: 2**-48 in all. Outward: a
# triangle near a leaf may be in it in vain.
BOX_PAD = 2.0**-45

CHILD = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)], np.int64)


class Links(NamedTuple):
    """Pairs of leaves that share part of a face, each both ways, grouped by the first.

    `offsets`: (n + 1,) int64; `to`: (m,) int32 leaves; `axis`: (m,) int8, the axis of the face's
    normal.
    """

    offsets: Int64
    to: Int32
    axis: NDArray[np.int8]


@dataclass(frozen=True, eq=False)
class Octree:
    """Leaves over a scene. `low`: (3,) float64 and `side`: the root's; `corner`: (n, 3) int64
    and `width`: (n,) int64, each leaf's least corner and side in grid steps; `bounds`: (n, 2, 3)
    float64, the same in world space; `units`: each leaf's triangles, ascending.

    `children`: (nodes,) int64, the first of a node's eight children, or -1 - leaf.
    """

    low: Float64
    side: float
    corner: Int64
    width: Int64
    bounds: Float64
    units: Units
    children: Int64

    @property
    def leaf_count(self) -> int:
        return len(self.width)

    def locate(self, cell: Int64, least_width: Int64 | None = None) -> Int64:
        """The leaf that holds each grid cell, (k,) int64 from (k, 3) grid coordinates within
        the root; -1 where it is narrower than `least_width`."""
        node = np.zeros(len(cell), np.int64)
        found = np.full(len(cell), -1, np.int64)
        going = np.arange(len(cell))
        for level in range(MAX_DEPTH + 1):
            first = self.children[node[going]]
            at_leaf = first < 0
            found[going[at_leaf]] = -1 - first[at_leaf]
            going, first = going[~at_leaf], first[~at_leaf]
            half = STEPS >> (level + 1)
            if least_width is not None:
                wide = half >= least_width[going]
                going, first = going[wide], first[wide]
            if not len(going):
                break
            bits = (cell[going] // half) & 1
            node[going] = first + (bits << np.arange(3)).sum(axis=1)
        return found

    def links(self) -> Links:
        """Every pair of leaves that meet in a face, across sizes: a leaf looks for neighbours
        at least as wide as itself, and each pair found counts both ways."""
        parts = []
        leaves = np.arange(self.leaf_count)
        for axis in range(3):
            for sign in (-1, 1):
                beyond = self.corner.copy()
                beyond[:, axis] += np.where(sign > 0, self.width, -1)
                inside = (beyond[:, axis] >= 0) & (beyond[:, axis] < STEPS)
                other = self.locate(beyond[inside], self.width[inside])
                here, other = leaves[inside][other >= 0], other[other >= 0]
                parts.append(np.stack([here, other, np.full_like(here, axis)]))
                parts.append(np.stack([other, here, np.full_like(here, axis)]))
        pairs = np.unique(np.concatenate(parts, axis=1).T, axis=0)
        start, to, axis_of = pairs.T
        offsets = np.searchsorted(start, np.arange(self.leaf_count + 1))
        return Links(offsets.astype(np.int64), to.astype(np.int32), axis_of.astype(np.int8))

    def hull(self) -> NDArray[np.bool_]:
        """(n, 2, 3) bool: which leaves have a face in each of the root's six faces."""
        return np.stack([self.corner == 0, self.corner + self.width[:, None] == STEPS], axis=1)


def octree_of(scene: Scene, limit: int) -> Octree:
    """`build`, once for all cullers of a scene: a million triangles take a second."""
    made = _MADE.setdefault(scene, {})
    if limit not in made:
        made[limit] = build(scene, limit)
    return made[limit]


# By scene, for as long as it is there, and by limit.
_MADE: WeakKeyDictionary[Scene, dict[int, Octree]] = WeakKeyDictionary()


def build(scene: Scene, limit: int) -> Octree:
    """The octree of a scene, its leaves with fewer than `limit` triangles."""
    corners = scene.vertices.astype(np.float64)
    low, side = _root(scene)
    pad = BOX_PAD * (np.abs(low).max() + side)
    children: list[Int64] = []
    leaves: list[tuple[Int64, Int64, Int64, Int32]] = []  # corner, width, sizes, triangles
    leaf_count = node_count = 0
    corner = np.zeros((1, 3), np.int64)
    growth = np.ones(1)
    offsets = np.array([0, scene.triangle_count])
    triangles = np.arange(scene.triangle_count, dtype=np.int32)
    for depth in range(MAX_DEPTH + 1):
        width = STEPS >> depth
        sizes = np.diff(offsets)
        split = (sizes >= limit) & (growth < MAX_GROWTH) & (depth < MAX_DEPTH)
        keep = np.flatnonzero(~split)
        held = Units(offsets, triangles).gather(keep.astype(np.int32))
        leaves.append((corner[keep], np.full(len(keep), width), sizes[keep], held))
        first = np.empty(len(corner), np.int64)
        first[keep] = -1 - leaf_count - np.arange(len(keep))
        leaf_count += len(keep)
        chosen = np.flatnonzero(split)
        node_count += len(corner)
        first[chosen] = node_count + 8 * np.arange(len(chosen))
        children.append(first)
        if not len(chosen):
            break
        moved = Units(offsets, triangles).gather(chosen.astype(np.int32))
        starts = np.concatenate([[0], np.cumsum(sizes[chosen])])
        corner = (corner[chosen, None] + CHILD * (width // 2)).reshape(-1, 3)
        bounds = _world(low, side, corner, np.full(len(corner), width // 2))
        counts, triangles = _distribute(corners, scene.triangles, moved, starts, bounds, pad)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        spread = counts.reshape(-1, 8).sum(axis=1) / sizes[chosen]
        growth = np.repeat(growth[chosen] * spread, 8)
    all_corners = np.concatenate([part[0] for part in leaves])
    widths = np.concatenate([part[1] for part in leaves])
    sizes = np.concatenate([part[2] for part in leaves])
    units = Units(
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        np.concatenate([part[3] for part in leaves]),
        "octree cell",
    )
    bounds = _world(low, side, all_corners, widths)
    return Octree(
        low,
        side,
        frozen(all_corners),
        frozen(widths),
        frozen(bounds),
        units,
        frozen(np.concatenate(children)),
    )


def _root(scene: Scene) -> tuple[Float64, float]:
    """Least corner and side of a cube that holds every vertex that a triangle uses."""
    low, high = scene.bounds
    side = float((high - low).max()) or 1.0
    while (low + side < high).any():  # the difference rounded down
        side = float(np.nextafter(side, np.inf))
    return np.asarray(low, np.float64), side


def _world(low: Float64, side: float, corner: Int64, width: Int64) -> Float64:
    """(k, 2, 3) float64 world boxes. The same grid coordinate always gives the same number."""
    grid = np.stack([corner, corner + width[:, None]], axis=1)
    result: Float64 = low + side * (grid / STEPS)
    return result


def _distribute(
    corners: Float64,
    triangles: Int32,
    chosen: Int32,
    starts: Int64,
    bounds: Float64,
    pad: float,
) -> tuple[Int64, Int32]:
    """Give the nodes' triangles to their children: (8 k,) counts, and the lists joined.
    `chosen` are the nodes' triangles, `starts` where each node's begin, `bounds` the
    children's boxes."""
    met = np.empty(len(chosen), np.uint8)
    counts = np.zeros(len(bounds), np.int64)
    _meet(corners, triangles, chosen, starts, bounds, pad, met, counts)
    lists = np.empty(int(counts.sum()), np.int32)
    _fill(chosen, starts, met, np.cumsum(counts) - counts, lists)
    return counts, lists


@njit()
def _meet(
    corners: NDArray[Any],
    triangles: NDArray[Any],
    chosen: NDArray[Any],
    starts: NDArray[Any],
    bounds: NDArray[Any],
    pad: float,
    met: NDArray[Any],
    counts: NDArray[Any],
) -> None:
    """Set in `met` a bit for each of the eight children that a triangle meets."""
    p = np.empty((3, 3))
    for node in range(len(starts) - 1):
        first = 8 * node
        for place in range(starts[node], starts[node + 1]):
            for i in range(3):
                for axis in range(3):
                    p[i, axis] = corners[triangles[chosen[place], i], axis]
            bits = 0
            for child in range(8):
                if _meets_box(p, bounds[first + child], pad):
                    bits |= 1 << child
                    counts[first + child] += 1
            met[place] = bits


@njit()
def _fill(
    chosen: NDArray[Any],
    starts: NDArray[Any],
    met: NDArray[Any],
    at: NDArray[Any],
    lists: NDArray[Any],
) -> None:
    for node in range(len(starts) - 1):
        for place in range(starts[node], starts[node + 1]):
            for child in range(8):
                if met[place] >> child & 1:
                    lists[at[8 * node + child]] = chosen[place]
                    at[8 * node + child] += 1


@njit()
def _meets_box(p: NDArray[Any], box: NDArray[Any], pad: float) -> bool:
    """False only where an axis separates the triangle `p` from the closed box, grown by `pad`.

    Whichever axis the rounded arithmetic tries, a gap along it is a proof.
    """
    inside = True
    for axis in range(3):
        least = min(p[0, axis], p[1, axis], p[2, axis])
        most = max(p[0, axis], p[1, axis], p[2, axis])
        if least > box[1, axis] + pad or most < box[0, axis] - pad:
            return False
        inside = inside and least >= box[0, axis] and most <= box[1, axis]
    if inside:
        return True
    q = np.empty((3, 3))
    half = np.empty(3)
    for axis in range(3):
        # Halved first: the sum of two great coordinates need not be finite.
        middle = 0.5 * box[0, axis] + 0.5 * box[1, axis]
        half[axis] = 0.5 * box[1, axis] - 0.5 * box[0, axis] + pad
        for i in range(3):
            q[i, axis] = p[i, axis] - middle
    a = np.empty(3)
    e, f = q[1] - q[0], q[2] - q[0]
    a[0] = e[1] * f[2] - e[2] * f[1]
    a[1] = e[2] * f[0] - e[0] * f[2]
    a[2] = e[0] * f[1] - e[1] * f[0]
    if _separates(q, a, half):
        return False
    for i in range(3):
        e = q[(i + 1) % 3] - q[i]
        for axis in range(3):
            j, k = (axis + 1) % 3, (axis + 2) % 3
            a[axis], a[j], a[k] = 0.0, -e[k], e[j]
            if _separates(q, a, half):
                return False
    return True


@njit(inline="always")
def _separates(q: NDArray[Any], a: NDArray[Any], half: NDArray[Any]) -> bool:
    reach = abs(a[0]) * half[0] + abs(a[1]) * half[1] + abs(a[2]) * half[2]
    s0 = q[0, 0] * a[0] + q[0, 1] * a[1] + q[0, 2] * a[2]
    s1 = q[1, 0] * a[0] + q[1, 1] * a[1] + q[1, 2] * a[2]
    s2 = q[2, 0] * a[0] + q[2, 1] * a[1] + q[2, 2] * a[2]
    return bool(min(s0, s1, s2) > reach or max(s0, s1, s2) < -reach)
