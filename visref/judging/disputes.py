"""Where a drawn set contradicts the truth, and what exact arithmetic says there.

`find_disputes` lists the samples that a drawn set fails to show. `decide` decides each of them
exactly, so that a float32 engine's slips convict nobody. Only disputes pay: a frame in which
every owner was drawn costs nothing here.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from visref.exact import ExactScene
from visref.judging.walk import SampleWalk
from visref.scene import Float64, Int32, Int64
from visref.visibility import BlendVisibility, Doubt, FrameTruth, Ties, VisibilityBuffer


class Measured(NamedTuple):
    """How firmly objects hold a sample that they lose, the firmest that was asked for: (k,) arrays,
    by `object`, ascending. Margins are in pixels, and in relative depth."""

    object: Int64
    sample: Int64
    margin_px: Float64
    margin_depth: Float64

    @classmethod
    def none(cls) -> Measured:
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))

    def of(self, objects: Int64) -> tuple[Int64, Float64, Float64]:
        """Of each of (m,) objects the sample, -1 where none was asked for, and the margins, NaN
        there."""
        place = np.searchsorted(self.object, objects)
        known = np.flatnonzero(place < len(self.object))
        known = known[self.object[place[known]] == objects[known]]
        sample = np.full(len(objects), -1)
        margin_px, margin_depth = np.full(len(objects), np.nan), np.full(len(objects), np.nan)
        at = place[known]
        sample[known] = self.sample[at]
        margin_px[known], margin_depth[known] = self.margin_px[at], self.margin_depth[at]
        return sample, margin_px, margin_depth


@dataclass(frozen=True, eq=False)
class Rulings:
    """Exact answers at the disputed samples.

    `samples`: (k,) int64 flat, ascending; `exact`: a truth that holds at those, None where
    nothing was disputed or the truth was exact already. `corrections`: how many samples the
    engine had given to a wrong owner. `within_raster`: objects that the rasteriser may have lost
    by itself. `measured`: the margins of objects that lose samples.
    """

    samples: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    exact: FrameTruth | None = None
    corrections: int = 0
    within_raster: frozenset[int] = frozenset()
    measured: Measured = field(default_factory=lambda: Measured.none())


def find_disputes(walk: SampleWalk) -> Int64:
    """Flat indices, (k,) int64, ascending, of the samples that a drawn set fails to show in full:
    what owns them was left out, or glass that is seen there, or what a mask leaves open. The last
    are counted, not charged; whether they are open hangs on ties too."""
    lost = walk.lost_samples
    for more in (walk.lost_blended_samples, walk.undecided_samples):
        if len(more):
            lost = np.union1d(lost, more)
    return lost


def decide(exact: ExactScene, truth: FrameTruth, samples: Int64) -> Rulings:
    """Every dispute, decided in exact arithmetic. Clears misses, never finds new ones where the
    engine saw nothing amiss. An exact truth has nothing left to decide. `samples`: (k,) int64,
    flat, ascending."""
    if truth.ties_complete:
        return Rulings()
    right = exact.certify(truth.camera, samples)
    engine = truth.buffer.triangle.reshape(-1)[samples]
    same = right.buffer.triangle.reshape(-1)[samples] == engine
    pairs = right.ties.sample * len(exact.scene.triangles) + right.ties.triangle
    same |= np.isin(samples * len(exact.scene.triangles) + engine, pairs) & (engine >= 0)
    return Rulings(samples, right, int(np.count_nonzero(~same)))


def corrected(truth: FrameTruth, rulings: Rulings) -> FrameTruth:
    """The truth with the rulings' answers in place of the engine's."""
    right, samples = rulings.exact, rulings.samples
    if right is None:
        return truth
    shape = truth.buffer.triangle.shape
    triangle, depth = (
        truth.buffer.triangle.reshape(-1).copy(),
        truth.buffer.depth.reshape(-1).copy(),
    )
    triangle[samples] = right.buffer.triangle.reshape(-1)[samples]
    depth[samples] = right.buffer.depth.reshape(-1)[samples]
    tie_sample, tie_triangle = _joined(
        samples, truth.ties.sample, truth.ties.triangle, right.ties.sample, right.ties.triangle
    )
    doubt_sample, doubt_triangle = _joined(
        samples, truth.doubt.at(), truth.doubt.triangle, right.doubt.at(), right.doubt.triangle
    )
    old = truth.blend.where(~np.isin(truth.blend.sample, samples))
    new = right.blend.where(np.isin(right.blend.sample, samples))
    order = np.lexsort(
        tuple(np.concatenate([getattr(old, name), getattr(new, name)])
              for name in ("triangle", "depth", "sample", "object"))
    )  # fmt: skip
    blend = BlendVisibility(
        *(np.concatenate([getattr(old, name), getattr(new, name)])[order]
          for name in ("object", "sample", "triangle", "depth"))
    )  # fmt: skip
    return replace(
        truth,
        buffer=VisibilityBuffer(triangle.reshape(shape), depth.reshape(shape)),
        ties=Ties(tie_sample, tie_triangle),
        doubt=Doubt.of(doubt_sample, doubt_triangle),
        blend=blend,
        veiled=np.union1d(truth.veiled, right.veiled),
    )


def _joined(
    samples: Int64, old_sample: Int64, old: Int32, new_sample: Int64, new: Int32
) -> tuple[Int64, Int32]:
    """(sample, triangle) pairs, the new ones at `samples` and the old ones elsewhere, sorted by
    sample, and within one in the order they have."""
    kept, taken = ~np.isin(old_sample, samples), np.isin(new_sample, samples)
    sample = np.concatenate([old_sample[kept], new_sample[taken]])
    order = np.argsort(sample, kind="stable")
    return sample[order], np.concatenate([old[kept], new[taken]])[order]
