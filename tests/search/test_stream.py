"""What is tried next is the same whoever asks and wherever a search stopped, and what showed
something new is tried more."""

from __future__ import annotations

from collections import Counter

import numpy as np

from visref.search.stream import ROUND, Stream, round_of


class Numbers:
    """A source whose genomes are numbers."""

    def random(self, rng):
        return float(rng.uniform(0.0, 1.0))

    def changed(self, genome, rng):
        return genome + 10.0

    def crossed(self, one, other, rng):
        return one + other + 1000.0

    def written(self, genome):
        return genome

    def read(self, value):
        return value


def shown(genome: float) -> set[str]:
    """A few features, the rarer the larger the number."""
    return {f"tens {int(genome) // 10}", "any"}


def run(stream: Stream, trials: range) -> list[float]:
    tried = []
    for first in range(trials.start, trials.stop, ROUND):
        numbers = [n for n in round_of(first) if n in trials]
        genomes = [stream.genome(number) for number in numbers]
        for number, genome in zip(numbers, genomes, strict=True):
            stream.learn(number, genome, shown(genome))
        tried += genomes
    return tried


def test_a_trial_is_kept_only_if_it_shows_something_new():
    stream = Stream(Numbers(), 0)
    assert stream.learn(0, 1.0, ["a", "b"]) is not None
    assert stream.learn(1, 2.0, ["a"]) is None
    assert stream.learn(2, 3.0, ["a", "c"]) is not None
    assert [one.trial for one in stream.kept] == [0, 2]
    assert stream.hits == Counter(a=3, b=1, c=1)


def test_the_same_seed_tries_the_same_and_another_does_not():
    trials = range(4 * ROUND)
    one, again, other = (run(Stream(Numbers(), seed), trials) for seed in (5, 5, 6))
    assert one == again
    assert one != other


def test_what_is_tried_in_a_round_hangs_on_earlier_rounds_alone():
    """So they can be tried side by side, and in parts."""
    whole, parts = Stream(Numbers(), 1), Stream(Numbers(), 1)
    everything = run(whole, range(3 * ROUND))
    cut = ROUND + ROUND // 2
    first = run(parts, range(ROUND)) + run(parts, range(ROUND, cut))
    rest = [parts.genome(number) for number in range(cut, 2 * ROUND)]
    assert first + rest == everything[: 2 * ROUND]


def test_what_was_kept_is_changed_and_crossed_where_the_search_is_guided():
    guided = run(Stream(Numbers(), 2), range(6 * ROUND))
    unguided = run(Stream(Numbers(), 2, guided=False), range(6 * ROUND))
    assert max(unguided) <= 1.0
    # Of the trials after the first round three in five, give or take.
    from_kept = [genome for genome in guided if genome > 1.0]
    assert 0.5 < len(from_kept) / (5 * ROUND) < 0.7
    assert any(genome < 1000.0 for genome in from_kept)
    assert any(genome >= 1000.0 for genome in from_kept)


def test_rare_features_draw_more_trials():
    stream = Stream(Numbers(), 3)
    for number in range(ROUND):
        stream.learn(number, 0.5, ["common"])
    stream.learn(ROUND - 1, 5000.0, ["rare"])
    tried = [stream.genome(ROUND + k) for k in range(ROUND)]
    changed = [genome for genome in tried if genome > 1.0]
    assert np.mean([genome > 4000.0 for genome in changed]) > 0.7
