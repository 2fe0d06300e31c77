"""The hard numerical cases of visibility, each a small scene with the right verdict beside it.

The verdicts are derived by construction, in closed form, from how each scene was laid out;
no engine was asked.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from visref.errors import InputError
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.hard import objects, ranges, surfaces
from visref_datasets_gen.hard.stage import HardCase

__all__ = ["HardCase", "hard", "hard_cases"]


@cache
def hard_cases(seed: int = 0) -> tuple[HardCase, ...]:
    """All cases, in a stable order; the seed moves only the tessellated walls' vertices."""
    rng = np.random.Generator(np.random.PCG64(seed))
    return (
        *surfaces.coincidences(),
        *surfaces.junctions(),
        *surfaces.tessellations(rng),
        *surfaces.slivers(),
        *surfaces.degenerates(),
        *surfaces.soups(),
        *surfaces.enormous(),
        *ranges.offsets(),
        *ranges.planes(),
        *ranges.eyes(),
        *ranges.viewports(),
        *ranges.classics(),
        *ranges.lens_shift(),
        *objects.transforms(),
        *objects.counts(),
        *objects.not_finite(),
        *objects.motion(),
    )


def hard(*, seed: int = 0, scale: float = 1.0, frames: int | None = None) -> list[Dataset]:
    """Every case as a data set. Raises InputError for a scale or a number of frames: what a
    case is made of is what makes it hard."""
    for name, given in (("scale", scale != 1.0), ("frames", frames is not None)):
        if given:
            raise InputError(f"the hard cases have no {name}", place=name, fix="leave it out")
    return [case.dataset for case in hard_cases(seed)]
