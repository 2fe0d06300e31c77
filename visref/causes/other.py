"""Materials, time, motion, views and lists: who else's answer it might be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import Boxes
from visref.causes.hidden import by_box
from visref.causes.in_view import kept_by_depth
from visref.causes.layers import Layers, draw
from visref.causes.rectangles import asked
from visref.causes.sights import At, Sight, Tell, Told, facing
from visref.scene import Alpha, Int32

Bool = NDArray[np.bool_]


def left_out(kind: Alpha) -> Tell:
    def tell(at: At) -> Told:
        flags = at.scene.alpha == kind
        return ~at.any_triangle(flags) if flags.any() else None

    return tell


def left_out_whole(kind: Alpha) -> Tell:
    def tell(at: At) -> Told:
        flags = at.scene.alpha == kind
        return ~at.every_triangle(flags) if flags.any() else None

    return tell


def turned_away(*, one_sided_only: bool = False, reverse: bool = False, axis: bool = False,
                eye: bool = False, first: bool = False) -> Tell:  # fmt: skip
    """Left out where all triangles (or the first) turn away."""

    def tell(at: At) -> Told:
        scene = at.scene
        if eye and at.camera.is_perspective:
            return None
        away = ~facing(scene, at.camera, axis=axis, eye=eye)
        if reverse:
            away = ~away
        if one_sided_only:
            if not scene.one_sided.any():
                return None
            away &= scene.one_sided
        if not first:
            return ~at.every_triangle(away)
        units = at.sights.units
        kept = np.ones(len(at.ids), np.bool_)
        filled = units.sizes[at.ids] > 0
        kept[filled] = ~away[units.triangles[units.offsets[at.ids[filled]]]]
        return kept

    return tell


def answered(sight: Callable[[At], Sight | None]) -> dict[str, Tell]:
    def shown(at: At) -> Told:
        there = sight(at)
        return None if there is None or there is at.now else there.seen[at.ids]

    def boxes(at: At) -> Told:
        there = sight(at)
        if there is None or there is at.now:
            return None
        return kept_by_depth(at, there.boxes(at.ids), there) | _gone(there, at)

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
        return then[at.ids] | there.seen[at.ids]

    return {"repeated": repeated, "what shows": shown, "boxes": boxes}


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


def old_depth(at: At) -> Told:
    before = at.before(1)
    if before is None or (before.camera.width, before.camera.height) != (
        at.camera.width,
        at.camera.height,
    ):
        return None
    return by_box(at, before.layers())


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


def standing(frame: Callable[[At], int | None]) -> dict[str, Tell]:
    """Boxes as they stood in another frame, before this camera."""

    def sight(at: At) -> Sight | None:
        other = frame(at)
        if other is None or not at.sights.moments.timeline.moves:
            return None
        return at.sights.sight(at.frame, at.view, other)

    def boxes(at: At) -> Told:
        there = sight(at)
        if there is None:
            return None
        # Boxes of then against the depth of now.
        return kept_by_depth(at, there.boxes(at.ids)) | ~at.boxes.there

    def view(at: At) -> Told:
        there = sight(at)
        return None if there is None else there.boxes(at.ids).in_view | ~at.boxes.there

    return {"boxes": boxes, "view": view}


def hiding(frame: Callable[[At], int | None]) -> dict[str, Tell]:
    """What hides as it stood in another frame, before this camera."""

    def boxes(at: At) -> Told:
        other = frame(at)
        if other is None or not at.sights.moments.timeline.moves:
            return None
        return by_box(at, at.sights.sight(at.frame, at.view, other).layers())

    def both(at: At) -> Told:
        """Then and now: where it was hides too."""
        other = frame(at)
        if other is None or not at.sights.moments.timeline.moves:
            return None
        then = by_box(at, at.sights.sight(at.frame, at.view, other).layers())
        return then & by_box(at, at.now.layers())

    return {"then": boxes, "then and now": both}


def _frame_before(at: At) -> int | None:
    return at.sights.moments.before(at.frame, 1)


def _first_frame(at: At) -> int | None:
    frame = at.sights.moments.frames[0]
    return None if frame == at.frame else frame


def rest(at: At) -> Sight | None:
    timeline = at.sights.moments.timeline
    if not timeline.moves:
        return None
    return at.sights.of(at.frame, timeline.still, at.camera)


def rest_boxes(at: At) -> Told:
    there = rest(at)
    return None if there is None else kept_by_depth(at, there.boxes(at.ids)) | ~at.boxes.there


def rest_view(at: At) -> Told:
    there = rest(at)
    return None if there is None else there.boxes(at.ids).in_view | ~at.boxes.there


def rest_moved(at: At) -> Told:
    """Boxes of the rest pose, moved to where the object is."""
    there = rest(at)
    if there is None:
        return None
    then, now = there.boxes(at.ids).boxes, at.boxes.boxes
    with np.errstate(invalid="ignore"):
        moved = then + (now - then).mean(axis=1, keepdims=True)
    boxes = Boxes(at.camera, np.where(np.isfinite(moved), moved, np.inf))
    return kept_by_depth(at, boxes) | ~at.boxes.there


def rest_hides(at: At) -> Told:
    there = rest(at)
    return None if there is None else by_box(at, there.layers())


def rest_wholly(at: At) -> Told:
    there = rest(at)
    if there is None:
        return None
    return kept_by_depth(at, there.boxes(at.ids), there) | ~at.boxes.there


def removed_hides(at: At) -> Told:
    """What is absent now hides where it last stood, beside what is there."""
    moments = at.sights.moments
    absent = at.scene.absent
    if absent is None or not absent.any():
        return None
    gone = absent.copy()
    layers = at.now.layers()
    ghost = Layers(layers.nearest.copy(), layers.owner.copy(), layers.second.copy())
    drawn = False
    frame = moments.before(at.frame, 1)
    while frame is not None and gone.any():
        scene = moments.timeline.at(frame)
        there = gone if scene.absent is None else gone & ~scene.absent
        if there.any():
            which = np.flatnonzero(there[scene.object_of_triangle] & (scene.alpha == Alpha.OPAQUE))
            place = at.now.place
            draw(ghost, scene.vertices, scene.triangles, at.camera, which, place.unit_of)
            gone &= ~there
            drawn = True
        frame = moments.before(frame, 1)
    return by_box(at, ghost) if drawn else None


def absent_at_first(at: At) -> Told:
    first = at.sights.moments.timeline.at(at.sights.moments.frames[0])
    if first.absent is None or not first.absent.any():
        return None
    return ~first.absent[np.maximum(at.objects(), 0)]


def absent_once(at: At) -> Told:
    moments = at.sights.moments
    once = np.zeros(at.scene.object_count, np.bool_)
    for frame in moments.frames:
        if frame == at.frame:
            break
        once |= moments.timeline.absent(frame)
    return ~once[np.maximum(at.objects(), 0)] if once.any() else None


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


def neighbour(step: int) -> dict[str, Tell]:
    """The answer of the unit whose id is so many higher."""

    def others(at: At) -> tuple[Int32, Bool]:
        ids = at.ids + np.int32(step)
        known = (ids >= 0) & (ids < at.sights.units.count)
        return np.where(known, ids, 0).astype(np.int32), known

    def of(told: Callable[[At], Bool]) -> Tell:
        def tell(at: At) -> Told:
            ids, known = others(at)
            return told(replace(at, ids=ids)) & known

        return tell

    return {
        f"{step:+d}, what shows": of(lambda at: at.now.seen[at.ids]),
        f"{step:+d}, boxes": of(lambda at: kept_by_depth(at, at.boxes)),
        f"{step:+d}, in the view": of(lambda at: at.boxes.in_view),
    }


def neighbour_in_order(at: At) -> Told:
    """Front to back, the answer of the one before."""
    every = np.arange(at.sights.units.count, dtype=np.int32)
    if len(every) > 4096:
        return None
    everyone = replace(at, ids=every)
    boxes = everyone.boxes
    asked = np.flatnonzero(boxes.in_view)
    order = asked[np.argsort(boxes.nearest[asked], kind="stable")]
    answers = kept_by_depth(everyone, boxes)
    kept = np.zeros(len(every), np.bool_)
    kept[order[1:]] = answers[order[:-1]]
    kept[order[:1]] = True
    return kept[at.ids] | ~at.boxes.in_view


def wraps(bits: int) -> Tell:
    def tell(at: At) -> Told:
        return at.ids < 1 << bits if at.sights.units.count > 1 << bits else None

    return tell


def not_first_of_name(at: At) -> Told:
    names = at.scene.given_names
    if len(set(names)) == len(names):
        return None
    seen: set[str] = set()
    first = np.zeros(len(names), np.bool_)
    for index, name in enumerate(names):
        first[index] = name not in seen
        seen.add(name)
    return first[np.maximum(at.objects(), 0)]


# Without a look at what else is there.
LEFT_OUT: dict[str, dict[str, Tell]] = {
    "masked-left-out": {"any": left_out(Alpha.MASK), "whole": left_out_whole(Alpha.MASK)},
    "glass-left-out": {"any": left_out(Alpha.BLEND), "whole": left_out_whole(Alpha.BLEND)},
    "same-names": {"": not_first_of_name},
    "ids-wrap": {str(1 << bits): wraps(bits) for bits in (8, 16)},
    "appeared-unknown": {"absent at first": absent_at_first, "absent before": absent_once},
    "last-view": {"": in_view_before},
    "first-view-only": {"view": _view_of(_first_view)},
    "other-view": {"view": _view_of(_other_view)},
    "back-faces": {
        "reversed": turned_away(reverse=True),
        "one-sided reversed": turned_away(reverse=True, one_sided_only=True),
        "two-sided": turned_away(),
        "by the view's axis": turned_away(axis=True),
        "by the eye": turned_away(eye=True),
        "by the first triangle": turned_away(first=True),
        "one-sided by axis": turned_away(axis=True, one_sided_only=True),
        "one-sided by the eye": turned_away(eye=True, one_sided_only=True),
        "one-sided by the first": turned_away(first=True, one_sided_only=True),
    },
}
# Boxes or occluders of another moment.
MOVED: dict[str, dict[str, Tell]] = {
    "removed-still-hides": {"": removed_hides},
    "rest-pose": {
        "boxes": rest_boxes,
        "view": rest_view,
        "wholly": rest_wholly,
        **{f"first frame's {how}": tell for how, tell in standing(_first_frame).items()},
    },
    "bounds-too-small": {"rest pose's, moved": rest_moved},
    "old-pose": standing(_frame_before),
    "old-occluders": {
        **hiding(_frame_before),
        "at rest": rest_hides,
        **{f"first frame, {how}": tell for how, tell in hiding(_first_frame).items()},
    },
}
# The answer of another moment or view, or to another question.
ANSWERED: dict[str, dict[str, Tell]] = {
    "one-frame-late": late(1),
    "old-depth": {"then": old_depth, "not cleared": old_and_new_depth},
    "first-view-only": answered(_first_view),
    "other-view": {
        **answered(_other_view),
        **{f"before, {how}": tell for how, tell in answered(_next_view(-1)).items()},
    },
    "first-answer-kept": answered(_first),
    "two-frames-late": late(2),
    "n-frames-late": {
        f"{count} frames, {how}": tell
        for count in (3, 4, 5, 6, 8)
        for how, tell in late(count).items()
    },
    "across-a-cut": {
        **answered(_before_cut),
        **{f"since, {how}": tell for how, tell in answered(_since_cut).items()},
    },
    "ids-shifted": {**neighbour(1), **neighbour(-1), "in order": neighbour_in_order},
}
