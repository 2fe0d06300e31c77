"""Recorded visible sets: somebody's engine, judged without being linked to us.

JSON Lines, a line a frame: `{"frame": 0, "visible": [3, "name", …], "stats": {…}}`, where an
integer is an object id and a string a name (`visref.recordings.names`). The same as CSV or Parquet
with columns `frame` and `object_id` or `object`. Frames come in any order, each once.
"""

from __future__ import annotations

import csv
import re
import reprlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import (
    Culler,
    DrawnSet,
    Promise,
    QueryStats,
    Raster,
    RasterTolerance,
    is_count,
    is_duration,
)
from visref.errors import InputError
from visref.files import parse_json
from visref.recordings.names import Names
from visref.scene import Int32, Scene, Units

_WHOLE = re.compile(r"\s*[+-]?[0-9]+\s*")
_COUNTERS = {f.name for f in fields(QueryStats)} - {"ms"}


@dataclass(frozen=True, eq=False)
class VisibleSets:
    """An engine's recorded output by frame: the ids of the units that it drew, sorted int32, and
    what those units are: the scene's objects, or where groups were named, each such group as one
    unit in place of its objects."""

    frames: Mapping[int, Int32]
    stats: Mapping[int, QueryStats]
    units: Units


class DeclaredRaster(Raster):
    """A rasteriser that we know only by its declared tolerance: it has no picture to show."""

    def __init__(self, tolerance: RasterTolerance) -> None:
        self.tolerance = tolerance

    def item_buffer(self, camera: Camera) -> None:
        return None


class Replay(Culler):
    """Plays recorded visible sets back, so that they are judged like any culler."""

    name = "replay"
    summary = "an engine's recorded visible sets"
    timed = False

    def __init__(
        self,
        recorded: VisibleSets,
        path: CameraPath,
        promise: Promise = Promise.CONSERVATIVE,
        raster: RasterTolerance | None = None,
    ) -> None:
        self.promise = promise
        self.raster = DeclaredRaster(raster) if raster is not None else None
        self._recorded = recorded
        self._path = path
        self._coming = iter(recorded.frames)

    def prepare(self, scene: Scene) -> Units:
        return self._recorded.units

    def cull(self, camera: Camera) -> DrawnSet:
        frame = next(self._coming)
        assert camera is self._path.frames[frame], "cameras come in path order, each once"
        ids, stats = self._recorded.frames[frame], self._recorded.stats[frame]
        return DrawnSet(ids, stats, ordered=False)


def read_visible_sets(
    path: Path | str, scene: Scene, frames: Sequence[int], path_length: int
) -> VisibleSets:
    """Read a recording that has at least `frames` of a path of `path_length` frames.

    Raises InputError naming file and line for an unknown name or id, a missing, repeated or
    unexpected frame, or a file of another form.
    """
    source = str(path)
    readers = {".jsonl": _json_lines, ".ndjson": _json_lines, ".csv": _csv, ".parquet": _parquet}
    reader = readers.get(Path(path).suffix.lower())
    if reader is None:
        raise InputError(
            "recorded visible sets are .jsonl, .csv or .parquet", source=source, fix="rename it"
        )
    try:
        rows = list(reader(Path(path)))
    except InputError as error:
        raise error.at(source=source) from error
    except OSError as error:
        raise InputError(
            f"cannot read it: {error.strerror}", source=source, fix="check its name"
        ) from error
    except UnicodeDecodeError as error:
        raise InputError("it is not UTF-8 text", source=source, fix="write it anew") from error
    return _gather(rows, scene, frames, path_length, source)


@dataclass(frozen=True)
class _Row:
    place: str
    frame: int
    objects: list[int | str]
    stats: QueryStats


