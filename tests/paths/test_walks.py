"""Walks: along given points, and through a scene by themselves, which keep away from triangles."""

from __future__ import annotations

import json
import math
from itertools import pairwise

import numpy as np
import pytest

from tests.paths.rooms import BOXES, box, house
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.paths import free_space
from visref.paths.clearance import distance_to_triangles
from visref.paths.free_space import free_route
from visref.paths.lens import Lens
from visref.paths.walking import walk
from visref.scene import Scene

LENS = Lens(64, 48)


@pytest.fixture(autouse=True)
def _coarse(monkeypatch):
    """A grid that is quick; cells are 8 cm wide in the house."""
    monkeypatch.setattr(free_space, "CELLS", 300_000)


def eyes_of(path: CameraPath) -> np.ndarray:
    return np.array([camera.eye for camera in path.cameras])


def walked(points, frames, **changes) -> CameraPath:
    return walk(np.array(points, float), LENS, frames, [None] * frames, near=0.1, **changes)


def test_a_walk_passes_its_points_and_looks_where_it_goes():
    points = [(0, 1, 0), (0, 1, -6), (3, 1, -6)]
    path = walked(points, 40)
    eyes = eyes_of(path)
    for point in points:
        assert (eyes == point).all(axis=1).any()
    moves = np.diff(eyes, axis=0)
    for camera, move in zip(path.cameras[1:], moves, strict=True):
        if move.any():
            # Level, and straight ahead; the angle went through a tangent and back.
            assert camera.forward @ move / np.linalg.norm(move) == pytest.approx(1.0, abs=1e-15)
        assert camera.world_from_camera[1, 0] == pytest.approx(0.0, abs=1e-15)


def test_it_turns_on_the_spot_the_shorter_way_and_steps_are_alike():
    # South, then east of south by 135 degrees: to the left.
    path = walked([(0, 1, 0), (0, 1, 10), (7, 1, 3)], 60)
    eyes, forward = eyes_of(path), np.array([camera.forward for camera in path.cameras])
    moves = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
    turns = np.array([math.acos(min(1.0, a @ b)) for a, b in pairwise(forward)])
    turning = turns > 1e-7
    assert turning.sum() > 3
    # While it turns it stands, and all its turns together are the angle between the legs.
    assert np.all(moves[turning] == 0.0)
    assert turns.sum() == pytest.approx(math.radians(135), abs=1e-6)
    assert np.all(forward[:, 2][turning.argmax() :] <= 1.0)
    steps = moves[~turning]
    assert steps.max() / steps.min() < 1.5


def test_up_and_down_it_looks_on_as_before():
    path = walked([(0, 0, 0), (0, 0, -2), (0, 5, -2), (0, 5, -4)], 12)
    assert all(abs(camera.forward[1]) <= math.sin(math.radians(60)) + 1e-12 for camera in path)
    assert path.cameras[-1].forward.tolist() == pytest.approx([0, 0, -1], abs=1e-15)


@pytest.mark.parametrize(
    ("points", "frames", "expected"),
    [
        ([(0, 0, 0)], 9, "two points at least"),
        ([(0, 0, 0), (0, 0, 0)], 9, "same point twice"),
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0)], 2, "--frames is 2; give 3 to"),
        ([(0, 0, 0), (math.inf, 0, 0)], 9, "same point twice"),
        ([(-1e200, 0, 0), (1e200, 0, 0)], 9, "too far apart"),
    ],
)
def test_what_is_no_walk_is_refused(points, frames, expected):
    with pytest.raises(InputError, match=expected):
        walked(points, frames)


def nearest(scene: Scene, points: np.ndarray) -> float:
    """The least distance of any of these points to any triangle, whose nearest point is the best of
    the feet on its edges and that on its plane, where the weights there are positive."""
    corners = scene.vertices[scene.triangles].astype(np.float64) + scene.origin
    best = math.inf
    for a, b, c in corners:
        for start, end in ((a, b), (b, c), (c, a)):
            along = end - start
            share = np.clip((points - start) @ along / (along @ along), 0, 1)
            best = min(best, np.linalg.norm(points - start - share[:, None] * along, axis=1).min())
        weights, *_ = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), (points - a).T, rcond=None)
        over = (weights >= 0).all(axis=0) & (weights.sum(axis=0) <= 1)
        foot = a + weights.T @ np.stack([b - a, c - a])
        if over.any():
            best = min(best, np.linalg.norm(points - foot, axis=1)[over].min())
    return float(best)


def meets(scene: Scene, start: np.ndarray, end: np.ndarray) -> bool:
    """Whether a segment meets a triangle, by the signs of five volumes."""
    for a, b, c in scene.vertices[scene.triangles].astype(np.float64) + scene.origin:
        above, below = (np.linalg.det([b - a, c - a, p - a]) for p in (start, end))
        sides = [np.linalg.det([p - start, q - start, end - start])
                 for p, q in ((a, b), (b, c), (c, a))]  # fmt: skip
        if above * below <= 0 and (min(sides) >= 0 or max(sides) <= 0) and any(sides):
            return True
    return False


