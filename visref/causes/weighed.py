"""Hypotheses held against a culler's answers, and which of them are likely."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import some
from visref.causes.cut_off import cut_off
from visref.causes.displaced import displaced
from visref.causes.evidence import Answer
from visref.causes.fitted import FITS, ODDS, Fit, odds, threshold
from visref.causes.in_view import and_hidden, kept_by_depth
from visref.causes.inner import fitted_volumes
from visref.causes.partly import Applied, kinds_of
from visref.causes.sights import At, Hypothesis
from visref.causes.weighing import Told, features, likelihoods, worth
from visref.judging.causes import CODES
from visref.scene import Float64, Int32, Int64

Bool = NDArray[np.bool_]

# The ordinary first.
CAUSES = list(CODES)

# A cause explains so much of a culler's misses: a few of many are explained by chance.
LEAST = 0.25
# Rounds of causes of one culler, each of what those before leave open.
MOST = 5
# So many causes are named that may explain a miss, at most: the likeliest, as far as together they
# are so likely, and others that are as likely as this share of the first. Where even so many are
# not so likely together, none is named.
NAMED, LIKELY, NEARLY = 3, 0.45, 0.15
# Others that leave out the same of what shows, but for so much, cannot be told from the first by
# it: they are named too, unless they are less likely by far, by this share of it.
ALIKE, FAR_LESS = 0.9, 0.006
# So few misses tell one hypothesis from another by nothing but how ordinary they are.
TELLING = 3
# Where fewer were lost, what is named would pick them by chance in one of so many cases at most.
FEW_LOST, UNLIKELY = 10, 1000
# What says no more than that it was missed is for what nothing else explains.
LAST = ("never-drawn",)


@dataclass(eq=False)
class Looked:
    """Some of an answer's units: `ids` (k,), and of each whether it is `lost`, rightly drawn
    (`good`), drawn and hidden (`idle`), or left out and hidden (`left`). `views`: the answer in
    each view that it is for. `again`: (k,) bool, drawn in the frame before too. `pairs`: (m, 2)
    int32, a unit that was left out and an object that loses samples by it, `NO_UNIT` where what is
    lost is in no unit."""

    answer: Answer
    pairs: Int32
    views: tuple[At, ...]
    ids: Int32
    lost: Bool
    good: Bool
    idle: Bool
    left: Bool
    again: Bool

    @cached_property
    def boxes(self) -> Bool:
        """(k,) bool: the right test of boxes keeps it, in some view."""
        return some(np.stack([kept_by_depth(at, at.boxes) for at in self.views]), 0)

    def kept(self, hypothesis: Hypothesis) -> Bool | None:
        """(k,) bool: kept in some view that the answer is for."""
        told = [(at, hypothesis.tell(at)) for at in self.views]
        if all(kept is None for _, kept in told):
            return None
        result = np.zeros(len(self.ids), np.bool_)
        for at, kept in told:
            result |= at.now.seen[at.ids] if kept is None else kept
        return result

    def value(self, fit: Fit) -> Float64:
        values = [fit.value(at) for at in self.views]
        return np.asarray(np.max(values, axis=0) if fit.below else np.min(values, axis=0))


@dataclass(frozen=True, eq=False)
class Tried:
    """What a hypothesis says of all units that were looked at: (k,) bool, which it would leave
    out."""

    hypothesis: Hypothesis
    culled: Bool


class Weighed:
    """Hypotheses about one culler's answers, and which of them are likely."""

    def __init__(
        self,
        hypotheses: Sequence[Hypothesis],
        looked: Sequence[Looked],
        clean: Sequence[Looked],
    ) -> None:
        self._looked, self._every = looked, [*looked, *clean]
        self.told = _told(looked, clean)
        # An answer at a time, as its pictures are kept for a while only.
        by_answer = [[one.kept(each) for each in hypotheses] for one in self._every]
        of_each = zip(*by_answer, strict=True) if by_answer else ()
        tried = [*map(self._tried, hypotheses, of_each), *map(self._tried_now, self._volumes())]
        told = [one for one in tried if one is not None]
        told += self._of_some(told)
        self.tried = [*told, *self._and_hidden(told)]

    def _of_some(self, tried: Sequence[Tried]) -> list[Tried]:
        """Those that are wrong about some units, about the others only."""
        if not self.told.lost.any():
            return []
        frames = np.concatenate([np.full(len(one.ids), one.answer.frame) for one in self._every])
        units = np.concatenate([one.ids for one in self._every]).astype(np.int64)
        applied = Applied(frames, units, self._kinds())
        found = []
        for one in tried:
            if one.hypothesis.fact or one.hypothesis.many or one.hypothesis.fitted:
                continue
            right, wrong = one.culled & self.told.lost, one.culled & self.told.good
            where = applied.found(right, wrong) if wrong.any() else None
            if where is None:
                continue
            here = applied.here(where)
            if self._tells(one.culled & here, here):
                restricted = applied.restricted(one.hypothesis, where)
                found.append(Tried(restricted, one.culled & here))
        return found

    def _tells(self, culled: Bool, here: Bool) -> bool:
        """Whether it tells what is lost from what is drawn among the units that it is about: what
        says no more than that these get lost says nothing."""
        lost, good = here & self.told.lost, here & self.told.good
        right, wrong = (int(np.count_nonzero(culled & one)) for one in (lost, good))
        every = int(np.count_nonzero(lost)), int(np.count_nonzero(good))
        return right > 0 and odds(right, wrong, every[0], sum(every)) >= ODDS

    def _kinds(self) -> Int64:
        """(u,) of each unit the kind that its object is of, by its name."""
        at = self._every[0].views[0]
        every = replace(at, ids=np.arange(at.sights.units.count, dtype=np.int32))
        objects = every.objects()
        kinds = kinds_of(at.scene)
        nobody = int(kinds.max(initial=-1)) + 1
        return np.where(objects >= 0, kinds[np.maximum(objects, 0)] if len(kinds) else 0, nobody)

    def _and_hidden(self, tried: Sequence[Tried]) -> list[Tried]:
        """Those about the view alone, of a culler that leaves out what is hidden too."""
        told = self.told
        if not (told.left & ~told.boxes).any():
            return []
        return [
            Tried(and_hidden(one.hypothesis), one.culled | ~told.boxes)
            for one in tried
            if not (one.hypothesis.depth or one.hypothesis.answer or one.hypothesis.fact)
        ]

    def _volumes(self) -> list[Hypothesis]:
        if not self.told.lost.any():
            return []
        count = self._every[0].views[0].sights.units.count
        return [
            *fitted_volumes(self._every, count),
            *displaced(self._every, count),
            *cut_off(self._every),
        ]

    def _tried_now(self, hypothesis: Hypothesis) -> Tried | None:
        return self._tried(hypothesis, [one.kept(hypothesis) for one in self._every])

    def _tried(self, hypothesis: Hypothesis, kept: Sequence[Bool | None]) -> Tried | None:
        """`kept`: what it keeps of each answer. None where it says nothing of what was lost."""
        if all(one is None for one in kept):
            return None
        culled = np.concatenate(
            [
                np.zeros(len(one.ids), np.bool_) if flags is None else ~flags
                for one, flags in zip(self._every, kept, strict=True)
            ]
        )
        return Tried(hypothesis, culled) if (culled & self.told.lost).any() else None

    def fits(self, open_: Bool) -> list[Tried]:
        """Hypotheses with a number in them that is chosen to fit, for all units or for those alone
        that get lost at some time."""
        lost, good = open_[self.told.lossy], self.told.good[self.told.lossy]
        ids = np.concatenate([one.ids for one in self._looked])
        ever = np.zeros(int(ids.max(initial=-1)) + 1, np.bool_)
        ever[ids[lost]] = True
        found = []
        for fit in FITS:
            values = np.concatenate([one.value(fit) for one in self._looked])
            for only in (None, ever):
                told = good if only is None else good & only[ids]
                limit = threshold(values, lost, told, fit.below)
                if limit is not None:
                    tried = self._tried_now(_fitted(fit, limit, only))
                    found += [] if tried is None else [tried]
        return [*found, *self._and_hidden(found)]

    def candidates(self, open_: Bool) -> list[Tried]:
        """Those that explain enough."""
        least = LEAST * np.count_nonzero(self.told.lost)
        able = [
            one
            for one in (*self.tried, *self.fits(open_))
            if np.count_nonzero(one.culled & open_) >= least
        ]
        return [one for one in able if one.hypothesis.cause not in LAST] or able

    def likely(self, open_: Bool, known: Sequence[str] = ()) -> list[Tried]:
        """The causes that explain what is open, one hypothesis each, the likeliest first; none if
        it might be any of many. `known`: causes that are found already."""
        best: dict[str, tuple[float, Tried]] = {}
        for one in self.candidates(open_):
            cause = one.hypothesis.cause
            value = worth(features(one.hypothesis, one.culled, self.told, open_))
            if cause not in known and (cause not in best or value > best[cause][0]):
                best[cause] = value, one
        if not best:
            return []
        return self._likely(best, open_) or self._facts(open_, known)

    def _facts(self, open_: Bool, known: Sequence[str]) -> list[Tried]:
        """What is so, where no more can be said."""
        least = LEAST * np.count_nonzero(self.told.lost)
        able = [
            one
            for one in self.tried
            if one.hypothesis.cause in LAST
            and one.hypothesis.cause not in known
            and np.count_nonzero(one.culled & open_) >= least
        ]
        return able[:1]

    def _likely(self, best: Mapping[str, tuple[float, Tried]], open_: Bool) -> list[Tried]:
        """Of the causes that explain enough, each with its worth."""
        if np.count_nonzero(open_) < TELLING:
            return self._ordinary([one for _, one in best.values()], open_)
        ranked = sorted(best.values(), key=lambda found: -found[0])
        likely = likelihoods(np.array([value for value, _ in ranked]))
        among = likely[:-1][:NAMED]
        enough = np.flatnonzero(np.cumsum(among) >= LIKELY)
        if not len(enough):
            return []
        wanted = (np.arange(len(among)) <= enough[0]) | (among >= NEARLY * among[0])
        named = np.flatnonzero(wanted).tolist()
        first = ranked[named[0]][1]
        able = np.flatnonzero(likely[:-1] >= FAR_LESS * likely[0]).tolist()
        others = [i for i in able if i >= NAMED or not wanted[i]]
        named += [i for i in others if self._alike(ranked[i][1], first)]
        left = [i for i in named[:NAMED] if self._may_be_named(ranked[i][1], open_)]
        # Where the likeliest cannot be named, no less likely one stands in for it.
        return [ranked[i][1] for i in left] if likely[left].sum() >= LIKELY else []

    def _may_be_named(self, tried: Tried, open_: Bool) -> bool:
        return self._explains(tried, open_) and self._no_chance(tried, open_)

    def _explains(self, tried: Tried, open_: Bool) -> bool:
        """Whether it explains more of what is open than it would have left out besides."""
        right = np.count_nonzero(tried.culled & open_)
        return bool(right > np.count_nonzero(tried.culled & self.told.good & self.told.lossy))

    def _alike(self, one: Tried, other: Tried) -> bool:
        """Whether they leave out nearly the same of what shows, where something was lost."""
        shows = self.told.lost | (self.told.good & self.told.lossy)
        both = np.count_nonzero(one.culled & other.culled & shows)
        return bool(both >= ALIKE * np.count_nonzero((one.culled | other.culled) & shows))

    def _ordinary(self, tried: Sequence[Tried], open_: Bool) -> list[Tried]:
        """Of one miss or two all hypotheses say alike that explain them and are wrong about
        nothing: the ordinary are named."""
        told = self.told
        able = [
            one
            for one in tried
            if (one.culled | ~open_).all() and not (one.culled & told.good).any()
        ]
        able.sort(key=lambda one: (one.hypothesis.odd, CAUSES.index(one.hypothesis.cause)))
        return able[:NAMED]

    def _no_chance(self, tried: Tried, open_: Bool) -> bool:
        """Where few were lost, one of so many hypotheses picks them by chance: there it has to
        be unlikely, or to explain all and be wrong about nothing."""
        told = self.told
        lost, good = int(np.count_nonzero(open_)), int(np.count_nonzero(told.good & told.lossy))
        right = int(np.count_nonzero(tried.culled & open_))
        wrong = int(np.count_nonzero(tried.culled & told.good & told.lossy))
        if lost >= FEW_LOST or (right == lost and not wrong):
            return True
        return odds(right, wrong, lost, lost + good) >= UNLIKELY

    def chosen(self, tried: Tried) -> Chosen:
        """With its score: of all that was lost what it explains, less what it would have left out
        besides."""
        right = int(np.count_nonzero(tried.culled & self.told.lost))
        wrong = int(np.count_nonzero(tried.culled & self.told.good & self.told.lossy))
        score = (right - wrong) / max(int(np.count_nonzero(self.told.lost)), 1)
        return Chosen(tried.hypothesis, max(float(score), 0.0))


