"""Camera paths: a sequence of cameras, and its JSON form."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from visref.camera import Camera
from visref.errors import InputError
from visref.files import json_bytes, map_file, parse_json
from visref.memory import Budget
from visref.scene import Float64

PATH_FORMAT = "visref-path"
PATH_VERSION = 1

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
                fix="give at least one camera",
            )

    def __len__(self) -> int:
        return len(self.frames)

    def views(self, frame: int) -> tuple[Camera, ...]:
        """The cameras of one frame, in the path's order."""
        return (self.frames[frame],)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.frames)

    @classmethod
    def load(cls, path: Path | str, *, budget: Budget | None = None) -> CameraPath:
        """Read a path file (JSON). Raises InputError naming the file and the place, and where it
        does not fit `budget` (by default that of the machine)."""
        source = str(path)
        try:
            data = map_file(Path(path))
            (budget or Budget.of(None)).need("its JSON", json_bytes(data))
            return cls.from_json(parse_json(data.tobytes()), source=source)
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
                fix=f'write "format": "{PATH_FORMAT}"',
            )
        version = top.get("version")
        if version != PATH_VERSION or isinstance(version, bool):
            raise InputError(
                f"version {reprlib.repr(version)} is not known",
                place="version",
                fix=f"this visref reads version {PATH_VERSION}",
            )
        _known(top, ("format", "version", "frames", *_SHARED_FIELDS), "")
        frames = top.get("frames")
        if not isinstance(frames, list):
            raise InputError("frames is not a list", place="frames", fix="give a list of frames")
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

    def relative_to(self, origin: Float64) -> CameraPath:
        """The same path, its cameras relative to a point of the world, (3,) float64; itself where
        they are."""
        cameras = tuple(camera.relative_to(origin) for camera in self.frames)
        if all(new is old for new, old in zip(cameras, self.frames, strict=True)):
            return self
        return replace(self, frames=cameras)

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
        raise InputError("world_from_camera is missing", fix="give a 4 by 4 matrix")
    for name in ("width", "height", "near"):
        if name not in values:
            raise InputError(f"{name} is missing", fix="give it at the top or in the frame")
    cut = values.get("cut", False)
    if not isinstance(cut, bool):
        raise InputError("cut is not true or false", place="cut", fix="write true or false")
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
        raise InputError("this is not a JSON object", place=place, fix="write { ... }")
    return value


def _known(value: Mapping[str, Any], names: tuple[str, ...], place: str) -> None:
    for key in value:
        if key not in names:
            raise InputError(
                f"unknown field {reprlib.repr(key)}",
                place=place,
                fix=f"known are {', '.join(names)}",
            )


def _number(values: Mapping[str, Any], name: str) -> float:
    return _float(values[name], name)


def _float(value: Any, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{reprlib.repr(value)} is not a number", place=place, fix="give a number")
    try:
        return float(value)
    except OverflowError as error:
        raise InputError(
            "the number is too large", place=place, fix="give a float64 number"
        ) from error


def _integer(values: Mapping[str, Any], name: str) -> int:
    value = values[name]
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{reprlib.repr(value)} is not an integer", place=name, fix="give pixels")
    return value


def _matrix(value: Any) -> Float64:
    place = "world_from_camera"
    rows_ok = isinstance(value, list) and len(value) == 4
    if not rows_ok or not all(isinstance(row, list) and len(row) == 4 for row in value):
        raise InputError("not a 4 by 4 matrix", place=place, fix="give four rows of four")
    return np.array(
        [
            [_float(entry, f"{place}[{i}][{j}]") for j, entry in enumerate(row)]
            for i, row in enumerate(value)
        ]
    )
