"""Engines follow a scene from moment to moment: what they say of one is what an engine says that
was made of it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.engine_kinds import engine_kind
from tests.support.exact_scenes import random_case
from tests.support.motion import moments, with_own_vertices
from tests.support.shares import examples, share
from tests.support.strategies import cases
from tests.support.truth_scenes import box as solid_box
from tests.support.truth_scenes import brute_force, random_soup
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.conformance.suite import built_case
from visref.culler import RasterTolerance
from visref.engines.base import TruthEngine
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.engines.rays import RayEngine
from visref.engines.recalled import RecalledTruths
from visref.errors import InputError
from visref.exact import ExactScene, surviving, witness_margins
from visref.scene import Scene
from visref.visibility import BACKGROUND, FrameTruth

Make = Callable[..., TruthEngine]


@pytest.fixture(params=["packets", "single rays", "open3d", "exact"])
def make(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Make:
    """An engine of each kind; "single rays" is Embree without its bundled library."""
    return engine_kind(request.param, monkeypatch)


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
    return Scene(
        np.concatenate([soup.vertices] * 2),
        np.concatenate([soup.triangles, soup.triangles + len(soup.vertices)]),
        np.concatenate([soup.object_offsets, triangles + soup.object_offsets[1:]]),
        tuple(f"object {i}" for i in range(2 * soup.object_count)),
        one_sided=rng.random(2 * triangles) < 0.3,
        alpha=rng.choice(np.array([0, 0, 0, 1, 2], np.uint8), 2 * triangles),
    )


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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_posed_embree_is_right_wherever_float32_can_tell(make: Make, seed: int) -> None:
    scenes = moments(random_soup(seed), seed, 3)
    engine = make(scenes[0])
    for scene in scenes[1:]:
        engine.pose(scene)
        camera = view(seed)
        reference = brute_force(scene, camera)
        wrong = engine.frame(camera).buffer.triangle != reference.owner
        assert not (wrong & ~reference.doubtful).any()
        assert reference.doubtful.mean() < 0.02
        assert len(np.unique(reference.owner)) > 5


@pytest.mark.parametrize("name", ["through_the_holes_of_a_mask", "glass", "one_sided_walls"])
def test_masks_and_glass_move_with_their_objects(make: Make, name: str) -> None:
    built, _ = built_case(name, 0)
    scenes = moments(built.scene, 1, 4, share=0.7, size=0.3)
    engine = make(scenes[0])
    before: set[tuple[bytes, ...]] = set()
    for scene in scenes[1:]:
        engine.pose(scene)
        fresh = make(scene)
        for camera in built.path:
            found = contents(engine.frame(camera))
            assert found == contents(fresh.frame(camera))
            before.add(tuple(found))
    assert len(before) > 2


@pytest.mark.slow
@pytest.mark.parametrize("threads", [2, 7])
def test_any_number_of_threads_gives_the_same_bytes_in_motion(make: Make, threads: int) -> None:
    scenes = moments(mixed(3, triangles=600), 3, 4)
    one, many = make(scenes[0], threads=1), make(scenes[0], threads=threads)
    for scene in scenes:
        for engine in (one, many):
            engine.pose(scene)
        camera = view(4, 160, 120)
        assert contents(one.frame(camera)) == contents(many.frame(camera))
    one.close()
    many.close()


@pytest.mark.slow
def test_duplicates_that_move_are_told_apart_alike_each_time(make: Make) -> None:
    """A library that builds on all cores may put them in any order."""
    soup = random_soup(5, triangles=3000)
    twice = Scene(
        np.concatenate([soup.vertices] * 2),
        np.concatenate([soup.triangles, soup.triangles + len(soup.vertices)]),
        np.concatenate([soup.object_offsets, 3000 + soup.object_offsets[1:]]),
        tuple(f"object {i}" for i in range(2 * soup.object_count)),
    )
    scene = replace(twice, moving=np.ones(twice.object_count, np.bool_))
    engine, camera = make(scene), view(4, 160, 120)
    first = contents(engine.frame(camera))
    for _ in range(5):
        engine.pose(scene)
        assert contents(engine.frame(camera)) == first


def test_a_scene_of_which_nothing_is_there_is_background(make: Make) -> None:
    soup = random_soup(1)
    every = np.ones(soup.object_count, np.bool_)
    scene = replace(soup, moving=every)
    engine, camera = make(scene), view(1)
    shown = contents(engine.frame(camera))
    engine.pose(replace(scene, absent=every))
    truth = engine.frame(camera)
    assert (truth.buffer.triangle == BACKGROUND).all()
    assert np.isinf(truth.buffer.depth).all()
    engine.pose(scene)
    assert contents(engine.frame(camera)) == shown
    # So made, too.
    engine = make(replace(scene, absent=every))
    assert (engine.frame(camera).buffer.triangle == BACKGROUND).all()
    engine.pose(scene)
    assert contents(engine.frame(camera)) == shown


def test_an_object_that_is_absent_and_never_moves_is_not_there(make: Make) -> None:
    soup = random_soup(2)
    absent = np.arange(soup.object_count) % 3 == 0
    scene = replace(soup, absent=absent)
    owners = np.unique(make(scene).frame(view(1)).buffer.triangle)
    owners = scene.object_of_triangle[owners[owners >= 0]]
    assert len(owners)
    assert not absent[owners].any()


@pytest.mark.parametrize("far", [2.0**17, 2.0**20])
def test_far_out_a_pose_is_seen_as_sharply_as_a_scene_made_there(make: Make, far: float) -> None:
    scenes = moments(random_soup(7, triangles=120, at=far), 7, 4, size=3.0)
    engine = make(scenes[0])
    for scene in scenes[1:]:
        engine.pose(scene)
        fresh = make(scene)
        camera = view(4, at=far)
        assert contents(engine.frame(camera)) == contents(fresh.frame(camera))
        if isinstance(engine, RayEngine) and isinstance(fresh, RayEngine):
            np.testing.assert_array_equal(engine.rebase, fresh.rebase)
            assert engine.rebase.any()
    assert len(np.unique(engine.frame(view(4, at=far)).buffer.triangle)) > 5


def beside(way: float, scale: float = 1.0) -> Scene:
    """Many still things about the origin, and one that has moved by `way` and grown."""
    soup = random_soup(8)
    moving = np.zeros(soup.object_count, np.bool_)
    moving[0] = True
    vertices = soup.vertices.copy()
    rows = np.unique(soup.triangles[soup.object_of_triangle == 0])
    vertices[rows] = vertices[rows] * np.float32(scale) + np.float32(way)
    return replace(soup, vertices=vertices, moving=moving)


@pytest.mark.parametrize("way", [2.0**10, 2.0**40, 2.0**80])
def test_what_flies_far_off_is_seen_and_the_rest_stays_as_it_was(make: Make, way: float) -> None:
    """Within what one scale holds, and beyond."""
    scene, there = beside(0.0), beside(way, way)
    engine, camera = make(scene), view(4)
    shown = contents(engine.frame(camera))
    away = Camera(look_at((way, way, way * 4.0), (way,) * 3), 48, 36, way / 64, yfov=2.5)
    try:
        engine.pose(there)
    except InputError as error:
        # One float32 scene does not hold both: it says so, and so it does when made so.
        assert way > 2.0**20
        with pytest.raises(InputError, match=re.escape(str(error)[:40])):
            make(there)
    else:
        fresh = make(there)
        for each in (away, camera):
            assert contents(engine.frame(each)) == contents(fresh.frame(each))
        assert (engine.frame(away).buffer.triangle >= 0).any()
    engine.pose(scene)
    assert contents(engine.frame(camera)) == shown


FACES = solid_box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)).faces


def box(x: float) -> np.ndarray:
    return solid_box((x, 0.0, 0.0), (1.0, 1.0, 1.0)).points


def test_a_pose_that_is_rounded_is_said_and_stays_said(make: Make) -> None:
    objects = [(f"far {i}", box(1e6 + 3 * i), FACES) for i in range(20)]
    still = Scene.from_objects([*objects, ("near", box(1e6), FACES)])
    moving = np.arange(21) == 20
    exact = replace(still, moving=moving)
    engine = make(exact)
    if not isinstance(engine, RayEngine):
        return
    assert engine.rebase.any()
    assert engine.rebase_exact
    vertices = still.vertices.copy()
    vertices[-len(box(0.0)) :] = box(0.1)
    engine.pose(replace(exact, vertices=vertices))
    assert not engine.rebase_exact
    engine.pose(exact)
    assert not engine.rebase_exact


def test_points_and_rays_of_ones_own_follow_the_pose(make: Make) -> None:
    scenes = moments(random_soup(4, triangles=150), 4, 3)
    engine = make(scenes[0])
    if not isinstance(engine, RayEngine):
        return
    rng, camera = np.random.default_rng(4), view(4)
    a, b = rng.uniform(-40, 40, (2, 500))
    origins, directions = rng.uniform(-2, 2, (500, 3)), rng.normal(size=(500, 3))
    seen = set()
    for scene in scenes:
        engine.pose(scene)
        fresh = make(scene)
        assert isinstance(fresh, RayEngine)
        probed = engine.probe(camera, a, b)
        np.testing.assert_array_equal(probed, fresh.probe(camera, a, b))
        along = engine.along(origins, directions)
        np.testing.assert_array_equal(along, fresh.along(origins, directions))
        (wrong, asked), other = engine.known_wrong(camera), fresh.known_wrong(camera)
        assert len(wrong) == len(other[0]) == 0 < asked == other[1]
        seen.add((probed.tobytes(), along.tobytes()))
    assert len(seen) == 3


def test_other_objects_than_at_first_cannot_be_posed(make: Make) -> None:
    soup = random_soup(1)
    some = np.arange(soup.object_count) < 2
    for made, posed in ((None, some), (some, None), (some, ~some)):
        engine = make(replace(soup, moving=made))
        with pytest.raises(ValueError, match="other objects move"):
            engine.pose(replace(soup, moving=posed))


@pytest.mark.slow
@settings(max_examples=examples(60), deadline=None)
@given(case=cases(), seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.2, 0.6, 1.0]))
def test_on_a_grid_of_ties_a_posed_engine_is_one_made_of_the_pose(case, seed, share) -> None:
    scenes = moments(case.scene, seed, 3, share=share)
    for kind in (EmbreeEngine, ExactEngine):
        engine = kind(scenes[0])
        for scene in scenes[1:]:
            engine.pose(scene)
            fresh = kind(scene)
            for camera in case.path:
                assert contents(engine.frame(camera)) == contents(fresh.frame(camera))


@pytest.mark.parametrize(
    "seed",
    [*range(12), *(pytest.param(n, marks=pytest.mark.slow) for n in share(range(12, 60), 0))],
)
def test_posed_arithmetic_is_fresh_arithmetic_bit_for_bit(seed: int) -> None:
    """Against one made of the moment, and against one that knows of no motion."""
    scene, camera = random_case(77, seed)
    rng = np.random.default_rng(seed)
    scenes = moments(with_own_vertices(scene), seed, 4, share=0.5)
    posed = ExactScene(scenes[0], threads=1)
    samples = rng.integers(0, camera.samples, 40)
    for now in scenes[1:]:
        posed.pose(now)
        fresh, plain = ExactScene(now, threads=2), ExactScene(replace(now, moving=None))
        include = rng.random(now.triangle_count) < 0.7
        for asked in (None, include):
            ours = posed.decide(camera, samples, include=asked)
            for other in (fresh, plain):
                theirs = other.decide(camera, samples, include=asked)
                for name in ("offsets", "triangles", "depth"):
                    np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
            assert ours.rational == fresh.decide(camera, samples, include=asked).rational
        ours = posed.certify(camera)
        assert contents(ours) == contents(fresh.certify(camera)) == contents(plain.certify(camera))
        owner = ours.buffer.triangle.reshape(-1)
        at = np.flatnonzero(owner >= 0)
        objects = now.object_of_triangle[owner[at]].astype(np.int64)
        for other in (fresh, plain):
            for mine, other_s in zip(
                witness_margins(posed, camera, at, objects),
                witness_margins(other, camera, at, objects),
                strict=True,
            ):
                np.testing.assert_array_equal(mine, other_s)
            tolerance = RasterTolerance(2.0**-8, 24)
            np.testing.assert_array_equal(
                surviving(posed, camera, at, objects, tolerance),
                surviving(other, camera, at, objects, tolerance),
            )
        mine, other_s = posed.hits(camera, include), fresh.hits(camera, include)
        for one, two in zip(mine, other_s, strict=True):
            np.testing.assert_array_equal(one, two)


def test_walls_in_one_plane_stay_in_it_when_another_joins_and_leaves() -> None:
    """What is kept of planes from pose to pose holds for none but those that stand still."""
    wall = np.array([[-9, -9, -4], [9, -9, -4], [0, 9, -4]], float)
    face = np.array([[0, 1, 2]])
    still = Scene.from_objects([("a", wall, face), ("b", wall, face), ("c", wall, face)])
    moving = np.array([False, False, True])
    vertices = still.vertices.copy()
    camera = Camera(np.eye(4), 8, 8, 0.5, 64.0, yfov=1.0)
    poses = []
    # Away, nearer by a lower bit than any before, back, and in the plane of the others.
    for z in (-5.0, -4.0, -4.0 + 2.0**-18, -4.0, -3.0):
        vertices[6:, 2] = z
        poses.append(replace(still, vertices=vertices.copy(), moving=moving))
    posed = ExactScene(poses[0])
    for now in [*poses, *poses[::-1]]:
        posed.pose(now)
        ours, theirs = posed.certify(camera), ExactScene(now).certify(camera)
        assert contents(ours) == contents(theirs)
        z = now.vertices[6, 2]
        assert (ours.buffer.triangle[4, 4] == 2) == (z > -4.0)
        tied = {0.0: 2}.get(z + 4.0, 1 if z < -4.0 else 0)
        assert np.count_nonzero(ours.ties.sample == 36) == tied


def test_recalled_truths_of_a_scene_that_moves_need_a_camera_each() -> None:
    scene = moments(random_soup(1), 1, 1)[0]
    truth = ExactScene(scene).certify(view(1))
    camera = view(1)
    with pytest.raises(ValueError, match="two frames"):
        RecalledTruths(scene, CameraPath((camera, camera)), [truth, truth])
    recalled = RecalledTruths(scene, CameraPath((camera,)), [truth])
    assert recalled.poses
    recalled.pose(scene)
    assert recalled.frame(camera) is truth
