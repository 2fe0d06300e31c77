"""A culler that is broken on purpose, so that a newcomer sees what a violation looks like."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.scene import Int64
from visref_culling.baselines import SingleQueryCulling


class HastyQueryCulling(SingleQueryCulling):
    """Draws an object only if more than a hundred samples of its box pass.

    A popular mistake: "so few pixels cannot matter". The box of a lamp post that shows through
    a gap has as few. It still declares itself conservative, and so it is convicted.
    """

    name = "hasty-query"
    summary = "broken on purpose: draws an object only if over 100 samples of its box pass"

    THRESHOLD_SAMPLES = 100

    def passes(self, counts: Int64) -> NDArray[np.bool_]:
        """(k,) bool of (k,) int64 samples, one per query: whether it means visible."""
        return counts > self.THRESHOLD_SAMPLES
