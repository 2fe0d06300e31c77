"""Delta debugging: a few of many things that still make it fail.

Source: Zeller and Hildebrandt, Simplifying and Isolating Failure-Inducing Input, IEEE Transactions
on Software Engineering 28(2), 2002, section 3.2 (the minimizing algorithm ddmin). Departure: none
of the things is asked about first, for what fails by itself needs none of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")


def ddmin(items: Sequence[T], fails: Callable[[list[T]], bool]) -> list[T]:
    """Some of the items, in their order, of which `fails` is true and none can be left out by
    itself so that it stays true. Of all items it must be true, and is not asked; where its answers
    hang on nothing else than the items, it is asked O(n^2) times at worst, about
    2 k log2(n / k) + k^2 where k of n items are to blame."""
    if not items or fails([]):
        return []
    kept, parts = list(items), 2
    while len(kept) > 1:
        bounds = [len(kept) * k // parts for k in range(parts + 1)]
        pieces = list(pairwise(bounds))
        for low, high in pieces:
            if fails(kept[low:high]):
                kept, parts = kept[low:high], 2
                break
        else:
            # With two parts, each is the other's complement.
            for low, high in pieces if parts > 2 else []:
                rest = kept[:low] + kept[high:]
                if fails(rest):
                    kept, parts = rest, max(parts - 1, 2)
                    break
            else:
                if parts == len(kept):
                    break
                parts = min(2 * parts, len(kept))
    return kept
