"""One part's folder, read and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from visref.culler import Promise, RasterTolerance
from visref.errors import InputError
from visref.findings import Code, Finding
from visref.judging.again import Difference
from visref.judging.asking import Failure, Step
from visref.judging.bounds import BoundsTooSmall
from visref.judging.summary import Caster, Facts, Moved
from visref.picking import Shard, Stretch
from visref.recordings.truth_reading import TruthRows, read_rows
from visref.run_folder.checks import Told
from visref.run_folder.columns import table_inside
from visref.run_folder.facts import read_motion
from visref.run_folder.inside import file_inside, json_inside
from visref.run_folder.json_fields import Fields
from visref.run_folder.layout import (
    MANIFEST,
    OBJECTS_SCHEMA,
    PART,
    PART_CELLS,
    PART_SCHEMA,
    PART_UNITS,
    PART_UNITS_SCHEMA,
    SUPERFLUOUS_ROWS,
    TRUTH,
)
from visref.run_folder.part import PART_FORMAT, PART_VERSION, InputFindings
from visref.run_folder.read import RunFolder, read_objects, read_run
from visref.run_folder.rows import FrameRow, Motion
from visref.scene import Units

FIX = "give folders that `visref run` or `visref check` wrote with --shard"
_MOST_SHARDS = 1 << 20


@dataclass(frozen=True)
class CullerPart:
    """What a part says of a culler beside its verdicts. `names`: of the units that it names."""

    name: str
    promise: Promise
    unit_kind: str
    units: int
    failed: bool
    raster: RasterTolerance | None
    too_small: tuple[BoundsTooSmall, ...]
    ignored: Mapping[int, int]
    names: Mapping[int, str]


@dataclass(frozen=True, eq=False)
class Said:
    """`part.json`: see `visref.run_folder.part`."""

    shard: Shard | Stretch
    frames: tuple[int, ...]
    cuts: frozenset[int]
    pictures: tuple[int, ...]
    truth: bool
    facts: Facts
    inputs: InputFindings
    remarks: tuple[Finding, ...]
    moved: Motion | None
    paths: Mapping[int, str]
    again: tuple[Mapping[str, Difference], ...]
    cullers: tuple[CullerPart, ...]


@dataclass(frozen=True, eq=False)
class PartFolder:
    """A part's folder, but for the tables that there is a row of for all that was drawn: those are
    read when they are asked for. `manifest`: its JSON as it stands; `units`: of cullers that decide
    about others than objects."""

    folder: Path
    run: RunFolder
    manifest: dict[str, Any]
    said: Said
    units: dict[str, Units]
    truth: TruthRows | None

    @property
    def judged(self) -> tuple[int, ...]:
        """The frames of this part."""
        return tuple(self.said.shard.of(self.said.frames))

    def told(self, row: FrameRow) -> Told:
        """How many rows of objects.parquet are a verdict's."""
        listed = row.frame in self.said.pictures or self.run.manifest.settings.get(SUPERFLUOUS_ROWS)
        hidden = row.superfluous if listed else row.superfluous_confirmed or 0
        return Told(row.missed + (row.partly_missed or 0) + row.undecided, hidden)

    def objects(self) -> pa.Table:
        """objects.parquet. Raises InputError where it is spoilt."""
        told = [self.told(row) for row in self.run.frames]
        most = Told(sum(one.missed for one in told), sum(one.superfluous for one in told))
        return read_objects(self.folder, self.run.manifest, most).cast(OBJECTS_SCHEMA)

    def cells(self) -> list[dict[str, Any]]:
        """part.parquet, a row for each of `run.frames`. Raises InputError where it is spoilt."""
        cells: list[dict[str, Any]] = table_inside(
            self.folder,
            PART_CELLS,
            PART_SCHEMA,
            self.run.manifest.version,
            FIX,
            required=frozenset({"culler", "frame", "settled", "drawn"}),
            most=len(self.run.frames),
        ).to_pylist()
        own = [(row.culler, row.frame, row.view) for row in self.run.frames]
        if own != [(cell["culler"], cell["frame"], cell["view"]) for cell in cells]:
            raise self.error("its rows are not those of frames.parquet", PART_CELLS)
        return cells

    def error(self, problem: str, file: str = "", fix: str = FIX) -> InputError:
        """An error in this folder, or in a file of it."""
        return InputError(problem, source=str(self.folder / file if file else self.folder), fix=fix)


def read_part(folder: Path, truth: TruthRows | None = None) -> PartFolder:
    """`truth`: that of the file that it went by, where it has no copy. Raises InputError where it
    is no folder of a part, or a file of it is spoilt."""
    run = read_run(folder, objects=False)
    if not (folder / PART).exists():
        raise InputError("it is a run of its own, not a part", source=str(folder), fix=FIX)
    said = _said(Fields(json_inside(folder, PART, FIX), str(folder / PART), FIX))
    if truth is None and (folder / TRUTH).exists():
        truth = read_rows(file_inside(folder, TRUTH, FIX), run.manifest.scene.objects)
    part = PartFolder(
        folder, run, json_inside(folder, MANIFEST, FIX), said, _units(folder, run), truth
    )
    _check(part)
    return part


