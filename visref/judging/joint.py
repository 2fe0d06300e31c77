"""One drawn set for several views: their settled frames joined into one, so that the judge counts
their samples together.

Samples of the views stand one after another, in the views' order: sample s of a view becomes s plus
the samples of the views before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Promise
from visref.judging.disputes import Measured, Rulings
from visref.judging.frame import SettledFrame
from visref.judging.holders import UnitsSeen
from visref.judging.judge import FrameVerdict, nothing_missed
from visref.judging.misses import Misses
from visref.judging.superfluous import Superfluous, superfluous_units
from visref.judging.walk import SampleWalk
from visref.scene import Int64
from visref.visibility import (
    BlendVisibility,
    Doubt,
    FrameTruth,
    ObjectVisibility,
    Ties,
    VisibilityBuffer,
)


def all_drawn(frames: Sequence[SettledFrame]) -> bool:
    """Whether all that is seen in some view, or may be, was drawn, so that nothing is missed."""
    return all(frame.walked is None for frame in frames)


def judge_all_drawn(frames: Sequence[SettledFrame], promise: Promise) -> FrameVerdict:
    """What `judge` says of such frames, joined: by what is seen in them, not by their samples."""
    first = frames[0]
    seen = reduce(UnitsSeen.joined, (frame.units_seen for frame in frames))
    confirmed = first.confirmed
    if len(frames) > 1:
        starts = _starts([frame.truth.camera for frame in frames])
        confirmed = _confirmed([frame.confirmed for frame in frames], starts)
    owned = sum(frame.seen.owned for frame in frames)
    return nothing_missed(
        promise,
        visible=int(np.count_nonzero(np.logical_or.reduce([one.seen.visible for one in frames]))),
        owned_samples=owned + sum(len(frame.truth.doubt) for frame in frames),
        drawn=len(first.drawn_units),
        superfluous=superfluous_units(first.scene, seen, first.draw_list),
        confirmed=confirmed,
        owned=owned,
    )


def joined(frames: Sequence[SettledFrame]) -> SettledFrame:
    """The views of one drawn set as one frame; its camera is the first view's, and says nothing of
    its samples. An object is visible, shown or lost where it is so in some view; a unit is
    superfluous where it shows in none."""
    if len(frames) == 1:
        return frames[0]
    starts = _starts([frame.truth.camera for frame in frames])
    truth = _truth([frame.truth for frame in frames], starts)
    return replace(
        frames[0],
        truth=truth,
        seen=_seen([frame.seen for frame in frames], starts),
        units_seen=reduce(UnitsSeen.joined, (frame.units_seen for frame in frames)),
        walked=_walk(frames, starts),
        rulings=_rulings(frames, starts),
        confirmed=_confirmed([frame.confirmed for frame in frames], starts),
    )


def located(verdict: FrameVerdict, cameras: Sequence[Camera]) -> FrameVerdict:
    """The verdict on `joined` frames, each miss and each hidden unit at the sample of its view."""
    starts = _starts(cameras)
    views = tuple(camera.view for camera in cameras)

    def of_unit(unit: Superfluous) -> Superfluous:
        if unit.sample < 0:
            return replace(unit, view=cameras[0].view, width=cameras[0].width)
        view = int(np.searchsorted(starts, unit.sample, side="right")) - 1
        sample, camera = unit.sample - int(starts[view]), cameras[view]
        return replace(unit, sample=sample, view=camera.view, width=camera.width)

    columns = verdict.misses.columns
    place = np.searchsorted(starts, columns.sample, side="right") - 1
    widths = np.array([camera.width for camera in cameras], np.int32)
    columns = columns._replace(
        sample=columns.sample - starts[place], view=place.astype(np.int16), width=widths[place]
    )
    return replace(
        verdict,
        misses=Misses(columns, views),
        confirmed_superfluous=tuple(map(of_unit, verdict.confirmed_superfluous)),
    )


def _starts(cameras: Sequence[Camera]) -> Int64:
    """(k + 1,) int64, the first sample of each view, and one beyond the last view's."""
    return np.cumsum([0, *(camera.samples for camera in cameras)])


def _truth(truths: Sequence[FrameTruth], starts: Int64) -> FrameTruth:
    def flat(arrays: Sequence[NDArray[np.generic]]) -> NDArray[np.generic]:
        return np.concatenate([array.reshape(-1) for array in arrays])[None]

    def shifted(samples: Sequence[Int64]) -> Int64:
        return np.concatenate(
            [sample + start for sample, start in zip(samples, starts[:-1], strict=True)]
        )

    doubts = [truth.doubt for truth in truths]
    hits = np.cumsum([0, *(len(doubt.triangle) for doubt in doubts)])
    offsets = [doubt.offsets[:-1] + at for doubt, at in zip(doubts, hits[:-1], strict=True)]
    blends = [truth.blend for truth in truths]
    blend = BlendVisibility(
        np.concatenate([blend.object for blend in blends]),
        shifted([blend.sample for blend in blends]),
        np.concatenate([blend.triangle for blend in blends]),
        np.concatenate([blend.depth for blend in blends]),
    )
    return FrameTruth(
        truths[0].camera,
        truths[0].engine,
        VisibilityBuffer(
            flat([truth.buffer.triangle for truth in truths]).astype(np.int32),
            flat([truth.buffer.depth for truth in truths]).astype(np.float64),
        ),
        Ties(
            shifted([truth.ties.sample for truth in truths]),
            np.concatenate([truth.ties.triangle for truth in truths]),
        ),
        all(truth.ties_complete for truth in truths),
        Doubt(
            shifted([doubt.sample for doubt in doubts]),
            np.concatenate([*offsets, hits[-1:]]).astype(np.int64),
            np.concatenate([doubt.triangle for doubt in doubts]),
        ),
        blend,
        np.unique(np.concatenate([truth.veiled for truth in truths])),
    )


