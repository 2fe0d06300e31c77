"""`old_town` and `deep_forest`: exact sizes, solid houses, walks that meet nothing and see few."""

from __future__ import annotations

import numpy as np
import pytest

from visref.effects.light import sun
from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.visibility import objects_seen
from visref_culling.shadow_volumes.casters import casters_of
from visref_datasets_gen import scene_of
from visref_datasets_gen.city_large import triangles_of
from visref_datasets_gen.deep_forest import deep_forest
from visref_datasets_gen.glb import glb_bytes
from visref_datasets_gen.old_town import CELL_M, STREET_M, old_town


def named(scene, word):
    """(n,) bool, the objects whose path has a part that begins so."""
    return np.array([any(p.startswith(word) for p in n.split("/")) for n in scene.names])


def gaps(boxes, eye):
    """(n,) metres from an eye to boxes, (n, 2, 3)."""
    away = np.maximum(np.maximum(boxes[:, 0] - eye, eye - boxes[:, 1]), 0.0)
    return np.linalg.norm(away, axis=1)


@pytest.mark.parametrize(
    ("make", "scale", "triangles"),
    [
        (old_town, 0.001, 34_034),
        (old_town, 0.0071, 241_643),
        (deep_forest, 0.02, 33_889),
        (deep_forest, 0.0511, 86_585),
    ],
)
def test_scene_of_any_scale_is_exact(make, scale, triangles):
    dataset = make(scale=scale, frames=2)
    assert sum(map(triangles_of, dataset.nodes)) == triangles
    assert scene_of(dataset).triangle_count == triangles


@pytest.mark.slow
def test_forest_is_1694426_triangles_a_tree_an_object():
    dataset = deep_forest(frames=20)
    scene = scene_of(dataset)
    assert scene.triangle_count == 1_694_426
    trees = ~named(scene, "ground") & ~named(scene, "meadow")
    assert 15_000 < trees.sum() < 18_000
    assert np.diff(scene.object_offsets)[trees].max() < 150
    for camera in dataset.path:
        assert gaps(scene.object_bounds[trees], camera.eye).min() > camera.near


@pytest.mark.slow
def test_town_is_34034176_triangles_of_which_only_meshes_are_kept():
    dataset = old_town(frames=2)
    assert sum(map(triangles_of, dataset.nodes)) == 34_034_176
    meshes = {id(node.mesh) for node in dataset.nodes if node.mesh is not None}
    assert len(meshes) < 10


def test_houses_are_solids_wall_to_wall():
    scene = scene_of(old_town(scale=0.001, frames=1))
    casters = casters_of(scene, sun((0.3, -1.0, 0.2), scene, 8))
    houses = named(scene, "house")
    assert casters.solid == np.diff(scene.object_offsets)[houses].sum() > 0.98 * casters.solid
    boxes = scene.object_bounds[houses].astype(np.float64)
    # Three to a block, each as far from the next as it is wide.
    middles = boxes.mean(axis=1).reshape(-1, 3, 3)[..., [0, 2]]
    assert np.allclose(np.linalg.norm(np.diff(middles, axis=1), axis=2), 8.0)


def test_blocks_cover_no_ground_twice_and_streets_are_open():
    scene = scene_of(old_town(scale=0.004, frames=1))
    boxes = scene.object_bounds[named(scene, "paving")].astype(np.float64)[..., [0, 2]]
    sides = np.sort(boxes[:, 1] - boxes[:, 0], axis=1)
    assert np.allclose(sides, [CELL_M, 2.0 * CELL_M])
    cells = set()
    for low, high in boxes / CELL_M:
        own = {(x, z) for x in np.arange(low[0], high[0] - 0.1).round() for z in
               np.arange(low[1], high[1] - 0.1).round()}  # fmt: skip
        assert len(own) == 2
        assert not own & cells
        cells |= own
    houses = scene.object_bounds[named(scene, "house")].astype(np.float64)
    for low, high in houses[:, :, [0, 2]]:
        # Half a street to every side of a block, and none of a house in it.
        middle = (low + high) / 2.0
        block = boxes[((boxes[:, 0] <= middle) & (middle <= boxes[:, 1])).all(axis=1)]
        assert len(block) == 1
        assert (low >= block[0, 0] + STREET_M / 2.0 - 1e-3).all()
        assert (high <= block[0, 1] - STREET_M / 2.0 + 1e-3).all()


@pytest.mark.parametrize(
    ("make", "scale", "things", "most"),
    [(old_town, 0.01, "house", 30), (deep_forest, 0.1, "ground", 80)],
)
def test_walk_meets_nothing_and_sees_few_of_the_things_around(make, scale, things, most):
    dataset = make(scale=scale, frames=8)
    scene = scene_of(dataset)
    engine = EmbreeEngine(scene)
    chosen = named(scene, things) if things == "house" else ~named(scene, things)
    for camera in dataset.path.resized(320, 240):
        assert gaps(scene.object_bounds[chosen], camera.eye).min() > camera.near
        seen = objects_seen(engine.frame(camera), scene).visible
        assert 2 <= seen[chosen].sum() < most


@pytest.mark.parametrize("make", [old_town, deep_forest])
def test_same_seed_same_bytes_and_another_seed_others(make):
    made = [make(seed=seed, scale=0.01, frames=3) for seed in (5, 5, 6)]
    files = [glb_bytes(dataset.nodes) for dataset in made]
    assert files[0] == files[1] != files[2]
    assert made[0].path.to_json() == made[1].path.to_json()


@pytest.mark.parametrize("make", [old_town, deep_forest])
@pytest.mark.parametrize(
    ("settings", "line"), [({"scale": 0.0}, "scale"), ({"scale": 1e-5}, "greater"),
                           ({"scale": 0.01, "frames": 0}, "frames")]
)  # fmt: skip
def test_nothing_to_make_is_one_clear_line(make, settings, line):
    with pytest.raises(InputError, match=line):
        make(**settings)
