"""Scene × path × cullers: the order of work, and what a run concludes.

Each view of a frame is cast once and judged against every culler (`Sitting`); without cullers a run
is the truth alone. With a recorded truth, a frame is cast again only if a culler left something
visible out of it. How old a miss is and what a policy says of it hang on frames before it and on
the user alone: `Review` says that of verdicts as they come, or later, of verdicts on file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import Culler, CullerError, DrawnSet, Promise, Raster, Recorded
from visref.engines.base import TruthEngine
from visref.findings import Finding
from visref.judging.ages import Followed
from visref.judging.asking import Answer, Job, Panel
from visref.judging.casting import AHEAD, Asked, Cast, Casting
from visref.judging.frame import SettledFrame
from visref.judging.holders import DrawList
from visref.judging.joint import all_drawn, joined, judge_all_drawn, located
from visref.judging.judge import FrameVerdict, judge
from visref.judging.on_file import clean_verdict
from visref.judging.outcome import ALL_VIEWS, FrameRecord, RunOutcome
from visref.judging.policy import Policy
from visref.judging.rasters import looser
from visref.judging.review import Review
from visref.judging.settle import settle
from visref.judging.summary import Caster, Facts, conclude, examined
from visref.picking import Shard, Stretch
from visref.recordings.truth_file import RecordedTruth
from visref.scene import Int32, Scene
from visref.timeline import Timeline
from visref.visibility import FrameTruth, ObjectVisibility


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


class Parting(Protocol):
    """Takes what a run found so far, so that it need not be held until the end."""

    def due(self, frame: int) -> bool:
        """Whether what was found up to this frame, which is through, is to be taken now."""
        ...

    def take(self, outcome: RunOutcome, frame: int) -> None:
        """What was found since the last time; its records are emptied once this returns."""
        ...


@dataclass(frozen=True, eq=False)
class JudgedFrame:
    """What a listener may want to keep of one culler's answer. `settled`: what the verdict rests
    on, one per view of the drawn set, none where a recorded truth was enough. `followed`: where
    units are finer than objects, what their ages hang on.
    """

    record: FrameRecord
    settled: tuple[SettledFrame, ...]
    drawn_set: DrawnSet
    draw_list: DrawList
    followed: Followed | None = None

    @property
    def drawn(self) -> NDArray[np.bool_]:
        """(t,) bool, the triangles drawn."""
        return self.draw_list.triangles

    @property
    def drawn_units(self) -> Int32:
        """(k,) int32, the ids of the units drawn."""
        return self.drawn_set.unit_ids


# What becomes of a verdict as it was found: the job, its frame's record, and what it rests on.
OnVerdict = Callable[[Job, JudgedFrame], None]
OnTruth = Callable[[int, FrameTruth, ObjectVisibility, float], None]


def _judge_joined(settled: Sequence[SettledFrame], promise: Promise) -> FrameVerdict:
    return judge(joined(settled), promise)


@dataclass(eq=False)
class Sitting:
    """A referee at work: whatever frame is asked for is cast and judged by itself. Verdicts are as
    they are found: their misses have no age yet, and no policy was asked.

    The fields are the referee's. `path` is relative to the scene's origin. While a frame is judged
    the truths of those that follow are cast, unless a culler is then at work that should have the
    machine to itself.
    """

    path: CameraPath
    timeline: Timeline
    panel: Panel
    engine: Callable[[], TruthEngine]
    threads: int | None = None
    recorded: RecordedTruth | None = None
    image_check: ImageCheck | None = None
    shares_cores: bool = False

    def __post_init__(self) -> None:
        self.casting = Casting(self.engine, self.threads)
        # Whom everybody met last; None where somebody has met another since.
        self._posed: Scene | None = self.timeline.still

    def frame(
        self, frame: int, jobs: Sequence[Job], on_truth: OnTruth, on_verdict: OnVerdict,
        before: Callable[[Mapping[str, NDArray[np.bool_]]], None] = lambda seen: None,
        following: Sequence[int] = (),
    ) -> None:  # fmt: skip
        """Judge a frame by these jobs. `before` is given, by view, (n,) bool, which objects own a
        sample, before any culler is asked. `following`: the frames that will be asked for next."""
        self._pose(frame)
        cameras = self.path.views(frame)
        casts: dict[str, Cast] = {}
        if self.recorded is None:
            ahead: list[Asked] = []
            if self._may_cast_ahead():
                ahead = [(one, self.path.views(one)) for one in following]
            views = self.casting.views(frame, cameras, self.panel.scene, ahead)
            for camera, view in zip(cameras, views, strict=True):
                on_truth(frame, view.truth, view.seen, view.ms)
                casts[camera.view] = view.truth, view.seen
        if not jobs:
            return
        before({camera.view: self._seen(frame, camera.view, casts) for camera in cameras})
        for job in jobs:
            for cell, answer in self.panel.cells(job, cameras, frame):
                self._cell(cell, answer, frame, job, casts, on_verdict)
            if not job.record.failed:
                boxes = self.panel.bounds(job, frame)
                self.panel.audit(job, frame, boxes, [truth for truth, _ in casts.values()])

    def begin(self, frames: Sequence[int], first: int | None) -> None:
        """Let cullers meet the scene, and look back from the frame `first` of a run over `frames`,
        all ascending."""
        self.panel.prepare(frames[0] if frames else None)
        if first is not None:
            self.panel.warm_up(self.path, frames, first)
        self._posed = self.panel.scene
        if self._posed is not self.timeline.still and isinstance(self.image_check, TruthEngine):
            self.image_check.pose(self._posed)

    def examine(self, scene: Scene, frames: Sequence[int]) -> list[Finding]:
        """What is to be said of engine and scene once a run over these frames is through."""
        caster = self.casting.engine
        if caster is None or not frames:
            return []
        # Whichever part of the run this is: as at the end of the whole.
        last = self.timeline.at(frames[-1])
        if last is not self.panel.scene:
            caster.pose(last)
            self._posed = None
        return examined(caster, scene, self.path, frames, self.threads)

    def _pose(self, frame: int) -> None:
        """Let everybody meet the scene of a frame, where it is not that of the frame before."""
        self.panel.pose(frame)
        scene = self.panel.scene
        if scene is self._posed:
            return
        self._posed = scene
        self.casting.pose(scene)
        if isinstance(self.image_check, TruthEngine):
            self.image_check.pose(scene)

    def _may_cast_ahead(self) -> bool:
        if self.timeline.moves:
            return False
        return self.shares_cores or all(isinstance(job.culler, Recorded) for job in self.panel.jobs)

    def _seen(self, frame: int, view: str, casts: Mapping[str, Cast]) -> NDArray[np.bool_]:
        """(n,) bool, the objects that own a sample of a view."""
        if self.recorded is None:
            return casts[view][1].visible
        return self.recorded.seen(frame, view, self.panel.scene.object_count)

    def _cell(
        self,
        cameras: Sequence[Camera],
        answer: Answer,
        frame: int,
        job: Job,
        casts: dict[str, Cast],
        on_verdict: OnVerdict,
    ) -> None:
        """One culler's drawn set for these views, judged. Truths that it needs go to `casts`."""
        scene, drawn_set = self.panel.scene, answer.drawn_set
        if answer.raster is not None:
            job.record.raster = looser(job.record.raster, answer.raster.tolerance)
        for unit in answer.ignored.tolist():
            job.record.ignored.setdefault(unit, frame)
        drawn = DrawList(job.holders, drawn_set.unit_ids)
        verdict = None
        if self.recorded is not None:
            rows = [self.recorded.views[frame, camera.view] for camera in cameras]
            verdict = clean_verdict(scene, rows, job, drawn.unit_ids)
        settled: tuple[SettledFrame, ...] = ()
        if verdict is None:
            try:
                settled = tuple(
                    self._settled(camera, frame, job, answer.raster, drawn, casts)
                    for camera in cameras
                )
            except CullerError as error:  # its rasteriser's picture is the plug-in's too
                self.panel.fail_in_frame(job.record, frame, error)
                return
            judges = judge_all_drawn if all_drawn(settled) else _judge_joined
            verdict = located(judges(settled, job.record.promise), cameras)
        view = cameras[0].view if len(cameras) == 1 else ALL_VIEWS
        differ = None
        if self.image_check is not None:
            check = self.image_check
            differ = sum(check.pixels_differ(camera, drawn.triangles) for camera in cameras)
        record = FrameRecord(
            frame,
            view,
            cameras[0].width,
            verdict,
            drawn_set.stats,
            drawn.triangle_count,
            sum(one.rulings.corrections for one in settled),
            differ,
        )
        on_verdict(job, JudgedFrame(record, settled, drawn_set, drawn))

    def _settled(
        self,
        camera: Camera,
        frame: int,
        job: Job,
        raster: Raster | None,
        drawn: DrawList,
        casts: dict[str, Cast],
    ) -> SettledFrame:
        if camera.view not in casts:
            casts[camera.view] = self.casting.view(frame, camera, self.panel.scene)
        if self.recorded is not None:
            self.casting.moved[frame].want(job.spec)
        truth, seen = casts[camera.view]
        return settle(
            self.panel.scene,
            truth,
            drawn,
            exact=partial(self.casting.arithmetic, self.panel.scene),
            raster=raster,
            seen=seen,
            only_visible=not job.record.promise.may_draw_hidden,
        )

    def close(self) -> None:
        """Let cullers and engine go."""
        try:
            self.panel.close()
        finally:
            self.casting.close()


