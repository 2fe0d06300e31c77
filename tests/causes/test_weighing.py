"""What speaks for a hypothesis, and how likely that makes it."""

from __future__ import annotations

import numpy as np
import pytest

from visref.causes.search import HYPOTHESES
from visref.causes.weighing import (
    MOST_TOLD,
    OF_BOXES,
    WEIGHTS,
    Told,
    features,
    information,
    likelihoods,
)

NAMES = list(WEIGHTS)[:-1]


def told(**changed):
    """Six units of an answer that lost three of them and drew the others, which show."""
    none = np.zeros(6, np.bool_)
    lost = np.arange(6) < 3
    kinds = dict.fromkeys(("idle", "left", "again", "boxes", "small"), none)
    return Told(**{"lost": lost, "good": ~lost, "lossy": ~none, **kinds, **changed})


def of(cause, culled, given):
    hypothesis = next(one for one in HYPOTHESES if one.cause == cause)
    return dict(zip(NAMES, features(hypothesis, culled, given, given.lost), strict=True))


def test_a_right_split_tells_all_that_is_in_doubt():
    assert information(3, 0, 3, 3) == pytest.approx(6 * np.log(2) - 6 * _doubt(0.5 / 4), rel=1e-9)
    assert information(1000, 0, 1000, 1000) == MOST_TOLD


def test_what_takes_lost_and_drawn_alike_tells_nothing():
    assert information(0, 0, 5, 5) == pytest.approx(0.0, abs=1e-9)
    assert information(4, 4, 8, 8) == pytest.approx(0.0, abs=1e-9)


def test_no_split_tells_less_than_nothing():
    for lost in range(1, 6):
        for right in range(lost + 1):
            for wrong in range(6):
                assert information(right, wrong, lost, 5) >= 0.0


def _doubt(p):
    return -p * np.log(p) - (1 - p) * np.log(1 - p)


def test_likelihoods_of_causes_and_of_none_add_up_to_one():
    found = likelihoods(np.array([2.0, 1.0]), none=1.0)
    assert found.sum() == pytest.approx(1.0)
    assert found[1] == found[2] == pytest.approx(found[0] / np.e)


def test_without_causes_none_is_sure():
    assert likelihoods(np.zeros(0)).tolist() == [1.0]


def test_boxes_found_too_small_speak_for_causes_of_boxes_alone():
    given = told(small=np.arange(6) < 2)
    for cause in ("bounds-too-small", "rest-pose", "glass-solid", "one-frame-late"):
        found = of(cause, given.lost, given)
        expected = 2 / 3 if cause in OF_BOXES else 0.0
        assert found["its box is too small"] == pytest.approx(expected)
        assert found["its box is too small, others' are not"] == pytest.approx(expected)


def test_boxes_too_small_of_all_say_little_of_the_lost():
    found = of("rest-pose", told().lost, told(small=np.ones(6, np.bool_)))
    assert found["its box is too small"] == 1.0
    assert found["its box is too small, others' are not"] == 0.0


def test_all_and_nothing_else_is_that():
    given = told(again=np.arange(6) == 5)
    lost = given.lost
    whole = "all and nothing else", "all and nothing else that is new"
    for culled, expected in (
        (lost, (1.0, 1.0)),
        (lost | given.again, (0.0, 1.0)),
        (lost | (np.arange(6) == 3), (0.0, 0.0)),
        (np.arange(6) < 2, (0.0, 0.0)),
    ):
        found = of("glass-solid", culled, given)
        assert tuple(found[name] for name in whole) == expected
