"""The boxes of an object's parts, which together contain it: its outer proxy.

An object is halved along the widest axis of its triangles' centroids until a part has few enough
triangles. However they are shared out, each triangle lies in its part's box.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.scene import Float64, Int32, Int64, Scene, Units

TRIANGLES_A_BOX = 12


def parts_of(scene: Scene, reduction: int) -> tuple[Units, Int64]:
    """Parts as units of triangles, and for each object the first of its parts, (n + 1,) int64.

    The boxes of an object's parts have 1 in `reduction` of its triangles, rounded up to whole
    boxes; an object without triangles has no part.
    """
    corners = scene.vertices.astype(np.float64)[scene.triangles]
    centroids = corners.mean(axis=1)
    pieces: list[Int64] = []
    first = [0]
    for start, end in zip(scene.object_offsets[:-1], scene.object_offsets[1:], strict=True):
        boxes = -(-int(end - start) // (TRIANGLES_A_BOX * reduction))
        if boxes:
            pieces += halved(np.arange(start, end), centroids, boxes)
        first.append(len(pieces))
    offsets = np.cumsum([0, *map(len, pieces)])
    triangles: Int32 = np.concatenate([np.zeros(0, np.int64), *pieces]).astype(np.int32)
    return Units(offsets, triangles, "part"), np.array(first, np.int64)


def halved(triangles: Int64, centroids: NDArray[np.float64], count: int) -> list[Int64]:
    """Triangles, (k,) ids, in `count` pieces of nearly one size, cut across the longest axis.
    `centroids`: (t, 3), of all triangles of the scene."""
    if count == 1:
        return [triangles]
    here: Float64 = centroids[triangles]
    axis = int(np.argmax(np.ptp(here, axis=0)))
    order = triangles[np.argsort(here[:, axis], kind="stable")]
    left = count // 2
    at = len(order) * left // count
    return [
        *halved(order[:at], centroids, left),
        *halved(order[at:], centroids, count - left),
    ]
