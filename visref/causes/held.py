"""Answers that are held: until something happens, for so many frames, or in a list that changes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from visref.causes.answers import answered, of_others
from visref.causes.in_view import kept_by_depth
from visref.causes.sights import At, Sight, Tell, Told
from visref.scene import Int32, Int64

Bool = NDArray[np.bool_]

# An answer is held over so many frames at most.
LOOK_BACK = 64
# Every so many frames answers may be found anew.
STEPS = (2, 3, 4, 5, 6, 8, 10, 15)


def unchanged(at: At) -> Sight | None:
    """The frame since which the culler's own answer has been the same, unless that is this one, or
    the first of all."""
    moments, answers = at.sights.moments, at.sights.answers
    now, frame = answers.at(at.frame, at.view), at.frame
    if now is None:
        return None
    for _ in range(LOOK_BACK):
        before = moments.before(frame, 1)
        then = None if before is None else answers.at(before, at.view)
        if before is None or then is None or not np.array_equal(then, now):
            break
        frame = before
    if frame in (at.frame, moments.frames[0]):
        return None
    return at.then(frame)


def before_that(count: int) -> Callable[[At], Sight | None]:
    """So many frames before the one since which the answer has been the same."""

    def sight(at: At) -> Sight | None:
        since = unchanged(at)
        return None if since is None else at.then(at.sights.moments.before(since.frame, count))

    return sight


def every(step: int, late: int = 0) -> Callable[[At], Sight | None]:
    """The last frame whose number among all is a multiple, or (`late`) so many frames before."""

    def sight(at: At) -> Sight | None:
        moments = at.sights.moments
        back = moments.place(at.frame) % step + late
        return at.then(moments.before(at.frame, back)) if back else None

    return sight


Listed = Callable[[Int64, Int64, int], Int64]


def as_before(now: Int64, before: Int64, count: int) -> Int64:
    """Places in the list of this frame, answers in the order of the frame before."""
    found = np.arange(count)
    known = min(len(now), len(before))
    found[now[:known]] = before[:known]
    return found


def as_all(now: Int64, before: Int64, count: int) -> Int64:
    """Answers in the order of what is there, read by the numbers of all."""
    found = np.full(count, -1)
    found[: len(now)] = now
    return found


def from_all(now: Int64, before: Int64, count: int) -> Int64:
    """Answers by the numbers of all, read in the order of what is there."""
    found = np.full(count, -1)
    found[now] = np.arange(len(now))
    return found


def moved_up(now: Int64, before: Int64, count: int) -> Int64:
    """The last has taken the place of each that was removed, after the answer was given."""
    listed, there = before.tolist(), set(now.tolist())
    for gone in [one for one in before.tolist() if one not in there]:
        at, last = listed.index(gone), listed.pop()
        if last != gone:
            listed[at] = last
    found = np.arange(count)
    found[listed] = before[: len(listed)]
    return found


def of_list(order: Listed) -> dict[str, Tell]:
    """Each unit gets the answer of another, as what is there changes."""

    def others(at: At) -> tuple[Int32, Bool] | None:
        moments, count = at.sights.moments, at.sights.units.count
        frame = moments.before(at.frame, 1)
        if frame is None or count != at.scene.object_count:
            return None
        absent, then = (moments.timeline.absent(one) for one in (at.frame, frame))
        if not absent.any() and not then.any():
            return None
        ids = order(np.flatnonzero(~absent), np.flatnonzero(~then), count)[at.ids]
        if np.array_equal(ids, at.ids):
            return None
        return np.maximum(ids, 0).astype(np.int32), ids >= 0

    return of_others(others)


def in_every_view(at: At) -> Told:
    """Drawn in no view unless it is in all of them."""
    others = at.other_views()
    if not others:
        return None
    kept = at.boxes.in_view
    for one in others:
        kept = kept & one.boxes(at.ids).in_view
    return kept


def seen_in_every_view(at: At) -> Told:
    others = at.other_views()
    if not others:
        return None
    kept = at.now.seen[at.ids]
    for one in others:
        kept = kept & one.seen[at.ids]
    return kept


def of_any_other(at: At) -> Told:
    """What some other view shows."""
    others = at.other_views()
    if not others:
        return None
    return np.asarray(np.any([kept_by_depth(at, one.boxes(at.ids), one) for one in others], axis=0))


HELD: dict[str, dict[str, Tell]] = {
    "one-frame-late": {f"every 2, {how}": tell for how, tell in answered(every(2)).items()},
    "n-frames-late": {
        **{f"unchanged since, {how}": tell for how, tell in answered(unchanged).items()},
        **{
            f"{count} before, unchanged since, {how}": tell
            for count in (1, 2)
            for how, tell in answered(before_that(count)).items()
            # It is the same since, and so not that of before.
            if how != "repeated"
        },
        **{
            f"every {step}{', as late again' * again}, {how}": tell
            for step in STEPS[1:]
            for again in (False, True)
            for how, tell in answered(every(step, again * step)).items()
        },
    },
    "other-view": {
        "in all of them": in_every_view,
        "seen in all of them": seen_in_every_view,
        "any other": of_any_other,
    },
    "ids-shifted": {
        f"{name}, {how}": tell
        for name, order in (
            ("list of before", as_before),
            ("order of what is there", as_all),
            ("numbers of all", from_all),
            ("last moved up", moved_up),
        )
        for how, tell in of_list(order).items()
    },
}
