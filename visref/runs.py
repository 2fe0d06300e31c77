"""Whole runs, from inputs to files: a run folder, and a file of truth.

`visref.judging` decides and `visref.run_folder` writes; this brings them together, for the command
line and for Python alike.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise
from math import gcd
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from visref.alignment import misaligned
from visref.between.search import FrameGeometry, GeometricSearch, write_geometric
from visref.causes.evidence import Evidence
from visref.causes.search import find_causes
from visref.culler import Culler
from visref.engines import TruthEngine, check_engine, make_engine
from visref.engines.rays import RayEngine
from visref.errors import InputError
from visref.exact import ExactScene
from visref.files import refuse_inputs, replacing_file, replacing_folder
from visref.findings import Finding
from visref.inputs import Inputs, open_inputs
from visref.judging.again import Answers, Difference, ask, mark_unsteady
from visref.judging.asking import Job, Panel
from visref.judging.outcome import RunOutcome
from visref.judging.policy import Policy
from visref.judging.referee import ImageCheck, JudgedFrame, Listener, Referee
from visref.merging import merge_into
from visref.merging.joining import Cell, Joined
from visref.picking import Shard, evenly_picked
from visref.recordings.truth_file import TRUTH_BEGINS, TruthTable, path_digest, read_truth
from visref.recordings.visible_sets import Replay
from visref.registry import DEFAULT_ENGINE
from visref.run_folder.layout import PART, RUN_FOLDER, TRUTH
from visref.run_folder.part import InputFindings, Part, PartKeeper
from visref.run_folder.read import read_run
from visref.run_folder.write import RunWriter, write_json
from visref.visibility import FrameTruth, ObjectVisibility

# Makes the cullers of a run anew, with the same names; they live until the block ends.
MakingAnew = Callable[[], AbstractContextManager[Sequence[tuple[str, Culler]]]]


class Misaligned(StrEnum):
    """What becomes of the status of a recording that fits another input: it stays, or nothing is
    concluded from it. It stays in any case where an engine may err that way by itself."""

    KEEP = "keep"
    INCONCLUSIVE = "inconclusive"


def judge_to_folder(
    inputs: Inputs,
    cullers: Sequence[tuple[str, Culler]],
    out: Path | str,
    *,
    truth: Path | str | None = None,
    pictures: int = 4,
    image_check: bool = False,
    if_misaligned: Misaligned = Misaligned.KEEP,
    listeners: Sequence[Listener] = (),
    policy: Policy | None = None,
    repeat: int = 1,
    anew: MakingAnew | None = None,
    shard: Shard | None = None,
) -> RunOutcome:
    """Judge cullers, each with the name that reports give it, and write the run folder `out`.

    `truth`: a truth file to take instead of casting again; its engine looks at what was missed.
    `pictures`: how many frames to draw, evenly picked. `image_check`: redraw each drawn set by
    OpenGL and compare it with the unculled picture. `policy`: what the user accepts
    (`visref.judging.policy_file.read_policy`). `repeat`: how often cullers are asked about all
    frames, each time made by `anew` but for the first; who answers otherwise is inconclusive.
    `if_misaligned`: what becomes of a recording that fits another input. `shard`: the part of the
    run to judge; `visref.merging` makes the whole of all.

    Raises InputError where `out` cannot be written to, holds what is no run, or is or holds one of
    the inputs, and where the truth file is of another scene, path or engine; NothingToJudge where
    an engine cannot start.
    """
    if pictures < 0:
        raise InputError(f"--pictures is {pictures}", fix="give 0 or more")
    if repeat < 1 or (repeat > 1 and anew is None):
        raise InputError(f"--repeat is {repeat}", fix="give 1 or more, and a way to make cullers")
    scene, frames = inputs.scene, inputs.frames
    part = None
    if shard is not None:
        part = Part(shard, tuple(frames), 0 if policy is None else policy.latency_frames)
        if not part.judged:
            raise InputError(
                f"--shard {shard} has no frame: the run has {len(frames)}", fix="give fewer shards"
            )
    refuse_inputs(out, [*inputs.files, truth, policy.source if policy is not None else None])
    recorded = None
    if truth is not None:
        truth = Path(truth)
        recorded = read_truth(truth, scene, inputs.path, frames)
        inputs = _of_the_same_engine(inputs, recorded.engine, truth)
    with replacing_folder(out, kind=RUN_FOLDER) as folder, ExitStack() as closing:
        checker = None
        if image_check:
            # Any engine that redraws and compares pictures would do.
            checker = make_engine("gl", inputs.timeline.still)
            closing.callback(checker.close)
        planned = [frames[i] for i in evenly_picked(len(frames), pictures)]
        writer = RunWriter(
            folder,
            scene,
            inputs.path,
            timeline=inputs.timeline,
            engine=inputs.engine,
            exact=recorded.exact if recorded is not None else None,
            settings={
                **inputs.settings,
                "frames": _slice(frames),
                **({"repeat": repeat} if repeat > 1 else {}),
                **({} if if_misaligned is Misaligned.KEEP else {"if_misaligned": if_misaligned}),
                **({} if shard is None else {"shard": str(shard)}),
            },
            policy=policy,
            picture_frames=planned,
            part=part,
        )
        keeper = None if part is None else PartKeeper(folder, part, scene, inputs.path)
        referee = Referee(
            scene,
            inputs.make_engine,
            threads=inputs.threads,
            recorded=recorded,
            image_check=cast(ImageCheck | None, checker),
            examine=True,
            keeps_superfluous=False,  # the folder has them
            timeline=inputs.timeline,
            policy=policy or Policy(),
        )
        answers = Answers()
        kept: list[Listener] = [answers] if repeat > 1 else []
        if keeper is not None:
            kept.append(keeper)
        evidence = Evidence()
        if shard is None:
            kept.append(evidence)
        outcome = referee.run(
            inputs.path, frames, cullers, [writer, *kept, *listeners], shard=shard
        )
        again = []
        for _ in range(repeat - 1):
            assert anew is not None
            again.append(_asked_again(inputs, anew, answers, outcome, shard))
        mark_unsteady(outcome, again)
        of_inputs = _of_the_input(inputs, cullers, if_misaligned)
        of_inputs.notes += inputs.notes
        of_inputs.recorded += recorded.findings if recorded else ()
        of_inputs.put_first(outcome)
        name_the_causes(inputs, evidence, outcome)
        writer.finish(outcome)
        if keeper is not None:
            said = keeper.finish(
                outcome, referee.facts, of_inputs, again,
                pictures=planned, moved=writer.moved, truth=truth is not None,
            )  # fmt: skip
            write_json(folder / PART, said)
        if truth is not None:
            shutil.copyfile(truth, folder / TRUTH)
    return outcome


def merge_naming(folder: Path, parts: Sequence[Path], inputs: Inputs) -> RunOutcome:
    """The whole of a run's parts, in a folder that is there and empty, with the causes of what was
    missed, for which its `inputs` are needed. Raises what `visref.merging.merge_runs` does."""
    evidence = Evidence()

    def on_cell(cell: Cell) -> None:
        units = cell.part.units.get(cell.spec, inputs.scene.object_units())
        evidence.add(cell.spec, units, cell.record, cell.drawn)

    def after(joined: Joined) -> None:
        name_the_causes(inputs, evidence, joined.outcome)

    return merge_into(folder, parts, on_cell=on_cell, after=after)


def merge_with_scene(parts: Sequence[Path], out: Path, scene: str, path: str | None) -> RunOutcome:
    """`visref.merging.merge_runs`, with the causes of what was missed. Raises InputError too where
    scene or path are not those of the parts."""
    run = read_run(parts[0])
    settings = run.manifest.settings
    inputs = open_inputs(
        scene,
        path=path,
        engine=run.manifest.engine,
        cull_backfaces=bool(settings.get("cull_backfaces")),
        lenient=bool(settings.get("lenient")),
        rest_pose=bool(settings.get("rest_pose")),
    )
    start, stop, step = settings["frames"]
    wanted = frozenset(range(start, stop, step))
    frames_of_run = [one for one in inputs.path.numbers if one in wanted]
    for what, mine, source in (
        ("scene", inputs.scene.digest == run.manifest.scene.sha256, scene),
        ("path", path_digest(inputs.path) == run.manifest.path.sha256, path or scene),
    ):
        if not mine:
            raise InputError(
                f"it is another {what} than that of {parts[0]}",
                source=source,
                fix=f"give the {what} that was judged",
            )
    refuse_inputs(out, [*parts, *inputs.files])
    with replacing_folder(out, kind=RUN_FOLDER) as folder:
        return merge_naming(folder, parts, replace(inputs, frames=frames_of_run))


def name_the_causes(inputs: Inputs, evidence: Evidence, outcome: RunOutcome) -> None:
    """Say why things were missed (`visref.causes`), in the outcome's records."""
    find_causes(
        evidence,
        outcome.cullers,
        inputs.timeline,
        inputs.path,
        inputs.frames,
        inputs.make_engine,
    )


