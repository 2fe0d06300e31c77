"""What the verdict on one drawn set rests on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.judging.disputes import Rulings
from visref.judging.superfluous import Superfluous, superfluous_units
from visref.judging.walk import SampleWalk
from visref.picking import distinct
from visref.scene import Int32, Int64, Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility


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
