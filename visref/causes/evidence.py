"""What a run keeps for the question why things were missed: what was drawn in each answer, and
which objects were missed."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.judging.asking import Job
from visref.judging.judge import FrameVerdict, MissKind
from visref.judging.outcome import FrameRecord
from visref.judging.referee import JudgedFrame
from visref.picking import evenly_picked
from visref.recordings.spool import Spool
from visref.scene import Int32, Int64, Units
from visref.visibility import FrameTruth, ObjectVisibility

# So many answers that lost nothing are looked at, evenly spread.
CLEAN = 16


# What is held in memory of all answers; what goes beyond it goes to disk.
_IN_MEMORY = 4 << 20


@dataclass(frozen=True, eq=False)
class Answer:
    """A culler's answer that was judged: what was drawn and missed lies in `spool`, read again by
    whoever looks at it. `loses`: how many objects it loses samples of."""

    frame: int
    view: str
    loses: int
    spool: Spool
    places: tuple[tuple[int, int], tuple[int, int]]

    @classmethod
    def of(cls, frame: int, view: str, drawn: Int32, missed: Int32, spool: Spool) -> Answer:
        """`drawn`: the ids of the units drawn, (k,) int32; `missed`: the objects that it loses
        samples of, (m,) int32 ascending."""
        places = spool.put_set(np.sort(drawn)), spool.put_set(missed)
        return cls(frame, view, len(missed), spool, places)

    def drawn(self, units: int) -> NDArray[np.bool_]:
        """(units,) bool."""
        flags = np.zeros(units, np.bool_)
        flags[self.spool.get_set(self.places[0])] = True
        return flags

    @property
    def missed(self) -> Int32:
        """(k,) int32, the objects that it loses samples of, ascending."""
        return self.spool.get_set(self.places[1])


@dataclass(eq=False)
class Answers:
    """One culler's, in order."""

    units: Units
    every: list[Answer] = field(default_factory=list)

    @property
    def lossy(self) -> list[Answer]:
        return [answer for answer in self.every if answer.loses]

    def some_clean(self) -> list[Answer]:
        """Some of those that lost nothing, evenly spread."""
        clean = [answer for answer in self.every if not answer.loses]
        return [clean[i] for i in evenly_picked(len(clean), CLEAN)]

    @cached_property
    def by_place(self) -> dict[tuple[int, str], Answer]:
        return {(answer.frame, answer.view): answer for answer in self.every}

    def at(self, frame: int, view: str) -> NDArray[np.bool_] | None:
        """(u,) bool, what was drawn in a view of a frame, None where there was no answer."""
        found = self._found(frame, view)
        return None if found is None else found.drawn(self.units.count)

    def missed(self, frame: int, view: str) -> Int32:
        """(k,) int32, the objects that were missed in a view of a frame, ascending."""
        found = self._found(frame, view)
        return np.zeros(0, np.int32) if found is None else found.missed

    def _found(self, frame: int, view: str) -> Answer | None:
        return self.by_place.get((frame, view)) or self.by_place.get((frame, ""))


class Evidence:
    """What a run keeps of every answer, by the culler's name: a run's listener, or told of verdicts
    by who has them from elsewhere."""

    def __init__(self) -> None:
        self.answers: dict[str, Answers] = {}
        self._spool = Spool(_IN_MEMORY)

    def add(self, spec: str, units: Units, record: FrameRecord, drawn: Int32) -> None:
        """A verdict, and the ids of the units drawn, (k,) int32."""
        kept = self.answers.setdefault(spec, Answers(units))
        missed = convicted(record.verdict)
        kept.every.append(Answer.of(record.frame, record.view, drawn, missed, self._spool))

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        self.add(job.spec, job.units, judged.record, judged.drawn_units)

    def on_frame_done(self, frame: int) -> None:
        pass


def convicted(verdict: FrameVerdict) -> Int32:
    """(k,) int32, the objects that a verdict says were missed, ties and roundings aside."""
    misses = verdict.misses
    excused = misses.are(MissKind.TIE) | misses.are(MissKind.WITHIN_RASTER)
    return np.unique(misses.columns.object[~excused])


class Membership:
    """Which units hold a triangle."""

    def __init__(self, units: Units) -> None:
        order = np.argsort(units.triangles, kind="stable")
        self._triangle = units.triangles[order]
        self._unit = np.repeat(np.arange(units.count, dtype=np.int32), units.sizes)[order]

    def units(self, triangles: Int64) -> tuple[Int32, Int64]:
        """The units that hold some of (k,) triangles: (m,) int32 units and int64 places among the
        triangles asked for."""
        first = np.searchsorted(self._triangle, triangles, "left")
        count = np.searchsorted(self._triangle, triangles, "right") - first
        at = np.repeat(np.arange(len(triangles)), count)
        starts = np.cumsum(count) - count
        place = np.arange(len(at)) - np.repeat(starts, count) + np.repeat(first, count)
        return self._unit[place], at

    def first_of(self, triangle_count: int) -> Int32:
        """(t,) int32, a unit that holds each triangle, -1 for none."""
        result = np.full(triangle_count, -1, np.int32)
        result[self._triangle[::-1]] = self._unit[::-1]
        return result
