"""`terrain_towers`: deterministic, of the size it promises, and with shadows to clamp."""

from __future__ import annotations

import numpy as np
import pytest

from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.visibility import objects_seen
from visref_datasets_gen import scene_of
from visref_datasets_gen.glb import glb_bytes
from visref_datasets_gen.terrain_towers import WALK, terrain_towers


def kinds(scene):
    return np.array([name.split("-")[0] for name in scene.names])


def test_scale_1_is_about_115000_triangles_in_900_objects():
    scene = scene_of(terrain_towers())
    assert scene.triangle_count == pytest.approx(115_000, rel=0.05)
    assert scene.object_count == pytest.approx(900, rel=0.05)
    a, b, c = scene.vertices.astype(np.float64)[scene.triangles].transpose(1, 0, 2)
    assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0.0).all()


def test_it_grows_with_its_scale():
    small, large = (scene_of(terrain_towers(scale=scale)) for scale in (0.25, 1.0))
    assert 3.0 < large.triangle_count / small.triangle_count < 5.0


def test_same_seed_same_bytes_and_another_seed_others():
    made = [terrain_towers(seed=seed, scale=0.05, frames=3) for seed in (5, 5, 6)]
    files = [glb_bytes(dataset.nodes) for dataset in made]
    assert files[0] == files[1] != files[2]
    assert made[0].path.to_json() == made[1].path.to_json()


def test_walk_meets_no_tower_and_sees_towers_but_few_of_the_birds():
    dataset = terrain_towers(frames=12)
    scene = scene_of(dataset)
    kind, boxes, engine = kinds(scene), scene.object_bounds, EmbreeEngine(scene)
    for camera in dataset.path:
        gap = np.maximum(np.maximum(boxes[:, 0] - camera.eye, camera.eye - boxes[:, 1]), 0.0)
        assert np.linalg.norm(gap[kind != "ground"], axis=1).min() > camera.near
        assert camera.eye[1] > WALK.eye_m - 5.0
        seen = objects_seen(engine.frame(camera), scene).visible
        assert seen[kind == "tower"].any()
        assert seen[kind == "bird"].mean() < 0.1
        assert (camera.width, camera.height) == (640, 480)


@pytest.mark.parametrize(
    ("settings", "line"), [({"scale": 0.0}, "scale"), ({"frames": 0}, "frames")]
)
def test_nothing_to_make_is_one_clear_line(settings, line):
    with pytest.raises(InputError, match=line):
        terrain_towers(**settings)
