"""`visref shrink`: from a run's miss to a folder that shows it, and replays from there alone."""

from __future__ import annotations

import json
import runpy
import shutil
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from PIL import Image

from tests.examples.test_c_culler import FILES, compiled
from tests.search.test_shrinking import FAULTS, once, suspect_of
from visref.cli.main import main
from visref.conformance.scenes import SCENES
from visref.run_folder.colours import MISSED_RGB
from visref.schemas import schema
from visref.search.case import Case
from visref.search.fault_folder import write_fault

BUILD = {maker.name: maker.build for maker in SCENES}
NEAREST = "tests.wrong_cullers.depth:NearestOfTheRectangle"


def written(name: str, folder: Path) -> Path:
    """A scene of the suite as files."""
    built = BUILD[name](np.random.default_rng(0))
    folder.mkdir(parents=True, exist_ok=True)
    Case.of(built.scene, built.path).write(folder)
    return folder


def run_on(files: Path, out: Path, *arguments: str) -> int:
    scene, path = str(files / "scene.glb"), str(files / "path.json")
    return main(["run", scene, "--path", path, *arguments, "--out", str(out)])


def shrink_of(run: Path, out: Path, frame: int, target: str | int, *arguments: str) -> int:
    where = ["--frame", str(frame), "--object", str(target)]
    return main(["shrink", str(run), *where, *arguments, "--out", str(out)])


def expected(folder: Path) -> dict:
    value = json.loads((folder / "expected.json").read_text())
    jsonschema.validate(value, schema("fault"))
    return value


def replayed(folder: Path, command: str, out: Path, monkeypatch) -> tuple[int, dict]:
    """What one of the command lines of a fault says, given in its folder."""
    monkeypatch.chdir(folder)
    status = main([*expected(folder)[command], "--out", str(out)])
    (sums,) = json.loads((out / "verdict.json").read_text())["cullers"].values()
    return status, sums


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """A run with a miss, and the object that was missed in frame 0."""
    folder = tmp_path_factory.mktemp("judged")
    written("coplanar_ties", folder)
    assert run_on(folder, folder / "run", "--culler", NEAREST) == 1
    worst = json.loads((folder / "run" / "verdict.json").read_text())["cullers"][NEAREST]["worst"]
    return folder / "run", worst


@pytest.fixture(scope="module")
def fault(judged, tmp_path_factory):
    run, worst = judged
    out = tmp_path_factory.mktemp("fault") / "out"
    asked = ["--culler", NEAREST]
    assert shrink_of(run, out, worst["frame"], worst["object_name"], *asked) == 0
    return out


def test_its_folder_holds_what_is_told_of_it_and_nothing_else(fault, judged):
    assert sorted(file.name for file in fault.iterdir()) == [
        "REPORT.md", "command.txt", "drawn.jsonl", "expected.json", "path.json", "picture.png",
        "scene.glb", "test_fault.py",
    ]  # fmt: skip
    told = expected(fault)
    assert (told["objects"], told["triangles"], told["frames"]) == (2, 2, 1)
    assert told["violation"]["object_name"] == judged[1]["object_name"]
    report = (fault / "REPORT.md").read_text()
    assert report.startswith(f"# `{NEAREST}` leaves out a visible object\n")
    assert all(line in report for line in (fault / "command.txt").read_text().splitlines())


@pytest.mark.parametrize("command", ["run", "check"])
def test_it_replays_from_its_folder_alone(command, fault, tmp_path, monkeypatch):
    moved = tmp_path / "elsewhere"
    shutil.copytree(fault, moved)
    status, sums = replayed(moved, command, tmp_path / "out", monkeypatch)
    told = expected(fault)["violation"]
    assert (status, sums["violations"]) == (1, 1)
    worst, witness = sums["worst"], told["witness"]
    assert (worst["object_name"], worst["x"], worst["y"]) == (
        told["object_name"], witness["x"], witness["y"],
    )  # fmt: skip


@pytest.mark.slow
def test_its_pytest_test_passes_and_fails_once_the_culler_is_taken_for_mended(fault, tmp_path):
    test = runpy.run_path(str(fault / "test_fault.py"))
    names = [name for name in test if name.startswith("test_")]
    assert len(names) == 2
    for name in names:
        (tmp_path / name).mkdir()
        test[name](tmp_path / name)
    mended = test["test_the_culler_is_judged_as_it_is"]
    mended.__globals__["FIXED"] = True
    with pytest.raises(AssertionError):
        mended(tmp_path)


