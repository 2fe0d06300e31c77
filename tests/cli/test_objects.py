"""visref objects: each object with its size, bounds, glTF node, path and groups."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.support.gltf_files import SQUARE, TRIANGLE, TWO, Gltf
from visref.cli.main import main


@pytest.fixture
def scene(tmp_path):
    """Nodes: 0 a room at (5, 0, 0), 1 a lamp in it, 2 an empty, 3 two instances of a tile, 4 points
    alone."""
    gltf = Gltf()
    lamp = gltf.mesh(gltf.primitive(TRIANGLE, np.arange(3, dtype="u2")))
    tile = gltf.mesh(gltf.primitive(SQUARE, TWO))
    gltf.node(name="room", translation=[5, 0, 0], children=[1])
    gltf.node(root=False, name="lamp", mesh=lamp, translation=[0, 2, 0])
    gltf.node(name="empty")
    places = gltf.accessor(np.array([[0, 0, 0], [0, 0, 3]], "f4"))
    instances = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
    gltf.node(name="tile", mesh=tile, extensions=instances)
    gltf.json["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    gltf.node(name="sparks", mesh=gltf.mesh(gltf.primitive(TRIANGLE, mode=0)))
    return str(gltf.write(tmp_path / "scene.glb"))


def test_for_programs_each_object_has_all_that_is_known_of_it(scene, capsys):
    assert main(["objects", scene, "--json"]) == 0
    lamp, first, second, sparks = json.loads(capsys.readouterr().out)
    assert lamp == {
        "id": 0, "name": "lamp", "path": "room/lamp", "node": 1, "triangles": 1,
        "bounds": [[5.0, 2.0, 0.0], [6.0, 3.0, 0.0]], "groups": [],
    }  # fmt: skip
    assert [(row["node"], row["triangles"], row["groups"]) for row in (first, second)] == [
        (3, 2, ["tile"]), (3, 2, ["tile"]),
    ]  # fmt: skip
    assert second["bounds"] == [[0.0, 0.0, 3.0], [1.0, 1.0, 3.0]]
    assert (sparks["node"], sparks["triangles"], sparks["bounds"]) == (4, 0, None)


def test_the_table_has_a_row_for_each_object_and_says_paths_and_groups(scene, capsys):
    assert main(["objects", scene]) == 0
    heading, lamp, first, _, sparks = capsys.readouterr().out.splitlines()
    assert heading.split() == [
        "id", "triangles", "node", "least", "corner", "greatest", "corner", "name",
    ]  # fmt: skip
    assert lamp.split() == ["0", "1", "1", "5", "2", "0", "6", "3", "0", "lamp", "(path",
                            "room/lamp)"]  # fmt: skip
    assert first.endswith("(in tile)")
    assert sparks.split() == ["3", "0", "4", "-", "-", "sparks"]


def test_bounds_far_out_are_those_of_the_world(tmp_path, capsys):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE, np.arange(3, dtype="u2")))
    gltf.node(name="part", mesh=mesh, translation=[6e6, -4e6, 0])
    assert main(["objects", str(gltf.write(tmp_path / "far.glb")), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["bounds"] == [[6e6, -4e6, 0.0], [6e6 + 1, -4e6 + 1, 0.0]]


def test_a_file_that_has_no_nodes_has_none_to_name(tmp_path, capsys):
    file = tmp_path / "one.obj"
    file.write_text("o wall\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert main(["objects", str(file), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["name"], row["node"], row["path"]) == ("wall", None, "wall")
    assert main(["objects", str(file)]) == 0
    assert capsys.readouterr().out.splitlines()[1].split()[:3] == ["0", "1", "-"]
