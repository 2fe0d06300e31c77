"""Recorded visible sets: somebody's engine, judged without being linked to us.

JSON Lines, a line a frame: `{"frame": 0, "visible": [3, "name", …], "stats": {…}}`, where an
integer is an object id and a string a name (`visref.recordings.names`). The same as CSV or Parquet
with columns `frame` and `object_id` or `object`. Frames come in any order, each once.
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import (
    Culler,
    DrawnSet,
    Promise,
    QueryStats,
    Raster,
    RasterTolerance,
)
from visref.errors import InputError
from visref.memory import Budget
from visref.recordings.names import Names
from visref.recordings.rows import READERS, Row
from visref.scene import Int32, Scene, Units


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

    def update(self, scene: Scene) -> None:
        """What was recorded stands, whatever moves."""

    def cull(self, camera: Camera) -> DrawnSet:
        frame = next(self._coming)
        asked, planned = camera.world_from_camera, self._path.cameras[frame].world_from_camera
        assert np.array_equal(asked, planned), "cameras come in path order, each once"
        ids, stats = self._recorded.frames[frame], self._recorded.stats[frame]
        return DrawnSet(ids, stats, ordered=False)


def read_visible_sets(
    path: Path | str,
    scene: Scene,
    frames: Sequence[int],
    path_length: int,
    *,
    max_memory: int | None = None,
) -> VisibleSets:
    """Read a recording that has at least `frames` of a path of `path_length` frames.

    `max_memory`: bytes that it may take, by default a share of what is free.

    Raises InputError naming file and line for an unknown name or id, a missing, repeated or
    unexpected frame, a file of another form, or one that takes more than the limit.
    """
    source = str(path)
    reader = READERS.get(Path(path).suffix.lower())
    if reader is None:
        raise InputError(
            "recorded visible sets are .jsonl, .csv or .parquet", source=source, fix="rename it"
        )
    try:
        rows = list(reader(Path(path), Budget.of(max_memory)))
    except InputError as error:
        raise error.at(source=source) from error
    except OSError as error:
        raise InputError(
            f"cannot read it: {error.strerror}", source=source, fix="check its name"
        ) from error
    except MemoryError as error:
        raise InputError(
            "it needs more memory than there is", source=source, fix="record fewer frames at once"
        ) from error
    except UnicodeDecodeError as error:
        raise InputError("it is not UTF-8 text", source=source, fix="write it anew") from error
    return _gather(rows, scene, frames, path_length, source)


def _gather(
    rows: Iterable[Row], scene: Scene, frames: Sequence[int], path_length: int, source: str
) -> VisibleSets:
    by_frame: dict[int, Row] = {}
    for row in rows:
        if not 0 <= row.frame < path_length:
            raise InputError(
                f"frame {reprlib.repr(row.frame)} is not on the path (0…{path_length - 1})",
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
            f"object id {reprlib.repr(entry)} is not in the scene (0…{scene.object_count - 1})",
            source=source,
            place=place,
            fix="ids are dense, in the scene graph's depth-first order",
        )
    return entry
