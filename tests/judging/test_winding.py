"""A one-sided scene that is inside out is named, one that is rightly wound is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.gltf_files import Gltf
from tests.support.truth_scenes import Part, box, build
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.formats import load_scene
from visref.judging.referee import Referee
from visref.judging.winding import TRIANGLES, inside_out, volume_signs
from visref.scene import Scene


def one_sided(part: Part, *, turned: bool = False) -> Part:
    faces = part.faces[:, ::-1] if turned else part.faces
    return Part(part.points, faces, part.alpha, True)


def eye(position, target=(0.0, 0.0, 0.0)):
    return [Camera(look_at(position, target), 48, 36, near=0.01, yfov=1.0)]


OUTSIDE = [eye((0.0, 3.0, 12.0)), eye((9.0, 4.0, -7.0))]
INSIDE = [eye((0.1, 0.2, 0.3), (1.0, 0.5, 0.0)), eye((0.1, 0.2, 0.3), (-1.0, 0.1, 0.4))]
CUBE = box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
# A sheet that faces +Y, below everything and wider than the pictures' share of the cubes.
SHEET = Part(
    np.array([[-40, -3, 40], [40, -3, 40], [40, -3, -40], [-40, -3, -40]], float),
    np.array([[0, 1, 2], [0, 2, 3]]),
)


def found(scene, frames, kind=ExactEngine):
    return [finding.message for finding in inside_out(kind, scene, frames)]


@pytest.mark.parametrize("kind", [ExactEngine, EmbreeEngine])
def test_a_cube_is_accused_only_where_it_is_wound_inwards(kind):
    assert not found(build(one_sided(CUBE)), OUTSIDE, kind)
    (message,) = found(build(one_sided(CUBE, turned=True)), OUTSIDE, kind)
    assert message == (
        "100 % of what the cameras meet in 2 frames is back faces, and 1 of 1 closed object met "
        "is inside out: turn the winding, or leave --cull-backfaces out"
    )


def test_two_sided_triangles_are_never_accused():
    class Never(ExactEngine):
        def frame(self, camera):
            raise AssertionError("it was cast")

    turned = replace(one_sided(CUBE, turned=True), one_sided=False)
    assert not found(build(turned), OUTSIDE, Never)


def test_an_open_sheet_is_accused_only_where_it_is_seen_from_behind():
    above, below = [eye((0.0, 9.0, 12.0))], [eye((0.0, -9.0, 12.0))]
    assert not found(build(one_sided(SHEET)), above)
    (message,) = found(build(one_sided(SHEET)), below)
    assert message.startswith("100 % of what the cameras meet in 1 frame is back faces: turn")
    assert found(build(one_sided(SHEET, turned=True)), above)


def test_a_room_wound_inwards_and_seen_from_within_is_right():
    assert not found(build(one_sided(CUBE, turned=True)), INSIDE)


def test_a_room_wound_as_a_solid_shows_no_wall_from_within_and_is_accused():
    (message,) = found(build(one_sided(CUBE)), INSIDE)
    assert "100 % of what the cameras meet in 2 frames is back faces" in message
    assert "0 of 1 closed object met are inside out" in message


def test_rooms_that_no_camera_sees_accuse_nobody():
    """Their volume is negative, and whether they are rooms cannot be told."""
    others = [one_sided(box((50.0 * i, 0.0, 0.0), (2.0, 2.0, 2.0)), turned=True) for i in (1, 2, 3)]
    assert not found(build(one_sided(CUBE, turned=True), *others), INSIDE)


def test_closed_objects_inside_out_on_a_right_ground_are_accused():
    ground = one_sided(SHEET)
    small = box((0.0, 0.0, 0.0), (0.5, 0.5, 0.5))
    assert not found(build(ground, one_sided(small)), OUTSIDE)
    (message,) = found(build(ground, one_sided(small, turned=True)), OUTSIDE)
    assert int(message.split(" %")[0]) < 50
    assert "1 of 1 closed object met is inside out" in message


def test_fewer_than_half_of_the_closed_objects_are_not_enough():
    ground = one_sided(SHEET)
    cubes = [box((2.0 * i - 3.0, 0.0, 0.0), (0.5, 0.5, 0.5)) for i in range(4)]
    half = [one_sided(cube, turned=i < 2) for i, cube in enumerate(cubes)]
    most = [one_sided(cube, turned=i < 3) for i, cube in enumerate(cubes)]
    assert not found(build(ground, *half), OUTSIDE)
    assert "3 of 4 closed objects met are" in found(build(ground, *most), OUTSIDE)[0]


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1], [-1, -1, -2]])
@pytest.mark.parametrize("turned", [False, True])
def test_mirrored_instances_are_taken_as_they_are_drawn(tmp_path, scale, turned):
    gltf = Gltf()
    faces = one_sided(CUBE, turned=turned).faces
    gltf.json["materials"] = [{"doubleSided": False}]
    primitive = gltf.primitive(CUBE.points.astype("f4"), faces.astype("u2").reshape(-1), material=0)
    gltf.json["meshes"] = [{"primitives": [primitive]}]
    gltf.json["nodes"] = [{"mesh": 0, "scale": scale}]
    gltf.json["scenes"] = [{"nodes": [0]}]
    file = gltf.write(tmp_path / "cube.gltf")
    scene = load_scene(file, cull_backfaces=True)
    assert scene.one_sided.all()
    assert bool(found(scene, OUTSIDE)) is turned


def test_volumes_have_the_sign_of_the_winding_whatever_else_is_near():
    """A cube of vertices that repeat, one turned, an open one, a flat double sheet, one that
    touches the first, an object without triangles, one with flat triangles, two cubes in one."""
    loose = Part(CUBE.points[CUBE.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    beside = box((4.0, 0.0, 0.0), (2.0, 2.0, 2.0))
    flat = Part(SHEET.points, np.concatenate([SHEET.faces, SHEET.faces[:, ::-1]]))
    collapsed = Part(CUBE.points, np.concatenate([CUBE.faces, [[0, 0, 1], [2, 2, 2]]]))
    two = Part(
        np.concatenate([CUBE.points, np.add(beside.points, (0.0, 4.0, 0.0))]),
        np.concatenate([CUBE.faces, beside.faces + 8]),
    )
    scene = build(
        loose,
        Part(loose.points, loose.faces[:, ::-1]),
        Part(CUBE.points, CUBE.faces[:-1]),
        flat,
        beside,
        Part(np.zeros((0, 3)), np.zeros((0, 3), np.int64)),
        collapsed,
        two,
    )
    every = np.arange(scene.object_count, dtype=np.int32)
    assert volume_signs(scene, every).tolist() == [1, -1, 0, 0, 1, 0, 1, 1]
    assert volume_signs(scene, every[1:3]).tolist() == [-1, 0]
    assert volume_signs(scene, every[5:6]).tolist() == [0]


def test_a_small_cube_far_from_the_origin_keeps_its_sign():
    # 2^-7 is the spacing of float32 there.
    far = box((2.0**16, 2.0**16, 2.0**16), (2.0**-7, 2.0**-7, 2.0**-7))
    scene = build(far, Part(far.points, far.faces[:, ::-1]))
    assert volume_signs(scene, np.arange(2, dtype=np.int32)).tolist() == [1, -1]


def test_no_more_than_the_budget_is_examined(monkeypatch):
    cubes = [one_sided(box((3.0 * i, 0.0, 0.0), (1.0, 1.0, 1.0)), turned=True) for i in range(4)]
    monkeypatch.setattr("visref.judging.winding.TRIANGLES", 12 * 2 + 11)
    (message,) = found(build(*cubes), [eye((4.0, 2.0, 20.0), (4.0, 0.0, 0.0))])
    assert "2 of 2 closed objects met are" in message
    assert TRIANGLES > 10**6


def test_a_run_says_so_before_all_else():
    scene: Scene = build(one_sided(CUBE, turned=True))
    path = CameraPath(tuple(views[0] for views in OUTSIDE))
    for examine in (False, True):
        referee = Referee(scene, lambda: ExactEngine(scene), examine=examine)
        codes = [finding.code for finding in referee.run(path, range(2), ()).findings]
        assert codes[:1] == (["INSIDE_OUT"] if examine else [])
