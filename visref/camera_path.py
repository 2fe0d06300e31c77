"""Camera paths: a sequence of cameras, and its JSON form."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from visref.camera import Camera
from visref.errors import InputError
from visref.files import json_bytes, map_file, parse_json
from visref.memory import Budget
from visref.scene import Float64, clean_name

PATH_FORMAT = "visref-path"
PATH_VERSION = 1

_SHARED_FIELDS = (
    "width",
    "height",
    "near",
    "far",
    "yfov",
    "ymag",
    "shift_x_px",
    "shift_y_px",
    "clip_plane",
)
_VIEW_FIELDS = (*_SHARED_FIELDS, "world_from_camera")
_POSE_FIELDS = ("time_s", "animation", "world_from_object", "absent", "levels")
_FRAME_FIELDS = (*_VIEW_FIELDS, *_POSE_FIELDS, "cut", "views")
_TOP_FIELDS = ("format", "version", "frames", "fps", "animation", *_SHARED_FIELDS)


@dataclass(frozen=True, eq=False)
class Frame:
    """One moment: the cameras that look, and the state of what they look at.

    `cameras`: one per view, in order; a frame's only view need not have a name. `time_s`: the time
    at which the scene's file poses its objects, by its animation `clip` (None: the first).
    `world_from_object`: by the name of an object or a group, a (4, 4) float64 affine matrix: an
    object's place, or what a group's (and a skinned object's) is multiplied with from the left.
    `absent`: names of objects and groups that are not there. `levels`: by the name of a group,
    which of its levels of detail is there. Nothing is taken over from the frame before.
    """

    cameras: tuple[Camera, ...]
    time_s: float | None = None
    clip: str | None = None
    world_from_object: Mapping[str, Float64] = field(default_factory=dict)
    absent: tuple[str, ...] = ()
    levels: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        views = [camera.view for camera in self.cameras]
        if not views:
            raise InputError("the frame has no view", place="views", fix="give a camera")
        if len(set(views)) != len(views):
            raise InputError("two views have the same name", place="views", fix="rename one")
        if len(views) > 1 and "" in views:
            raise InputError("one of several views has no name", place="views", fix="name it")

    @property
    def poses(self) -> bool:
        """Whether it says more than where the cameras are."""
        return self.time_s is not None or bool(self.world_from_object or self.absent or self.levels)

    def definition(self) -> Any:
        """What its samples and its scene hang on, as JSON values: the camera's own definition where
        that is all."""
        if not self.poses and len(self.cameras) == 1 and not self.cameras[0].view:
            return self.cameras[0].definition()
        return {
            "views": {camera.view: camera.definition() for camera in self.cameras},
            "time_s": None if self.time_s is None else float(self.time_s).hex(),
            "animation": self.clip,
            "world_from_object": {
                name: [float(value).hex() for value in matrix.reshape(-1)]
                for name, matrix in self.world_from_object.items()
            },
            "absent": sorted(set(self.absent)),
            "levels": dict(self.levels),
        }


@dataclass(frozen=True)
class CameraPath:
    """A sequence of frames; a camera stands for a frame of its own. `source` names the file it came
    from, for messages."""

    frames: tuple[Frame, ...]
    source: str = field(default="camera path", compare=False)

    def __init__(self, frames: Iterable[Frame | Camera], source: str = "camera path") -> None:
        made = tuple(Frame((one,)) if isinstance(one, Camera) else one for one in frames)
        object.__setattr__(self, "frames", made)
        object.__setattr__(self, "source", source)
        if not made:
            raise InputError(
                "the path has no frames",
                source=source,
                place="frames",
                fix="give at least one camera",
            )

    def __len__(self) -> int:
        return len(self.frames)

    def views(self, frame: int) -> tuple[Camera, ...]:
        """The cameras of one frame, in the path's order."""
        return self.frames[frame].cameras

    @cached_property
    def cameras(self) -> tuple[Camera, ...]:
        """Each frame's only camera. Raises InputError where a frame has several views."""
        for index, frame in enumerate(self.frames):
            if len(frame.cameras) > 1:
                raise InputError(
                    f"it has {len(frame.cameras)} views, and this looks through one camera",
                    source=self.source,
                    place=f"frames[{index}]",
                    fix="give a path with a view per frame",
                )
        return tuple(frame.cameras[0] for frame in self.frames)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.cameras)

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
        _known(top, _TOP_FIELDS, "")
        frames = top.get("frames")
        if not isinstance(frames, list):
            raise InputError("frames is not a list", place="frames", fix="give a list of frames")
        fps = _number(top, "fps") if top.get("fps") is not None else None
        if fps is not None and not 0.0 < fps < math.inf:
            raise InputError(f"fps is {fps}", place="fps", fix="give frames a second above 0")
        shared = {name: top[name] for name in (*_SHARED_FIELDS, "animation") if name in top}
        made = []
        for index, entry in enumerate(frames):
            place = f"frames[{index}]"
            try:
                time_s = None if fps is None else index / fps
                made.append(_frame(_mapping(entry, ""), shared, time_s))
            except InputError as error:
                raise error.at(place=place) from error
        return cls(made, source)

    def to_json(self) -> dict[str, Any]:
        """The JSON form; fields that all cameras share stand at the top, and so does what
        animation all frames name."""
        frames = [_frame_json(frame) for frame in self.frames]
        cameras = [one for row in frames for one in row.get("views", {"": row}).values()]
        shared: dict[str, Any] = {}
        for names, rows in ((_SHARED_FIELDS, cameras), (("animation",), frames)):
            for name in names:
                if all(name in row and row[name] == rows[0][name] for row in rows):
                    shared[name] = rows[0][name]
                    for row in rows:
                        del row[name]
        return {"format": PATH_FORMAT, "version": PATH_VERSION, **shared, "frames": frames}

    def relative_to(self, origin: Float64) -> CameraPath:
        """The same path, its cameras relative to a point of the world, (3,) float64; itself where
        they are."""
        return self._with_cameras(lambda camera: camera.relative_to(origin))

    def resized(self, width: int, height: int) -> CameraPath:
        """The same path at another resolution (a vertical field of view stays as it is)."""
        return self._with_cameras(lambda camera: replace(camera, width=width, height=height))

    def _with_cameras(self, change: Callable[[Camera], Camera]) -> CameraPath:
        frames = []
        for frame in self.frames:
            cameras = tuple(map(change, frame.cameras))
            same = all(new is old for new, old in zip(cameras, frame.cameras, strict=True))
            frames.append(frame if same else replace(frame, cameras=cameras))
        if all(new is old for new, old in zip(frames, self.frames, strict=True)):
            return self
        return CameraPath(frames, self.source)


