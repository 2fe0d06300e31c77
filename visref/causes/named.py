"""What a cause is called, and which misses each explains."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

# Every cause that may be named, and what it says of the culler. The codes stand in records.
CODES: Mapping[str, str] = {
    # What is in the view.
    "corners-only": "a box counts as outside where none of its corners is in the view",
    "centre-only": "an object counts as outside where its box's centre is",
    "pivot": "an object counts as outside where its origin is",
    "corners-behind-eye": "box corners behind the eye are dropped, clamped or mirrored",
    "eye-inside-box": "a box that holds the eye counts as outside",
    "no-lens-shift": "the frustum leaves out the lens shift",
    "lens-shift-reversed": "the frustum has the lens shift on the other side",
    "lens-shift-halved": "the frustum has half of the lens shift",
    "other-lens": "the frustum has another field of view or aspect",
    "roll-ignored": "the frustum leaves out the camera's roll",
    "flat-box": "a box without thickness is dropped",
    "bounds-too-small": "the box or sphere that is tested does not hold the object",
    "near-larger": "the near plane lies farther out",
    "far-nearer": "the far plane lies nearer",
    "distance-for-far": "straight distance is compared with the far plane's depth",
    "on-the-plane": "what touches a plane of the view counts as outside",
    "rounded-coordinates": "positions are rounded too coarsely",
    # What hides it.
    "centre-depth": "the box's centre depth is compared in place of its nearest",
    "farthest-depth": "the box's farthest depth is compared in place of its nearest",
    "euclidean-depth": "straight distance is compared with view depth",
    "few-samples": "only some samples of the box's rectangle are tested",
    "rectangle-too-small": "the rectangle that is tested is smaller than the box",
    "coarse-depth-1/2": "depth has half of the resolution, and a hole may lie between its samples",
    "coarse-depth-1/4": "depth has 1/4 of the resolution, and a hole may lie between its samples",
    "coarse-depth-1/8": "depth has 1/8 of the resolution, and a hole may lie between its samples",
    "coarse-depth-1/16": "depth has 1/16 of the resolution, and a hole may lie between its samples",
    "nearest-of-region": "the rectangle's nearest depth is compared in place of its farthest",
    "odd-size-pyramid": "the depth pyramid loses the last row or column of an odd size",
    "flipped": "depth or rectangle is upside down or mirrored",
    "quantised-depth": "depths are rounded too coarsely",
    "occluders-too-large": "what hides is taken for larger than it is",
    "own-depth": "an object is hidden by its own depth, or by an equal one",
    "depth-not-compared": "whatever covers its pixels hides an object, nearer or not",
    "empty-hides": "pixels in which nothing was drawn hide",
    "back-faces": "the side from which a face can be seen is got wrong",
    "wrong-occluder-clip": "occluders are not cut by the near or clip plane",
    # Materials.
    "masks-solid": "alpha masks hide as if they were solid",
    "glass-solid": "glass hides as if it were opaque",
    "masked-left-out": "what is alpha-masked is not drawn",
    "glass-left-out": "glass is not drawn",
    # Time.
    "one-frame-late": "answered one frame late",
    "two-frames-late": "answered two frames late",
    "n-frames-late": "answered several frames late",
    "last-view": "the frustum of the frame before",
    "old-depth": "this frame's boxes against the depth of the frame before",
    "first-answer-kept": "the first frame's answer is kept",
    "across-a-cut": "the answer from before a cut is kept",
    # What moves.
    "rest-pose": "boxes or occluders stand as in the rest pose",
    "old-pose": "boxes stand where they were in the frame before",
    "old-occluders": "occluders stand where they were in the frame before",
    "removed-still-hides": "what was removed hides still",
    "appeared-unknown": "what was absent before is not known",
    # Several views.
    "other-view": "the answer of another view",
    "first-view-only": "the first view's answer for all views",
    # Lists.
    "ids-shifted": "each object has its neighbour's answer",
    "ids-wrap": "ids wrap at a power of two",
    "same-names": "of objects with one name only the first is known",
    "list-full": "the list of what is drawn is cut off",
    "absent-lod": "another level of detail is drawn, which is not there",
    "never-drawn": "never drawn, in whichever frame it is seen",
    # Sizes.
    "too-few-samples": "objects that show in few samples are dropped",
    "gap-too-narrow": "what is seen through a narrow gap is dropped",
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
        """As in `verdict.json`: causes by how many misses they explain best, the most first."""
        misses, score = Counter[str](), dict[str, float]()
        objects: dict[str, set[int]] = defaultdict(set)
        for (_, _, obj), (first, *_) in self.named.items():
            misses[first.cause] += 1
            objects[first.cause].add(obj)
            score[first.cause] = max(score.get(first.cause, 0.0), first.score)
        return [
            {
                "cause": cause,
                "text": CODES[cause],
                "misses": count,
                "examined": len(self.examined),
                "objects": len(objects[cause]),
                "score": round(score[cause], 3),
            }
            for cause, count in sorted(misses.items(), key=lambda one: (-one[1], one[0]))
        ]
