"""How firm each miss is: its margins, its best witness, and whether the rasteriser behind the
culler's depth buffer could have lost the object by itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import CullerError, Raster
from visref.exact import ExactScene, surviving, witness_margins
from visref.judging.disputes import Disputes, Rulings
from visref.judging.walk import SampleWalk
from visref.scene import Int32, Int64, Scene
from visref.visibility import BACKGROUND, FrameTruth

# How many of a missed object's samples are asked for their margins; the best one is reported.
# Of a frame that misses hundreds of objects, fewer of each: a margin takes about a millisecond.
MARGIN_SAMPLES = 64
FRAME_MARGIN_SAMPLES = 2048


def with_margins(
    exact: ExactScene,
    truth: FrameTruth,
    walk: SampleWalk,
    disputes: Disputes,
    raster: Raster | None,
    rulings: Rulings,
) -> Rulings:
    """The rulings, with what is known of each object that stays missed in full.

    `truth`: the corrected one; `walk`: over its samples. `raster` is the rasteriser behind the
    culler's depth buffer, None if it has none. Raises CullerError where its picture is none.
    """
    scene = exact.scene
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
