"""What moves and what stands still, as a ray library gets them: apart.

What stands still is built once. What moves is handed over anew at each pose, every triangle with
corners of its own, so that neither its vertices nor its hierarchy hang on the poses before. A
pose's answers are those of an engine that was made of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.placing import origin_of, somewhere
from visref.scene import Float32, Float64, Int32, Scene

# What the triangles that stand still and those that move are called, (s,) and (m,) int32.
Places = tuple[Int32, Int32]

# By how many powers of two what moves may reach further than what stands still before that is
# scaled, and so built, anew. Scaling rounds nothing, and products of three lengths, 2^48, are far
# within float32's exponents.
ROOM = 16

# Vertices that are moved and scaled at a time.
_BLOCK = 1 << 12
_WIDE = 256


class Parts:
    """A scene's opaque triangles, `solid` (t,) int32 ascending ids, as those that move and those
    that do not: of what `scene.moving` says, at the moment of `scene`."""

    def __init__(self, scene: Scene, moving: NDArray[np.bool_], solid: Int32) -> None:
        self.solid = solid
        moves = moving[scene.object_of_triangle[solid]]
        there = scene.present[solid]
        # Places in `solid`. Nobody that does not move comes or goes.
        self.still = np.flatnonzero(~moves & there).astype(np.int32)
        self.movable = np.flatnonzero(moves).astype(np.int32)
        self._object_of_movable = scene.object_of_triangle[solid[self.movable]]
        self._objects = np.flatnonzero(moving).astype(np.int32)
        self._units = scene.object_units().take(self._objects)
        self._boxes = scene.object_bounds.copy()
        self.there = self.movable

    def meet(self, scene: Scene) -> None:
        """Follow to another moment: `there`, the places of the triangles that move and are there,
        and the boxes."""
        self._boxes[self._objects] = scene.bounds_of(self._units)
        self.there = self.movable
        if scene.absent is not None:
            self.there = self.movable[~scene.absent[self._object_of_movable]]

    def origin(self) -> Float64:
        """(3,) float64, what is to be subtracted from all of it."""
        return origin_of(somewhere(self._boxes))

    def bounds(self) -> Float64:
        """(2, 3) float64: `Scene.bounds` of this moment, zeros where nothing is there."""
        boxes = somewhere(self._boxes)
        if not len(boxes):
            return np.zeros((2, 3))
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    def standing(self, scene: Scene) -> tuple[Float32, Int32]:
        """What stands still: vertices (v, 3), of those triangles alone, and triangles (s, 3)."""
        triangles = scene.triangles[self.solid[self.still]]
        used = np.zeros(len(scene.vertices), np.bool_)
        used[triangles] = True
        row = np.cumsum(used, dtype=np.int32) - 1
        return scene.vertices[used], row[triangles]


def scale_of(still: float, moving: float) -> float:
    """The power of two by which all is multiplied, given the greatest coordinates of both parts.
    It hangs on this moment alone, and rarely on what moves."""
    exponent, outer = (int(np.frexp(value)[1]) for value in (still, moving))
    if still == 0.0 or (moving > 0.0 and outer > exponent + ROOM):
        exponent = outer
    return 2.0**-exponent


def local_vertices(
    vertices: Float32, rebase: Float64, scale: float | None = None
) -> tuple[Float32, float, bool]:
    """(vertices - rebase) * scale in float32, (v, 3), the scale, by default a power of two with
    which the greatest coordinate is between 1/2 and 1, and whether no rounding came of it (either
    way)."""
    if scale is None:
        reach = 0.0
        if len(vertices):
            # Subtracting does not decrease where what is subtracted from grows.
            low, high = (end.astype(np.float64) - rebase for end in _column_ends(vertices))
            reach = max(-float(low.min()), float(high.max()), 0.0)
        scale = scale_of(reach, 0.0)
    # One more, for a library that reads whole vectors; what is handed out has only the vertices.
    local = np.zeros((len(vertices) + 1, 3), np.float32)[:-1]
    exact, moves = True, bool(rebase.any())
    # Block by block, so that float64 stays in the cache: a scene may have millions of vertices.
    scratch = np.empty((min(len(vertices), _BLOCK), 3))
    for at in range(0, len(vertices), _BLOCK):
        block, part = vertices[at : at + _BLOCK], local[at : at + _BLOCK]
        moved = scratch[: len(block)]
        np.subtract(block, rebase, out=moved)
        exact = exact and (not moves or np.array_equal(moved + rebase, block))
        moved *= scale
        part[:] = moved
        exact = exact and np.array_equal(part, moved)
    return local, scale, exact


def _column_ends(vertices: Float32) -> tuple[Float32, Float32]:
    """The least and the greatest of each coordinate, (3,) each, of one vertex at least."""
    # NumPy is slow along rows of three: many of them are made one.
    wide = len(vertices) // _WIDE * _WIDE
    ends = []
    for best in (np.min, np.max):
        some = best(vertices[:wide].reshape(-1, 3 * _WIDE), axis=0) if wide else vertices[:0]
        ends.append(best(np.concatenate([some.reshape(-1, 3), vertices[wide:]]), axis=0))
    return ends[0], ends[1]


def own_corners(count: int) -> Int32:
    """(count, 3) int32: triangles that share no corner."""
    return np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def nearer(still: tuple[Int32, Float32], moving: tuple[Int32, Float32], places: Places) -> Int32:
    """(n,) int32, the places of the nearer of two answers, each primitives (n,), -1 for none, and
    distances (n,) float32; the lesser place where they are level."""
    (first, near), (second, far) = still, moving
    place = np.full(len(first), -1, np.int32)
    met = np.flatnonzero(first >= 0)
    place[met] = places[0][first[met]]
    met = np.flatnonzero(second >= 0)
    other = places[1][second[met]]
    before = (place[met] < 0) | (far[met] < near[met])
    before |= (far[met] == near[met]) & (other < place[met])
    place[met[before]] = other[before]
    return place


@njit()
def reach(
    vertices: NDArray[Any], triangles: NDArray[Any], which: NDArray[Any], origin: Any
) -> float:
    """The greatest coordinate of some triangles' corners less `origin`: in float64."""
    greatest = 0.0
    for t in which:
        for corner in range(3):
            for axis in range(3):
                at = np.float64(vertices[triangles[t, corner], axis]) - origin[axis]
                greatest = max(greatest, abs(at))
    return greatest


@njit()
def place_corners(
    vertices: NDArray[Any],
    triangles: NDArray[Any],
    which: NDArray[Any],
    origin: Any,
    scale: float,
    corners: NDArray[Any],
) -> bool:
    """(corner - origin) * scale of the triangles `which`, (m,) int32 ids, into `corners`,
    (3 m, 3) float32; whether no rounding came of it."""
    exact = True
    for i, t in enumerate(which):
        for corner in range(3):
            for axis in range(3):
                at = np.float64(vertices[triangles[t, corner], axis])
                moved = at - origin[axis]
                local = np.float32(moved * scale)
                exact &= moved + origin[axis] == at and np.float64(local) == moved * scale
                corners[3 * i + corner, axis] = local
    return exact
