"""What each command does, from parsed arguments to files; the command line only prints."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from visref.bench import MARKER, Measurement, write_bench
from visref.bench.verdict import headline, sentences
from visref.between.search import FrameGeometry, GeometricSearch, geometric_line, write_geometric
from visref.camera import Camera, look_at
from visref.culler import Culler, Promise, RasterTolerance
from visref.engines import ENGINES, TruthEngine, check_engine, engine_names, make_engine
from visref.engines.rays import RayEngine
from visref.errors import InputError, NothingToJudge
from visref.exact import ExactScene
from visref.files import replacing_file, replacing_folder
from visref.inputs import Inputs, open_inputs, open_scene
from visref.judging.outcome import RunOutcome
from visref.judging.referee import ImageCheck, Listener, Referee
from visref.papers import Paper, tables_beside
from visref.papers.table import Table
from visref.picking import evenly_picked
from visref.recordings.truth_file import TruthTable, read_truth
from visref.recordings.visible_sets import Replay, read_visible_sets
from visref.registry import CULLERS, available, load_entry, make_culler
from visref.report import write_report
from visref.run_folder.explain import draw_neighbourhood, explain
from visref.run_folder.read import read_run
from visref.run_folder.write import MANIFEST, TRUTH, Recorder, slug
from visref.scene import Scene
from visref.trials.hardcases import HardCaseTable, every_spec, run_hard_cases
from visref.trials.hardcases_page import hard_cases_page
from visref.trials.watertight import leaks_line, watertight_rates
from visref.visibility import objects_seen

DEFAULT_ENGINE = "embree"
BENCH_FRAMES = 6
DEMO_SCENE = "city:scale=0.2"
DEMO_FRAMES = 24
DEMO_SIZE = (960, 720)
DEMO_CULLERS = ("none", "frustum", "occlusion-query", "visref_culling.broken:HastyQueryCulling")


def cast_truth(
    inputs: Inputs, out: Path, listeners: Sequence[Listener] = (), *, geometric: Path | None = None
) -> str:
    """`visref truth`: cast the frames and write the file, and with `geometric` who shows between
    the samples to another; returns a line for the reader."""
    if geometric is not None and geometric.resolve() == out.resolve():
        raise InputError("--geometric and --out are the same file", fix="name two")
    table = TruthTable(inputs.scene)
    ties_complete = False
    owners = np.zeros(inputs.scene.object_count, np.bool_)
    found: list[tuple[int, FrameGeometry]] = []
    with replacing_file(out) as file:
        engine = inputs.make_engine()
        search = _geometric_search(inputs, engine) if geometric is not None else None
        try:
            for frame in inputs.frames:
                truth = engine.frame(inputs.path.frames[frame])
                seen = objects_seen(truth, inputs.scene)
                table.add(frame, truth.camera.width, seen)
                owners |= seen.visible
                if search is not None:
                    found.append((frame, search.frame(frame, truth.camera, seen)))
                ties_complete = truth.ties_complete
                for listener in listeners:
                    listener.on_frame_done(frame)
        finally:
            engine.close()
            if search is not None:
                search.close()
        if geometric is not None:
            with replacing_file(geometric) as beside:
                write_geometric(beside, inputs.scene, inputs.path, found, engine=inputs.engine)
        table.write(file, engine=inputs.engine, path=inputs.path, ties_complete=ties_complete)
    return (
        f"{out}: {len(inputs.frames)} frames, {np.count_nonzero(owners)} of "
        f"{inputs.scene.object_count} objects visible in some frame (engine {inputs.engine})"
        + (f"\n{geometric}: {geometric_line([one for _, one in found])}" if geometric else "")
    )


def _geometric_search(inputs: Inputs, engine: TruthEngine) -> GeometricSearch:
    """Over the engine's own rays, or Embree's where it casts none."""
    exact = ExactScene(inputs.scene, threads=inputs.threads)
    if isinstance(engine, RayEngine):
        return GeometricSearch(inputs.scene, engine, exact)
    prober = cast(RayEngine, make_engine("embree", inputs.scene, threads=inputs.threads))
    return GeometricSearch(inputs.scene, prober, exact)


def bench_frames(inputs: Inputs) -> list[int]:
    """`BENCH_FRAMES` of the frames at most, evenly picked."""
    return [inputs.frames[i] for i in evenly_picked(len(inputs.frames), BENCH_FRAMES)]


def bench(
    inputs: Inputs, frames: Sequence[int], out: Path, on_frame: Callable[[int], None]
) -> list[str]:
    """`visref bench`: measure and write the folder; returns lines for the reader."""
    with replacing_folder(out, marker=MARKER) as folder:
        measured = Measurement(inputs.scene, inputs.path, frames, inputs.threads).run(on_frame)
        write_bench(folder, measured, inputs.scene, inputs.path, inputs.threads)
    return [headline(measured), *sentences(measured)]


def make_cullers(specs: Sequence[str]) -> list[tuple[str, Culler]]:
    """Cullers by their specs. Raises InputError for an unknown name, option or value."""
    return [(spec, make_culler(spec)) for spec in specs]


def replay_of(inputs: Inputs, visible: Path, promise: Promise, raster: str | None) -> Replay:
    """`visref check`'s culler: a recording."""
    recorded = read_visible_sets(visible, inputs.scene, inputs.frames, len(inputs.path))
    tolerance = _raster(raster) if raster is not None else None
    return Replay(recorded, inputs.path, promise, tolerance)


