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
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from visref.camera import Camera
from visref.culler import RasterTolerance
from visref.errors import InputError
from visref.scene import Float32, Float64, Scene

FLOAT32_UNIT = 2.0**-24

# Float32's normal exponents, -126 to 127, less 24 bits on either side: what a driver flushes to
# zero then is no more than a rounding, and no product of a clip coordinate overflows.
LEAST_LENGTH, GREATEST_LENGTH = 2.0**-102, 2.0**103

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


@dataclass(frozen=True, eq=False)
class View:
    """One camera, ready for the rasteriser. `far` is the camera's, closed behind the scene
    where an orthographic range is infinite."""

    camera: Camera
    far: float
    subpixel_bits: int

    @classmethod
    def of(cls, camera: Camera, scene: Scene, subpixel_bits: int) -> View:
        """Raises InputError where lengths do not fit float32's exponents."""
        _check_lengths(camera, scene)
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
        """(3,) float32, world units: what `eye_high` leaves of the eye."""
        return (self.camera.eye - self.eye_high.astype(np.float64)).astype(np.float32)

    @cached_property
    def depth_row(self) -> Float64:
        """(3,) float64: view depth is this row times a vector from the eye."""
        row: Float64 = -self.camera_from_relative[2]
        return row

    @cached_property
    def planes(self) -> Float64:
        """(5 to 7, 4) float64: a point p relative to the eye is in the view where
        row[:3] @ p + row[3] >= 0 for every row. The pixels' outer edges, not their centres; near,
        far where it is finite, and the clip plane, where there is one, last."""
        clip = self.clip_from_relative
        rows = [clip[3] + clip[0], clip[3] - clip[0], clip[3] + clip[1], clip[3] - clip[1]]
        rows.append(np.append(self.depth_row, -self.camera.near))
        if math.isfinite(self.far):
            rows.append(np.append(-self.depth_row, self.far))
        if self.is_cut:
            plane, error = self._clip_plane
            rows.append(plane + np.array([0.0, 0.0, 0.0, error]))
        return np.stack(rows)

    @cached_property
    def _clip_plane(self) -> tuple[Float64, float]:
        """(4,) float64: the camera's clip plane for a vector from the eye, its normal of length 1;
        and by how much the fourth number may err. (What the normal errs by is relative to the
        vector, and far less than what boxes are inflated by.)"""
        given = np.array(self.camera.clip_plane)
        # By a power of two first: no square leaves the range.
        plane = np.ldexp(given, -np.frexp(np.abs(given[:3]).max())[1])
        plane /= float(np.linalg.norm(plane[:3]))
        eye = self.camera.eye
        # 4 units of 2**-53 for each quotient, 2 for products and 3 for sums: under 2**-49.
        error = 2.0**-49 * float(np.abs(plane[:3]) @ np.abs(eye) + abs(plane[3]))
        plane[3] += plane[:3] @ eye
        return plane, error

    @cached_property
    def clip_plane(self) -> Float64 | None:
        """(4,) float64: where this row times (p, 1), for p relative to the eye, is positive, p is
        for certain on the side of the camera's clip plane that counts; None without one."""
        if self.camera.clip_plane is None:
            return None
        plane, error = self._clip_plane
        inner: Float64 = plane - np.array([0.0, 0.0, 0.0, error])
        return inner

    @property
    def is_cut(self) -> bool:
        """Whether draws of the scene are cut by a clip plane: `State.cut`."""
        return self.camera.clip_plane is not None

    @cached_property
    def pixel(self) -> float:
        """Width of a pixel in world units: at unit depth for a perspective view."""
        return 2.0 * self.camera.half_pixel

    @cached_property
    def _window_error_px(self) -> float:
        snap = math.sqrt(0.5) * 2.0**-self.subpixel_bits
        side = max(self.camera.width, self.camera.height)
        return snap + WINDOW_ROUNDINGS * FLOAT32_UNIT * side

    @property
    def window_error(self) -> float:
        """By how much snapping and the window's roundings move a vertex: world units, in a
        perspective view for each unit of depth."""
        return self._window_error_px * self.pixel

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
        transform_px = TRANSFORM_ROUNDINGS * FLOAT32_UNIT * distance / self.pixel
        return RasterTolerance(
            snap_px=self._window_error_px + transform_px,
            depth_bits=None if depth_bits == 32 else depth_bits,
        )

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


def _check_lengths(camera: Camera, scene: Scene) -> None:
    """Raise InputError where GL would flush or overflow lengths, without a word."""
    away = float(np.abs(scene.bounds - camera.eye).max())
    greatest = max(away, float(np.abs(camera.eye).max()), float(np.abs(scene.bounds).max()))
    pixel = 2.0 * camera.half_pixel
    least = pixel * away if camera.is_perspective else pixel
    # An empty scene has nothing to draw.
    if away > 0.0 and not (greatest < GREATEST_LENGTH and least > LEAST_LENGTH):
        raise InputError(
            f"lengths from {least:.3g} (a pixel) to {greatest:.3g} (the scene, seen from the eye) "
            f"are beyond the float32 of OpenGL",
            source=scene.source,
            fix=f"scale scene and path to within {LEAST_LENGTH:.0e} and {GREATEST_LENGTH:.0e}",
        )
