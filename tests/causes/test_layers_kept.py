"""Pictures for hypotheses are kept as far as memory goes, and made again where they were not."""

from __future__ import annotations

import tracemalloc

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.causes.small import Stage, at
from visref.causes.layers import Layers, LayersKept
from visref.causes.sights import Sights
from visref.conformance.building import camera, case, pixel_panel

SIDE = 8
EACH = Layers.empty(SIDE, SIDE).bytes


@given(st.lists(st.integers(0, 6), max_size=60), st.integers(1, 5))
def test_what_was_asked_for_last_is_kept_and_no_more_than_fits(asked, room):
    kept, made = LayersKept(room * EACH), []
    recent: list[int] = []
    for key in asked:

        def make(key=key):
            made.append(key)
            layers = Layers.empty(SIDE, SIDE)
            layers.owner[:] = key
            return layers

        before = len(made)
        assert (kept.get(key, make).owner == key).all()
        assert (len(made) == before) == (key in recent)
        recent = [*(one for one in recent if one != key), key][-room:]
        assert kept.held == len(recent) * EACH


def test_layers_larger_than_the_room_are_held_alone():
    kept = LayersKept(1)
    for key in "ab":
        kept.get(key, lambda: Layers.empty(SIDE, SIDE))
        assert kept.held == EACH


def test_memory_is_given_back():
    kept = LayersKept(10 << 20)
    tracemalloc.start()
    try:
        for key in range(40):
            kept.get(key, lambda: Layers.empty(256, 512))
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 12 << 20
    assert np.isinf(kept.get(39, lambda: Layers.empty(1, 1)).nearest).all()


def test_what_a_scene_has_not_makes_no_other_layers():
    """Nor do those of a moment stand for others, however often its sight was made."""
    asked = at(panels)
    sights = Sights(asked.sights.moments, asked.sights.answers)
    now = sights.sight(0, "")
    drawn = now.layers()
    again = now.layers(masks=True, glass=True, back_faces=True, unclipped=True)
    assert again is drawn
    assert now.layers(before_near=True) is not drawn
    small = now.layers(by=2)
    assert small.owner.shape == tuple(side // 2 for side in drawn.owner.shape)
    assert now.layers(by=2, masks=True, glass=True) is small
    sights._sights.clear()
    assert sights.sight(0, "").layers() is drawn
    other = sights.sight(1, "").layers()
    assert other is not drawn
    assert not np.array_equal(other.nearest, drawn.nearest)


def panels():
    here, nearer = camera(), camera(eye=(0.0, 0.0, -1.0))
    return Stage(case([("panel", pixel_panel(here, (10, 30), (10, 30), 9.0))], [here, nearer]))
