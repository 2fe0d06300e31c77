"""Orbits, turntables and pairs of eyes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.paths.rooms import box, house
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.paths.circling import bounds_of, circle_around, everything, orbit, turntable
from visref.paths.lens import Lens
from visref.paths.stereo import stereo_frame
from visref.scene import Group, Scene
from visref.timeline import Timeline

LENS = Lens(64, 48)
U = 2.0**-53


def circle(scene: Scene, **changes):
    return circle_around(scene.bounds + scene.origin, LENS, **{"elevation": 0.3, **changes})


def test_an_orbit_goes_round_at_one_distance_and_looks_at_the_middle():
    around = circle(house())
    path = orbit(around, LENS, 12, [None] * 12)
    middle = np.array((4.0, 1.5, 3.0))
    assert around.centre.tolist() == middle.tolist()
    angles = []
    for camera in path.cameras:
        away = camera.eye - middle
        assert np.linalg.norm(away) == pytest.approx(around.distance, rel=8 * U)
        assert math.asin(away[1] / around.distance) == pytest.approx(0.3, rel=16 * U)
        assert np.abs(camera.forward + away / around.distance).max() <= 16 * U
        angles.append(math.atan2(away[0], away[2]))
    steps = np.diff(np.unwrap(angles))
    assert np.abs(steps - 2 * math.pi / 12).max() <= 64 * U


@pytest.mark.parametrize("size", [(64, 48), (48, 64), (200, 20)])
def test_from_the_default_distance_all_of_it_is_in_view(size):
    lens, scene = Lens(*size), house()
    around = circle_around(scene.bounds, lens, elevation=0.4)
    corners = np.array(np.meshgrid(*scene.bounds.T)).reshape(3, -1).T
    for camera in orbit(around, lens, 7, [None] * 7).cameras:
        pixels, depth = camera.pixel_of(corners)
        assert (depth > camera.near).all()
        # Pixel centres are whole numbers; the image ends half a pixel beyond.
        assert (pixels >= -0.5).all()
        assert (pixels <= np.array(size) - 0.5).all()


def test_a_turntable_shows_what_an_orbit_shows():
    scene = house((0.5, 0.0, -1.0))
    around = circle(scene)
    orbited = orbit(around, LENS, 5, [None] * 5)
    turned = turntable(around, LENS, 5, scene, everything(scene))
    timeline = Timeline(scene, turned)
    for k in range(5):
        (standing,), (moving,) = turned.views(k), orbited.views(k)
        assert standing.definition() == turned.views(0)[0].definition()
        posed = timeline.at(k).vertices.astype(np.float64)
        here = posed @ standing.camera_from_world[:3, :3].T + standing.camera_from_world[:3, 3]
        still = scene.vertices.astype(np.float64)
        there = still @ moving.camera_from_world[:3, :3].T + moving.camera_from_world[:3, 3]
        # Posed vertices, of 9 at most, are rounded to float32; three of them make a coordinate.
        assert np.abs(here - there).max() <= 3 * 2.0**-24 * 9
    assert timeline.moves


def test_one_thing_may_turn_alone_and_a_group_about_its_middle():
    plain = Scene.from_objects(
        [("a", *box((0, 0, 0), (1, 1, 1))), ("b", *box((2, 0, 0), (3, 1, 1)))]
    )
    scene = replace(plain, groups=(Group("pair", "pair", (0, 1)),))
    for name, middle in (("a", (0.5, 0.5, 0.5)), ("pair", (1.5, 0.5, 0.5))):
        bounds = bounds_of(scene, name)
        assert bounds.mean(axis=0).tolist() == list(middle)
        around = circle_around(bounds, LENS, elevation=0.1)
        path = turntable(around, LENS, 2, scene, [name])
        half = Timeline(scene, path).at(1)
        moved = half.vertices[:8] - scene.vertices[:8]
        expected = 2 * (np.array(middle) - scene.vertices[:8]) * (1, 0, 1)
        assert np.abs(moved - expected).max() <= 4 * 2.0**-24
        assert np.any(half.vertices[8:] != scene.vertices[8:]) == (name == "pair")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"elevation": math.pi / 2}, "90 degrees looks along the axis"),
        ({"distance": 0.0}, "the distance is 0"),
        ({"distance": -1.0}, "the distance is -1"),
    ],
)
def test_what_is_no_circle_is_refused(changes, expected):
    with pytest.raises(InputError, match=expected):
        circle(house(), **changes)


def test_nothing_is_not_circled_around():
    scene = Scene.from_objects([("nothing", np.zeros((0, 3)), np.zeros((0, 3)))])
    for bounds in (scene.bounds, bounds_of(scene, "nothing")):
        with pytest.raises(InputError, match="nothing to circle around"):
            circle_around(bounds, LENS, elevation=0.0)
    with pytest.raises(InputError, match="no object named 'lamp'"):
        bounds_of(scene, "lamp")
    with pytest.raises(InputError, match="--frames is 0"):
        orbit(circle(house()), LENS, 0, [])


CAMERA = Camera(
    look_at((1, 2, 3), (4, 0, -5)), 64, 48, near=0.1, far=90.0, yfov=1.0, shift_x_px=2.0
)


def test_two_eyes_stand_apart_and_look_the_same_way():
    frame = stereo_frame(Frame((CAMERA,), 0.5, absent=("door",)), 0.25)
    left, right = frame.cameras
    assert (left.view, right.view) == ("left", "right")
    assert (frame.time_s, frame.absent) == (0.5, ("door",))
    apart = right.eye - left.eye
    assert np.abs(apart - 0.25 * CAMERA.world_from_camera[:3, 0]).max() <= 8 * U * 4
    assert np.abs((left.eye + right.eye) / 2 - CAMERA.eye).max() <= 4 * U * 4
    for one in frame.cameras:
        assert one.forward.tolist() == CAMERA.forward.tolist()
        assert one.shift_x_px == 2.0


def test_at_the_screen_s_depth_both_eyes_see_a_point_at_the_same_pixel():
    left, right = stereo_frame(Frame((CAMERA,)), 0.25, screen=3.0).cameras
    for x, y in ((0, 0), (40, 20)):
        eye, ray = CAMERA.ray(x, y)
        at_screen, beyond = ((eye + t * ray)[None] for t in (3.0, 6.0))
        for one in (left, right):
            pixel, depth = one.pixel_of(at_screen)
            # Pixels of up to 64, from numbers of up to 5 over steps of 1/44.
            assert pixel[0].tolist() == pytest.approx([x, y], abs=64 * 44 * 5 * 16 * U)
            assert depth[0] == pytest.approx(3.0, rel=16 * U)
        # What is farther lies to the right for the right eye: it is seen uncrossed.
        assert right.pixel_of(beyond)[0][0, 0] > x > left.pixel_of(beyond)[0][0, 0]


@pytest.mark.parametrize(
    ("frame", "arguments", "expected"),
    [
        (Frame((replace(CAMERA, view="a"), replace(CAMERA, view="b"))), (0.1,), "several views"),
        (Frame((CAMERA,)), (0.0,), "--eyes is 0"),
        (Frame((CAMERA,)), (0.1, -1.0), "--screen is -1"),
        (Frame((replace(CAMERA, yfov=None, ymag=1.0),)), (0.1, 1.0), "no depth to converge at"),
    ],
)
def test_what_is_no_pair_of_eyes_is_refused(frame, arguments, expected):
    with pytest.raises(InputError, match=expected):
        stereo_frame(frame, *arguments)


def test_an_orthographic_camera_has_two_eyes_too():
    left, right = stereo_frame(Frame((replace(CAMERA, yfov=None, ymag=1.0),)), 0.5).cameras
    assert (left.ymag, right.ymag) == (1.0, 1.0)
    assert len(CameraPath([Frame((left, right))]).views(0)) == 2
