"""Boxes that cover what GL makes of their geometry, and what is certain about them."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.culling_scenes import ortho, perspective, random_camera
from visref.camera import Camera
from visref.scene import Scene
from visref_culling.boxes.conservative import (
    growth,
    inflated,
    meets_frustum,
    nearest_depth,
    needs_no_query,
    round_outward,
)
from visref_culling.gl.view import View

EMPTY = Scene.from_objects([])


def corners_of(relative):
    """(k, 8, 3) of boxes (k, 2, 3)."""
    return np.stack(
        [
            np.stack([relative[:, pick[axis], axis] for axis in range(3)], axis=1)
            for pick in itertools.product((0, 1), repeat=3)
        ],
        axis=1,
    )


def random_bounds(rng, count, scale=1.0):
    points = rng.normal(size=(count, 2, 3)) * scale
    return np.sort(points.astype(np.float32).astype(np.float64), axis=1)


@given(st.integers(0, 10**6))
def test_compiled_boxes_grow_as_the_formula_says(seed):
    """Whole arrays at a time, and to the last bit: the GPU's cullers are held to the same."""
    rng = np.random.default_rng(seed)
    camera = random_camera(rng, 32, 24)
    view = View.of(camera, EMPTY, 8)
    bounds = random_bounds(rng, 20, scale=10.0 ** rng.integers(-2, 5))
    relative = bounds - camera.eye
    reach = np.linalg.norm(np.abs(relative).max(axis=1), axis=1)
    part, pixel, rounding = growth(view)
    grow = part * reach + (pixel * reach if camera.is_perspective else pixel)
    grow += rounding * (np.abs(bounds).max(axis=(1, 2)) + np.abs(camera.eye).max())
    relative[:, 0] -= grow[:, None]
    relative[:, 1] += grow[:, None]
    assert np.array_equal(inflated(view, bounds), relative)
    assert inflated(view, bounds[:0]).shape == (0, 2, 3)


@given(st.integers(0, 10**6))
def test_nearest_depth_is_the_least_of_all_eight_corners(seed):
    rng = np.random.default_rng(seed)
    view = View.of(random_camera(rng, 32, 24), EMPTY, 8)
    boxes = random_bounds(rng, 20)
    expected = (corners_of(boxes) @ view.depth_row).min(axis=1)
    assert np.allclose(nearest_depth(view, boxes), expected, rtol=1e-12, atol=1e-12)


@given(st.integers(0, 10**6))
def test_box_that_holds_a_sample_of_the_view_is_never_outside_the_frustum(seed):
    rng = np.random.default_rng(seed)
    camera = random_camera(rng, 32, 24)
    view = View.of(camera, EMPTY, 8)
    for _ in range(10):
        origin, direction = camera.ray(int(rng.integers(32)), int(rng.integers(24)))
        t = camera.near if rng.random() < 0.2 else camera.near + rng.exponential(1.0)
        point = origin + min(t, view.far) * direction
        reach = rng.exponential(0.1, (2, 3))
        bounds = np.stack([point - reach[0], point + reach[1]])[None]
        assert meets_frustum(view, inflated(view, bounds))[0]


def test_frustum_leaves_out_what_is_beside_behind_and_beyond():
    view = View.of(perspective(40, 40, near=1.0, far=10.0), EMPTY, 8)
    inside = [(0, 0, -5), (6, 0, -5), (0, -6, -5), (0, 0, -10.5), (0, 0, -0.5)]
    outside = [(8, 0, -5), (-8, 0, -5), (0, 8, -5), (0, -8, -5), (0, 0, 0.5), (0, 0, -11.5)]
    centres = np.array(inside + outside)
    bounds = np.stack([centres - 1.0, centres + 1.0], axis=1)
    kept = meets_frustum(view, inflated(view, bounds))
    assert kept.tolist() == [True] * len(inside) + [False] * len(outside)


def test_eye_in_the_box_and_a_box_across_the_near_plane_need_no_query():
    view = View.of(perspective(40, 40, near=1.0), EMPTY, 8)
    around = np.array([[[-2, -2, -2], [2, 2, 2]]], float)
    across = np.array([[[-2, -2, -5], [2, 2, -0.9]]], float)
    beyond = np.array([[[-2, -2, -5], [2, 2, -1.1]]], float)
    far_away = np.array([[[-1e31, -2, -5], [2, 2, -1.1]]], float)
    boxes = inflated(view, np.concatenate([around, across, beyond, far_away]))
    assert needs_no_query(view, boxes).tolist() == [True, True, False, True]


@pytest.mark.parametrize("origin", [0.0, 1e5, 1e7])
def test_inflated_box_keeps_a_sub_pixel_of_distance_from_its_geometry(origin):
    pose = np.eye(4)
    pose[:3, 3] = origin
    camera = Camera(pose, 640, 480, 0.1, yfov=1.0)
    view = View.of(camera, EMPTY, 8)
    bounds = np.array([[[-1, -1, -11], [1, 1, -10]]], float) + origin
    relative = round_outward(inflated(view, bounds)).astype(np.float64)
    pixel = 2.0 * math.tan(0.5) / 480 * 10.0
    true = bounds - camera.eye
    for side, sign in ((0, -1.0), (1, 1.0)):
        grown = sign * (relative[0, side] - true[0, side])
        assert (grown >= pixel / 256).all()
        assert (grown <= 0.1 * pixel).all()  # and not so much that nothing is ever culled


def test_rounding_outward_never_shrinks():
    boxes = random_bounds(np.random.default_rng(3), 1000) * (1.0 + 1e-9)
    rounded = round_outward(boxes).astype(np.float64)
    assert (rounded[:, 0] <= boxes[:, 0]).all()
    assert (rounded[:, 1] >= boxes[:, 1]).all()
    assert (np.abs(rounded - boxes) <= np.abs(boxes) * 2.0**-22).all()


@pytest.mark.parametrize("make", [ortho, perspective])
def test_box_that_clipping_could_cut_short_of_the_rim_needs_no_query(make):
    view = View.of(make(40, 40, near=1.0), EMPTY, 8)
    # Half a pixel is lost from 2^24 / 64 / 2 = 131,072 pixels beside the image on.
    pixel = 10.0 * 2.0 * np.linalg.norm(view.camera.right_step) if make is perspective else 1.0
    sides = np.array([[1e5], [1.4e5]]) * pixel
    boxes = np.array([[[-1, -1, -11], [1, 1, -10]]] * 2, float)
    boxes[:, 1, 0] = sides[:, 0]
    assert needs_no_query(view, boxes).tolist() == [False, True]
