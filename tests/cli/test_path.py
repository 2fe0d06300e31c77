"""visref path: every kind writes a path that is read with its scene and sees something in it."""

from __future__ import annotations

import json
import math
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from tests.paths.rooms import write_house
from visref.camera_path import CameraPath
from visref.cli.main import main
from visref.inputs import open_inputs
from visref.paths import free_space
from visref.paths.looking import looks


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setattr(free_space, "CELLS", 300_000)
    return write_house(tmp_path)


SMALL = ["--size", "32x24"]
KINDS = {
    "orbit": ["orbit", "SCENE", "--frames", "4", *SMALL],
    "orbit of one thing": [
        "orbit", "SCENE", "--around", "table", "--frames", "3", "--distance", "2.5", *SMALL,
        "--elevation", "35", "--fov", "50", "--fps", "25",
    ],
    "turntable": ["turntable", "SCENE", "--frames", "3", *SMALL],
    "turntable of one thing": [
        "turntable", "SCENE", "--around", "pillar", "--distance", "1.5", "--frames", "3", *SMALL,
    ],
    "walk": ["walk", "SCENE", "--frames", "40", "--seed", "1", *SMALL],
    "walk at a height": [
        "walk", "SCENE", "--frames", "40", "--eye-height", "1.5", "--clearance", "0.2", *SMALL,
    ],
    "walk along points": ["walk", "--through", "1,1.5,3; 6,1.5,3.5;6,1.5,5", *SMALL],
    "cube": ["cube", "--eye", "3,1.5,3", "--size", "16"],
    "cameras": ["cameras", "SCENE", *SMALL],
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_writes_a_path_whose_cameras_see_the_scene(name, scene, tmp_path, capsys):
    out = tmp_path / "path.json"
    given = [scene if word == "SCENE" else word for word in KINDS[name]]
    assert main(["path", *given, "--out", str(out)]) == 0
    inputs = open_inputs(scene, path=str(out))
    views = sum(len(frame.cameras) for frame in inputs.path.frames)
    assert f"{views} view" in capsys.readouterr().out
    seen = list(looks(inputs))
    assert len(seen) == views
    assert all(look.hits for look in seen)
    if name.startswith("walk"):
        assert {look.through for look in seen} == {None}
        # It is in the house, whose walls and ceiling fill every view but for the way out: none.
        assert all(look.hits == look.samples and not look.inside for look in seen)
        assert len({look.visible for look in seen}) > 1


def test_the_frames_of_an_orbit_have_the_times_that_are_asked_for(scene, tmp_path):
    out = tmp_path / "path.json"
    given = [scene if word == "SCENE" else word for word in KINDS["orbit of one thing"]]
    assert main(["path", *given, "--out", str(out)]) == 0
    path = CameraPath.load(out)
    assert [frame.time_s for frame in path.frames] == [0.0, 1 / 25, 2 / 25]
    for camera in path.cameras:
        assert camera.yfov == math.radians(50)
        assert np.linalg.norm(camera.eye - (1.75, 0.375, 1.5)) == pytest.approx(2.5)


def test_a_walk_is_written_byte_for_byte_alike(scene, tmp_path):
    texts = []
    for name in ("a.json", "b.json"):
        out = tmp_path / name
        given = [scene if word == "SCENE" else word for word in KINDS["walk"]]
        assert main(["path", *given, "--out", str(out)]) == 0
        texts.append(out.read_bytes())
    assert texts[0] == texts[1]


def test_two_eyes_of_every_frame_of_a_path(scene, tmp_path):
    walk, out = tmp_path / "walk.json", tmp_path / "stereo.json"
    given = ["path", "walk", "--through", "1,1.5,3;3,1.5,3", "--frames", "5", *SMALL]
    assert main([*given, "--out", str(walk)]) == 0
    stereo = ["path", "stereo", "--from", str(walk), "--eyes", "0.06", "--screen", "2"]
    assert main([*stereo, "--out", str(out)]) == 0
    path = CameraPath.load(out)
    assert [[camera.view for camera in frame.cameras] for frame in path.frames] == [
        ["left", "right"]
    ] * 5
    assert all(look.hits for look in looks(open_inputs(scene, path=str(out))))
    # The frames of a pair of eyes have two of their own.
    again = ["path", "stereo", "--from", str(out), "--out", str(tmp_path / "no.json")]
    assert main(again) == 2


def test_what_is_made_is_checked_at_once_where_it_is_asked_for(scene, tmp_path, capsys):
    out = tmp_path / "path.json"
    given = ["path", "orbit", scene, "--frames", "2", *SMALL, "--check", "--out", str(out)]
    assert main(given) == 0
    made, heading, first, _, summary = capsys.readouterr().out.splitlines()
    assert made.endswith("2 frames, 2 views")
    assert heading.split()[0] == "frame"
    assert first.split()[0] == "0"
    assert summary.startswith("2 views: 0 met nothing")
    walk = ["path", "walk", "--through", "1,1,3;7,1,3.25", "--frames", "3", *SMALL, scene]
    assert main([*walk, "--check", "--out", str(out)]) == 0
    assert "came through pillar" not in capsys.readouterr().out
    walk[3] = "1,1,1;7,1,1"
    assert main([*walk, "--check", "--out", str(out)]) == 0
    assert "came through wall by the door" in capsys.readouterr().out


WRONG = {
    "no kind": ([], "give a KIND (see --help), or --check"),
    "no scene": (["walk", "--out", "OUT"], "give a SCENE, or --through"),
    "no point": (["walk", "--through", "1,2;3,4,5", "--out", "OUT"], "--through 1,2 is no point"),
    "one point": (["walk", "--through", "1,2,3", "--out", "OUT"], "two points at least"),
    "no fov": (["orbit", "SCENE", "--fov", "180", "--out", "OUT"], "--fov is 180"),
    "no fps": (["orbit", "SCENE", "--fps", "0", "--out", "OUT"], "--fps is 0"),
    "no frames": (["orbit", "SCENE", "--frames", "0", "--out", "OUT"], "--frames is 0"),
    "endless": (["walk", "SCENE", "--frames", "999999999999", "--out", "OUT"], "1 to 1,000,000"),
    "more than fits": (
        ["turntable", "SCENE", "--frames", "99999", "--max-memory", "90M", "--out", "OUT"],
        "a path of 99,999 frames",
    ),
    "cameras of no glTF": (["cameras", "a.obj", "--out", "OUT"], "only glTF files have cameras"),
    "negative seed": (["walk", "SCENE", "--seed", "-1", "--out", "OUT"], "--seed is -1"),
    "negative frames": (["walk", "SCENE", "--frames", "-1", "--out", "OUT"], "--frames is -1"),
    "steep": (["orbit", "SCENE", "--elevation", "90", "--out", "OUT"], "90 degrees looks along"),
    "unknown": (["orbit", "SCENE", "--around", "tabel", "--out", "OUT"], "did you mean 'table'?"),
    "no near": (["orbit", "SCENE", "--near", "0", "--out", "OUT"], "near is 0.0"),
    "no size": (["orbit", "SCENE", "--size", "0x24", "--out", "OUT"], "image's width is 0"),
    "no file": (["--check", "nowhere.json"], "nowhere.json"),
    "no such scene": (["orbit", "nowhere.glb", "--out", "OUT"], "there is no such file"),
    "no cameras": (["cameras", "EMPTY", "--out", "OUT"], "has a camera"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input_is_one_line_and_writes_nothing(name, scene, tmp_path, capsys):
    given, expected = WRONG[name]
    empty = tmp_path / "empty.gltf"
    empty.write_text(json.dumps({"asset": {"version": "2.0"}, "scenes": [{}], "scene": 0}))
    out = tmp_path / "out.json"
    words = {"SCENE": scene, "OUT": str(out), "EMPTY": str(empty)}
    assert main(["path", *(words.get(word, word) for word in given)]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("size", ["32", "32x", "axb", "32x24x8"])
def test_a_size_that_is_none_is_a_usage_error(size, tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        main(["path", "cameras", "x.glb", "--size", size, "--out", str(tmp_path / "o.json")])
    assert left.value.code == 2
    assert "--size" in capsys.readouterr().err


def test_the_commands_of_the_documentation_do_what_it_says(scene, tmp_path, monkeypatch):
    page = Path(__file__).parent.parent.parent / "docs" / "paths.md"
    commands = re.findall(r"^visref (path .*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert {"orbit", "walk", "from-poses", "--check"} <= {text.split()[1] for text in commands}
    monkeypatch.chdir(tmp_path)
    Path("poses.csv").write_text("x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,1\n")
    for text in commands:
        words = [scene if word == "SCENE" else word for word in shlex.split(text)]
        # As many samples as it takes to see that it goes.
        small = [] if "--size" in words or words[1] in ("--check", "stereo") else ["--size", "8x6"]
        assert main([*words, *small]) == 0, text


def test_no_input_is_written_over(tmp_path, capsys):
    scene, path, poses = write_house(tmp_path), tmp_path / "path.json", tmp_path / "poses.csv"
    poses.write_text("x,y,z,qx,qy,qz,qw\n0,1,2,0,0,0,1\n")
    eye = ["path", "walk", "--through", "1,1.5,3; 6,1.5,3.5", *SMALL]
    assert main([*eye, "--out", str(path)]) == 0
    for given in (
        ["orbit", scene, "--frames", "2", *SMALL, "--out", scene],
        ["stereo", "--from", str(path), "--out", str(path)],
        ["from-poses", str(poses), "--convention", "opengl", "--out", str(poses)],
    ):
        before = Path(given[-1]).read_bytes()
        assert main(["path", *given]) == 2
        assert "would be lost" in capsys.readouterr().err
        assert Path(given[-1]).read_bytes() == before


def test_times_beyond_float64_are_one_line(tmp_path, capsys):
    given = ["walk", "--through", "1,1.5,3; 6,1.5,3.5", "--fps", "1e-320", *SMALL]
    assert main(["path", *given, "--out", str(tmp_path / "path.json")]) == 2
    assert "a frame's time infinite" in capsys.readouterr().err
