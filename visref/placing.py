"""Where a scene lies: its boxes, the origin that it is held relative to, and rounding once."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# A scene is held relative to an origin where its core lies further out than this many times its
# own size: nearer than that, float32 loses less than three bits to the distance.
ORIGIN_DISTANCE = 4.0


def somewhere(boxes: Float64) -> Float64:
    """Those of (n, 2, 3) boxes that hold something: no object without triangles, no absent one."""
    return boxes[boxes[:, 0, 0] <= boxes[:, 1, 0]]


def core_of(boxes: Float64) -> Float64:
    """(2, 3) float64, the box of those of (n, 2, 3) boxes that belong together: without what
    reaches more than ten times as far from the median centre, along any axis, as nine of ten do.
    Zeros where there is none."""
    if not len(boxes):
        return np.zeros((2, 3))
    centres = boxes.mean(axis=1)
    reach = np.abs(boxes - np.median(centres, axis=0)[None, None]).max(axis=(1, 2))
    limit = 10.0 * float(np.percentile(reach, 90.0, method="lower"))
    core = boxes[reach <= max(limit, float(reach.min()))]
    return np.stack([core[:, 0].min(axis=0), core[:, 1].max(axis=0)])


def origin_of(boxes: Float64) -> Float64:
    """(3,) float64: the origin for a scene of objects with these (n, 2, 3) boxes.

    Each component is zero unless the scene's core is far out along that axis; then a multiple
    of a power of two no less than the core's size, near its centre. Such a multiple is a
    multiple of the far vertices' last bits too, so that differences of float32 vertices from it
    are float32.
    """
    low, high = core_of(boxes)
    size = float((high - low).max())
    if size == 0.0 or not np.isfinite(size):
        return np.zeros(3)
    centre = low / 2.0 + high / 2.0
    # 2^ceil(log2 size), exactly.
    step = 2.0 ** int(np.frexp(size)[1])
    return np.where(np.abs(centre) > ORIGIN_DISTANCE * size, np.rint(centre / step) * step, 0.0)


def placed_boxes(meshes: Iterable[tuple[NDArray[Any], Float64]]) -> Float64:
    """(n, 2, 3) float64: boxes of meshes, (v, 3) positions each, under each of their (k, 4, 4)
    transforms: those of the transformed boxes. What is not finite is left out."""
    boxes = [np.zeros((0, 2, 3))]
    for positions, worlds in meshes:
        finite = np.isfinite(positions).all(axis=1)
        points = positions if finite.all() else positions[finite]
        if not len(points) or not len(worlds):
            continue
        low, high = (
            corner.astype(np.float64) for corner in (points.min(axis=0), points.max(axis=0))
        )
        placed = np.empty((len(worlds), 2, 3))
        for axis in range(3):
            # Rounded sums do not decrease where a term grows: the least of each makes the least.
            ends = worlds[:, axis, :3] * low, worlds[:, axis, :3] * high
            for side, terms in enumerate((np.minimum(*ends), np.maximum(*ends))):
                placed[:, side, axis] = (terms[:, 0] + terms[:, 1]) + (
                    terms[:, 2] + worlds[:, axis, 3]
                )
        boxes.append(placed[np.isfinite(placed).all(axis=(1, 2))])
    return np.concatenate(boxes)


def rounded(exact: Float64) -> tuple[Float32, Float32]:
    """Vertices, (v, 3) or (…, 3) float64, as float32, and how far that moved each, (v,) or (…,)
    float32, rounded up."""
    # What is not finite stays so, and is refused by whoever makes a scene of it.
    with np.errstate(invalid="ignore", over="ignore"):
        vertices = exact.astype(np.float32)
        moved = np.sqrt(((exact - vertices) ** 2).sum(axis=-1))
    # Outward: the least float32 that is greater, but for vertices that did not move at all.
    up = np.nextafter(moved.astype(np.float32), np.float32(np.inf))
    return vertices, np.where(moved > 0.0, up, np.float32(0.0))
