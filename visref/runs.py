"""Whole runs, from inputs to files: a run folder, and a file of truth.

`visref.judging` decides and `visref.run_folder` writes; this brings them together, for the command
line and for Python alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from visref.between.search import FrameGeometry, GeometricSearch, write_geometric
from visref.causes.evidence import Evidence
from visref.causes.pictured import paint_causes
from visref.culler import Culler
from visref.engines import TruthEngine, make_engine
from visref.engines.exact import ExactEngine
from visref.engines.rays import RayEngine
from visref.errors import InputError
from visref.exact import ExactScene
from visref.files import refuse_inputs, replacing_file, replacing_folder
from visref.findings import Finding
from visref.inputs import Inputs, open_inputs
from visref.judging.asking import Job
from visref.judging.outcome import RunOutcome
from visref.judging.policy import Policy
from visref.judging.referee import JudgedFrame, Listener, Referee
from visref.labels.writing import LabelFiles, Labelling, labelling
from visref.merging import merge_into
from visref.merging.joining import Cell, Joined
from visref.picking import Shard
from visref.recordings.truth_file import TRUTH_BEGINS, TruthTable, path_digest
from visref.run_folder.layout import PICTURES, RUN_FOLDER
from visref.run_folder.picture_plan import PicturePlan
from visref.run_folder.pictures import Painter
from visref.run_folder.read import read_run
from visref.run_folder.rows import PictureSet
from visref.shares import Asked, judge_share, name_the_causes
from visref.shares import MakingAnew as MakingAnew
from visref.shares import Misaligned as Misaligned
from visref.visibility import FrameTruth, ObjectVisibility


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
    superfluous_rows: bool = False,
    shard: Shard | None = None,
) -> RunOutcome:
    """Judge cullers, each with the name that reports give it, and write the run folder `out`.

    `truth`: a truth file to take instead of casting again; its engine looks at what was missed.
    `pictures`: how many frames to draw, evenly picked. `image_check`: redraw each drawn set by
    OpenGL and compare it with the unculled picture. `policy`: what the user accepts
    (`visref.judging.policy_file.read_policy`). `repeat`: how often cullers are asked about all
    frames, each time made by `anew` but for the first; who answers otherwise is inconclusive.
    `if_misaligned`: what becomes of a recording that fits another input. `shard`: the part of the
    run to judge; `visref.merging` makes the whole of all. `superfluous_rows`: list what was
    drawn for nothing in every frame, not only in those picked for pictures and where a promise
    forbids it.

    Raises InputError where `out` cannot be written to, holds what is no run, or is or holds one of
    the inputs, and where the truth file is of another scene, path or engine; NothingToJudge where
    an engine cannot start.
    """
    source = None if truth is None else Path(truth)
    asked = Asked(
        source, pictures, image_check, if_misaligned, policy, repeat, anew, superfluous_rows
    )
    if shard is not None and not shard.of(inputs.frames):
        raise InputError(
            f"--shard {shard} has no frame: the run has {len(inputs.frames)}",
            fix="give fewer shards",
        )
    refuse_inputs(out, [*inputs.files, truth, policy.source if policy is not None else None])
    with replacing_folder(out, kind=RUN_FOLDER) as folder:
        outcome = judge_share(inputs, cullers, folder, asked, share=shard, listeners=listeners)
    assert outcome is not None
    return outcome


def merge_naming(
    folder: Path, parts: Sequence[Path], inputs: Inputs, truth: Path | None = None
) -> RunOutcome:
    """The whole of a run's parts, in a folder that is there and empty, with the causes of what was
    missed, for which its `inputs` are needed. `truth`: the file that they went by, where they are
    stretches. Raises what `visref.merging.merge_runs` does."""
    evidence = Evidence()

    def on_cell(cell: Cell) -> None:
        units = cell.part.units.get(cell.spec, inputs.scene.object_units())
        evidence.add(cell.spec, units, cell.record, cell.drawn)

    def after(joined: Joined, plan: PicturePlan) -> list[PictureSet]:
        name_the_causes(inputs, evidence, joined.outcome)
        painter = Painter(folder / PICTURES)
        return paint_causes(inputs, evidence, joined.outcome.cullers, plan, painter)

    return merge_into(folder, parts, path=inputs.path, truth=truth, on_cell=on_cell, after=after)


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


@dataclass(frozen=True, eq=False)
class CastTruth:
    """What `truth_to_file` found. `visible`: (n,) bool, the objects that own a sample in some
    frame; `between`: who shows between the samples, one per frame, empty unless asked for;
    `findings`: what else a reader should know. `left_out`: the names of objects that bend or are
    scaled, and so are in no dataset of poses."""

    visible: NDArray[np.bool_]
    between: tuple[FrameGeometry, ...] = ()
    findings: tuple[Finding, ...] = ()
    left_out: tuple[str, ...] = ()


def truth_to_file(
    inputs: Inputs,
    out: Path | str,
    *,
    geometric: Path | str | None = None,
    labels: LabelFiles | None = None,
    listeners: Sequence[Listener] = (),
) -> CastTruth:
    """Cast who owns which samples in each frame and write it to `out`, a Parquet file; with
    `geometric`, who shows between the samples to another; with `labels`, what makers of data ask
    for to those.

    Raises InputError where a file cannot be written or is one of the inputs, and NothingToJudge
    where the engine cannot start.
    """
    for file in (out, geometric):
        if file is not None:
            refuse_inputs(file, inputs.files)
    if geometric is not None and Path(geometric).resolve() == Path(out).resolve():
        raise InputError("--geometric and --out are the same file", fix="name two")
    files = labels if labels is not None else LabelFiles()
    others = {"--out": Path(out)}
    if geometric is not None:
        others["--geometric"] = Path(geometric)
    files.check(inputs, others)
    with replacing_file(out, begins=TRUTH_BEGINS) as file, ExitStack() as closing:
        engine = inputs.make_engine()
        labelled: Labelling | None = None
        if files.asked:
            labelled = closing.enter_context(labelling(files, inputs, engine))
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
            kept: list[Listener] = [cast_] if labelled is None else [cast_, labelled]
            outcome = referee.run(inputs.path, inputs.frames, (), [*kept, *listeners])
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
    left_out = () if labelled is None else tuple(labelled.left_out)
    return CastTruth(cast_.visible, between, tuple(outcome.findings), left_out)


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
    if isinstance(engine, ExactEngine) and not inputs.timeline.moves:
        exact = engine.arithmetic
    else:
        exact = ExactScene(inputs.scene, threads=inputs.threads)
    if isinstance(engine, RayEngine):
        return GeometricSearch(inputs.scene, engine, exact)
    prober = cast(RayEngine, make_engine("embree", inputs.scene, threads=inputs.threads))
    return GeometricSearch(inputs.scene, prober, exact)
