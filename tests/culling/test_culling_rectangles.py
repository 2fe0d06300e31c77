"""Screen rectangles of boxes: every pixel that a box may touch, and no more."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.culling_scenes import ortho, perspective, random_camera
from visref.scene import Scene
from visref_culling.boxes.conservative import inflated
from visref_culling.boxes.rectangles import screen_rectangles
from visref_culling.gl.view import View

EMPTY = Scene.from_objects([])


@settings(deadline=None)  # the first call compiles
@given(st.integers(0, 10**6))
def test_rectangle_holds_every_pixel_of_the_box_and_is_no_larger_than_its_part_in_view(seed):
    rng = np.random.default_rng(seed)
    camera = random_camera(rng, 48, 32)
    view = View.of(camera, EMPTY, 8)
    bounds = np.sort(rng.normal(size=(1, 2, 3)), axis=1)
    relative = inflated(view, bounds)
    x0, y0, x1, y1 = screen_rectangles(view, relative)[0]
    points = rng.uniform(bounds[0, 0], bounds[0, 1], (400, 3))
    pixels, depth = camera.pixel_of(points)
    shown = pixels[depth >= camera.near]
    inside = (np.abs(shown - (23.5, 15.5)) <= (24.0, 16.0)).all(axis=1)
    for x, y in np.floor(shown[inside] + 0.5):
        assert x0 <= min(x, 47) <= x1
        assert y0 <= min(y, 31) <= y1
    corners = np.stack(np.meshgrid(*bounds[0].T), axis=-1).reshape(-1, 3)
    exact, depth = camera.pixel_of(corners)
    if depth.min() > max(camera.near, 0.5):  # nearer, a sub-pixel far away is more than a pixel
        low, high = np.floor(exact.min(axis=0) + 0.4), np.floor(exact.max(axis=0) + 0.6)
        assert x1 <= max(high[0], -1)
        assert y1 <= max(high[1], -1)
        assert x0 >= min(low[0], 48)
        assert y0 >= min(low[1], 32)


@pytest.mark.parametrize("make", [ortho, perspective])
def test_rectangles_known_by_hand(make):
    view = View.of(make(16, 12), EMPTY, 8)
    pixel = 1.0 if make is ortho else 2.0 * 4.0 / 12
    inset = 0.25 * pixel

    def at(x0, y0, x1, y1):
        """The box of these pixels, right edge exclusive, a quarter pixel inside them."""
        low = ((x0 - 8) * pixel + inset, (6 - y1) * pixel + inset, -4.0)
        high = ((x1 - 8) * pixel - inset, (6 - y0) * pixel - inset, -4.0)
        return low, high

    bounds = np.array([at(2, 3, 5, 4), at(-5, -5, 3, 2), at(20, 2, 25, 4), at(0, -9, 4, -3)])
    rectangles = screen_rectangles(view, inflated(view, bounds))
    assert rectangles[0].tolist() == [2, 3, 4, 3]
    assert rectangles[1].tolist() == [0, 0, 2, 1]
    assert rectangles[2][2] < rectangles[2][0]
    assert rectangles[3][3] < rectangles[3][1]


def test_rectangle_of_a_box_across_the_near_plane_is_that_of_its_part_beyond():
    view = View.of(perspective(16, 16, near=1.0), EMPTY, 8)
    floor = np.array([[(-0.5, -0.9, -8.0), (0.5, -0.5, 3.0)]])  # passes under the eye
    behind = np.array([[(-9.0, -9.0, 1.0), (9.0, 9.0, 2.0)]])
    around = np.array([[(-9.0, -9.0, -9.0), (9.0, 9.0, 9.0)]])
    x0, y0, x1, y1 = screen_rectangles(view, inflated(view, floor))[0]
    assert (x0, x1, y1) == (3, 12, 15)
    assert y0 == 8  # the far edge, at 0.5 / 8 below the middle
    x0, y0, x1, y1 = screen_rectangles(view, inflated(view, behind))[0]
    assert x1 < x0
    assert screen_rectangles(view, inflated(view, around))[0].tolist() == [0, 0, 15, 15]
