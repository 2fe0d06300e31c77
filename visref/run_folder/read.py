"""Reading a run folder back."""

from __future__ import annotations

import statistics
from collections import defaultdict
from dataclasses import MISSING, dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from visref.judging.status import Exit
from visref.run_folder.checks import (
    MAX_OBJECT_ROWS,
    MAX_PHASES,
    Told,
    check_frames,
    check_is_run,
    check_objects,
    check_timings,
    check_verdict,
    judged_views,
    told_rows,
)
from visref.run_folder.columns import table_inside
from visref.run_folder.facts import FIX, read_manifest, read_verdict
from visref.run_folder.inside import json_inside
from visref.run_folder.layout import (
    CULL_PHASE,
    FIRST_PHASE,
    FRAMES,
    FRAMES_SCHEMA,
    MANIFEST,
    OBJECTS,
    OBJECTS_REPEATED,
    OBJECTS_SCHEMA,
    TIMINGS,
    TIMINGS_SCHEMA,
    TRUTH_PHASE,
    UNNAMED_VIEW,
    VERDICT,
    ObjectKind,
)
from visref.run_folder.rows import (
    FrameRow,
    HiddenUnit,
    LostObject,
    Manifest,
    RunVerdict,
    TimingRow,
    Witness,
)
from visref.scene import Int32, Int64

# What a row that tells of a miss need not have.
_NOT_OF_A_MISS = ("culler", "unit", "cause", "samples", "occluder", "occluder_name")
_HIDDEN = ("unit", "name", "frame", "view", "samples", "occluder", "occluder_name", "x", "y")


