"""Recorded visible sets: somebody's engine, judged without being linked to us.

JSON Lines, a line a frame: `{"frame": 0, "visible": [3, "name", …], "stats": {…}}`, where an
integer is an object id and a string a name (`visref.recordings.names`). The list is one set for all
views of the frame; where each has its own, `"visible": {"left": [3], "right": []}` names them all.
The same as CSV or Parquet with columns `frame`, `object_id` or `object`, and `view` (empty: all
views). Frames come in any order, each once.
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from visref.camera import ALL_VIEWS, Camera
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
from visref.recordings.names import Names, shown_name
from visref.recordings.rows import READERS, Row
from visref.scene import Float64, Int32, Scene, Units

# So many are listed of what may be many.
_VIEWS_SHOWN = 6


@dataclass(frozen=True, eq=False)
class VisibleSets:
    """An engine's recorded output: what it drew, and what its units are: the scene's objects, or
    where groups were named, each such group as one unit in place of its objects.

    `sets`: by frame, and in each by view, or under `ALL_VIEWS` for all views together, the ids of
    the units, ascending int32. `boxes`: of the frames that say which boxes were tested, (u, 2, 3)
    float64 in world space, one per unit; +inf and -inf where it says none.
    """

    sets: Mapping[int, Mapping[str, Int32]]
    stats: Mapping[int, QueryStats]
    units: Units
    boxes: Mapping[int, Float64] = field(default_factory=dict)

    @property
    def frames(self) -> dict[int, Int32]:
        """By frame, the set that is for all views together."""
        return {frame: views[ALL_VIEWS] for frame, views in self.sets.items() if ALL_VIEWS in views}


class DeclaredRaster(Raster):
    """A rasteriser that we know only by its declared tolerance: it has no picture to show."""

    def __init__(self, tolerance: RasterTolerance) -> None:
        self.tolerance = tolerance

    def item_buffer(self, camera: Camera) -> None:
        return None


class Replay(Culler):
    """Plays recorded visible sets back, so that they are judged like any culler: one set for all
    views in the frames that have one, else one per view. It knows what moved: nothing that was
    recorded changes by it."""

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
        # What will be asked for, in order: the frame, its cameras, and the view of the set.
        self._calls: list[tuple[int, tuple[Camera, ...], str]] = []
        for frame, sets in recorded.sets.items():
            cameras = path.views(frame)
            if ALL_VIEWS in sets:
                self._calls.append((frame, cameras, ALL_VIEWS))
            else:
                self._calls += [(frame, (camera,), camera.view) for camera in cameras]
        self._done, self._frame = 0, -1
        self._look_ahead()

    def _look_ahead(self) -> None:
        """`joint` says how the next set is asked for."""
        coming = self._calls[self._done : self._done + 1]
        self.joint = any(len(cameras) > 1 for _, cameras, _ in coming)

    def prepare(self, scene: Scene) -> Units:
        return self._recorded.units

    def update(self, scene: Scene) -> None:
        """What was recorded stands, whatever moves."""

    def cull(self, camera: Camera) -> DrawnSet:
        return self.cull_joint((camera,))

    def cull_joint(self, cameras: Sequence[Camera]) -> DrawnSet:
        frame, planned, view = self._calls[self._done]
        for asked, expected in zip(cameras, planned, strict=True):
            same = np.array_equal(asked.world_from_camera, expected.world_from_camera)
            assert (same, asked.view) == (True, expected.view), "cameras come in order, each once"
        self._frame = frame
        self._done += 1
        self._look_ahead()
        return DrawnSet(
            self._recorded.sets[frame][view], self._recorded.stats[frame], ordered=False
        )

    def bounds(self) -> Float64 | None:
        return self._recorded.boxes.get(self._frame)


def read_visible_sets(
    file: Path | str,
    scene: Scene,
    frames: Sequence[int],
    path: CameraPath,
    *,
    max_memory: int | None = None,
) -> VisibleSets:
    """Read a recording that has at least `frames` of a path.

    `max_memory`: bytes that it may take, by default a share of what is free.

    Raises InputError naming file and line for an unknown name or id, a missing, repeated or
    unexpected frame, an unknown or missing view, a file of another form, or one that takes more
    than the limit.
    """
    source = str(file)
    reader = READERS.get(Path(file).suffix.lower())
    if reader is None:
        raise InputError(
            "recorded visible sets are .jsonl, .csv or .parquet", source=source, fix="rename it"
        )
    try:
        rows = list(reader(Path(file), Budget.of(max_memory)))
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
    return _gather(rows, scene, frames, path, source)


def _gather(
    rows: Iterable[Row], scene: Scene, frames: Sequence[int], path: CameraPath, source: str
) -> VisibleSets:
    by_frame: dict[int, Row] = {}
    for row in rows:
        if not path.has(row.frame):
            raise InputError(
                f"frame {reprlib.repr(row.frame)} is not on the path "
                f"({path.numbers[0]}…{path.numbers[-1]})",
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
        _check_views(by_frame[frame], [camera.view for camera in path.views(frame)], source)
        for objects in by_frame[frame].sets.values():
            for entry in objects:
                if isinstance(entry, str):
                    places.setdefault(entry, by_frame[frame].place)
        for name in by_frame[frame].bounds:
            places.setdefault(name, by_frame[frame].place)
    named = Names(scene).resolved(places, source) if places else {}

    def meant(entry: int | str, row: Row) -> tuple[int, ...]:
        if isinstance(entry, str):
            return named[entry]
        return (_object_id(entry, scene, source, row.place),)

    drawn = {
        frame: {
            view: [meant(entry, by_frame[frame]) for entry in objects]
            for view, objects in by_frame[frame].sets.items()
        }
        for frame in frames
    }
    every = {one for sets in drawn.values() for objects in sets.values() for one in objects}
    every |= {named[name] for frame in frames for name in by_frame[frame].bounds}
    units, unit_of = _units(scene, every)
    boxes = {}
    for frame in frames:
        if by_frame[frame].bounds:
            boxes[frame] = np.tile(np.array([[np.inf], [-np.inf]]), (units.count, 1, 3))
            for name, box in by_frame[frame].bounds.items():
                boxes[frame][unit_of[named[name]]] = box
    sets = {
        frame: {
            view: np.unique(np.array([unit_of[one] for one in objects], np.int32))
            for view, objects in of_frame.items()
        }
        for frame, of_frame in drawn.items()
    }
    return VisibleSets(sets, {frame: by_frame[frame].stats for frame in frames}, units, boxes)


def _check_views(row: Row, views: list[str], source: str) -> None:
    """Raise InputError unless a frame has one set for all its views, or one for each."""
    if list(row.sets) == [ALL_VIEWS]:
        return
    known = ", ".join(map(shown_name, views[:_VIEWS_SHOWN]))
    fix = f"write a list for all views, or one for each of {known}"
    if views == [ALL_VIEWS]:
        fix = "the frame has one view without a name: write a list"
    unknown = [view for view in row.sets if view not in views]
    if unknown:
        problem = f"the frame has no view {shown_name(unknown[0])}"
        if unknown[0] == ALL_VIEWS:
            problem = "it has a set for all views and others by view"
    elif missing := [view for view in views if view not in row.sets]:
        problem = f"view {shown_name(missing[0])} is missing"
    else:
        return
    raise InputError(f"frame {row.frame}: {problem}", source=source, place=row.place, fix=fix)


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
