"""Cameras and the sample grid: every convention of the project, in one place.

Right-handed; a camera looks down its own -Z with +Y up. Pixels are (x, y), x to the right,
y *down*, arrays are (height, width). Matrices are named destination-from-source.

A *sample* is a pixel centre. Its ray, in float64 and in this order of operations:

    perspective    s = tan(yfov / 2) / height     ray  e + t * (F + a * R + b * U)
    orthographic   s = ymag / height              ray  e + a * R + b * U + t * F
    with           R = right * s,  U = up * s,  F = -back
                   a = 2 * (x + shift_x_px) + 1 - width
                   b = height - 2 * (y + shift_y_px) - 1

`t` is view depth. The float64 values e, F, R, U, a and b *are* the definition of the
samples: exact arithmetic takes them as exact numbers, whatever they were rounded from.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.frozen import Shared, frozen

Float64 = NDArray[np.float64]

# How far the rotation part of a camera matrix may be from orthonormal. A matrix written with
# seven significant digits is within 1e-6 of one; anything further off is scaled or sheared.
ORTHONORMAL_TOLERANCE = 1e-6

# Sample coordinates a, b must be exact in float32 too (the fast engines use them), so the
# image is at most 2**24 / 2 pixels on a side; far above any GL limit.
MAX_IMAGE_SIDE = 1 << 20
# A visibility buffer takes 12 bytes a sample: 3 GB here, and an engine needs several times that.
MAX_SAMPLES = 1 << 28

# The view of what is for all views of a frame together.
ALL_VIEWS = ""


@dataclass(frozen=True, eq=False)
class Camera(Shared):
    """One frame's view: a pose, a projection and a grid of samples.

    `world_from_camera`: (4, 4) float64, columns right, up, back, eye; orthonormal to 1e-6 and
    right-handed. `near`, `far`: view depth in world units, a hit counts where
    near <= t <= far; `far` may be infinite. Exactly one of `yfov` (vertical field of view,
    radians) and `ymag` (half the view's height, world units; orthographic) is given.
    `cut` marks a jump from the frame before, for temporal methods. `view` names the view of
    the frame that this camera is; a frame's only view need not have a name. `origin`: the point
    of the world that the pose is relative to, (3,) float64; see `relative_to`. `clip_plane`:
    (a, b, c, d), in the same space as the pose: only hits with a x + b y + c z + d >= 0 count
    (what lies before a mirror), decided like near and far; None for no such plane.

    Raises InputError where a value breaks these rules. All arrays, computed ones too, are read-only
    and cannot be made writable (`visref.frozen`), but for a camera that was `handed_out`.
    """

    world_from_camera: Float64
    width: int
    height: int
    near: float
    far: float = math.inf
    yfov: float | None = None
    ymag: float | None = None
    shift_x_px: float = 0.0
    shift_y_px: float = 0.0
    cut: bool = False
    view: str = ""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clip_plane: tuple[float, float, float, float] | None = None
    # Whether the arrays are nobody else's; see `handed_out`.
    _own: ClassVar[bool] = False

    def __post_init__(self) -> None:
        matrix = np.array(self.world_from_camera, dtype=np.float64)
        _check_pose(matrix)
        object.__setattr__(self, "world_from_camera", frozen(matrix))
        for name in ("width", "height"):
            side = getattr(self, name)
            if not 1 <= side <= MAX_IMAGE_SIDE:
                raise InputError(
                    f"the image's {name} is {side}",
                    place=name,
                    fix=f"give 1 to {MAX_IMAGE_SIDE} pixels",
                )
        if self.samples > MAX_SAMPLES:
            raise InputError(
                f"the image has {self.width} x {self.height} pixels",
                place="width",
                fix=f"give at most {MAX_SAMPLES} in all",
            )
        if (self.yfov is None) == (self.ymag is None):
            raise InputError(
                "a camera is perspective or orthographic", fix="give either 'yfov' or 'ymag'"
            )
        if self.yfov is not None and not 0.0 < self.yfov < math.pi:
            raise InputError(
                f"yfov is {self.yfov}", place="yfov", fix="give radians between 0 and pi"
            )
        if self.ymag is not None and not (0.0 < self.ymag < math.inf):
            raise InputError(f"ymag is {self.ymag}", place="ymag", fix="give a positive length")
        self._check_range()
        for name in ("shift_x_px", "shift_y_px"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"{name} is not finite", place=name, fix="give pixels")
        if self.clip_plane is not None:
            plane = tuple(map(float, self.clip_plane))
            if len(plane) != 4 or not all(map(math.isfinite, plane)) or not any(plane[:3]):
                raise InputError(
                    f"clip_plane is {list(plane)}",
                    place="clip_plane",
                    fix="give a, b, c and d, not all of a, b, c zero",
                )
            object.__setattr__(self, "clip_plane", plane)

    def _check_range(self) -> None:
        lowest = 0.0 if self.is_perspective else -math.inf
        if not lowest <= self.near < math.inf or (self.is_perspective and self.near == 0.0):
            raise InputError(
                f"near is {self.near}",
                place="near",
                fix="give a positive distance" if self.is_perspective else "give a finite one",
            )
        if math.isnan(self.far) or self.far <= self.near:
            raise InputError(
                f"near ({self.near}) is not less than far ({self.far})",
                place="far",
                fix="give near < far; far may be null for an infinite range",
            )

    def relative_to(self, origin: Float64 | tuple[float, float, float]) -> Camera:
        """The same camera, its pose relative to a point of the world, (3,) float64, by one
        subtraction in float64; itself where it is so already.

        A scene far out holds its vertices relative to an origin of its own, and so must the
        cameras that look at it: the samples are defined by the difference.
        """
        wanted = (float(origin[0]), float(origin[1]), float(origin[2]))
        if wanted == self.origin:
            return self
        matrix = self.world_from_camera.copy()
        matrix[:3, 3] = (matrix[:3, 3] + np.array(self.origin)) - np.array(wanted)
        plane = self.clip_plane
        if plane is not None:
            # n (p + o) + d, rounded once: this, like the eye, is then the definition.
            step = [wanted[i] - self.origin[i] for i in range(3)]
            d = math.fsum([plane[3], *(plane[i] * step[i] for i in range(3))])
            plane = (plane[0], plane[1], plane[2], d)
        return replace(self, world_from_camera=matrix, origin=wanted, clip_plane=plane)

    def handed_out(self) -> Camera:
        """A camera of its own for a plug-in: its arrays are copies, which it may write to as it
        likes (camera-relative coordinates in place, say)."""
        own = object.__new__(Camera)
        own.__dict__.update({f.name: getattr(self, f.name) for f in fields(self)})
        own.__dict__.update(world_from_camera=self.world_from_camera.copy(), _own=True)
        return own

    def _kept(self, array: Float64) -> Float64:
        """An array as this camera keeps it."""
        return array if self._own else frozen(array)

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        if state.get("_own"):
            self.__dict__.update(state)
        else:
            super().__setstate__(state)

    @property
    def is_perspective(self) -> bool:
        return self.yfov is not None

    @property
    def samples(self) -> int:
        """How many samples the frame has."""
        return self.width * self.height

    @cached_property
    def eye(self) -> Float64:
        """e: (3,) float64, the camera's origin in world space."""
        return self._kept(self.world_from_camera[:3, 3].copy())

    @cached_property
    def forward(self) -> Float64:
        """F: (3,) float64, the direction along which view depth grows."""
        return self._kept(-self.world_from_camera[:3, 2])

    @cached_property
    def _step(self) -> float:
        if self.yfov is not None:
            return math.tan(self.yfov / 2) / self.height
        assert self.ymag is not None
        return self.ymag / self.height

    @cached_property
    def right_step(self) -> Float64:
        """R: (3,) float64, what one unit of `a` adds to a ray (half a pixel)."""
        return self._kept(self.world_from_camera[:3, 0] * self._step)

    @cached_property
    def up_step(self) -> Float64:
        """U: (3,) float64, what one unit of `b` adds to a ray (half a pixel)."""
        return self._kept(self.world_from_camera[:3, 1] * self._step)

    @cached_property
    def half_pixel(self) -> float:
        """|R|: half the width of a pixel at view depth 1, or at any where rays are parallel."""
        return math.sqrt(self.right_step.dot(self.right_step))

    @cached_property
    def column_a(self) -> Float64:
        """a of every pixel column: (width,) float64, integers unless the lens is shifted."""
        x = np.arange(self.width, dtype=np.float64)
        return self._kept(2.0 * (x + self.shift_x_px) + 1.0 - self.width)

    @cached_property
    def row_b(self) -> Float64:
        """b of every pixel row: (height,) float64, integers unless the lens is shifted."""
        y = np.arange(self.height, dtype=np.float64)
        return self._kept(self.height - 2.0 * (y + self.shift_y_px) - 1.0)

    def ray(self, x: int, y: int) -> tuple[Float64, Float64]:
        """Origin and direction of one sample's ray, (3,) float64 each; t is view depth."""
        a, b = self.column_a[x], self.row_b[y]
        offset = a * self.right_step + b * self.up_step
        if self.is_perspective:
            return self.eye.copy(), self.forward + offset
        return self.eye + offset, self.forward.copy()

    @cached_property
    def camera_from_world(self) -> Float64:
        """(4, 4) float64. The transpose of the rotation, not a general inverse."""
        rotation = self.world_from_camera[:3, :3].T
        result = np.eye(4)
        result[:3, :3] = rotation
        result[:3, 3] = -rotation @ self.eye
        return self._kept(result)

    def clip_from_camera(self, far: float | None = None) -> Float64:
        """The OpenGL projection, (4, 4) float64: pixel centres fall on the samples.

        `far` stands in for this camera's own, so that an infinite orthographic range, which
        no depth buffer can hold, can be closed behind the last object.
        """
        far = self.far if far is None else far
        result = np.zeros((4, 4))
        result[0, 0] = 1.0 / (self._step * self.width)
        result[1, 1] = 1.0 / (self._step * self.height)
        shift = (2.0 * self.shift_x_px / self.width, -2.0 * self.shift_y_px / self.height)
        if self.is_perspective:
            result[0, 2], result[1, 2] = shift
            result[3, 2] = -1.0
            if math.isinf(far):
                result[2, 2], result[2, 3] = -1.0, -2.0 * self.near
            else:
                result[2, 2] = -(far + self.near) / (far - self.near)
                result[2, 3] = -2.0 * far * self.near / (far - self.near)
            return result
        if math.isinf(far):
            raise InputError(
                "an orthographic depth buffer needs a finite far plane",
                place="far",
                fix="give the path a finite far",
            )
        result[0, 3], result[1, 3] = -shift[0], -shift[1]
        result[2, 2] = -2.0 / (far - self.near)
        result[2, 3] = -(far + self.near) / (far - self.near)
        result[3, 3] = 1.0
        return result

    def clip_from_world(self, far: float | None = None) -> Float64:
        """(4, 4) float64: `clip_from_camera(far) @ camera_from_world`."""
        return self.clip_from_camera(far) @ self.camera_from_world

    def pixel_of(self, points: Float64) -> tuple[Float64, Float64]:
        """Where world points fall: ((n, 2) pixel coordinates, (n,) view depth), float64.

        A sample's own point has integer coordinates, so (0, 0) is the *centre* of the
        top-left pixel. Perspective coordinates mean nothing where the depth is not positive.
        """
        rotation = self.world_from_camera[:3, :3]
        local = (np.asarray(points, dtype=np.float64) - self.eye) @ rotation
        depth = -local[:, 2]
        scale = self._step * (depth if self.is_perspective else np.ones_like(depth))
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = local[:, 0] / scale, local[:, 1] / scale
        x = (a - 1.0 + self.width) / 2.0 - self.shift_x_px
        y = (self.height - 1.0 - b) / 2.0 - self.shift_y_px
        return np.stack([x, y], axis=1), depth

    def definition(self) -> dict[str, Any]:
        """The samples' definition with every float as a hexadecimal literal, for records."""

        def exact(values: Float64) -> list[str]:
            return [float(value).hex() for value in values]

        definition: dict[str, Any] = {
            "projection": "perspective" if self.is_perspective else "orthographic",
            "width": self.width,
            "height": self.height,
            "near": float(self.near).hex(),
            "far": float(self.far).hex(),
            "e": exact(self.eye),
            "F": exact(self.forward),
            "R": exact(self.right_step),
            "U": exact(self.up_step),
            "shift_x_px": float(self.shift_x_px).hex(),
            "shift_y_px": float(self.shift_y_px).hex(),
        }
        if any(self.origin):
            definition["origin"] = exact(np.array(self.origin))
        if self.clip_plane is not None:
            definition["clip_plane"] = exact(np.array(self.clip_plane))
        return definition


def _check_pose(matrix: Float64) -> None:
    place = "world_from_camera"
    if matrix.shape != (4, 4):
        raise InputError(
            f"the matrix has shape {matrix.shape}", place=place, fix="give four rows of four"
        )
    if not np.isfinite(matrix).all():
        raise InputError("the matrix is not finite", place=place, fix="give finite numbers")
    if not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        raise InputError(
            "the matrix's last row is not 0 0 0 1",
            place=place,
            fix="write row-major rows, translation in the last column",
        )
    rotation = matrix[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(rotation, axis=0)
        determinant = float(np.linalg.det(rotation / np.where(lengths > 0.0, lengths, 1.0)))
        error = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if abs(determinant) < ORTHONORMAL_TOLERANCE:
        raise InputError("the matrix is singular", place=place, fix="give a rigid transform")
    if not error <= ORTHONORMAL_TOLERANCE:  # also where huge entries overflowed to NaN
        raise InputError(
            f"the camera's axes are not orthonormal (off by {error:.3g})",
            place=place,
            fix="remove scale and shear from the matrix",
        )
    if determinant < 0.0:
        raise InputError(
            "the camera's matrix is mirrored", place=place, fix="give a right-handed rotation"
        )


def look_at(
    eye: NDArray[Any] | tuple[float, float, float],
    target: NDArray[Any] | tuple[float, float, float],
    up: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> Float64:
    """`world_from_camera` (4, 4) float64 of a camera at `eye` that looks at `target`.

    Where the view runs along `up`, another axis stands in, so that the result is rigid.
    """
    position = np.asarray(eye, dtype=np.float64)
    back = position - np.asarray(target, dtype=np.float64)
    length = float(np.linalg.norm(back))
    if length == 0.0:
        raise InputError("a camera cannot look at its own position", fix="move eye or target")
    back = back / length
    right = np.cross(np.asarray(up, dtype=np.float64), back)
    # Below this sine the cross product has lost its direction to rounding.
    if float(np.linalg.norm(right)) < 1e-9:
        right = np.cross(np.eye(3)[int(np.argmin(np.abs(back)))], back)
    right = right / np.linalg.norm(right)
    result = np.eye(4)
    result[:3, 0], result[:3, 1] = right, np.cross(back, right)
    result[:3, 2], result[:3, 3] = back, position
    return result


def __getattr__(name: str) -> Any:
    # Where programs that are not ours have imported it from so far.
    if name == "CameraPath":
        return importlib.import_module("visref.camera_path").CameraPath
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
