"""Samples beyond an image's edges, and how far objects reach there."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import MAX_IMAGE_SIDE, Camera
from visref.compiled import njit
from visref.exact.filters import PROJECT, View, view_of
from visref.scene import Float64, Int32, Int64, Scene

Bool = NDArray[np.bool_]
# An image that takes more samples than this is not made.
MOST_SAMPLES = 1 << 30
# What a vertex's place may be off by, in pixels, beside the rounding of its projection: that of a
# and b to pixels (`PIXEL_SLACK`), and the pixel that floor and ceil may cut off.
_SPARE_PX = 1.0
# The columns of what `_reaches` finds: the least view depth, less its error, and plus it; the first
# and last column and row, outward, in pixels.
LEAST, LEAST_PLUS, X0, X1, Y0, Y1 = range(6)


@dataclass(frozen=True, eq=False)
class Window:
    """A rectangle of a camera's grid of samples, which goes on beyond the image: `visref.exact`'s
    `Samples`. Its column 0 is the camera's column `x0`, its row 0 the camera's row `y0`; a sample
    in both has the same ray, to the last bit."""

    camera: Camera
    x0: int
    y0: int
    width: int
    height: int

    @classmethod
    def of_image(cls, camera: Camera) -> Window:
        return cls(camera, 0, 0, camera.width, camera.height)

    @property
    def is_perspective(self) -> bool:
        return self.camera.is_perspective

    @property
    def eye(self) -> Float64:
        return self.camera.eye

    @property
    def forward(self) -> Float64:
        return self.camera.forward

    @property
    def right_step(self) -> Float64:
        return self.camera.right_step

    @property
    def up_step(self) -> Float64:
        return self.camera.up_step

    @property
    def near(self) -> float:
        return self.camera.near

    @property
    def far(self) -> float:
        return self.camera.far

    @property
    def clip_plane(self) -> tuple[float, float, float, float] | None:
        return self.camera.clip_plane

    @property
    def shift_x_px(self) -> float:
        # a = 2 (x + shift) + 1 - width, of the window's own x and width. Nothing but screen boxes,
        # which are outward, depends on its rounding.
        return self.camera.shift_x_px + self.x0 + (self.width - self.camera.width) / 2

    @property
    def shift_y_px(self) -> float:
        return self.camera.shift_y_px + self.y0 + (self.height - self.camera.height) / 2

    @cached_property
    def column_a(self) -> Float64:
        # As `Camera.column_a`, in its order of operations.
        x = np.arange(self.x0, self.x0 + self.width, dtype=np.float64)
        a: Float64 = 2.0 * (x + self.camera.shift_x_px) + 1.0 - self.camera.width
        return a

    @cached_property
    def row_b(self) -> Float64:
        y = np.arange(self.y0, self.y0 + self.height, dtype=np.float64)
        b: Float64 = self.camera.height - 2.0 * (y + self.camera.shift_y_px) - 1.0
        return b


@dataclass(frozen=True, eq=False)
class Reach:
    """How far objects reach, (n,) arrays: `behind` bool, a vertex of it is nearer than near;
    `whole` bool, its silhouette lies in the image for certain; `boxes` (n, 4) int64, first and last
    column and row of an image that holds all of it, `fits` bool, whether there can be such an
    image: not where a vertex is nearer than near, nor where it would be too large."""

    behind: Bool
    whole: Bool
    boxes: Int64
    fits: Bool


def reach_of(scene: Scene, camera: Camera, objects: Int64) -> Reach:
    """How far some objects, (k,) ids, reach beyond the image: arrays over all objects, right of
    those. The camera is relative to the scene's origin."""
    view = view_of(camera)
    found = np.zeros((scene.object_count, 6))
    _reaches(
        scene.vertices, scene.triangles, scene.object_offsets, objects, view,
        0.5 * (camera.width - 1) - camera.shift_x_px,
        0.5 * (camera.height - 1) - camera.shift_y_px,
        found,
    )  # fmt: skip
    behind = found[:, LEAST_PLUS] < camera.near
    for each in objects[~behind[objects] & (found[objects, LEAST] < camera.near)]:
        behind[each] = _exactly_behind(scene, camera, int(each))
    low, high = found[:, [X0, Y0]], found[:, [X1, Y1]]
    size = np.array([camera.width, camera.height])
    whole = ~behind & (low >= 0).all(axis=1) & (high <= size - 1).all(axis=1)
    limit = float(MAX_IMAGE_SIDE)
    # Not where a place is no number, nor of an object without triangles.
    fits = ~behind & (low <= high).all(axis=1)
    fits &= (low > -limit).all(axis=1) & (high < limit).all(axis=1)
    boxes = np.zeros((len(found), 4), np.int64)
    boxes[fits] = np.stack([low[fits, 0], high[fits, 0], low[fits, 1], high[fits, 1]], axis=1)
    sides = boxes[:, 1::2] - boxes[:, ::2] + 1
    fits &= (sides <= MAX_IMAGE_SIDE).all(axis=1) & (sides.prod(axis=1) <= MOST_SAMPLES)
    return Reach(behind, whole, boxes, fits)


