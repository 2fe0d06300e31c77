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
from visref.judging.disputes import Rulings
from visref.judging.frame import SettledFrame
from visref.picking import distinct
from visref.scene import Int32, Int64, Scene
from visref.visibility import BACKGROUND

# How many of a missed object's samples are asked for their margins; the best one is reported.
# Of a frame that misses hundreds of objects, fewer of each: a margin takes about a millisecond.
MARGIN_SAMPLES = 64
FRAME_MARGIN_SAMPLES = 2048


def with_margins(exact: ExactScene, frame: SettledFrame, raster: Raster | None) -> Rulings:
    """The frame's rulings, with what is known of each object that loses samples.

    `raster` is the rasteriser behind the culler's depth buffer, None if it has none. Raises
    CullerError where its picture is none.
    """
    rulings, camera = frame.rulings, frame.truth.camera
    losing = np.flatnonzero(frame.walk.lost > 0)
    if not len(losing):
        return rulings
    each = min(MARGIN_SAMPLES, max(1, FRAME_MARGIN_SAMPLES // len(losing)))
    lost = _lost_pairs(frame)
    samples, objects = _picked(lost, each)
    margin_px, margin_depth = witness_margins(exact, camera, samples, objects)
    within: set[int] = set()
    if raster is not None:
        survives = surviving(exact, camera, samples, objects, raster.tolerance)
        excused = np.setdiff1d(losing, objects[survives])
        if len(excused):
            # The tolerance speaks of every sample, so look at the ones left out above too.
            more, theirs = (part[np.isin(lost[1], excused)] for part in lost)
            again = surviving(exact, camera, more, theirs, raster.tolerance)
            excused = np.setdiff1d(excused, theirs[again])
        if len(excused):
            shown = _triangles_shown(frame.scene, camera, raster)
            excused = np.setdiff1d(excused, _of_units_that_show(frame, excused, shown))
            within = {int(o) for o in excused}
    best: dict[int, int] = {}
    margins: dict[int, tuple[float, float]] = {}
    order = np.lexsort((samples, -margin_px, objects))
    for at in order:
        best.setdefault(int(objects[at]), int(samples[at]))
        margins.setdefault(int(objects[at]), (float(margin_px[at]), float(margin_depth[at])))
    return replace(rulings, within_raster=frozenset(within), best_sample=best, margins=margins)


def _triangles_shown(scene: Scene, camera: Camera, raster: Raster) -> Int32:
    """The triangles in the rasteriser's own unculled picture, none if it has no picture. Raises
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
    shown: Int32 = seen[seen >= 0].astype(np.int32)
    return shown


def _of_units_that_show(
    frame: SettledFrame, objects: NDArray[np.int64], shown: Int32
) -> NDArray[np.int64]:
    """Those of the objects with an undrawn unit that holds an owner of a lost sample of theirs
    and has a pixel in the unculled picture."""
    units, count = frame.units, frame.scene.triangle_count
    undrawn = np.ones(units.count, np.bool_)
    undrawn[frame.drawn_units] = False
    in_picture = np.zeros(count, np.bool_)
    in_picture[shown] = True
    of_unit = np.repeat(np.arange(units.count), units.sizes)
    shows = np.zeros(units.count, np.bool_)
    shows[of_unit[in_picture[units.triangles]]] = True
    owners = frame.walk.lost_triangle[units.triangles] & (undrawn & shows)[of_unit]
    theirs = frame.scene.object_of_triangle[units.triangles[owners]]
    return objects[np.isin(objects, theirs)]


def _lost_pairs(frame: SettledFrame) -> tuple[Int64, Int64]:
    """Every (sample, object) of a lost sample and an object that owns or shares it, sorted by
    object, then sample."""
    truth, scene, lost = frame.truth, frame.scene, frame.walk.lost_samples
    owner = truth.buffer.triangle.reshape(-1)[lost]
    at = np.isin(truth.ties.sample, lost)
    sample = np.concatenate([lost, truth.ties.sample[at]])
    triangle = np.concatenate([owner, truth.ties.triangle[at]])
    pairs = scene.object_of_triangle[triangle].astype(np.int64) * truth.camera.samples + sample
    obj, sample = np.divmod(distinct(pairs), truth.camera.samples)
    return sample, obj


def _picked(pairs: tuple[Int64, Int64], limit: int) -> tuple[Int64, Int64]:
    """At most `limit` samples of each object, evenly picked."""
    sample, obj = pairs
    starts = np.searchsorted(obj, obj)
    counts = np.searchsorted(obj, obj, side="right") - starts
    step = np.maximum(1, -(-counts // limit))
    picked = (np.arange(len(obj)) - starts) % step == 0
    return sample[picked], obj[picked]
