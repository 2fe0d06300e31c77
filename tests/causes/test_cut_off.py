"""Limits that are each answer's own: which are believed, and which cullers are said to have one."""

from __future__ import annotations

import numpy as np
import pytest

from tests.causes.test_inner import row
from tests.causes.test_plain_cullers import DropsAtRandom, Right, first_named, judged, town
from visref.causes.cut_off import beyond


def test_what_lies_beyond_all_that_was_drawn():
    values = np.array([1.0, 4.0, 3.0, 2.0, 6.0, 3.0])
    drawn = np.array([True, False, True, False, False, False])
    assert beyond(values, drawn, below=False).tolist() == [0, 1, 0, 0, 1, 0]
    assert beyond(-values, drawn, below=True).tolist() == [0, 1, 0, 0, 1, 0]
    assert not beyond(values, np.zeros(6, np.bool_), below=False).any()


class SomeOfTheList(Right):
    """So many are drawn as the frame before would have drawn, less a few, the first by number."""

    before = 20

    def answer(self, view):
        now = super().answer(view)
        most, self.before = self.before - 6, len(now)
        return now[:most]


class NarrowerByTheFrame(Right):
    """The view is taken for narrower, by more in each frame."""

    def in_view(self, view, corners, pixels, depth):
        share = 1.0 - 0.07 * (self.count % 8)
        middle = (view.width - 1) / 2.0
        low, high = pixels[:, 0].min(), pixels[:, 0].max()
        inside = low <= middle + share * view.width / 2 and high >= middle - share * view.width / 2
        return inside and super().in_view(view, corners, pixels, depth)


@pytest.mark.parametrize("scene", [town, row])
def test_list_that_is_cut_off_is_full(scene):
    told = first_named(judged(SomeOfTheList(), scene()))
    assert told.total() >= 10
    assert told["list-full"] >= 0.8 * told.total(), told


def test_view_that_is_narrower_by_the_frame_has_another_lens():
    told = first_named(judged(NarrowerByTheFrame(), row()))
    assert told.total() >= 10
    assert told["other-lens"] >= 0.8 * told.total(), told


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("scene", [town, row])
def test_what_is_dropped_at_random_is_cut_off_nowhere(scene, seed):
    told = first_named(judged(DropsAtRandom(seed), scene()))
    assert not told["list-full"], told