def _raster(text: str) -> RasterTolerance:
    values = dict(part.partition("=")[::2] for part in text.split(","))
    try:
        if set(values) != {"snap", "depth"}:
            raise ValueError
        snap_px = float(values["snap"])
        depth_bits = None if values["depth"] == "float" else int(values["depth"])
        if not 0.0 <= snap_px < 1.0 or (depth_bits is not None and not 8 <= depth_bits <= 32):
            raise ValueError
    except ValueError as error:
        raise InputError(
            f"--raster {text} is not understood",
            fix="write snap=0.004,depth=24 (pixels below 1; 8 to 32 bits, or float)",
        ) from error
    return RasterTolerance(snap_px, depth_bits)


def run(
    inputs: Inputs,
    cullers: Sequence[tuple[str, Culler]],
    out: Path,
    *,
    truth: Path | None = None,
    pictures: int = 4,
    image_check: bool = False,
    listeners: Sequence[Listener] = (),
) -> RunOutcome:
    """`visref run` and `visref check`: judge the cullers and write the run folder."""
    if pictures < 0:
        raise InputError(f"--pictures is {pictures}", fix="give 0 or more")
    scene, frames = inputs.scene, inputs.frames
    recorded = None
    if truth is not None:
        recorded = read_truth(truth, scene, inputs.path, frames)
        inputs = _of_the_same_engine(inputs, recorded.engine, truth)
    with replacing_folder(out, marker=MANIFEST) as folder, ExitStack() as closing:
        checker = None
        if image_check:
            # Any engine that redraws and compares pictures would do.
            checker = make_engine("gl", scene)
            closing.callback(checker.close)
        recorder = Recorder(
            folder,
            scene,
            inputs.path,
            engine=inputs.engine,
            settings={**inputs.settings, "frames": [frames.start, frames.stop, frames.step]},
            picture_frames=[frames[i] for i in evenly_picked(len(frames), pictures)],
        )
        referee = Referee(
            scene,
            inputs.make_engine,
            threads=inputs.threads,
            recorded=recorded,
            image_check=cast(ImageCheck | None, checker),
        )
        outcome = referee.run(inputs.path, frames, cullers, [recorder, *listeners])
        outcome.findings[:0] = inputs.notes
        recorder.finish(outcome)
        if truth is not None:
            shutil.copyfile(truth, folder / TRUTH)
    return outcome


def published_beside(run: Path) -> list[tuple[Paper, list[Table]]]:
    """What a run folder fills of the papers' tables."""
    return tables_beside(read_run(run, objects=False))


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


def report(runs: Sequence[Path], out: Path) -> Path:
    """`visref report`: a page from run folders."""
    return write_report(runs, out)


def demo(out: Path, listeners: Sequence[Listener] = ()) -> tuple[RunOutcome, Path]:
    """`visref demo`: four cullers, one of them broken, on a generated city."""
    inputs = open_inputs(
        f"{DEMO_SCENE},frames={DEMO_FRAMES}", path=None, frames=None, engine="embree"
    )
    sized = replace(inputs, path=inputs.path.resized(*DEMO_SIZE))
    outcome = run(
        sized, make_cullers(DEMO_CULLERS), out / "run", image_check=True, listeners=listeners
    )
    return outcome, write_report([out / "run"], out)


