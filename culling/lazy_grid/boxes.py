"""The units of a triangle scene: boxes of so many triangles, from a hierarchical subdivision.

Hey, Tobler, Purgathofer 2001, section 7: "hierarchically subdivided into bounding boxes until
each bounding box contains no more than 1500 triangles". The paper does not say where it cuts.
Here a set of triangles is cut across the longest axis of its centroids, so that both parts
fill their share of ceil(count / limit) boxes: as few boxes as the limit allows, and all of
nearly one size.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Scene, Units


def triangle_boxes(scene: Scene, limit: int) -> Units:
    """Units of at most `limit` triangles; every triangle is in exactly one."""
    count = scene.triangle_count
    boxes = -(-count // limit)
    ids = np.arange(count, dtype=np.int32)
    offsets = np.zeros(boxes + 1, np.int64)
    if count:
        _subdivide(_centroids(scene.vertices, scene.triangles), ids, offsets)
    return Units(offsets, ids, "box")


@njit()
def _centroids(vertices: NDArray[Any], triangles: NDArray[Any]) -> NDArray[Any]:
    """(t, 3) float32; thirds are taken first, so that the sum cannot overflow."""
    third = np.float32(1.0 / 3.0)
    result = np.empty((len(triangles), 3), np.float32)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        for axis in range(3):
            result[t, axis] = (
                vertices[a, axis] * third + vertices[b, axis] * third + vertices[c, axis] * third
            )
    return result


@njit()
def _subdivide(points: NDArray[Any], ids: NDArray[Any], offsets: NDArray[Any]) -> None:
    """Order `ids` by box and fill in the boxes' offsets; `points` move along with their ids,
    so that memory is read in order."""
    stack = [(0, len(ids), 0, len(offsets) - 1)]
    while len(stack):
        first, end, box, boxes = stack.pop()
        if boxes == 1:
            offsets[box + 1] = end
            # By id again: neighbours in the scene's order share vertices.
            ids[first:end] = np.sort(ids[first:end])
            continue
        axis, longest = 0, np.float32(-1.0)
        for k in range(3):
            low = high = points[first, k]
            for i in range(first + 1, end):
                low, high = min(low, points[i, k]), max(high, points[i, k])
            if high - low > longest:
                axis, longest = k, high - low
        left = boxes // 2
        cut = first + (end - first) * left // boxes
        _select(points, ids, first, end, cut, axis)
        stack.append((first, cut, box, left))
        stack.append((cut, end, box + left, boxes - left))


@njit()
def _select(
    points: NDArray[Any], ids: NDArray[Any], first: int, end: int, cut: int, axis: int
) -> None:
    """Move the least `cut - first` points along an axis before `cut` (Hoare's quickselect)."""
    low, high = first, end - 1
    while low < high:
        middle = (low + high) // 2
        a, b, c = points[low, axis], points[middle, axis], points[high, axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for k in range(3):
                    points[i, k], points[j, k] = points[j, k], points[i, k]
                ids[i], ids[j] = ids[j], ids[i]
                i += 1
                j -= 1
        if cut <= j:
            high = j
        elif cut >= i:
            low = i
        else:
            return
