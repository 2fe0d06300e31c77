"""Running what the papers' tables need, each thing once, into a folder that survives an
interrupt.

    OUT/scenes/SCENE-DIGEST/        generated scenes, kept
    OUT/records/PAPER/RUN/          run folders
    OUT/records/PAPER/EXPERIMENT/   experiment.json

Each says what it was asked for and by which code; one that fits is kept, any other is made
anew. So an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from visref.beside import sweep
from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.engines import TruthEngine, make_engine
from visref.errors import InputError, NothingToJudge
from visref.files import FolderKind, make_folder, remove_folder, replacing_folder
from visref.findings import Code
from visref.inputs import generated_with, open_scene
from visref.judging.asking import Job
from visref.judging.referee import JudgedFrame, Referee
from visref.papers import Paper
from visref.papers.contents import Experiment, JudgedRun
from visref.registry import SCENES, available, load_entry, make_culler
from visref.run_folder.inside import json_inside
from visref.run_folder.layout import MANIFEST, RUN_FOLDER, slug
from visref.run_folder.read import RunFolder, read_run
from visref.run_folder.write import RunWriter, write_json
from visref.scene import Scene
from visref.tables.at_once import measuring_at_once
from visref.tables.plan import (
    EXPERIMENTS,
    Task,
    code_digest,
    cut_path,
    sampled,
    side_by_side,
    steps,
    tasks,
)
from visref.tables.progress import Progress
from visref.timeline import Timeline
from visref.visibility import FrameTruth, ObjectVisibility

RESULT = "experiment.json"
_FIELDS = {"asked", "result", "digest"}
ENGINE = "embree"


def _wrote(record: Any) -> Sequence[str] | None:
    ours = isinstance(record, dict) and record.keys() == _FIELDS
    return [re.escape(RESULT)] if ours else None


EXPERIMENT_FOLDER = FolderKind(RESULT, _wrote)


@dataclass(frozen=True, eq=False)
class PaperResults:
    """`visref.papers.contents.Results`, read from disk, a run once; what is not there is None, and
    what is `failed`: an older result is none of this one."""

    folder: Path
    failed: frozenset[str] = frozenset()
    _runs: dict[str, RunFolder | None] = field(default_factory=dict)

    def run(self, key: str) -> RunFolder | None:
        if key not in self._runs:
            folder = self.folder / key
            there = key not in self.failed and (folder / MANIFEST).is_file()
            self._runs[key] = read_run(folder) if there else None
        return self._runs[key]

    def experiment(self, key: str) -> Mapping[str, Any] | None:
        if key in self.failed or not (self.folder / key / RESULT).exists():
            return None
        found = _experiment(self.folder / key)
        if found is None:
            raise InputError(
                "it was changed after it was written: its digest is another",
                source=str(self.folder / key / RESULT),
                fix="remove it, and run again",
            )
        return cast(Mapping[str, Any], found["result"])


@dataclass(frozen=True)
class PaperRuns:
    """What was run: the papers, where their results are, and what failed and why, by
    `PAPER/KEY`; on how many frames, moved by what share of the way to the next (`shift`), and with
    which seed."""

    papers: tuple[Paper, ...]
    out: Path
    frames: int | None
    shift: float = 0.0
    seed: int = 0
    failures: dict[str, str] = field(default_factory=dict)

    def results(self, paper: Paper) -> PaperResults:
        split = (label.partition("/") for label in self.failures)
        failed = frozenset(key for name, _, key in split if name == paper.name)
        return PaperResults(self.out / "records" / paper.name, failed)


@dataclass(frozen=True)
class Measuring:
    """What is measured, beside the tasks: into which folder, on how many frames of every path (None
    for all), moved along it by what share of the way from one to the next, by how many processes at
    once, and with how many threads each (None: all there are)."""

    out: Path
    frames: int | None
    shift: float
    workers: int
    threads: int | None

    def measure(self, tasks: Iterable[Task], progress: Progress) -> dict[str, str]:
        """Do what was not done yet, and say what failed and why, by `PAPER/KEY`."""
        failures: dict[str, str] = {}
        stage = _Stage(self.out / "scenes", self.threads)
        code = code_digest()
        try:
            for task in tasks:
                progress.task(task.label)
                folder = self.out / "records" / task.paper / task.work.key
                asked = self._asked(task, code)
                share = _Share(progress, steps(task, self.frames))
                sweep(folder.parent)
                if _asked_before(folder, task) != asked:
                    try:
                        _run_task(task, folder, asked, stage, (self.frames, self.shift), share)
                    except (InputError, NothingToJudge) as error:
                        failures[task.label] = str(error)
                        # What an earlier run left is no result of this one.
                        remove_folder(folder, _kind(task))
                share.end()
        finally:
            stage.close()
        return failures

    def _asked(self, task: Task, code: str) -> dict[str, Any]:
        """What a result must have been made of to be kept."""
        work = json.loads(json.dumps(vars(task.work)))
        return {
            "work": work,
            "frames": self.frames,
            "shift": self.shift,
            "workers": self.workers,
            "code": code,
            "engine": ENGINE,
        }


def run_all(
    papers: Iterable[Paper],
    out: Path,
    progress: Progress,
    *,
    frames: int | None = None,
    large: bool = False,
    threads: int | None = None,
    shift: float = 0.0,
    seed: int = 0,
    workers: int = 1,
) -> PaperRuns:
    """Run all that the papers need, on `frames` frames of every path (None for all), moved along it
    by a `shift` of the way from one to the next, from -0.5 to 0.5, through scenes generated with
    `seed`, by so many `workers` (processes) at once.

    `progress` must not have threads of its own before it is told to begin: workers are copies of
    this process. A thing that fails is told in `failures`, and its old results are no longer there;
    the others go on. Raises InputError for a number of frames, workers or threads that is none,
    another shift, or an `out` that is a file, or a folder of something else; RuntimeError where a
    worker breaks down.
    """
    if frames is not None and frames < 1:
        raise InputError(f"--frames is {frames}", fix="give 1 or more")
    if not -0.5 <= shift <= 0.5:
        raise InputError(f"--shift is {shift}", fix="give -0.5 to 0.5")
    if seed < 0:
        raise InputError(f"--seed is {seed}", fix="give 0 or more")
    for name, count in (("workers", workers), ("threads", threads)):
        if count is not None and count < 1:
            raise InputError(f"--{name} is {count}", fix="give 1 or more")
    _check_out(out)
    done = PaperRuns(tuple(papers), out, frames, shift, seed)
    todo = tasks(done.papers, large=large, seed=seed)
    measuring = Measuring(out, frames, shift, workers, threads)
    if workers > 1:
        groups = side_by_side(todo, frames)
        beside = {task.label for group in groups for task in group}

        def measure(group: Sequence[Task], told: Progress, cores: int | None) -> dict[str, str]:
            return replace(measuring, threads=cores).measure(group, told)

        with measuring_at_once(measure, groups, workers) as wait:
            progress.begin(sum(steps(task, frames) for task in todo))
            done.failures.update(wait(progress))
        todo = [task for task in todo if task.label not in beside]
    else:
        progress.begin(sum(steps(task, frames) for task in todo))
    done.failures.update(measuring.measure(todo, progress))
    return done


def _check_out(out: Path) -> None:
    """Make the folder, or go on in one. Raises InputError where it is another's."""
    make_folder(out)
    there = {one.name for one in out.iterdir()}
    # Without records it was ended early, if it is one.
    if "records" not in there and there - {"scenes"}:
        raise InputError(
            "cannot write here: it holds what is no tables",
            source=str(out),
            fix="name a new folder",
        )


