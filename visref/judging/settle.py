"""One culler's frame, settled: disputes decided, the truth corrected, its samples walked over.

Each of these is computed once here, and the judge, the pictures and the records all use it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.culler import Raster
from visref.exact import ExactScene
from visref.judging.disputes import Rulings, corrected, decide, find_disputes
from visref.judging.frame import SettledFrame
from visref.judging.margins import with_margins
from visref.judging.rounding import in_doubt
from visref.judging.superfluous import confirm
from visref.judging.walk import walk_samples
from visref.picking import distinct
from visref.scene import Int32, Int64, Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility, objects_seen


def settle(
    scene: Scene,
    truth: FrameTruth,
    units: Units,
    drawn_units: Int32,
    *,
    exact: Callable[[], ExactScene],
    raster: Raster | None = None,
    drawn: NDArray[np.bool_] | None = None,
    seen: ObjectVisibility | None = None,
    only_visible: bool = False,
) -> SettledFrame:
    """Decide every dispute between a truth and the drawn units, and ask of every loss that stays
    whether the culler's rasteriser could have lost it by itself.

    `drawn_units`: (k,) int32 unit ids. `exact` is asked only if there is any. `raster`: the
    rasteriser behind the culler's depth buffer, None if it has none. `drawn`: (t,) bool, the
    triangles of the drawn units, and `seen`: `objects_seen` of `truth`, where they are known.
    `only_visible`: the culler promises to draw nothing hidden, so that is confirmed too.
    """
    frame = with_rulings(scene, truth, units, drawn_units, Rulings(), drawn=drawn, seen=seen)
    samples = find_disputes(frame.walk)
    if len(samples):
        rulings = decide(exact(), truth, samples)
        while rulings.exact is not None:
            frame = with_rulings(scene, truth, units, drawn_units, rulings, drawn=frame.drawn)
            more = np.union1d(samples, _may_be_tied(exact(), frame))
            if len(more) == len(samples):
                break
            samples, rulings = more, decide(exact(), truth, more)
        rounded = in_doubt(exact(), frame.truth, frame.walk.lost_samples)
        if rounded is not frame.truth:
            frame = replace(
                frame,
                truth=rounded,
                seen=objects_seen(rounded, scene),
                walk=walk_samples(rounded, scene, frame.drawn),
            )
        frame = replace(frame, rulings=with_margins(exact(), frame, raster))
    if only_visible and len(frame.superfluous):
        frame = replace(frame, confirmed=confirm(exact(), frame.truth, units, frame.superfluous))
    return frame


def _may_be_tied(exact: ExactScene, frame: SettledFrame) -> Int64:
    """The samples, ascending, that the drawn triangles of objects cover that are seen and yet show
    nowhere. A ray engine lists no ties, so whether such an object shows by one is to be asked
    there. None where units are objects, of which nothing is drawn then."""
    silent = frame.seen.visible & ~frame.walk.shows
    theirs = frame.drawn & silent[frame.scene.object_of_triangle]
    if not theirs.any():
        return np.zeros(0, np.int64)
    return distinct(exact.hits(frame.truth.camera, theirs).sample)


def with_rulings(
    scene: Scene,
    truth: FrameTruth,
    units: Units,
    drawn_units: Int32,
    rulings: Rulings,
    *,
    drawn: NDArray[np.bool_] | None = None,
    seen: ObjectVisibility | None = None,
) -> SettledFrame:
    """The frame settled by these rulings. `drawn_units`: (k,) int32 unit ids. `drawn`: (t,) bool,
    their triangles, and `seen`: `objects_seen` of the corrected truth, where they are known."""
    right = corrected(truth, rulings)
    if drawn is None:
        drawn = units.mask(drawn_units, scene.triangle_count)
    if seen is None:
        seen = objects_seen(right, scene)
    walk = walk_samples(right, scene, drawn)
    return SettledFrame(scene, right, seen, units, drawn_units, drawn, walk, rulings)