def _first(found: Sequence[Int64], starts: Int64) -> Int64:
    """(n,) int64, for each object the first view's sample that is one (not below 0), shifted."""
    result = np.full(len(found[0]), -1, np.int64)
    for samples, start in reversed(list(zip(found, starts[:-1].tolist(), strict=True))):
        result = np.where(samples >= 0, samples + start, result)
    return result


def _seen(seen: Sequence[ObjectVisibility], starts: Int64) -> ObjectVisibility:
    sample = _first([one.sample for one in seen], starts)
    view = np.clip(np.searchsorted(starts, sample, side="right") - 1, 0, None)
    depths = np.stack([one.depth for one in seen])
    return ObjectVisibility(
        sum((one.samples for one in seen), np.zeros_like(seen[0].samples)),
        sum((one.alone for one in seen), np.zeros_like(seen[0].alone)),
        sample,
        depths[view, np.arange(depths.shape[1])],
        np.minimum.reduce([one.nearest for one in seen]),
        sum(one.owned for one in seen),
    )


def _walk(frames: Sequence[SettledFrame], starts: Int64) -> SampleWalk:
    walks = [frame.walk for frame in frames]
    # Glass that is lost is named by its place among the joined hits, which stand view by view too.
    hits = np.cumsum([0, *(len(frame.truth.blend.object) for frame in frames)])

    def shifted(samples: Sequence[Int64]) -> Int64:
        return np.concatenate(
            [sample + start for sample, start in zip(samples, starts[:-1], strict=True)]
        )

    return SampleWalk(
        np.logical_or.reduce([walk.shows for walk in walks]),
        sum((walk.lost for walk in walks), np.zeros_like(walks[0].lost)),
        _first([walk.lost_sample for walk in walks], starts),
        sum((walk.lost_blended for walk in walks), np.zeros_like(walks[0].lost_blended)),
        _first([walk.blended_hit for walk in walks], hits),
        sum((walk.charged for walk in walks), np.zeros_like(walks[0].charged)),
        np.logical_or.reduce([walk.lost_triangle for walk in walks]),
        shifted([walk.lost_samples for walk in walks]),
        shifted([walk.lost_blended_samples for walk in walks]),
        shifted([walk.undecided_samples for walk in walks]),
    )


def _rulings(frames: Sequence[SettledFrame], starts: Int64) -> Rulings:
    count = len(frames[0].walk.lost)
    most = np.full(count, np.iinfo(np.int64).min)
    best, margin_px, margin_depth = (
        np.full(count, -1),
        np.full(count, np.nan),
        np.full(count, np.nan),
    )
    charged, excused = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    for frame, start in zip(frames, starts[:-1].tolist(), strict=True):
        lost = np.flatnonzero(frame.walk.lost)
        within = np.isin(lost, np.fromiter(frame.rulings.within_raster, np.int64))
        excused[lost[within]] = charged[lost[~within]] = True
        # The witness is from the view that loses most, of those that nothing excuses.
        rank = frame.walk.lost[lost] - np.where(within, 1 << 40, 0)
        better = rank > most[lost]
        lost = lost[better]
        most[lost] = rank[better]
        sample, margin_px[lost], margin_depth[lost] = frame.rulings.measured.of(lost)
        best[lost] = np.where(sample >= 0, sample, frame.walk.lost_sample[lost]) + start
    known = np.flatnonzero(best >= 0)
    return Rulings(
        corrections=sum(frame.rulings.corrections for frame in frames),
        within_raster=frozenset(np.flatnonzero(excused & ~charged).tolist()),
        measured=Measured(known, best[known], margin_px[known], margin_depth[known]),
    )


def _confirmed(found: Sequence[tuple[Superfluous, ...]], starts: Int64) -> tuple[Superfluous, ...]:
    """Units that are confirmed in every view, with all samples that were examined, and what hides
    them where most of these are."""
    by_view = [{one.unit: one for one in units} for units in found]
    everywhere = reduce(set.intersection, (set(units) for units in by_view))
    result = []
    for unit in sorted(everywhere):
        each = [
            replace(
                units[unit], sample=units[unit].sample + start if units[unit].sample >= 0 else -1
            )
            for units, start in zip(by_view, starts[:-1].tolist(), strict=True)
        ]
        most = max(each, key=lambda one: one.samples)
        result.append(replace(most, samples=sum(one.samples for one in each)))
    return tuple(result)
