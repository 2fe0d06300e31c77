"""Axes hold what is plotted, and one slow culler does not hide the others."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from visref.report.plots import HEIGHT, Plot, Series, log_ticks, needs_log

VALUES = st.floats(1e-4, 1e6)


@given(VALUES, VALUES)
def test_logarithmic_ticks_hold_the_values_and_are_few(one, other):
    low, high = sorted((one, other))
    marks = log_ticks(low, high)
    assert marks[0] <= low * (1 + 1e-12)
    assert marks[-1] >= high * (1 - 1e-12)
    assert marks == sorted(set(marks))
    assert 2 <= len(marks) <= 12


@pytest.mark.parametrize(
    ("usual", "log"), [((1.0, 2.0), False), ((1.0, 100.0), True), ((100.0,), False)]
)
def test_only_a_line_far_above_others_asks_for_a_logarithm(usual, log):
    lines = [Series(f"{n}", dict.fromkeys(range(5), value), n) for n, value in enumerate(usual)]
    assert needs_log(lines) is log


def test_nothing_asks_for_a_logarithm_of_zero():
    assert not needs_log([Series("a", {0: 0.0, 1: 1.0}, 0), Series("b", {0: 99.0, 1: 99.0}, 1)])


def test_a_decade_is_as_high_anywhere_on_a_logarithmic_axis():
    plot = Plot("Time", "ms", [Series("a", {0: 1.0, 1: 10.0, 2: 100.0}, 0)], log=True)
    heights = [float(y) for y in re.findall(r'<circle cx="[^"]*" cy="([^"]*)"', plot.svg)]
    assert heights[0] - heights[1] == pytest.approx(heights[1] - heights[2], abs=0.2)
    assert all(0 < height < HEIGHT for height in heights)
