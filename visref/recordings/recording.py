"""One-file recordings: what an engine writes as it runs, a line per frame.

JSON Lines. The first line is a header, `{"format": "visref-recording", "version": 1, …}`, with what
all frames share (as at the top of a camera path), `"groups": {NAME: [object, …]}` and `"units"`, a
file beside the recording (`visref.recordings.units`). Each further line is a frame of a camera path
with its `"frame"`, a number that ascends and may leave some out, and what was drawn: `"visible"` or
`"visible_nodes"`, and `"stats"` and `"bounds"` as in recorded visible sets.

A file that ends in the middle of a line is that of an engine that died, and one whose last line is
`{"stopped": "why"}` that of a recorder that gave up: the frames before count.
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from visref.camera_path import PATH_FORMAT, CameraPath
from visref.errors import InputError
from visref.findings import Code
from visref.memory import Budget
from visref.numerals import as_whole
from visref.path_frame import Frame, Remark, Remarks, frame_of, mapping, shared_of
from visref.recordings.gathering import Gathering
from visref.recordings.names import Names, shown_name
from visref.recordings.rows import ROW_FIELDS, JsonLines, Row, reading, row_of
from visref.recordings.units import read_units
from visref.recordings.visible_sets import VisibleSets
from visref.scene import Group, Scene, clean_name

RECORDING_FORMAT = "visref-recording"
RECORDING_VERSION = 1

# What a header says besides what a path says at its top.
HEADER_FIELDS = ("groups", "units")
# So many characters of a recorder's last words are repeated.
_SHOWN = 300
# Records hold frame numbers as int32.
MOST_FRAME = 2**31 - 1
# A frame in memory: itself, a view's camera with its vectors, a pose, a name.
_FRAME_BYTES, _VIEW_BYTES, _POSE_BYTES, _NAME_BYTES = 1000, 3000, 500, 200
# An object in a group: its number, and its names in two tuples of a set, twice over.
_MEMBER_BYTES = 600


@dataclass(frozen=True, eq=False)
class Line:
    """A frame's line: its `number`, the `frame` of the path, what was drawn, and the JSON that
    says it."""

    number: int
    frame: Frame
    row: Row
    values: Mapping[str, Any]


@dataclass(eq=False)
class RecordingLines:
    """A recording, read a line at a time.

    `header`: the first line. `remarks`: what was passed over or set right in the lines read so far.
    `cut_off`: how it ends, once all are read, where it does not end well: a line that is not whole,
    or a recorder that stopped; else empty. Raises InputError without the file's name, at its line;
    from the constructor for the header.
    """

    file: Path
    budget: Budget
    header: Mapping[str, Any] = field(init=False)
    remarks: Remarks = field(default_factory=Remarks, init=False)

    def __post_init__(self) -> None:
        self._stopped: tuple[str, str] | None = None
        self._json = JsonLines(self.file, self.budget, whole=False)
        self._lines = iter(self._json)
        place, values = next(self._lines, ("line 1", None))
        if values is None:
            raise InputError(
                "the header is not whole" if self._json.cut_off else "it is empty",
                place=self._json.cut_off,
                fix="record again: the program ended before the recorder was closed or flushed",
            )
        if isinstance(values, dict) and isinstance(values.get("stopped"), str):
            why = " ".join(clean_name(values["stopped"]).split())[:_SHOWN]
            raise InputError(
                f"the recorder stopped before it wrote anything: {why}",
                place=place,
                fix="mend that, and record again",
            )
        if isinstance(values, dict) and values.get("format") == PATH_FORMAT:
            raise InputError(
                "this is a camera path", place=place, fix="give it as --path, with --visible"
            )
        if not isinstance(values, dict) or values.get("format") != RECORDING_FORMAT:
            raise InputError(
                "this is no recording: the first line is no header",
                place=place,
                fix=f'write {{"format": "{RECORDING_FORMAT}", "version": {RECORDING_VERSION}, …}} '
                "first; for visible sets without cameras give --visible and --path",
            )
        version = values.get("version")
        if version != RECORDING_VERSION or isinstance(version, bool):
            raise InputError(
                f"version {reprlib.repr(version)} is not known",
                place=f"{place}: version",
                fix=f"this visref reads version {RECORDING_VERSION}",
            )
        self.header = values
        try:
            self._shared, self.fps = shared_of(values, self.remarks, HEADER_FIELDS)
        except InputError as error:
            at = f"{place}: {error.place}"
            raise InputError(error.problem, place=at, fix=error.fix) from error

    @property
    def cut_off(self) -> str:
        if self._stopped:
            return f"{self._stopped[0]}: the recorder stopped: {self._stopped[1][:_SHOWN]}"
        return f"{self._json.cut_off} is not whole" if self._json.cut_off else ""

    def __iter__(self) -> Iterator[Line]:
        last = -1
        for place, values in self._lines:
            if self._stopped:
                raise InputError(
                    "the recorder stopped before it", place=place, fix="keep one recording a file"
                )
            if isinstance(values, dict) and isinstance(values.get("stopped"), str):
                self._stopped = place, " ".join(clean_name(values["stopped"]).split())
                continue
            row = row_of(values, place)
            if not last < row.frame <= MOST_FRAME:
                problem = f"frame {reprlib.repr(row.frame)} comes after frame {last}"
                if last < 0 or row.frame > MOST_FRAME:
                    problem = f"frame is {reprlib.repr(row.frame)}"
                raise InputError(
                    problem, place=place, fix=f"number the frames 0 to {MOST_FRAME}, ascending"
                )
            last = row.frame
            time_s = None if self.fps is None else row.frame / self.fps
            try:
                frame = frame_of(
                    values,
                    self._shared,
                    time_s,
                    remarks=self.remarks,
                    place=place,
                    beside=ROW_FIELDS,
                )
            except InputError as error:
                at = f"{place}: {error.place}" if error.place else place
                raise InputError(error.problem, place=at, fix=error.fix) from error
            yield Line(row.frame, frame, row, values)

    def groups(self, scene: Scene) -> Scene:
        """The scene with the header's groups. Raises InputError where one cannot be."""
        named: dict[str, list[int | str]] = {}
        names = Names(scene)
        places: dict[str, str] = {}
        for name, given in mapping(self.header.get("groups", {}), "groups").items():
            members = list(map(as_whole, given)) if isinstance(given, list) else given
            if not isinstance(members, list) or not set(map(type, members)) <= {int, str}:
                raise InputError(
                    f"group {shown_name(name)} is not a list of ids and names",
                    place="groups",
                    fix="write [3, 'name']",
                )
            named[name] = members
            for member in members:
                if isinstance(member, str):
                    places.setdefault(clean_name(member), f"groups.{name}")
        if not named:
            return scene
        known = names.resolved(places, str(self.file)) if places else {}
        groups = list(scene.groups)
        taken = {name for group in groups for name in (group.name, group.path)}
        for name, members in named.items():
            objects: set[int] = set()
            for member in members:
                if isinstance(member, str):
                    objects.update(known[clean_name(member)])
                elif 0 <= member < scene.object_count:
                    objects.add(member)
                else:
                    raise InputError(
                        f"object id {reprlib.repr(member)} is not in the scene "
                        f"(0…{scene.object_count - 1})",
                        place=f"groups.{name}",
                        fix="use the ids of `visref objects`",
                    )
            if not objects:
                raise InputError(
                    f"group {shown_name(name)} is empty", place="groups", fix="leave it out"
                )
            self.budget.claim(
                f"its groups up to {shown_name(name)}",
                _MEMBER_BYTES * len(objects),
                place="groups",
            )
            name = clean_name(name)
            if name in taken:
                raise InputError(
                    f"the scene has a group {shown_name(name)} of its own",
                    place="groups",
                    fix="give yours another name",
                )
            groups.append(Group(name, name, tuple(sorted(objects))))
        return replace(scene, groups=tuple(groups))

    def units_file(self) -> Path | None:
        """The file of units that the header names, inside the recording's folder. Raises InputError
        for any other."""
        named = self.header.get("units")
        if named is None:
            return None
        inside = isinstance(named, str) and bool(named) and "\0" not in named
        if inside:
            parts = PureWindowsPath(named).parts
            inside = not PureWindowsPath(named).anchor and not PurePosixPath(named).is_absolute()
            inside = inside and ".." not in parts
        if inside:
            folder = self.file.absolute().parent.resolve()
            # A name that no file can have, and a link to itself, lead nowhere.
            try:
                inside = (folder / named).resolve().is_relative_to(folder)
            except (OSError, RuntimeError, ValueError):
                inside = False
        if not inside:
            raise InputError(
                f"units is {reprlib.repr(named)}",
                place="line 1: units",
                fix="name a file in the recording's folder",
            )
        return self.file.parent / str(named)


