"""Scene × path × cullers: the order of work, progress, and the isolation of failures.

Each view of a frame is cast once and judged against every culler; without cullers a run is the
truth alone. A culler that breaks down stops alone. With a recorded truth, a frame is cast again
only if a culler left something visible out of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import (
    Culler,
    CullerError,
    DrawnSet,
    Promise,
    Raster,
    check_asked,
    check_drawn,
    check_stats,
    fault_text,
)
from visref.engines.base import TruthEngine
from visref.engines.exact import ExactEngine
from visref.errors import InputError, NothingToJudge
from visref.exact import ExactScene
from visref.findings import Code, Finding
from visref.judging.absences import without_absent
from visref.judging.ages import CellAges
from visref.judging.bounds import BoundsAudit
from visref.judging.culler_findings import culler_findings
from visref.judging.frame import SettledFrame
from visref.judging.joint import joined, located
from visref.judging.judge import Counts, FrameVerdict, judge
from visref.judging.limits import LOOKED_AT, hidden_by_limits, known_to_be_wrong
from visref.judging.outcome import ALL_VIEWS, CullerRecord, FrameRecord, RunOutcome
from visref.judging.policy import Accepting, Policy
from visref.judging.rasters import looser, raster_of
from visref.judging.restored import settings_restored
from visref.judging.rounding import FORGIVEN_PX, greatest_move
from visref.judging.settle import settle
from visref.judging.stale import policy_findings
from visref.judging.winding import inside_out
from visref.picking import evenly_picked
from visref.recordings.truth_file import FrameRows, RecordedTruth
from visref.scene import OBJECT, Int32, Scene, Units, unique_names
from visref.stopwatch import Stopwatch
from visref.timeline import Timeline
from visref.visibility import FrameTruth, ObjectVisibility, objects_seen

Cast = tuple[FrameTruth, ObjectVisibility]


class ImageCheck(Protocol):
    """An engine that can redraw a drawn set and compare it with the unculled picture."""

    def pixels_differ(self, camera: Camera, drawn: NDArray[np.bool_]) -> int:
        """Pixels in which the drawn triangles' picture differs from the whole scene's. `drawn`:
        (t,) bool, one per triangle."""
        ...


class Listener(Protocol):
    """Told of everything a run does, in order; it keeps records, progress and pictures."""

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        """A frame's truth was cast (not called for frames taken from a truth file)."""
        ...

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        """A culler's frame was judged."""
        ...

    def on_frame_done(self, frame: int) -> None:
        """All cullers are through with this frame."""
        ...


@dataclass(eq=False)
class Job:
    """A culler under judgement, and its record."""

    spec: str
    culler: Culler
    record: CullerRecord
    units: Units
    audit: BoundsAudit = field(default_factory=BoundsAudit)


@dataclass(frozen=True, eq=False)
class JudgedFrame:
    """What a listener may want to keep of one culler's answer. `settled`: what the verdict rests
    on, one per view of the drawn set, none where a recorded truth was enough. `drawn`: (t,) bool.
    """

    record: FrameRecord
    settled: tuple[SettledFrame, ...]
    drawn_set: DrawnSet
    drawn: NDArray[np.bool_]

    @property
    def drawn_units(self) -> Int32:
        """(k,) int32, the ids of the units drawn."""
        return self.drawn_set.unit_ids