@dataclass(frozen=True, eq=False)
class RunFolder:
    """A run folder's content. `frames` and `timings` are in file order; `objects` has the columns
    of `OBJECTS_SCHEMA`, one row per culler, frame, view and object."""

    folder: Path
    manifest: Manifest
    verdict: RunVerdict
    frames: list[FrameRow]
    timings: list[TimingRow]
    objects: pa.Table

    @property
    def exit(self) -> Exit:
        return Exit(self.verdict.exit_status)

    @property
    def scene_name(self) -> str:
        """The scene's file name, without its folders."""
        return Path(self.manifest.scene.source).name or "scene"

    @cached_property
    def cullers(self) -> tuple[str, ...]:
        """Their names in the order they ran; those that never judged a frame come last."""
        ran = dict.fromkeys(row.culler for row in self.frames)
        return tuple(dict.fromkeys([*ran, *self.verdict.cullers]))

    @cached_property
    def frame_numbers(self) -> tuple[int, ...]:
        return tuple(sorted({row.frame for row in self.frames}))

    @cached_property
    def frames_of(self) -> dict[str, list[FrameRow]]:
        """Each culler's rows of frames.parquet, by frame."""
        result: dict[str, list[FrameRow]] = {culler: [] for culler in self.cullers}
        for row in sorted(self.frames, key=lambda row: row.frame):
            result[row.culler].append(row)
        return result

    @cached_property
    def cull_ms(self) -> dict[str, dict[int, float]]:
        """Milliseconds by culler and frame, all views of the frame together."""
        result: dict[str, dict[int, float]] = defaultdict(lambda: defaultdict(float))
        for row in self.timings:
            if row.phase == CULL_PHASE:
                result[row.culler][row.frame] += row.ms
        return {culler: dict(times) for culler, times in result.items()}

    @cached_property
    def warm_ms(self) -> dict[str, dict[int, float]]:
        """The same without each culler's first frame in a process, in which it may have compiled
        what it needs; of records of old, which do not say which that was, without its first."""
        first = {(row.culler, row.frame) for row in self.timings if row.phase == FIRST_PHASE}
        if not first:
            first = {(culler, min(times)) for culler, times in self.cull_ms.items() if times}
        return {
            culler: {
                frame: ms for frame, ms in sorted(times.items()) if (culler, frame) not in first
            }
            for culler, times in self.cull_ms.items()
        }

    @cached_property
    def truth_ms(self) -> float | None:
        """The median milliseconds of casting a truth, None if none was cast."""
        times = [row.ms for row in self.timings if row.phase == TRUTH_PHASE]
        return statistics.median(times) if times else None

    def size(self, frame: int, view: str = UNNAMED_VIEW) -> tuple[int, int]:
        """Width and height of a view, in samples."""
        definition = self.manifest.samples[frame][view]
        return int(definition["width"]), int(definition["height"])

    def views_of(self, row: FrameRow) -> tuple[str, ...]:
        """The views that the row's drawn set is for: its own, or all of its frame."""
        return judged_views(self.manifest, row.frame, row.view)

    def samples_of(self, row: FrameRow) -> int:
        """How many samples the row's views have."""
        sizes = (self.size(row.frame, view) for view in self.views_of(row))
        return sum(width * height for width, height in sizes)

    @cached_property
    def sizes(self) -> frozenset[tuple[int, int]]:
        """Width and height of all judged views."""
        return frozenset(
            self.size(row.frame, view) for row in self.frames for view in self.views_of(row)
        )

    def resolution(self) -> str:
        """The judged frames' size in words."""
        if len(self.sizes) != 1:
            return "several sizes"
        ((width, height),) = self.sizes
        return f"{width} × {height}"

    def lost_objects(self, culler: str) -> list[LostObject]:
        """Objects with a confirmed miss, the most samples lost first."""
        table = self.misses(culler, ObjectKind.CONFIRMED)
        if not len(table):
            return []
        obj, frame, lost = (table[name].to_numpy() for name in ("object", "frame", "pixels"))
        partly = table["partly"].to_numpy(zero_copy_only=False)
        # Of each object's misses the worst first, and of equals that of the first frame.
        order = np.lexsort((frame, -lost, obj))
        objects, first = np.unique(obj[order], return_index=True)
        worst = table.take(order[first]).drop_columns(_NOT_OF_A_MISS).to_pylist()
        # Each frame of an object once, in however many views.
        in_frame = np.unique((obj.astype(np.int64) << 32) | frame) >> 32
        columns = (
            _sums_by(objects, obj, lost),
            _sums_by(objects, in_frame, np.ones(len(in_frame), np.int64)),
            _sums_by(objects, obj, np.ones(len(obj), np.int64)),
            _sums_by(objects, obj, partly.astype(np.int64)),
        )
        rows = zip(*(column.tolist() for column in columns), worst, strict=True)
        found = [
            LostObject(samples, frames, misses, part, Witness(**row))
            for samples, frames, misses, part, row in rows
        ]
        return sorted(found, key=lambda one: (-one.samples, one.worst.object))

    def misses(self, culler: str, kind: ObjectKind) -> pa.Table:
        """The culler's rows of one kind in `objects`. There are few: what is superfluous, of which
        there may be tens of millions of rows, is none of them."""
        if not len(self.objects):
            return self.objects
        mine = pc.and_(
            pc.equal(self.objects["culler"], culler), pc.equal(self.objects["kind"], kind.value)
        )
        return self.objects.filter(mine)

    def hidden_units(self, culler: str) -> list[HiddenUnit]:
        """Superfluous units that exact arithmetic confirmed against the culler's promise, the most
        often drawn first."""
        if not len(self.objects):
            return []
        mine = pc.and_(
            pc.equal(self.objects["culler"], culler), pc.is_valid(self.objects["samples"])
        )
        table = self.objects.filter(mine).select(_HIDDEN)
        # Of each unit the frame with most samples, and of those the first.
        order = [("unit", "ascending"), ("samples", "descending"), ("frame", "ascending")]
        table = table.sort_by(order)
        _, first = np.unique(table["unit"].to_numpy(), return_index=True)
        rows = table.take(first).to_pylist()
        counted = table.group_by("unit").aggregate([("frame", "count_distinct")]).to_pylist()
        frames = {row["unit"]: row["frame_count_distinct"] for row in counted}
        units = [
            HiddenUnit(**{**row, "name": row["name"] or ""}, frames=frames[row["unit"]])
            for row in rows
        ]
        return sorted(units, key=lambda one: (-one.frames, one.unit))

    def superfluous_causes(self, culler: str) -> dict[str, int]:
        """Superfluous units by cause (`visref.run_folder.causes`), summed over the frames that were
        explained; empty where none was."""
        if not len(self.objects):
            return {}
        mine = pc.and_(
            pc.equal(self.objects["culler"], culler),
            pc.equal(self.objects["kind"], ObjectKind.SUPERFLUOUS.value),
        )
        counts = pc.value_counts(self.objects["cause"].filter(mine).drop_null())
        return {row["values"]: row["counts"] for row in counts.to_pylist()}

    def superfluous_listed(self, culler: str) -> int:
        """How many rows tell of what was drawn for nothing: of all that is counted, or of the
        frames alone that were picked for pictures, and of what a promise forbids."""
        mine = pc.and_(
            pc.equal(self.objects["culler"], culler),
            pc.equal(self.objects["kind"], ObjectKind.SUPERFLUOUS.value),
        )
        return int(pc.sum(mine).as_py() or 0)

    def superfluous_units(self, culler: str) -> list[tuple[int, str, int]]:
        """(unit, name, frames) of what was drawn for nothing, as far as it is listed, the most
        often first; the name is empty unless units are objects."""
        # Only what is counted: of small units there are tens of millions of rows.
        table = self.objects.select(["culler", "kind", "unit", "name", "frame"])
        mine = pc.equal(table["culler"], culler)
        table = table.filter(pc.and_(mine, pc.equal(table["kind"], ObjectKind.SUPERFLUOUS.value)))
        counted = table.group_by(["unit", "name"]).aggregate([("frame", "count_distinct")])
        rows = [
            (row["unit"], row["name"] or "", row["frame_count_distinct"])
            for row in counted.to_pylist()
        ]
        return sorted(rows, key=lambda row: (-row[2], row[0]))


