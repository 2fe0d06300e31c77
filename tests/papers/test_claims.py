"""A claim's grade, on each side of each line and across it; and what stands as published."""

from __future__ import annotations

import pytest

from visref.papers.claims import Claim, Grade, Sense
from visref.papers.contents import Curve, Row, SetUp, printed_curve
from visref.papers.estimates import Estimate, single
from visref.papers.published import (
    Derived,
    Printed,
    PrintedRange,
    PrintedWords,
    one_more,
    printed_numbers,
    product_of,
    ratio_of,
)

TWO = Printed(2, "Table 1", "some row, some column")
TENTH = Printed(10, "p. 3", "ten per cent of it", per=100)


class Between(Estimate):
    """A figure whose interval is known."""

    def __init__(self, low, high):
        super().__init__((low + high) / 2.0)
        object.__setattr__(self, "ends", (low, high))

    @property
    def interval(self):
        return self.ends


HOLDS, DIRECTION, FAILS, OPEN = Grade.HOLDS, Grade.IN_DIRECTION, Grade.FAILS, Grade.OPEN


@pytest.mark.parametrize(
    ("low", "high", "grade"),
    [
        (2.0, 3.0, HOLDS),
        (2.1, 2.2, HOLDS),
        (1.99, 2.1, OPEN),
        (0.5, 2.0, OPEN),
        (1.01, 1.99, DIRECTION),
        (1.0, 1.5, OPEN),
        (0.9, 1.1, OPEN),
        (0.5, 1.0, FAILS),
        (0.1, 0.2, FAILS),
        (1.0, 1.0, FAILS),
        (2.0, 2.0, HOLDS),
    ],
)
def test_a_figure_that_is_to_be_at_least_the_published_one(low, high, grade):
    assert Claim("twice", Sense.AT_LEAST, Between(low, high), TWO).grade is grade


@pytest.mark.parametrize(
    ("low", "high", "grade"),
    [
        (0.05, 0.10, HOLDS),
        (0.05, 0.11, OPEN),
        (0.11, 0.99, DIRECTION),
        (0.11, 1.0, OPEN),
        (1.0, 1.5, FAILS),
    ],
)
def test_a_figure_that_is_to_be_at_most_the_published_one(low, high, grade):
    assert Claim("a tenth", Sense.AT_MOST, Between(low, high), TENTH).grade is grade


@pytest.mark.parametrize(
    ("low", "high", "grade"),
    [(2.0, 3.0, HOLDS), (1.9, 2.0, OPEN), (1.2, 1.9, FAILS), (0.1, 0.2, FAILS)],
)
def test_a_figure_without_an_order_is_reached_or_not(low, high, grade):
    assert Claim("twice", Sense.AT_LEAST, Between(low, high), TWO, even=None).grade is grade


@pytest.mark.parametrize(
    ("low", "high", "strict", "ties"),
    [
        (1.1, 1.2, HOLDS, HOLDS),
        (1.0, 1.2, OPEN, HOLDS),
        (0.9, 1.2, OPEN, OPEN),
        (0.9, 1.0, FAILS, OPEN),
        (1.0, 1.0, FAILS, HOLDS),
        (0.8, 0.9, FAILS, FAILS),
    ],
)
def test_an_order_that_the_paper_gives_no_figure_for(low, high, strict, ties):
    for ties_hold, grade in ((False, strict), (True, ties)):
        claim = Claim("more", Sense.AT_LEAST, Between(low, high), ties=ties_hold)
        assert claim.grade is grade
        mirrored = Claim("less", Sense.AT_MOST, Between(-high, -low), even=-1.0, ties=ties_hold)
        assert mirrored.grade is grade


def test_a_single_figure_is_judged_as_it_is_and_none_is_not_measured():
    assert Claim("twice", Sense.AT_LEAST, single(2.0), TWO).grade is HOLDS
    assert Claim("twice", Sense.AT_LEAST, single(1.9), TWO).grade is DIRECTION
    assert Claim("twice", Sense.AT_LEAST, None, TWO).grade is Grade.UNMEASURED


def test_claims_that_nothing_could_judge_are_refused():
    with pytest.raises(ValueError, match="wrong side"):
        Claim("twice", Sense.AT_MOST, None, TWO)
    with pytest.raises(ValueError, match="nothing to be judged by"):
        Claim("something", Sense.AT_MOST, None, even=None)
    with pytest.raises(TypeError, match="no source"):
        Claim("twice", Sense.AT_LEAST, None, 2.0)
    with pytest.raises(TypeError, match="no estimate"):
        Claim("twice", Sense.AT_LEAST, 2.0, TWO)


# What stands as published.


@pytest.mark.parametrize("typed", [2, 2.0, "2", "1.9 to 5.8", True])
def test_a_number_that_is_typed_in_is_no_published_one(typed):
    with pytest.raises(TypeError, match="no source"):
        Row("quantity", typed, 2.0)
    with pytest.raises(TypeError, match="no source"):
        SetUp("quantity", typed)
    with pytest.raises(TypeError, match="no source"):
        printed_curve("paper", (1.0,), (typed,))
    with pytest.raises(TypeError):
        ratio_of(TWO, typed)
    with pytest.raises(TypeError):
        PrintedRange(typed, TWO)


def test_a_printed_number_needs_its_place():
    for where, words in (("", "row"), ("Table 1", " "), ("Table 1", "x" * 101)):
        with pytest.raises(ValueError, match="its place"):
            Printed(2, where, words)
    with pytest.raises(ValueError, match="no number"):
        Printed(float("nan"), "Table 1", "row")
    with pytest.raises(ValueError, match="in words"):
        PrintedWords("over 1,000", "section 4")
    with pytest.raises(ValueError, match="a range"):
        PrintedRange(TWO, TENTH)


def test_what_is_derived_is_computed_from_what_is_printed():
    eight = Printed(8, "Table 1", "other row")
    assert ratio_of(eight, TWO).amount == 4.0
    assert product_of(eight, TENTH).amount == 0.8
    assert one_more(TENTH).amount == 1.1
    nested = ratio_of(ratio_of(eight, TWO), TENTH)
    assert nested.amount == 40.0
    assert list(printed_numbers(nested)) == [eight, TWO, TENTH]
    assert isinstance(nested, Derived)


def test_units_of_print_are_turned_into_those_that_compare():
    assert Printed(35, "Table 5", "per cent", per=100).amount == 0.35
    assert Printed(20, "section 4.4", "M pixels", times=1e6).amount == 2e7


def test_a_rows_ratio_is_of_comparable_numbers_only():
    assert Row("q", TWO, 3.0).ratio == 1.5
    assert Row("q", PrintedRange(TENTH, TWO), 3.0).ratio is None
    assert Row("q", PrintedWords("works", "p. 1"), 3.0).ratio is None
    assert Row("q", TWO, None).ratio is None
    assert not Curve("ours", (1.0,), (2.0,)).published
    assert printed_curve("theirs", (1.0,), (TWO,)).y == (2.0,)