@dataclass(eq=False)
class Referee:
    """Casts truths and judges cullers on one scene, which a path's frames may pose.

    `timeline`: the scene of each of the path's frames; by default `scene` and the path make it.
    Where something moves, the engine is to be made of `timeline.still`. `engine` makes the truth
    engine on first use, so that a recorded truth with nothing to dispute never builds one. It
    must be the engine that cast a recorded truth: another may not see what that truth says was
    missed. `examine`: say too, where an engine is built, whether near, far or the winding hide
    most of the scene; then the engine must cast any camera. `keeps_superfluous`: whether the
    records list the units drawn for nothing once the listeners have seen them; of a long run that
    is much. `policy`: what the user accepts.
    """

    scene: Scene
    engine: Callable[[], TruthEngine]
    threads: int | None = None
    recorded: RecordedTruth | None = None
    image_check: ImageCheck | None = None
    examine: bool = False
    keeps_superfluous: bool = True
    timeline: Timeline | None = None
    policy: Policy = field(default_factory=Policy)

    def __post_init__(self) -> None:
        self._accepting = Accepting(self.policy, self.scene)
        self._engine: TruthEngine | None = None
        self._exact: ExactScene | None = None
        # The scene of the frame at hand.
        self._now = self.scene
        self._ages = CellAges()
        # By how many pixels rounding moved a vertex that is seen, less the frame, and a triangle.
        self._moved = (0.0, 0, -1)

    def run(
        self,
        path: CameraPath,
        frames: Iterable[int],
        cullers: Sequence[tuple[str, Culler]],
        listeners: Sequence[Listener] = (),
    ) -> RunOutcome:
        """Judge every culler on these frames of the path, in order."""
        path = path.relative_to(self.scene.origin)
        names = unique_names([spec for spec, _ in cullers])
        cullers = [(name, culler) for name, (_, culler) in zip(names, cullers, strict=True)]
        frames = list(frames)
        timeline = self.timeline or Timeline(self.scene, path)
        self._now = timeline.at(frames[0]) if frames else timeline.still
        outcome = RunOutcome([], policy=self.policy)
        try:
            jobs = [j for spec, culler in cullers if (j := self._prepare(spec, culler, outcome))]
            for frame in frames:
                self._pose(timeline.at(frame), frame, jobs, outcome)
                self._frame(path, frame, jobs, outcome, listeners)
                for listener in listeners:
                    listener.on_frame_done(frame)
            if self.examine and self._engine is not None:
                # Afterwards: nobody needs the engine's arrays any more.
                picked = [path.views(frames[i]) for i in evenly_picked(len(frames), LOOKED_AT)]
                kind = type(self._engine)
                outcome.findings[:0] = [
                    *hidden_by_limits(self._engine, self.scene, picked),
                    *known_to_be_wrong(self._engine, self.scene, picked),
                    *inside_out(kind, self.scene, picked, threads=self.threads),
                ]
        finally:
            for spec, culler in cullers:
                self._close(spec, culler, outcome)
            if self._engine is not None:
                self._engine.close()
        self._summarise(outcome, path)
        return outcome

    def _prepare(self, spec: str, culler: Culler, outcome: RunOutcome) -> Job | None:
        record = CullerRecord(spec, Promise.CONSERVATIVE, max_undecided=self.policy.max_undecided)
        outcome.cullers.append(record)
        try:
            # Here and below a plug-in gets records of its own, and is not asked for its own later.
            with settings_restored():
                record.promise = _promise(culler)
                if self._now.moving is not None and not culler.moves:
                    raise CullerError("it is for scenes that stand still: it has no update()")
                units = _checked(culler.prepare(self._now.handed_out()), self._now)
                # `prepare` may have settled what the options promise.
                record.promise = _promise(culler)
        except NothingToJudge as error:
            record.failed = True
            outcome.findings.append(Finding(Code.NO_GL, str(error), culler=spec))
            return None
        except (InputError, KeyboardInterrupt):
            raise
        except BaseException as error:  # a plug-in may raise anything; the others go on
            self._fail(record, outcome, None, error)
            return None
        record.unit_kind, record.unit_count = units.kind, units.count
        return Job(spec, culler, record, units)

    def _close(self, spec: str, culler: Culler, outcome: RunOutcome) -> None:
        try:
            with settings_restored():
                culler.close()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plug-in may raise anything; the others are closed too
            record = next((r for r in outcome.cullers if r.spec == spec), None)
            if record is not None:
                self._fail(record, outcome, None, error)

    def _fail(
        self, record: CullerRecord, outcome: RunOutcome, frame: int | None, error: BaseException
    ) -> None:
        record.failed = True
        text = fault_text(error)
        outcome.findings.append(Finding(Code.CULLER_FAILED, text, culler=record.spec, frame=frame))

    def _pose(self, scene: Scene, frame: int, jobs: Sequence[Job], outcome: RunOutcome) -> None:
        """Let everybody meet the scene of a frame, where it is not that of the frame before."""
        if scene is self._now:
            return
        self._now = scene
        if self._exact is not None and not isinstance(self._engine, ExactEngine):
            self._exact.pose(scene)
        for sees in (self._engine, self.image_check):
            if isinstance(sees, TruthEngine):
                sees.pose(scene)
        for job in jobs:
            if job.record.failed:
                continue
            try:
                with settings_restored():
                    job.culler.update(scene.handed_out())
            except (InputError, KeyboardInterrupt):
                raise
            except BaseException as error:  # a plug-in may raise anything; the others go on
                self._fail(job.record, outcome, frame, error)

    def _frame(
        self,
        path: CameraPath,
        frame: int,
        jobs: Sequence[Job],
        outcome: RunOutcome,
        listeners: Sequence[Listener],
    ) -> None:
        cameras = path.views(frame)
        casts: dict[str, Cast] = {}
        if self.recorded is None:
            for camera in cameras:
                casts[camera.view] = self._cast(camera, frame, listeners, len(cameras) > 1)
        if jobs:
            seen = {camera.view: self._seen(frame, camera.view, casts) for camera in cameras}
            self._ages.look(frame, cameras[0].cut, seen, ALL_VIEWS)
        self._ask_all(cameras, frame, jobs, outcome, casts, listeners)

    def _ask_all(
        self,
        cameras: Sequence[Camera],
        frame: int,
        jobs: Sequence[Job],
        outcome: RunOutcome,
        casts: dict[str, Cast],
        listeners: Sequence[Listener],
    ) -> None:
        """Ask each culler about all views of a frame, joint or one by one."""
        for job in jobs:
            if job.record.failed:
                continue
            try:
                joint = bool(job.culler.joint)
            except Exception as error:  # a plug-in's may be anything
                self._fail(job.record, outcome, frame, error)
                continue
            for cell in [cameras] if joint else [(camera,) for camera in cameras]:
                if not job.record.failed:
                    self._cell(cell, frame, job, casts, outcome, listeners)
            if not job.record.failed:
                self._audit(job, frame, casts, outcome)

    def _seen(self, frame: int, view: str, casts: Mapping[str, Cast]) -> NDArray[np.bool_]:
        """(n,) bool, the objects that own a sample of a view."""
        if self.recorded is None:
            return casts[view][1].visible
        seen = np.zeros(self._now.object_count, np.bool_)
        seen[self.recorded.views[frame, view].objects] = True
        return seen

    def _audit(self, job: Job, frame: int, casts: Mapping[str, Cast], outcome: RunOutcome) -> None:
        """Hold the boxes that the culler says it tested against what they stand for."""
        truths = [truth for truth, _ in casts.values()]
        try:
            with settings_restored():
                boxes = job.culler.bounds()
            if boxes is not None:
                job.record.tells_boxes = True
                job.audit.look(frame, self._now, job.units, boxes, truths)
        except (InputError, KeyboardInterrupt):
            raise
        except BaseException as error:  # a plug-in may raise anything; the others go on
            self._fail(job.record, outcome, frame, error)
        job.record.too_small = list(job.audit.found.values())

    def _cell(
        self,
        cameras: Sequence[Camera],
        frame: int,
        job: Job,
        casts: dict[str, Cast],
        outcome: RunOutcome,
        listeners: Sequence[Listener],
    ) -> None:
        """One culler's drawn set for these views, judged. Truths that it needs go to `casts`."""
        try:
            drawn_set, ignored = without_absent(self._now, job.units, self._cull(job, cameras))
            # A rasteriser may declare more for each camera that it sees: once a frame.
            with settings_restored():
                raster = raster_of(job.culler)
        except (InputError, KeyboardInterrupt):
            raise
        except BaseException as error:  # a plug-in may raise anything; the others go on
            self._fail(job.record, outcome, frame, error)
            return
        if raster is not None:
            job.record.raster = looser(job.record.raster, raster.tolerance)
        for unit in ignored.tolist():
            job.record.ignored.setdefault(unit, frame)
        drawn_units = drawn_set.unit_ids
        drawn = job.units.mask(drawn_units, self._now.triangle_count)
        verdict = None
        if self.recorded is not None:
            rows = [self.recorded.views[frame, camera.view] for camera in cameras]
            verdict = _clean_verdict(self._now, rows, job, drawn_units)
        settled: tuple[SettledFrame, ...] = ()
        if verdict is None:
            try:
                settled = tuple(
                    self._settled(camera, frame, job, drawn_units, drawn, raster, casts)
                    for camera in cameras
                )
            except CullerError as error:  # its rasteriser's picture is the plug-in's too
                self._fail(job.record, outcome, frame, error)
                return
            verdict = located(judge(joined(settled), job.record.promise), cameras)
        view = cameras[0].view if len(cameras) == 1 else ALL_VIEWS
        verdict = self._ages.aged(verdict, frame, view, job.spec, job.units, settled)
        verdict = self._accepting.verdict(verdict, job.record.promise, frame, job.spec)
        differ = None
        if self.image_check is not None:
            differ = sum(self.image_check.pixels_differ(camera, drawn) for camera in cameras)
        record = FrameRecord(
            frame,
            view,
            cameras[0].width,
            verdict,
            drawn_set.stats,
            int(np.count_nonzero(drawn)),
            sum(one.rulings.corrections for one in settled),
            differ,
        )
        job.record.frames.append(record)
        judged = JudgedFrame(record, settled, drawn_set, drawn)
        for listener in listeners:
            listener.on_verdict(job, judged)
        if not self.keeps_superfluous:
            kept = replace(verdict, superfluous_units=np.zeros(0, np.int32))
            job.record.frames[-1] = replace(record, verdict=kept)

    def _settled(
        self,
        camera: Camera,
        frame: int,
        job: Job,
        drawn_units: Int32,
        drawn: NDArray[np.bool_],
        raster: Raster | None,
        casts: dict[str, Cast],
    ) -> SettledFrame:
        if camera.view not in casts:
            casts[camera.view] = self._cast(camera, frame, (), True)
        truth, seen = casts[camera.view]
        return settle(
            self._now,
            truth,
            job.units,
            drawn_units,
            exact=self._arithmetic,
            raster=raster,
            drawn=drawn,
            seen=seen,
            only_visible=not job.record.promise.may_draw_hidden,
        )

    def _cast(self, camera: Camera, frame: int, listeners: Sequence[Listener], keep: bool) -> Cast:
        """A view's truth; in arrays of its own where others are cast before it is done with."""
        if self._engine is None:
            self._engine = engine = self.engine()
            moving = self._now.moving is not None
            if moving and not engine.poses:
                raise InputError(
                    f"engine '{engine.name}' casts scenes that stand still",
                    fix="use another, such as 'exact'",
                )
            if moving and engine.scene is not self._now:
                engine.pose(self._now)
        with Stopwatch() as watch:
            truth = self._engine.frame(camera)
            if truth.ties_complete != self._engine.exact:
                # An engine that lists its ties and says so nowhere is taken at its class's word.
                truth = replace(truth, ties_complete=self._engine.exact)
            if keep:
                truth = truth.copy()
            seen = objects_seen(truth, self._now)
            moved, triangle = greatest_move(self._now, truth)
            self._moved = max(self._moved, (moved, -frame, triangle))
        for listener in listeners:
            listener.on_truth(frame, truth, seen, watch.ms)
        return truth, seen

    def _cull(self, job: Job, cameras: Sequence[Camera]) -> DrawnSet:
        handed = tuple(camera.handed_out() for camera in cameras)
        with settings_restored(), Stopwatch() as watch:
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

    def _arithmetic(self) -> ExactScene:
        if self._exact is None:
            engine = self._engine
            if isinstance(engine, ExactEngine):
                self._exact = engine.arithmetic
            else:
                self._exact = ExactScene(self._now, threads=self.threads)
        return self._exact

    def _summarise(self, outcome: RunOutcome, path: CameraPath) -> None:
        outcome.findings.extend(policy_findings(self._accepting, outcome.cullers, path.numbers))
        for record in outcome.cullers:
            outcome.findings.extend(culler_findings(record, self.scene))
        engine = self._engine
        caster: RecordedTruth | TruthEngine | None = self.recorded or engine
        if caster is not None and not caster.exact:
            name = caster.engine if isinstance(caster, RecordedTruth) else caster.name
            outcome.findings.append(
                Finding(Code.ENGINE_BLIND_SPOTS, f"the truth was cast by '{name}'")
            )
        moved, frame, triangle = self._moved
        if moved > FORGIVEN_PX:
            owner = self.scene.names[self.scene.object_of_triangle[triangle]]
            outcome.findings.append(
                Finding(Code.VERTICES_ROUNDED, f"by {moved:.3g} pixels at most", "", -frame, owner)
            )
        if engine is not None and not getattr(engine, "rebase_exact", True):
            outcome.findings.append(Finding(Code.REBASE_INEXACT, "the scene spans too far"))


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


def _clean_verdict(
    scene: Scene, rows: Sequence[FrameRows], job: Job, drawn_units: Int32
) -> FrameVerdict | None:
    """The verdict on a set from a recorded truth, `rows` of each view that the set is for, or None
    if the views must be looked at by sample.

    Enough where units are objects and every object that some view sees was drawn whole.
    """
    if scene.has_mask or job.units.kind != OBJECT:
        return None
    visible = np.unique(np.concatenate([view.objects for view in rows]))
    if not np.isin(visible, drawn_units).all():
        return None
    superfluous = np.setdiff1d(drawn_units, visible).astype(np.int32)
    superfluous = superfluous[job.units.sizes[superfluous] > 0]
    if len(superfluous) and not job.record.promise.may_draw_hidden:
        return None
    owned = [view.owned for view in rows]
    counts = Counts(
        visible=len(visible),
        owned_samples=sum(count or 0 for count in owned),
        drawn=len(drawn_units),
        superfluous=len(superfluous),
    )
    known = None if None in owned else counts.owned_samples
    return FrameVerdict(counts, (), superfluous, owned=known)
