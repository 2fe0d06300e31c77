"""Cullers under judgement: met, asked frame after frame, and let go. One that breaks down, or
breaks its contract, stops alone; the others go on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import (
    Culler,
    CullerError,
    DrawnSet,
    Promise,
    Raster,
    Recorded,
    check_asked,
    check_drawn,
    check_stats,
    fault_text,
)
from visref.errors import InputError, NothingToJudge
from visref.findings import Code, Finding
from visref.judging.absences import without_absent
from visref.judging.bounds import BoundsAudit
from visref.judging.holders import Holders
from visref.judging.outcome import CullerRecord
from visref.judging.policy import Policy
from visref.judging.rasters import raster_of
from visref.judging.restored import settings_restored
from visref.scene import OBJECT, Int32, Scene, Units, unique_names
from visref.stopwatch import Stopwatch
from visref.timeline import Timeline
from visref.visibility import FrameTruth


@dataclass(eq=False)
class Job:
    """A culler under judgement, and its record."""

    spec: str
    culler: Culler
    record: CullerRecord
    units: Units
    holders: Holders
    audit: BoundsAudit = field(default_factory=BoundsAudit)


class Step(IntEnum):
    """Where in a run a culler broke down, in the order in which a frame goes."""

    PREPARE = 0
    UPDATE = 1
    FRAME = 2
    CLOSE = 3


@dataclass(frozen=True)
class Failure:
    """A culler's breakdown. `frame`: in which it was found, None where it was in none."""

    step: Step
    frame: int | None
    finding: Finding


@dataclass(frozen=True, eq=False)
class Answer:
    """One drawn set, checked, and the rasteriser behind it. `ignored`: (k,) int32, the units that
    were named and are absent."""

    drawn_set: DrawnSet
    ignored: Int32
    raster: Raster | None


class Panel:
    """All cullers of a run, by name, in order. `failures` grows as they break down.

    `pose` lets them meet the scene of a frame; the first one prepares them. Of who failed nothing
    more is asked.
    """

    def __init__(
        self, cullers: Sequence[tuple[str, Culler]], timeline: Timeline, policy: Policy
    ) -> None:
        names = unique_names([spec for spec, _ in cullers])
        self._cullers = [(name, culler) for name, (_, culler) in zip(names, cullers, strict=True)]
        self._timeline = timeline
        self.records = [
            CullerRecord(name, Promise.CONSERVATIVE, max_undecided=policy.max_undecided)
            for name in names
        ]
        self.jobs: list[Job] = []
        self.failures: list[Failure] = []
        self.scene: Scene = timeline.still

    def prepare(self, frame: int | None) -> None:
        """Let every culler meet the scene of a run's first frame."""
        self.scene = self._timeline.still if frame is None else self._timeline.at(frame)
        for (_, culler), record in zip(self._cullers, self.records, strict=True):
            try:
                with self._guarded(record, Step.PREPARE, None):
                    self.jobs.append(self._prepared(culler, record))
            except NothingToJudge as error:
                record.failed = True
                finding = Finding(Code.NO_GL, str(error), culler=record.spec)
                self.failures.append(Failure(Step.PREPARE, None, finding))

    def _prepared(self, culler: Culler, record: CullerRecord) -> Job:
        # Here and below a plug-in gets records of its own, and is not asked for its own later.
        record.promise = _promise(culler)
        if self.scene.moving is not None and not culler.moves:
            raise CullerError("it is for scenes that stand still: it has no update()")
        units = _checked(culler.prepare(self.scene.handed_out()), self.scene)
        # `prepare` may have settled what the options promise.
        record.promise = _promise(culler)
        record.unit_kind, record.unit_count = units.kind, units.count
        return Job(record.spec, culler, record, units, Holders.of_units(units, self.scene))

    def pose(self, frame: int) -> bool:
        """Go on to a frame; whether its scene is another than that of the frame before."""
        scene = self._timeline.at(frame)
        if scene is self.scene:
            return False
        self.scene = scene
        for job in self.jobs:
            if not job.record.failed:
                with self._guarded(job.record, Step.UPDATE, frame):
                    job.culler.update(scene.handed_out())
        return True

    def cells(
        self, job: Job, cameras: Sequence[Camera], frame: int
    ) -> Iterator[tuple[tuple[Camera, ...], Answer]]:
        """A culler's answers in one frame: for all views together where it is joint, else for each.
        Nothing follows once it has failed."""
        if job.record.failed:
            return
        joint = False
        with self._guarded(job.record, Step.FRAME, frame):
            joint = bool(job.culler.joint)
        for cell in [tuple(cameras)] if joint else [(camera,) for camera in cameras]:
            if job.record.failed:
                return
            answer = None
            with self._guarded(job.record, Step.FRAME, frame):
                answer = self._answer(job, cell)
            if answer is not None:
                yield cell, answer

    def _answer(self, job: Job, cameras: Sequence[Camera]) -> Answer:
        drawn_set, ignored = without_absent(self.scene, job.holders, _cull(job, cameras))
        # A rasteriser may declare more for each camera that it sees: once a frame.
        return Answer(drawn_set, ignored, raster_of(job.culler))

    def bounds(self, job: Job, frame: int) -> object:
        """The boxes that the culler says it tested; None where it does not say, or has failed."""
        if not job.record.failed:
            with self._guarded(job.record, Step.FRAME, frame):
                return job.culler.bounds()
        return None

    def audit(self, job: Job, frame: int, boxes: object, truths: Sequence[FrameTruth]) -> None:
        """Hold boxes against what they stand for."""
        with self._guarded(job.record, Step.FRAME, frame):
            if boxes is not None:
                job.audit.look(frame, self.scene, job.units, boxes, truths)
        job.record.too_small = list(job.audit.found.values())

    def warm_up(self, path: CameraPath, frames: Sequence[int], before: int) -> None:
        """Bring cullers to where they stand before the frame `before` of a run over `frames`, all
        ascending: who looks back is asked about as many frames as it says, and about all of them
        where it sets no limit. Their answers are not kept."""
        start = frames.index(before)
        if not start:
            return
        depth = {job.spec: memory_of(job.culler) for job in self.jobs}
        for job in self.jobs:
            if isinstance(job.culler, Recorded) and not job.record.failed:
                with self._guarded(job.record, Step.UPDATE, before):
                    job.culler.seek(before)
        longest = max((start if k is None else k for k in depth.values()), default=0)
        for place in range(max(0, start - longest), start):
            frame = frames[place]
            asked = [
                job
                for job in self.jobs
                if not isinstance(job.culler, Recorded)
                and ((k := depth[job.spec]) is None or place >= start - k)
            ]
            if asked:
                self.pose(frame)
                for job in asked:
                    for _ in self.cells(job, path.views(frame), frame):
                        pass

    def fail(self, record: CullerRecord, step: Step, frame: int | None, why: BaseException) -> None:
        """Put down that a culler broke down."""
        record.failed = True
        finding = Finding(Code.CULLER_FAILED, fault_text(why), culler=record.spec, frame=frame)
        self.failures.append(Failure(step, frame, finding))

    def fail_in_frame(self, record: CullerRecord, frame: int, why: BaseException) -> None:
        """Put down that a culler broke down as its answer was looked at."""
        self.fail(record, Step.FRAME, frame, why)

    @contextmanager
    def _guarded(self, record: CullerRecord, step: Step, frame: int | None) -> Iterator[None]:
        """Whatever a plug-in raises here is its own failure; settings stay as they were."""
        passing = (NothingToJudge,) if step is Step.PREPARE else ()
        if step is not Step.CLOSE:
            passing = (*passing, InputError)
        try:
            with settings_restored():
                yield
        except (*passing, KeyboardInterrupt):
            raise
        except BaseException as error:  # a plug-in may raise anything; the others go on
            self.fail(record, step, frame, error)

    def forget(self) -> None:
        """Begin the records anew: what was found so far is kept elsewhere. Who failed is not asked
        again."""
        self.failures = []
        for record in self.records:
            record.frames, record.too_small, record.ignored = [], [], {}
            record.raster, record.misaligned = None, False
        for job in self.jobs:
            job.audit.found = {}

    def close(self) -> None:
        """Let all go."""
        for (_, culler), record in zip(self._cullers, self.records, strict=True):
            with self._guarded(record, Step.CLOSE, None):
                culler.close()


