"""The stream of trials: what is tried next, from what has been seen.

As coverage-guided fuzzers do (AFL; Böhme et al. 2016, 2020, for the energy by rarity): a trial that
shows a feature that none before it showed is kept; later ones are drawn anew, or change or cross
what was kept, the more often the rarer the features that it shows. Trial `n` of a seed depends on
nothing but the truths of the trials of earlier rounds, so that any number of processes, and a run
that goes on where another stopped, try the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from visref.search.case import Case
from visref.search.novelty import Feature, rarity

G = TypeVar("G")

# Trials of a round are chosen by what was known before it, so that they can run side by side.
ROUND = 32
# Shares of the trials: changed or crossed from what was kept; and of these, crossed.
_KEPT, _CROSSED = 0.6, 0.3


class Source(Protocol[G]):
    """Where trials come from: generated scenes, or views of one scene. A trial's genome `G` is JSON
    values once it is `written`."""

    def random(self, rng: np.random.Generator) -> G:
        """A genome drawn anew."""
        ...

    def changed(self, genome: G, rng: np.random.Generator) -> G:
        """One that differs from another by little."""
        ...

    def crossed(self, one: G, other: G, rng: np.random.Generator) -> G:
        """One made of two."""
        ...

    def written(self, genome: G) -> Any:
        """The genome in JSON values."""
        ...

    def read(self, value: Any) -> G:
        """The genome of JSON values. Raises InputError for what is none."""
        ...

    def case(self, genome: G) -> Case:
        """The case of a genome. Raises InputError where there is none."""
        ...

    def called(self, case: Case) -> Callable[[int], str]:
        """By object id, what features call the objects of a case."""
        ...


@dataclass(frozen=True)
class Kept(Generic[G]):
    """A trial that showed something new: its number, its genome and all features that it shows."""

    trial: int
    genome: G
    features: tuple[Feature, ...]


@dataclass(eq=False)
class Stream(Generic[G]):
    """What was kept, and how often each feature was shown. `guided`: whether that guides what is
    tried; else each trial is drawn anew."""

    source: Source[G]
    seed: int
    guided: bool = True
    kept: list[Kept[G]] = field(default_factory=list)
    hits: Counter[Feature] = field(default_factory=Counter)
    # The round at hand, and `hits` as they were when it began.
    round_at: int = 0
    hits_then: Counter[Feature] = field(default_factory=Counter)

    def genome(self, trial: int) -> G:
        """What a trial of the round at hand tries, or of the next one when all of this are
        learnt."""
        start = round_of(trial).start
        if start != self.round_at:
            self.round_at, self.hits_then = start, Counter(self.hits)
        rng = np.random.default_rng([self.seed, trial])
        kept = [one for one in self.kept if one.trial < start]
        if not self.guided or not kept or rng.random() >= _KEPT:
            return self.source.random(rng)
        energy = np.array([rarity(one.features, self.hits_then) for one in kept])
        first, second = rng.choice(len(kept), 2, p=energy / energy.sum())
        one, other = kept[int(first)].genome, kept[int(second)].genome
        if rng.random() < _CROSSED:
            return self.source.crossed(one, other, rng)
        return self.source.changed(one, rng)

    def is_new(self, features: Iterable[Feature]) -> bool:
        """Whether a trial that shows these would be kept."""
        return any(feature not in self.hits for feature in features)

    def learn(self, trial: int, genome: G, features: Iterable[Feature]) -> Kept[G] | None:
        """Take in what a trial showed, in the order of the trials: what is kept of it, if it showed
        anything new."""
        shown = tuple(sorted(set(features)))
        new = self.is_new(shown)
        self.hits.update(shown)
        if not new:
            return None
        one = Kept(trial, genome, shown)
        self.kept.append(one)
        return one


def round_of(trial: int) -> range:
    """The trials of a trial's round."""
    first = trial - trial % ROUND
    return range(first, first + ROUND)
