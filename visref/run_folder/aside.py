"""What a long run puts aside of its verdicts, so that its memory does not grow with frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from visref.judging.judge import FrameVerdict
from visref.judging.misses import MissColumns, Misses
from visref.recordings.spool import Spool

# A frame of a culler that leaves out half of a large scene; what goes beyond it goes to disk.
_IN_MEMORY = 4 << 20


class Aside:
    """Keeps misses in a file of its own, which goes with the process. The units drawn for nothing
    are not kept: whoever lists them has done so."""

    def __init__(self) -> None:
        self._spool = Spool(_IN_MEMORY)

    def __call__(self, verdict: FrameVerdict) -> FrameVerdict:
        """The verdict as a run holds it: its misses are read again by whoever looks at them."""
        none = np.zeros(0, np.int32)
        misses = verdict.misses
        if not misses:
            return replace(verdict, superfluous_units=none)
        spool, at = self._spool, self._spool.put_arrays(misses.columns)
        kept = Misses(lambda: MissColumns(*spool.get_arrays(at)), misses.views, count=len(misses))
        return replace(verdict, superfluous_units=none, misses=kept)
