"""The third of the catalogue that is kept back until the causes are done with.

What is drawn is a mistake, with all its variants and scenes, so that none of what is kept back is
met before. The lot is drawn within each part that mistakes come from (a suite of mutants, a kind of
wrong cullers), from their sorted names, by a generator with a fixed seed.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from functools import cache

import numpy as np

from tests.causes.catalogue import FAULTS
from tests.causes.fault import Fault

SEED = 17
# Parts, and mistakes, that were written once the causes were done: all of them are kept back, and
# the lot of the others stays what it was.
LATER = frozenset(
    {
        "mutant/hzb",
        "mutant/chc",
        "mutant/masked",
        "mutant/three_pass/TilesInTheOrderOfTheirHalves",
        "mutant/three_pass/TriangleIdsOfTheTiledScene",
        "reported",
        "spare",
        "later",
        "recent",
        "newest",
    }
)


def part_of(mistake: str) -> str:
    """What the lot is drawn within: all but the last of a mistake's name."""
    return mistake.rpartition("/")[0]


def is_later(mistake: str) -> bool:
    """Whether it was written once the causes were done."""
    return mistake in LATER or part_of(mistake) in LATER


def drawn(faults: Iterable[Fault], seed: int = SEED) -> frozenset[str]:
    """Names of the faults that are kept back, whatever the order they come in."""
    faults = list(faults)
    later = {fault.mistake for fault in faults if is_later(fault.mistake)}
    parts: dict[str, set[str]] = defaultdict(set)
    for fault in faults:
        if fault.mistake in later:
            continue
        parts[part_of(fault.mistake)].add(fault.mistake)
    rng = np.random.Generator(np.random.PCG64(seed))
    chosen: set[str] = set()
    for _, mistakes in sorted(parts.items()):
        ordered = sorted(mistakes)
        picked = rng.permutation(len(ordered))[: round(len(ordered) / 3)]
        chosen |= {ordered[at] for at in picked}
    chosen |= later
    return frozenset(fault.name for fault in faults if fault.mistake in chosen)


@cache
def kept_back() -> frozenset[str]:
    """Names of the faults of the catalogue that are kept back."""
    return drawn(FAULTS.values())


KEPT_BACK = kept_back()
