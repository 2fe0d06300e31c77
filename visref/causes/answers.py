"""The answer of another moment, of another view, or to another question."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.causes.in_view import kept_by_depth
from visref.causes.rectangles import asked, by_box
from visref.causes.sights import At, Sight, Tell, Told
from visref.scene import Int32

Bool = NDArray[np.bool_]

# Over how many frames it is followed for how long something has been left out.
LOOK_BACK = 64


def answered(sight: Callable[[At], Sight | None]) -> dict[str, Tell]:
    def shown(at: At) -> Told:
        there = sight(at)
        return None if there is None or there is at.now else there.seen[at.ids]

    def boxes(at: At) -> Told:
        there = sight(at)
        if there is None or there is at.now:
            return None
        return kept_by_depth(at, there.boxes(at.ids), there) | _gone(there, at)

    def asked_then(at: At) -> Told:
        """Only what was in the view then was asked about: the rest is drawn if it is in the view
        of now."""
        there = sight(at)
        if there is None or there is at.now:
            return None
        then = there.boxes(at.ids)
        return (kept_by_depth(at, then, there) | ~then.in_view) & at.boxes.in_view

    def view(at: At) -> Told:
        there = sight(at)
        if there is None or there is at.now:
            return None
        return there.boxes(at.ids).in_view

    def repeated(at: At) -> Told:
        """The culler's own answer of then, where it is that of now too, as far as it was right
        then."""
        there = sight(at)
        if there is None or there is at.now:
            return None
        then = at.sights.answers.at(there.frame, there.camera.view)
        now = at.sights.answers.at(at.frame, at.view)
        if then is None or now is None or not np.array_equal(then, now):
            return None
        if not (now & there.seen & ~at.now.seen).any():
            # Nothing that was seen then and is hidden now shows that the answer is an old one.
            return None
        return then[at.ids] | there.seen[at.ids]

    return {
        "repeated": repeated,
        "what shows": shown,
        "boxes": boxes,
        "in the view": view,
        "asked then": asked_then,
    }


def _gone(sight: Sight, at: At) -> Bool:
    """(k,) none: what was not there was in no answer."""
    return np.zeros(len(at.ids), np.bool_)


def late(count: int) -> dict[str, Tell]:
    return answered(lambda at: at.before(count))


def in_view_before(at: At) -> Told:
    before = at.before(1)
    if before is None:
        return None
    return at.now.boxes(at.ids, before.camera).in_view | ~at.boxes.there


def depth_of(sight: Callable[[At], Sight | None]) -> Tell:
    """This frame's boxes against the depth of another."""

    def tell(at: At) -> Told:
        before = sight(at)
        if before is None or (before.camera.width, before.camera.height) != (
            at.camera.width,
            at.camera.height,
        ):
            return None
        return by_box(at, before.layers())

    return tell


def old_and_new_depth(at: At) -> Told:
    """The depth before is drawn over in place of being cleared."""
    before = at.before(1)
    if before is None or before.layers().owner.shape != at.now.layers().owner.shape:
        return None
    then = asked(at, at.boxes.rectangles, at.boxes.nearest, layers=before.layers()).passing > 0
    now = by_box(at, at.now.layers())
    return now & then | at.boxes.crossing | ~at.boxes.there


def _first(at: At) -> Sight | None:
    frame = at.sights.moments.frames[0]
    return None if frame == at.frame else at.then(frame)


def _since_cut(at: At) -> Sight | None:
    frame = at.sights.moments.since_cut(at.frame)
    first = frame == at.sights.moments.frames[0]
    return None if frame == at.frame or first else at.then(frame)


def _before_cut(at: At) -> Sight | None:
    moments = at.sights.moments
    if not moments.cameras(at.frame)[0].cut:
        return None
    return at.before(1)


def _until_cut(at: At) -> Sight | None:
    """The last frame before the cut that began what this one is in."""
    moments = at.sights.moments
    return at.then(moments.before(moments.since_cut(at.frame), 1))


def _other_view(at: At) -> Sight | None:
    others = at.other_views()
    return others[0] if len(others) == 1 else None


def _next_view(step: int) -> Callable[[At], Sight | None]:
    def sight(at: At) -> Sight | None:
        moments = at.sights.moments
        views = [camera.view for camera in moments.cameras(at.frame)]
        if len(views) < 2:
            return None
        place = views.index(at.view) + step
        if 0 <= place < len(views):
            return at.sights.sight(at.frame, views[place])
        before = moments.before(at.frame, 1)
        if before is None or place > 0:
            return None
        return at.sights.sight(before, views[-1])

    return sight


def _first_view(at: At) -> Sight | None:
    views = [camera.view for camera in at.sights.moments.cameras(at.frame)]
    return None if len(views) < 2 else at.sights.sight(at.frame, views[0])


def _view_of(sight: Callable[[At], Sight | None]) -> Tell:
    def tell(at: At) -> Told:
        there = sight(at)
        return None if there is None else there.boxes(at.ids).in_view | ~at.boxes.there

    return tell


def of_others(others: Callable[[At], tuple[Int32, Bool] | None]) -> dict[str, Tell]:
    """Each unit gets the answer of another. `others`: (k,) int32 which, and (k,) bool whether there
    is such a one; None where nothing is said."""

    def of(told: Callable[[At], Bool]) -> Tell:
        def tell(at: At) -> Told:
            found = others(at)
            return None if found is None else told(replace(at, ids=found[0])) & found[1]

        return tell

    return {
        "what shows": of(lambda at: at.now.seen[at.ids]),
        "boxes": of(lambda at: kept_by_depth(at, at.boxes)),
        "in the view": of(lambda at: at.boxes.in_view),
    }