@dataclass(frozen=True, eq=False)
class Recording:
    """A whole recording: its `path`, what was drawn, and the `scene` that it was read for, with the
    groups that it names."""

    path: CameraPath
    sets: VisibleSets
    scene: Scene


def read_recording(file: Path | str, scene: Scene, *, max_memory: int | None = None) -> Recording:
    """Read a recording of a scene. What was drawn is put aside in a temporary file where it is
    much; the frames' cameras and poses are in memory.

    `max_memory`: bytes that it may take, by default a share of what is free. What was passed over,
    set right or cut off is in the path's `remarks`.

    Raises InputError naming file and line for whatever is wrong with it.
    """
    file = Path(file)
    source = str(file)
    with reading(source):
        budget = Budget.of(max_memory)
        lines = RecordingLines(file, budget)
        scene = lines.groups(scene)
        units_file = lines.units_file()
        units = None
        if units_file is not None:
            units = read_units(units_file, scene, max_memory=max_memory)
        gathering = Gathering(scene, budget, units=units)
        frames, numbers = [], []
        for line in lines:
            frame = line.frame
            budget.claim("its frames up to here", _frame_bytes(frame), place=line.row.place)
            gathering.add(line.row, [camera.view for camera in frame.cameras])
            frames.append(frame)
            numbers.append(line.number)
        if not frames:
            raise InputError(_no_frame(lines), fix="record one at least")
        remarks = (*lines.remarks.all(source), *_cut_off(lines, source, numbers[-1]))
        plain = numbers == list(range(len(numbers)))
        path = CameraPath(frames, source, None if plain else numbers, remarks)
        return Recording(path, VisibleSets.of(gathering, path.numbers, source), scene)


def _no_frame(lines: RecordingLines) -> str:
    """What to say of a recording without a frame."""
    return "there is no whole frame in it" + (f" ({lines.cut_off})" if lines.cut_off else "")


def _cut_off(lines: RecordingLines, source: str, last: int) -> tuple[Remark, ...]:
    if not lines.cut_off:
        return ()
    text = f"{source}: {lines.cut_off}; the recording is judged up to frame {last}"
    return ((Code.RECORDING_CUT_OFF, text),)


def _frame_bytes(frame: Frame) -> int:
    poses = len(frame.world_from_object) + len(frame.levels)
    return (
        _FRAME_BYTES
        + _VIEW_BYTES * len(frame.cameras)
        + _POSE_BYTES * poses
        + _NAME_BYTES * len(frame.absent)
    )
