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
from visref.judging.superfluous import Superfluous, confirm, superfluous_units
from visref.judging.walk import SampleWalk, walk_samples
from visref.scene import Int32, Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility, objects_seen


@dataclass(frozen=True, eq=False)
class SettledFrame:
    """What the verdict on one drawn set rests on.

    `truth`: the corrected one. `seen`: who is visible by it. `drawn`: (t,) bool, the triangles
    of `drawn_units`. `walk`: what is shown and lost of each object. `rulings`: what exact
    arithmetic said. `confirmed`: the superfluous units that it confirmed, where the culler
    promises to draw none.
    """

    scene: Scene
    truth: FrameTruth
    seen: ObjectVisibility
    units: Units
    drawn_units: Int32
    drawn: NDArray[np.bool_]
    walk: SampleWalk
    rulings: Rulings
    confirmed: tuple[Superfluous, ...] = ()

    @cached_property
    def superfluous(self) -> Int32:
        """The drawn units that show nowhere, ascending."""
        return superfluous_units(self.scene, self.truth, self.units, self.drawn_units)


def settle(
    scene: Scene,
    truth: FrameTruth,
    units: Units,
    drawn_units: Int32,
    *,
    exact: Callable[[], ExactScene],
    raster: Raster | None = None,
    seen: ObjectVisibility | None = None,
    only_visible: bool = False,
) -> SettledFrame:
    """Decide every dispute between a truth and the drawn units, and ask of every loss that stays
    whether the culler's rasteriser could have lost it by itself.

    `exact` is asked only if there is any. `raster`: the rasteriser behind the culler's depth
    buffer, None if it has none. `seen`: `objects_seen` of `truth`, where it is known.
    `only_visible`: the culler promises to draw nothing hidden, so that is confirmed too.
    """
    frame = with_rulings(scene, truth, units, drawn_units, Rulings(), seen=seen)
    samples = find_disputes(frame.walk)
    if len(samples):
        rulings = decide(exact(), truth, samples)
        if rulings.exact is not None:
            frame = with_rulings(scene, truth, units, drawn_units, rulings)
        frame = replace(frame, rulings=with_margins(exact(), frame, raster))
    if only_visible and len(frame.superfluous):
        frame = replace(frame, confirmed=confirm(exact(), frame.truth, units, frame.superfluous))
    return frame


def with_rulings(
    scene: Scene,
    truth: FrameTruth,
    units: Units,
    drawn_units: Int32,
    rulings: Rulings,
    *,
    seen: ObjectVisibility | None = None,
) -> SettledFrame:
    """The frame settled by these rulings. `seen`: `objects_seen` of the corrected truth, where it
    is known."""
    right = corrected(truth, rulings)
    drawn = units.mask(drawn_units, scene.triangle_count)
    if seen is None:
        seen = objects_seen(right, scene)
    walk = walk_samples(right, scene, drawn)
    return SettledFrame(scene, right, seen, units, drawn_units, drawn, walk, rulings)
