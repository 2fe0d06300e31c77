"""Vertices that rounding moved by more than a picture forgives convict nobody; others do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.hand_made import camera, scene_of_squares
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.findings import Code
from visref.judging.referee import Referee
from visref.judging.rounding import FORGIVEN_PX, moved_px
from visref.placing import rounded
from visref.scene import Scene


class Draws(Culler):
    name = "draws"

    def __init__(self, *ids: int) -> None:
        self.ids = np.array(ids, np.int32)

    def cull(self, camera: Camera) -> DrawnSet:
        return DrawnSet(self.ids)


def moved(scene: Scene, by: dict[str, float]) -> Scene:
    """The scene, with the vertices of some objects moved so far by rounding."""
    far = np.zeros(len(scene.vertices), np.float32)
    for name, distance in by.items():
        low, high = scene.object_offsets[scene.id_of_name[name] :][:2]
        far[scene.triangles[low:high]] = distance
    return replace(scene, moved=far)


def outcome(scene: Scene, engine: str, *drawn: int):
    path = CameraPath((camera(),))
    run = Referee(scene, lambda: make_engine(engine, scene)).run(path, [0], [("d", Draws(*drawn))])
    return run, run.cullers[0].totals


# A pixel of `camera()` is one unit wide, whatever the depth.
LITTLE, MUCH = 0.9 * FORGIVEN_PX, 1.1 * FORGIVEN_PX
SQUARES = scene_of_squares(0.0, -3.0, -6.0)


@pytest.mark.parametrize("engine", ["exact", "embree"])
@pytest.mark.parametrize(
    ("name", "far", "lost"),
    [
        ("square0", LITTLE, 8),
        ("square0", MUCH, 0),  # the owner
        ("square1", LITTLE, 8),
        ("square1", MUCH, 0),  # right behind the owner
        ("square2", MUCH, 8),  # behind both: whatever it does, it is not seen
    ],
)
def test_loss_convicts_unless_the_owner_or_what_is_right_behind_it_moved_too_far(
    engine, name, far, lost
):
    _, totals = outcome(moved(SQUARES, {name: far}), engine)
    assert totals.missed_pixels == lost
    assert (totals.undecided_samples, totals.violations) == ((0, 1) if lost else (8, 0))
    assert totals.owned_samples == 8


def test_drawing_all_that_may_be_seen_decides_the_sample():
    _, totals = outcome(moved(SQUARES, {"square0": MUCH}), "exact", 0, 1, 2)
    assert (totals.missed_pixels, totals.undecided_samples) == (0, 0)


def test_the_greatest_move_of_what_is_seen_is_a_finding():
    run, _ = outcome(moved(SQUARES, {"square0": 0.5, "square2": 7.0}), "exact", 0, 1, 2)
    (found,) = [f for f in run.findings if f.code == Code.VERTICES_ROUNDED]
    assert (found.message, found.object, found.frame) == ("by 0.5 pixels at most", "square0", 0)
    run, _ = outcome(moved(SQUARES, {"square0": LITTLE, "square2": 7.0}), "exact", 0, 1, 2)
    assert Code.VERTICES_ROUNDED not in [f.code for f in run.findings]


def test_pixels_shrink_with_depth_and_no_vertex_is_nearer_than_near():
    scene = moved(SQUARES, {"square0": 1.0})
    eye = Camera(look_at((0, 0, 8), (0, 0, 0)), 4, 4, near=2.0, yfov=2 * np.arctan(0.5))
    # At depth 8 the view is 8 high, so a pixel is 2 wide; at near, 0.5.
    assert moved_px(scene, eye, np.array([0], np.int32)) == pytest.approx([0.5])
    inside = replace(eye, world_from_camera=look_at((0, 0, -1), (0, 0, -9)))
    assert moved_px(scene, inside, np.array([0], np.int32)) == pytest.approx([2.0])


def test_rounding_says_how_far_it_moved_and_never_less():
    rng = np.random.default_rng(5)
    exact = rng.normal(size=(500, 3)) * 10.0 ** rng.integers(-3, 8, (500, 1))
    held, far = rounded(exact)
    true = np.linalg.norm(exact - held.astype(np.float64), axis=1)
    assert (far >= true).all()
    assert (far <= true * 1.001 + 1e-30).all()
    assert (rounded(held.astype(np.float64))[1] == 0.0).all()


def test_camera_and_scene_are_relative_to_one_origin_by_one_subtraction():
    origin = np.array([6.4e6, -1.5e8, 1e5])
    eye = look_at(origin + np.array([0.25, 0.5, 9.0]), origin)
    far = Camera(eye, 8, 6, near=0.1, yfov=1.0)
    near = far.relative_to(origin)
    assert near.eye.tolist() == (far.eye - origin).tolist()
    assert near.relative_to(origin) is near
    assert near.relative_to((0, 0, 0)).eye.tolist() == far.eye.tolist()
    assert near.definition()["origin"] == [float(v).hex() for v in origin]
    base = SQUARES
    scene = replace(base, origin=origin)
    here = look_at((0, 0, 10), (0, 0, 0))
    there = here.copy()
    there[:3, 3] += origin
    ortho = {"near": 1.0, "far": 100.0, "ymag": 1.0}
    for name in ("exact", "embree", "open3d", "gl"):
        ours = make_engine(name, scene).frame(Camera(there, 4, 2, **ortho))
        plain = make_engine(name, base).frame(Camera(here, 4, 2, **ortho))
        assert np.array_equal(ours.buffer.triangle, plain.buffer.triangle)
        assert np.array_equal(ours.buffer.depth, plain.buffer.depth)
    assert scene.digest != base.digest