def middles(length: int, parts: int) -> list[int]:
    """Frames in the middles of equal parts of a path, ascending; of a shorter path, all of it.
    Neither its first frame nor its last is special."""
    parts = min(parts, length)
    return [(2 * k + 1) * length // (2 * parts) for k in range(parts)]


def _frame_json(frame: Frame) -> dict[str, Any]:
    row: dict[str, Any] = {}
    if len(frame.cameras) == 1 and not frame.cameras[0].view:
        row = _camera_json(frame.cameras[0])
    else:
        row["views"] = {camera.view: _camera_json(camera) for camera in frame.cameras}
    if frame.cameras[0].cut:
        row["cut"] = True
    if frame.time_s is not None:
        row["time_s"] = frame.time_s
    if frame.clip is not None:
        row["animation"] = frame.clip
    if frame.world_from_object:
        row["world_from_object"] = {n: m.tolist() for n, m in frame.world_from_object.items()}
    if frame.absent:
        row["absent"] = list(frame.absent)
    if frame.levels:
        row["levels"] = dict(frame.levels)
    return row


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
    if camera.clip_plane is not None:
        row["clip_plane"] = list(camera.clip_plane)
    row["world_from_camera"] = camera.world_from_camera.tolist()
    return row


def _frame(own: Mapping[str, Any], shared: Mapping[str, Any], time_s: float | None) -> Frame:
    """A frame from its own fields and those that all share; `time_s` unless it says otherwise."""
    _known(own, _FRAME_FIELDS, "")
    cut = own.get("cut", False)
    if not isinstance(cut, bool):
        raise InputError("cut is not true or false", place="cut", fix="write true or false")
    if own.get("time_s") is not None:
        time_s = _number(own, "time_s")
        if not math.isfinite(time_s):
            raise InputError(f"time_s is {time_s}", place="time_s", fix="give seconds")
    clip = own.get("animation", shared.get("animation"))
    if clip is not None and not isinstance(clip, str):
        raise InputError("animation is not a name", place="animation", fix="name a clip")
    return Frame(
        _views(own, shared, cut),
        time_s,
        clip,
        {
            clean_name(name): _matrix(value, f"world_from_object.{name}")
            for name, value in _mapping(
                own.get("world_from_object", {}), "world_from_object"
            ).items()
        },
        _names(own.get("absent", [])),
        _levels(own.get("levels", {})),
    )


def _views(own: Mapping[str, Any], shared: Mapping[str, Any], cut: bool) -> tuple[Camera, ...]:
    merged = _over(shared, own)
    if "views" not in own:
        return (_camera(merged, "", cut),)
    cameras = []
    for name, values in _mapping(own["views"], "views").items():
        place = f"views.{name}"
        try:
            view = _mapping(values, "")
            _known(view, _VIEW_FIELDS, "")
            cameras.append(_camera(_over(merged, view), clean_name(name), cut))
        except InputError as error:
            raise error.at(place=place) from error
    return tuple(cameras)


def _over(under: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Fields over those that they override; one kind of projection overrides the other."""
    merged = {**under, **own}
    for name, other in (("ymag", "yfov"), ("yfov", "ymag")):
        if name in own and other not in own:
            merged.pop(other, None)
    return merged


def _names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise InputError("absent is not a list of names", place="absent", fix='write ["name"]')
    return tuple(map(clean_name, value))


def _levels(value: Any) -> dict[str, int]:
    levels = _mapping(value, "levels")
    for name, level in levels.items():
        if isinstance(level, bool) or not isinstance(level, int) or level < 0:
            raise InputError(
                f"{reprlib.repr(level)} is no level", place=f"levels.{name}", fix="give 0, 1, …"
            )
    return {clean_name(name): level for name, level in levels.items()}


def _camera(values: Mapping[str, Any], view: str, cut: bool) -> Camera:
    if "world_from_camera" not in values:
        raise InputError("world_from_camera is missing", fix="give a 4 by 4 matrix")
    for name in ("width", "height", "near"):
        if name not in values:
            raise InputError(f"{name} is missing", fix="give it at the top or in the frame")
    far, plane = values.get("far"), values.get("clip_plane")
    if plane is not None and not isinstance(plane, list):
        raise InputError("clip_plane is no list", place="clip_plane", fix="write [a, b, c, d]")
    return Camera(
        world_from_camera=_matrix(values["world_from_camera"], "world_from_camera"),
        width=_integer(values, "width"),
        height=_integer(values, "height"),
        near=_number(values, "near"),
        far=math.inf if far is None else _number(values, "far"),
        yfov=_number(values, "yfov") if values.get("yfov") is not None else None,
        ymag=_number(values, "ymag") if values.get("ymag") is not None else None,
        shift_x_px=_number(values, "shift_x_px") if "shift_x_px" in values else 0.0,
        shift_y_px=_number(values, "shift_y_px") if "shift_y_px" in values else 0.0,
        cut=cut,
        view=view,
        clip_plane=None if plane is None else tuple(_float(value, "clip_plane") for value in plane),  # type: ignore[arg-type]
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


def _matrix(value: Any, place: str) -> Float64:
    rows_ok = isinstance(value, list) and len(value) == 4
    if not rows_ok or not all(isinstance(row, list) and len(row) == 4 for row in value):
        raise InputError("not a 4 by 4 matrix", place=place, fix="give four rows of four")
    return np.array(
        [
            [_float(entry, f"{place}[{i}][{j}]") for j, entry in enumerate(row)]
            for i, row in enumerate(value)
        ]
    )