def _sums_by(objects: Int32, obj: Int32 | Int64, values: Int64) -> Int64:
    """For each of `objects`, ascending, the sum of its `values`."""
    sums = np.zeros(len(objects), np.int64)
    np.add.at(sums, np.searchsorted(objects, obj), values)
    return sums


def read_run(folder: Path, *, objects: bool = True) -> RunFolder:
    """Read a run folder. Without its `objects`, of which there may be tens of millions, that table
    is empty. Raises InputError if it is none, or a file of it is spoilt."""
    check_is_run(folder)
    manifest = read_manifest(json_inside(folder, MANIFEST, FIX), str(folder / MANIFEST))
    version = manifest.version
    verdict = read_verdict(json_inside(folder, VERDICT, FIX), str(folder / VERDICT), version)
    check_verdict(folder, manifest, verdict)
    cells = sum(map(len, manifest.samples.values()))
    frames = table_inside(
        folder,
        FRAMES,
        FRAMES_SCHEMA,
        version,
        FIX,
        required=_without_default(FrameRow),
        most=cells * len(manifest.cullers),
    )
    timings = table_inside(
        folder,
        TIMINGS,
        TIMINGS_SCHEMA,
        version,
        FIX,
        required=_without_default(TimingRow),
        most=cells * (len(manifest.cullers) + 1) * MAX_PHASES,
    )
    check_frames(folder, manifest, verdict, frames)
    check_timings(folder, manifest, timings)
    table = OBJECTS_SCHEMA.empty_table()
    if objects:
        table = read_objects(folder, manifest, told_rows(frames))
    return RunFolder(
        folder,
        manifest,
        verdict,
        [FrameRow(**row) for row in frames.to_pylist()],
        [TimingRow(**row) for row in timings.to_pylist()],
        table,
    )


def read_objects(folder: Path, manifest: Manifest, told: Told) -> pa.Table:
    """The table of objects of a run folder whose frames tell of so many rows. Raises InputError if
    it is spoilt."""
    table = table_inside(
        folder,
        OBJECTS,
        OBJECTS_SCHEMA,
        manifest.version,
        FIX,
        required=frozenset({"culler", "frame", "kind"}),
        repeated=OBJECTS_REPEATED,
        most=min(MAX_OBJECT_ROWS, sum(told)),
    )
    check_objects(folder, manifest, table, told)
    return table


def _without_default(row: type[FrameRow] | type[TimingRow]) -> frozenset[str]:
    """The columns that a row must have."""
    return frozenset(field.name for field in fields(row) if field.default is MISSING)
