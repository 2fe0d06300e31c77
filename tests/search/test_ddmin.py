"""Delta debugging keeps exactly what is to blame, and no part of it can be left out."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from visref.search.ddmin import ddmin

sizes = st.integers(0, 40)


@given(sizes, st.sets(st.integers(0, 39)))
def test_things_that_fail_together_and_nothing_else_are_kept(count, blamed):
    items = list(range(count))
    blamed &= set(items)
    assert ddmin(items, lambda kept: blamed <= set(kept)) == sorted(blamed)


@given(sizes, st.lists(st.sets(st.integers(0, 39), min_size=1), min_size=1, max_size=4))
def test_none_of_what_is_kept_can_be_left_out_by_itself(count, reasons):
    """There are several reasons to fail, each a set of things; it keeps one of them whole."""
    items = list(range(count))

    def fails(kept):
        return any(reason <= set(kept) for reason in reasons)

    if not fails(items):
        return
    kept = ddmin(items, fails)
    assert fails(kept)
    assert kept == sorted(kept)
    assert not any(fails([one for one in kept if one != gone]) for gone in kept)


@given(st.integers(1, 200), st.integers(0, 199))
def test_one_of_many_is_found_in_as_many_questions_as_halving_takes(count, blamed):
    blamed %= count
    asked = []

    def fails(kept):
        asked.append(kept)
        return blamed in kept

    assert ddmin(range(count), fails) == [blamed]
    assert len(asked) <= 1 + 2 * math.ceil(math.log2(count) if count > 1 else 0)


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_what_fails_by_itself_keeps_nothing(count):
    assert ddmin(range(count), lambda kept: True) == []