def _kind(task: Task) -> FolderKind:
    return EXPERIMENT_FOLDER if isinstance(task.work, Experiment) else RUN_FOLDER


class _Share:
    """A task's share of the progress, as a run's listener."""

    def __init__(self, progress: Progress, steps: int) -> None:
        self._progress, self._all, self._left = progress, steps, float(steps)
        self.verdicts = steps

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        step = self._all / self.verdicts
        self._left -= step
        self._progress.advance(step)

    def on_frame_done(self, frame: int) -> None:
        pass

    def end(self) -> None:
        self._progress.advance(self._left)


def _asked_before(folder: Path, task: Task) -> object:
    """What the result on disk was asked for, None where there is none."""
    try:
        if isinstance(task.work, Experiment):
            found = _experiment(folder)
            return None if found is None else found["asked"]
        return json_inside(folder, MANIFEST, "")["settings"]["asked"]
    except (InputError, KeyError, TypeError):
        return None


def _experiment(folder: Path) -> dict[str, Any] | None:
    """What stands in an experiment's file, None unless it is as it was written. What an experiment
    found has a form that only its paper knows, so a digest tells whether it was changed."""
    found = json_inside(folder, RESULT, "remove it, and run again")
    if not isinstance(found, dict) or found.keys() != _FIELDS:
        return None
    return found if found["digest"] == _digest(found["asked"], found["result"]) else None


