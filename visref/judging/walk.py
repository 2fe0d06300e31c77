"""The walk over a frame's samples: what a drawn set shows of each object, and what it loses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref import kernels
from visref.picking import distinct
from visref.scene import Int64, Scene
from visref.visibility import FrameTruth, ObjectVisibility, own_besides


@dataclass(frozen=True, eq=False)
class SampleWalk:
    """One pass over a frame's samples, (n,) arrays over all objects.

    `shows` bool: one of the object's own triangles was drawn where it is nearest, or seen as
    glass. `lost` int64: its samples at which nothing at the nearest depth was drawn;
    `lost_sample` int64: the first of them, -1 if none. `lost_blended` int64: further samples at
    which it is seen as glass and none of its glass there was drawn, `blended_hit` int64: the
    nearest such hit in `truth.blend`, -1 if none. `charged` int64: those of `lost` at which a
    mask leaves open whether the object or a leaf before it is seen, and it is not seen as glass.

    `lost_triangle`: (t,) bool, the triangles that own a lost sample, or are glass of an object
    that loses one by it. `lost_samples`, `lost_blended_samples` (where glass is lost, whoever owns
    the sample), `undecided_samples`: flat indices, ascending, each once.
    """

    shows: NDArray[np.bool_]
    lost: Int64
    lost_sample: Int64
    lost_blended: Int64
    blended_hit: Int64
    charged: Int64
    lost_triangle: NDArray[np.bool_]
    lost_samples: Int64
    lost_blended_samples: Int64
    undecided_samples: Int64


def walk_samples(truth: FrameTruth, scene: Scene, drawn: NDArray[np.bool_]) -> SampleWalk:
    """What `drawn` ((t,) bool) shows of each object, and what it loses."""
    count = scene.object_count
    tally = kernels.Tally(
        np.zeros(count, np.bool_),
        np.zeros(count, np.int64),
        np.full(count, -1, np.int64),
        np.zeros(count, np.int64),
        np.zeros(scene.triangle_count, np.bool_),
    )
    owned = kernels.Owned(
        truth.buffer.triangle.reshape(-1),
        truth.ties.sample,
        truth.ties.triangle,
        truth.doubt.sample,
        truth.doubt.offsets,
        truth.doubt.triangle,
    )
    lost_at = np.zeros(truth.camera.samples, np.uint8)
    kernels.judge_samples(owned, drawn, scene.object_of_triangle, tally, lost_at)
    lost_blended, blended_hit = np.zeros(count, np.int64), np.full(count, -1, np.int64)
    through = np.zeros(0, np.int64)
    if len(truth.blend.object):
        through = _walk_blended(truth, scene, drawn, tally, lost_at, lost_blended, blended_hit)
    return SampleWalk(
        tally.shows,
        tally.lost,
        tally.lost_sample,
        lost_blended,
        blended_hit,
        tally.charged,
        tally.lost_triangle,
        np.flatnonzero(lost_at == kernels.LOST),
        through,
        np.flatnonzero(lost_at == kernels.UNDECIDED),
    )


def nothing_lost(seen: ObjectVisibility, scene: Scene) -> SampleWalk:
    """`walk_samples` where all that is seen, or may be, was drawn."""
    count, nowhere = scene.object_count, np.zeros(0, np.int64)
    return SampleWalk(
        seen.visible,
        np.zeros(count, np.int64),
        np.full(count, -1, np.int64),
        np.zeros(count, np.int64),
        np.full(count, -1, np.int64),
        np.zeros(count, np.int64),
        np.zeros(scene.triangle_count, np.bool_),
        nowhere,
        nowhere,
        nowhere,
    )


def _walk_blended(
    truth: FrameTruth,
    scene: Scene,
    drawn: NDArray[np.bool_],
    tally: kernels.Tally,
    lost_at: NDArray[np.uint8],
    lost_blended: Int64,
    blended_hit: Int64,
) -> Int64:
    """A sample is lost to an object that is seen there as glass if none of that glass is drawn.
    Returns such samples."""
    blend = truth.blend
    starts = np.flatnonzero(
        np.append(True, (np.diff(blend.object) != 0) | (np.diff(blend.sample) != 0))
    )
    here = drawn[blend.triangle]
    any_drawn = np.logical_or.reduceat(here, starts)
    np.logical_or.at(tally.shows, blend.object, here)
    sizes = np.diff(np.append(starts, len(here)))
    lost = np.repeat(~any_drawn, sizes)
    tally.lost_triangle[blend.triangle[lost]] = True
    hits = np.flatnonzero(lost)
    order = hits[np.lexsort((blend.sample[hits], blend.depth[hits], blend.object[hits]))]
    objects, first = np.unique(blend.object[order], return_index=True)
    blended_hit[objects] = order[first]
    # A sample that the object loses as an opaque owner besides is counted there.
    counted = (lost_at[blend.sample] == kernels.LOST) & own_besides(truth, scene)
    # And one that a mask leaves open is among those at which the object is seen, as glass.
    seen_twice = starts[(counted & ~truth.decided[blend.sample])[starts]]
    tally.charged[:] -= np.bincount(blend.object[seen_twice], minlength=len(tally.charged))
    where = starts[~any_drawn & ~counted[starts]]
    lost_blended += np.bincount(blend.object[where], minlength=len(lost_blended))
    return distinct(blend.sample[lost])
