"""Names in recordings: plain ones mean what they say, and no other is guessed at."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.support.gltf_files import TRIANGLE, Gltf
from tests.support.hand_made import judged, soup, still_path, truth
from visref.errors import InputError
from visref.formats import load_scene
from visref.recordings.gathering import grouped_units
from visref.recordings.names import Names
from visref.recordings.visible_sets import read_visible_sets
from visref.scene import Group, Scene

# 0 house/kitchen/chair, 1 house/hall/chair, 2 house/hall/lamp, 3 chair, 4 tree,
# 5-7 the instances of garden/grass, 8-9 those of garden/tree, 10 house (mesh of a nameless node)


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Scene:
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE))

    def leaf(name: str | None = None, count: int = 0) -> int:
        more = {} if name is None else {"name": name}
        if count:
            places = gltf.accessor(np.arange(3 * count, dtype="f4").reshape(-1, 3))
            instancing = {"attributes": {"TRANSLATION": places}}
            more["extensions"] = {"EXT_mesh_gpu_instancing": instancing}
        return gltf.node(root=False, mesh=mesh, **more)

    def group(name: str | None, *children: int, root: bool = False) -> int:
        more = {} if name is None else {"name": name}
        return gltf.node(root=root, children=list(children), **more)

    kitchen, hall = group("kitchen", leaf("chair")), group("hall", leaf("chair"), leaf("lamp"))
    group("house", kitchen, group(None, hall), root=True)
    gltf.json["scenes"][0]["nodes"] += [leaf("chair"), leaf("tree")]
    group("garden", leaf("grass", 3), leaf("tree", 2), root=True)
    group("house", group(None, leaf()), root=True)
    return load_scene(gltf.write(tmp_path_factory.mktemp("names") / "scene.glb"))


def test_objects_know_their_names_and_paths_and_instanced_nodes_are_groups(scene):
    assert scene.given_names == (
        *("chair", "chair", "lamp", "chair", "tree"),
        *("grass", "grass", "grass", "tree", "tree", "house"),
    )
    assert scene.names == (
        *("chair", "chair#2", "lamp", "chair#3", "tree"),
        *("grass", "grass#2", "grass#3", "tree#2", "tree#3", "house"),
    )
    assert scene.paths == (
        *("house/kitchen/chair", "house/hall/chair", "house/hall/lamp", "chair", "tree"),
        *("garden/grass",) * 3,
        *("garden/tree",) * 2,
        "house",
    )
    assert scene.groups == (
        Group("grass", "garden/grass", (5, 6, 7)),
        Group("tree", "garden/tree", (8, 9)),
    )


@pytest.mark.parametrize(
    ("name", "meanings"),
    [
        ("lamp", [(2,)]),
        ("house/hall/lamp", [(2,)]),
        ("/house/hall/lamp", [(2,)]),
        ("chair", [(0,), (1,), (3,)]),
        ("/chair", [(3,)]),
        ("house/hall/chair", [(1,)]),
        ("chair#2", [(1,)]),
        ("grass", [(5, 6, 7)]),
        ("garden/grass", [(5, 6, 7)]),
        ("/garden/grass", [(5, 6, 7)]),
        ("group:grass", [(5, 6, 7)]),
        ("grass#2", [(6,)]),
        ("tree", [(4,)]),
        ("group:tree", [(8, 9)]),
        ("garden/tree", [(8, 9)]),
        ("house", [(10,)]),
        ("hall", []),
        ("group:lamp", []),
        ("/lamp", []),
        ("", []),
    ],
)
def test_a_name_means_what_it_says_or_several_things_or_none(scene, name, meanings):
    assert Names(scene).meanings(name) == meanings


def read(tmp_path, scene: Scene, *frames: list):
    file = tmp_path / "v.jsonl"
    rows = [{"frame": frame, "visible": visible} for frame, visible in enumerate(frames)]
    file.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return read_visible_sets(file, scene, range(len(rows)), still_path(len(rows)))


def test_a_group_draws_all_that_is_in_it(tmp_path, scene):
    drawn = read(tmp_path, scene, ["grass", "lamp", 8], ["group:tree", "house/kitchen/chair"])
    assert objects_drawn(drawn, scene, 0) == [2, 5, 6, 7, 8]
    assert objects_drawn(drawn, scene, 1) == [0, 8, 9]


def objects_drawn(recorded, scene: Scene, frame: int) -> list[int]:
    triangles = recorded.units.gather(recorded.frames[frame])
    return np.unique(scene.object_of_triangle[triangles]).tolist()


def test_a_group_is_one_unit_and_so_are_its_objects_where_they_are_named_alone(tmp_path, scene):
    drawn = read(tmp_path, scene, ["grass", "lamp"], ["grass", 8])
    # Three of the objects are in one group.
    assert drawn.units.count == scene.object_count - 2
    assert drawn.units.kind == "object or group"
    assert [len(ids) for ids in drawn.frames.values()] == [2, 2]
    alone = read(tmp_path, scene, ["grass", 5])
    assert (alone.units.count, len(alone.frames[0])) == (scene.object_count - 1, 2)
    plain = read(tmp_path, scene, [5, 6, 7])
    assert plain.units.are_objects(scene)
    assert plain.frames[0].tolist() == [5, 6, 7]


def test_a_group_is_superfluous_only_if_none_of_it_is_visible():
    scene = replace(soup([1, 1, 1]), groups=(Group("pair", "pair", (0, 1)),))
    units, unit_of = grouped_units(scene, [(0, 1)], np.zeros(3, np.bool_))
    for owner, hidden in ((0, False), (1, False), (2, True)):
        verdict = judged(scene, truth([[owner]]), units, [0, 1])
        assert (unit_of[3] in verdict.superfluous_units) == hidden


def test_an_ambiguous_name_is_an_error_that_lists_the_candidates(tmp_path, scene):
    with pytest.raises(InputError) as caught:
        read(tmp_path, scene, ["lamp"], ["chair"])
    line = str(caught.value)
    assert "v.jsonl: line 2: ambiguous is 'chair', which may be" in line
    assert "0 ('house/kitchen/chair'), 1 ('house/hall/chair'), 3 ('/chair')" in line


def test_objects_of_one_name_at_the_root_are_told_apart_by_id_and_mark(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE))
    for x in range(3):
        gltf.node(mesh=mesh, name="Chair", translation=[x, 0, 0])
    chairs = load_scene(gltf.write(tmp_path / "scene.glb"))
    for given in ("Chair", "/Chair"):
        with pytest.raises(InputError, match=r"may be 0, 1 \('Chair#2'\), 2 \('Chair#3'\); give"):
            read(tmp_path, chairs, [given])
    drawn = read(tmp_path, chairs, [0, "Chair#2", "Chair#3"])
    assert drawn.frames[0].tolist() == [0, 1, 2]


def test_two_groups_of_one_name_are_ambiguous_but_for_their_paths():
    triangle = np.zeros((3, 3), np.float32)
    parts = [(name, triangle, [[0, 1, 2]]) for name in "aabb"]
    base = Scene.from_objects(parts)
    groups = (Group("bush", "east/bush", (0, 1)), Group("bush", "west/bush", (2, 3)))
    names = Names(
        Scene(base.vertices, base.triangles, base.object_offsets, base.names, groups=groups)
    )
    assert names.meanings("bush") == names.meanings("group:bush") == [(0, 1), (2, 3)]
    assert names.meanings("west/bush") == names.meanings("group:west/bush") == [(2, 3)]


def test_all_unknown_names_are_said_at_once(tmp_path, scene):
    with pytest.raises(InputError) as caught:
        read(tmp_path, scene, ["lamp", "lmap"], ["sofa", 1], ["sofa", *"abcdef"])
    line = str(caught.value)
    assert "v.jsonl: line 1: the scene has no object named 'lmap' and 7 others" in line
    assert "('sofa', 'a', 'b', 'c', …)" in line
    assert "did you mean 'lamp'?" in line


@pytest.mark.parametrize(
    ("name", "suggested"),
    [
        ("Lamp", "'lamp'"),
        ("house/hal/chair", "'house/hall/chair'"),
        ("gras", "'grass'"),
        ("garden/tre", "'garden/tree'"),
        ("sofa", None),
    ],
)
def test_what_is_suggested_can_be_written(tmp_path, scene, name, suggested):
    with pytest.raises(InputError) as caught:
        read(tmp_path, scene, [name])
    if suggested is None:
        assert "use the names of `visref objects`" in str(caught.value)
    else:
        assert f"did you mean {suggested}?" in str(caught.value)
        assert read(tmp_path, scene, [suggested.strip("'")]).frames[0].size


def test_a_near_name_that_is_ambiguous_is_not_suggested(tmp_path, scene):
    with pytest.raises(InputError, match="did you mean") as caught:
        read(tmp_path, scene, ["chairs"])
    assert "'chair'?" not in str(caught.value)


def test_paths_of_other_readers_go_down_from_the_root(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\no a\nf 1 2 3\no a\nf 1 2 3\n")
    scene = load_scene(tmp_path / "a.obj")
    assert (scene.given_names, scene.paths) == (("a", "a"), ("a", "a"))


def test_a_scene_in_memory_knows_the_names_it_was_given():
    triangle = np.zeros((3, 3), np.float32)
    scene = Scene.from_objects([("a", triangle, [[0, 1, 2]]), ("a", triangle, [[0, 1, 2]])])
    assert scene.names == ("a", "a#2")
    assert Names(scene).meanings("a") == [(0,), (1,)]
    with pytest.raises(InputError, match="not one per object"):
        Scene(scene.vertices, scene.triangles, scene.object_offsets, scene.names, paths=("a",))
