"""One culler's frame, settled: disputes decided, the truth corrected, its samples walked over.

Each of these is computed once here, and the judge, the pictures and the records all use it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.culler import Raster
from visref.exact import ExactScene
from visref.judging.disputes import Rulings, corrected, decide, find_disputes
from visref.judging.margins import with_margins
from visref.judging.walk import SampleWalk, walk_samples
from visref.scene import Int64, Scene
from visref.visibility import FrameTruth, ObjectVisibility, objects_seen


@dataclass(frozen=True, eq=False)
class SettledFrame:
    """What the verdict on one drawn set rests on.

    `truth`: the corrected one. `seen`: who is visible by it. `drawn`: (t,) bool. `walk`: what
    `drawn` shows and loses of each object. `rulings`: what exact arithmetic said.
    """

    scene: Scene
    truth: FrameTruth
    seen: ObjectVisibility
    drawn: NDArray[np.bool_]
    walk: SampleWalk
    rulings: Rulings

    @cached_property
    def lost_samples(self) -> Int64:
        """Flat indices, ascending, of the decided samples at which nothing at the nearest depth
        was drawn."""
        if not self.walk.missed_pixels:
            return np.zeros(0, np.int64)
        return find_disputes(self.truth, self.scene, self.drawn).samples


def settle(
    scene: Scene,
    truth: FrameTruth,
    drawn: NDArray[np.bool_],
    *,
    exact: Callable[[], ExactScene],
    raster: Raster | None = None,
    seen: ObjectVisibility | None = None,
) -> SettledFrame:
    """Decide every dispute between a truth and `drawn`, (t,) bool.

    `exact` is asked only if there is any. `raster`: the rasteriser behind the culler's depth
    buffer, None if it has none. `seen`: `objects_seen` of `truth`, where it is known.
    """
    disputes = find_disputes(truth, scene, drawn)
    if not disputes:
        return with_rulings(scene, truth, drawn, Rulings(), seen=seen)
    frame = with_rulings(scene, truth, drawn, decide(exact(), truth, disputes), seen=seen)
    rulings = with_margins(exact(), frame.truth, frame.walk, disputes, raster, frame.rulings)
    return replace(frame, rulings=rulings)


def with_rulings(
    scene: Scene,
    truth: FrameTruth,
    drawn: NDArray[np.bool_],
    rulings: Rulings,
    *,
    seen: ObjectVisibility | None = None,
) -> SettledFrame:
    """The frame settled by these rulings."""
    right = corrected(truth, rulings)
    if seen is None or right is not truth:
        seen = objects_seen(right, scene)
    return SettledFrame(scene, right, seen, drawn, walk_samples(right, scene, drawn), rulings)
