"""The view through another lens: shift, field of view, aspect and roll got wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.causes.boxes import Boxes, beyond
from visref.causes.sights import At, Tell, Told
from visref.scene import Float64

Bool = NDArray[np.bool_]


def lens(change: Callable[[Camera], Camera | None]) -> Tell:
    """The frustum of another camera, all corners beyond one plane of it."""

    def tell(at: At) -> Told:
        camera = change(at.camera)
        if camera is None:
            return None
        boxes = at.now.boxes(at.ids, camera)
        return boxes.in_view | ~boxes.there

    return tell


def shift(x: float, y: float) -> Callable[[Camera], Camera | None]:
    def change(camera: Camera) -> Camera | None:
        wanted = (camera.shift_x_px * x, camera.shift_y_px * y)
        if wanted == (camera.shift_x_px, camera.shift_y_px):
            return None
        return replace(camera, shift_x_px=wanted[0], shift_y_px=wanted[1])

    return change


@dataclass(frozen=True, eq=False)
class Extent(Boxes):
    """Boxes before a frustum of its own half width and height at depth 1 (or of an orthographic
    view), about the same axes."""

    half: tuple[float, float]
    perspective: bool

    def beyond(self, local: Float64) -> Bool:
        camera, (width, height) = self.camera, self.half
        step = camera.half_pixel
        aside, up = 2.0 * camera.shift_x_px * step, -2.0 * camera.shift_y_px * step
        sides = aside - width, aside + width, up - height, up + height
        return beyond(camera, local, sides, self.perspective)


def extent(at: At, half: tuple[float, float], perspective: bool) -> Told:
    boxes = Extent(at.camera, at.boxes.boxes, half, perspective)
    return boxes.in_view | ~boxes.there


def halves(camera: Camera) -> tuple[float, float]:
    step = camera.half_pixel
    return step * camera.width, step * camera.height


def other_extent(change: Callable[[float, float], tuple[float, float]]) -> Tell:
    def tell(at: At) -> Told:
        w, h = halves(at.camera)
        if math.isclose(w, h):
            return None
        return extent(at, change(w, h), at.camera.is_perspective)

    return tell


def scaled_extent(factor: float, *, perspective: bool | None = None) -> Tell:
    def tell(at: At) -> Told:
        if perspective is not None and perspective != at.camera.is_perspective:
            return None
        w, h = halves(at.camera)
        return extent(at, (factor * w, factor * h), at.camera.is_perspective)

    return tell


def wide_as_pyramid(at: At) -> Told:
    """An orthographic view as a pyramid of 45 degrees."""
    camera = at.camera
    if camera.is_perspective:
        return None
    half = math.tan(math.pi / 8)
    return extent(at, (half * camera.width / camera.height, half), True)


def ninety(at: At) -> Told:
    if at.camera.is_perspective:
        return None
    return extent(at, (at.camera.width / at.camera.height, 1.0), True)


def radians_as_degrees(at: At) -> Told:
    camera = at.camera
    if camera.yfov is None:
        return None
    half = math.tan(min(math.radians(math.radians(math.degrees(camera.yfov))), 3.0) / 2)
    return extent(at, (half * camera.width / camera.height, half), True)


def first_lens(at: At) -> Told:
    first = at.then(at.sights.moments.frames[0])
    if first is None or first.camera.is_perspective != at.camera.is_perspective:
        return None
    if np.allclose(halves(first.camera), halves(at.camera)):
        return None
    return extent(at, halves(first.camera), at.camera.is_perspective)


def first_viewport(at: At) -> Told:
    first = at.then(at.sights.moments.frames[0])
    if first is None:
        return None
    was, camera = first.camera, at.camera
    if was.width * camera.height == was.height * camera.width:
        return None
    _, h = halves(camera)
    return extent(at, (h * was.width / was.height, h), camera.is_perspective)


def rolled(camera: Camera) -> Camera | None:
    """The same view, upright."""
    back = camera.world_from_camera[:3, 2]
    right = np.cross([0.0, 1.0, 0.0], back)
    if np.linalg.norm(right) < 1e-9:
        return None
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    if np.allclose(up, camera.world_from_camera[:3, 1], atol=1e-6):
        return None
    pose = camera.world_from_camera.copy()
    pose[:3, 0], pose[:3, 1] = right, up
    return replace(camera, world_from_camera=pose)
