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
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from visref.culler import Promise
from visref.judging.frame import SettledFrame
from visref.judging.superfluous import Superfluous
from visref.scene import Int32, Scene
from visref.visibility import FrameTruth


class MissKind(StrEnum):
    """What a miss is put down to; each is counted once, as the first that holds."""

    TIE = "tie"
    WITHIN_RASTER = "within_raster_tolerance"
    SMALL = "small"
    LATE = "late"
    WAIVED = "waived"
    CONFIRMED = "confirmed"


@dataclass(frozen=True)
class Miss:
    """A visible object that was not drawn, or (`partly`) not all of it that is seen, with the
    sample that witnesses it.

    `samples`: those lost (0 for a tie); `owned`: samples at which it is seen. `sample` is a flat
    index in the image of `view`, `width` samples wide, `depth` view depth there. Margins are None
    where they were not computed. `age`: for how many frames it had been in view
    (`visref.judging.ages`), None where it has no age.
    """

    object: int
    kind: MissKind
    samples: int
    owned: int
    sample: int
    triangle: int
    depth: float
    margin_px: float | None = None
    margin_depth: float | None = None
    partly: bool = False
    view: str = ""
    width: int = 0
    age: int | None = None


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
    misses: tuple[Miss, ...] = ()
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
    misses = [_miss(frame, int(o)) for o in left_out]
    misses.sort(key=lambda miss: (-miss.samples, miss.object))

    superfluous = frame.superfluous
    undecided = _undecided(frame, visible)
    kinds = [miss.kind for miss in misses]
    confirmed = kinds.count(MissKind.CONFIRMED)
    partly = sum(miss.partly for miss in misses)
    may_own = frame.truth.doubt.sample
    counts = Counts(
        visible=int(np.count_nonzero(visible)),
        missed=len(misses) - partly,
        partly_missed=partly,
        confirmed=confirmed,
        ties=kinds.count(MissKind.TIE),
        within_raster_tolerance=kinds.count(MissKind.WITHIN_RASTER),
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
    return FrameVerdict(counts, tuple(misses), superfluous, undecided, seen.owned, frame.confirmed)


def _miss(frame: SettledFrame, object_id: int) -> Miss:
    scene, truth, rulings, walk = frame.scene, frame.truth, frame.rulings, frame.walk
    owned = int(frame.seen.samples[object_id]) + int(walk.charged[object_id])
    opaque, glass = int(walk.lost[object_id]), int(walk.blended_hit[object_id])
    partly = bool(walk.shows[object_id])
    within_raster = object_id in rulings.within_raster
    if glass >= 0 and (opaque == 0 or within_raster):
        # Glass owns no sample of the visibility buffer, and no tolerance excuses it.
        blend = truth.blend
        return Miss(
            object_id,
            MissKind.CONFIRMED,
            opaque + int(walk.lost_blended[object_id]),
            owned,
            int(blend.sample[glass]),
            int(blend.triangle[glass]),
            float(blend.depth[glass]),
            partly=partly,
        )
    if opaque == 0:
        sample, kind = int(frame.seen.sample[object_id]), MissKind.TIE
    else:
        sample = rulings.best_sample.get(object_id, int(walk.lost_sample[object_id]))
        kind = MissKind.WITHIN_RASTER if within_raster else MissKind.CONFIRMED
    margin_px, margin_depth = rulings.margins.get(object_id, (None, None))
    return Miss(
        object_id,
        kind,
        opaque + int(walk.lost_blended[object_id]),
        owned,
        sample,
        _own_triangle(scene, truth, sample, object_id),
        float(truth.buffer.depth.reshape(-1)[sample]),
        margin_px,
        margin_depth,
        partly,
    )


def _own_triangle(scene: Scene, truth: FrameTruth, sample: int, object_id: int) -> int:
    """The object's own triangle at a sample it owns or shares."""
    owner = int(truth.buffer.triangle.reshape(-1)[sample])
    if scene.object_of_triangle[owner] == object_id:
        return owner
    low, high = np.searchsorted(truth.ties.sample, (sample, sample + 1))
    tied = truth.ties.triangle[low:high]
    return int(tied[scene.object_of_triangle[tied] == object_id][0])


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
