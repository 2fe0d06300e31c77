"""How much speaks for a hypothesis: a weighed sum of what it explains and what it gets wrong.

A culler that errs draws less than it should, or more; what a hypothesis says is held against all
of that, and against what was drawn in the frame before too, which many cullers draw unasked. What
each of these counts for is not known beforehand: the weights are those by which the right causes
of the known faults of `tests.causes` come out likeliest (`python -m tests.causes.weights` finds
them, without the third that is kept back).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.causes.sights import Hypothesis
from visref.judging.causes import CODES
from visref.scene import Float64

Bool = NDArray[np.bool_]

# By feature, in the order of `features`; the last is how much speaks for none of all causes.
WEIGHTS = {
    "explained": 4.49,
    "wrong": 0.20,
    "wrong, new": -1.34,
    "wrong, drawn again": -0.71,
    "wrong elsewhere, new": -1.22,
    "wrong elsewhere, drawn again": -1.12,
    "hidden and drawn, new": -1.01,
    "hidden and drawn, drawn again": -0.48,
    "hidden by its box and drawn": 0.77,
    "hidden by its box, left out and kept": 0.01,
    "hidden, left out": 2.43,
    "about depth": 0.10,
    "an answer": 0.03,
    "odd": -1.79,
    "own depth too": -1.27,
    "fitted": -0.87,
    "of some": -2.36,
    "each answer's own": -1.79,
    "place in the order": -1.11,
    "how many wrong": -2.23,
    "sweeping": -0.62,
    "special": 2.64,
    "its box is too small": 0.97,
    "its box is too small, others' are not": 0.20,
    "a fact": 0.16,
    "information": 0.31,
    "all and nothing else": 0.37,
    "all and nothing else that is new": 0.90,
    "none": 4.39,
}
_WEIGHTS = np.array(list(WEIGHTS.values()))
# Of a few units less is believed.
FEW = 4
# So much information is as good as any, in nats.
MOST_TOLD = 40.0
# Causes that say that a box does not hold its object.
OF_BOXES = frozenset({"bounds-too-small", "rest-pose", "old-pose"})
# So many times as many as are explained is as wrong as can be.
MOST_WRONG = 2.0
_ORDER = {cause: place / len(CODES) for place, cause in enumerate(CODES)}


@dataclass(frozen=True, eq=False)
class Told:
    """All units that were looked at, those of answers with misses first: (k,) bool each. `lost`,
    `good` (it shows and was drawn), `idle` (drawn and hidden), `left` (left out and hidden),
    `again` (drawn in the frame before too), `boxes` (the right test of boxes keeps it), `small`
    (the culler's own box was found not to hold it), and `lossy`, of an answer that lost
    something."""

    lost: Bool
    good: Bool
    idle: Bool
    left: Bool
    again: Bool
    boxes: Bool
    small: Bool
    lossy: Bool


def features(hypothesis: Hypothesis, culled: Bool, told: Told, open_: Bool) -> Float64:
    """What speaks for a hypothesis and against it, as in `WEIGHTS`. `culled`: (k,) bool, the units
    that it would leave out; `open_`: those lost that nothing explains so far."""
    new = ~told.again
    wrong = culled & told.good
    open_count = max(int(np.count_nonzero(open_)), 1)
    wrong_count = int(np.count_nonzero(wrong & told.lossy))
    right_count = int(np.count_nonzero(culled & open_))
    drawn = told.good & told.lossy
    small = np.count_nonzero(told.small & open_) / open_count
    others_small = np.count_nonzero(told.small & drawn) / max(int(np.count_nonzero(drawn)), 1)
    of_boxes = hypothesis.cause in OF_BOXES
    explains_all = right_count == np.count_nonzero(open_)
    return np.array(
        [
            np.count_nonzero(culled & open_) / open_count,
            min(wrong_count / open_count, MOST_WRONG),
            share(culled, told.good & told.lossy & new),
            share(culled, told.good & told.lossy & told.again),
            share(culled, told.good & ~told.lossy & new),
            share(culled, told.good & ~told.lossy & told.again),
            share(culled, told.idle & told.boxes & new),
            share(culled, told.idle & told.boxes & told.again),
            share(culled, told.idle & ~told.boxes & new),
            share(~culled, told.left & ~told.boxes),
            share(culled, told.left & told.boxes),
            hypothesis.depth,
            hypothesis.answer,
            hypothesis.odd,
            hypothesis.own,
            hypothesis.fitted,
            hypothesis.some,
            hypothesis.cut,
            _ORDER[hypothesis.cause],
            np.log1p(np.count_nonzero(wrong)) / 5.0,
            hypothesis.many,
            hypothesis.special,
            of_boxes * small,
            of_boxes * small * (1.0 - others_small),
            hypothesis.fact,
            information(
                right_count, wrong_count, int(np.count_nonzero(open_)), int(np.count_nonzero(drawn))
            )
            / 10.0,
            explains_all and not wrong_count,
            explains_all and not (wrong & told.lossy & new).any(),
        ],
        np.float64,
    )


def share(flags: Bool, of: Bool) -> float:
    return float(np.count_nonzero(flags & of) / (np.count_nonzero(of) + FEW))


def information(right: int, wrong: int, lost: int, drawn: int) -> float:
    """By how many nats, up to `MOST_TOLD`, it is told better which of `lost` and `drawn` units are
    lost, if it is told of each whether it is among `right` lost and `wrong` drawn ones."""
    every = lost + drawn
    taken, kept = right + wrong, every - right - wrong
    before = every * _doubt(lost / max(every, 1))
    after = taken * _doubt((right + 0.5) / (taken + 1))
    after += kept * _doubt((lost - right + 0.5) / (kept + 1))
    return float(np.clip(before - after, 0.0, MOST_TOLD))


def _doubt(share: float) -> float:
    """The entropy of yes and no, in nats."""
    inside = min(max(share, 1e-9), 1.0 - 1e-9)
    return float(-inside * np.log(inside) - (1.0 - inside) * np.log1p(-inside))


def worth(values: Float64) -> float:
    """Of `features`: the more, the likelier."""
    return float(values @ _WEIGHTS[:-1])


def likelihoods(worths: Float64, none: float = WEIGHTS["none"]) -> Float64:
    """(k + 1,) which add up to one, of (k,) worths of causes, and of none of them, the last."""
    every = np.append(worths, none)
    raised = np.exp(every - every.max())
    return np.asarray(raised / raised.sum())
