"""MSFT_lod: which objects are levels of which, in which order, and where they stand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.formats.test_gltf_animation import VISIBLE, animate
from tests.support.gltf_files import TRIANGLE, Gltf
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.formats import load_scene
from visref.scene import Scene
from visref.timeline import Timeline


def level_file(*levels: str) -> tuple[Gltf, dict[str, int]]:
    """A tree with a leaf, below a house that stands at (10, 0, 0); its levels are further nodes,
    in the file before the others; a lamp stands after the tree."""
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE, np.arange(3, dtype="u2")))
    ids = {name: gltf.node(root=False, mesh=mesh, name=name) for name in levels}
    ids["lamp"] = gltf.node(root=False, mesh=mesh, name="lamp")
    ids["leaf"] = gltf.node(root=False, mesh=mesh, name="leaf")
    ids["tree"] = gltf.node(
        root=False, mesh=mesh, name="tree", children=[ids["leaf"]], translation=[5, 0, 0]
    )
    has_levels(gltf, ids["tree"], [ids[name] for name in levels])
    children = [ids["tree"], ids["lamp"]]
    ids["house"] = gltf.node(name="house", children=children, translation=[10, 0, 0])
    return gltf, ids


def has_levels(gltf: Gltf, node: int, levels: list[int]) -> None:
    gltf.json["nodes"][node].setdefault("extensions", {})["MSFT_lod"] = {"ids": levels}


def load(gltf: Gltf, folder) -> Scene:
    return load_scene(gltf.write(folder / "levels.glb"))


def test_levels_follow_the_finest_ones_subtree_in_the_extensions_order(tmp_path):
    gltf, ids = level_file("far", "near")
    bush = gltf.node(root=False, mesh=0, name="bush")
    gltf.json["nodes"][ids["far"]]["children"] = [bush]
    scene = load(gltf, tmp_path)
    assert scene.names == ("tree", "leaf", "far", "bush", "near", "lamp")
    (group,) = scene.groups
    assert (group.name, group.path) == ("tree", "house/tree")
    assert group.objects == (0, 1, 2, 3, 4)
    assert group.levels == ((0, 1), (2, 3), (4,))
    assert scene.notes == ()


def test_levels_stand_at_the_finest_ones_parent(tmp_path):
    gltf, ids = level_file("far")
    gltf.json["nodes"][ids["far"]]["translation"] = [0, 1, 0]
    scene = load(gltf, tmp_path)
    assert scene.paths[2] == "house/far"
    # Neither at the tree's own place, nor where a root would stand.
    assert scene.rig.worlds[2][:3, 3].tolist() == [10, 1, 0]


def test_all_levels_but_the_finest_are_absent_and_keep_their_triangles_for_later(tmp_path):
    scene = load(level_file("near", "far")[0], tmp_path)
    assert scene.absent.tolist() == [False, False, True, True, False]
    assert (scene.triangles[2] == scene.triangles[2][0]).all()
    assert len(np.unique(scene.rig.triangles[2])) == 3
    assert scene.rig.hidden is None
    assert np.isinf(scene.object_bounds[2]).all()


def test_a_level_that_is_listed_beside_its_node_too_stands_there_once(tmp_path):
    gltf, ids = level_file("far")
    gltf.json["nodes"][ids["house"]]["children"] = [ids["far"], ids["tree"], ids["lamp"]]
    scene = load(gltf, tmp_path)
    assert scene.names == ("tree", "leaf", "far", "lamp")
    assert scene.groups[0].levels == ((0, 1), (2,))


def test_a_level_of_a_root_that_is_listed_as_a_root_too_stands_there_once(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE, np.arange(3, dtype="u2")))
    far, near = (gltf.node(mesh=mesh, name=name) for name in ("far", "near"))
    has_levels(gltf, near, [far])
    scene = load(gltf, tmp_path)
    assert scene.names == ("near", "far")
    assert scene.absent.tolist() == [False, True]


def test_a_level_beside_a_node_outside_the_scene_is_an_object_like_others(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE, np.arange(3, dtype="u2")))
    far = gltf.node(mesh=mesh, name="far")
    has_levels(gltf, gltf.node(root=False, mesh=mesh, name="near"), [far])
    scene = load(gltf, tmp_path)
    assert scene.names == ("far",)
    assert scene.groups == ()
    assert scene.absent is None


def test_levels_within_a_level_are_absent_with_it(tmp_path):
    gltf, ids = level_file("far")
    below = gltf.node(root=False, mesh=0, name="nest")
    coarse = gltf.node(root=False, mesh=0, name="coarse nest")
    gltf.json["nodes"][ids["far"]]["children"] = [below]
    has_levels(gltf, below, [coarse])
    scene = load(gltf, tmp_path)
    assert scene.names == ("tree", "leaf", "far", "nest", "coarse nest", "lamp")
    assert {group.name: group.levels for group in scene.groups} == {
        "tree": ((0, 1), (2, 3, 4)),
        "nest": ((3,), (4,)),
    }
    assert scene.absent.tolist() == [False, False, True, True, True, False]


def test_an_instanced_finest_level_makes_one_group(tmp_path):
    gltf, ids = level_file("far")
    places = gltf.accessor(np.eye(3, dtype="f4"))
    instancing = {"attributes": {"TRANSLATION": places}}
    gltf.json["nodes"][ids["tree"]]["extensions"]["EXT_mesh_gpu_instancing"] = instancing
    (group,) = load(gltf, tmp_path).groups
    assert group.levels == ((0, 1, 2, 3), (4,))


def present(scene: Scene, levels: dict[str, int], time: float | None = None) -> list[str]:
    """The names of what is there in a frame."""
    camera = Camera(look_at((0, 0, 9), (0, 0, 0)), 8, 8, near=0.1, ymag=1.0)
    posed = Timeline(scene, CameraPath([Frame((camera,), time, levels=levels)])).at(0)
    there = np.ones(len(scene.names)) if posed.absent is None else ~posed.absent
    drawn = np.diff(posed.object_offsets) > 0
    corners = posed.vertices[posed.triangles]
    whole = (corners != corners[:, :1]).any(axis=(1, 2))
    assert whole.tolist() == posed.present.tolist() == (there & drawn).tolist()
    return [name for name, is_there in zip(scene.names, there, strict=True) if is_there]


def test_a_frame_chooses_a_level_and_one_within_stands_or_falls_with_it(tmp_path):
    gltf, ids = level_file("far")
    nest, coarse = (gltf.node(root=False, mesh=0, name=name) for name in ("nest", "coarse"))
    gltf.json["nodes"][ids["far"]]["children"] = [nest]
    has_levels(gltf, nest, [coarse])
    scene = load(gltf, tmp_path)
    assert present(scene, {}) == ["tree", "leaf", "lamp"]
    assert present(scene, {"tree": 1}) == ["far", "nest", "lamp"]
    assert present(scene, {"tree": 1, "nest": 1}) == ["far", "coarse", "lamp"]
    assert present(scene, {"nest": 1}) == ["tree", "leaf", "lamp"]


def test_a_level_that_moves_is_absent_all_the_same_and_one_switched_off_stays_off(tmp_path):
    gltf, ids = level_file("far")
    animate(gltf, ids["house"], "translation", [0, 1], [[0, 0, 0], [1.0, 0, 0]])
    animate(gltf, f"/nodes/{ids['leaf']}", VISIBLE, [0, 1], np.array([1, 0], "u1"), "STEP")
    animate(gltf, f"/nodes/{ids['far']}", VISIBLE, [0, 1], np.array([1, 0], "u1"), "STEP")
    scene = load(gltf, tmp_path)
    assert present(scene, {}, 0.5) == ["tree", "leaf", "lamp"]
    assert present(scene, {}, 1.0) == ["tree", "lamp"]
    assert present(scene, {"tree": 1}, 0.5) == ["far", "lamp"]
    assert present(scene, {"tree": 1}, 1.0) == ["lamp"]


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda nodes, ids: nodes[ids["tree"]]["extensions"]["MSFT_lod"]["ids"].append(99), "99"),
        (
            lambda nodes, ids: nodes[ids["tree"]]["extensions"]["MSFT_lod"]["ids"].append(
                ids["tree"]
            ),
            "of itself",
        ),
        (
            lambda nodes, ids: nodes[ids["lamp"]].update(
                extensions={"MSFT_lod": {"ids": [ids["far"]]}}
            ),
            "already",
        ),
        (
            lambda nodes, ids: nodes[ids["far"]].update(
                extensions={"MSFT_lod": {"ids": [ids["near"]]}}
            ),
            "already",
        ),
        (lambda nodes, ids: nodes[ids["leaf"]].update(children=[ids["far"]]), "stands in"),
        (
            lambda nodes, ids: nodes[ids["leaf"]].update(
                extensions={"MSFT_lod": {"ids": [ids["house"]]}}
            ),
            "cycle",
        ),
        (lambda nodes, ids: nodes[ids["tree"]].update(extensions={"MSFT_lod": {}}), "missing"),
    ],
)
def test_levels_that_cannot_be_are_refused_in_a_line_with_their_place(tmp_path, spoil, says):
    gltf, ids = level_file("far", "near")
    spoil(gltf.json["nodes"], ids)
    with pytest.raises(InputError) as caught:
        load(gltf, tmp_path)
    line = str(caught.value)
    assert says in line
    assert "nodes[" in line
    assert "\n" not in line


def test_a_level_with_levels_of_its_own_is_refused(tmp_path):
    gltf, ids = level_file("far")
    other = gltf.node(root=False, mesh=0)
    has_levels(gltf, ids["far"], [other])
    with pytest.raises(InputError, match="levels of its own"):
        load(gltf, tmp_path)


def test_a_level_that_is_a_root_of_the_scene_and_stands_below_another_node_is_refused(tmp_path):
    gltf, ids = level_file("far")
    gltf.json["scenes"][0]["nodes"].append(ids["far"])
    with pytest.raises(InputError, match="root of the scene"):
        load(gltf, tmp_path)
