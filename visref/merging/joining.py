"""What the parts found, gone through again in order as one run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from visref.culler import QueryStats
from visref.errors import InputError
from visref.judging.again import Difference, mark_unsteady
from visref.judging.ages import Followed
from visref.judging.asking import Failure, Step
from visref.judging.bounds import BoundsTooSmall
from visref.judging.judge import Counts, FrameVerdict
from visref.judging.misses import CODES, MissColumns, Misses, MissKind
from visref.judging.outcome import ALL_VIEWS, CullerRecord, FrameRecord, RunOutcome
from visref.judging.policy import Policy
from visref.judging.policy_file import policy_of
from visref.judging.rasters import looser
from visref.judging.review import Review
from visref.judging.summary import Facts, conclude
from visref.judging.superfluous import Superfluous
from visref.merging.reading import FIX, PartFolder, cells_error
from visref.run_folder.aside import Aside
from visref.run_folder.layout import (
    COUNTS,
    MANIFEST,
    MISS_KINDS,
    OBJECTS,
    OBJECTS_SCHEMA,
    ObjectKind,
)
from visref.run_folder.part import drawn_units, unpacked
from visref.run_folder.rows import FrameRow
from visref.scene import OBJECT, Int32

_KIND, _AGE = (OBJECTS_SCHEMA.get_field_index(name) for name in ("kind", "age"))


class _Told(dict[int, str]):
    """Texts by id; InputError for one that no part tells, though it should."""

    def __init__(self, source: str) -> None:
        self._source = source

    def __missing__(self, index: int) -> str:
        problem = f"no part says what number {index} is called"
        raise InputError(problem, source=self._source, fix=FIX)


class KnownNames:
    """What the parts call objects, by id: their names, their paths, and the name of whose a
    triangle is that hides something. `source`: the folder that an error names."""

    def __init__(self, source: str) -> None:
        self.names = _Told(source)
        self.paths = _Told(source)
        self.owners = _Told(source)

    def owner_name(self, triangle: int) -> str:
        return self.owners[triangle]


@dataclass(frozen=True, eq=False)
class Cell:
    """A verdict of a part, as the whole run has it. `row`: of frames.parquet; `objects`: its rows
    of objects.parquet; `settled`: whether samples were looked at; `drawn`: (k,) int32, the units
    drawn, ascending; `followed`: of units finer than objects, by which an object was missed."""

    part: PartFolder
    record: FrameRecord
    spec: str
    row: dict[str, Any]
    objects: pa.Table
    settled: bool
    drawn: Int32
    followed: Followed | None


@dataclass(eq=False)
class Joined:
    """The whole run. `ends`: by culler, how many parts count: after it broke down it is not asked
    again."""

    outcome: RunOutcome
    names: KnownNames
    ends: dict[str, int] = field(default_factory=dict)


def join(
    parts: Sequence[PartFolder],
    on_cell: Callable[[Cell], None],
    numbers: Sequence[int] | None = None,
) -> Joined:
    """Go through the verdicts of all parts, in order, and conclude. `on_cell` is told of each.
    `numbers`: of the path's frames, where the parts do not say them."""
    policy = _policy(parts)
    records = {
        one.name: CullerRecord(
            one.name, one.promise, one.unit_kind, one.units, max_undecided=policy.max_undecided
        )
        for one in parts[0].said.cullers
    }
    joined = Joined(
        RunOutcome(list(records.values()), policy=policy), KnownNames(str(parts[0].folder))
    )
    joined.ends = {spec: _end(parts, spec) for spec in records}
    review, held = Review(policy, joined.names), Aside()
    for number, part in enumerate(parts):
        joined.names.paths.update(part.said.paths)
        used = {spec for spec, end in joined.ends.items() if number < end}
        try:
            _go_through(part, used, records, review, joined.names, held, on_cell)
        except InputError:
            raise
        except ValueError as error:
            raise cells_error(part, error) from error
        for one in part.said.cullers:
            if one.name in used:
                if one.unit_kind == OBJECT:
                    joined.names.names.update(one.names)
                _add_facts(records[one.name], part, one.name)
    facts = _facts(parts, joined)
    if numbers is None:
        numbers = parts[0].run.manifest.path.numbers
    conclude(joined.outcome, facts, review.accepting, numbers, joined.names)
    mark_unsteady(joined.outcome, _again(parts, joined))
    parts[0].said.inputs.put_first(joined.outcome)
    return joined


def _policy(parts: Sequence[PartFolder]) -> Policy:
    """The parts' policy, asked on the last of the days on which they were run."""
    first = parts[0]
    said = first.manifest.get("policy")
    if said is None:
        return Policy()
    plain = {
        **said,
        "waive": [
            {name: value for name, value in waiver.items() if value not in (None, [])}
            for waiver in said["waive"]
        ],
    }
    try:
        policy = policy_of({name: plain[name] for name in plain if name not in _NOT_OF_A_FILE})
    except InputError as error:
        raise error.at(source=str(first.folder / MANIFEST)) from error
    days = [part.manifest["policy"]["today"] for part in parts]
    return replace(
        policy,
        today=max((date.fromisoformat(day) for day in days if day is not None), default=None),
        source=said["source"],
        sha256=said["sha256"],
        remarks=first.said.remarks,
    )


