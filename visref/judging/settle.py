"""One culler's frame, settled: disputes decided, the truth corrected, its samples walked over.

Each of these is computed once here, and the judge, the pictures and the records all use it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from visref.culler import Raster
from visref.exact import ExactScene
from visref.judging.disputes import Rulings, corrected, decide, find_disputes
from visref.judging.frame import SettledFrame
from visref.judging.holders import DrawList, UnitsSeen
from visref.judging.margins import with_margins
from visref.judging.rounding import in_doubt
from visref.judging.superfluous import confirm
from visref.judging.walk import walk_samples
from visref.picking import distinct
from visref.scene import Int64, Scene
from visref.visibility import FrameTruth, ObjectVisibility, objects_seen

_NONE: Int64 = np.zeros(0, np.int64)


def settle(
    scene: Scene,
    truth: FrameTruth,
    drawn: DrawList,
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
    frame = with_rulings(scene, truth, drawn, Rulings(), seen=seen)
    samples = _NONE if frame.walked is None else find_disputes(frame.walked)
    if len(samples):
        rulings = decide(exact(), truth, samples)
        while rulings.exact is not None:
            frame = with_rulings(scene, truth, drawn, rulings)
            more = np.union1d(samples, _may_be_tied(exact(), frame))
            if len(more) == len(samples):
                break
            samples, rulings = more, decide(exact(), truth, more)
        rounded = in_doubt(exact(), frame.truth, frame.walk.lost_samples)
        if rounded is not frame.truth:
            frame = _looked_at(scene, rounded, drawn, frame.rulings)
        frame = replace(frame, rulings=with_margins(exact(), frame, raster))
    if only_visible and len(frame.superfluous):
        hidden = confirm(exact(), frame.truth, frame.units, frame.superfluous)
        frame = replace(frame, confirmed=hidden)
    return frame


def _may_be_tied(exact: ExactScene, frame: SettledFrame) -> Int64:
    """The samples, ascending, that the drawn triangles of objects cover that are seen and yet show
    nowhere. A ray engine lists no ties, so whether such an object shows by one is to be asked
    there. None where units are objects, of which nothing is drawn then."""
    silent = np.flatnonzero(frame.seen.visible & ~frame.walk.shows).astype(np.int32)
    if not len(silent) or frame.draw_list.holders.are_objects:
        return _NONE
    own = frame.scene.object_units().gather(silent)
    own = own[frame.drawn[own]]
    if not len(own):
        return _NONE
    theirs = np.zeros(frame.scene.triangle_count, np.bool_)
    theirs[own] = True
    return distinct(exact.hits(frame.truth.camera, theirs).sample)


def with_rulings(
    scene: Scene,
    truth: FrameTruth,
    drawn: DrawList,
    rulings: Rulings,
    *,
    seen: ObjectVisibility | None = None,
) -> SettledFrame:
    """The frame settled by these rulings. `seen`: `objects_seen` of the corrected truth, where it
    is known."""
    return _looked_at(scene, corrected(truth, rulings), drawn, rulings, seen)


def _looked_at(
    scene: Scene,
    truth: FrameTruth,
    drawn: DrawList,
    rulings: Rulings,
    seen: ObjectVisibility | None = None,
) -> SettledFrame:
    """By its samples, or by what is seen alone where all of that was drawn."""
    if seen is None:
        seen = objects_seen(truth, scene)
    units_seen = UnitsSeen.of(truth, seen, drawn)
    walked = None if units_seen.all_drawn else walk_samples(truth, scene, drawn.triangles)
    return SettledFrame(scene, truth, seen, units_seen, drawn, walked, rulings)