def test_the_brute_force_sees_walls():
    scene = house()
    assert meets(scene, np.array([3.0, 1.5, 1.0]), np.array([5.0, 1.5, 1.0]))
    assert not meets(scene, np.array([3.0, 1.5, 2.9]), np.array([5.0, 1.5, 2.9]))
    assert nearest(scene, np.array([[5.0, 1.0, 3.5]])) == 0.75


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 7])
@pytest.mark.parametrize("clearance", [None, 0.3])
def test_a_walk_through_a_house_meets_no_triangle_between_its_frames(seed, clearance):
    scene = house()
    points, kept = free_route(scene, seed=seed, places=5, clearance=clearance)
    assert kept == (clearance or kept)
    path = walk(points, LENS, 60, [None] * 60, near=0.05)
    eyes = eyes_of(path)
    for start, end in pairwise(eyes):
        assert not meets(scene, start, end)
        # Points a fiftieth of the clearance apart: what is between two of them is nearer by at
        # most a hundredth of it.
        count = max(2, math.ceil(np.linalg.norm(end - start) / kept * 50))
        if (start != end).any():
            assert nearest(scene, np.linspace(start, end, count)) >= kept * (1 - 1e-9)


def test_a_walk_through_a_house_is_in_it_turns_and_goes_through_the_door():
    points, _ = free_route(house(), seed=3, places=6)
    assert (points >= (0, 0, 0)).all()
    assert (points <= (8, 3, 6)).all()
    assert points[:, 0].min() < 4 < points[:, 0].max()
    legs = np.diff(points, axis=0)
    legs /= np.linalg.norm(legs, axis=1, keepdims=True)
    turning = sum(math.acos(np.clip(a @ b, -1, 1)) for a, b in pairwise(legs))
    assert turning > math.pi


def test_a_walk_is_the_same_for_the_same_seed_and_another_for_another():
    routes = [free_route(house(), seed=seed, places=4)[0].tolist() for seed in (1, 1, 2)]
    assert routes[0] == routes[1]
    assert routes[0] != routes[2]


def test_a_house_far_out_is_walked_in_its_own_place():
    here, _ = free_route(house(), seed=1, places=3)
    there, _ = free_route(house((4096.0, 0.0, -2048.0)), seed=1, places=3)
    # Whole numbers: nothing is rounded but the sums, of numbers of 4096.
    assert np.abs(there - here - (4096.0, 0.0, -2048.0)).max() < 1e-9


def test_the_height_of_the_eye_may_be_given():
    points, _ = free_route(house(), seed=1, places=3, height=1.7)
    assert set(points[:, 1]) == {1.7}


def test_around_a_thing_that_stands_alone_one_walks_outside_of_it():
    vertices, triangles = house().vertices[:8] * (1, 10, 1), house().triangles[:12]
    scene = Scene.from_objects([("block", vertices, triangles)])
    points, kept = free_route(scene, seed=0, places=4)
    low, high = scene.bounds
    assert (((points < low - kept) | (points > high + kept)).any(axis=1)).all()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"clearance": -1.0}, "--clearance is -1"),
        ({"clearance": 100.0}, "--clearance is 100; give a length below 8.5"),
    ],
)
def test_a_clearance_that_is_no_length_is_refused(changes, expected):
    with pytest.raises(InputError, match=expected):
        free_route(house(), seed=0, places=2, height=1.5, **changes)


def test_a_scene_without_triangles_has_nothing_to_walk_about_in():
    empty = Scene.from_objects([("nothing", np.zeros((0, 3)), np.zeros((0, 3)))])
    with pytest.raises(InputError, match="nothing to walk about in"):
        free_route(empty, seed=0, places=2)


def test_times_are_written(tmp_path):
    path = walk(np.array([(0, 0, 0), (1.0, 0, 0)]), LENS, 3, [0.0, 0.5, 1.0], near=0.1)
    assert [frame["time_s"] for frame in json.loads(json.dumps(path.to_json()))["frames"]] == [
        0.0, 0.5, 1.0,
    ]  # fmt: skip


def test_where_the_house_leaves_no_room_it_is_walked_around():
    points, kept = free_route(house(), seed=0, places=3, clearance=2.0)
    assert kept == 2.0
    assert nearest(house(), points) >= 2.0


def test_what_the_grid_says_keeps_the_clearance_does():
    scene, rng = house(), np.random.default_rng(2)
    grid = free_space._grid(scene, 0.25, 1.5)
    kept = 0
    for _ in range(3000):
        start, end = rng.uniform((0, 1.5, 0), (8, 1.5, 6), (2, 3))
        end = start + (end - start) * 0.2
        if free_space._keeps(scene, grid, 0, start, end):
            kept += 1
            assert distance_to_triangles(scene, start, end)[0] >= 0.25
    # Not all of them, and not none.
    assert 300 < kept < 2700


@pytest.mark.parametrize("seed", range(3))
def test_on_a_wide_plain_a_walk_keeps_to_the_things_on_it(seed):
    plain = box((-40, -0.5, -40), (48, -0.25, 46))
    things = [(name, *box(low, high)) for name, (low, high) in BOXES.items()]
    points, _ = free_route(Scene.from_objects([("plain", *plain), *things]), seed=seed, places=4)
    low, high = house().bounds
    beyond = np.maximum(np.maximum(low - points, points - high), 0.0).max(axis=1)
    # The plain reaches 40 farther than the house; a place anywhere on it is 25 off, on average.
    assert beyond.max() < 4.0
