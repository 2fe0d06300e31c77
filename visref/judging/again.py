"""The same question twice: whether a culler that is made anew and asked about all frames again
gives the same answers. Nothing is cast and nothing is judged for it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
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


def ask(panel: Panel, path: CameraPath, frames: Sequence[int]) -> Answers:
    """What cullers answer in these frames, asked as a referee asks them; the panel's records say
    who broke down. Which boxes they tested is no answer. `path` is relative to the scene's origin.
    """
    answers = Answers()
    try:
        panel.prepare(frames[0] if frames else None)
        for frame in frames:
            panel.pose(frame)
            cameras = path.views(frame)
            for job in panel.jobs:
                for cell, answer in panel.cells(job, cameras, frame):
                    view = cell[0].view if len(cell) == 1 else ALL_VIEWS
                    answers.add(job, (frame, view), answer.drawn_set.unit_ids)
    finally:
        panel.close()
    return answers


def compare(first: Answers, again: Answers, record: CullerRecord, other: CullerRecord) -> str:
    """What is otherwise the second time, in a sentence; empty where nothing is. `record`, `other`:
    the culler's records of both times."""
    spec = record.spec
    if record.failed or other.failed:
        # One that broke down is inconclusive by that; where it broke down only now, that is new.
        return "" if record.failed else "it broke down when it was asked again"
    if first.units.get(spec) != again.units.get(spec):
        return "it decides about other units when it is asked again"
    before, after = first.drawn.get(spec, {}), again.drawn.get(spec, {})
    differing = [cell for cell in before if before[cell] != after.get(cell)]
    if not differing:
        return ""
    frames = sorted({frame for frame, _ in differing})
    return (
        f"it draws another set in {len(frames)} of {len({frame for frame, _ in before})} frames "
        f"when it is asked again, first in frame {frames[0]}"
    )


def mark_unsteady(record: CullerRecord, outcome: RunOutcome, why: str) -> None:
    """Say of a culler that it answers otherwise when it is asked again."""
    record.unsteady = True
    outcome.findings.append(Finding(Code.NOT_DETERMINISTIC, why, record.spec))


def _digest(*arrays: np.ndarray) -> _Digest:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(len(array).to_bytes(8, "little"))
        digest.update(np.ascontiguousarray(array, np.int64).tobytes())
    return digest.digest()


def _units_digest(units: Units) -> _Digest:
    return _digest(units.offsets, units.triangles)
