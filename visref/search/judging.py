"""A culler on a case: what it violates, judged exactly as a run is."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from visref.causes.evidence import Evidence
from visref.culler import Promise
from visref.errors import NothingToJudge
from visref.findings import Code
from visref.judging.asking import Job
from visref.judging.judge import Counts, Miss, MissKind
from visref.judging.outcome import CullerRecord, RunOutcome
from visref.judging.referee import JudgedFrame, Listener, Referee
from visref.judging.status import Status
from visref.judging.superfluous import Superfluous
from visref.registry import DEFAULT_ENGINE
from visref.scene import Int32, Scene, Units
from visref.search.case import Case
from visref.search.suspects import Suspect
from visref.shares import name_the_causes
from visref.visibility import FrameTruth, ObjectVisibility


class Kind(StrEnum):
    """What a culler did to an object though its promise forbids it: left it out, left a part of it
    out, or drew it (or a unit of it) though it is hidden."""

    MISSED = "missed"
    PARTLY_MISSED = "partly missed"
    SUPERFLUOUS = "superfluous"


@dataclass(frozen=True)
class Violation:
    """One object, or one unit that was drawn for nothing, in one frame and view.

    `view`: the view that the drawn set is for, "" for all of a frame's; `seen_in`: that of the
    witness. `samples`: those lost, or those that the hidden unit covers; `owned`: those at which
    the object is seen. The witness is pixel (`x`, `y`), where `triangle` at view depth `depth` is
    lost, or hides the unit where it comes closest to it (-1 each where it covers no sample; without
    a depth).
    `unit`: what was drawn, -1 of a miss. `cause`: the code of why (`visref.judging.causes`), ""
    where none was found or looked for; `others`: causes that explain it alike.
    """

    kind: Kind
    frame: int
    view: str
    object: int
    name: str
    samples: int
    owned: int
    x: int
    y: int
    triangle: int
    depth: float
    seen_in: str = ""
    unit: int = -1
    cause: str = ""
    others: tuple[str, ...] = ()

    @property
    def causes(self) -> tuple[str, ...]:
        """All that explain it."""
        return (self.cause, *self.others) if self.cause else ()

    def by(self, cause: str) -> Violation:
        """The same, with one of its causes as the first."""
        rest = tuple(one for one in self.causes if one != cause)
        return replace(self, cause=cause, others=rest)


@dataclass(frozen=True)
class Verdict:
    """`violations`: in the order of frames, views and what weighs most. `failed`: how the culler
    broke down, "" if it did not."""

    violations: tuple[Violation, ...]
    status: Status
    promise: Promise
    counts: Counts
    failed: str = ""
    unit_kind: str = ""


def verdict_of(
    case: Case,
    suspect: Suspect,
    *,
    engine: str = DEFAULT_ENGINE,
    threads: int | None = 1,
    listeners: Sequence[Listener] = (),
    explained: Callable[[Verdict], bool] | None = None,
) -> Verdict:
    """Judge a suspect on a case, by the referee of a run with the same engine. `listeners` are
    told of the truths and the verdicts as they come. `explained`: of which verdicts the misses get
    their causes, which takes some times as long as judging a small case.

    Raises InputError where the case is one that nobody can judge (no file says it, an engine that
    does not pose), and NothingToJudge where the culler or the engine cannot start here.
    """
    inputs = case.inputs(engine, threads)
    drawn, evidence = Drawn(), Evidence()
    heard = [drawn, *listeners, *([evidence] if explained is not None else [])]
    referee = Referee(inputs.scene, inputs.make_engine, threads=threads, timeline=inputs.timeline)
    with suspect.on(case) as culler:
        outcome = referee.run(inputs.path, inputs.frames, [(suspect.name, culler)], heard)
    verdict = verdict_from(outcome, inputs.scene, drawn.units)
    if explained is not None and explained(verdict):
        name_the_causes(inputs, evidence, outcome)
        verdict = verdict_from(outcome, inputs.scene, drawn.units)
    return verdict


def verdict_from(outcome: RunOutcome, scene: Scene, units: Units | None) -> Verdict:
    """The verdict of a run of one culler with these units, with the causes that its record has.
    Raises NothingToJudge where that could not start."""
    (record,) = outcome.cullers
    failed = ""
    for finding in outcome.findings:
        if finding.code is Code.NO_GL:
            raise NothingToJudge(finding.message)
        if finding.code is Code.CULLER_FAILED:
            failed = failed or finding.message
    return Verdict(
        tuple(_violations(record, scene, units)),
        record.status,
        record.promise,
        record.totals,
        failed,
        record.unit_kind,
    )


def _violations(record: CullerRecord, scene: Scene, units: Units | None) -> list[Violation]:
    found = []
    for row in record.frames:
        if record.promise.convicts:
            found += [
                _of_miss(row.frame, row.view, miss, scene, record)
                for miss in row.verdict.misses
                if miss.kind is MissKind.CONFIRMED
            ]
        if not record.promise.may_draw_hidden:
            assert units is not None, "who was judged has units"
            found += [
                _of_hidden(row.frame, row.view, one, scene, units)
                for one in row.verdict.confirmed_superfluous
            ]
    return found


def _of_miss(frame: int, view: str, miss: Miss, scene: Scene, record: CullerRecord) -> Violation:
    y, x = divmod(miss.sample, miss.width)
    kind = Kind.PARTLY_MISSED if miss.partly else Kind.MISSED
    causes = [one.cause for one in record.causes.of(frame, view, miss.object)]
    return Violation(
        kind, frame, view, miss.object, scene.names[miss.object], miss.samples, miss.owned,
        x, y, miss.triangle, miss.depth, miss.view,
        cause=causes[0] if causes else "", others=tuple(causes[1:]),
    )  # fmt: skip


def _of_hidden(frame: int, view: str, one: Superfluous, scene: Scene, units: Units) -> Violation:
    """The object is that of the unit's first triangle."""
    owner = int(scene.object_of_triangle[units.gather(np.array([one.unit], np.int32))[0]])
    y, x = divmod(one.sample, one.width) if one.sample >= 0 else (-1, -1)
    return Violation(
        Kind.SUPERFLUOUS, frame, view, owner, scene.names[owner], one.samples, 0,
        x, y, one.occluder, math.nan, one.view, one.unit,
    )  # fmt: skip


class Drawn:
    """A run's listener that keeps what was drawn: the units, and by frame and view their ids."""

    def __init__(self) -> None:
        self.units: Units | None = None
        self.drawn: dict[tuple[int, str], Int32] = {}

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        self.units = job.units
        self.drawn[judged.record.frame, judged.record.view] = judged.drawn_units

    def on_frame_done(self, frame: int) -> None:
        pass
