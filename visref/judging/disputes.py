"""Where a drawn set contradicts the truth, and what exact arithmetic says there.

`find_disputes` lists the samples that a drawn set fails to show. `settle` decides each of
them exactly, so that a float32 engine's slips convict nobody, and asks of every object that
stays missed whether the culler's rasteriser could have lost it by itself. Only disputes pay:
a frame in which every owner was drawn costs nothing here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from visref import kernels
from visref.camera import Camera
from visref.culler import CullerError, Raster
from visref.exact import ExactScene, Owners, surviving, witness_margins
from visref.scene import Alpha, Int32, Int64, Scene
from visref.visibility import (
    BACKGROUND,
    BlendVisibility,
    FrameTruth,
    Ties,
    VisibilityBuffer,
)

# How many of a missed object's samples are asked for their margins; the best one is reported.
# Of a frame that misses hundreds of objects, fewer of each: a margin takes about a millisecond.
MARGIN_SAMPLES = 64
FRAME_MARGIN_SAMPLES = 2048


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


@dataclass(frozen=True, eq=False)
class SampleWalk:
    """One pass over a frame's decided samples, (n,) arrays over all objects.

    `shows` bool: one of the object's own triangles was drawn where it is nearest. `lost`
    int64: its samples at which nothing at the nearest depth was drawn; `lost_sample` int64:
    the first of them, -1 if none. `missed_pixels`: such samples, each counted once.
    """

    shows: NDArray[np.bool_]
    lost: Int64
    lost_sample: Int64
    missed_pixels: int


def walk_samples(truth: FrameTruth, scene: Scene, drawn: NDArray[np.bool_]) -> SampleWalk:
    """What `drawn` ((t,) bool) shows of each object, and what it loses."""
    count = scene.object_count
    shows, lost = np.zeros(count, np.bool_), np.zeros(count, np.int64)
    lost_sample = np.full(count, -1, np.int64)
    missed_pixels = kernels.judge_samples(
        truth.buffer.triangle.reshape(-1),
        truth.decided,
        truth.ties.sample,
        truth.ties.triangle,
        drawn,
        scene.object_of_triangle,
        shows,
        lost,
        lost_sample,
    )
    return SampleWalk(shows, lost, lost_sample, int(missed_pixels))


def find_disputes(truth: FrameTruth, scene: Scene, drawn: NDArray[np.bool_]) -> Disputes:
    """The samples and blended objects that `drawn` ((t,) bool) fails to show."""
    samples = kernels.undrawn_samples(truth.buffer.triangle.reshape(-1), truth.decided, drawn)
    ties = truth.ties
    if len(ties.sample) and len(samples):
        samples = np.setdiff1d(samples, ties.sample[drawn[ties.triangle]])
    blended = [o for o in truth.blend.object if not drawn[blended_triangles(scene, int(o))].any()]
    return Disputes(samples, np.array(blended, np.int32))


def settle(
    exact: ExactScene,
    truth: FrameTruth,
    disputes: Disputes,
    drawn: NDArray[np.bool_],
    raster: Raster | None,
) -> Rulings:
    """Decide every dispute in exact arithmetic.

    `raster` is the rasteriser behind the culler's depth buffer, None if it has none. Clears
    misses, never finds new ones where the engine saw nothing amiss.
    """
    scene, camera = exact.scene, truth.camera
    samples, owners, corrections = disputes.samples, None, 0
    if len(samples) and not truth.ties_complete:
        owners = exact.decide(camera, samples, include=scene.alpha == Alpha.OPAQUE)
        corrections = _corrections(truth, samples, owners)
    blend, undecided = None, samples[:0]
    if not truth.ties_complete and (len(disputes.blended) or (scene.has_mask and len(samples))):
        # Rare enough that a whole frame may be certified.
        certified = exact.certify(camera)
        blend = certified.blend if len(disputes.blended) else None
        undecided = np.intersect1d(certified.undecided, samples)
    rulings = Rulings(
        samples if owners is not None else samples[:0], owners, blend, undecided, corrections
    )
    return _with_margins(exact, corrected(truth, rulings), disputes, drawn, raster, rulings)


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


def _with_margins(
    exact: ExactScene,
    truth: FrameTruth,
    disputes: Disputes,
    drawn: NDArray[np.bool_],
    raster: Raster | None,
    rulings: Rulings,
) -> Rulings:
    """Add what is known of each object that stays missed in full."""
    scene = exact.scene
    walk = walk_samples(truth, scene, drawn)
    missed = np.flatnonzero((walk.lost > 0) & ~walk.shows)
    if not len(missed):
        return rulings
    each = min(MARGIN_SAMPLES, max(1, FRAME_MARGIN_SAMPLES // len(missed)))
    samples, objects = _witness_samples(scene, truth, disputes, missed, each)
    margin_px, margin_depth = witness_margins(exact, truth.camera, samples, objects)
    within: set[int] = set()
    if raster is not None:
        survives = surviving(exact, truth.camera, samples, objects, raster.tolerance)
        lost_all = np.setdiff1d(missed, objects[survives])
        if len(lost_all):
            # The tolerance speaks of every sample, so look at the ones left out above too.
            more, their = _witness_samples(scene, truth, disputes, lost_all, None)
            again = surviving(exact, truth.camera, more, their, raster.tolerance)
            lost_all = np.setdiff1d(lost_all, their[again])
        if len(lost_all):
            lost_all = np.setdiff1d(lost_all, _objects_shown(scene, truth.camera, raster))
            within = {int(o) for o in lost_all}
    best: dict[int, int] = {}
    margins: dict[int, tuple[float, float]] = {}
    order = np.lexsort((samples, -margin_px, objects))
    for at in order:
        best.setdefault(int(objects[at]), int(samples[at]))
        margins.setdefault(int(objects[at]), (float(margin_px[at]), float(margin_depth[at])))
    return replace(rulings, within_raster=frozenset(within), best_sample=best, margins=margins)


def _objects_shown(scene: Scene, camera: Camera, raster: Raster) -> Int32:
    """The objects in the rasteriser's own unculled picture, none if it has no picture. Raises
    CullerError where it is no such picture."""
    try:
        picture = raster.item_buffer(camera)
    except Exception as error:  # a plug-in may raise anything
        raise CullerError(f"item_buffer() raised {type(error).__name__}: {error}") from error
    if picture is None:
        return np.zeros(0, np.int32)
    seen = np.unique(picture)
    if not (
        picture.shape == (camera.height, camera.width)
        and np.issubdtype(picture.dtype, np.integer)
        and BACKGROUND <= seen[0] <= seen[-1] < scene.triangle_count
    ):
        raise CullerError("item_buffer() is no picture of the scene's triangle ids")
    shown: Int32 = np.unique(scene.object_of_triangle[seen[seen >= 0]])
    return shown


def _witness_samples(
    scene: Scene,
    truth: FrameTruth,
    disputes: Disputes,
    missed: NDArray[np.int64],
    limit: int | None,
) -> tuple[Int64, NDArray[np.int64]]:
    """(sample, object) pairs: samples of each missed object, evenly picked if too many."""
    triangle = truth.buffer.triangle.reshape(-1)
    owner = np.where(triangle >= 0, scene.object_of_triangle[triangle], -1)[disputes.samples]
    pairs_sample = [disputes.samples]
    pairs_object = [owner.astype(np.int64)]
    at = np.isin(truth.ties.sample, disputes.samples)
    pairs_sample.append(truth.ties.sample[at])
    pairs_object.append(scene.object_of_triangle[truth.ties.triangle[at]].astype(np.int64))
    sample, obj = np.concatenate(pairs_sample), np.concatenate(pairs_object)
    wanted = np.isin(obj, missed)
    obj, sample = np.divmod(np.unique(obj[wanted] * triangle.size + sample[wanted]), triangle.size)
    if limit is not None:
        starts = np.searchsorted(obj, obj)
        counts = np.searchsorted(obj, obj, side="right") - starts
        step = np.maximum(1, -(-counts // limit))
        picked = (np.arange(len(obj)) - starts) % step == 0
        obj, sample = obj[picked], sample[picked]
    return sample, obj