def explain_witness(
    run: Path, frame: int, target: str, culler: str | None, picture: Path | None
) -> tuple[list[str], bool]:
    """`visref explain`: the replay in words, and whether every claim held."""
    explanations = explain(run, frame, target, culler)
    lines: list[str] = []
    for index, explanation in enumerate(explanations):
        witness = explanation.witness
        file = picture or run / "witnesses" / (
            f"{slug(witness['culler'])}-{frame:05d}-{witness['object']}.png"
        )
        if picture is not None and index:
            file = picture.with_stem(f"{picture.stem}-{index + 1}")
        draw_neighbourhood(explanation, file)
        lines += [*explanation.lines, f"the neighbourhood: {file}"]
        lines.append("the claim holds" if explanation.holds else "THE CLAIM DOES NOT HOLD")
    return lines, all(explanation.holds for explanation in explanations)


def list_objects(scene: str) -> list[dict[str, Any]]:
    """`visref objects`: ids, names and sizes."""
    loaded, _, _ = open_scene(scene)
    sizes = np.diff(loaded.object_offsets)
    return [
        {"id": index, "name": name, "triangles": int(size)}
        for index, (name, size) in enumerate(zip(loaded.names, sizes, strict=True))
    ]


def list_cullers() -> list[dict[str, Any]]:
    """`visref cullers`: what each is, its options, its class and its promise."""
    rows = []
    for name in available(CULLERS):
        culler = cast(type[Culler], load_entry(CULLERS, name, kind="culler"))
        rows.append(
            {
                "name": name,
                "summary": culler.summary,
                "class": culler.promise.value,
                "promise": culler.promise.statement,
                "options": {
                    option: {
                        "default": value.default,
                        "choices": list(value.choices),
                        "help": value.help,
                    }
                    for option, value in culler.options.items()
                },
            }
        )
    return rows


def hard_cases(
    engines: Sequence[str] | None,
    cullers: Sequence[str] | None,
    *,
    only: Sequence[str] | None = None,
    out: Path | None = None,
    on_case: Callable[[str], None] = lambda name: None,
) -> HardCaseTable:
    """`visref hardcases`: the named engines and cullers, or if none is named all there are."""
    if engines is None and cullers is None:
        engines, cullers = every_spec(ENGINES), every_spec(CULLERS)
    table = run_hard_cases(engines or (), cullers or (), only=only, on_case=on_case)
    if out is not None:
        checks = [_check_engine(name) for name in engine_names()]
        machine = [f"{check.name}: {check.detail}" for check in checks if check.works]
        with replacing_file(out) as file:
            file.write_text(hard_cases_page(table, machine), encoding="utf-8")
    return table


@dataclass(frozen=True)
class DoctorCheck:
    """One line of `visref doctor`; `otherwise` is the word for one that does not work."""

    name: str
    works: bool
    detail: str
    is_engine: bool = False
    otherwise: str = "missing"


def doctor() -> list[DoctorCheck]:
    """What works on this machine. Each engine casts a frame whose answer is known, and frames
    of rays that all aim at vertices and edges of a closed surface."""
    checks = [_check_engine(name) for name in engine_names()]
    broken = {check.name for check in checks if not check.works}
    for spec in every_spec(ENGINES):
        if f"engine {spec.partition(':')[0]}" not in broken:
            leaks = watertight_rates(spec)
            tight = not any(leak.missed for leak in leaks)
            label, line = f"watertight engine {spec}", leaks_line(leaks)
            checks.append(DoctorCheck(label, tight, line, otherwise="leaks"))
    for name in available(CULLERS):
        try:
            load_entry(CULLERS, name, kind="culler")
            checks.append(DoctorCheck(f"culler {name}", True, "found"))
        except ImportError as error:
            checks.append(DoctorCheck(f"culler {name}", False, str(error)))
    return checks


def _check_engine(name: str) -> DoctorCheck:
    label = f"engine {name}"
    # A square of half the view's height, centred: 6 of 12 columns and rows.
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    square = Scene.from_objects([("square", corners, np.array([[0, 1, 2], [0, 2, 3]]))])
    camera = Camera(look_at((0, 0, 4), (0, 0, 0)), 12, 12, near=1.0, far=9.0, ymag=2.0)
    try:
        engine = make_engine(name, square)
        owned = int(np.count_nonzero(engine.frame(camera).buffer.triangle >= 0))
        detail = engine.describe()
        engine.close()
    except (ImportError, NothingToJudge, InputError) as error:
        return DoctorCheck(label, False, str(error), is_engine=True)
    if owned != 36:
        return DoctorCheck(label, False, f"owned {owned} samples of 36; {detail}", is_engine=True)
    return DoctorCheck(label, True, detail, is_engine=True)
