"""What is left out whatever is there, and boxes or occluders of another pose."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import Boxes
from visref.causes.in_view import kept_by_depth
from visref.causes.layers import Layers, draw
from visref.causes.rectangles import by_box
from visref.causes.sights import AT_REST, At, Sight, Tell, Told, facing
from visref.scene import Alpha

Bool = NDArray[np.bool_]

# Over how many frames it is looked back for whether something was drawn.
LOOK_BACK = 64


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
            if not scene.has_one_sided:
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


def _before(count: int) -> Callable[[At], int | None]:
    return lambda at: at.sights.moments.before(at.frame, count)


_frame_before = _before(1)


def _first_frame(at: At) -> int | None:
    frame = at.sights.moments.frames[0]
    return None if frame == at.frame else frame


def rest(at: At) -> Sight | None:
    if not at.sights.moments.timeline.moves:
        return None
    return at.sights.sight(at.frame, at.view, AT_REST)


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


def until_drawn(tell: Tell) -> Tell:
    """The same, until a unit is drawn for the first time."""

    def told(at: At) -> Told:
        kept = tell(at)
        if kept is None:
            return None
        moments, answers = at.sights.moments, at.sights.answers
        drawn = np.zeros(len(at.ids), np.bool_)
        frame = moments.before(at.frame, 1)
        for _ in range(LOOK_BACK):
            then = None if frame is None else answers.at(frame, at.view)
            if frame is None or then is None:
                break
            drawn |= then[at.ids]
            frame = moments.before(frame, 1)
        return kept | drawn

    return told


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
    "appeared-unknown": {
        "absent at first": absent_at_first,
        "absent before": absent_once,
        "absent at first, until drawn": until_drawn(absent_at_first),
        "absent before, until drawn": until_drawn(absent_once),
    },
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
MOVED_IN_VIEW: dict[str, dict[str, Tell]] = {
    "rest-pose": {"view": rest_view, "first frame's view": standing(_first_frame)["view"]},
    "old-pose": {
        "view": standing(_frame_before)["view"],
        **{f"{n} frames before, view": standing(_before(n))["view"] for n in (2, 3, 4)},
    },
}
MOVED: dict[str, dict[str, Tell]] = {
    "removed-still-hides": {"": removed_hides},
    "rest-pose": {
        "boxes": rest_boxes,
        "wholly": rest_wholly,
        "first frame's boxes": standing(_first_frame)["boxes"],
    },
    "bounds-too-small": {"rest pose's, moved": rest_moved},
    "old-pose": {
        "boxes": standing(_frame_before)["boxes"],
        **{f"{n} frames before, boxes": standing(_before(n))["boxes"] for n in (2, 3, 4)},
    },
    "old-occluders": {
        **hiding(_frame_before),
        **{
            f"{n} frames before, {how}": tell
            for n in (2, 3, 4)
            for how, tell in hiding(_before(n)).items()
        },
        "at rest": rest_hides,
        **{f"first frame, {how}": tell for how, tell in hiding(_first_frame).items()},
    },
}