def _asked_again(
    inputs: Inputs,
    anew: MakingAnew,
    answers: Answers,
    outcome: RunOutcome,
    shard: Shard | None,
) -> dict[str, Difference]:
    """Hold the answers of the run against those of cullers that are made anew, by name."""
    frames = inputs.frames
    judged = frames if shard is None else shard.of(frames)
    with anew() as cullers:
        panel = Panel(cullers, inputs.timeline, outcome.policy)
        path = inputs.path.relative_to(inputs.scene.origin)
        again = ask(panel, path, frames, judged)
    return {
        record.spec: Difference.between(answers, again, record, asked)
        for record, asked in zip(outcome.cullers, panel.records, strict=True)
    }


def _of_the_input(
    inputs: Inputs, cullers: Sequence[tuple[str, Culler]], if_misaligned: Misaligned
) -> InputFindings:
    """What is said of recordings that fit another input."""
    found = InputFindings()
    for name, culler in cullers:
        if not isinstance(culler, Replay):
            continue
        finding, by_input_alone = misaligned(
            name, inputs.timeline, inputs.path, culler.recorded, threads=inputs.threads
        )
        if finding is None:
            continue
        found.misaligned.append(finding)
        if by_input_alone and if_misaligned is Misaligned.INCONCLUSIVE:
            found.excused.append(name)
    return found