def test_its_picture_marks_the_samples_that_are_lost(fault):
    told = expected(fault)
    camera = json.loads((fault / "path.json").read_text())
    picture = np.asarray(Image.open(fault / "picture.png").convert("RGB"))
    times = (picture.shape[0]) // camera["height"]
    # The right panel, a corner of each sample.
    panel = picture[::times, -camera["width"] * times :: times]
    wrong = (panel == MISSED_RGB).all(axis=-1)
    assert wrong.sum() == told["violation"]["samples"]
    assert wrong[told["violation"]["witness"]["y"], told["violation"]["witness"]["x"]]


@pytest.mark.parametrize("name", ["glass-occludes", "last-cluster-lost",
                                  "hidden-drawn-though-exact", "removed-still-hides"])  # fmt: skip
def test_a_fault_of_each_kind_replays_by_what_was_drawn(name, tmp_path, monkeypatch):
    """Glass, units finer than objects, what is drawn for nothing, what moves."""
    write_fault(tmp_path, once(name).shrunk, suspect_of(name))
    assert FAULTS[name]
    status, sums = replayed(tmp_path, "check", tmp_path / "out", monkeypatch)
    assert (status, sums["violations"] > 0) == (1, True)
    told = expected(tmp_path)["violation"]
    assert (told["kind"] == "superfluous") == ("hidden-drawn" in name)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
def test_a_program_s_fault_is_shrunk_and_replays(tmp_path, monkeypatch):
    program = compiled(tmp_path, "NEAREST")
    command = ["--command", f"{program} {FILES}"]
    files = written("slanting_wall_before_a_screen", tmp_path / "files")
    assert run_on(files, tmp_path / "run", *command) == 1
    worst = json.loads((tmp_path / "run" / "verdict.json").read_text())["cullers"]
    (worst,) = (sums["worst"] for sums in worst.values())
    out = tmp_path / "fault"
    assert shrink_of(tmp_path / "run", out, worst["frame"], worst["object"], *command) == 0
    told = expected(out)
    # Two hide nothing and show nothing; what a cause is told by may take some more.
    assert told["objects"] == 2
    assert 2 <= told["triangles"] <= 4
    for one in ("run", "check"):
        assert replayed(out, one, tmp_path / one, monkeypatch)[0] == 1


def test_a_culler_that_does_not_leave_it_out_is_refused(judged, tmp_path, capsys):
    run, worst = judged
    sound = ["--culler", "tests.wrong_cullers.frustum:Frustum"]
    assert shrink_of(run, tmp_path / "out", worst["frame"], worst["object"], *sound) == 2
    assert "does not leave it out any more" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("frame", "target", "arguments", "said"),
    [
        (0, 0, [], "no culler is named"),
        (0, 0, ["--culler", NEAREST, "--culler", "frustum"], "several cullers are named"),
        (7, 0, ["--culler", NEAREST], "frame 7 was not judged"),
        (0, "nobody", ["--culler", NEAREST], "the scene has no object 'nobody'"),
        (0, "99", ["--culler", NEAREST], "the scene has no object '99'"),
        (0, 0, ["--culler", NEAREST], "is not lost in frame 0"),
        (0, 0, ["--culler", NEAREST, "--trials", "0"], "--trials is 0"),
        (0, 0, ["--culler", NEAREST, "--time", "0"], "--time is 0"),
        (0, 0, ["--culler", "no-such-culler"], "no-such-culler"),
    ],
)
def test_what_cannot_be_asked_is_one_line_and_exit_status_2(
    frame, target, arguments, said, judged, tmp_path, capsys
):
    run, worst = judged
    # An object that was drawn, or that is not seen.
    safe = next(i for i in range(4) if i != worst["object"])
    capsys.readouterr()
    asked = safe if target == 0 else target
    assert shrink_of(run, tmp_path / "out", frame, asked, *arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not (tmp_path / "out").exists()


def test_a_scene_that_is_another_since_is_refused(judged, tmp_path, capsys):
    run, worst = judged
    folder = tmp_path / "copy"
    shutil.copytree(run.parent, folder)
    manifest = folder / "run" / "manifest.json"
    manifest.write_text(manifest.read_text().replace(str(run.parent), str(folder)))
    written("glass", folder)
    where = (worst["frame"], worst["object"], "--culler", NEAREST)
    assert shrink_of(folder / "run", tmp_path / "out", *where) == 2
    assert "is not the one that was judged" in capsys.readouterr().err


@pytest.mark.slow
def test_a_fault_s_folder_is_replaced_and_one_with_something_of_the_user_s_is_not(
    fault, judged, tmp_path, capsys
):
    run, worst = judged
    folder = tmp_path / "fault"
    shutil.copytree(fault, folder)
    where = (worst["frame"], worst["object"], "--culler", NEAREST, "--trials", "2")
    assert shrink_of(run, folder, *where) == 0
    assert expected(folder)["trials"] == 2
    (folder / "notes.txt").write_text("mine")
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert shrink_of(run, folder, *where) == 2
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
