"""Numbers with their nouns, what was probably meant, and some of many."""

from __future__ import annotations

import itertools

import pytest

from visref.picking import evenly_picked
from visref.wording import counted, did_you_mean


def test_one_is_singular_and_everything_else_plural():
    assert [counted(n, "frame") for n in (0, 1, 2, 2000)] == [
        "0 frames",
        "1 frame",
        "2 frames",
        "2,000 frames",
    ]
    assert counted(2, "mesh", "meshes") == "2 meshes"


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("chiar", "did you mean 'Chair'?"),
        ("CHAIR", "did you mean 'Chair'?"),
        ("zzz", "known are Chair, Table"),
    ],
)
def test_a_near_name_is_suggested_whatever_its_case_and_else_all_are_listed(name, hint):
    assert did_you_mean(name, ["Chair", "Table"]) == hint


def test_where_nothing_is_near_the_caller_may_say_what_to_do():
    assert did_you_mean("zzz", ["Chair"], "look it up") == "look it up"
    assert did_you_mean("zzz", []) == "known are none"


@pytest.mark.parametrize(("count", "at_most"), [(0, 3), (3, 5), (5, 5), (100, 7), (9, 2), (4, 1)])
def test_picked_positions_are_ascending_spread_and_no_more_than_asked(count, at_most):
    picked = evenly_picked(count, at_most).tolist()
    assert len(picked) == min(count, at_most)
    assert picked == sorted(set(picked))
    if len(picked) > 1:
        assert (picked[0], picked[-1]) == (0, count - 1)
        gaps = [b - a for a, b in itertools.pairwise(picked)]
        # Rounded down at both ends, equal steps differ by one at most.
        assert max(gaps) - min(gaps) <= 1


def test_nothing_is_picked_of_anything_where_none_is_asked():
    assert evenly_picked(5, 0).tolist() == []