def _gather(
    rows: Iterable[_Row], scene: Scene, frames: Sequence[int], path_length: int, source: str
) -> VisibleSets:
    by_frame: dict[int, _Row] = {}
    for row in rows:
        if not 0 <= row.frame < path_length:
            raise InputError(
                f"frame {row.frame} is not on the path (0…{path_length - 1})",
                source=source,
                place=row.place,
                fix="record the frames of this path",
            )
        if row.frame in by_frame:
            raise InputError(
                f"frame {row.frame} comes twice (first at {by_frame[row.frame].place})",
                source=source,
                place=row.place,
                fix="keep one",
            )
        by_frame[row.frame] = row
    missing = sorted(set(frames) - set(by_frame))
    if missing:
        shown = ", ".join(map(str, missing[:5])) + (", …" if len(missing) > 5 else "")
        raise InputError(
            f"{len(missing)} of {len(frames)} frames are missing: {shown}",
            source=source,
            place="frame",
            fix='write a line for each frame, "visible": [] where nothing was drawn',
        )
    places: dict[str, str] = {}
    for frame in frames:
        for entry in by_frame[frame].objects:
            if isinstance(entry, str):
                places.setdefault(entry, by_frame[frame].place)
    named = Names(scene).resolved(places, source) if places else {}
    drawn: dict[int, list[tuple[int, ...]]] = {}
    for frame in frames:
        row = by_frame[frame]
        drawn[frame] = [
            named[entry]
            if isinstance(entry, str)
            else (_object_id(entry, scene, source, row.place),)
            for entry in row.objects
        ]
    units, unit_of = _units(scene, {objects for every in drawn.values() for objects in every})
    ids = {
        frame: np.unique(np.array([unit_of[objects] for objects in every], np.int32))
        for frame, every in drawn.items()
    }
    return VisibleSets(ids, {frame: by_frame[frame].stats for frame in frames}, units)


def _units(
    scene: Scene, named: set[tuple[int, ...]]
) -> tuple[Units, Mapping[tuple[int, ...], int]]:
    """The units of a recording, and the unit of each object or group that it names."""
    groups = sorted(objects for objects in named if len(objects) != 1)
    if not groups:
        return scene.object_units(), {(i,): i for i in range(scene.object_count)}
    grouped = {i for objects in groups for i in objects}
    single = [i for i in range(scene.object_count) if i not in grouped or (i,) in named]
    every = [*((i,) for i in single), *groups]
    offsets, triangles = [0], [np.zeros(0, np.int32)]
    for objects in every:
        for i in objects:
            low, high = scene.object_offsets[i : i + 2]
            triangles.append(np.arange(low, high, dtype=np.int32))
        offsets.append(
            offsets[-1] + sum(int(np.diff(scene.object_offsets[i : i + 2])[0]) for i in objects)
        )
    units = Units(np.array(offsets, np.int64), np.concatenate(triangles), "object or group")
    return units, {objects: unit for unit, objects in enumerate(every)}


def _object_id(entry: int, scene: Scene, source: str, place: str) -> int:
    if not 0 <= entry < scene.object_count:
        raise InputError(
            f"object id {entry} is not in the scene (0…{scene.object_count - 1})",
            source=source,
            place=place,
            fix="ids are dense, in the scene graph's depth-first order",
        )
    return entry


def _json_lines(path: Path) -> Iterator[_Row]:
    with path.open("rb") as lines:
        for number, line in enumerate(lines, start=1):
            place = f"line {number}"
            if not line.strip():
                continue
            try:
                row = parse_json(line)
            except InputError as error:
                raise InputError(
                    error.problem, place=place, fix="write an object a line"
                ) from error
            if not isinstance(row, dict) or "frame" not in row or "visible" not in row:
                raise InputError(
                    "a line needs 'frame' and 'visible'",
                    place=place,
                    fix='write {"frame": 0, "visible": [3, "name"]}',
                )
            if isinstance(row["frame"], bool) or not isinstance(row["frame"], int):
                raise InputError(f"frame is {row['frame']!r}", place=place, fix="give an integer")
            visible = row["visible"]
            if not isinstance(visible, list) or not all(
                isinstance(entry, (int, str)) and not isinstance(entry, bool) for entry in visible
            ):
                raise InputError(
                    "visible is not a list of ids and names", place=place, fix="write [3, 'name']"
                )
            yield _Row(place, row["frame"], visible, _stats(row.get("stats", {}), place))


