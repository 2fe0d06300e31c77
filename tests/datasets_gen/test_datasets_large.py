"""The two scenes of the lazy grid's paper: exact sizes, instances, walks that meet nothing."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from visref.errors import InputError
from visref_datasets_gen import scene_of
from visref_datasets_gen.city_large import city_large, triangles_of
from visref_datasets_gen.forest import forest
from visref_datasets_gen.glb import glb_bytes
from visref_datasets_gen.terrain import patch

pytestmark = pytest.mark.slow


def slope(x, z):
    return 0.1 * x + 0.2 * z


@settings(max_examples=60, deadline=None, derandomize=True)
@given(triangles=st.integers(0, 400))
def test_patch_has_the_triangles_asked_and_covers_its_ground_once(triangles):
    points, faces = patch((1.0, 2.0), (5.0, 9.0), triangles, slope)
    assert len(faces) == triangles
    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal[:, 1] > 0.0).all()
    assert np.allclose(points[:, 1], slope(points[:, 0], points[:, 2]))
    if triangles > 1:
        assert 0.5 * normal[:, 1].sum() == pytest.approx(4.0 * 7.0)


def test_forest_is_1694426_triangles_a_tree_an_object():
    dataset = forest(frames=40)
    scene = scene_of(dataset)
    assert scene.triangle_count == 1_694_426
    sizes = np.diff(scene.object_offsets)
    trees = np.array([name.split("-")[0] not in ("ground", "meadow") for name in scene.names])
    assert trees.sum() > 4000
    assert sizes[trees].sum() > 0.99 * scene.triangle_count
    # Stored once a shape: the file is a small part of its triangles' 36 bytes.
    assert len(glb_bytes(dataset.nodes)) < 0.03 * 36 * scene.triangle_count
    # No tree within reach of the walk's near plane, and ground below every eye.
    boxes = scene.object_bounds[trees]
    for camera in dataset.path:
        gap = np.maximum(np.maximum(boxes[:, 0] - camera.eye, camera.eye - boxes[:, 1]), 0.0)
        assert np.linalg.norm(gap, axis=1).min() > camera.near


@pytest.mark.parametrize(("scale", "triangles"), [(0.02, 33_889), (0.0511, 86_585)])
def test_forest_of_any_scale_is_exact(scale, triangles):
    assert sum(map(triangles_of, forest(scale=scale, frames=2).nodes)) == triangles


@pytest.mark.parametrize(("scale", "triangles"), [(0.002, 68_068), (0.0071, 241_643)])
def test_large_city_of_any_scale_is_exact(scale, triangles):
    dataset = city_large(scale=scale, frames=4)
    assert sum(map(triangles_of, dataset.nodes)) == triangles
    assert scene_of(dataset).triangle_count == triangles


def test_large_city_is_instanced():
    dataset = city_large(scale=0.02, frames=2)
    assert len(glb_bytes(dataset.nodes)) < 0.2 * 36 * sum(map(triangles_of, dataset.nodes))


@pytest.mark.parametrize("make", [forest, city_large])
def test_same_seed_same_bytes_and_another_seed_others(make):
    made = [make(seed=seed, scale=0.02, frames=3) for seed in (5, 5, 6)]
    files = [glb_bytes(dataset.nodes) for dataset in made]
    assert files[0] == files[1] != files[2]
    assert made[0].path.to_json() == made[1].path.to_json()


@pytest.mark.parametrize("make", [forest, city_large])
@pytest.mark.parametrize(
    ("settings", "line"), [({"scale": 0.0}, "scale"), ({"scale": 1e-5}, "greater"),
                           ({"scale": 0.01, "frames": 0}, "frames")]
)  # fmt: skip
def test_nothing_to_make_is_one_clear_line(make, settings, line):
    with pytest.raises(InputError, match=line):
        make(**settings)
