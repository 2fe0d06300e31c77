"""Boxes as a camera sees them: what every frustum or rectangle test starts from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.scene import Float64, Int32

Bool = NDArray[np.bool_]


def every(flags: Bool, axis: int | tuple[int, ...]) -> Bool:
    """Whether all are set, along an axis."""
    return np.asarray(flags.all(axis=axis))


def some(flags: Bool, axis: int | tuple[int, ...]) -> Bool:
    """Whether any is set, along an axis."""
    return np.asarray(flags.any(axis=axis))


_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


@dataclass(frozen=True, eq=False)
class Boxes:
    """(k, 2, 3) float64 boxes, least and greatest corner, before a camera in the same space. A box
    of infinities, of what is not there, lies nowhere."""

    camera: Camera
    boxes: Float64

    @cached_property
    def there(self) -> Bool:
        return every(np.isfinite(self.boxes), (1, 2))

    @cached_property
    def corners(self) -> Float64:
        """(k, 8, 3) in the world."""
        boxes = np.where(self.there[:, None, None], self.boxes, 0.0)
        found: Float64 = boxes[:, _CORNERS, np.arange(3)]
        return found

    def local(self, points: Float64) -> Float64:
        """(…, 3): to the right, up, and view depth."""
        axes = self.camera.world_from_camera[:3, :3] * np.array([1.0, 1.0, -1.0])
        found: Float64 = (points - self.camera.eye) @ axes
        return found

    @cached_property
    def seen_from(self) -> Float64:
        return self.local(self.corners)

    @cached_property
    def centres(self) -> Float64:
        """(k, 3) local coordinates of the boxes' centres."""
        return self.local(self.corners.mean(axis=1))

    def beyond(self, local: Float64) -> Bool:
        """(…, 6) bool: beyond the left, right, bottom, top, near and far plane."""
        return beyond(self.camera, local, edges(self.camera), self.camera.is_perspective)

    @cached_property
    def planes(self) -> Bool:
        """(k, 8, 6) bool, each corner against each plane."""
        return self.beyond(self.seen_from)

    @cached_property
    def in_view(self) -> Bool:
        """(k,) bool: no plane has all corners beyond it."""
        return ~some(every(self.planes, 1), 1) & self.there

    @cached_property
    def depths(self) -> Float64:
        """(k, 8) view depths of the corners."""
        return np.asarray(self.seen_from[..., 2])

    @cached_property
    def nearest(self) -> Float64:
        return np.asarray(self.depths.min(axis=1))

    @cached_property
    def crossing(self) -> Bool:
        """(k,) bool: has a corner before the near plane."""
        found: Bool = self.nearest <= self.camera.near
        return found if self.camera.is_perspective else np.zeros_like(found)

    @cached_property
    def closest(self) -> Float64:
        """(k, 3) in the world: the point of each box that is nearest to the eye, straight."""
        boxes = np.where(self.there[:, None, None], self.boxes, 0.0)
        return np.clip(self.camera.eye, boxes[:, 0], boxes[:, 1])

    def pixels(self, local: Float64) -> Float64:
        """(…, 2) pixel coordinates, whole numbers at samples."""
        camera = self.camera
        depth = local[..., 2] if camera.is_perspective else np.ones(local.shape[:-1])
        scale = camera.half_pixel * depth
        with np.errstate(divide="ignore", invalid="ignore"):
            found: Float64 = local[..., :2] / scale[..., None]
        found[..., 0] = (found[..., 0] - camera.column_a[0]) / 2.0
        found[..., 1] = (camera.row_b[0] - found[..., 1]) / 2.0
        return found

    @cached_property
    def spans(self) -> Float64:
        """(k, 4) float64: x0, y0, x1, y1 in pixels, finite; they say something of boxes that cross
        no near plane."""
        return finite(span(self.pixels(self.seen_from)))

    @cached_property
    def rectangles(self) -> Int32:
        """(k, 4) int32, the samples that a box may touch, outward, within the image."""
        return within(self.camera, self.spans)


def span(pixels: Float64) -> Float64:
    """(k, 4) float64 x0, y0, x1, y1 about (k, m, 2) pixel coordinates."""
    return np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=1)


def within(camera: Camera, spans: Float64, *, texel: int = 1, inward: bool = False) -> Int32:
    """(k, 4) int32 texels of `texel` samples a side that spans touch (or, `inward`, hold), clipped
    to the image; empty where x1 < x0."""
    width, height = -(-camera.width // texel), -(-camera.height // texel)
    spans = finite(spans)
    low, high = spans[:, :2] - 1e-6, spans[:, 2:] + 1e-6
    # A sample stands for the pixel about it, half a pixel each way.
    if inward:
        first, last = np.ceil((low + 0.5) / texel), np.floor((high + 0.5) / texel) - 1
    else:
        first, last = np.floor(low) // texel, np.ceil(high) // texel
    found = np.empty((len(spans), 4), np.int32)
    found[:, :2] = np.minimum(np.maximum(first, 0), (width, height))
    found[:, 2:] = np.minimum(np.maximum(last, -1), (width - 1, height - 1))
    return found


Edges = tuple[float, float, float, float]


def edges(camera: Camera) -> Edges:
    """The image's left, right, bottom and top edge, half a pixel beyond the outermost samples, at
    view depth 1 (at any, where rays are parallel)."""
    step = camera.half_pixel
    left, right = (camera.column_a[0] - 1.0) * step, (camera.column_a[-1] + 1.0) * step
    top, bottom = (camera.row_b[0] + 1.0) * step, (camera.row_b[-1] - 1.0) * step
    return left, right, bottom, top


def beyond(camera: Camera, local: Float64, edges: Edges, perspective: bool) -> Bool:
    """(…, 6) bool: which points, (…, 3) local coordinates, lie beyond the left, right, bottom, top,
    near and far plane, of a view that has these edges."""
    left, right, bottom, top = edges
    x, y, z = local[..., 0], local[..., 1], local[..., 2]
    scale = z if perspective else np.ones_like(z)
    found = np.empty((*z.shape, 6), np.bool_)
    np.less(x, left * scale, out=found[..., 0])
    np.greater(x, right * scale, out=found[..., 1])
    np.less(y, bottom * scale, out=found[..., 2])
    np.greater(y, top * scale, out=found[..., 3])
    np.less(z, camera.near, out=found[..., 4])
    np.greater(z, camera.far, out=found[..., 5])
    return found


def finite(spans: Float64) -> Float64:
    """Far beyond the image is as good as infinity, and no arithmetic's trouble; what is no number
    is in the middle of nowhere, 0."""
    known = np.where(np.isnan(spans), 0.0, spans)
    return np.minimum(np.maximum(known, -1e9), 1e9)


def half_angle(camera: Camera) -> float:
    """tan(yfov / 2), or half the height."""
    return camera.half_pixel * camera.height


def finite_far(camera: Camera, else_: float) -> float:
    return camera.far if math.isfinite(camera.far) else else_
