"""A verdict from a truth on file alone, where that is enough."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from visref.judging.asking import Job
from visref.judging.judge import Counts, FrameVerdict
from visref.recordings.truth_file import FrameRows
from visref.scene import OBJECT, Int32, Scene


def clean_verdict(
    scene: Scene, rows: Sequence[FrameRows], job: Job, drawn_units: Int32
) -> FrameVerdict | None:
    """The verdict on a set from a recorded truth, `rows` of each view that the set is for, or None
    if the views must be looked at by sample.

    Enough where units are objects and every object that some view sees was drawn whole.
    """
    if scene.has_mask or job.units.kind != OBJECT:
        return None
    visible = np.unique(np.concatenate([view.objects for view in rows]))
    if not np.isin(visible, drawn_units).all():
        return None
    superfluous = np.setdiff1d(drawn_units, visible).astype(np.int32)
    superfluous = superfluous[job.units.sizes[superfluous] > 0]
    if len(superfluous) and not job.record.promise.may_draw_hidden:
        return None
    owned = [view.owned for view in rows]
    counts = Counts(
        visible=len(visible),
        owned_samples=sum(count or 0 for count in owned),
        drawn=len(drawn_units),
        superfluous=len(superfluous),
    )
    known = None if None in owned else counts.owned_samples
    return FrameVerdict(counts, superfluous_units=superfluous, owned=known)
