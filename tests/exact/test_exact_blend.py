"""Blended and masked triangles mean the same to the exact engine and to rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.hand_made import camera, scene_of_squares
from visref.camera import Camera, look_at
from visref.engines import make_engine
from visref.scene import Alpha, Scene
from visref.visibility import objects_seen


def mixed_scene(seed: int) -> Scene:
    """Twenty objects of three scattered triangles, each opaque, masked or blended."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(60, 1, 3)) * 3 + rng.normal(size=(60, 3, 3))
    objects = [
        (f"t{i}", corners[3 * i : 3 * i + 3].reshape(-1, 3), np.arange(9).reshape(3, 3))
        for i in range(20)
    ]
    kinds = [Alpha.OPAQUE] * 3 + [Alpha.MASK] + [Alpha.BLEND] * 2
    return replace(Scene.from_objects(objects), alpha=rng.choice(kinds, 60).astype(np.uint8))


@pytest.mark.parametrize("seed", range(8))
def test_exact_and_rays_count_blended_objects_alike(seed):
    scene = mixed_scene(seed)
    view = Camera(look_at((0, 2, 12), (0, 0, 0)), 64, 48, 0.5, 30.0, yfov=0.9)
    exact = make_engine("exact", scene).frame(view).copy()
    rays = make_engine("embree", scene).frame(view)
    assert np.array_equal(exact.undecided, rays.undecided)
    assert np.array_equal(exact.blend.object, rays.blend.object)
    assert np.array_equal(exact.blend.sample, rays.blend.sample)
    assert np.array_equal(exact.blend.triangle, rays.blend.triangle)
    ours, theirs = objects_seen(exact, scene), objects_seen(rays, scene)
    assert np.array_equal(ours.samples, theirs.samples)
    assert np.allclose(ours.nearest, theirs.nearest, rtol=1e-12)


def with_alpha(scene: Scene, *kinds: Alpha) -> Scene:
    return replace(scene, alpha=np.repeat(np.array(kinds, np.uint8), 2))


def test_blended_object_behind_a_masked_one_is_undecided_not_visible():
    scene = with_alpha(scene_of_squares(0.0, -3.0), Alpha.MASK, Alpha.BLEND)
    truth = make_engine("exact", scene).frame(camera())
    assert len(truth.undecided) == camera().samples
    assert len(truth.blend.object) == 0


def test_object_blended_before_itself_counts_each_sample_once():
    scene = scene_of_squares(0.0, -3.0)
    one = Scene(
        scene.vertices, scene.triangles, np.array([0, 4]), ("both",), alpha=scene.alpha.copy()
    )
    one = with_alpha(one, Alpha.BLEND, Alpha.OPAQUE)
    seen = objects_seen(make_engine("exact", one).frame(camera()), one)
    assert seen.samples.tolist() == [camera().samples]


def test_the_witness_of_a_blended_object_is_its_nearest_hit():
    scene = scene_of_squares(0.0)
    tilted = scene.vertices.copy()
    tilted[:, 2] = tilted[:, 0]
    scene = with_alpha(replace(scene, vertices=tilted), Alpha.BLEND)
    truth = make_engine("exact", scene).frame(camera())
    seen = objects_seen(truth, scene)
    # The surface comes nearer to the right: z = x, so depth = 10 - x at the last column.
    assert seen.sample[0] % camera().width == camera().width - 1
    assert seen.depth[0] == seen.nearest[0] == 10.0 - 1.5


@pytest.mark.parametrize("engine", ["exact", "embree", "gl"])
def test_masked_triangles_that_may_be_seen_are_named(engine):
    scene = with_alpha(scene_of_squares(0.0, -3.0, -6.0), Alpha.MASK, Alpha.OPAQUE, Alpha.MASK)
    truth = make_engine(engine, scene).frame(camera())
    assert truth.undecided.tolist() == list(range(camera().samples))
    assert set(scene.object_of_triangle[truth.doubt.triangle].tolist()) == {0}
    assert set(scene.object_of_triangle[truth.buffer.triangle].reshape(-1).tolist()) == {1}


@pytest.mark.parametrize("engine", ["exact", "embree"])
def test_of_an_object_that_owns_a_sample_its_own_glass_there_is_kept_too(engine):
    scene = scene_of_squares(0.0, -3.0)
    one = Scene(
        scene.vertices,
        scene.triangles,
        np.array([0, 4]),
        ("window",),
        alpha=np.repeat(np.array([Alpha.BLEND, Alpha.OPAQUE], np.uint8), 2),
    )
    truth = make_engine(engine, one).frame(camera())
    assert np.unique(truth.blend.sample).tolist() == list(range(camera().samples))
    assert (truth.blend.triangle < 2).all()
    assert (truth.blend.depth == 10.0).all()


@pytest.mark.parametrize("engine", ["exact", "embree", "gl"])
def test_glass_before_all_that_a_mask_leaves_open_is_seen(engine):
    scene = with_alpha(scene_of_squares(0.0, -3.0, -6.0), Alpha.BLEND, Alpha.MASK, Alpha.OPAQUE)
    truth = make_engine(engine, scene).frame(camera())
    assert len(truth.doubt) == camera().samples
    assert np.unique(truth.blend.sample).tolist() == list(range(camera().samples))
    assert set(truth.blend.object.tolist()) == {0}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_exact_and_rays_leave_the_same_triangles_open(seed):
    scene = mixed_scene(seed)
    view = Camera(look_at((0, 2, 12), (0, 0, 0)), 64, 48, 0.5, 30.0, yfov=0.9)
    exact = make_engine("exact", scene).frame(view)
    rays = make_engine("embree", scene).frame(view)
    assert len(exact.doubt) > 0
    assert np.array_equal(exact.doubt.offsets, rays.doubt.offsets)
    assert np.array_equal(exact.doubt.triangle, rays.doubt.triangle)
