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
    DrawnSet,
    Promise,
    QueryStats,
    Raster,
    RasterTolerance,
    Recorded,
)
from visref.errors import InputError
from visref.memory import Budget
from visref.recordings.gathering import Gathering, missing_frames
from visref.recordings.rows import READERS, Row, reading
from visref.scene import Float64, Int32, Scene, Units

# Of every frame that says none: a record per frame would be much.
_NO_STATS = QueryStats()


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

    @classmethod
    def of(cls, gathering: Gathering, frames: Sequence[int], source: str) -> VisibleSets:
        """What was gathered, of these frames. Raises InputError as `Gathering.finish` does."""
        sets, stats, units, boxes = gathering.finish(source)
        return cls(
            {frame: sets[frame] for frame in frames},
            {frame: stats.get(frame, _NO_STATS) for frame in frames},
            units,
            boxes,
        )

    def only(self, frames: Sequence[int]) -> VisibleSets:
        """The same, of these frames alone."""
        return VisibleSets(
            {frame: self.sets[frame] for frame in frames},
            {frame: self.stats[frame] for frame in frames},
            self.units,
            self.boxes,
        )

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


class Replay(Recorded):
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
        self.recorded = recorded
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

    def seek(self, frame: int) -> None:
        self._done = next(
            place for place, (found, _, _) in enumerate(self._calls) if found == frame
        )
        self._look_ahead()

    def prepare(self, scene: Scene) -> Units:
        return self.recorded.units

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
        return DrawnSet(self.recorded.sets[frame][view], self.recorded.stats[frame], ordered=False)

    def bounds(self) -> Float64 | None:
        return self.recorded.boxes.get(self._frame)


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
    with reading(source):
        budget = Budget.of(max_memory)
        rows = reader(Path(file), budget)
        return _gather(rows, scene, frames, path, source, budget)


def _gather(
    rows: Iterable[Row],
    scene: Scene,
    frames: Sequence[int],
    path: CameraPath,
    source: str,
    budget: Budget,
) -> VisibleSets:
    wanted = set(frames)
    seen: dict[int, str] = {}
    gathering = Gathering(scene, budget)
    for row in rows:
        if not path.has(row.frame):
            raise InputError(
                f"frame {reprlib.repr(row.frame)} is not on the path "
                f"({path.numbers[0]}…{path.numbers[-1]})",
                source=source,
                place=row.place,
                fix="record the frames of this path",
            )
        if row.frame in seen:
            raise InputError(
                f"frame {row.frame} comes twice (first at {seen[row.frame]})",
                source=source,
                place=row.place,
                fix="keep one",
            )
        seen[row.frame] = row.place
        if row.frame in wanted:
            gathering.add(row, [camera.view for camera in path.views(row.frame)])
    if missing := sorted(wanted - set(seen)):
        raise missing_frames(missing, len(wanted), source)
    return VisibleSets.of(gathering, frames, source)
