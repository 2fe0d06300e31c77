"""Volumes that do not hold their objects: what reaches into the view, which of them fits, and which
cullers are said to test such a one."""

from __future__ import annotations

import numpy as np
import pytest

from tests.causes.small import at, plain, wide
from tests.causes.test_fits_and_lists import besides
from tests.causes.test_plain_cullers import (
    CentreOnly,
    DropsAtRandom,
    NearestOfTheRectangle,
    OneFrameLate,
    QuarterOfTheResolution,
    Right,
    first_named,
    judged,
    town,
)
from visref.camera import Camera
from visref.causes.inner import EVERY, VOLUMES, WITHIN, Pairs, kept_by, reaches
from visref.conformance.building import box, camera, case


@pytest.mark.parametrize("view", [plain(), wide(shift_x_px=3.0)], ids=["flat", "deep"])
def test_box_reaches_into_the_view_unless_one_side_has_all_its_corners_beyond_it(view: Camera):
    rng = np.random.default_rng(3)
    centres, halves = rng.uniform(-20, 20, (400, 3)), rng.uniform(0, 4, (400, 3))
    corners = np.array(list(np.ndindex(2, 2, 2))) * 2 - 1
    points = centres[:, None] + corners * halves[:, None]
    pixels, depth = view.pixel_of(points.reshape(-1, 3))
    pixels, depth = pixels.reshape(-1, 8, 2), depth.reshape(-1, 8)
    # Where all lies before the eye pixels tell sides apart; elsewhere near does.
    ahead = depth.min(axis=1) > 0
    beyond = (pixels < -0.5).all(axis=1).any(axis=1) | (depth > view.far).all(axis=1)
    beyond |= (pixels > np.array([view.width, view.height]) - 0.5).all(axis=1).any(axis=1)
    beyond |= (depth < view.near).all(axis=1)
    found = reaches(view, centres, halves, np.zeros(len(centres)))
    assert ahead.sum() > 50
    assert (found == ~beyond)[ahead].all()
    assert not found[(depth < view.near).all(axis=1)].any()
    # A sphere of no more than a box's half sides reaches no farther, one around it no less.
    inner = reaches(view, centres, np.zeros_like(halves), halves.min(axis=1))
    outer = reaches(view, centres, np.zeros_like(halves), np.linalg.norm(halves, axis=1))
    assert not (inner & ~found).any()
    assert not (found & ~outer).any()


def test_the_first_volume_is_the_box():
    asked = at(besides)
    kept = kept_by(asked, np.zeros(len(asked.ids), np.int64), hidden=False)
    assert WITHIN[0]
    assert VOLUMES.half[0].tolist() == [1.0, 1.0, 1.0]
    assert kept.tolist() == asked.boxes.in_view.tolist()


def pairs(lost, inside):
    """Of one kind that says `inside` in place of the last."""
    flags = np.ones((len(lost), len(EVERY)), np.bool_)
    flags[:, -1] = inside
    every = np.arange(len(lost))
    return Pairs(every, every * 0, np.array(lost), np.ones(len(lost), np.bool_), flags)


def test_volume_that_tells_lost_from_drawn_is_believed_and_one_that_chance_gives_is_not():
    lost = np.arange(60) < 12
    told = pairs(lost, ~lost)
    assert told.net()[-1] == 12
    assert told.believed(len(EVERY) - 1)
    # Three of three, of which one in 20 is picked by chance, and there are hundreds of kinds.
    few = np.arange(20) < 2
    assert not pairs(few, ~few).believed(len(EVERY) - 1)
    assert not pairs(lost, np.arange(60) % 5 > 0).believed(len(EVERY) - 1)


# Cullers.


def row():
    """Wide boxes strewn in six rows, one above another, past which the camera goes to and fro."""
    rng = np.random.default_rng(5)
    objects = []
    for i in range(36):
        low = np.array([rng.uniform(-16.0, 13.0), i % 6 - 3.0, -9.0 - 0.2 * (i // 6)])
        objects.append((f"o{i}", box(low, low + np.array([rng.uniform(1.5, 4.0), 0.7, 0.1]))))
    steps = 7.0 * np.sin(np.arange(20) * 0.7)
    return case(
        objects, [camera((x, 0.0, 0.0), (x, 0.0, -5.0), width=60, height=40) for x in steps]
    )


class ThatBox(Right):
    """Not all of its box is tested against the view; nothing is held against depth."""

    def keeps(self, view, corners, pixels, depth):
        low, high = corners.min(axis=0), corners.max(axis=0)
        ends = np.array(self.part(low, high))
        those = np.array([[ends[(i >> a) & 1, a] for a in range(3)] for i in range(8)])
        return super().in_view(view, those, *view.pixel_of(those))


class RightHalf(ThatBox):
    def part(self, low, high):
        return ((low[0] + high[0]) / 2, *low[1:]), high


class BoxBeside(ThatBox):
    """The box lies on the right of the object."""

    def part(self, low, high):
        away = np.array([1.0, 0.0, 0.0]) * (high - low)
        return low + away, high + away


@pytest.mark.parametrize("culler", [RightHalf, BoxBeside])
def test_box_of_another_shape_is_named(culler):
    told = first_named(judged(culler(), row()))
    assert told.total() >= 10
    assert told["bounds-too-small"] >= 0.8 * told.total(), told


@pytest.mark.parametrize(
    "culler", [OneFrameLate, CentreOnly, NearestOfTheRectangle, QuarterOfTheResolution]
)
@pytest.mark.parametrize("scene", [town, row])
def test_other_mistakes_are_not_said_to_be_of_boxes(culler, scene):
    told = first_named(judged(culler(), scene()))
    assert not told["bounds-too-small"], told


@pytest.mark.parametrize("seed", range(4))
def test_what_is_dropped_at_random_is_of_no_volume(seed):
    told = first_named(judged(DropsAtRandom(seed), row()))
    assert told.total() >= 10
    assert not told["bounds-too-small"], told
