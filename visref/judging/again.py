"""The same question twice: whether a culler that is made anew and asked about all frames again
gives the same answers. Nothing is cast and nothing is judged for it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from visref.camera_path import CameraPath
from visref.findings import Code, Finding
from visref.judging.asking import Job, Panel
from visref.judging.outcome import ALL_VIEWS, CullerRecord, RunOutcome
from visref.judging.referee import JudgedFrame
from visref.scene import Int32, Units
from visref.visibility import FrameTruth, ObjectVisibility

# A drawn set, by what it is: the ids of its units, ascending, each once.
_Digest = bytes
_Cell = tuple[int, str]


@dataclass(eq=False)
class Answers:
    """A run's listener that keeps, by culler, what its units are and what it drew in each frame and
    view, as digests."""

    units: dict[str, _Digest] = field(default_factory=dict)
    drawn: dict[str, dict[_Cell, _Digest]] = field(default_factory=dict)

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        record = judged.record
        self.add(job, (record.frame, record.view), judged.drawn_units)

    def on_frame_done(self, frame: int) -> None:
        pass

    def add(self, job: Job, cell: _Cell, drawn_units: Int32) -> None:
        if job.spec not in self.units:
            self.units[job.spec] = _units_digest(job.units)
        self.drawn.setdefault(job.spec, {})[cell] = _digest(np.unique(drawn_units))


def ask(panel: Panel, path: CameraPath, frames: Sequence[int], judged: Sequence[int]) -> Answers:
    """What cullers answer in the frames `judged` of a run over `frames`, asked as a referee asks
    them; the panel's records say who broke down. Which boxes they tested is no answer. `path` is
    relative to the scene's origin.
    """
    answers = Answers()
    try:
        panel.prepare(frames[0] if frames else None)
        if judged:
            panel.warm_up(path, frames, judged[0])
        for frame in judged:
            panel.pose(frame)
            cameras = path.views(frame)
            for job in panel.jobs:
                for cell, answer in panel.cells(job, cameras, frame):
                    view = cell[0].view if len(cell) == 1 else ALL_VIEWS
                    answers.add(job, (frame, view), answer.drawn_set.unit_ids)
    finally:
        panel.close()
    return answers


@dataclass(frozen=True)
class Difference:
    """What was otherwise when a culler was asked again: it `failed`, its `units` were others, or
    its drawn set in these `frames` of the number `asked`."""

    failed: bool = False
    units: bool = False
    frames: tuple[int, ...] = ()
    asked: int = 0

    @classmethod
    def between(
        cls, first: Answers, again: Answers, record: CullerRecord, other: CullerRecord
    ) -> Difference:
        """`record`, `other`: the culler's records of both times. One that broke down the first time
        is inconclusive by that, and nothing is asked of its answers."""
        if record.failed:
            return cls()
        spec = record.spec
        before, after = first.drawn.get(spec, {}), again.drawn.get(spec, {})
        differing = {
            frame for frame, view in before if before[frame, view] != after.get((frame, view))
        }
        return cls(
            other.failed,
            first.units.get(spec) != again.units.get(spec),
            tuple(sorted(differing)),
            len({frame for frame, _ in before}),
        )

    def __add__(self, later: Difference) -> Difference:
        """Of two parts of a run, one after the other."""
        return Difference(
            self.failed or later.failed,
            self.units or later.units,
            self.frames + later.frames,
            self.asked + later.asked,
        )

    @property
    def text(self) -> str:
        """It in a sentence; empty where nothing is otherwise."""
        if self.failed:
            return "it broke down when it was asked again"
        if self.units:
            return "it decides about other units when it is asked again"
        if not self.frames:
            return ""
        return (
            f"it draws another set in {len(self.frames)} of {self.asked} frames when it is asked "
            f"again, first in frame {self.frames[0]}"
        )


def mark_unsteady(outcome: RunOutcome, again: Sequence[Mapping[str, Difference]]) -> None:
    """Say of each culler that answers otherwise when it is asked again how it does so, the first
    time that it does."""
    for time in again:
        for record in outcome.cullers:
            said = time[record.spec].text if record.spec in time else ""
            if said and not record.unsteady and not record.failed:
                record.unsteady = True
                outcome.findings.append(Finding(Code.NOT_DETERMINISTIC, said, record.spec))


def _digest(*arrays: np.ndarray) -> _Digest:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(len(array).to_bytes(8, "little"))
        digest.update(np.ascontiguousarray(array, np.int64).tobytes())
    return digest.digest()


def _units_digest(units: Units) -> _Digest:
    return _digest(units.offsets, units.triangles)
