"""What a culler draws of what is not there: it is left out of account."""

from __future__ import annotations

import numpy as np

from visref.culler import DrawnSet
from visref.judging.holders import Holders
from visref.scene import Int32, Scene


def without_absent(scene: Scene, holders: Holders, drawn: DrawnSet) -> tuple[DrawnSet, Int32]:
    """The drawn set less those units whose every triangle is of absent objects, and these, (k,)
    int32 ids. A unit without triangles stays, and so does one of which a part is there."""
    ids = drawn.unit_ids
    none: Int32 = np.zeros(0, np.int32)
    if scene.absent is None or not scene.absent.any() or not len(ids):
        return drawn, none
    gone = (holders.units.sizes[ids] > 0) & (holders.sizes_there(scene)[ids] == 0)
    if not gone.any():
        return drawn, none
    asked_at = drawn.asked_at
    if asked_at is not None:
        # How many had been drawn by then, of those that stay.
        before = np.concatenate([[0], np.cumsum(~gone)])
        asked_at = np.where(asked_at < 0, -1, before[asked_at])[~gone].astype(np.int32)
    return DrawnSet(ids[~gone], drawn.stats, asked_at, drawn.ordered), ids[gone]
