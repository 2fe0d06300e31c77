"""What the frames of a path see: said of rooms in which it is known."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.paths.rooms import box, house
from tests.support.gltf_files import Gltf, one_triangle
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath, Frame
from visref.cli.main import main
from visref.inputs import Inputs
from visref.paths.looking import looks, winding_number
from visref.scene import Scene


def camera(eye, target, **changes) -> Camera:
    return Camera(look_at(eye, target), **{"width": 32, "height": 24, "near": 0.01, "yfov": 1.0,
                                           **changes})  # fmt: skip


def seen(scene: Scene, *frames):
    path = CameraPath(frames)
    return list(looks(Inputs(scene, path, range(len(path)))))


def test_a_view_that_one_wall_fills_is_told_exactly():
    # Two and a half from the south wall, whose front it sees, and what its view covers there.
    (look,) = seen(house(), camera((2.0, 1.5, 3.5), (2.0, 1.5, 9.0), yfov=0.5))
    assert (look.visible, look.samples, look.hits, look.from_behind) == (1, 768, 768, 0)
    assert look.nearest == 2.5
    # Nearer than floor and ceiling, at 1.5, is an edge of the cupboard behind.
    assert look.clearance == pytest.approx(math.hypot(1.25, 0.5), rel=2.0**-50)
    assert (look.inside, look.through) == ((), None)


def test_a_view_into_the_void_meets_nothing():
    (look,) = seen(house(), camera((0.0, 10.0, 0.0), (0.0, 20.0, 1.0)))
    assert (look.visible, look.hits, look.nearest) == (0, 0, math.inf)
    assert look.clearance == 6.75


def test_an_eye_inside_of_a_wall_sees_backs_and_is_said_to_be_in_it():
    scene = house()
    wall = scene.names.index("south")
    (look,) = seen(scene, camera((2.0, 1.5, 6.125), (2.0, 1.5, 0.0)))
    assert look.inside == (wall,)
    assert look.from_behind == look.hits == look.samples


def test_a_room_of_walls_and_an_open_box_have_no_inside():
    (look,) = seen(house(), camera((2.0, 1.0, 3.0), (3.0, 1.0, 3.0)))
    assert look.inside == ()
    vertices, triangles = box((0, 0, 0), (2, 2, 2))
    at = camera((1.0, 1.0, 1.0), (0.0, 1.0, 1.0))
    for faces, inside in ((triangles, (0,)), (triangles[2:], ()), (triangles[:, ::-1], ())):
        # A shell that is wound inwards is a room.
        (look,) = seen(Scene.from_objects([("box", vertices, faces)]), at)
        assert look.inside == inside


@pytest.mark.parametrize(
    ("point", "expected"),
    [((0.5, 0.5, 0.5), 1), ((0.999, 0.001, 0.5), 1), ((1.001, 0.5, 0.5), 0), ((9, 9, 9), 0)],
)
def test_winding_numbers_of_a_box(point, expected):
    scene = Scene.from_objects([("box", *box((0, 0, 0), (1, 1, 1)))])
    assert winding_number(scene, 0, np.array(point)) == pytest.approx(expected, abs=1e-12)


def test_an_eye_that_comes_through_a_wall_is_told_unless_it_jumps():
    scene = house()
    wall = scene.names.index("wall by the door")
    west, east = camera((3, 1, 1), (8, 1, 1)), camera((5, 1, 1), (8, 1, 1))
    by_door = [camera((x, 1, 2.9), (8, 1, 2.9)) for x in (3, 5)]
    assert [look.through for look in seen(scene, west, east)] == [None, wall]
    assert [look.through for look in seen(scene, west, replace(east, cut=True))] == [None, None]
    assert [look.through for look in seen(scene, west, *by_door, east)] == [None] * 4
    assert [look.through for look in seen(scene, west, west)] == [None, None]


def test_each_view_has_its_own_way():
    scene = house()
    wall = scene.names.index("wall by the door")
    left = [replace(camera((x, 1, 1), (8, 1, 1)), view="left") for x in (3, 5)]
    right = [replace(camera((x, 1, 2.9), (8, 1, 2.9)), view="right") for x in (3, 5)]
    found = seen(scene, Frame((left[0], right[0])), Frame((left[1], right[1])))
    assert [(look.frame, look.view, look.through) for look in found] == [
        (0, "left", None), (0, "right", None), (1, "left", wall), (1, "right", None),
    ]  # fmt: skip


def test_what_moves_is_looked_at_where_it_is():
    scene = Scene.from_objects([("box", *box((0, 0, 0), (1, 1, 1)))])
    at = camera((0.5, 0.5, 5.0), (0.5, 0.5, 0.0))
    there, away = np.eye(4), np.eye(4)
    there[2, 3], away[0, 3] = 2.0, 100.0
    found = seen(scene, *(Frame((at,), world_from_object={"box": m}) for m in (there, away)))
    assert [look.nearest for look in found] == [2.0, math.inf]
    assert [look.visible for look in found] == [1, 0]


@pytest.fixture
def files(tmp_path):
    """A triangle that a camera looks at, and a path of two frames of which one looks away."""
    scene: Gltf = one_triangle()
    path = CameraPath([camera((0.2, 0.2, 3), (0.2, 0.2, 0)), camera((0.2, 0.2, 3), (0.2, 0.2, 9))])
    (tmp_path / "path.json").write_text(json.dumps(path.to_json()))
    return str(scene.write(tmp_path / "scene.glb")), str(tmp_path / "path.json")


def test_the_command_prints_a_row_for_each_view_and_what_they_come_to(files, capsys):
    scene, path = files
    assert main(["path", "--check", path, "--scene", scene]) == 0
    heading, first, second, summary = capsys.readouterr().out.splitlines()
    assert heading.split() == ["frame", "view", "visible", "hits", "behind", "nearest", "clear",
                               "eye"]  # fmt: skip
    assert first.split()[:2] == ["0", "1"]
    assert first.split()[-3:] == ["3", "3", "free"]
    assert second.split() == ["1", "0", "0", "%", "-", "-", "3", "free"]
    assert summary == ("2 views: 1 met nothing, 0 inside an object, 0 came through one")


def test_for_programs_it_is_json(files, capsys):
    scene, path = files
    assert main(["path", "--check", path, "--scene", scene, "--json"]) == 0
    first, second = json.loads(capsys.readouterr().out)
    assert second == {
        "frame": 1, "view": "", "visible": 0, "samples": 768, "hits": 0, "from_behind": 0,
        "nearest": None, "clearance": 3.0, "inside": [], "through": None,
    }  # fmt: skip
    assert first["visible"] == 1
    assert 0 < first["hits"] < 768


def test_without_a_scene_it_says_where_the_cameras_look(files, capsys):
    _, path = files
    assert main(["path", "--check", path]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert rows[1].split() == ["0", "57.296", "0.2", "0.2", "3", "0", "0", "-1"]
    assert main(["path", "--check", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[1]["looks along"] == [0.0, 0.0, 1.0]
