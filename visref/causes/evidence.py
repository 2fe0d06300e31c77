"""What a run keeps for the question why things were missed: who was drawn in each answer, and who
was lost by it."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.judging.frame import SettledFrame
from visref.judging.judge import FrameVerdict, MissKind
from visref.judging.referee import Job, JudgedFrame
from visref.picking import evenly_picked
from visref.scene import Int32, Int64, Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility

# So many answers that lost nothing are looked at, evenly spread.
CLEAN = 16
NO_UNIT = -1


@dataclass(frozen=True, eq=False)
class Answer:
    """A culler's answer that was judged. `packed`: the units drawn, a bit each, compressed. `lost`:
    (k, 2) int32, the pairs of a unit that was not drawn and an object that loses samples by it,
    sorted; `NO_UNIT` where what was lost is in no unit."""

    frame: int
    view: str
    packed: bytes
    lost: Int32

    @classmethod
    def of(cls, frame: int, view: str, drawn: NDArray[np.bool_], lost: Int32) -> Answer:
        return cls(frame, view, zlib.compress(np.packbits(drawn).tobytes(), 1), lost)

    def drawn(self, units: int) -> NDArray[np.bool_]:
        """(units,) bool."""
        bits = np.frombuffer(zlib.decompress(self.packed), np.uint8)
        return np.unpackbits(bits, count=units).astype(np.bool_)


@dataclass(eq=False)
class Answers:
    """One culler's, in order."""

    units: Units
    every: list[Answer] = field(default_factory=list)

    @property
    def lossy(self) -> list[Answer]:
        return [answer for answer in self.every if len(answer.lost)]

    def some_clean(self) -> list[Answer]:
        """Some of those that lost nothing, evenly spread."""
        clean = [answer for answer in self.every if not len(answer.lost)]
        return [clean[i] for i in evenly_picked(len(clean), CLEAN)]

    @cached_property
    def _by_place(self) -> dict[tuple[int, str], Answer]:
        return {(answer.frame, answer.view): answer for answer in self.every}

    def at(self, frame: int, view: str) -> NDArray[np.bool_] | None:
        """(u,) bool, what was drawn in a view of a frame, None where there was no answer."""
        found = self._by_place.get((frame, view)) or self._by_place.get((frame, ""))
        return None if found is None else found.drawn(self.units.count)


class Evidence:
    """A run's listener. `answers`: by the culler's name."""

    def __init__(self, scene: Scene) -> None:
        self.answers: dict[str, Answers] = {}
        self._scene = scene
        self._units_at: dict[str, Membership] = {}

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        kept = self.answers.setdefault(job.spec, Answers(job.units))
        drawn = np.zeros(job.units.count, np.bool_)
        drawn[judged.drawn_units] = True
        record = judged.record
        lost = np.zeros((0, 2), np.int32)
        objects = convicted(record.verdict)
        if len(objects):
            if job.spec not in self._units_at:
                self._units_at[job.spec] = Membership(job.units)
            lost = self._lost(judged.settled, self._units_at[job.spec], objects, drawn)
        kept.every.append(Answer.of(record.frame, record.view, drawn, lost))

    def on_frame_done(self, frame: int) -> None:
        pass

    def _lost(
        self,
        settled: Sequence[SettledFrame],
        of_triangle: Membership,
        objects: Int64,
        drawn: NDArray[np.bool_],
    ) -> Int32:
        counted = np.zeros(self._scene.object_count, np.bool_)
        counted[objects] = True
        owner = self._scene.object_of_triangle
        triangles = [np.flatnonzero(one.walk.lost_triangle) for one in settled]
        lost = np.unique(np.concatenate([np.zeros(0, np.int64), *triangles]))
        lost = lost[counted[owner[lost]]]
        unit, at = of_triangle.units(lost)
        left_out = ~drawn[unit]
        unit, at = unit[left_out], at[left_out]
        listed = np.zeros(len(lost), np.bool_)
        listed[at] = True
        nowhere = owner[lost[~listed]]
        pairs = np.concatenate(
            [
                np.stack([unit, owner[lost[at]]], axis=1),
                np.stack([np.full(len(nowhere), NO_UNIT), nowhere], axis=1),
            ]
        )
        return np.unique(pairs, axis=0).astype(np.int32).reshape(-1, 2)


def convicted(verdict: FrameVerdict) -> Int64:
    """(k,) int64, the objects that a verdict says were missed, ties and roundings aside."""
    kinds = (MissKind.TIE, MissKind.WITHIN_RASTER)
    found = sorted({miss.object for miss in verdict.misses if miss.kind not in kinds})
    return np.array(found, np.int64)


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