_NOT_OF_A_FILE = ("source", "sha256", "today")


def _end(parts: Sequence[PartFolder], spec: str) -> int:
    """How many parts count of a culler: those to the first in which it broke down."""
    for number, part in enumerate(parts):
        if any(
            one.finding.culler == spec and one.step is not Step.CLOSE
            for one in part.said.facts.failures
        ):
            return number + 1
    return len(parts)


def _go_through(
    part: PartFolder,
    used: set[str],
    records: dict[str, CullerRecord],
    review: Review,
    names: KnownNames,
    held: Aside,
    on_cell: Callable[[Cell], None],
) -> None:
    """Review the verdicts of a part. Raises ValueError where its rows do not go together."""
    table = part.objects()
    _check_rows(part, table)
    truth = None if part.truth is None else part.truth.recorded
    samples = part.run.manifest.samples
    rows = iter(zip(part.run.frames, part.cells(), strict=True))
    following = next(rows, None)
    start = 0
    for frame in part.judged:
        cut = frame in part.said.cuts
        if truth is not None:
            count = part.run.manifest.scene.objects
            seen = {view: truth.seen(frame, view, count) for view in samples[frame]}
            review.look(frame, cut, seen)
        while following is not None and following[0].frame == frame:
            row, kept = following
            stop = start + sum(part.told(row))
            mine = table.slice(start, stop - start)
            start, following = stop, next(rows, None)
            if row.culler not in used:
                continue
            record = records[row.culler]
            found = _record(row, mine, samples[frame], names)
            followed = unpacked(kept, record.unit_count)
            verdict = review.verdict(found, record.promise, row.culler, cut, followed)
            found = replace(found, verdict=verdict)
            record.frames.append(replace(found, verdict=held(verdict)))
            on_cell(
                Cell(
                    part,
                    found,
                    row.culler,
                    {**_values(row), **vars(verdict.counts)},
                    _reviewed(mine, verdict),
                    kept["settled"],
                    drawn_units(kept["drawn"], record.unit_count),
                    followed,
                )
            )
    if following is not None:
        raise ValueError("its frames do not ascend")


def _values(row: FrameRow) -> dict[str, Any]:
    return {name: getattr(row, name) for name in row.__dataclass_fields__}


def _check_rows(part: PartFolder, table: pa.Table) -> None:
    """That objects.parquet has the rows of each verdict together, ordered as frames.parquet is."""
    rows = part.run.frames
    counts = [sum(part.told(row)) for row in rows]
    fits = sum(counts) == len(table)
    for name in ("culler", "frame", "view"):
        if not fits:
            break
        values = pa.array([getattr(row, name) for row in rows], OBJECTS_SCHEMA.field(name).type)
        known = pc.unique(values)
        wanted = np.repeat(pc.index_in(values, known).to_numpy(), counts)
        given = pc.index_in(table[name], known).fill_null(-1).to_numpy()
        if name == "view":
            # A miss in a set for several views is told of the one that shows it.
            joint = pc.index_in(pa.scalar(ALL_VIEWS), known).as_py()
            given = np.where(wanted == joint, wanted, given) if joint is not None else given
        fits = np.array_equal(given, wanted)
    if not fits:
        raise part.error("its rows are not those that frames.parquet counts", OBJECTS)


def _record(row: FrameRow, mine: pa.Table, samples: Any, names: KnownNames) -> FrameRecord:
    """A verdict as its part has it."""
    lost = row.missed + (row.partly_missed or 0)
    misses = _misses(mine.slice(0, lost), samples, names)
    rest = mine.slice(lost)
    hidden = rest.filter(pc.is_valid(rest["samples"])).to_pylist()
    undecided = rest.filter(pc.equal(rest["kind"], ObjectKind.UNDECIDED.value)).to_pylist()
    names.names.update({one["object"]: one["name"] for one in undecided})
    width = next(iter(samples.values()))["width"] if row.view == ALL_VIEWS else None
    verdict = FrameVerdict(
        Counts(**{name: getattr(row, name) or 0 for name in COUNTS}),
        misses,
        undecided_objects=np.array([one["object"] for one in undecided], np.int32),
        owned=row.owned,
        confirmed_superfluous=tuple(_hidden(one, samples, row.view, names) for one in hidden),
    )
    return FrameRecord(
        row.frame,
        row.view,
        width if width is not None else samples[row.view]["width"],
        verdict,
        QueryStats(),
        row.triangles_drawn or 0,
        row.corrections,
        row.image_pixels_differ,
    )


