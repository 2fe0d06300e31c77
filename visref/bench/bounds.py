"""How much of an image may still show what nobody has seen: a bound that holds.

Freeze the set of objects found so far, then cast M fresh rays, uniform over the image. Let p be
the share of the image in which a ray would meet an object outside that set, and k how many of the
M did. If no ray did, p is at most 1 - alpha^(1/M) (about 3.0 / M at 95 %), because a greater
p gives k = 0 with probability (1 - p)^M < alpha. Else p is at most Clopper and Pearson's upper
limit (1934): the p at which P(Binomial(M, p) <= k) = alpha.

The rays may be *stratified* (one in each pixel, at random in it): by the inequality of the
means prod(1 - p_i) <= (1 - mean p_i)^M, so k = 0 is rarer still. For k > 0 the number of hits is
a sum of independent Bernoullis, and Hoeffding (1956, theorem 4) has P(sum <= k) <=
P(Binomial(M, p) <= k) as long as k <= M p - 1, which holds at the limit: there M p > k + 1.

What is bounded is a share of one frame's image, never a number of objects. Whoever looks several
times splits alpha among the looks.
"""

from __future__ import annotations

import math

import numpy as np

from visref.scene import Int64

ALPHA = 0.05


def unseen_share_bound(new: int, rays: int, alpha: float = ALPHA) -> float:
    """The one-sided 1 - alpha upper bound of the share, from `new` hits among `rays`."""
    if not 0 <= new <= rays or rays < 1 or not 0.0 < alpha < 1.0:
        raise ValueError(f"{new} of {rays} rays at alpha {alpha}")
    if new == rays:
        return 1.0
    if new == 0:
        return -math.expm1(math.log(alpha) / rays)
    hits = np.arange(new + 1, dtype=np.float64)
    ways = np.cumsum(np.log((rays - hits[1:] + 1.0) / hits[1:]))
    log_ways = np.concatenate([[0.0], ways])
    low, high = new / rays, 1.0
    # To the last bits; of the two ends the upper. Outward: too large a bound is still one.
    while high - low > 1e-12 * high:
        p = 0.5 * (low + high)
        terms = log_ways + hits * math.log(p) + (rays - hits) * math.log1p(-p)
        top = float(terms.max())
        if top + math.log(float(np.exp(terms - top).sum())) > math.log(alpha):
            low = p
        else:
            high = p
    return high


def good_turing(hits: Int64) -> float:
    """Good and Turing's *estimate* of the share (1953): objects hit exactly once, over all rays
    that hit anything or nothing. `hits`: (n + 1,) rays by object, the last for none."""
    total = int(hits.sum())
    return int(np.count_nonzero(hits[:-1] == 1)) / total if total else 1.0
