"""Mistakes that are made about some objects only: one kind of thing, or one whose asset is wrong.

Which objects these are, nobody says. A hypothesis that would leave out much of what was drawn may
still be right about some units. So of each unit it is asked whether the hypothesis was right about
it in other parts of the run, and where these say nothing, whether it was about units of its kind;
only there is it held to apply. As a unit's own answers are never asked about themselves, it cannot
fit by chance.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.causes.sights import At, Hypothesis
from visref.scene import Int64, Scene

Bool = NDArray[np.bool_]

# What a unit is asked about is left out, so many parts of the run one by one.
PARTS = 6
# What its kind tells of a unit counts as so many of its own answers.
COMMON = 1.5


def kinds_of(scene: Scene) -> Int64:
    """(n,) a number per object, the same for objects whose names differ in digits alone."""
    stems = [re.sub(r"\d+.*", "", name) for name in scene.given_names]
    number = {stem: place for place, stem in enumerate(dict.fromkeys(stems))}
    return np.array([number[stem] for stem in stems], np.int64)


@dataclass(frozen=True, eq=False)
class Where:
    """Where a hypothesis applies: (PARTS + 1, u) bool by part of the run and unit that was looked
    at, the last row for other frames; (PARTS + 1, kinds) bool, what holds of other units of a kind.
    """

    units: Bool
    kinds: Bool


class Applied:
    """Finds where hypotheses apply."""

    def __init__(self, frames: Int64, units: Int64, kinds: Int64) -> None:
        """What was looked at: (k,) frames and units; `kinds`: (n,) of each unit that there is, what
        kind it is of."""
        every = np.unique(frames).tolist()
        self._part_of = {frame: i * PARTS // len(every) for i, frame in enumerate(every)}
        self._parts = np.array([self._part_of[frame] for frame in frames.tolist()], np.int64)
        self._known, self._place = np.unique(units, return_inverse=True)
        self._kinds = kinds

    def here(self, where: Where) -> Bool:
        """(k,) whether it applies to what was looked at."""
        found: Bool = where.units[self._parts, self._place]
        return found

    def found(self, right: Bool, wrong: Bool) -> Where | None:
        """From (k,) flags of what the hypothesis would leave out: rightly, as it was lost, or
        wrongly. None if it applies to all of these units or to none."""
        shape = PARTS, len(self._known)
        net, told = np.zeros(shape), np.zeros(shape)
        np.add.at(net, (self._parts, self._place), right.astype(float) - wrong.astype(float))
        np.add.at(told, (self._parts, self._place), (right | wrong).astype(float))
        kinds, of = int(self._kinds.max(initial=0)) + 1, self._kinds[self._known]
        # Of each part what the others tell, and of other frames what all do.
        net_of, told_of = (
            np.concatenate([one.sum(axis=0) - one, one.sum(axis=0)[None]]) for one in (net, told)
        )
        mean = np.zeros((PARTS + 1, kinds))
        for part in range(PARTS + 1):
            asked = np.bincount(of, told_of[part], minlength=kinds)
            total = np.bincount(of, net_of[part], minlength=kinds)
            np.divide(total, asked, out=mean[part], where=asked > 0)
        units = net_of + COMMON * mean[:, of] > 0
        touched = told.any(axis=0)
        if units[:, touched].all() or not units.any():
            return None
        return Where(units, mean > 0)

    def restricted(self, hypothesis: Hypothesis, where: Where) -> Hypothesis:
        """The hypothesis, where it applies."""

        def tell(at: At) -> Bool | None:
            kept = hypothesis.tell(at)
            if kept is None:
                return None
            part = self._part_of.get(at.frame, PARTS)
            place = np.minimum(np.searchsorted(self._known, at.ids), len(self._known) - 1)
            here = where.kinds[part, self._kinds[at.ids]]
            known = self._known[place] == at.ids
            here[known] = where.units[part, place[known]]
            found: Bool = kept | ~here
            return found

        return hypothesis.of_some(tell)