def _units(folder: Path, run: RunFolder) -> dict[str, Units]:
    """Raises InputError where a culler's units are others than it is said to have."""
    known = run.manifest.cullers
    table = table_inside(
        folder,
        PART_UNITS,
        PART_UNITS_SCHEMA,
        run.manifest.version,
        FIX,
        required=frozenset(PART_UNITS_SCHEMA.names),
        most=len(known),
        views=False,
    )
    found = {}
    columns = (table[name] for name in PART_UNITS_SCHEMA.names)
    for name, offsets, triangles in zip(*columns, strict=True):
        facts = known.get(name.as_py())
        ends, ids = offsets.values.to_numpy(), triangles.values.to_numpy()
        if (
            facts is None
            or len(ends) != facts.units + 1
            or (ends[0], ends[-1]) != (0, len(ids))
            or (np.diff(ends) < 0).any()
            or (len(ids) and not 0 <= ids.min() <= ids.max() < run.manifest.scene.triangles)
        ):
            source = str(folder / PART_UNITS)
            raise InputError("a culler's units are none", source=source, fix=FIX)
        found[name.as_py()] = Units(ends, ids, facts.unit_kind)
    return found


def _check(part: PartFolder) -> None:
    """That its files tell of the same."""
    known, judged = set(part.run.manifest.samples), set(part.judged)
    stretch = isinstance(part.said.shard, Stretch)
    if not (judged if stretch else set(part.said.frames)) <= known:
        raise part.error("it has frames that the path has not", PART)
    if not {row.frame for row in part.run.frames} <= judged:
        raise part.error("it judges frames that are not this part's", PART)
    if {culler.name for culler in part.said.cullers} != set(part.run.manifest.cullers):
        raise part.error(f"its cullers are not those of {MANIFEST}", PART)
    if part.truth is None:
        if part.said.cullers:
            raise part.error("its truth is missing", TRUTH)
        return
    wanted = {(frame, view) for frame in judged for view in part.run.manifest.samples[frame]}
    if not wanted <= part.truth.cells.keys():
        raise part.error("it lacks frames of this part", TRUTH)


def _said(top: Fields) -> Said:
    if top.plain().get("format") != PART_FORMAT or top.whole("version") != PART_VERSION:
        raise top.error(f"this is no part's (format {PART_FORMAT}, version {PART_VERSION})")
    frames = top.whole_list("frames")
    if list(frames) != sorted(set(frames)):
        raise top.error("they do not ascend", "frames")
    shard = _share(top, len(frames))
    inputs = top.inner("inputs")
    return Said(
        shard,
        frames,
        frozenset(top.whole_list("cuts")),
        top.whole_list("pictures"),
        top.flag("truth"),
        Facts(
            _caster(top, "caster"),
            _caster(top, "recorded"),
            _findings(top, "examined"),
            [
                Failure(
                    Step(one.whole("step", most=max(Step))),
                    None if one.is_null("frame") else one.whole("frame"),
                    _finding(one.inner("finding")),
                )
                for one in top.each("failures")
            ],
            [
                Moved(
                    one.whole("frame"),
                    one.hexadecimal("pixels"),
                    one.whole("triangle", least=-1),
                    one.text("owner"),
                    list(one.text_list("wanted")),
                )
                for one in top.each("rounded")
            ],
        ),
        InputFindings(
            _findings(inputs, "misaligned"),
            list(inputs.text_list("excused")),
            _findings(inputs, "notes"),
            _findings(inputs, "recorded"),
        ),
        tuple(_findings(top, "remarks")),
        None if top.is_null("moved") else read_motion(top.inner("moved")),
        {_id(name, top): path for name, path in top.inner("paths").texts().items()},
        tuple({spec: _difference(one) for spec, one in time.items()} for time in top.each("again")),
        tuple(_culler(one) for one in top.each("cullers")),
    )


def _share(top: Fields, frames: int) -> Shard | Stretch:
    if top.has("start"):
        stop = top.whole("stop", least=1, most=frames)
        return Stretch(top.whole("start", most=stop - 1), stop)
    count = top.whole("shards", least=1, most=_MOST_SHARDS)
    return Shard(top.whole("shard", least=1, most=count), count)


def _id(text: str, top: Fields) -> int:
    if not text.isascii() or not text.isdecimal():
        raise top.error("an object is a whole number", "paths")
    return int(text)


def _caster(top: Fields, name: str) -> Caster | None:
    if top.is_null(name):
        return None
    one = top.inner(name)
    exact = None if one.is_null("exact") else one.flag("exact")
    return Caster(one.text("name"), exact, one.flag("rebase_exact"))


def _findings(top: Fields, name: str) -> list[Finding]:
    return [_finding(one) for one in top.each(name)]


def _finding(one: Fields) -> Finding:
    return Finding(
        Code[one.text("code", among=tuple(Code.__members__))],
        one.text("message"),
        one.text("culler"),
        None if one.is_null("frame") else one.whole("frame"),
        one.text("object"),
    )


def _difference(one: Fields) -> Difference:
    return Difference(
        one.flag("failed"), one.flag("units"), one.whole_list("frames"), one.whole("asked")
    )


def _culler(one: Fields) -> CullerPart:
    small, ignored = one.each("too_small"), one.each("ignored")
    raster = None
    if not one.is_null("raster"):
        declared = one.inner("raster")
        bits = None if declared.is_null("depth_bits") else declared.whole("depth_bits", least=1)
        raster = RasterTolerance(declared.number("snap_px"), bits)
    return CullerPart(
        one.text("name"),
        Promise(one.text("promise", among=tuple(Promise))),
        one.text("unit_kind"),
        one.whole("units"),
        one.flag("failed"),
        raster,
        tuple(
            BoundsTooSmall(
                box.whole("unit"),
                box.whole("frames"),
                box.hexadecimal("outside"),
                box.whole("frame"),
                box.whole("samples"),
            )
            for box in small
        ),
        {unit.whole("unit"): unit.whole("frame") for unit in ignored},
        {unit.whole("unit"): unit.text("name") for unit in (*small, *ignored)},
    )


def cells_error(part: PartFolder, why: ValueError) -> InputError:
    """What is wrong with a row of `part.parquet`."""
    return part.error(str(why), PART_CELLS)
