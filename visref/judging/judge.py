"""The judge: a settled frame in, a verdict out. Pure; nothing is read or kept.

- A sample is *lost* if no triangle at its nearest depth was drawn. Where an alpha mask leaves the
  nearest depth open, it is lost only if nothing that may be seen there was drawn, down to a
  certain hit; it is undecided if some of it was.
- An object is *missed* if it is visible and shows nowhere, because its triangles there were not
  drawn; *partly missed* if it shows somewhere and loses samples elsewhere. Glass is lost at a
  sample where none of the object's glass that is seen there was drawn.
- A miss is a *tie* if every sample of the object shows a co-owner at exactly the same depth;
  *within raster tolerance* if the rulings say so; else *confirmed*. So
  missed + partly missed = confirmed + ties + within raster tolerance.
- A unit is *missed* if it was not drawn and samples that it owns are lost by that, *superfluous*
  if it was drawn and none of its triangles is visible.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from visref.culler import Promise
from visref.judging.frame import SettledFrame
from visref.judging.misses import CODES, MissColumns, Misses
from visref.judging.misses import Miss as Miss
from visref.judging.misses import MissKind as MissKind
from visref.judging.superfluous import Superfluous
from visref.scene import Int32, Int64, Scene
from visref.visibility import FrameTruth


@dataclass(frozen=True)
class Counts:
    """The numbers of `verdict.json`, for a frame or summed over frames.

    `visible`, `missed`, `partly_missed`, their kinds and `undecided` count objects; `drawn`,
    `superfluous`, `superfluous_confirmed` and `missed_units` count units; `missed_pixels`,
    `owned_samples` (all that something owns or may own) and `undecided_samples` (those of them
    on which the verdict hangs and which a mask leaves open) count samples. `violations` is what
    the promise forbids of these.
    """

    visible: int = 0
    missed: int = 0
    partly_missed: int = 0
    confirmed: int = 0
    ties: int = 0
    within_raster_tolerance: int = 0
    small: int = 0
    late: int = 0
    waived: int = 0
    violations: int = 0
    undecided: int = 0
    missed_pixels: int = 0
    owned_samples: int = 0
    undecided_samples: int = 0
    drawn: int = 0
    superfluous: int = 0
    superfluous_confirmed: int = 0
    missed_units: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(**{name: getattr(self, name) + getattr(other, name) for name in vars(self)})


def violations(promise: Promise, confirmed: int, superfluous_confirmed: int) -> int:
    """What a promise forbids of what was confirmed."""
    return {
        Promise.CONSERVATIVE: confirmed,
        Promise.EXACT: confirmed + superfluous_confirmed,
        Promise.AGGRESSIVE: superfluous_confirmed,
        Promise.APPROXIMATE: 0,
    }[promise]


@dataclass(frozen=True, eq=False)
class FrameVerdict:
    """What the judge says of one frame. `misses` come with the most samples lost first;
    `superfluous_units` ascend. `owned`: how many samples something owns for certain, None where
    the truth on file does not say. `confirmed_superfluous`: those that a promise forbids."""

    counts: Counts
    misses: Misses = field(default_factory=lambda: Misses.of(()))
    superfluous_units: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    undecided_objects: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    owned: int | None = None
    confirmed_superfluous: tuple[Superfluous, ...] = ()


def nothing_missed(
    promise: Promise,
    *,
    visible: int,
    owned_samples: int,
    drawn: int,
    superfluous: Int32,
    confirmed: tuple[Superfluous, ...] = (),
    owned: int | None,
) -> FrameVerdict:
    """The verdict on a drawn set that has all that is seen, or may be. `visible` objects,
    `owned_samples` and `drawn` units as in `Counts`, the others as in the verdict."""
    counts = Counts(
        visible=visible,
        violations=violations(promise, 0, len(confirmed)),
        owned_samples=owned_samples,
        drawn=drawn,
        superfluous=len(superfluous),
        superfluous_confirmed=len(confirmed),
    )
    return FrameVerdict(
        counts, superfluous_units=superfluous, owned=owned, confirmed_superfluous=confirmed
    )


def judge(frame: SettledFrame, promise: Promise) -> FrameVerdict:
    """Judge one drawn set, settled against its truth."""
    walk, seen = frame.walk, frame.seen
    # What is lost for certain behind a mask is seen for certain, if anything is.
    visible = seen.visible | (walk.charged > 0)
    loses = (walk.lost > 0) | (walk.lost_blended > 0) | (walk.blended_hit >= 0)
    left_out = np.flatnonzero(visible & (loses | ~walk.shows))
    misses = _misses(frame, left_out)

    superfluous = frame.superfluous
    undecided = _undecided(frame, visible)
    confirmed = misses.number_of(MissKind.CONFIRMED)
    partly = int(np.count_nonzero(misses.columns.partly))
    may_own = frame.truth.doubt.sample
    counts = Counts(
        visible=int(np.count_nonzero(visible)),
        missed=len(misses) - partly,
        partly_missed=partly,
        confirmed=confirmed,
        ties=misses.number_of(MissKind.TIE),
        within_raster_tolerance=misses.number_of(MissKind.WITHIN_RASTER),
        violations=violations(promise, confirmed, len(frame.confirmed)),
        undecided=len(undecided),
        missed_pixels=len(walk.lost_samples),
        owned_samples=seen.owned + len(may_own),
        undecided_samples=len(walk.undecided_samples),
        drawn=len(frame.drawn_units),
        superfluous=len(superfluous),
        superfluous_confirmed=len(frame.confirmed),
        missed_units=_missed_units(frame),
    )
    return FrameVerdict(counts, misses, superfluous, undecided, seen.owned, frame.confirmed)


def _misses(frame: SettledFrame, objects: Int64) -> Misses:
    """What is to be said of the `objects` (k,) that were missed, the most samples lost first."""
    truth, rulings, walk = frame.truth, frame.rulings, frame.walk
    opaque, hit = walk.lost[objects], walk.blended_hit[objects]
    samples = opaque + walk.lost_blended[objects]
    order = np.lexsort((objects, -samples))
    objects, opaque, hit, samples = objects[order], opaque[order], hit[order], samples[order]
    within = np.isin(objects, np.fromiter(rulings.within_raster, np.int64))
    # Glass owns no sample of the visibility buffer, and no tolerance excuses it.
    glass = (hit >= 0) & ((opaque == 0) | within)
    tie = ~glass & (opaque == 0)
    kind = np.full(len(objects), CODES[MissKind.CONFIRMED], np.int8)
    kind[tie] = CODES[MissKind.TIE]
    kind[~glass & ~tie & within] = CODES[MissKind.WITHIN_RASTER]
    best, margin_px, margin_depth = rulings.measured.of(objects)
    sample = np.where(best >= 0, best, walk.lost_sample[objects])
    sample = np.where(tie, frame.seen.sample[objects], sample)
    triangle = np.empty(len(objects), np.int32)
    depth = np.empty(len(objects))
    sample[glass] = truth.blend.sample[hit[glass]]
    triangle[glass] = truth.blend.triangle[hit[glass]]
    depth[glass] = truth.blend.depth[hit[glass]]
    triangle[~glass] = _own_triangles(frame.scene, truth, sample[~glass], objects[~glass])
    depth[~glass] = truth.buffer.depth.reshape(-1)[sample[~glass]]
    unmeasured = glass | tie
    margin_px[unmeasured] = margin_depth[unmeasured] = np.nan
    return Misses(
        MissColumns(
            objects.astype(np.int32),
            kind,
            samples,
            frame.seen.samples[objects] + walk.charged[objects],
            sample,
            triangle,
            depth,
            margin_px,
            margin_depth,
            walk.shows[objects],
            np.zeros(len(objects), np.int16),
            np.zeros(len(objects), np.int32),
            np.full(len(objects), -1, np.int64),
        )
    )


def _own_triangles(scene: Scene, truth: FrameTruth, samples: Int64, objects: Int64) -> Int32:
    """(k,) int32, each object's own triangle at a sample that it owns or shares."""
    own: Int32 = truth.buffer.triangle.reshape(-1)[samples]
    shared = np.flatnonzero(scene.object_of_triangle[own] != objects)
    if len(shared):
        tied = np.isin(truth.ties.sample, samples[shared])
        triangle, count = truth.ties.triangle[tied], scene.object_count
        pairs = truth.ties.sample[tied] * count + scene.object_of_triangle[triangle]
        # The first of each pair, in the ties' order.
        order = np.argsort(pairs, kind="stable")
        wanted = samples[shared] * count + objects[shared]
        own[shared] = triangle[order[np.searchsorted(pairs[order], wanted)]]
    return own


def _missed_units(frame: SettledFrame) -> int:
    """How many undrawn units hold a triangle that owns a lost sample, or is lost glass."""
    lost = np.flatnonzero(frame.walk.lost_triangle).astype(np.int32)
    missed = np.zeros(frame.units.count, np.bool_)
    frame.draw_list.holders.mark(lost, frame.draw_list.by_unit, missed)
    missed &= ~frame.draw_list.by_unit
    return int(np.count_nonzero(missed))


def _undecided(frame: SettledFrame, visible: NDArray[np.bool_]) -> Int32:
    """Objects that nobody saw for certain and that were not drawn where they may be visible, at
    samples that a mask leaves open."""
    scene, truth, drawn = frame.scene, frame.truth, frame.drawn
    open_ = frame.walk.undecided_samples
    owner = truth.buffer.triangle.reshape(-1)[open_]
    may = np.concatenate(
        [owner[owner >= 0], truth.doubt.triangle[np.isin(truth.doubt.at(), open_)]]
    )
    objects: Int32 = np.unique(scene.object_of_triangle[may[~drawn[may]]]).astype(np.int32)
    undecided: Int32 = objects[~visible[objects]]
    return undecided
