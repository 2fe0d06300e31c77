"""Whatever way the nodes of a glTF file are read, the scene is that of a plain walk over them; and
loading instances takes little more memory than the scene that it makes."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest

from benchmarks.scenes import write_instances
from tests.support.gltf_files import TRIANGLE, Gltf
from tests.support.plain_nodes import PlainWalk, marked, random_tree
from visref.engines.in_motion import local_vertices
from visref.errors import InputError
from visref.formats import load_scene
from visref.formats.place_kernels import place_vertices
from visref.formats.placed import transformed
from visref.frozen import Fresh, is_frozen


@pytest.mark.parametrize("seed", range(40))
def test_scene_is_that_of_a_plain_walk_over_the_nodes(seed, tmp_path):
    gltf = random_tree(seed)
    plain = PlainWalk(gltf)
    assert plain.objects
    scene = load_scene(gltf.write(tmp_path / "tree.glb"))
    drawn = plain.objects
    given = [one.name for one in drawn]
    assert scene.given_names == tuple(given)
    assert scene.names == tuple(marked(given))
    assert scene.paths == tuple(one.path for one in drawn)
    assert scene.nodes.tolist() == [one.node for one in drawn]
    assert [(g.name, g.path, g.objects) for g in scene.groups] == plain.groups
    counts = [len(one.triangles) for one in drawn]
    assert np.diff(scene.object_offsets).tolist() == counts
    base, triangles, exact = 0, [], []
    for one in drawn:
        faces = [[base + corner for corner in face] for face in one.triangles]
        triangles += [face[::-1] for face in faces] if one.mirrored else faces
        exact += one.vertices
        base += len(one.vertices)
    assert scene.triangles.tolist() == triangles
    relative = np.array(exact).reshape(-1, 3) - scene.origin
    assert scene.vertices.tobytes() == relative.astype(np.float32).tobytes()


def test_random_trees_hold_what_they_claim_to():
    entries = [node for seed in range(40) for node in random_tree(seed).json["nodes"]]
    for name in ("matrix", "rotation", "scale", "skin", "weights", "mesh", "children"):
        assert sum(name in entry for entry in entries) > 10
    for name in ("EXT_mesh_gpu_instancing", "KHR_node_visibility"):
        assert sum(name in entry.get("extensions", {}) for entry in entries) > 10
    assert any(type(c) is float for entry in entries for c in entry.get("children", []))
    assert sum(any(one.mirrored for one in PlainWalk(random_tree(s)).objects) for s in range(9)) > 4


@pytest.mark.parametrize(
    ("property_", "value", "problem"),
    [
        ("translation", [0, True, 0], r"nodes\[1\]\.translation\[1\].*not a number"),
        ("translation", [0, 0], r"nodes\[1\]\.translation.*not a list of 3 numbers"),
        ("scale", [1, "1", 1], r"nodes\[1\]\.scale\[1\].*not a number"),
        ("rotation", [0, 0, 0, 0], r"nodes\[1\]\.rotation.*zero or infinite length"),
        ("matrix", [1.0] * 16, r"nodes\[1\]\.matrix.*last row"),
        ("translation", None, r"nodes\[1\]\.translation.*not a list"),
        ("translation", [10**400, 0, 0], r"nodes\[1\]\.translation\[0\].*too large"),
        ("name", 7, r"nodes\[1\]\.name.*not a string"),
        ("mesh", 5, r"nodes\[1\]\.mesh.*meshes\[5\] is named"),
    ],
)
def test_wrong_node_among_many_is_named(property_, value, problem, tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE))
    for _ in range(4):
        gltf.node(mesh=mesh, translation=[1, 2, 3])
    gltf.json["nodes"][1][property_] = value
    with pytest.raises(InputError, match=problem):
        load_scene(gltf.write(tmp_path / "wrong.glb"))


def test_whole_numbers_of_any_size_are_those_numbers(tmp_path):
    scenes = []
    for number in (2**70, 2.0**70):
        gltf = Gltf()
        gltf.node(mesh=gltf.mesh(gltf.primitive(TRIANGLE)), translation=[number, 1.5, -3])
        scenes.append(load_scene(gltf.write(tmp_path / "whole.glb")))
    assert scenes[0].digest == scenes[1].digest


@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_compiled_placing_is_the_plain_one(dtype):
    """Vertices and how far rounding moved each, mirrored or not, with what overflows float32."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(50, 3)).astype(dtype)
    worlds = np.tile(np.eye(4), (9, 1, 1))
    worlds[:, :3] = rng.normal(size=(9, 3, 4)) * 10.0 ** rng.integers(-45, 39, (9, 1, 1))
    worlds[0] = np.eye(4)
    worlds[1, 0, 3] = 1e39
    origin = np.array([0.0, 1024.0, -8.0])
    with np.errstate(over="ignore", invalid="ignore"):
        vertices, far = transformed(worlds, points, origin)
    placed, moved = np.empty((450, 3), np.float32), np.empty(450, np.float32)
    users, starts = np.arange(9), 50 * np.arange(9)
    bits = moved.view(np.int32)
    exact = points.astype(np.float64)
    place_vertices(exact, worlds, users, starts, origin, placed, moved, bits)
    assert placed.tobytes() == vertices.tobytes()
    assert moved.tobytes() == far.tobytes()
    assert not np.isfinite(moved).all()


def test_loading_instances_takes_little_more_than_the_scene(tmp_path):
    """Before, arrays were held twice while they were frozen, and a float64 copy of a block."""
    load_scene(write_instances(tmp_path / "few.glb", 300))  # what is imported once
    file = write_instances(tmp_path / "many.glb", 1_000_000)
    tracemalloc.start()
    try:
        scene = load_scene(file)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    arrays = (scene.vertices, scene.moved, scene.triangles, scene.one_sided, scene.alpha)
    held = sum(array.nbytes for array in arrays)
    # Beyond: what the 3,333 objects take, and a flag for each coordinate while all are checked.
    assert peak < 1.3 * held


@pytest.mark.parametrize("rebase", [(0.0, 0.0, 0.0), (64.0, 0.0, -1e7), (0.1, 0.0, 0.0)])
@pytest.mark.parametrize("count", [0, 1, 255, 5000])
def test_vertices_of_an_engine_are_moved_and_scaled_as_if_at_once(rebase, count):
    rng = np.random.default_rng(count)
    vertices = (rng.integers(-4000, 4000, (count, 3)) / 64).astype(np.float32)
    local, scale, exact = local_vertices(vertices, np.array(rebase))
    moved = vertices.astype(np.float64) - np.array(rebase)
    reach = float(np.abs(moved).max(initial=0.0))
    assert scale == (2.0 ** -math.frexp(reach)[1] if reach else 1.0)
    assert local.tobytes() == (moved * scale).astype(np.float32).tobytes()
    kept = np.array_equal(moved + np.array(rebase), vertices)
    assert exact == (kept and np.array_equal(local, moved * scale))


@pytest.mark.parametrize("shape", [(0, 3), (1,), (1000, 3)])
def test_fresh_memory_is_frozen_without_a_copy(shape):
    fresh = Fresh(shape, np.float32)
    fresh.array[...] = 7.0
    at = fresh.array.ctypes.data
    done = fresh.frozen()
    assert is_frozen(done)
    assert done.ctypes.data == at
    assert done.shape == shape
    assert (done == 7.0).all()
    assert not hasattr(fresh, "array")
    with pytest.raises(ValueError, match="cannot set WRITEABLE"):
        done.flags.writeable = True