@dataclass(eq=False)
class Referee:
    """Casts truths and judges cullers on one scene, which a path's frames may pose.

    `timeline`: the scene of each of the path's frames; by default `scene` and the path make it.
    Where something moves, the engine is to be made of `timeline.still`. `engine` makes the truth
    engine on first use, so that a recorded truth with nothing to dispute never builds one. It
    must be the engine that cast a recorded truth: another may not see what that truth says was
    missed. `examine`: say too, where an engine is built, whether near, far or the winding hide
    most of the scene; then the engine must cast any camera. `held`: what the records hold
    of a verdict once the listeners have seen it; by default all of it, which of a long run is much.
    `policy`: what the user accepts. `shares_cores`: others judge at the same time, so that no
    culler has the machine to itself.
    """

    scene: Scene
    engine: Callable[[], TruthEngine]
    threads: int | None = None
    recorded: RecordedTruth | None = None
    image_check: ImageCheck | None = None
    examine: bool = False
    held: Callable[[FrameVerdict], FrameVerdict] | None = None
    timeline: Timeline | None = None
    policy: Policy = field(default_factory=Policy)
    shares_cores: bool = False

    def __post_init__(self) -> None:
        self.facts = Facts()
        self._sitting: Sitting | None = None

    @property
    def caster(self) -> TruthEngine | None:
        """The engine of the run that is under way, once it has cast. Its next answer may take the
        arrays of the last: to be asked between frames."""
        return None if self._sitting is None else self._sitting.casting.engine

    def run(
        self,
        path: CameraPath,
        frames: Iterable[int],
        cullers: Sequence[tuple[str, Culler]],
        listeners: Sequence[Listener] = (),
        *,
        shard: Shard | Stretch | None = None,
        parting: Parting | None = None,
    ) -> RunOutcome:
        """Judge every culler on these frames of the path, in order; of a `shard`, in its frames
        alone, as the whole run would judge them. What was found beside verdicts is in `facts`.
        What `parting` took is in neither."""
        path = path.relative_to(self.scene.origin)
        frames = list(frames)
        judged = frames if shard is None else shard.of(frames)
        timeline = self.timeline or Timeline(self.scene, path)
        panel = Panel(cullers, timeline, self.policy)
        sitting = Sitting(
            path, timeline, panel, self.engine, self.threads, self.recorded, self.image_check,
            self.shares_cores,
        )  # fmt: skip
        review = Review(self.policy, self.scene)
        known: list[Finding] | None = None
        parted = False

        def examine() -> list[Finding]:
            # Once: nothing of it hangs on what was judged.
            nonlocal known
            if known is None and self.examine and sitting.casting.caster is not None:
                known = sitting.examine(self.scene, frames)
            return known or []

        def concluded(findings: list[Finding]) -> RunOutcome:
            self.facts = facts = Facts(examined=findings, failures=panel.failures)
            outcome = RunOutcome(panel.records, policy=self.policy)
            facts.caster = sitting.casting.caster
            if self.recorded is not None:
                facts.recorded = Caster(self.recorded.engine, self.recorded.exact)
            facts.moved = list(sitting.casting.moved.values())
            whole = len(judged) == len(frames) and not parted
            conclude(outcome, facts, review.accepting, path.numbers, self.scene, whole=whole)
            return outcome

        try:
            sitting.begin(frames, judged[0] if judged else None)
            if self.recorded is not None and panel.jobs:
                review.look_back(path, frames[: frames.index(judged[0])], self.recorded, self.scene)
            self._sitting = sitting
            for place, frame in enumerate(judged):
                following = judged[place + 1 : place + 1 + AHEAD]
                self._judge(sitting, frame, following, review, listeners)
                for listener in listeners:
                    listener.on_frame_done(frame)
                if parting is not None and frame != judged[-1] and parting.due(frame):
                    parted = True
                    # Between frames: the engine may be asked.
                    parting.take(concluded(examine()), frame)
                    panel.forget()
                    sitting.casting.moved.clear()
            findings = examine()
        finally:
            self._sitting = None
            sitting.close()
        return concluded(findings)

    def _judge(
        self,
        sitting: Sitting,
        frame: int,
        following: Sequence[int],
        review: Review,
        listeners: Sequence[Listener],
    ) -> None:
        cut = sitting.path.views(frame)[0].cut

        def on_truth(frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
            for listener in listeners:
                listener.on_truth(frame, truth, seen, ms)

        def on_verdict(job: Job, judged: JudgedFrame) -> None:
            record = judged.record
            followed = Followed.of(job.units, judged.settled, record.verdict)
            verdict = review.verdict(record, job.record.promise, job.spec, cut, followed)
            record = replace(record, verdict=verdict)
            job.record.frames.append(record)
            told = replace(judged, record=record, followed=followed)
            for listener in listeners:
                listener.on_verdict(job, told)
            if self.held is not None:
                job.record.frames[-1] = replace(record, verdict=self.held(verdict))

        def before(seen: Mapping[str, NDArray[np.bool_]]) -> None:
            review.look(frame, cut, seen)

        sitting.frame(frame, sitting.panel.jobs, on_truth, on_verdict, before, following)
