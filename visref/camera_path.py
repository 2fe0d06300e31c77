"""Camera paths: a sequence of cameras, and its JSON form."""

from __future__ import annotations

import reprlib
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from visref.camera import Camera
from visref.errors import InputError
from visref.files import json_bytes, map_file, parse_json
from visref.memory import Budget
from visref.path_frame import (
    SHARED_FIELDS,
    Frame,
    Remark,
    Remarks,
    frame_json,
    frame_of,
    mapping,
    shared_of,
)
from visref.scene import Float64

__all__ = ["PATH_FORMAT", "PATH_VERSION", "CameraPath", "Frame", "middles"]

PATH_FORMAT = "visref-path"
PATH_VERSION = 1


@dataclass(frozen=True)
class CameraPath:
    """A sequence of frames; a camera stands for a frame of its own.

    `source` names the file it came from, for messages. `numbers`: each frame's number, ascending:
    0, 1, … unless it is of a recording that leaves some out. Whoever speaks of a frame gives its
    number. `remarks`: what its reader passed over or set right.
    """

    frames: tuple[Frame, ...]
    source: str = field(default="camera path", compare=False)
    numbers: Sequence[int] = ()
    remarks: tuple[Remark, ...] = field(default=(), compare=False)

    def __init__(
        self,
        frames: Iterable[Frame | Camera],
        source: str = "camera path",
        numbers: Sequence[int] | None = None,
        remarks: tuple[Remark, ...] = (),
    ) -> None:
        made = tuple(Frame((one,)) if isinstance(one, Camera) else one for one in frames)
        numbers = range(len(made)) if numbers is None else numbers
        object.__setattr__(self, "frames", made)
        object.__setattr__(self, "source", source)
        object.__setattr__(self, "numbers", numbers)
        object.__setattr__(self, "remarks", remarks)
        if not made:
            raise InputError(
                "the path has no frames",
                source=source,
                place="frames",
                fix="give at least one camera",
            )
        assert len(numbers) == len(made), "a number per frame"

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def without_gaps(self) -> bool:
        """Whether the frames are 0, 1, …"""
        return list(self.numbers) == list(range(len(self.frames)))

    def place(self, number: int) -> int:
        """How many frames come before the one of this number. Raises KeyError for no frame's."""
        at = number if isinstance(self.numbers, range) else bisect_left(self.numbers, number)
        if not 0 <= at < len(self.frames) or self.numbers[at] != number:
            raise KeyError(number)
        return at

    def has(self, number: int) -> bool:
        """Whether a frame has this number."""
        try:
            return self.place(number) >= 0
        except KeyError:
            return False

    def frame(self, number: int) -> Frame:
        """The frame of this number. Raises KeyError where there is none."""
        return self.frames[self.place(number)]

    def views(self, number: int) -> tuple[Camera, ...]:
        """The cameras of the frame of this number, in the path's order."""
        return self.frame(number).cameras

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
        top = mapping(data, "")
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
        frames = top.get("frames")
        if not isinstance(frames, list):
            raise InputError("frames is not a list", place="frames", fix="give a list of frames")
        remarks = Remarks()
        shared, fps = shared_of(top, remarks, ("frames",))
        made = []
        for index, entry in enumerate(frames):
            place = f"frames[{index}]"
            try:
                time_s = None if fps is None else index / fps
                own = mapping(entry, "")
                made.append(frame_of(own, shared, time_s, remarks=remarks, place=place))
            except InputError as error:
                raise error.at(place=place) from error
        return cls(made, source, remarks=remarks.all(source))

    def to_json(self) -> dict[str, Any]:
        """The JSON form; fields that all cameras share stand at the top, and so does what
        animation all frames name."""
        frames = [frame_json(frame) for frame in self.frames]
        cameras = [one for row in frames for one in row.get("views", {"": row}).values()]
        shared: dict[str, Any] = {}
        for names, rows in ((SHARED_FIELDS, cameras), (("animation",), frames)):
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
        return CameraPath(frames, self.source, self.numbers, self.remarks)


def middles(length: int, parts: int) -> list[int]:
    """Frames in the middles of equal parts of a path, ascending; of a shorter path, all of it.
    Neither its first frame nor its last is special."""
    parts = min(parts, length)
    return [(2 * k + 1) * length // (2 * parts) for k in range(parts)]
