"""Limits that are each answer's own: a list that is cut off, a field of view or a range that is got
wrong by more in one frame than in another.

A limit lies between all that was drawn and shows, and what was lost beyond it. What was drawn
cannot speak against such a limit, so it is believed only if what was lost would not lie there by
chance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from visref.causes.fitted import ODDS, Fit, aside, far, log_odds, near, on_screen, samples
from visref.causes.inner import Looked
from visref.causes.sights import At, Hypothesis, Told
from visref.scene import Float64

Bool = NDArray[np.bool_]

# Of what was lost so much lies beyond the limits, at least.
MOST_OF_IT = 0.6


def number(at: At) -> Float64:
    return at.ids.astype(np.float64)


CUTS = (
    Fit("list-full", "by number", number, below=False),
    Fit("other-lens", "across and up", aside((0, 1)), below=False),
    Fit("other-lens", "across", aside((0,)), below=False),
    Fit("other-lens", "up", aside((1,)), below=False),
    Fit("far-nearer", "by depth", far, below=False),
    Fit("near-larger", "by depth", near),
    Fit("too-few-samples", "owned", samples),
    Fit("too-few-samples", "size", on_screen),
)


def beyond(values: Float64, drawn: Bool, below: bool) -> Bool:
    """(k,) which values lie beyond those of all that was drawn; none if nothing was."""
    if not drawn.any():
        return np.zeros(len(values), np.bool_)
    if below:
        return np.asarray(values < values[drawn].min())
    return np.asarray(values > values[drawn].max())


def cut_off(looked: Sequence[Looked]) -> list[Hypothesis]:
    """Those of the limits that are believed."""
    made = []
    every = [(one, one.views[0]) for one in looked if len(one.views) == 1]
    for fit in CUTS:
        told, lost, right = 0.0, 0, 0
        for one, at in every:
            if not (one.lost.any() and one.good.any()):
                continue
            past = beyond(fit.value(at), one.good, fit.below) & one.lost
            count, out = int(one.lost.sum()), int(past.sum())
            lost, right = lost + count, right + out
            told += log_odds(out, 0, count, count + int(one.good.sum())) if out else 0.0
        if right and right >= MOST_OF_IT * lost and told >= np.log(ODDS * len(CUTS)):
            made.append(_hypothesis(fit))
    return made


def _hypothesis(fit: Fit) -> Hypothesis:
    def tell(at: At) -> Told:
        now = at.sights.answers.at(at.frame, at.view)
        if now is None:
            return None
        drawn = now[at.ids] & at.now.seen[at.ids]
        return ~beyond(fit.value(at), drawn, fit.below)

    return Hypothesis(fit.cause, f"{fit.variant}, in each answer", tell, fitted=True, cut=True)
