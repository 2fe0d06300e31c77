"""How firm each miss is: its margins, its best witness, and whether the rasteriser behind the
culler's depth buffer could have lost the object by itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.culler import Raster
from visref.exact import REACH_PX, ExactScene, resolves, surviving, witness_margins
from visref.judging.disputes import Measured, Rulings
from visref.judging.frame import SettledFrame
from visref.judging.rasters import JudgedRaster
from visref.picking import distinct
from visref.scene import Float64, Int32, Int64

# How many of a missed object's samples are asked for their margins; the best one is reported.
# Of a frame that misses hundreds of objects, fewer of each: a margin takes about a millisecond.
MARGIN_SAMPLES = 64
FRAME_MARGIN_SAMPLES = 2048
# They are first asked how they hold for this many pixels. Those that do are asked for twice as
# many, and so on up to `REACH_PX`; a step looks at four times the area, so that only the objects
# that lose most are asked, each at few samples.
FIRST_REACH_PX = 1.0
FAR_SAMPLES = 8
FRAME_FAR_SAMPLES = 64


def with_margins(exact: ExactScene, frame: SettledFrame, raster: Raster | None) -> Rulings:
    """The frame's rulings, with what is known of each object that loses samples.

    `raster` is the rasteriser behind the culler's depth buffer, None if it has none. Raises
    CullerError where what it declares is out of bounds, or its picture is none.
    """
    rulings, camera = frame.rulings, frame.truth.camera
    losing = np.flatnonzero(frame.walk.lost > 0)
    if not len(losing):
        return rulings
    each = min(MARGIN_SAMPLES, max(1, FRAME_MARGIN_SAMPLES // len(losing)))
    lost = frame.lost_pairs
    samples, objects = _picked(lost, each)
    margin_px, margin_depth = witness_margins(
        exact,
        camera,
        samples,
        objects,
        reach_px=FIRST_REACH_PX,
        most_around=exact.scene.triangle_count,
    )
    _look_further(exact, frame, samples, objects, margin_px)
    within: frozenset[int] = frozenset()
    if raster is not None:
        judged = raster if isinstance(raster, JudgedRaster) else JudgedRaster(raster)
        excused = _excused(exact, frame, judged, losing, lost, (samples, objects))
        within = frozenset(excused.tolist())
    # Of each object the firmest, and of those alike the first.
    order = np.lexsort((samples, -margin_px, objects))
    first = np.append(True, np.diff(objects[order]) != 0)
    best = order[first]
    measured = Measured(objects[best], samples[best], margin_px[best], margin_depth[best])
    return replace(rulings, within_raster=within, measured=measured)


def _look_further(
    exact: ExactScene, frame: SettledFrame, samples: Int64, objects: Int64, margin_px: Float64
) -> None:
    """Raise the margins, (k,), of samples that hold as far as was asked, in place. `samples` are
    sorted by `objects`."""
    reach = FIRST_REACH_PX
    while reach < REACH_PX:
        held = np.flatnonzero(margin_px >= reach)
        if not len(held):
            return
        losing = distinct(objects[held])
        most_lost = np.lexsort((losing, -frame.walk.lost[losing]))
        asked = losing[most_lost[:FRAME_FAR_SAMPLES]]
        held = held[np.isin(objects[held], asked)]
        each = min(FAR_SAMPLES, FRAME_FAR_SAMPLES // len(asked))
        held, _ = _picked((held, objects[held]), each)
        reach = min(2.0 * reach, REACH_PX)
        further, _ = witness_margins(
            exact, frame.truth.camera, samples[held], objects[held], reach_px=reach
        )
        # Where too many triangles lie around, what held before still does.
        margin_px[held] = np.maximum(margin_px[held], further)


def _excused(
    exact: ExactScene,
    frame: SettledFrame,
    raster: JudgedRaster,
    losing: NDArray[np.int64],
    lost: tuple[Int64, Int64],
    picked: tuple[Int64, Int64],
) -> NDArray[np.int64]:
    """Those of the objects `losing` samples that the rasteriser may have lost by itself.
    `lost`: every (sample, object) pair; `picked`: some of each object, which are asked first."""
    camera, tolerance = frame.truth.camera, raster.tolerance
    nearest = float(frame.seen.nearest.min())

    def without_survivors(
        objects: NDArray[np.int64], pairs: tuple[Int64, Int64], nearest: float | None
    ) -> NDArray[np.int64]:
        sample, obj = (part[np.isin(pairs[1], objects)] for part in pairs)
        survives = surviving(exact, camera, sample, obj, tolerance, nearest=nearest)
        return np.setdiff1d(objects, obj[survives])

    excused = losing
    # The tolerance speaks of every sample, so what is left is asked of those not picked too.
    for pairs in (picked, lost):
        if len(excused):
            excused = without_survivors(excused, pairs, None)
    if not len(excused):
        return excused
    shown = raster.triangles_shown(camera, frame.scene.triangle_count)
    if shown is not None:
        excused = np.setdiff1d(excused, _of_units_that_show(frame, excused, shown))
    if shown is None or not resolves(camera, exact, tolerance, nearest):
        # Nobody has seen what such a buffer makes of these depths: a picture of a frame in which
        # it tells no depth from another shows nothing.
        for pairs in (picked, lost):
            if len(excused):
                excused = without_survivors(excused, pairs, nearest)
    return excused


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


def _picked(pairs: tuple[Int64, Int64], limit: int) -> tuple[Int64, Int64]:
    """At most `limit` samples of each object, evenly picked."""
    sample, obj = pairs
    starts = np.searchsorted(obj, obj)
    counts = np.searchsorted(obj, obj, side="right") - starts
    step = np.maximum(1, -(-counts // limit))
    picked = (np.arange(len(obj)) - starts) % step == 0
    return sample[picked], obj[picked]