def _digest(asked: object, result: object) -> str:
    """SHA-256 (hexadecimal) of what was asked for and what was found."""
    said = json.dumps([asked, result], sort_keys=True, allow_nan=False)
    return hashlib.sha256(said.encode()).hexdigest()


class _Stage:
    """The scene at hand, and its truth engine: kept while the tasks are of that scene."""

    def __init__(self, folder: Path, threads: int | None) -> None:
        self._folder, self._threads = folder, threads
        self._wanted: tuple[str, bool] | None = None
        self._opened: tuple[Scene, CameraPath] | None = None
        self._engine: TruthEngine | None = None

    def scene(self, spec: str, *, cull_backfaces: bool) -> tuple[Scene, CameraPath]:
        if self._wanted != (spec, cull_backfaces) or self._opened is None:
            self.close()
            points, name = available(SCENES), spec.partition(":")[0]
            package = points[name].module.partition(".")[0] if name in points else "visref"
            kept = self._folder / f"{slug(spec)}-{code_digest([package])}"
            scene, path, _ = open_scene(spec, cull_backfaces=cull_backfaces, kept_in=kept)
            if path is None:
                raise InputError("a paper's scene is a generated one", source=spec)
            self._wanted, self._opened = (spec, cull_backfaces), (scene, path)
        return self._opened

    def engine(self) -> TruthEngine:
        """Of the scene at hand. It outlives the runs that use it."""
        assert self._opened is not None
        if self._engine is None:
            self._engine = make_engine(ENGINE, self._opened[0], threads=self._threads)
        return self._engine

    def close(self) -> None:
        if self._engine is not None:
            self._engine.close()
        self._engine, self._opened = None, None


class _Kept(TruthEngine):
    """An engine that stays open when a run is through with it: the next one uses it too."""

    def __init__(self, engine: TruthEngine) -> None:
        super().__init__(engine.scene, threads=engine.threads)
        self._engine = engine
        self.name = engine.name  # type: ignore[misc]
        self.rebase_exact = getattr(engine, "rebase_exact", True)

    def frame(self, camera: Camera) -> FrameTruth:
        return self._engine.frame(camera)


def _run_task(
    task: Task,
    folder: Path,
    asked: dict[str, Any],
    stage: _Stage,
    sampling: tuple[int | None, float],
    share: _Share,
) -> None:
    work = task.work
    scene = path = None
    picked: list[int] = []
    if work.scene is not None:
        scene, path = stage.scene(work.scene, cull_backfaces=work.cull_backfaces)
        frames, shift = sampling
        picked = sampled(len(path), frames, work.stretch, shift)
        path = cut_path(path if work.size is None else path.resized(*work.size), picked)
    with replacing_folder(folder, kind=_kind(task)) as written:
        if isinstance(work, Experiment):
            entry = cast(Any, load_entry(EXPERIMENTS, work.name, kind="experiment"))
            if path is not None:
                path = CameraPath([path.frame(frame) for frame in picked], path.source)
            result = json.loads(json.dumps(entry(scene, path), allow_nan=False))
            record = {"asked": asked, "result": result, "digest": _digest(asked, result)}
            write_json(written / RESULT, record)
        else:
            assert scene is not None
            assert path is not None
            _judge(work, scene, path, picked, written, asked, stage, share)


def _judge(
    judged: JudgedRun,
    scene: Scene,
    path: CameraPath,
    frames: list[int],
    folder: Path,
    asked: dict[str, Any],
    stage: _Stage,
    share: _Share,
) -> None:
    share.verdicts = len(frames) * len(judged.cullers)
    settings = {
        "frames": frames,
        "generated": generated_with(judged.scene),
        "asked": asked,
        "cull_backfaces": judged.cull_backfaces,
    }
    timeline = Timeline(scene, path)
    writer = RunWriter(folder, scene, path, timeline=timeline, engine=ENGINE, settings=settings)

    def engine() -> TruthEngine:
        # An engine that is kept is one of a scene that stands still.
        return make_engine(ENGINE, timeline.still) if timeline.moves else _Kept(stage.engine())

    referee = Referee(scene, engine, timeline=timeline)
    cullers = [(spec, make_culler(spec)) for spec in judged.cullers]
    outcome = referee.run(path, frames, cullers, [writer, share])
    for finding in outcome.findings:
        # A table of the frames before it would be a table of something else.
        if finding.code in (Code.CULLER_FAILED, Code.NO_GL):
            raise NothingToJudge(f"{finding.culler}: {finding.message}")
    writer.finish(outcome)