def _exactly_behind(scene: Scene, camera: Camera, object_id: int) -> bool:
    """Whether a vertex of an object is nearer than near, in exact arithmetic: with w = v - e and
    w = aR + bU + tF, t is the ratio of the determinants of (R, U, w) and (R, U, F)."""
    first, last = scene.object_offsets[object_id : object_id + 2]
    vertices = scene.vertices[np.unique(scene.triangles[first:last])]
    eye, forward, right, up = (
        [Fraction(float(x)) for x in v]
        for v in (camera.eye, camera.forward, camera.right_step, camera.up_step)
    )
    normal = [right[i - 2] * up[i - 1] - right[i - 1] * up[i - 2] for i in range(3)]
    along = sum((normal[i] * forward[i] for i in range(3)), Fraction(0))
    limit = Fraction(float(camera.near)) * abs(along)
    sign = 1 if along > 0 else -1

    def depth(vertex: NDArray[np.float32]) -> Fraction:
        away = [Fraction(float(vertex[i])) - eye[i] for i in range(3)]
        return sign * sum((normal[i] * away[i] for i in range(3)), Fraction(0))

    return any(depth(vertex) < limit for vertex in vertices)


@njit(error_model="numpy")
def _reaches(
    vertices: NDArray[Any],
    triangles: Int32,
    offsets: Int64,
    objects: Int64,
    view: View,
    middle_x: float,
    middle_y: float,
    found: Float64,
) -> None:
    """Of each object, the columns LEAST to Y1 into its row of `found`; all bounds are outward."""
    for o in objects:
        least, least_plus = np.inf, np.inf
        x_low, x_high, y_low, y_high = np.inf, -np.inf, np.inf, -np.inf
        for t in range(offsets[o], offsets[o + 1]):
            for corner in range(3):
                v = triangles[t, corner]
                x, y, z, size = 0.0, 0.0, 0.0, 0.0
                for k in range(3):
                    w = np.float64(vertices[v, k]) - view.e[k]
                    size = max(size, abs(w))
                    x += view.x_dual[k] * w
                    y += view.y_dual[k] * w
                    z += view.z_dual[k] * w
                z_error = PROJECT * view.z_norm * size
                least, least_plus = min(least, z - z_error), min(least_plus, z + z_error)
                x_error, y_error = PROJECT * view.x_norm * size, PROJECT * view.y_norm * size
                if view.perspective:
                    # Where the vertex may be at the eye nothing is known, and said.
                    inverse = 1.0 / z if z > 2.0 * z_error else np.inf
                    x, y = x * inverse, y * inverse
                    # The quotient's relative error is twice its depth's, and its own is below that.
                    x_error = 2.0 * (x_error + 2.0 * abs(x) * z_error) * inverse
                    y_error = 2.0 * (y_error + 2.0 * abs(y) * z_error) * inverse
                x_error, y_error = x_error + _SPARE_PX, y_error + _SPARE_PX
                px, py = 0.5 * x + middle_x, middle_y - 0.5 * y
                x_low, x_high = min(x_low, px - x_error), max(x_high, px + x_error)
                y_low, y_high = min(y_low, py - y_error), max(y_high, py + y_error)
        found[o, LEAST], found[o, LEAST_PLUS] = least, least_plus
        found[o, X0], found[o, X1] = np.floor(x_low), np.ceil(x_high)
        found[o, Y0], found[o, Y1] = np.floor(y_low), np.ceil(y_high)