def _misses(rows: pa.Table, samples: Any, names: KnownNames) -> Misses:
    """What rows of objects.parquet say was missed."""
    views = tuple(samples)
    lists = {name: rows[name].to_pylist() for name in ("object", "name", "kind", "view")}
    if not set(lists["kind"]).issubset(MISS_KINDS) or not set(lists["view"]).issubset(views):
        raise ValueError("a miss has no kind, or no view")
    names.names.update(zip(lists["object"], lists["name"], strict=True))
    place = {view: number for number, view in enumerate(views)}
    view = np.array([place[one] for one in lists["view"]], np.int16)
    width = np.array([int(samples[one]["width"]) for one in views], np.int32)[view]

    def column(name: str, absent: float | bool = 0) -> NDArray[Any]:
        values: NDArray[Any] = pc.fill_null(rows[name], absent).to_numpy()
        return values

    return Misses(
        MissColumns(
            column("object"),
            np.array([CODES[MissKind(one)] for one in lists["kind"]], np.int8),
            column("pixels"),
            column("owned"),
            column("y").astype(np.int64) * width + column("x"),
            column("triangle"),
            column("depth"),
            column("margin_px", np.nan),
            column("margin_depth", np.nan),
            column("partly", False).astype(np.bool_),
            view,
            width,
            column("age", -1),
        ),
        views,
    )


def _hidden(one: dict[str, Any], samples: Any, view: str, names: KnownNames) -> Superfluous:
    """A hidden unit. Which of several views its sample is in, nothing that follows asks."""
    if one["name"] is not None:
        names.names[one["object"]] = one["name"]
    if one["occluder"] is None:
        return Superfluous(one["unit"], one["samples"], -1, -1)
    names.owners[one["occluder"]] = one["occluder_name"]
    width = int(samples[view]["width"]) if view in samples else 0
    return Superfluous(
        one["unit"], one["samples"], one["occluder"], one["y"] * width + one["x"], view, width
    )


def _reviewed(mine: pa.Table, verdict: FrameVerdict) -> pa.Table:
    """The rows with the misses' kinds and ages as the whole run has them."""
    lost = len(verdict.misses)
    if not lost:
        return mine
    kinds = pa.array(verdict.misses.kind_names(), pa.string())
    age = verdict.misses.columns.age
    ages = pa.array(age, pa.int64(), mask=age < 0)
    told = mine.slice(0, lost)
    told = told.set_column(_KIND, OBJECTS_SCHEMA.field(_KIND), kinds)
    told = told.set_column(_AGE, OBJECTS_SCHEMA.field(_AGE), ages)
    return pa.concat_tables([told, mine.slice(lost)])


def _add_facts(record: CullerRecord, part: PartFolder, spec: str) -> None:
    """What a part says of a culler beside its verdicts."""
    (one,) = (culler for culler in part.said.cullers if culler.name == spec)
    record.failed |= one.failed
    if one.raster is not None:
        record.raster = looser(record.raster, one.raster)
    for unit, frame in one.ignored.items():
        record.ignored.setdefault(unit, frame)
    known = {small.unit: small for small in record.too_small}
    for small in one.too_small:
        sum_ = known.setdefault(small.unit, BoundsTooSmall(small.unit))
        sum_.frames += small.frames
        sum_.samples += small.samples
        if small.outside > sum_.outside:
            sum_.outside, sum_.frame = small.outside, small.frame
    record.too_small = list(known.values())


def _facts(parts: Sequence[PartFolder], joined: Joined) -> Facts:
    """What the whole run found beside verdicts."""
    facts = Facts(recorded=parts[0].said.facts.recorded)
    for number, part in enumerate(parts):
        its = part.said.facts
        kept = [
            one
            for one in its.moved
            if not one.wanted or any(joined.ends.get(spec, 0) > number for spec in one.wanted)
        ]
        facts.moved += kept
        if facts.caster is None and (kept or facts.recorded is None):
            facts.caster, facts.examined = its.caster, its.examined
    facts.failures = _failures(parts, joined)
    return facts


def _failures(parts: Sequence[PartFolder], joined: Joined) -> list[Failure]:
    """Who broke down, in the order in which one run would have found it, each once."""
    order = {spec: place for place, spec in enumerate(joined.ends)}
    found: dict[tuple[str, bool], Failure] = {}
    for number, part in enumerate(parts):
        for one in part.said.facts.failures:
            spec = one.finding.culler
            if spec in order and number < joined.ends[spec]:
                found.setdefault((spec, one.step is Step.CLOSE), one)

    def place(one: Failure) -> tuple[int, int, int, int]:
        ends = {Step.PREPARE: 0, Step.CLOSE: 2}
        frame = -1 if one.frame is None else one.frame
        return ends.get(one.step, 1), frame, int(one.step), order[one.finding.culler]

    return sorted(found.values(), key=place)


def _again(parts: Sequence[PartFolder], joined: Joined) -> list[dict[str, Difference]]:
    """For each time that cullers were asked again, what was otherwise in the whole run."""
    return [
        {
            spec: sum(
                (part.said.again[time].get(spec, Difference()) for part in parts[:end]),
                Difference(),
            )
            for spec, end in joined.ends.items()
        }
        for time in range(len(parts[0].said.again))
    ]
