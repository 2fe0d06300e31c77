"""One frame of a camera path: the word, and its JSON form, which recordings share."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from visref.camera import Camera
from visref.camera_forms import CAMERA_FIELDS, far_of, matrix, over, read_camera
from visref.camera_forms import number as _float
from visref.errors import InputError
from visref.findings import Code
from visref.numerals import as_whole
from visref.scene import Float64, clean_name
from visref.wording import counted, did_you_mean

SHARED_FIELDS = (
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
_VIEW_FIELDS = (*SHARED_FIELDS, *CAMERA_FIELDS)
_POSE_FIELDS = ("time_s", "animation", "world_from_object", "absent", "levels")
_FRAME_FIELDS = (*_VIEW_FIELDS, *_POSE_FIELDS, "cut", "views")
# What a path or a recording says at its top besides what all its frames share.
TOP_FIELDS = ("format", "version", "fps", "animation", *_VIEW_FIELDS)

Remark = tuple[Code, str]


class Remarks:
    """What a reader noticed and took all the same: each kind once, with count and first place."""

    def __init__(self) -> None:
        # By kind: how many, the first one's place, and a hint.
        self._found: dict[Remark, tuple[int, str, str]] = {}

    def add(self, code: Code, text: str, place: str, hint: Callable[[], str] = lambda: "") -> None:
        """`hint`: what may stand behind the text; asked once, as it may take its time."""
        if (known := self._found.get((code, text))) is not None:
            self._found[code, text] = (known[0] + 1, *known[1:])
        elif sum(one is code for one, _ in self._found) < _MOST_REMARKS:
            self._found[code, text] = 1, place, hint()

    def all(self, source: str) -> tuple[Remark, ...]:
        """One per kind, in the order in which they were met."""
        result = []
        for (code, text), (count, first, hint) in self._found.items():
            where = f"{counted(count, 'time')}, first at {first}" if count > 1 else f"at {first}"
            said = f"{text}; {hint}" if hint else text
            result.append((code, f"{source}: {said} ({where})"))
        return tuple(result)


# Of one code: a file may hold a field of another name in each of its frames.
_MOST_REMARKS = 20


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


def frame_json(frame: Frame) -> dict[str, Any]:
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


def frame_of(
    own: Mapping[str, Any],
    shared: Mapping[str, Any],
    time_s: float | None,
    *,
    remarks: Remarks,
    place: str,
    beside: tuple[str, ...] = (),
) -> Frame:
    """A frame from its own fields and those that all share; `time_s` unless it says otherwise.

    `beside`: the fields that may stand there for others to read. What is passed over or set right
    goes to `remarks`, at `place`. Raises InputError naming the place in the frame.
    """
    pass_over(own, (*_FRAME_FIELDS, *beside), remarks, place)
    cut = own.get("cut", False)
    if not isinstance(cut, bool):
        raise InputError("cut is not true or false", place="cut", fix="write true or false")
    if own.get("time_s") is not None:
        time_s = number(own, "time_s")
    # A frame's number over `fps` may be none either.
    if time_s is not None and not math.isfinite(time_s):
        raise InputError(f"time_s is {time_s}", place="time_s", fix="give seconds")
    clip = own.get("animation")
    if clip is None:
        clip = shared.get("animation")
    if clip is not None and not isinstance(clip, str):
        raise InputError("animation is not a name", place="animation", fix="name a clip")
    return Frame(
        _views(own, shared, cut, remarks, place),
        time_s,
        clip,
        {
            clean_name(name): matrix(value, f"world_from_object.{name}")
            for name, value in mapping(
                own.get("world_from_object", {}), "world_from_object"
            ).items()
        },
        _names(own.get("absent", [])),
        _levels(own.get("levels", {})),
    )


def shared_of(
    top: Mapping[str, Any], remarks: Remarks, beside: tuple[str, ...]
) -> tuple[dict[str, Any], float | None]:
    """What all frames share, from the top of a path or a recording, and its frames per second."""
    pass_over(top, (*TOP_FIELDS, *beside), remarks, "the top")
    fps = number(top, "fps") if top.get("fps") is not None else None
    if fps is not None and not 0.0 < fps < math.inf:
        raise InputError(f"fps is {fps}", place="fps", fix="give frames a second above 0")
    return {name: top[name] for name in (*_VIEW_FIELDS, "animation") if name in top}, fps


def _views(
    own: Mapping[str, Any], shared: Mapping[str, Any], cut: bool, remarks: Remarks, place: str
) -> tuple[Camera, ...]:
    merged = over(shared, own)
    if "views" not in own:
        return (_camera(merged, "", cut, remarks, place),)
    cameras = []
    for name, values in mapping(own["views"], "views").items():
        inside = f"views.{name}"
        try:
            view = mapping(values, "")
            pass_over(view, _VIEW_FIELDS, remarks, f"{place}.{inside}")
            at = f"{place}.{inside}"
            cameras.append(_camera(over(merged, view), clean_name(name), cut, remarks, at))
        except InputError as error:
            raise error.at(place=inside) from error
    return tuple(cameras)


def _names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise InputError("absent is not a list of names", place="absent", fix='write ["name"]')
    return tuple(map(clean_name, value))


def _levels(value: Any) -> dict[str, int]:
    levels = {name: as_whole(level) for name, level in mapping(value, "levels").items()}
    for name, level in levels.items():
        if isinstance(level, bool) or not isinstance(level, int) or level < 0:
            raise InputError(
                f"{reprlib.repr(level)} is no level", place=f"levels.{name}", fix="give 0, 1, …"
            )
    return {clean_name(name): level for name, level in levels.items()}


def _camera(
    values: Mapping[str, Any], view: str, cut: bool, remarks: Remarks, place: str
) -> Camera:
    for name in ("width", "height"):
        if name not in values:
            raise InputError(f"{name} is missing", fix="give it at the top or in the frame")
    plane = values.get("clip_plane")
    if plane is not None and not isinstance(plane, list):
        raise InputError("clip_plane is no list", place="clip_plane", fix="write [a, b, c, d]")
    width, height = _integer(values, "width"), _integer(values, "height")
    given = read_camera(values, width, height)
    if given.off:
        # A power of ten, so that the frames of a path are not a remark each.
        size = 10.0 ** math.ceil(math.log10(given.off))
        text = f"{given.made}: it was off by up to {size:.0e}"
        remarks.add(Code.CAMERA_MADE_RIGID, text, place)
    return Camera(
        world_from_camera=given.world_from_camera,
        width=width,
        height=height,
        **(given.lens or _lens(values)),
        cut=cut,
        view=view,
        clip_plane=None if plane is None else tuple(_float(value, "clip_plane") for value in plane),  # type: ignore[arg-type]
    )


def _lens(values: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a camera's lens and its range, where the pose's form does not say them."""
    if "near" not in values:
        raise InputError("near is missing", fix="give it at the top or in the frame")
    return {
        "near": number(values, "near"),
        "far": far_of(values),
        "yfov": number(values, "yfov") if values.get("yfov") is not None else None,
        "ymag": number(values, "ymag") if values.get("ymag") is not None else None,
        "shift_x_px": number(values, "shift_x_px") if "shift_x_px" in values else 0.0,
        "shift_y_px": number(values, "shift_y_px") if "shift_y_px" in values else 0.0,
    }


def mapping(value: Any, place: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InputError("this is not a JSON object", place=place, fix="write { ... }")
    return value


def pass_over(
    values: Mapping[str, Any], known: tuple[str, ...], remarks: Remarks, place: str
) -> None:
    """Remark on every field that is not known: it may be a later version's, or misspelt."""
    for key in values:
        if key not in known:
            text = f"field {reprlib.repr(key)} is not known, and was passed over"
            remarks.add(Code.FIELD_IGNORED, text, place, partial(did_you_mean, key, known, ""))


def number(values: Mapping[str, Any], name: str) -> float:
    return _float(values[name], name)


def _integer(values: Mapping[str, Any], name: str) -> int:
    value = as_whole(values[name])
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{reprlib.repr(value)} is not an integer", place=name, fix="give pixels")
    return value
