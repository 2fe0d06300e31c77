"""A picture for every cause that is named: of the frame in which most is lost by it, where none of
the pictured ones shows it.

Causes are known only when every answer was judged, and what a picture needs of each answer would be
too much to hold until then. So such a frame is judged once more, by what was drawn in it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np

from visref.camera import Camera
from visref.causes.evidence import Answers, Evidence
from visref.culler import Culler, DrawnSet
from visref.inputs import Inputs
from visref.judging.asking import Job, Panel
from visref.judging.causes import CausesFound
from visref.judging.outcome import ALL_VIEWS, CullerRecord, FrameRecord
from visref.judging.policy import Policy
from visref.judging.referee import JudgedFrame, Sitting
from visref.run_folder.layout import slug
from visref.run_folder.motion import MotionRecord
from visref.run_folder.picture_plan import PicturePlan, Shown
from visref.run_folder.pictures import Painter
from visref.run_folder.rows import PictureSet
from visref.scene import Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility


def paint_causes(
    inputs: Inputs,
    evidence: Evidence,
    records: Sequence[CullerRecord],
    plan: PicturePlan,
    painter: Painter,
) -> list[PictureSet]:
    """Draw, of every cause in `records`, a frame that shows it, beside those that the `plan` of the
    whole run has drawn. None at all where that plans none."""
    wanted: dict[int, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for record in records if plan.draws else ():
        for frame, view in without_picture(
            record.causes, record.frames, plan.drawn_of(record.spec)
        ):
            wanted[frame][record.spec].add(view)
    return _painted(inputs, evidence, records, wanted, painter) if wanted else []


def without_picture(
    causes: CausesFound, frames: Sequence[FrameRecord], drawn: Callable[[Shown], bool]
) -> list[Shown]:
    """Of each cause of which no frame is `drawn`, the frame and view with the object that loses
    most by it, the first of equals; one may stand for several causes."""
    by_place = {(record.frame, record.view): record for record in frames}
    losers: dict[str, dict[Shown, list[int]]] = defaultdict(lambda: defaultdict(list))
    for (frame, view, obj), named in causes.named.items():
        losers[named[0].cause][frame, view].append(obj)
    chosen: list[Shown] = []
    for cause in (str(one["cause"]) for one in causes.grouped()):
        places = losers[cause]
        if any(drawn(place) or place in chosen for place in places):
            continue
        most = {place: _most_lost(by_place[place], its) for place, its in places.items()}
        chosen.append(min(most, key=lambda place: (-most[place], *place)))
    return chosen


def _most_lost(record: FrameRecord, objects: Sequence[int]) -> int:
    columns = record.verdict.misses.columns
    return int(columns.samples[np.isin(columns.object, objects)].max(initial=0))


class _AsItAnswered(Culler):
    """Gives the answers that a culler gave."""

    def __init__(self, record: CullerRecord, answers: Answers) -> None:
        self.promise = record.promise
        self._answers = answers
        self._frame = 0

    def turn_to(self, frame: int) -> None:
        """The frame that it is asked about next."""
        self._frame = frame
        self.joint = (frame, ALL_VIEWS) in self._answers.by_place

    def prepare(self, scene: Scene) -> Units:
        return self._answers.units

    def update(self, scene: Scene) -> None:
        pass

    def cull(self, camera: Camera) -> DrawnSet:
        return self._answer(camera.view)

    def cull_joint(self, cameras: Sequence[Camera]) -> DrawnSet:
        return self._answer(ALL_VIEWS)

    def _answer(self, view: str) -> DrawnSet:
        answer = self._answers.by_place.get((self._frame, view))
        units = np.zeros(0, np.bool_) if answer is None else answer.drawn(self._answers.units.count)
        return DrawnSet(np.flatnonzero(units).astype(np.int32))


def _painted(
    inputs: Inputs,
    evidence: Evidence,
    records: Sequence[CullerRecord],
    wanted: dict[int, dict[str, set[str]]],
    painter: Painter,
) -> list[PictureSet]:
    """The pictures of these frames, by culler and view."""
    timeline, motion = inputs.timeline, MotionRecord(inputs.timeline)
    specs = {spec for its in wanted.values() for spec in its}
    cullers = [
        (record.spec, _AsItAnswered(record, evidence.answers[record.spec]))
        for record in records
        if record.spec in specs
    ]
    found: list[PictureSet] = []

    def on_truth(frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        painter.see(frame, truth)

    def on_verdict(job: Job, judged: JudgedFrame) -> None:
        frame, verdict = judged.record.frame, judged.record.verdict
        if judged.record.view in wanted[frame][job.spec]:
            found.extend(
                painter.draw(
                    settled,
                    verdict,
                    stem=slug(job.spec),
                    culler=job.spec,
                    frame=frame,
                    moved=motion.changed(frame),
                )
                for settled in judged.settled
            )

    path = inputs.path.relative_to(inputs.scene.origin)
    panel = Panel(cullers, timeline, Policy())
    sitting = Sitting(path, timeline, panel, inputs.make_engine, inputs.threads)
    try:
        sitting.begin(sorted(wanted), None)
        for frame in sorted(wanted):
            for _, culler in cullers:
                culler.turn_to(frame)
            jobs = [job for job in panel.jobs if job.spec in wanted[frame]]
            sitting.frame(frame, jobs, on_truth, on_verdict)
    finally:
        sitting.close()
    assert not panel.failures
    return found