def neighbour(step: int) -> dict[str, Tell]:
    """The answer of the unit whose id is so many higher."""

    def others(at: At) -> tuple[Int32, Bool]:
        ids = at.ids + np.int32(step)
        known = (ids >= 0) & (ids < at.sights.units.count)
        return np.where(known, ids, 0).astype(np.int32), known

    return {f"{step:+d}, {how}": tell for how, tell in of_others(others).items()}


def left_out_before(at: At) -> Told:
    """What was in the view and left out in the frame before stays left out."""
    return _as_before(at, in_view=True)


def nothing_new(at: At) -> Told:
    """What was not drawn in the frame before is not drawn."""
    return _as_before(at, in_view=False)


def _as_before(at: At, *, in_view: bool) -> Told:
    """What was left out stays left out; `in_view`: if it was in the view then.

    Most of what is drawn or missed was so in the frame before, and says nothing by that. So it is
    followed back to where that began: what is missed since it was left out rightly would be left
    out, and so would be what is drawn, though it was once left out.
    """
    frame, answers = at.sights.moments.before(at.frame, 1), at.sights.answers
    then = None if frame is None else answers.at(frame, at.view)
    if frame is None or then is None:
        return None
    objects = at.objects()
    drawn = then[at.ids]
    # What is missed now and was drawn then is not left out because it was.
    was_drawn = drawn & ~np.isin(objects, answers.missed(at.frame, at.view))
    was_missed = ~drawn
    left_out = np.zeros(len(at.ids), np.bool_)
    for _ in range(LOOK_BACK):
        missed = np.isin(objects, answers.missed(frame, at.view)) & ~drawn
        begins = ~drawn & (was_drawn | (was_missed & ~missed))
        if begins.any():
            left_out |= begins & _in_view(at, frame) if in_view else begins
        was_drawn, was_missed = was_drawn & drawn, was_missed & missed
        cut = at.sights.moments.cameras(frame)[0].cut
        before = at.sights.moments.before(frame, 1)
        then = None if before is None else answers.at(before, at.view)
        if before is None or then is None or cut or not (was_drawn | was_missed).any():
            break
        frame, drawn = before, then[at.ids]
    return ~left_out


def _in_view(at: At, frame: int) -> Bool:
    there = at.then(frame)
    if there is None:
        return np.zeros(len(at.ids), np.bool_)
    return there.boxes(at.ids).in_view


def neighbour_in_order(*, first: bool, by_id: bool = False) -> Tell:
    """The answer of the one asked before it, front to back or by number; `first`: what the first
    of them gets."""
    return lambda at: _in_order(at, first, by_id)


def _in_order(at: At, first: bool, by_id: bool) -> Told:
    every = np.arange(at.sights.units.count, dtype=np.int32)
    if len(every) > 4096:
        return None
    everyone = replace(at, ids=every)
    boxes = everyone.boxes
    asked = np.flatnonzero(boxes.in_view & ~boxes.crossing)
    order = asked if by_id else asked[np.argsort(boxes.nearest[asked], kind="stable")]
    answers = kept_by_depth(everyone, boxes)
    kept = boxes.crossing & boxes.in_view
    kept[order[1:]] = answers[order[:-1]]
    kept[order[:1]] = first
    return kept[at.ids] | ~at.boxes.in_view


# The frustum of another moment or view.
ANOTHER_VIEW: dict[str, dict[str, Tell]] = {
    "last-view": {"": in_view_before},
    "first-view-only": {"view": _view_of(_first_view)},
    "other-view": {"view": _view_of(_other_view), "the first, view": _view_of(_first_view)},
}
# The answer of another moment or view, or to another question.
ANSWERED: dict[str, dict[str, Tell]] = {
    "one-frame-late": late(1),
    "old-depth": {
        "then": depth_of(lambda at: at.before(1)),
        "not cleared": old_and_new_depth,
        "two frames before": depth_of(lambda at: at.before(2)),
        "three frames before": depth_of(lambda at: at.before(3)),
        "first": depth_of(_first),
        "before the cut": depth_of(_until_cut),
    },
    "first-view-only": answered(_first_view),
    "other-view": {
        **answered(_other_view),
        # The first view's answer for the others is another view's too.
        **{f"the first, {how}": tell for how, tell in answered(_first_view).items()},
        **{f"before, {how}": tell for how, tell in answered(_next_view(-1)).items()},
        **{f"next, {how}": tell for how, tell in answered(_next_view(1)).items()},
    },
    "first-answer-kept": {
        **answered(_first),
        "left out before": left_out_before,
        "nothing new": nothing_new,
    },
    "two-frames-late": late(2),
    "n-frames-late": {
        f"{count} frames, {how}": tell
        for count in (3, 4, 5, 6, 8)
        for how, tell in late(count).items()
    },
    "across-a-cut": {
        **answered(_before_cut),
        **{f"since, {how}": tell for how, tell in answered(_since_cut).items()},
        **{f"from before, {how}": tell for how, tell in answered(_until_cut).items()},
    },
    "ids-shifted": {
        **neighbour(1),
        **neighbour(-1),
        "in order": neighbour_in_order(first=True),
        "in order, the first lost": neighbour_in_order(first=False),
        "by number": neighbour_in_order(first=True, by_id=True),
    },
}
