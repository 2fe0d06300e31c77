"""COLMAP's text reconstructions: `images.txt`, and the `cameras.txt` beside it (Schönberger 2016).

An image is two lines, `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME` and its points. Quaternion and
translation take the world to the camera, whose axes are OpenCV's; the world's axes are whatever the
reconstruction came out with, or were aligned to. Frames are in the order of the images' names.

Of cameras those with square pixels and without distortion are read: `SIMPLE_PINHOLE`, `PINHOLE`,
and the polynomial ones with zeros. Principal points are kept, as shifts of the lens.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from visref.camera import Camera
from visref.camera_forms import rotation_matrix
from visref.camera_path import Frame
from visref.clip_matrices import RIGID_TOLERANCE
from visref.errors import InputError
from visref.files import map_file
from visref.numerals import decimal_number, whole_number
from visref.paths.conventions import Convention
from visref.paths.lens import Lens
from visref.scene import Float64

# By model: how many focal lengths stand before the principal point; what follows is distortion.
_MODELS = {
    "SIMPLE_PINHOLE": (1, 0),
    "PINHOLE": (2, 0),
    "SIMPLE_RADIAL": (1, 1),
    "RADIAL": (1, 2),
    "OPENCV": (2, 4),
    "FULL_OPENCV": (2, 8),
}


@dataclass(frozen=True)
class _Intrinsics:
    """An image's size, focal length and principal point, in pixels; (0, 0) is the corner of the
    top-left pixel."""

    width: int
    height: int
    focal: float
    centre: tuple[float, float]

    def camera(self, pose: Float64, near: float, far: float) -> Camera:
        # The middle of pixel x is x + 1/2 here, and visref's view axis meets the image's middle.
        return Camera(
            pose,
            self.width,
            self.height,
            near,
            far,
            yfov=2.0 * math.atan(self.height / (2.0 * self.focal)),
            shift_x_px=self.width / 2 - self.centre[0],
            shift_y_px=self.height / 2 - self.centre[1],
        )


def decoded(data: bytes) -> str:
    """UTF-8 text, with a mark of its byte order or without. Raises InputError."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("it is no UTF-8 text", fix="save it as UTF-8") from error


def is_colmap(lines: Sequence[str]) -> bool:
    """Whether the lines are those of an `images.txt`: ten words in the first that is no comment."""
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    return len(first.split(maxsplit=9)) == 10 and "," not in first


def read_colmap(
    file: Path,
    lines: Sequence[str],
    convention: Convention,
    lens: Lens | None,
    near: float,
    far: float,
) -> list[Frame]:
    """A frame for each image. `lens` over what `cameras.txt` says, which is not read then. Raises
    InputError with the place."""
    known: Mapping[int, _Intrinsics] = {} if lens is not None else _cameras(file)
    found = []
    rows = enumerate(lines, start=1)
    for index, line in rows:
        if not line.strip() or line.startswith("#"):
            continue
        next(rows, None)  # its points, of which there may be none
        place = f"line {index}"
        try:
            name, camera_id, pose = _image(line, convention)
            if lens is not None:
                camera = lens.camera(pose, near)
            elif camera_id in known:
                camera = known[camera_id].camera(pose, near, far)
            else:
                raise InputError(f"camera {camera_id} is not in cameras.txt", fix="add it there")
        except InputError as error:
            raise error.at(place=place) from error
        found.append((name, Frame((camera,))))
    return [frame for _, frame in sorted(found, key=lambda pair: pair[0])]


def _image(line: str, convention: Convention) -> tuple[str, int, Float64]:
    words = line.split(maxsplit=9)
    if len(words) != 10:
        raise InputError(
            f"it has {len(words)} words",
            fix="give IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and a line of points",
        )
    numbers = np.array(_decimals(words[1:8]))
    length = float(np.linalg.norm(numbers[:4]))
    if not abs(length * length - 1.0) <= RIGID_TOLERANCE:
        raise InputError(f"the quaternion's length is {length:.6g}", fix="give a unit quaternion")
    # What takes the camera to the world is the inverse.
    rotation = rotation_matrix(numbers[[1, 2, 3, 0]]).T
    pose = convention.pose(rotation, -rotation @ numbers[4:])
    return words[9].strip(), _whole(words[8]), pose


def _cameras(images: Path) -> dict[int, _Intrinsics]:
    file = images.with_name("cameras.txt")
    fix = "put COLMAP's cameras.txt beside images.txt, or give --size and --fov"
    try:
        lines = decoded(map_file(file).tobytes()).splitlines()
    except InputError as error:
        raise InputError(error.problem, source=str(file), fix=fix) from error
    cameras = {}
    for index, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            number, camera = _camera(line.split())
        except InputError as error:
            raise error.at(source=str(file), place=f"line {index}") from error
        cameras[number] = camera
    return cameras


def _camera(words: Sequence[str]) -> tuple[int, _Intrinsics]:
    if len(words) < 4:
        raise InputError("it is no camera", fix="give CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]")
    model = words[1]
    if model not in _MODELS:
        raise InputError(
            f"images of a camera {model} are no perspective",
            fix="undistort the images (colmap image_undistorter), or give --size and --fov",
        )
    focals, distortions = _MODELS[model]
    numbers = _decimals(words[4:])
    if len(numbers) != focals + 2 + distortions:
        raise InputError(
            f"{model} has {len(numbers)} parameters", fix=f"give {focals + 2 + distortions}"
        )
    if any(numbers[focals + 2 :]):
        raise InputError(
            "the lens distorts",
            fix="undistort the images (colmap image_undistorter), or give --size and --fov",
        )
    across, focal = numbers[0], numbers[focals - 1]
    if not 0.0 < focal < math.inf or not abs(across / focal - 1.0) <= RIGID_TOLERANCE:
        raise InputError(
            f"the focal lengths are {across:g} and {focal:g}",
            fix="scale the images so that pixels are square, or give --size and --fov",
        )
    size = _whole(words[2]), _whole(words[3])
    return _whole(words[0]), _Intrinsics(*size, focal, (numbers[focals], numbers[focals + 1]))


def _decimals(words: Sequence[str]) -> list[float]:
    try:
        return [decimal_number(word) for word in words]
    except ValueError as error:
        raise InputError(str(error), fix="write decimal numbers") from error


def _whole(word: str) -> int:
    try:
        return whole_number(word)
    except ValueError as error:
        raise InputError(str(error), fix="write a whole number") from error
