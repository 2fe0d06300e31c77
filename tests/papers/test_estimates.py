"""Intervals: how often they hold the truth, and what they must and must not depend on."""

from __future__ import annotations

import math

import numpy as np
import pytest

from visref.camera_path import middles
from visref.papers import estimates
from visref.papers.estimates import (
    RESAMPLES,
    Estimate,
    block_length,
    least,
    most,
    series,
    single,
    students_quantile,
)


def wave(rng, count, memory):
    """An autoregressive series of order 1 with mean 0 and variance 1 / (1 - memory²)."""
    found = np.empty(count)
    found[0] = rng.normal() / math.sqrt(1.0 - memory**2)
    for k in range(1, count):
        found[k] = memory * found[k - 1] + rng.normal()
    return found


def width(estimate):
    low, high = estimate.interval
    return high - low


# What is known in closed form.


@pytest.mark.parametrize(
    ("freedom", "known"),
    [(1, 12.7062), (2, 4.30265), (3, 3.18245), (6, 2.44691), (19, 2.09302), (1000, 1.96234)],
)
def test_students_quantile_is_that_of_the_tables(freedom, known):
    assert students_quantile(0.975, freedom) == pytest.approx(known, rel=1e-5)


def test_resamples_vary_as_means_of_blocks_do():
    """9 frames are 3 blocks of 3: of all 9 circular blocks, each as likely as another."""
    values = np.random.default_rng(1).normal(size=9)
    around = np.concatenate([values, values])
    blocks = [around[k : k + 3].mean() for k in range(9)]
    estimate = series(values, range(9)).mean()
    assert estimate.blocks == 3
    assert estimate.resamples.mean() == pytest.approx(values.mean(), abs=0.02)
    assert estimate.resamples.var() == pytest.approx(np.var(blocks) / 3.0, rel=0.1)


@pytest.mark.parametrize(
    ("frames", "length"),
    [
        (range(1), 1),
        (range(2), 1),
        (range(8), 2),
        (range(27), 3),
        (range(28), 4),
        ([8, 25, 41, 58, 75, 91], 2),
        (middles(300, 20), 3),
        ([*range(10, 15), *range(40, 45), *range(70, 75), *range(90, 95)], 5),
        ([4, 5, 6, 90], 2),
    ],
)
def test_blocks_are_as_long_as_the_rule_says_and_never_part_a_stretch(frames, length):
    assert block_length(list(frames)) == length


# How often the interval holds the truth.


# Blocks of 50^(1/3) frames leave out some of a memory of 0.3: 92 % of 2,000 intervals hold it.
@pytest.mark.parametrize(("memory", "often"), [(0.0, 0.95), (0.3, 0.92)])
def test_interval_holds_the_mean_of_a_process_about_as_often_as_it_says(memory, often):
    rng = np.random.default_rng(3)
    held = [
        low <= 0.0 <= high
        for low, high in (
            series(wave(rng, 50, memory), range(50), str(k % 20)).mean().interval
            for k in range(1000)
        )
    ]
    # Three standard errors of 1,000 draws.
    assert np.mean(held) == pytest.approx(often, abs=3.0 * math.sqrt(often * (1.0 - often) / 1000))


@pytest.mark.parametrize("memory", [0.0, 0.8, 0.95])
def test_interval_of_sampled_frames_holds_the_paths_mean(memory):
    """The question that is asked: what would every frame of this path have given?"""
    rng = np.random.default_rng(4)
    at = middles(300, 20)
    held = []
    for _ in range(200):
        path = wave(rng, 300, memory)
        low, high = series(path[at], at).mean().interval
        held.append(low <= path.mean() <= high)
    assert np.mean(held) >= 0.94


def test_without_blocks_the_interval_of_a_series_with_memory_would_be_too_narrow(monkeypatch):
    rng = np.random.default_rng(5)
    waves = [wave(rng, 60, 0.6) for _ in range(150)]

    def coverage():
        ends = [series(one, range(60)).mean().interval for one in waves]
        return np.mean([low <= 0.0 <= high for low, high in ends])

    with_blocks = coverage()
    monkeypatch.setattr(estimates, "block_length", lambda frames: 1)
    assert coverage() < with_blocks - 0.08


def test_order_of_the_frames_counts_and_a_rising_series_is_less_sure():
    rising = np.arange(30.0)
    mixed = np.random.default_rng(6).permutation(rising)
    assert width(series(rising, range(30)).mean()) > 1.3 * width(series(mixed, range(30)).mean())


def test_fewer_blocks_are_less_sure():
    values = np.random.default_rng(7).normal(size=40)
    widths = [
        width(series(np.tile(values[:10], n), range(10 * n)).mean()) * math.sqrt(10 * n)
        for n in (1, 4)
    ]
    assert widths[0] > widths[1]


