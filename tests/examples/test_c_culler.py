"""The example in C passes the suite, and each of its broken twins is convicted with a witness."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from visref.cli.main import main
from visref.conformance.classes import CLASSES
from visref.conformance.declared import read_declared
from visref.conformance.files import WrittenCase, written_cases
from visref.conformance.suite import Judged, judged_on
from visref.plug_ins.command import Command, CommandCuller

SOURCE = Path(__file__).parent.parent.parent / "examples" / "c_culler" / "c_culler.c"
FILES = "{scene} {path} {visible}"
CITY = "city:scale=0.02,frames=3"

# Each broken twin, the case of the suite that is built around its fault, and an object of that case
# that it loses.
TWINS = {
    "ABSENT": ("appearing_and_vanishing", "hidden 4"),
    "BACKFACE": ("one_sided_walls", "seen"),
    "BLEND": ("glass", "vase"),
    "CLIP_PLANE": ("cut_by_a_plane", "left beam"),
    "CORNERS": ("gap_narrower_than_a_texel", "in the gap"),
    "DISTANCE": ("large_object_at_the_edge", "right"),
    "LENS_SHIFT": ("beside_the_unshifted_view", "aside"),
    "MASK": ("through_the_holes_of_a_mask", "in a hole"),
    "NEAR": ("object_crossing_the_near_plane", "left wall"),
    "NEAREST": ("slanting_wall_before_a_screen", "wall"),
    "NEAR_OCCLUDERS": ("exactly_at_the_near_plane", "on near"),
    "ORTHOGRAPHIC": ("close_by_in_an_orthographic_view", "close by"),
    "POSES": ("carried_about", "behind the eye"),
    "ROUNDING": ("peeking_by_a_pixel", "peeks"),
    "VIEWS": ("two_eyes", "aside"),
}

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")


def compiled(folder: Path, *switches: str) -> Path:
    """The program, which no compiler warns about."""
    program = folder / "-".join(["c_culler", *(switch.lower() for switch in switches)])
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", *(f"-DBROKEN_{one}" for one in switches)]
    command = ["gcc", *flags, "-o", str(program), str(SOURCE), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return program


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return compiled(tmp_path_factory.mktemp("good"))


CASES = {case.name: case for case in written_cases()}


def judged(program: Path, case: WrittenCase, folder: Path) -> Judged:
    """What is wrong with a program's answer to a case of the suite, read from its files."""
    for name, data in case.files.items():
        (folder / name).write_bytes(data)
    command = Command.parse(f"{program} {FILES}")
    scene = folder / "scene.glb"

    def make() -> CommandCuller:
        return CommandCuller(command, scene, case.path, cull_backfaces=True, time_limit_s=60.0)

    return judged_on(make, case.case, case.truths)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_culler_passes(name, good, tmp_path):
    assert judged(good, CASES[name], tmp_path).problems == ()


@pytest.mark.parametrize("switch", TWINS)
def test_a_broken_twin_is_convicted_with_its_witness(switch, tmp_path):
    case, lost = TWINS[switch]
    problems = judged(compiled(tmp_path, switch), CASES[case], tmp_path).problems
    assert problems
    witness = re.compile(
        r"MISSED_OBJECT: frame \d+.*: '(.*?)(?:#\d+)?' \(object \d+\) lost \d+ of its \d+ samples; "
        r"witness: pixel \(\d+, \d+\), triangle \d+ at depth [\d.]+"
    )
    named = [found[1] for problem in problems if (found := witness.fullmatch(problem))]
    assert any(name.startswith(lost) for name in named)


def test_it_declares_all_that_it_is_tried_with_but_clusters():
    declared = read_declared(SOURCE.parent / "conformance.toml", list(CASES))
    assert declared.can == set(CLASSES) - {"clusters"}
    assert not declared.reasons


def test_every_switch_of_the_source_is_tried():
    switches = set(re.findall(r"BROKEN_(\w+)", SOURCE.read_text(encoding="utf-8")))
    assert switches - {""} == set(TWINS)


def run(program: Path, out: Path) -> tuple[int, dict]:
    status = main(["run", CITY, "--command", f"{program} {FILES}", "--out", str(out)])
    (sums,) = json.loads((out / "verdict.json").read_text())["cullers"].values()
    return status, sums


def test_it_draws_little_that_is_hidden(good, tmp_path):
    status, sums = run(good, tmp_path / "out")
    assert (status, sums["violations"]) == (0, 0)
    # Of 123 objects in each of three frames.
    assert sums["visible"] <= sums["drawn"] < 2 * sums["visible"]


def test_a_twin_s_witness_replays_from_the_run_folder_alone(tmp_path, capfd):
    status, sums = run(compiled(tmp_path, "DISTANCE"), tmp_path / "out")
    assert status == 1
    assert sums["violations"] > 0
    worst = sums["worst"]
    where = ["--frame", str(worst["frame"]), "--object", str(worst["object"])]
    capfd.readouterr()
    assert main(["explain", str(tmp_path / "out"), *where]) == 0
    told = capfd.readouterr().out
    assert f"'{worst['object_name']}', frame {worst['frame']}" in told
    assert "missed by command:c_culler-distance" in told
    assert told.endswith("the claim holds\n")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("a", "b"), "usage: c_culler SCENE.glb PATH.json VISIBLE.jsonl"),
        (("nowhere.glb", "p.json", "out"), "cannot read nowhere.glb"),
        ((str(SOURCE), "p.json", "out"), "is no GLB file of version 2"),
    ],
)
def test_what_it_cannot_read_it_says_and_fails(words, said, good, tmp_path):
    done = subprocess.run([good, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("c_culler: ")
    assert said in line
