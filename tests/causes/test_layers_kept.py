"""Pictures for hypotheses are kept as far as memory goes, and made again where they were not."""

from __future__ import annotations

import tracemalloc

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from visref.causes.layers import Layers, LayersKept

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
