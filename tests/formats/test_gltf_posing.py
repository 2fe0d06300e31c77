"""Animated glTF files: visibility, cameras in step, what is kept of them, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.formats.test_gltf_animation import (
    POINTER,
    VISIBLE,
    animate,
    assert_as_evaluated,
    read,
)
from tests.support.gltf_files import SQUARE, TRIANGLE, TWO, Gltf, one_triangle
from tests.support.gltf_pose import opened
from visref.errors import InputError
from visref.findings import Code
from visref.formats import load_path, load_scene
from visref.formats.gltf.objects import read_gltf
from visref.memory import Budget

MODELS = Path("/usr/share/assimp/models/glTF2")


def hidden(gltf: Gltf, node: int) -> None:
    gltf.json["nodes"][node]["extensions"] = {"KHR_node_visibility": {"visible": False}}


def triangle_mesh(gltf: Gltf, **more) -> int:
    return gltf.mesh(gltf.primitive(TRIANGLE, np.arange(3, dtype="u2"), **more))


def test_what_a_clip_shows_is_hidden_at_rest_and_keeps_its_triangles(tmp_path):
    gltf = Gltf()
    mesh = triangle_mesh(gltf)
    for name in ("shown later", "never shown", "plain"):
        gltf.node(mesh=mesh, name=name)
    hidden(gltf, 0)
    hidden(gltf, 1)
    animate(gltf, "/nodes/0", VISIBLE, [1, 2], np.array([1, 0], "u1"), "STEP")
    animate(gltf, "/nodes/1", VISIBLE, [1, 2], np.array([0, 0], "u1"), "STEP")
    scene = load_scene(gltf.write(tmp_path / "a.glb"))
    assert np.diff(scene.object_offsets).tolist() == [1, 0, 1]
    assert scene.absent.tolist() == [True, False, False]
    assert scene.rig.hidden.tolist() == [True, False, False]
    motion = scene.rig.motion
    # A key's value holds before it, too.
    hides = [motion.at(0, time).hidden.tolist() for time in (0.0, 1.5, 2.0, 9.0)]
    assert hides == [[False] * 3, [False] * 3, [True, False, False], [True, False, False]]
    assert motion.affected(0).tolist() == [True, False, False]


def test_a_hidden_node_hides_its_subtree_whatever_that_says(tmp_path):
    gltf = Gltf()
    mesh = triangle_mesh(gltf)
    child = gltf.node(root=False, mesh=mesh, name="child")
    above = gltf.node(mesh=mesh, name="above", children=[child])
    hidden(gltf, child)
    animate(gltf, f"/nodes/{above}", VISIBLE, [0, 2, 4], np.array([1, 0, 1], "u1"), "STEP")
    animate(gltf, f"/nodes/{child}", VISIBLE, [0, 1], np.array([0, 1], "u1"), "STEP")
    motion = read(gltf, tmp_path).motion
    hides = {time: motion.at(0, time).hidden.tolist() for time in (0.0, 1.0, 2.0, 4.0)}
    # Above is the first object.
    assert hides == {
        0.0: [False, True],
        1.0: [False, False],
        2.0: [True, True],
        4.0: [False, False],
    }


def test_shown_only_by_two_clips_together_is_never_shown(tmp_path):
    gltf = Gltf()
    child = gltf.node(root=False, mesh=triangle_mesh(gltf), name="child")
    above = gltf.node(children=[child])
    for clip, node in enumerate((child, above)):
        hidden(gltf, node)
        animate(gltf, f"/nodes/{node}", VISIBLE, [0], np.array([1], "u1"), "STEP", clip=clip)
    scene = load_scene(gltf.write(tmp_path / "a.glb"))
    assert scene.triangle_count == 0
    assert scene.absent is None


def skinned_file() -> Gltf:
    gltf = Gltf()
    bone = gltf.node(name="bone")
    primitive = gltf.primitive(SQUARE, TWO)
    primitive["attributes"]["JOINTS_0"] = gltf.accessor(np.zeros((4, 4), "u1"))
    primitive["attributes"]["WEIGHTS_0"] = gltf.accessor(np.full((4, 4), 0.25, "f4"))
    skin = gltf.entry("skins", joints=[bone])
    gltf.node(mesh=gltf.mesh(primitive), skin=skin, name="figure", translation=[7, 7, 7])
    gltf.node(mesh=0, name="statue")
    animate(gltf, bone, "translation", [0, 1], [[0, 0, 0], [0, 0, 4.0]])
    return gltf


def test_a_figure_follows_its_joints_and_not_its_node(tmp_path):
    placed = read(skinned_file(), tmp_path)
    assert placed.motion.skinned.tolist() == [True, False]
    assert placed.motion.affected(0).tolist() == [True, False]
    moment = placed.motion.at(0, 0.5)
    assert np.array_equal(moment.positions[0], SQUARE + np.array([0, 0, 2]))
    assert np.array_equal(moment.worlds, np.eye(4)[None])


def test_posed_at_rest_a_figure_has_the_very_vertices_that_were_read(tmp_path):
    gltf = skinned_file()
    gltf.json["animations"] = []
    turn = np.array([0.1, 0.2, 0.3, 0.9], "f4")
    gltf.json["nodes"][0]["rotation"] = turn.tolist()
    animate(gltf, 0, "rotation", [0], turn[None])
    placed = read(gltf, tmp_path)
    got = placed.motion.at(0, 0.0).positions[0]
    # STEP's, LINEAR's and the rest pose's quaternion are normalised alike.
    gltf.json["animations"][0]["samplers"][0]["interpolation"] = "STEP"
    stepped = read(gltf, tmp_path).motion.at(0, 0.0).positions[0]
    assert stepped.tobytes() == placed.meshes[0].positions.tobytes()
    assert np.abs(got - stepped).max() < 1e-15


def test_a_skinned_object_switched_off_by_its_node_is_affected(tmp_path):
    gltf = skinned_file()
    gltf.json["animations"] = []
    animate(gltf, "/nodes/1", VISIBLE, [0, 1], np.array([1, 0], "u1"), "STEP")
    motion = read(gltf, tmp_path).motion
    assert motion.affected(0).tolist() == [True, False]
    assert motion.at(0, 1.0).hidden.tolist() == [True, False]
    assert motion.at(0, 1.0).positions == {}


def test_instances_go_with_the_node_that_carries_them(tmp_path):
    gltf = Gltf()
    places = gltf.accessor(np.array([[1, 0, 0], [0, 1, 0]], "f4"))
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
    node = gltf.node(mesh=triangle_mesh(gltf), name="flock", extensions=extension)
    animate(gltf, node, "scale", [0, 1], [[1, 1, 1], [3.0, 3, 3]])
    moment = read(gltf, tmp_path).motion.at(0, 1.0)
    assert moment.objects.tolist() == [0, 1]
    assert moment.worlds[:, :3, 3].tolist() == [[3, 0, 0], [0, 3, 0]]


def test_a_nodes_own_weights_stand_before_what_animates_its_mesh(tmp_path):
    gltf = Gltf()
    moved = gltf.accessor(np.ones((3, 3), "f4"))
    mesh = triangle_mesh(gltf, targets=[{"POSITION": moved}])
    for more in ({}, {"weights": [0.5]}, {}):
        gltf.node(mesh=mesh, **more)
    animate(gltf, f"/meshes/{mesh}", "weights", [0], [[2.0]])
    animate(gltf, 2, "weights", [0], [[3.0]])
    motion = read(gltf, tmp_path).motion
    moment = motion.at(0, 0.0)
    assert {number: points[0, 0] for number, points in moment.positions.items()} == {0: 2.0, 2: 3.0}
    assert motion.affected(0).tolist() == [True, False, True]


def test_a_rotation_takes_the_short_way_whichever_sign_its_quaternions_have(tmp_path):
    half = np.radians(40.0) / 2
    end = np.array([[0, 0, np.sin(half), np.cos(half)]], "f4")
    worlds = []
    for sign in (1, -1):
        gltf = one_triangle()
        animate(gltf, 0, "rotation", [0, 1], np.concatenate([[[0, 0, 0, 1]], sign * end]))
        worlds.append(read(gltf, tmp_path).motion.at(0, 0.5).worlds[0])
    # A float32 sine or cosine is off by up to 2^-25.
    assert np.allclose(worlds[0][:2, 0], np.cos(np.radians([20.0, 70.0])), rtol=0, atol=2e-7)
    assert np.array_equal(*worlds)


def test_clips_have_names_of_their_own(tmp_path):
    gltf = one_triangle()
    for clip in range(4):
        animate(gltf, 0, "scale", [0], [[1.0, 1, 1]], clip=clip)
    for clip, name in ((0, "walk"), (2, "walk")):
        gltf.json["animations"][clip]["name"] = name
    assert read(gltf, tmp_path).motion.clips == ("walk", "animation", "walk#2", "animation#2")


@pytest.mark.parametrize("change", ["key", "value", "kind", "bind", "weight", "still"])
def test_the_digest_is_of_all_that_poses(tmp_path, change):
    def digest(change: str) -> str:
        gltf = skinned_file()
        values = [[0, 0, 0], [0, 0, 5.0 if change == "value" else 4.0]]
        gltf.json["animations"] = []
        kind = "STEP" if change == "kind" else "LINEAR"
        animate(gltf, 0, "translation", [0, 2 if change == "key" else 1], values, kind)
        if change == "bind":
            bind = np.eye(4, dtype="f4").reshape(1, 16)
            bind[0, 12] = 1
            gltf.json["skins"][0]["inverseBindMatrices"] = gltf.accessor(bind)
        if change == "weight":
            gltf.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = gltf.accessor(
                np.full((4, 4), 0.5, "f4")
            )
        return load_scene(gltf.write(tmp_path / "a.glb")).motion

    assert (digest(change) == digest("")) == (change == "still")
    assert len(digest(change)) == 64


def test_a_still_file_has_a_rig_without_motion(tmp_path):
    scene = load_scene(one_triangle().write(tmp_path / "a.glb"))
    assert (scene.rig.motion, scene.motion, scene.absent, scene.rig.hidden) == (
        None,
        "",
        None,
        None,
    )
    assert np.array_equal(scene.rig.positions[0], TRIANGLE)
    assert scene.rig.vertex_starts.tolist() == [0, 3]


def test_what_lenient_drops_is_told_to_the_rig(tmp_path):
    gltf = Gltf()
    bad = np.concatenate([TRIANGLE, TRIANGLE + 2])
    bad[4, 1] = np.nan
    gltf.node(mesh=gltf.mesh(gltf.primitive(bad, np.arange(6, dtype="u2"))), name="a")
    gltf.node(mesh=triangle_mesh(gltf), name="b")
    scene = load_scene(gltf.write(tmp_path / "a.glb"), lenient=True)
    assert scene.rig.kept.tolist() == [True] * 4 + [False] + [True] * 4
    assert scene.rig.vertex_starts.tolist() == [0, 6, 9]
    assert len(scene.vertices) == 8


def masked(gltf: Gltf) -> None:
    primitive = gltf.json["meshes"][0]["primitives"][0]
    primitive["material"] = gltf.entry("materials", alphaMode="MASK")
    moved = gltf.accessor(np.ones((3, 3), "f4"))
    colour = gltf.accessor(np.full((3, 4), -0.75, "f4"))
    primitive["attributes"]["COLOR_0"] = gltf.accessor(np.ones((3, 4), "f4"))
    primitive["targets"] = [{"POSITION": moved, "COLOR_0": colour}]


@pytest.mark.parametrize("animated", [True, False])
def test_a_masks_colours_that_a_target_animates_stay_and_that_is_said(tmp_path, animated):
    gltf = one_triangle()
    masked(gltf)
    if animated:
        animate(gltf, 0, "weights", [0, 1], [[0.0], [1.0]])
    notes = load_scene(gltf.write(tmp_path / "a.glb")).notes
    said = [text for code, text in notes if code == Code.PARTLY_READ]
    assert len(said) == animated
    assert all(text.endswith("first meshes[0]") for text in said)


def camera_file() -> Gltf:
    gltf = one_triangle()
    gltf.entry("cameras", type="perspective", perspective={"yfov": 1.0, "znear": 0.5})
    gltf.node(camera=0)
    return gltf


def test_a_moving_camera_says_when_it_is_where_and_in_which_clip(tmp_path):
    gltf = camera_file()
    gltf.node(camera=0)
    for clip, name in enumerate(("fly", "land")):
        animate(gltf, 1, "translation", [1, 2], [[0, 0, 0], [0, 0, 8.0]], clip=clip)
        gltf.json["animations"][clip]["name"] = name
    path = load_path(gltf.write(tmp_path / "a.glb"), fps=2.0)
    said = [(frame.time_s, frame.clip) for frame in path.frames]
    moving = [(time, clip) for clip in ("fly", "land") for time in (1.0, 1.5, 2.0)]
    assert said == [*moving, (None, None)]
    assert [frame.cameras[0].eye[2] for frame in path.frames] == [0, 4, 8, 0, 4, 8, 0]


def test_a_pointer_moves_a_camera_as_a_channel_does(tmp_path):
    gltf = camera_file()
    animate(gltf, "/nodes/1", "translation", [0, 1], [[0, 0, 0], [0, 0, 8.0]])
    path = load_path(gltf.write(tmp_path / "a.glb"), fps=2.0)
    assert [camera.eye[2] for camera in path] == [0, 4, 8]


def test_weights_alone_do_not_move_a_camera(tmp_path):
    gltf = camera_file()
    gltf.json["nodes"][1]["mesh"] = 0
    gltf.json["meshes"][0]["primitives"][0]["targets"] = [
        {"POSITION": gltf.accessor(np.ones((3, 3), "f4"))}
    ]
    animate(gltf, 1, "weights", [0, 1], [[0.0], [1.0]])
    (frame,) = load_path(gltf.write(tmp_path / "a.glb")).frames
    assert frame.time_s is None


def spoiled(kind: str) -> Gltf:
    """A file with one channel, that is wrong in one way."""
    gltf = one_triangle()
    values = {"output": [[0.0, 0, 0]] * 3, "value": [[0, np.nan, 0], [0, 0, 0]]}
    times = {"times": [1, 1], "nan": [0, np.nan], "falls": [1, 0]}
    path, target, more = "translation", 0, "LINEAR"
    rows = values.get(kind, [[0.0, 0, 0], [1, 1, 1]])
    if kind == "rotation":
        path, rows = "rotation", [[0.0, 0, 0, 0], [0, 0, 0, 1]]
    if kind == "spline":
        more = "CUBICSPLINE"
    if kind in ("no targets", "weights", "no mesh"):
        path, rows = "weights", [[0.0], [1], [2]]
    if kind == "weights":
        moved = gltf.accessor(np.ones((3, 3), "f4"))
        gltf.json["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": moved}]
    if kind == "linear visibility":
        target, path, rows = "/nodes/0", VISIBLE, np.array([0, 1], "u1")
    animate(gltf, target, path, times.get(kind, [0, 1]), rows, more)
    (animation,) = gltf.json["animations"]
    (channel,) = animation["channels"]
    if kind == "node":
        channel["target"]["node"] = 7
    if kind == "sampler":
        channel["sampler"] = 1
    if kind == "path":
        channel["target"]["path"] = "colour"
    if kind == "no pointer":
        channel["target"] = {"path": "pointer"}
    if kind == "far pointer":
        channel["target"] = pointing("/nodes/7/translation")
    if kind == "odd pointer":
        channel["target"] = pointing("/nodes/first/translation")
    if kind == "twice":
        animation["channels"].append(channel)
    if kind == "interpolation":
        animation["samplers"][0]["interpolation"] = "BEZIER"
    if kind == "matrix":
        gltf.json["nodes"][0]["matrix"] = np.eye(4).reshape(-1).tolist()
    if kind == "no keys":
        gltf.json["accessors"][animation["samplers"][0]["input"]]["count"] = 0
    if kind == "no mesh":
        channel["target"] = {"node": gltf.node(), "path": "weights"}
    return gltf


def pointing(pointer: str) -> dict:
    return {"path": "pointer", "extensions": {POINTER: {"pointer": pointer}}}


@pytest.mark.parametrize(
    ("kind", "place"),
    [
        ("output", "animations[0].samplers[0]"),
        ("value", "animations[0].samplers[0].output"),
        ("times", "animations[0].samplers[0].input"),
        ("nan", "animations[0].samplers[0].input"),
        ("falls", "animations[0].samplers[0].input"),
        ("rotation", "animations[0].samplers[0].output"),
        ("spline", "animations[0].samplers[0]"),
        ("no targets", "animations[0].samplers[0]"),
        ("no mesh", "animations[0].samplers[0]"),
        ("weights", "animations[0].samplers[0]"),
        ("linear visibility", "animations[0].samplers[0]"),
        ("node", "animations[0].channels[0].target.node"),
        ("sampler", "animations[0].channels[0].sampler"),
        ("path", "animations[0].channels[0].target.path"),
        ("no pointer", "animations[0].channels[0].target"),
        (
            "far pointer",
            "animations[0].channels[0].target.extensions.KHR_animation_pointer.pointer",
        ),
        (
            "odd pointer",
            "animations[0].channels[0].target.extensions.KHR_animation_pointer.pointer",
        ),
        ("twice", "animations[0].channels[1]"),
        ("interpolation", "animations[0].samplers[0]"),
        ("matrix", "nodes[0]"),
        ("no keys", "accessors[2].count"),
    ],
)
def test_a_bad_animation_is_refused_in_a_line_with_its_place(tmp_path, kind, place):
    with pytest.raises(InputError) as caught:
        load_scene(spoiled(kind).write(tmp_path / "bad.glb"))
    assert caught.value.place == place
    assert "\n" not in str(caught.value)
    assert caught.value.fix


def test_a_rotation_that_vanishes_between_its_keys_is_refused_when_it_does(tmp_path):
    gltf = one_triangle()
    flat = [0, 0, 0, 0]
    rows = [flat, [0, 0, 0, 1], flat, flat, [0, 0, 0, -1.0], flat]
    animate(gltf, 0, "rotation", [0, 1], rows, "CUBICSPLINE")
    motion = read(gltf, tmp_path).motion
    assert np.isfinite(motion.at(0, 0.25).worlds).all()
    with pytest.raises(InputError, match=r"animations\[0\]: the matrix of an object is not finite"):
        motion.at(0, 0.5)


def test_keys_that_expand_beyond_the_limit_are_refused(tmp_path):
    gltf = one_triangle()
    animate(gltf, 0, "scale", [0, 1], np.ones((2, 3)))
    (animation,) = gltf.json["animations"]
    for name in ("input", "output"):
        accessor = gltf.json["accessors"][animation["samplers"][0][name]]
        accessor["count"] = 50_000_000
        del accessor["bufferView"]
    with pytest.raises(InputError, match="max-memory"):
        load_scene(gltf.write(tmp_path / "a.glb"), max_memory=200 << 20)


@pytest.mark.skipif(not MODELS.is_dir(), reason="the package assimp-testmodels is not installed")
@pytest.mark.parametrize(
    ("name", "moves"),
    [
        ("simple_skin/simple_skin.gltf", "skin"),
        ("glTF-Sample-Models/AnimatedMorphCube-glTF/AnimatedMorphCube.gltf", "morph"),
    ],
)
def test_models_of_others_stand_where_the_specification_has_them(name, moves):
    document, buffers = opened(MODELS / name)
    placed = read_gltf(MODELS / name, budget=Budget.of(1 << 30))
    keys = placed.motion.channels[0][0].times
    assert (placed.motion.skinned.any()) == (moves == "skin")
    times = np.linspace(keys[0] - 0.5, keys[-1] + 0.5, 23)
    for time in times:
        assert_as_evaluated(placed, document, buffers, 0, float(time))
    points = [placed.motion.at(0, float(time)).positions[0] for time in times]
    assert np.ptp(points, axis=0).max() > 1e-3
