"""A camera as the rasteriser sees it: matrices relative to the eye, and how far GL may err.

Everything the GPU gets is relative to the eye, because `vertex - eye` in float32 errs by a part
of the *difference* while a transform from world space errs by a part of the distance to the
world's origin.

How far a vertex may land from where it belongs, in three parts:

1. The window position is snapped to a grid of 2**-subpixel_bits pixels: by half a step in each
   axis, so by sqrt(2) / 2 steps.
2. The division by w, the viewport transform and the plane equations of depth round float32
   numbers up to the image's side; each rounding is at most 2**-24 of it.
3. Before that, subtracting the eye, the matrix's entries, the products and the sums round: a
   displacement in space by a part of the distance from the eye.

A box that must cover its geometry after rounding moves too, so it is inflated by twice that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import RasterTolerance
from visref.scene import Float32, Float64, Scene

FLOAT32_UNIT = 2.0**-24

# Part 2: the division (2 roundings, of numbers up to half the side), the viewport's product and
# sum (2), and the three products and sums of a plane equation over the image.
WINDOW_ROUNDINGS = 7

# Part 3: per component of the position two subtractions, one rounding of each matrix entry, one
# of each product, three of the sums, so 7 units of the sum of |entry * component|, which is at
# most sqrt(3) times the distance from the eye.
TRANSFORM_ROUNDINGS = 7 * math.sqrt(3.0)

# Depth as stored, in units of 2**-24 of the window's range: dividing z by w (2 roundings in
# NDC, so 1 in the window's half range), the viewport's product and sum (2), the plane's last
# sum (1), and the rounding to a fixed-point step (1/2); the plane's slope is part 2.
DEPTH_STEPS = 5

# Clipping at the side planes: per plane the two distances to it (2 roundings of up to twice the
# larger coordinate M), their quotient, the difference, product and sum of the new position come
# to 14 units of M in x and as much in w; a corner of the image is made by two planes: 56.
CLIP_ROUNDINGS = 64
# A polygon over the whole image that is clipped short by less than this still covers the
# samples at its rim.
RIM_PX = 0.5

# Coordinates farther from the eye than this would overflow float32 when the shader multiplies
# them by a matrix entry; what reaches there is drawn without asking.
FARTHEST_QUERY = 1e30

# World coordinates are exact in float64; subtracting the eye rounds by 2**-53 of the larger.
FLOAT64_UNIT = 2.0**-53


@dataclass(frozen=True, eq=False)
class View:
    """One camera, ready for the rasteriser. `far` is the camera's, closed behind the scene
    where an orthographic range is infinite."""

    camera: Camera
    far: float
    subpixel_bits: int

    @classmethod
    def of(cls, camera: Camera, scene: Scene, subpixel_bits: int) -> View:
        far = camera.far
        if not camera.is_perspective and math.isinf(far):
            corners = scene.bounds - camera.eye
            deepest = np.where(camera.forward > 0.0, corners[1], corners[0]) @ camera.forward
            extent = float(deepest) - camera.near
            # Outward by a thousandth: too far a plane only costs depth resolution.
            far = camera.near + (1.001 * extent if extent > 0.0 else 1.0)
        return cls(camera, far, subpixel_bits)

    @cached_property
    def camera_from_relative(self) -> Float64:
        """(3, 3) float64: right, up, back of a vector from the eye. The samples' definition
        takes the camera's axes as given, so this is their inverse, not their transpose."""
        axes = self.camera.world_from_camera[:3, :3]
        return np.asarray(np.linalg.inv(axes), np.float64)

    @cached_property
    def clip_from_relative(self) -> Float64:
        """(4, 4) float64: OpenGL clip space from a position relative to the eye."""
        camera_from_relative = np.eye(4)
        camera_from_relative[:3, :3] = self.camera_from_relative
        result: Float64 = self.camera.clip_from_camera(self.far) @ camera_from_relative
        return result

    @cached_property
    def clip_from_relative_bytes(self) -> bytes:
        """The same in float32, in GLSL's column order."""
        return self.clip_from_relative.T.astype(np.float32).tobytes()

    @cached_property
    def eye_high(self) -> Float32:
        """(3,) float32, the eye rounded; `eye_low` is what that leaves."""
        return self.camera.eye.astype(np.float32)

    @cached_property
    def eye_low(self) -> Float32:
        return (self.camera.eye - self.eye_high.astype(np.float64)).astype(np.float32)

    @cached_property
    def depth_row(self) -> Float64:
        """(3,) float64: view depth is this row times a vector from the eye."""
        row: Float64 = -self.camera_from_relative[2]
        return row

    @cached_property
    def planes(self) -> Float64:
        """(5 or 6, 4) float64: a point p relative to the eye is in the view where
        row[:3] @ p + row[3] >= 0 for every row. The pixels' outer edges, not their centres."""
        clip = self.clip_from_relative
        rows = [clip[3] + clip[0], clip[3] - clip[0], clip[3] + clip[1], clip[3] - clip[1]]
        rows.append(np.append(self.depth_row, -self.camera.near))
        if math.isfinite(self.far):
            rows.append(np.append(-self.depth_row, self.far))
        return np.stack(rows)

    @cached_property
    def _pixel(self) -> float:
        """Width of a pixel in world units: at unit depth for a perspective view."""
        return 2.0 * float(np.linalg.norm(self.camera.right_step))

    @cached_property
    def _window_error_px(self) -> float:
        snap = math.sqrt(0.5) * 2.0**-self.subpixel_bits
        side = max(self.camera.width, self.camera.height)
        return snap + WINDOW_ROUNDINGS * FLOAT32_UNIT * side

    @property
    def window_error(self) -> float:
        """By how much snapping and the window's roundings move a vertex: world units, in a
        perspective view for each unit of depth."""
        return self._window_error_px * self._pixel

    @cached_property
    def depth_shift_ndc(self) -> float:
        """By how much a query box is moved towards the eye, in NDC depth: the geometry's
        error and its own. The window's range is half of NDC's."""
        return 2.0 * 2.0 * DEPTH_STEPS * FLOAT32_UNIT

    def tolerance(self, depth_bits: int) -> RasterTolerance:
        """What this rasteriser declares for this camera. At the screen's corner a distance
        is the longest for its depth, so its float32 error in pixels is the greatest there."""
        camera = self.camera
        aside = math.hypot(
            float(np.abs(camera.column_a).max() * np.linalg.norm(camera.right_step)),
            float(np.abs(camera.row_b).max() * np.linalg.norm(camera.up_step)),
        )
        distance = math.hypot(1.0 if camera.is_perspective else self.far, aside)
        transform_px = TRANSFORM_ROUNDINGS * FLOAT32_UNIT * distance / self._pixel
        return RasterTolerance(
            snap_px=self._window_error_px + transform_px,
            depth_bits=None if depth_bits == 32 else depth_bits,
        )

    @cached_property
    def growth(self) -> tuple[float, float, float]:
        """By how much boxes are inflated: a part of their distance from the eye, a part of a
        pixel there (of that distance too in a perspective view), a part of their coordinates."""
        return (
            2.0 * TRANSFORM_ROUNDINGS * FLOAT32_UNIT,
            2.0 * self._window_error_px * self._pixel,
            4.0 * FLOAT64_UNIT,
        )

    def inflated(self, bounds: Float64) -> Float64:
        """World boxes (k, 2, 3) -> boxes relative to the eye, float64, that cover their
        geometry however GL rounds it and them. Outward: too large a box only draws too much.
        """
        eye = self.camera.eye
        relative: Float64 = bounds - eye
        reach = np.linalg.norm(np.maximum(np.abs(relative[:, 0]), np.abs(relative[:, 1])), axis=1)
        part, pixel, rounding = self.growth
        grow = part * reach + (pixel * reach if self.camera.is_perspective else pixel)
        grow += rounding * (np.abs(bounds).max(axis=(1, 2)) + np.abs(eye).max())
        relative[:, 0] -= grow[:, None]
        relative[:, 1] += grow[:, None]
        return relative

    def nearest_depth(self, relative: Float64) -> Float64:
        """(k,) float64: the least view depth of boxes relative to the eye, over all corners
        (a linear function's least value over a box takes one bound in each axis)."""
        row = self.depth_row
        nearest: Float64 = np.where(row > 0.0, relative[:, 0], relative[:, 1]) @ row
        return nearest

    def window_depth(self, nearest: Float64) -> Float64:
        """(k,) float64: view depths beyond the near plane as a depth buffer holds them, in
        [0, 1], moved towards the eye by what stored geometry and this number may err
        (`depth_shift_ndc` holds both). Nearer only draws too much."""
        clip = self.camera.clip_from_camera(self.far)
        ndc = -clip[2, 2] * nearest + clip[2, 3]
        if self.camera.is_perspective:
            ndc /= nearest
        window: Float64 = np.clip(0.5 * (ndc - self.depth_shift_ndc) + 0.5, 0.0, 1.0)
        return window

    def meets_frustum(self, relative: Float64) -> NDArray[np.bool_]:
        """(k,) bool, False only where a box relative to the eye lies wholly outside one of
        the view's planes. Outward: a box near an edge of the frustum may be kept in vain."""
        result = np.ones(len(relative), np.bool_)
        for plane in self.planes:
            farthest = np.where(plane[:3] > 0.0, relative[:, 1], relative[:, 0])
            result &= farthest @ plane[:3] + plane[3] >= 0.0
        return result

    def needs_no_query(self, relative: Float64) -> NDArray[np.bool_]:
        """(k,) bool, True where a box holds the eye, crosses the near plane, is too far away
        for float32, or reaches so far beside the image that clipping it may lose samples at
        the rim: visible without asking, since GL cannot draw such a box whole."""
        nearest = self.nearest_depth(relative)
        result: NDArray[np.bool_] = nearest <= self.camera.near
        result |= np.abs(relative).max(axis=(1, 2)) > FARTHEST_QUERY
        result |= self._clipping_error_px(relative, nearest) >= RIM_PX
        return result

    def _clipping_error_px(self, relative: Float64, nearest: Float64) -> Float64:
        """(k,) float64: by how much clipping may move a box's corners on the image's rim."""
        half_side = 0.5 * max(self.camera.width, self.camera.height)
        axes = self.camera_from_relative
        # The greatest of each coordinate over a box, then of them all, in pixels times w.
        pick = axes[:, None, :] > 0.0
        low, high = relative[None, :, 0], relative[None, :, 1]
        most = np.sum(axes[:, None, :] * np.where(pick, high, low), axis=2)
        least = np.sum(axes[:, None, :] * np.where(pick, low, high), axis=2)
        sizes = np.maximum(np.abs(most), np.abs(least))
        aside = sizes[:2].max(axis=0) / self._pixel
        if self.camera.is_perspective:
            largest = np.maximum(aside, sizes[2] * half_side)
            largest /= np.maximum(nearest, self.camera.near)
        else:
            largest = np.maximum(aside, half_side)
        error: Float64 = CLIP_ROUNDINGS * FLOAT32_UNIT * largest
        return error


def round_outward(relative: Float64) -> Float32:
    """Boxes (k, 2, 3) in float32, none smaller than given."""
    result = relative.astype(np.float32)
    low, high = result[:, 0], result[:, 1]
    np.copyto(low, np.nextafter(low, np.float32(-np.inf)), where=low > relative[:, 0])
    np.copyto(high, np.nextafter(high, np.float32(np.inf)), where=high < relative[:, 1])
    return result
