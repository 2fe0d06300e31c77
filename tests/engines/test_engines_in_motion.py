"""Engines follow a scene from moment to moment: what they say of one is what an engine says that
was made of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.support.exact_scenes import random_case
from tests.support.motion import moments, with_own_vertices
from tests.support.truth_scenes import brute_force, random_soup
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import RasterTolerance
from visref.engines import embree
from visref.engines.base import TruthEngine
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.engines.open3d import Open3DEngine
from visref.engines.recalled import RecalledTruths
from visref.exact import ExactScene, surviving, witness_margins
from visref.scene import Alpha, Scene
from visref.visibility import FrameTruth

Make = Callable[..., TruthEngine]


@pytest.fixture(params=["packets", "single rays", "open3d", "exact"])
def make(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Make:
    """An engine of each kind; "single rays" is Embree without its bundled library."""
    if request.param == "exact":
        return ExactEngine
    if request.param == "open3d":
        pytest.importorskip("open3d")
        return Open3DEngine
    if request.param == "single rays":
        monkeypatch.setattr(embree, "load_library", lambda: None)
    elif embree.load_library() is None:
        pytest.skip("this embreex brings no library with packets of eight rays")
    return EmbreeEngine


def contents(truth: FrameTruth) -> list[bytes]:
    arrays = [truth.buffer.triangle, truth.buffer.depth, truth.ties.sample, truth.ties.triangle]
    arrays += [getattr(truth.doubt, n) for n in ("sample", "offsets", "triangle")]
    arrays += [getattr(truth.blend, n) for n in ("object", "sample", "triangle", "depth")]
    return [array.tobytes() for array in (*arrays, truth.veiled)]


def view(seed: int, width: int = 48, height: int = 36, at: float = 0.0) -> Camera:
    rng = np.random.default_rng(seed)
    eye, target = rng.uniform(-1, 1, 3) + at, rng.uniform((-1, -1, -6), (1, 1, -4)) + at
    if seed % 3:
        return Camera(look_at(eye, target), width, height, 0.5, 9.0, yfov=1.2)
    return Camera(look_at(eye, target), width, height, -1.0, 9.0, ymag=3.0)


def mixed(seed: int, triangles: int = 120, at: float = 0.0) -> Scene:
    """Opaque, masked, blended and one-sided triangles, some of them twice."""
    soup = random_soup(seed, triangles=triangles, at=at)
    rng = np.random.default_rng(seed)
    twice = Scene(
        np.concatenate([soup.vertices] * 2),
        np.concatenate([soup.triangles, soup.triangles + len(soup.vertices)]),
        np.concatenate([soup.object_offsets, triangles + soup.object_offsets[1:]]),
        tuple(f"object {i}" for i in range(2 * soup.object_count)),
        one_sided=rng.random(2 * triangles) < 0.3,
        alpha=rng.choice(np.array([0, 0, 0, 1, 2], np.uint8), 2 * triangles),
    )
    return twice


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_posed_engine_is_one_made_of_the_pose(make: Make, seed: int, share: float) -> None:
    scenes = moments(mixed(seed), seed, 5, share=share)
    engine = make(scenes[0])
    for scene in [*scenes[1:], scenes[0]]:
        engine.pose(scene)
        fresh = make(scene)
        for camera in (view(seed), view(seed + 1)):
            assert contents(engine.frame(camera)) == contents(fresh.frame(camera))
        fresh.close()
    engine.close()


@pytest.mark.parametrize("seed", range(3))
def test_what_moves_apart_is_seen_as_if_it_stood_still(make: Make, seed: int) -> None:
    """Against an engine that knows of no motion. Duplicates at one distance are left out: of
    these a ray library names one or the other."""
    soup = random_soup(seed, triangles=300)
    scenes = moments(soup, seed, 4, share=0.4)
    engine, differ, owned = make(scenes[0]), 0, 0
    for scene in scenes[1:]:
        engine.pose(scene)
        plain = make(replace(scene, moving=None))
        camera = view(seed, 160, 120)
        ours, theirs = engine.frame(camera).copy(), plain.frame(camera)
        same = ours.buffer.triangle == theirs.buffer.triangle
        np.testing.assert_array_equal(ours.buffer.depth[same], theirs.buffer.depth[same])
        differ += np.count_nonzero(~same)
        owned += np.count_nonzero(theirs.buffer.triangle >= 0)
    # Crossings within float32's rounding; exact arithmetic knows of none.
    assert differ <= (0 if engine.exact else 4) < owned / 1000


def test_of_two_at_one_distance_the_lesser_id_owns_whichever_moves(make: Make) -> None:
    wall = np.array([[-9, -9, -4], [9, -9, -4], [0, 9, -4]], float)
    for moving in ([True, False], [False, True]):
        still = Scene.from_objects([(name, wall, np.array([[0, 1, 2]])) for name in "ab"])
        scene = replace(still, moving=np.array(moving))
        engine = make(scene)
        engine.pose(replace(scene, absent=np.zeros(2, np.bool_)))
        assert (engine.frame(view(1)).buffer.triangle[8:-8, 8:-8] == 0).any()
        assert not (engine.frame(view(1)).buffer.triangle == 1).any()