def _stats(values: Any, place: str) -> QueryStats:
    if not isinstance(values, dict):
        raise InputError("stats is not an object", place=place, fix="write {…}")
    stats = QueryStats()
    for name, value in values.items():
        if name == "ms" and isinstance(value, dict) and all(map(is_duration, value.values())):
            stats.ms = {phase: float(ms) for phase, ms in value.items()}
        elif name in _COUNTERS and is_count(value):
            setattr(stats, name, value)
        else:
            raise InputError(
                f"stats has {name!r}: {value!r}",
                place=place,
                fix='"ms" holds milliseconds by phase; known counters, whole numbers, are '
                + ", ".join(sorted(_COUNTERS)),
            )
    return stats


def _csv(path: Path) -> Iterator[_Row]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.DictReader(file)
        columns = reader.fieldnames or []
        column = _object_column(list(columns))
        frames: dict[int, tuple[str, list[int | str]]] = {}
        while (row := _csv_row(reader)) is not None:
            place = f"line {reader.line_num}"
            if None in row or None in row.values():
                raise InputError(
                    "the row has not as many fields as the header",
                    place=place,
                    fix="quote names that hold commas",
                )
            frame = _whole(row["frame"], "frame", place)
            objects = frames.setdefault(frame, (place, []))[1]
            value = row[column]
            # A frame in which nothing was drawn is a row with an empty object.
            if value:
                by_id = column == "object_id"
                objects.append(_whole(value, column, place) if by_id else value)
    for frame, (place, objects) in frames.items():
        yield _Row(place, frame, objects, QueryStats())


def _csv_row(reader: csv.DictReader[str]) -> dict[str, str] | None:
    try:
        return next(reader, None)
    except csv.Error as error:
        raise InputError(
            f"not valid CSV: {error}", place=f"line {reader.line_num}", fix="write it anew"
        ) from error


def _parquet(path: Path) -> Iterator[_Row]:
    if path.is_dir():
        raise InputError("this is a folder, not a file", fix="give the file itself")
    if not path.exists():
        raise InputError("cannot read it: no such file", fix="check its name")
    try:
        # pyarrow takes a leading ~ for the home folder.
        table = pq.read_table(path.absolute())
    except (OSError, pa.ArrowException) as error:
        raise InputError(
            "it is not a Parquet file, or not a whole one", fix="write it anew"
        ) from error
    column = _object_column(table.column_names)
    frames: dict[int, list[int | str]] = {}
    for index, (frame, value) in enumerate(
        zip(table["frame"].to_pylist(), table[column].to_pylist(), strict=True)
    ):
        place = f"row {index}"
        objects = frames.setdefault(_whole(frame, "frame", place), [])
        if value is not None:
            if column == "object" and not isinstance(value, str):
                raise InputError(
                    f"object is {value!r}", place=place, fix="write names as text, or object_id"
                )
            objects.append(_whole(value, column, place) if column == "object_id" else value)
    for frame, objects in frames.items():
        yield _Row(f"frame {frame}", frame, objects, QueryStats())


def _object_column(columns: list[str]) -> str:
    if "frame" in columns:
        for column in ("object_id", "object"):
            if column in columns:
                return column
    raise InputError(
        f"columns are {', '.join(columns) or 'missing'}",
        place="header",
        fix="give 'frame' and 'object_id' or 'object'",
    )


def _whole(value: Any, column: str, place: str) -> int:
    try:
        if isinstance(value, int) and not isinstance(value, bool):
            return value
        if isinstance(value, str) and _WHOLE.fullmatch(value):
            return int(value)
    except ValueError:  # longer than Python reads
        pass
    raise InputError(f"{column} is {reprlib.repr(value)}", place=place, fix="give an integer")
