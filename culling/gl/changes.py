"""What has changed from one moment of a scene to the next, and how it gets to the GPU.

A frame in which something moved, appeared or vanished (an absent object's triangles are collapsed,
see `Scene.absent`) costs one pass over vertices and triangles, and what has changed is sent, in
whole blocks of rows. Nothing else of a scene changes over time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Int32, Int64, Scene, Units

# Rows are sent in blocks of so many: a call costs about what sending 20 kB does, and scattered
# changes make no more calls than there are blocks.
BLOCK_ROWS = 1024


@dataclass(frozen=True, eq=False)
class Changes:
    """`vertices`: (v,) bool, those that moved; `indices`: (t,) bool, triangles that name other
    vertices than before; `triangles`: (t,) bool, those and the ones with a vertex that moved."""

    vertices: NDArray[np.bool_]
    indices: NDArray[np.bool_]
    triangles: NDArray[np.bool_]

    @classmethod
    def between(cls, before: Scene, now: Scene) -> Changes:
        """Of two moments of one scene: as many vertices, the same triangles and objects."""
        vertices = np.zeros(len(now.vertices), np.bool_)
        indices = np.zeros(now.triangle_count, np.bool_)
        if now.vertices is not before.vertices:
            # By their bits: a zero may change its sign.
            _differ(before.vertices.view(np.int32), now.vertices.view(np.int32), vertices)
        if now.triangles is not before.triangles:
            _differ(before.triangles, now.triangles, indices)
        triangles = indices.copy()
        if vertices.any():
            _with_corners(now.triangles, vertices, triangles)
        return cls(vertices, indices, triangles)

    def units(self, units: Units) -> Int64:
        """(k,) int64, ascending: the units that have a triangle which changed."""
        touched = np.zeros(units.count, np.bool_)
        _touched(units.offsets, units.triangles, self.triangles, touched)
        return np.flatnonzero(touched)


def taken(units: Units, ids: Int64) -> Units:
    """Those units alone, (k,) ids, in that order."""
    offsets = np.concatenate([[0], np.cumsum(units.sizes[ids])])
    return Units(offsets, units.gather(ids.astype(np.int32)), units.kind)


def write_rows(
    buffer: moderngl.Buffer, changed: NDArray[np.bool_], rows: Callable[[int, int], NDArray[Any]]
) -> None:
    """Send what has changed, (n,) bool, one per row of the buffer. `rows(first, end)` are the rows
    as they are now, (end - first, …)."""
    if not changed.any():
        return
    touched = np.logical_or.reduceat(changed, np.arange(0, len(changed), BLOCK_ROWS))
    edges = np.flatnonzero(np.diff(touched, prepend=False, append=False)) * BLOCK_ROWS
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        part = np.ascontiguousarray(rows(first, min(end, len(changed))))
        buffer.write(part.tobytes(), offset=first * (part.nbytes // len(part)))


def write_vertices(buffer: moderngl.Buffer, scene: Scene, changes: Changes) -> None:
    """Bring a buffer of a scene's vertices up to date."""
    write_rows(buffer, changes.vertices, lambda first, end: scene.vertices[first:end])


def write_indices(
    buffer: moderngl.Buffer, scene: Scene, changes: Changes, triangles: Int32
) -> None:
    """Bring a buffer of the vertex ids of some triangles, (n,) int32, up to date."""
    if changes.indices.any():
        write_rows(
            buffer,
            changes.indices[triangles],
            lambda first, end: scene.triangles[triangles[first:end]],
        )


@njit()
def _differ(before: NDArray[Any], now: NDArray[Any], result: NDArray[Any]) -> None:
    for i in range(len(now)):
        result[i] = (
            before[i, 0] != now[i, 0] or before[i, 1] != now[i, 1] or before[i, 2] != now[i, 2]
        )


@njit()
def _with_corners(triangles: NDArray[Any], vertices: NDArray[Any], result: NDArray[Any]) -> None:
    for i in range(len(triangles)):
        result[i] |= (
            vertices[triangles[i, 0]] | vertices[triangles[i, 1]] | vertices[triangles[i, 2]]
        )


@njit()
def _touched(
    offsets: NDArray[Any], members: NDArray[Any], changed: NDArray[Any], result: NDArray[Any]
) -> None:
    for unit in range(len(offsets) - 1):
        for k in range(offsets[unit], offsets[unit + 1]):
            if changed[members[k]]:
                result[unit] = True
                break