def _told(looked: Sequence[Looked], clean: Sequence[Looked]) -> Told:
    every = [*looked, *clean]

    def all_of(of: Callable[[Looked], Bool]) -> Bool:
        return np.concatenate([np.zeros(0, np.bool_), *map(of, every)])

    return Told(
        lost=all_of(lambda one: one.lost),
        good=all_of(lambda one: one.good),
        idle=all_of(lambda one: one.idle),
        left=all_of(lambda one: one.left),
        again=all_of(lambda one: one.again),
        boxes=all_of(lambda one: one.boxes),
        small=all_of(lambda one: one.views[0].too_small),
        lossy=all_of(lambda one: np.full(len(one.ids), bool(one.answer.loses))),
    )


@dataclass(frozen=True)
class Chosen:
    """A hypothesis that explains some misses, its score, and others that may explain them."""

    hypothesis: Hypothesis
    score: float
    others: tuple[Chosen, ...] = ()


def _fitted(fit: Fit, limit: float, only: Bool | None = None) -> Hypothesis:
    """`only`: (u,) bool, the units that it is about, None for all."""

    def tell(at: At) -> Bool:
        values = fit.value(at)
        kept: Bool = values >= limit if fit.below else values <= limit
        return kept if only is None else kept | ~_flags(only, at.ids)

    found = Hypothesis(fit.cause, f"{fit.variant} {limit:.6g}", tell, odd=True, fitted=True)
    return found if only is None else found.of_some(tell)


def _flags(flags: Bool, ids: Int32) -> Bool:
    """(k,) of (u,) flags, none beyond their end."""
    known = ids < len(flags)
    return known & flags[np.minimum(ids, max(len(flags) - 1, 0))]
