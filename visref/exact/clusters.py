"""Triangles in clusters of neighbours, those that move apart from those that stand still.

What stands still is put in order once; what moves is at each pose, by itself. The order of a
moment hangs on that moment alone, and so does whatever is counted on the way to a decision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.placing import core_of, somewhere
from visref.scene import Float32, Float64, Int32, Int64, Scene

Bool = NDArray[np.bool_]

# Triangles in a cluster: enough that its box costs little, few enough that it is small.
CLUSTER = 32


class Clusters:
    """A scene's triangles in clusters: those that are there, which is all that can be seen.

    `order`: (k,) int32 triangle ids, first those of objects that do not move. `corners`: (k, 9)
    float32, `one_sided`: (k,) bool, `alpha`: (k,) uint8, in that order.
    `offsets`: (c + 1,) int64, cluster i has `order[offsets[i]:offsets[i + 1]]` and lies in
    `bounds[i]`, (c, 2, 3) float32.
    `movable`: (m,) int32, the triangles of objects that may move, there or not.
    """

    def __init__(self, scene: Scene) -> None:
        moving = np.zeros(scene.object_count, np.bool_) if scene.moving is None else scene.moving
        self._objects = np.flatnonzero(moving).astype(np.int32)
        self._units = scene.object_units().take(self._objects)
        self.movable = self._units.triangles
        still = np.arange(scene.triangle_count, dtype=np.int32)
        if scene.absent is not None or len(self._objects):
            still = still[~moving[scene.object_of_triangle] & scene.present]
        # Room for all that may come.
        room = len(still) + len(self.movable)
        self._order = np.empty(room, np.int32)
        self._corners = np.empty((room, 9), np.float32)
        self._one_sided = np.empty(room, np.bool_)
        self._alpha = np.empty(room, np.uint8)
        boxes = scene.object_bounds[~moving]
        self._still = len(still)
        self._still_offsets, self._still_bounds = self._fill(scene, 0, still, boxes)
        self._show(self._still, self._still_offsets, self._still_bounds)
        if len(self._objects):
            self.pose(scene)

    def pose(self, scene: Scene) -> Float32:
        """Follow to another moment; returns the corners, (m, 9) float32, of what may move and is
        there."""
        there = self.movable
        if scene.absent is not None:
            there = there[scene.present[there]]
        boxes = scene.bounds_of(self._units)
        starts, bounds = self._fill(scene, self._still, there, boxes)
        self._show(
            self._still + len(there),
            np.concatenate([self._still_offsets, starts]),
            np.concatenate([self._still_bounds, bounds]),
        )
        return self.corners[self._still :]

    def _show(self, count: int, starts: Int64, bounds: Float32) -> None:
        self.order = self._order[:count]
        self.corners = self._corners[:count]
        self.one_sided = self._one_sided[:count]
        self.alpha = self._alpha[:count]
        self.offsets, self.bounds = np.append(starts, count), bounds

    def _fill(self, scene: Scene, at: int, ids: Int32, boxes: Float64) -> tuple[Int64, Float32]:
        """Put triangles, of objects with these boxes, in order from a place on: where their
        clusters start, (c,) int64, and the clusters' boxes, (c, 2, 3) float32."""
        corners = scene.vertices[scene.triangles[ids]]
        low, high = (
            of(of(corners[:, 0], corners[:, 1]), corners[:, 2]) for of in (np.minimum, np.maximum)
        )
        order = _spatial_order(low, high, core_of(somewhere(boxes)))
        ids = ids[order]
        part = slice(at, at + len(ids))
        self._order[part] = ids
        self._corners[part] = corners.reshape(-1, 9)[order]
        self._one_sided[part] = scene.one_sided[ids]
        self._alpha[part] = scene.alpha[ids]
        starts = np.arange(0, len(ids), CLUSTER)
        bounds = np.zeros((len(starts), 2, 3), np.float32)
        if len(ids):
            bounds[:, 0] = np.minimum.reduceat(low[order], starts, axis=0)
            bounds[:, 1] = np.maximum.reduceat(high[order], starts, axis=0)
        return starts + at, bounds


def _spatial_order(low: Float32, high: Float32, box: Float64) -> Int64:
    """The places of triangles with these least and greatest corners, (k, 3) each, such that
    neighbours in the list are near each other and of like size. `box`: (2, 3) float64, where most
    of them are."""
    if not len(low):
        return np.zeros(0, np.int64)
    low, high = low.astype(np.float64), high.astype(np.float64)
    extent = float((box[1] - box[0]).max()) or 1.0
    size = np.clip(np.frexp((high - low).max(axis=1) / extent)[1], -8, 1) + 8
    cell = np.clip((0.5 * (low + high) - box[0]) / extent * 1024.0, 0, 1023).astype(np.int64)
    # Morton order: the bits of the three cell coordinates interleaved.
    for shift, mask in ((16, 0xFF0000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        cell = (cell | cell << shift) & mask
    key = cell[:, 0] | cell[:, 1] << 1 | cell[:, 2] << 2 | size.astype(np.int64) << 30
    return np.argsort(key, kind="stable")