def memory_of(culler: Culler) -> int | None:
    """How many frames a culler looks back, None for no limit, which is also what anything else than
    a count stands for."""
    try:
        said: object = culler.memory
    except Exception:  # a plug-in's may be anything
        return None
    whole = isinstance(said, (int, np.integer)) and not isinstance(said, bool)
    return int(said) if whole and said >= 0 else None  # type: ignore[operator, call-overload]


def _cull(job: Job, cameras: Sequence[Camera]) -> DrawnSet:
    handed = tuple(camera.handed_out() for camera in cameras)
    with Stopwatch() as watch:
        if job.culler.joint:
            drawn_set = job.culler.cull_joint(handed)
        else:
            drawn_set = job.culler.cull(handed[0])
    if not isinstance(drawn_set, DrawnSet):
        raise CullerError("cull() returned no DrawnSet")
    ids = check_drawn(drawn_set, job.units)
    asked_at = check_asked(drawn_set.asked_at, len(ids))
    elapsed_ms = watch.ms if job.culler.timed else None
    stats = check_stats(drawn_set.stats, elapsed_ms)
    return DrawnSet(ids, stats, asked_at, drawn_set.ordered)


def _promise(culler: Culler) -> Promise:
    said = culler.promise
    try:
        return Promise(said)
    except (ValueError, TypeError) as error:
        raise CullerError(
            f"it promises {said!r}; a promise is one of {', '.join(Promise)}"
        ) from error


def _checked(units: object, scene: Scene) -> Units:
    """What `prepare` returned, if it is units of the scene; CullerError otherwise."""
    if not isinstance(units, Units):
        raise CullerError("prepare() returned no Units")
    try:
        units.check(scene, source="")
    except InputError as error:  # not the user's: the culler made them
        raise CullerError(str(error)) from error
    units = units.owned()
    if units.kind == OBJECT and not units.are_objects(scene):
        units = replace(units, kind="unit")
    return units
