"""Cameras, camera paths and the sample grid: every convention of the project, in one place.

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

import math
import reprlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.reading import map_file, parse_json

Float64 = NDArray[np.float64]

PATH_FORMAT = "visref-path"
PATH_VERSION = 1

# How far the rotation part of a camera matrix may be from orthonormal. A matrix written with
# seven significant digits is within 1e-6 of one; anything further off is scaled or sheared.
ORTHONORMAL_TOLERANCE = 1e-6

# Sample coordinates a, b must be exact in float32 too (the fast engines use them), so the
# image is at most 2**24 / 2 pixels on a side; far above any GL limit.
MAX_IMAGE_SIDE = 1 << 20
# A visibility buffer takes 12 bytes a sample: 3 GB here, and an engine needs several times that.
MAX_SAMPLES = 1 << 28


@dataclass(frozen=True, eq=False)
class Camera:
    """One frame's view: a pose, a projection and a grid of samples.

    `world_from_camera`: (4, 4) float64, columns right, up, back, eye; orthonormal to 1e-6 and
    right-handed. `near`, `far`: view depth in world units, a hit counts where
    near <= t <= far; `far` may be infinite. Exactly one of `yfov` (vertical field of view,
    radians) and `ymag` (half the view's height, world units; orthographic) is given.
    `cut` marks a jump from the frame before, for temporal methods.

    Raises InputError where a value breaks these rules.
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

    def __post_init__(self) -> None:
        matrix = np.array(self.world_from_camera, dtype=np.float64)
        _check_pose(matrix)
        matrix.flags.writeable = False
        object.__setattr__(self, "world_from_camera", matrix)
        for name in ("width", "height"):
            side = getattr(self, name)
            if not 1 <= side <= MAX_IMAGE_SIDE:
                raise InputError(
                    f"the image's {name} is {side}",
                    place=name,
                    mend=f"give 1 to {MAX_IMAGE_SIDE} pixels",
                )
        if self.samples > MAX_SAMPLES:
            raise InputError(
                f"the image has {self.width} x {self.height} pixels",
                place="width",
                mend=f"give at most {MAX_SAMPLES} in all",
            )
        if (self.yfov is None) == (self.ymag is None):
            raise InputError(
                "a camera is perspective or orthographic", mend="give either 'yfov' or 'ymag'"
            )
        if self.yfov is not None and not 0.0 < self.yfov < math.pi:
            raise InputError(
                f"yfov is {self.yfov}", place="yfov", mend="give radians between 0 and pi"
            )
        if self.ymag is not None and not (0.0 < self.ymag < math.inf):
            raise InputError(f"ymag is {self.ymag}", place="ymag", mend="give a positive length")
        self._check_range()
        for name in ("shift_x_px", "shift_y_px"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"{name} is not finite", place=name, mend="give pixels")

    def _check_range(self) -> None:
        lowest = 0.0 if self.is_perspective else -math.inf
        if not lowest <= self.near < math.inf or (self.is_perspective and self.near == 0.0):
            raise InputError(
                f"near is {self.near}",
                place="near",
                mend="give a positive distance" if self.is_perspective else "give a finite one",
            )
        if math.isnan(self.far) or self.far <= self.near:
            raise InputError(
                f"near ({self.near}) is not less than far ({self.far})",
                place="far",
                mend="give near < far; far may be null for an infinite range",
            )

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
        return self.world_from_camera[:3, 3].copy()

    @cached_property
    def forward(self) -> Float64:
        """F: (3,) float64, the direction along which view depth grows."""
        return -self.world_from_camera[:3, 2]

    @cached_property
    def _step(self) -> float:
        if self.yfov is not None:
            return math.tan(self.yfov / 2) / self.height
        assert self.ymag is not None
        return self.ymag / self.height

    @cached_property
    def right_step(self) -> Float64:
        """R: (3,) float64, what one unit of `a` adds to a ray (half a pixel)."""
        return self.world_from_camera[:3, 0] * self._step

    @cached_property
    def up_step(self) -> Float64:
        """U: (3,) float64, what one unit of `b` adds to a ray (half a pixel)."""
        return self.world_from_camera[:3, 1] * self._step

    @cached_property
    def column_a(self) -> Float64:
        """a of every pixel column: (width,) float64, integers unless the lens is shifted."""
        x = np.arange(self.width, dtype=np.float64)
        return 2.0 * (x + self.shift_x_px) + 1.0 - self.width

    @cached_property
    def row_b(self) -> Float64:
        """b of every pixel row: (height,) float64, integers unless the lens is shifted."""
        y = np.arange(self.height, dtype=np.float64)
        return self.height - 2.0 * (y + self.shift_y_px) - 1.0

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
        return result

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
                mend="give the path a finite far",
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

        return {
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


def _check_pose(matrix: Float64) -> None:
    place = "world_from_camera"
    if matrix.shape != (4, 4):
        raise InputError(
            f"the matrix has shape {matrix.shape}", place=place, mend="give four rows of four"
        )
    if not np.isfinite(matrix).all():
        raise InputError("the matrix is not finite", place=place, mend="give finite numbers")
    if not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        raise InputError(
            "the matrix's last row is not 0 0 0 1",
            place=place,
            mend="write row-major rows, translation in the last column",
        )
    rotation = matrix[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(rotation, axis=0)
        determinant = float(np.linalg.det(rotation / np.where(lengths > 0.0, lengths, 1.0)))
        error = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if abs(determinant) < ORTHONORMAL_TOLERANCE:
        raise InputError("the matrix is singular", place=place, mend="give a rigid transform")
    if not error <= ORTHONORMAL_TOLERANCE:  # also where huge entries overflowed to NaN
        raise InputError(
            f"the camera's axes are not orthonormal (off by {error:.3g})",
            place=place,
            mend="remove scale and shear from the matrix",
        )
    if determinant < 0.0:
        raise InputError(
            "the camera's matrix is mirrored", place=place, mend="give a right-handed rotation"
        )


_SHARED_FIELDS = ("width", "height", "near", "far", "yfov", "ymag", "shift_x_px", "shift_y_px")
_FRAME_FIELDS = (*_SHARED_FIELDS, "world_from_camera", "cut")


@dataclass(frozen=True)
class CameraPath:
    """A sequence of cameras. `source` names the file it came from, for messages."""

    frames: tuple[Camera, ...]
    source: str = field(default="camera path", compare=False)

    def __post_init__(self) -> None:
        if not self.frames:
            raise InputError(
                "the path has no frames",
                source=self.source,
                place="frames",
                mend="give at least one camera",
            )

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.frames)

    @classmethod
    def load(cls, path: Path | str) -> CameraPath:
        """Read a path file (JSON). Raises InputError naming the file and the place."""
        source = str(path)
        try:
            return cls.from_json(parse_json(map_file(Path(path)).tobytes()), source=source)
        except InputError as error:
            raise error.at(source=source) from error

    @classmethod
    def from_json(cls, data: Any, *, source: str = "camera path") -> CameraPath:
        """Build a path from parsed JSON. Raises InputError naming the place."""
        top = _mapping(data, "")
        if top.get("format") != PATH_FORMAT:
            raise InputError(
                f"this is not a camera path (format is {reprlib.repr(top.get('format'))})",
                place="format",
                mend=f'write "format": "{PATH_FORMAT}"',
            )
        version = top.get("version")
        if version != PATH_VERSION or isinstance(version, bool):
            raise InputError(
                f"version {reprlib.repr(version)} is not known",
                place="version",
                mend=f"this visref reads version {PATH_VERSION}",
            )
        _known(top, ("format", "version", "frames", *_SHARED_FIELDS), "")
        frames = top.get("frames")
        if not isinstance(frames, list):
            raise InputError("frames is not a list", place="frames", mend="give a list of frames")
        shared = {name: top[name] for name in _SHARED_FIELDS if name in top}
        cameras = []
        for index, entry in enumerate(frames):
            place = f"frames[{index}]"
            own = _mapping(entry, place)
            _known(own, _FRAME_FIELDS, place)
            merged = {**shared, **own}
            if "ymag" in own and "yfov" not in own:
                merged.pop("yfov", None)
            if "yfov" in own and "ymag" not in own:
                merged.pop("ymag", None)
            try:
                cameras.append(_camera(merged))
            except InputError as error:
                raise error.at(place=place) from error
        return cls(tuple(cameras), source)

    def to_json(self) -> dict[str, Any]:
        """The JSON form; fields that all frames share stand at the top."""
        rows = [_camera_json(camera) for camera in self.frames]
        shared = {
            name: rows[0][name]
            for name in _SHARED_FIELDS
            if all(name in row and row[name] == rows[0][name] for row in rows)
        }
        frames = [{k: v for k, v in row.items() if k not in shared} for row in rows]
        return {"format": PATH_FORMAT, "version": PATH_VERSION, **shared, "frames": frames}

    def resized(self, width: int, height: int) -> CameraPath:
        """The same path at another resolution (a vertical field of view stays as it is)."""
        return replace(
            self, frames=tuple(replace(c, width=width, height=height) for c in self.frames)
        )


def middles(length: int, parts: int) -> list[int]:
    """Frames in the middles of equal parts of a path, ascending; of a shorter path, all of it.
    Neither its first frame nor its last is special."""
    parts = min(parts, length)
    return [(2 * k + 1) * length // (2 * parts) for k in range(parts)]


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
        raise InputError("a camera cannot look at its own position", mend="move eye or target")
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


def _camera_json(camera: Camera) -> dict[str, Any]:
    row: dict[str, Any] = {
        "width": camera.width,
        "height": camera.height,
        "near": camera.near,
        "far": None if math.isinf(camera.far) else camera.far,
    }
    if camera.yfov is not None:
        row["yfov"] = camera.yfov
    else:
        row["ymag"] = camera.ymag
    for name in ("shift_x_px", "shift_y_px"):
        if getattr(camera, name):
            row[name] = getattr(camera, name)
    if camera.cut:
        row["cut"] = True
    row["world_from_camera"] = camera.world_from_camera.tolist()
    return row


def _camera(values: Mapping[str, Any]) -> Camera:
    if "world_from_camera" not in values:
        raise InputError("world_from_camera is missing", mend="give a 4 by 4 matrix")
    for name in ("width", "height", "near"):
        if name not in values:
            raise InputError(f"{name} is missing", mend="give it at the top or in the frame")
    cut = values.get("cut", False)
    if not isinstance(cut, bool):
        raise InputError("cut is not true or false", place="cut", mend="write true or false")
    far = values.get("far")
    return Camera(
        world_from_camera=_matrix(values["world_from_camera"]),
        width=_integer(values, "width"),
        height=_integer(values, "height"),
        near=_number(values, "near"),
        far=math.inf if far is None else _number(values, "far"),
        yfov=_number(values, "yfov") if values.get("yfov") is not None else None,
        ymag=_number(values, "ymag") if values.get("ymag") is not None else None,
        shift_x_px=_number(values, "shift_x_px") if "shift_x_px" in values else 0.0,
        shift_y_px=_number(values, "shift_y_px") if "shift_y_px" in values else 0.0,
        cut=cut,
    )


def _mapping(value: Any, place: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InputError("this is not a JSON object", place=place, mend="write { ... }")
    return value


def _known(value: Mapping[str, Any], names: tuple[str, ...], place: str) -> None:
    for key in value:
        if key not in names:
            raise InputError(
                f"unknown field {reprlib.repr(key)}",
                place=place,
                mend=f"known are {', '.join(names)}",
            )


def _number(values: Mapping[str, Any], name: str) -> float:
    return _float(values[name], name)


def _float(value: Any, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(
            f"{reprlib.repr(value)} is not a number", place=place, mend="give a number"
        )
    try:
        return float(value)
    except OverflowError as error:
        raise InputError(
            "the number is too large", place=place, mend="give a float64 number"
        ) from error


def _integer(values: Mapping[str, Any], name: str) -> int:
    value = values[name]
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{reprlib.repr(value)} is not an integer", place=name, mend="give pixels")
    return value


def _matrix(value: Any) -> Float64:
    place = "world_from_camera"
    rows_ok = isinstance(value, list) and len(value) == 4
    if not rows_ok or not all(isinstance(row, list) and len(row) == 4 for row in value):
        raise InputError("not a 4 by 4 matrix", place=place, mend="give four rows of four")
    return np.array(
        [
            [_float(entry, f"{place}[{i}][{j}]") for j, entry in enumerate(row)]
            for i, row in enumerate(value)
        ]
    )