# Special figures.


def test_what_does_not_change_has_no_width_and_one_frame_tells_nothing():
    assert series([7.0] * 20, range(20)).mean().interval == (7.0, 7.0)
    assert series([7.0], [3]).mean().interval == (-math.inf, math.inf)
    assert single(7.0).interval is None
    assert (single(7.0) / 2.0).interval is None


def test_figures_of_one_walk_are_resampled_together_and_those_of_two_are_not():
    values = np.random.default_rng(8).uniform(1, 9, size=20)
    one, twice = series(values, range(20)).mean(), series(2.0 * values, range(20)).mean()
    assert (twice / one).interval == pytest.approx((2.0, 2.0))
    other = series(2.0 * values, range(20), walk="elsewhere").mean()
    assert width(other / one) > 0.5


def test_quotient_of_means_is_that_of_sums_and_not_the_mean_of_quotients():
    above, below = series([1.0, 30.0], [0, 1]), series([1.0, 10.0], [0, 1])
    assert (above.mean() / below.mean()).value == 31.0 / 11.0
    assert (above / below).mean().value == 2.0
    assert (above / below).median().value == 2.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_paths_worst_is_no_better_than_the_worst_that_was_seen(sign):
    values = sign * np.array([1.0, 2.0, 9.0, 3.0, 2.0, 1.0, 4.0, 2.0])
    worst = series(values, range(8)).most() if sign > 0 else series(values, range(8)).least()
    low, high = sorted(sign * end for end in worst.interval)
    assert (worst.value, low) == (sign * 9.0, 9.0)
    assert high > 9.0
    alone = series([5.0], [0]).most()
    assert alone.interval == (5.0, math.inf)


def test_worst_of_several_scenes_is_bounded_by_what_was_seen_in_each():
    one, other = series([0.0, 2.0], [0, 1], "a").most(), series([5.0], [0], "b").most()
    assert most(one, other).interval[0] == 5.0
    assert most(one, single(7.0)).interval[0] == 7.0
    assert least(one, other).interval[0] == 2.0
    assert (one - 1.0).at_least == -math.inf


def test_least_and_most_are_taken_resample_by_resample():
    rng = np.random.default_rng(9)
    parts = [series(rng.normal(size=12), range(12), str(k)).mean() for k in range(3)]
    joined = least(*parts)
    assert joined.value == min(part.value for part in parts)
    assert np.array_equal(joined.resamples, np.min([part.resamples for part in parts], axis=0))
    assert joined.resamples.shape == (RESAMPLES,)


def test_arithmetic_is_that_of_numbers():
    figure = series([2.0, 4.0], [0, 1]).mean()
    made = [figure + 1.0, figure - 1.0, 1.0 - figure, figure * 3.0, figure / 2.0, 6.0 / figure]
    assert [one.value for one in made] == [4.0, 2.0, -2.0, 9.0, 1.5, 2.0]
    expected = [lambda x: x + 1, lambda x: x - 1, lambda x: 1 - x, lambda x: 3 * x,
                lambda x: x / 2, lambda x: 6 / x]  # fmt: skip
    for one, of in zip(made, expected, strict=True):
        assert np.allclose(one.resamples, of(figure.resamples))


def test_no_figure_of_nothing():
    zero = series([0.0, 0.0], [0, 1])
    with pytest.raises(ZeroDivisionError):
        series([1.0, 1.0], [0, 1]).mean() / zero.mean()
    with pytest.raises(ZeroDivisionError):
        series([1.0, 1.0], [0, 1]) / zero
    with pytest.raises(ValueError, match="0"):
        series([], []).mean()
    with pytest.raises(ValueError, match="other frames"):
        series([1.0], [0]) / series([1.0], [1])
    sometimes = series([1.0] * 6, range(6)).mean() / series([0.0] * 5 + [6.0], range(6)).mean()
    assert sometimes.interval == (-math.inf, math.inf)


def test_another_seed_gives_another_interval_of_about_the_same_width():
    values = np.random.default_rng(11).normal(size=40)
    usual, other = (series(values, range(40)).mean() for _ in range(2))
    with estimates.resampling(1):
        ends = other.interval
    assert ends != usual.interval
    assert width(other) == pytest.approx(width(usual), rel=0.15)
    assert (other.value, other.blocks) == (usual.value, usual.blocks)


def test_the_same_frames_give_the_same_interval_in_any_order_of_asking():
    values = np.random.default_rng(10).normal(size=20)
    first = series(values, range(20), "walk").mean().interval
    estimates._draws.cache_clear()
    series(values, range(20), "other").mean()
    assert series(values, range(20), "walk").mean().interval == first
    assert isinstance(single(1.0), Estimate)
