"""The six views of a cube map."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath, Frame
from visref.cli.main import main
from visref.paths.cube import cube_frame, cube_views

EYE = np.array([1.0, 2.0, -3.0])
AXES = {
    "px": (1, 0, 0), "nx": (-1, 0, 0), "py": (0, 1, 0), "ny": (0, -1, 0),
    "pz": (0, 0, 1), "nz": (0, 0, -1),
}  # fmt: skip
VIEWS = cube_views(EYE, 64, 0.5)


def test_each_view_looks_along_the_axis_of_its_name_and_mirrors_nothing():
    assert [camera.view for camera in VIEWS] == list(AXES)
    for camera in VIEWS:
        assert camera.forward.tolist() == list(AXES[camera.view])
        assert camera.eye.tolist() == EYE.tolist()
        assert np.linalg.det(camera.world_from_camera) == 1.0


def seen_by(direction: np.ndarray) -> list[str]:
    """The views whose frustum, as GL would clip, holds the point one such step from the eye."""
    found = []
    for camera in VIEWS:
        x, y, _, w = camera.clip_from_world() @ np.append(EYE + direction, 1.0)
        if w > 0.0 and abs(x) <= w and abs(y) <= w:
            found.append(camera.view)
    return found


coordinates = st.integers(-1000, 1000)


@given(st.tuples(coordinates, coordinates, coordinates))
def test_every_direction_lies_in_the_view_of_its_longest_component(direction):
    lengths = np.abs(direction)
    longest = np.flatnonzero(lengths == lengths.max())
    if len(longest) > 1:
        return
    (axis,) = longest
    name = ("p" if direction[axis] > 0 else "n") + "xyz"[axis]
    # A tie on a border is by far out of the reach of rounding: components are whole numbers.
    assert seen_by(np.array(direction, np.float64)) == [name]


def test_no_sample_lies_on_a_border():
    for camera in VIEWS:
        for x, y in ((0, 0), (63, 63), (0, 31), (17, 63)):
            assert seen_by(camera.ray(x, y)[1]) == [camera.view]


def test_samples_of_all_views_go_in_different_directions():
    rays = np.array(
        [
            camera.ray(x, y)[1]
            for camera in cube_views(EYE, 5, 0.5)
            for y in range(5)
            for x in range(5)
        ]
    )
    assert len(np.unique(rays / np.abs(rays).max(axis=1, keepdims=True), axis=0)) == 6 * 25


def test_a_frame_keeps_all_else_that_it_says():
    camera = Camera(look_at(EYE, EYE + 1.0), 8, 6, near=0.25, far=9.0, yfov=1.0, cut=True)
    frame = Frame((camera,), 0.5, "walk", {"lift": np.eye(4)}, ("door",), {"tree": 1})
    cube = cube_frame(frame, 16)
    assert replace(cube, cameras=frame.cameras).definition() == frame.definition()
    assert {(one.near, one.far, one.cut, one.width) for one in cube.cameras} == {
        (0.25, 9.0, True, 16)
    }


def test_command_writes_what_the_reader_reads(tmp_path):
    out = tmp_path / "cube.json"
    assert main(["path", "cube", "--eye", "1,2,-3", "--size", "64", "--near", "0.5",
                 "--out", str(out)]) == 0  # fmt: skip
    (frame,) = CameraPath.load(out).frames
    assert [one.definition() for one in frame.cameras] == [one.definition() for one in VIEWS]
    again = tmp_path / "again.json"
    assert main(["path", "cube", "--from", str(out), "--size", "64", "--out", str(again)]) == 0
    assert json.loads(again.read_text()) == json.loads(out.read_text())


@pytest.mark.parametrize(
    ("eye", "expected"), [("1,2", "is no point"), ("1,2,x", "is no point"), ("1,2,inf", "no point")]
)
def test_an_eye_that_is_no_point_is_one_line(eye, expected, tmp_path, capsys):
    out = tmp_path / "cube.json"
    assert main(["path", "cube", "--eye", eye, "--size", "8", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_two_eyes_make_no_cube(tmp_path, capsys):
    views = tuple(
        Camera(look_at((x, 0, 0), (x, 0, -1)), 8, 6, near=0.1, yfov=math.pi / 3, view=view)
        for x, view in ((-0.03, "left"), (0.03, "right"))
    )
    path = tmp_path / "path.json"
    path.write_text(json.dumps(CameraPath([Frame(views)]).to_json()))
    out = tmp_path / "cube.json"
    assert main(["path", "cube", "--from", str(path), "--size", "8", "--out", str(out)]) == 2
    assert "frames[0]: its views have several eyes" in capsys.readouterr().err
