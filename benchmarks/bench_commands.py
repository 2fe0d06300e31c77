"""What a user waits for: `visref run`, `visref check`, and starting either."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pyarrow.parquet as pq
import pytest

from benchmarks.measuring import Job, Skipped, Spent, Turns, command
from benchmarks.scenes import NINE, Sizes, one_of_nine, write_blocks, write_wall
from visref.camera_path import CameraPath

GENERATED = "city:scale=0.3"


@dataclass(frozen=True)
class Program:
    """A `visref`, and whether it knows `--workers` and `visref warm`."""

    file: Path
    takes_workers: bool
    warms: bool

    @classmethod
    def at(cls, file: Path) -> Program:
        return cls(
            file, "--workers" in command(file, "run", "--help"), "warm" in command(file, "--help")
        )

    @property
    def one_worker(self) -> list[object]:
        return ["--workers", 1] if self.takes_workers else []


@pytest.fixture(scope="session")
def programs(request: pytest.FixtureRequest) -> dict[str, Program]:
    """`visref` as it is here, and where `--before` names one as it was there."""
    result = {"": Program.at(Path(sys.executable).with_name("visref"))}
    before = request.config.getoption("--before")
    if before is not None:
        result["before: "] = Program.at(before)
    return result


@pytest.fixture(scope="session")
def scene(
    request: pytest.FixtureRequest, programs, tmp_path_factory, sizes: Sizes
) -> tuple[object, list[object]]:
    """The scene that is run and checked, and the words that give its path."""
    given = request.config.getoption("--scene")
    if given is None:
        return (GENERATED if sizes.check_frames > 10 else "city:scale=0.01"), []
    path = tmp_path_factory.mktemp("path") / "orbit.path.json"
    size = "x".join(map(str, sizes.image))
    command(
        programs[""].file, "path", "orbit", given, "--frames", 120, "--size", size, "--out", path
    )
    return given, ["--path", path]


def seen(program: Program, words: list[object], folder: Path) -> tuple[Path, Path]:
    """A truth file, and the recorded visible sets of a perfect culler."""
    place = Path(mkdtemp(dir=folder))
    truth, drawn = place / "truth.parquet", place / "drawn.jsonl"
    command(program.file, "truth", *words, "--out", truth)
    table = pq.read_table(truth, columns=["frame", "object"])
    visible: dict[int, list[int]] = {}
    for frame, number in zip(*(column.to_pylist() for column in table.columns), strict=True):
        visible.setdefault(frame, []).append(number)
    lines = [json.dumps({"frame": frame, "visible": ids}) for frame, ids in visible.items()]
    drawn.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return truth, drawn


def checking(
    program: Program, words: list[object], drawn: Path, folder: Path, *more: object, status: int = 0
) -> Job:
    out = folder / "run"
    return lambda: command(
        program.file, "check", *words, "--visible", drawn, *more, "--out", out, status=status
    )


def per_frame(spent: Mapping[str, Spent], many: str, one: str, frames: int) -> float:
    """Milliseconds of processor time of each frame beyond the first."""
    beyond = spent[many].median("cpu") - spent[one].median("cpu")
    return 1e3 * beyond / max(1, frames - 1)


def test_run_by_workers(programs, scene, tmp_path, turns: Turns, sizes: Sizes) -> None:
    cullers = [
        word for name in ("none", "occlusion-query", "occupancy-map") for word in ("--culler", name)
    ]
    jobs: dict[str, Job | Skipped] = {}
    words = [scene[0], *scene[1], "--frames", f"0:{sizes.run_frames}", *cullers]
    for title, program in programs.items():
        run = (program.file, "run", *words, "--out", tmp_path / "run")
        jobs[f"{title}1 worker"] = lambda r=run, p=program: command(*r, *p.one_worker)
        jobs[f"{title}2 workers"] = (
            (lambda r=run: command(*r, "--workers", 2))
            if program.takes_workers
            else Skipped("it knows no workers")
        )
    name = f"three cullers, {sizes.run_frames} frames of {_called(scene[0])}"
    turns.run("run", name, jobs, rounds=2, warm=False, clock="wall")


def test_clean_check(programs, scene, tmp_path, turns: Turns, sizes: Sizes) -> None:
    """As users run it, with the pictures of the first frames, and without any."""
    frames = min(sizes.check_frames, 60 if not scene[1] else 120)
    words = [scene[0], *scene[1]]
    jobs: dict[str, Job | Skipped] = {}
    kinds = (("", ()), (", no pictures", ("--pictures", 0)))
    for title, program in programs.items():
        truth, drawn = seen(program, [*words, "--frames", f"0:{frames}"], tmp_path)
        for kind, more in kinds:
            for what, end in ((f"{frames} frames", frames), ("1 frame", 1)):
                some = [*words, "--frames", f"0:{end}", *more]
                jobs[f"{title}{what}{kind}"] = checking(program, some, drawn, tmp_path)
        some = [*words, "--frames", f"0:{frames}", "--truth", truth, "--pictures", 0]
        jobs[f"{title}{frames} frames, no pictures, truth given"] = checking(
            program, some, drawn, tmp_path
        )
    spent = turns.run("check", f"a clean culler of {_called(scene[0])}", jobs, rounds=2, warm=False)
    for title in programs:
        for kind, _ in kinds:
            many, one = f"{title}{frames} frames{kind}", f"{title}1 frame{kind}"
            turns.say(
                **{
                    f"{title}ms per frame beyond start-up{kind}": per_frame(
                        spent, many, one, frames
                    )
                }
            )


# Generated scenes that hold nothing but what is opaque.
OPAQUE = tuple(name for name in NINE if name not in {"town", "leaves", "seismic"})
FEW, MANY = 3, 33


def test_truth_by_version(programs, scene, tmp_path, turns: Turns, sizes: Sizes, quick) -> None:
    if len(programs) < 2:
        pytest.skip("no other version is named")
    inputs: dict[str, tuple[object, list[object]]] = {}
    for name in OPAQUE[:1] if quick else OPAQUE:
        cameras = one_of_nine(name, sizes.image, small=quick)[1] * (MANY // FEW)
        path = tmp_path / f"{name}.path.json"
        path.write_text(json.dumps(CameraPath(cameras).to_json()), encoding="utf-8")
        what = f"{name}:scale=0.01" if quick and name == "city" else name
        if all(_knows(program, what, path) for program in programs.values()):
            inputs[name] = what, ["--path", path]
    if scene[1]:
        inputs[_called(scene[0])] = scene
    jobs: dict[str, Job | Skipped] = {}
    kinds = {title: (program, "embree") for title, program in programs.items()}
    kinds["exact: "] = programs[""], "exact"
    for name, (what, words) in inputs.items():
        for title, (program, engine) in kinds.items():
            for end in (MANY, FEW):
                asked = ("truth", what, *words, "--frames", f"0:{end}", "--engine", engine)
                jobs[f"{title}{name}, {end} frames"] = lambda p=program, w=asked: command(
                    p.file, *w, "--out", tmp_path / "truth.parquet"
                )
    spent = turns.run("truth", "camera to truth file", jobs, rounds=2, warm=False)
    faster: dict[str, list[float]] = {"": [], "exact: ": []}
    for name in inputs:
        ms = {
            title: per_frame(
                spent,
                f"{title}{name}, {MANY} frames",
                f"{title}{name}, {FEW} frames",
                MANY - FEW + 1,
            )
            for title in kinds
        }
        turns.say(**{f"{title}{name}: ms per frame": one for title, one in ms.items()})
        for title, found in faster.items():
            found.append(ms["before: "] / max(ms[title], 1e-9))
            turns.say(**{f"{title}{name}: times the version before": found[-1]})
    for title, found in faster.items():
        turns.say(**{f"{title}median of times the version before": float(np.median(found))})


def test_judging_many_triangles(programs, tmp_path, turns: Turns, sizes: Sizes) -> None:
    scene, path = write_blocks(tmp_path, sizes.judged_triangles)
    words: list[object] = [scene, "--path", path]
    many = 24
    jobs: dict[str, Job | Skipped] = {}
    for title, program in programs.items():
        truth, drawn = seen(program, words, tmp_path)
        for end in (many, 1):
            some = [*words, "--frames", f"0:{end}", *program.one_worker, "--pictures", 0]
            count = "1 frame" if end == 1 else f"{end} frames"
            jobs[f"{title}{count}"] = checking(program, some, drawn, tmp_path)
            jobs[f"{title}{count}, truth given"] = checking(
                program, some, drawn, tmp_path, "--truth", truth
            )
    name = f"a clean culler, {sizes.judged_triangles:,} triangles"
    spent = turns.run("judging", name, jobs, rounds=3, warm=False)
    for title in programs:
        for given in ("", ", truth given"):
            ms = per_frame(spent, f"{title}{many} frames{given}", f"{title}1 frame{given}", many)
            turns.say(**{f"{title}ms per frame{given}": ms})


def test_many_misses(programs, tmp_path, turns: Turns, sizes: Sizes) -> None:
    scene, path = write_wall(tmp_path, sizes.misses)
    words: list[object] = [scene, "--path", path, "--pictures", 0]
    nothing = tmp_path / "nothing.jsonl"
    lines = [json.dumps({"frame": frame, "visible": []}) for frame in range(8)]
    nothing.write_text("\n".join(lines) + "\n", encoding="utf-8")
    jobs: dict[str, Job | Skipped] = {}
    for title, program in programs.items():
        for end in (8, 5, 1):
            jobs[f"{title}{end} {'frames' if end > 1 else 'frame'}"] = checking(
                program,
                [*words, "--frames", f"0:{end}", *program.one_worker],
                nothing,
                tmp_path,
                status=1,
            )
    name = f"{sizes.misses:,} objects missed in each frame"
    spent = turns.run("misses", name, jobs, rounds=1, warm=False)
    for title in programs:
        # Causes are looked for in up to five frames of this size; the others are judged alone.
        for more, fewer in ((8, 5), (5, 1)):
            few = f"{title}{fewer} {'frames' if fewer > 1 else 'frame'}"
            ms = per_frame(spent, f"{title}{more} frames", few, more - fewer + 1)
            turns.say(**{f"{title}ms per frame from {fewer} to {more}": ms})


def test_start(programs, tmp_path, turns: Turns) -> None:
    scene, path = write_wall(tmp_path, 12)
    words: list[object] = [scene, "--path", path, "--frames", "0:1"]
    _, drawn = seen(programs[""], words, tmp_path)
    jobs: dict[str, Job | Skipped] = {}
    for title, program in programs.items():
        jobs[f"{title}visref --help"] = lambda p=program: command(p.file, "--help")
        jobs[f"{title}tiny check"] = checking(program, words, drawn, tmp_path)
    turns.run("start", "what is compiled is kept", jobs, rounds=5)


def test_start_in_a_fresh_place(programs, tmp_path, turns: Turns, quick: bool) -> None:
    """Nothing is compiled yet, and after `visref warm` all of it is."""
    if quick:
        pytest.skip("it compiles everything")
    scene, path = write_wall(tmp_path, 12)
    words: list[object] = [scene, "--path", path, "--frames", "0:1"]
    _, drawn = seen(programs[""], words, tmp_path)
    jobs: dict[str, Job | Skipped] = {}
    for number, (title, program) in enumerate(programs.items()):
        out = tmp_path / "run"
        check = (program.file, "check", *words, "--visible", drawn, "--out", out)
        empty, warmed = (
            {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / f"{kind}{number}")}
            for kind in ("empty", "warmed")
        )
        jobs[f"{title}tiny check, nothing compiled"] = lambda c=check, e=empty: command(
            *c, environment=e
        )
        if program.warms:
            jobs[f"{title}visref warm"] = lambda p=program, e=warmed: command(
                p.file, "warm", environment=e
            )
            jobs[f"{title}tiny check after it"] = lambda c=check, e=warmed: command(
                *c, environment=e
            )
    turns.run("start", "a fresh place", jobs, rounds=1, warm=False)


def _knows(program: Program, scene: str, path: Path) -> bool:
    """Whether it has this generated scene."""
    out = path.with_suffix(".parquet")
    try:
        command(program.file, "truth", scene, "--path", path, "--frames", "0:1", "--out", out)
    except RuntimeError:
        return False
    return True


def _called(scene: object) -> str:
    return scene.stem if isinstance(scene, Path) else str(scene)
