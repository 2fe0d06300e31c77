"""What a cause is called, and which misses each explains."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

# Every cause that may be named, and what it says of the culler. The codes stand in records.
CODES: Mapping[str, str] = {
    # Materials.
    "glass-solid": "glass hides as if it were opaque",
    "masks-solid": "alpha masks hide as if they were solid",
    "masked-left-out": "what is alpha-masked is not drawn",
    "glass-left-out": "glass is not drawn",
    # What moves.
    "removed-still-hides": "what was removed hides still",
    "appeared-unknown": "what was absent before is not known",
    "rest-pose": "boxes or occluders stand as in the rest pose",
    "old-pose": "boxes stand where they were in the frame before",
    "old-occluders": "occluders stand where they were in the frame before",
    # Time.
    "one-frame-late": "answered one frame late",
    # Several views.
    "first-view-only": "the first view's answer for all views",
    "other-view": "the answer of another view",
    # What is in the view.
    "no-lens-shift": "the frustum leaves out the lens shift, or half of it",
    "lens-shift-reversed": "the frustum has the lens shift on the other side",
    "roll-ignored": "the frustum leaves out the camera's roll",
    "corners-only": "a box counts as outside where none of its corners is in the view",
    "eye-inside-box": "a box that holds the eye counts as outside",
    "corners-behind-eye": "box corners behind the eye are dropped, clamped or mirrored",
    "centre-only": "an object counts as outside where its box's centre is",
    "pivot": "an object counts as outside where its origin is",
    "near-larger": "the near plane lies farther out",
    "far-nearer": "the far plane lies nearer",
    "bounds-too-small": "the box or sphere that is tested does not hold the object",
    # What hides it.
    "wrong-occluder-clip": "occluders are not cut by the near or clip plane",
    "euclidean-depth": "straight distance is compared with a view depth",
    "too-few-samples": "objects that show in few samples are dropped",
    "own-depth": "an object is hidden by its own depth, or by an equal one",
    "centre-depth": "the box's centre depth is compared in place of its nearest",
    "farthest-depth": "the box's farthest depth is compared in place of its nearest",
    "few-samples": "only some samples of the box's rectangle are tested",
    "coarse-depth-1/2": "depth has half of the resolution, and a hole may lie between its samples",
    "coarse-depth-1/4": "depth has 1/4 of the resolution, and a hole may lie between its samples",
    "odd-size-pyramid": "the depth pyramid loses the last row or column of an odd size",
    "nearest-of-region": "the rectangle's nearest depth is compared in place of its farthest",
    "coarse-depth-1/8": "depth has 1/8 of the resolution, and a hole may lie between its samples",
    "coarse-depth-1/16": "depth has 1/16 of the resolution, and a hole may lie between its samples",
    "rectangle-too-small": "the rectangle that is tested is smaller than the box",
    "flipped": "depth or rectangle is upside down or mirrored",
    "occluders-too-large": "what hides is taken for larger than it is",
    "quantised-depth": "depths are rounded too coarsely",
    "empty-hides": "pixels in which nothing was drawn hide",
    "depth-not-compared": "whatever covers its pixels hides an object, nearer or not",
    # Sizes.
    "two-frames-late": "answered two frames late",
    "first-answer-kept": "the first frame's answer is kept",
    "old-depth": "this frame's boxes against the depth of the frame before",
    "gap-too-narrow": "what is seen through a narrow gap is dropped",
    # Lists.
    "absent-lod": "another level of detail is drawn, which is not there",
    "ids-wrap": "ids wrap at a power of two",
    # What might be said of many a scene.
    "other-lens": "the frustum has another field of view or aspect",
    "n-frames-late": "answered several frames late",
    "last-view": "the frustum of the frame before",
    "across-a-cut": "the answer from before a cut is kept",
    "flat-box": "a box without thickness is dropped",
    "nothing-drawn": "nothing at all is drawn in that frame or view",
    "list-full": "the list of what is drawn is cut off",
    "on-the-plane": "what touches a plane of the view counts as outside",
    "rounded-coordinates": "positions are rounded too coarsely",
    "origin-forgotten": "camera and boxes are about different origins",
    "back-faces": "the side from which a face can be seen is got wrong",
    "same-names": "of objects with one name only the first is known",
    "ids-shifted": "each object has its neighbour's answer",
    "never-drawn": "never drawn, in whichever frame it is seen",
}


@dataclass(frozen=True)
class Named:
    """A cause, with its share of what it explains, less what it predicts wrongly: 0 to 1."""

    cause: str
    score: float

    @property
    def text(self) -> str:
        return CODES[self.cause]


# A missed object of a view ("" for all of a frame's): frame, view, object.
Where = tuple[int, str, int]


@dataclass
class CausesFound:
    """The causes of one culler's misses. `named`: by missed object, the likeliest first;
    `examined`: those that were looked at, of which some may have none."""

    named: dict[Where, tuple[Named, ...]] = field(default_factory=dict)
    examined: frozenset[Where] = frozenset()

    def of(self, frame: int, view: str, object: int) -> tuple[Named, ...]:
        """What explains a miss, the likeliest first; nothing if nothing does. Of an answer that is
        for all of a frame's views, any of them may be named."""
        found = self.named.get((frame, view, object))
        return found if found is not None else self.named.get((frame, "", object), ())

    def grouped(self) -> list[dict[str, object]]:
        """As in `verdict.json`: causes by how many misses they explain best, the most first, each
        with those that may explain at least half of these misses as well."""
        misses, score = Counter[str](), dict[str, float]()
        objects: dict[str, set[int]] = defaultdict(set)
        beside: dict[str, Counter[str]] = defaultdict(Counter)
        for (_, _, obj), (first, *others) in self.named.items():
            misses[first.cause] += 1
            objects[first.cause].add(obj)
            score[first.cause] = max(score.get(first.cause, 0.0), first.score)
            beside[first.cause].update(one.cause for one in others)
        return [
            {
                "cause": cause,
                "text": CODES[cause],
                "alternatives": [
                    {"cause": other, "text": CODES[other]}
                    for other, times in sorted(
                        beside[cause].items(), key=lambda one: (-one[1], one[0])
                    )
                    if 2 * times >= count
                ],
                "misses": count,
                "examined": len(self.examined),
                "objects": len(objects[cause]),
                "score": round(score[cause], 3),
            }
            for cause, count in sorted(misses.items(), key=lambda one: (-one[1], one[0]))
        ]
