"""A scene with fewer triangles, to be looked at and not judged: some objects whole, the others
simplified, and what even then does not fit left out, the smallest first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from visref.scene import Float64, Int32, Int64, Scene

# What an object is not simplified below: a box.
LEAST_TRIANGLES = 12
# Positions are told in so many steps along each side of their object's box.
STEPS = 65535
# How fine the grid is that merges vertices where edges cannot be collapsed any further.
_GRID = 64

Part = tuple[Float64, Int64]


@dataclass(frozen=True, eq=False)
class Thinned:
    """`positions`: (v, 3) uint16, steps from the least corner of their object's box; `triangles`:
    (t, 3) int32 ids of vertices of the same object, which count from 0 in each; `vertex_counts`,
    `triangle_counts`: (n,) int64; `low`, `step`: (n, 3) float64, so that a vertex is
    low + step * position. `whole`: (n,) bool, objects with all their triangles. `left_out`: how
    many objects that have triangles have none here."""

    positions: NDArray[np.uint16]
    triangles: Int32
    vertex_counts: Int64
    triangle_counts: Int64
    low: Float64
    step: Float64
    whole: NDArray[np.bool_]
    left_out: int


def thinned(scene: Scene, first: Sequence[int], budget: int, whole_budget: int) -> Thinned:
    """The scene with at most `budget` triangles, and beside them those of the objects `first`, the
    most important first, which stay whole as long as they have no more than `whole_budget`."""
    counts = np.diff(scene.object_offsets)
    kept = np.zeros(scene.object_count, np.bool_)
    left = whole_budget
    for obj in first:
        if counts[obj] <= left:
            kept[obj] = True
            left -= int(counts[obj])
    goals = np.where(kept, counts, _goals(counts * ~kept, budget))
    goals[_too_small(scene, goals * ~kept, budget)] = 0
    points, faces = [], []
    for obj, goal in enumerate(goals.tolist()):
        part = _part(scene, obj) if goal else (np.zeros((0, 3)), np.zeros((0, 3), np.int64))
        part = _simplified(part, goal) if 0 < goal < counts[obj] else part
        points.append(part[0])
        faces.append(part[1])
    boxes = [
        (one.min(axis=0), one.max(axis=0)) if len(one) else (np.zeros(3), np.zeros(3))
        for one in points
    ]
    low = np.array([box[0] for box in boxes]).reshape(-1, 3)
    step = (np.array([box[1] for box in boxes]).reshape(-1, 3) - low) / STEPS
    vertex_counts = np.array([len(one) for one in points], np.int64)
    every = np.concatenate([*points, np.zeros((0, 3))])
    steps = np.repeat(np.where(step > 0.0, step, 1.0), vertex_counts, axis=0)
    positions = np.rint((every - np.repeat(low, vertex_counts, axis=0)) / steps)
    triangle_counts = np.array([len(one) for one in faces], np.int64)
    return Thinned(
        positions.astype(np.uint16),
        np.concatenate([*faces, np.zeros((0, 3), np.int64)]).astype(np.int32),
        vertex_counts,
        triangle_counts,
        low,
        step,
        triangle_counts == counts,
        int(np.count_nonzero((counts > 0) & (triangle_counts == 0))),
    )


def _goals(counts: Int64, budget: int) -> Int64:
    """For objects of so many triangles each, how many they may keep: the same share of each, but
    for small ones."""
    least = np.minimum(counts, LEAST_TRIANGLES)
    if counts.sum() <= budget:
        return counts
    shares = 0.0, 1.0
    for _ in range(40):
        middle = sum(shares) / 2
        fits = np.maximum(least, np.floor(counts * middle)).sum() <= budget
        shares = (middle, shares[1]) if fits else (shares[0], middle)
    goals: Int64 = np.maximum(least, np.floor(counts * shares[0])).astype(np.int64)
    return goals


def _too_small(scene: Scene, goals: Int64, budget: int) -> Int64:
    """The objects that do not fit, the largest first."""
    boxes = scene.object_bounds
    with np.errstate(invalid="ignore"):
        sizes = np.nan_to_num(np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1), posinf=0.0)
    order = np.argsort(-sizes, kind="stable")
    order = order[goals[order] > 0]
    return order[np.cumsum(goals[order]) > budget]


def _part(scene: Scene, obj: int) -> Part:
    """An object's vertices and triangles, those of no extent too."""
    triangles = scene.triangles[scene.object_offsets[obj] : scene.object_offsets[obj + 1]]
    used, index = np.unique(triangles, return_inverse=True)
    return scene.vertices[used].astype(np.float64), index.reshape(-1, 3).astype(np.int64)


def _simplified(part: Part, goal: int) -> Part:
    """The part with at most `goal` triangles."""
    points, index = np.unique(part[0], axis=0, return_inverse=True)
    low, extent = points.min(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
    points, faces = (points - low) / extent, index.reshape(-1)[part[1]]
    # A run may get stuck; the next one goes on.
    while len(faces) > goal:
        further = fast_simplification.simplify(points, faces.astype(np.int32), target_count=goal)
        if not 0 < len(further[1]) < len(faces):
            break
        points, faces = further[0].astype(np.float64), further[1].astype(np.int64)
    # Many loose pieces: whatever lies in the same cell of a grid becomes one point.
    cells = _GRID
    while len(faces) > goal and cells:
        points, faces = _clustered(points, faces, cells)
        cells //= 2
    return low + extent * points, faces


def _clustered(points: Float64, faces: Int64, cells: int) -> Part:
    _, kept, index = np.unique(
        np.floor(points * cells), axis=0, return_index=True, return_inverse=True
    )
    faces = np.sort(index.reshape(-1)[faces], axis=1)
    apart = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
    return points[kept], np.unique(faces[apart], axis=0)
