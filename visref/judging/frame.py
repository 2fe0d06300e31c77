"""What the verdict on one drawn set rests on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.judging.disputes import Rulings
from visref.judging.holders import DrawList, UnitsSeen
from visref.judging.superfluous import Superfluous, superfluous_units
from visref.judging.walk import SampleWalk, nothing_lost
from visref.picking import distinct
from visref.scene import Int32, Int64, Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility


@dataclass(frozen=True, eq=False)
class SettledFrame:
    """What the verdict on one drawn set rests on.

    `truth`: the corrected one. `seen`: who is visible by it, and `units_seen` which units are.
    `draw_list`: what was drawn. `walked`: what is shown and lost of each object, None where all
    that is seen was drawn, so that nobody need look at samples. `rulings`: what exact arithmetic
    said. `confirmed`: the superfluous units that it confirmed, where the culler promises to draw
    none.
    """

    scene: Scene
    truth: FrameTruth
    seen: ObjectVisibility
    units_seen: UnitsSeen
    draw_list: DrawList
    walked: SampleWalk | None
    rulings: Rulings
    confirmed: tuple[Superfluous, ...] = ()

    @property
    def units(self) -> Units:
        """The culler's units."""
        return self.draw_list.holders.units

    @property
    def drawn_units(self) -> Int32:
        """(k,) int32, the ids of the units drawn."""
        return self.draw_list.unit_ids

    @property
    def drawn(self) -> NDArray[np.bool_]:
        """(t,) bool, the triangles drawn."""
        return self.draw_list.triangles

    @cached_property
    def walk(self) -> SampleWalk:
        """What is shown and lost of each object."""
        if self.walked is None:
            return nothing_lost(self.seen, self.scene)
        return self.walked

    @cached_property
    def superfluous(self) -> Int32:
        """The drawn units that show nowhere, ascending."""
        return superfluous_units(self.scene, self.units_seen, self.draw_list)

    @cached_property
    def lost_pairs(self) -> tuple[Int64, Int64]:
        """Every (sample, object) of a lost sample and an object that owns or shares it, sorted by
        object, then sample; glass that is seen there is not among them."""
        truth, scene, lost = self.truth, self.scene, self.walk.lost_samples
        owner = truth.buffer.triangle.reshape(-1)[lost]
        at = np.isin(truth.ties.sample, lost)
        sample = np.concatenate([lost, truth.ties.sample[at]])
        triangle = np.concatenate([owner, truth.ties.triangle[at]])
        pairs = scene.object_of_triangle[triangle].astype(np.int64) * truth.camera.samples + sample
        obj, sample = np.divmod(distinct(pairs), truth.camera.samples)
        return sample, obj
