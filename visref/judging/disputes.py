"""Where a drawn set contradicts the truth, and what exact arithmetic says there.

`find_disputes` lists the samples that a drawn set fails to show. `decide` decides each of them
exactly, so that a float32 engine's slips convict nobody. Only disputes pay: a frame in which
every owner was drawn costs nothing here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from visref import kernels
from visref.exact import ExactScene, Owners
from visref.scene import Alpha, Int64, Scene
from visref.visibility import (
    BACKGROUND,
    BlendVisibility,
    FrameTruth,
    Ties,
    VisibilityBuffer,
)


@dataclass(frozen=True, eq=False)
class Disputes:
    """Samples whose known owners were all left out (flat, ascending), and blended objects
    that are seen by the truth but not drawn."""

    samples: Int64
    blended: NDArray[np.int32]

    def __bool__(self) -> bool:
        return bool(len(self.samples) or len(self.blended))


@dataclass(frozen=True, eq=False)
class Rulings:
    """Exact answers at the disputed samples.

    `samples`: (k,) int64 flat, ascending; `owners`: all triangles at the nearest depth of
    each. `blend`: all blended objects' exact visibility, None if none was disputed.
    `undecided`: those of the samples, ascending, where exact arithmetic finds a masked triangle
    at or before the owner, whatever the engine saw.
    `corrections`: how many samples the engine had given to a wrong owner.
    `within_raster`: objects that the rasteriser may have lost by itself. `best_sample` and
    `margins` (pixels, relative depth) belong to missed objects.
    """

    samples: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    owners: Owners | None = None
    blend: BlendVisibility | None = None
    undecided: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    corrections: int = 0
    within_raster: frozenset[int] = frozenset()
    best_sample: Mapping[int, int] = field(default_factory=dict)
    margins: Mapping[int, tuple[float, float]] = field(default_factory=dict)


def find_disputes(truth: FrameTruth, scene: Scene, drawn: NDArray[np.bool_]) -> Disputes:
    """The samples and blended objects that `drawn` ((t,) bool) fails to show."""
    samples = kernels.undrawn_samples(truth.buffer.triangle.reshape(-1), truth.decided, drawn)
    ties = truth.ties
    if len(ties.sample) and len(samples):
        samples = np.setdiff1d(samples, ties.sample[drawn[ties.triangle]])
    blended = [o for o in truth.blend.object if not drawn[blended_triangles(scene, int(o))].any()]
    return Disputes(samples, np.array(blended, np.int32))


def decide(exact: ExactScene, truth: FrameTruth, disputes: Disputes) -> Rulings:
    """Every dispute, decided in exact arithmetic. Clears misses, never finds new ones where the
    engine saw nothing amiss. An exact truth has nothing left to decide."""
    if truth.ties_complete:
        return Rulings()
    scene, camera, samples = exact.scene, truth.camera, disputes.samples
    owners, corrections = None, 0
    if len(samples):
        owners = exact.decide(camera, samples, include=scene.alpha == Alpha.OPAQUE)
        corrections = _corrections(truth, samples, owners)
    blend, undecided = None, samples[:0]
    if len(disputes.blended) or (scene.has_mask and len(samples)):
        # Rare enough that a whole frame may be certified.
        certified = exact.certify(camera)
        blend = certified.blend if len(disputes.blended) else None
        undecided = np.intersect1d(certified.undecided, samples)
    return Rulings(samples, owners, blend, undecided, corrections)


def corrected(truth: FrameTruth, rulings: Rulings) -> FrameTruth:
    """The truth with the rulings' owners in place of the engine's."""
    blend = truth.blend if rulings.blend is None else rulings.blend
    if rulings.owners is None:
        return truth if blend is truth.blend else replace(truth, blend=blend)
    owners = rulings.owners
    counts = np.diff(owners.offsets)
    first = np.full(len(counts), BACKGROUND, np.int32)
    first[counts > 0] = owners.triangles[owners.offsets[:-1][counts > 0]]
    shape = truth.buffer.triangle.shape
    triangle, depth = (
        truth.buffer.triangle.reshape(-1).copy(),
        truth.buffer.depth.reshape(-1).copy(),
    )
    triangle[rulings.samples], depth[rulings.samples] = first, owners.depth
    further = np.ones(len(owners.triangles), np.bool_)
    further[owners.offsets[:-1][counts > 0]] = False
    tie_sample = np.repeat(rulings.samples, counts)[further]
    tie_triangle = owners.triangles[further]
    kept = ~np.isin(truth.ties.sample, rulings.samples)
    tie_sample = np.concatenate([truth.ties.sample[kept], tie_sample])
    tie_triangle = np.concatenate([truth.ties.triangle[kept], tie_triangle])
    order = np.lexsort((tie_triangle, tie_sample))
    return replace(
        truth,
        buffer=VisibilityBuffer(triangle.reshape(shape), depth.reshape(shape)),
        ties=Ties(tie_sample[order], tie_triangle[order]),
        undecided=np.union1d(truth.undecided, rulings.undecided),
        blend=blend,
    )


def blended_triangles(scene: Scene, object_id: int) -> NDArray[np.int64]:
    """The ids of an object's BLEND triangles."""
    low, high = scene.object_offsets[object_id : object_id + 2]
    blended: NDArray[np.int64] = low + np.flatnonzero(scene.alpha[low:high] == Alpha.BLEND)
    return blended


def _corrections(truth: FrameTruth, samples: Int64, owners: Owners) -> int:
    """Samples at which the engine's owner is not among the exact owners."""
    engine = truth.buffer.triangle.reshape(-1)[samples]
    counts = np.diff(owners.offsets)
    right = np.zeros(len(samples), np.bool_)
    index = np.repeat(np.arange(len(samples)), counts)
    np.logical_or.at(right, index, owners.triangles == engine[index])
    return int(np.count_nonzero(~right))
