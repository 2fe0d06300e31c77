"""Mistakes that are made about some objects only: one kind of thing, or one whose asset is wrong.

Which objects these are, nobody says. A hypothesis that would leave out much of what was drawn may
still be right about some units. So of each unit it is asked whether the hypothesis was right about
it in other parts of the run, and where these say nothing, whether it was about units of its kind;
only there is it held to apply. As a unit's own answers are never asked about themselves, it cannot
fit by chance.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from visref.causes.sights import At, Hypothesis
from visref.scene import Float64, Int64, Scene

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


class Applied:
    """Where a hypothesis applies, by part of the run and unit."""

    def __init__(self, part_of: dict[int, int], kinds: Int64) -> None:
        """`part_of`: by frame; `kinds`: (u,) what kind each unit is of."""
        self._part_of, self._kinds = part_of, kinds

    @classmethod
    def over(cls, frames: Sequence[int], kinds: Int64) -> Applied:
        every = sorted(set(frames))
        return cls({frame: i * PARTS // len(every) for i, frame in enumerate(every)}, kinds)

    def parts(self, frames: Int64) -> Int64:
        """(k,) the part of each frame, the last row for one of none."""
        return np.array([self._part_of.get(frame, PARTS) for frame in frames.tolist()], np.int64)

    def found(self, parts: Int64, units: Int64, right: Bool, wrong: Bool) -> Bool | None:
        """(PARTS + 1, u) bool, from (k,) what the hypothesis would leave out: rightly, as it was
        lost, or wrongly. None if it applies to all or to none."""
        count = len(self._kinds)
        net = np.zeros((PARTS, count))
        np.add.at(net, (parts, units), right.astype(float) - wrong.astype(float))
        if not net.any():
            return None
        others: Float64 = np.concatenate([net.sum(axis=0) - net, net.sum(axis=0)[None]])
        told = np.zeros((PARTS, count))
        np.add.at(told, (parts, units), (right | wrong).astype(float))
        others_told = np.concatenate([told.sum(axis=0) - told, told.sum(axis=0)[None]])
        applies = np.zeros((PARTS + 1, count), np.bool_)
        kinds = int(self._kinds.max(initial=0)) + 1
        for part in range(PARTS + 1):
            of_kind = np.bincount(self._kinds, others[part], minlength=kinds)
            asked = np.bincount(self._kinds, others_told[part], minlength=kinds)
            mean = np.divide(of_kind, asked, out=np.zeros(kinds), where=asked > 0)
            applies[part] = others[part] + COMMON * mean[self._kinds] > 0
        touched = told.any(axis=0)
        if applies[:, touched].all() or not applies.any():
            return None
        return applies

    def restricted(self, hypothesis: Hypothesis, applies: Bool) -> Hypothesis:
        def tell(at: At) -> Bool | None:
            kept = hypothesis.tell(at)
            if kept is None:
                return None
            found: Bool = kept | ~applies[self._part_of.get(at.frame, PARTS), at.ids]
            return found

        return hypothesis.of_some(tell)