def _slice(frames: Sequence[int]) -> list[int]:
    """Start, stop and step of the slice that picks these frames, of those that there are."""
    if isinstance(frames, range):
        return [frames.start, frames.stop, frames.step]
    return [frames[0], frames[-1] + 1, gcd(*(b - a for a, b in pairwise(frames))) or 1]


def _of_the_same_engine(inputs: Inputs, engine: str, truth: Path) -> Inputs:
    """Inputs that cast with the engine of a truth file. What that truth says was missed, another
    engine might not see at all."""
    if inputs.engine not in (engine, DEFAULT_ENGINE):
        raise InputError(
            f"it was cast by '{engine}', not '{inputs.engine}'",
            source=str(truth),
            fix="leave --engine out, or cast the truth again",
        )
    try:
        check_engine(engine)
    except InputError as error:
        raise error.at(source=str(truth)) from error
    return replace(inputs, engine=engine)


@dataclass(frozen=True, eq=False)
class CastTruth:
    """What `truth_to_file` found. `visible`: (n,) bool, the objects that own a sample in some
    frame; `between`: who shows between the samples, one per frame, empty unless asked for;
    `findings`: what else a reader should know."""

    visible: NDArray[np.bool_]
    between: tuple[FrameGeometry, ...] = ()
    findings: tuple[Finding, ...] = ()


def truth_to_file(
    inputs: Inputs,
    out: Path | str,
    *,
    geometric: Path | str | None = None,
    listeners: Sequence[Listener] = (),
) -> CastTruth:
    """Cast who owns which samples in each frame and write it to `out`, a Parquet file; with
    `geometric`, who shows between the samples to another.

    Raises InputError where a file cannot be written or is one of the inputs, and NothingToJudge
    where the engine cannot start.
    """
    for file in (out, geometric):
        if file is not None:
            refuse_inputs(file, inputs.files)
    if geometric is not None and Path(geometric).resolve() == Path(out).resolve():
        raise InputError("--geometric and --out are the same file", fix="name two")
    with replacing_file(out, begins=TRUTH_BEGINS) as file:
        engine = inputs.make_engine()
        search = _geometric_search(inputs, engine) if geometric is not None else None
        cast_ = _Casting(inputs, search)
        try:
            # A run without cullers is the truth alone.
            referee = Referee(
                inputs.scene,
                lambda: engine,
                threads=inputs.threads,
                examine=True,
                timeline=inputs.timeline,
            )
            outcome = referee.run(inputs.path, inputs.frames, (), [cast_, *listeners])
        finally:
            engine.close()
            if search is not None:
                search.close()
        if geometric is not None:
            with replacing_file(geometric, begins=TRUTH_BEGINS) as beside:
                write_geometric(
                    beside, inputs.scene, inputs.path, cast_.between, engine=inputs.engine
                )
        cast_.table.write(
            file,
            engine=inputs.engine,
            path=inputs.path,
            ties_complete=engine.exact,
            exact=engine.exact,
        )
    between = tuple(one for _, one in cast_.between)
    return CastTruth(cast_.visible, between, tuple(outcome.findings))


class _Casting:
    """A run's listener that keeps its truth, and with `search` what shows between the samples."""

    def __init__(self, inputs: Inputs, search: GeometricSearch | None) -> None:
        self.table = TruthTable(inputs.scene)
        self.visible = np.zeros(inputs.scene.object_count, np.bool_)
        self.between: list[tuple[int, FrameGeometry]] = []
        self._search = search

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        self.table.add(frame, truth.camera.width, seen, view=truth.camera.view)
        self.visible |= seen.visible
        if self._search is not None:
            self.between.append((frame, self._search.frame(frame, truth.camera, seen)))

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        pass

    def on_frame_done(self, frame: int) -> None:
        pass


def _geometric_search(inputs: Inputs, engine: TruthEngine) -> GeometricSearch:
    """Over the engine's own rays, or Embree's where it casts none."""
    exact = ExactScene(inputs.scene, threads=inputs.threads)
    if isinstance(engine, RayEngine):
        return GeometricSearch(inputs.scene, engine, exact)
    prober = cast(RayEngine, make_engine("embree", inputs.scene, threads=inputs.threads))
    return GeometricSearch(inputs.scene, prober, exact)
