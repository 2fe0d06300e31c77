"""Kinds of mistakes, each with the causes that describe it.

They were written down from what the code of each fault does, before any cause was looked for. A
family has several causes only where each says truly what went wrong there, and none where no cause
does: then naming none is right, and naming any is wrong.
"""

from __future__ import annotations


def _told(causes: str) -> frozenset[str]:
    return frozenset(causes.split())


FAMILIES: dict[str, frozenset[str]] = {
    # The view.
    "one corner in the view": _told("corners-only"),
    "centre in the view": _told("centre-only"),
    "corners behind the eye": _told("corners-behind-eye"),
    "eye inside the box": _told("eye-inside-box"),
    "eye inside the first cell": _told("eye-inside-box nothing-drawn"),
    "box without thickness": _told("flat-box"),
    "box or sphere too small": _told("bounds-too-small"),
    # The stale box is the one at rest, and by that too small.
    "box at rest, too small": _told("bounds-too-small rest-pose"),
    # Least above greatest: such a box holds nothing, and is left out at all times.
    "box turned inside out": _told("bounds-too-small never-drawn"),
    "lens shift left out": _told("no-lens-shift"),
    "lens shift halved": _told("no-lens-shift"),
    # Where what the whole shift brings into view lies beyond the half of it.
    "lens shift halved, all beyond": _told("no-lens-shift"),
    "lens shift reversed": _told("lens-shift-reversed"),
    "other lens": _told("other-lens"),
    # A view narrower by a pixel each side is one row too few, and another field of view.
    "view a pixel too small": _told("other-lens rectangle-too-small"),
    "roll left out": _told("roll-ignored"),
    "near too large": _told("near-larger"),
    "far too near": _told("far-nearer"),
    # The far plane becomes a sphere: nearer than the plane towards the sides.
    "distance against far": _told("euclidean-depth far-nearer"),
    "on a plane": _told("on-the-plane"),
    "rounded coordinates": _told("rounded-coordinates"),
    # So coarsely rounded that the box does not hold the object.
    "rounded boxes": _told("rounded-coordinates bounds-too-small"),
    "origin forgotten": _told(""),
    # Depth.
    "centre's depth": _told("centre-depth"),
    "farthest depth": _told("farthest-depth"),
    "distance for depth": _told("euclidean-depth"),
    "some samples of the rectangle": _told("few-samples"),
    "rectangle too small": _told("rectangle-too-small"),
    # Two corners of eight span a box, and so a rectangle, that does not hold the others.
    "two corners of eight": _told("rectangle-too-small bounds-too-small"),
    # What the squares leave out of the rectangle is at one side of it, or in its middle.
    "squares too small": _told("few-samples rectangle-too-small"),
    "half the resolution": _told("coarse-depth-1/2"),
    "quarter of the resolution": _told("coarse-depth-1/4"),
    "nearest of the region": _told("nearest-of-region"),
    # A cell that is covered in part hides as if it were covered wholly: what covers it grows, and
    # the nearest of its depths stands for all.
    "cell covered in part": _told("nearest-of-region occluders-too-large"),
    "last texels left out": _told("odd-size-pyramid"),
    "upside down": _told("flipped"),
    "few bits": _told("quantised-depth"),
    "occluders too large": _told("occluders-too-large"),
    # What is asked writes depth: boxes hide what lies behind them.
    "asked boxes hide": _told("occluders-too-large"),
    "own depth": _told("own-depth"),
    "no depth compared": _told("depth-not-compared"),
    "background hides": _told("empty-hides"),
    "depth reversed": _told(""),
    "neighbours averaged": _told(""),
    "another point of the pixel": _told(""),
    "occluders not clipped": _told("wrong-occluder-clip"),
    "clip plane left out": _told("wrong-occluder-clip"),
    # Materials.
    "masks solid": _told("masks-solid"),
    "glass solid": _told("glass-solid"),
    "masks left out": _told("masked-left-out"),
    "glass left out": _told("glass-left-out"),
    "front for back": _told("back-faces"),
    "two-sided taken for one-sided": _told("back-faces"),
    "one-sided taken for two-sided": _told("back-faces"),
    # Time.
    "answer a frame late": _told("one-frame-late"),
    # Where nothing moves, the frame before differs by its view alone.
    "answer a frame late, nothing moves": _told("one-frame-late last-view"),
    "answer a frame late at cuts": _told("one-frame-late last-view across-a-cut"),
    "answer a frame late at cuts, nothing seen before": _told(
        "one-frame-late last-view across-a-cut nothing-drawn"
    ),
    "earlier depth": _told("old-depth"),
    "first answer kept": _told("first-answer-kept"),
    # Image tiles that were done with once are not looked at again, whatever the view: nothing is
    # drawn any more.
    "tiles of the frame before": _told("first-answer-kept old-depth nothing-drawn"),
    # Moving.
    "pose at rest": _told("rest-pose"),
    "pose of the frame before": _told("old-pose"),
    "occluders at their old place": _told("old-occluders"),
    "occluders at rest": _told("rest-pose"),
    "removed still hides": _told("removed-still-hides"),
    "appeared unknown": _told("appeared-unknown"),
    # Views.
    "the other view": _told("other-view"),
    "the first view": _told("first-view-only other-view"),
    # Ids.
    "answers shifted": _told("ids-shifted"),
    "ids wrap": _told("ids-wrap"),
    "same names": _told("same-names"),
    # Sizes and lists.
    "threshold of samples": _told("too-few-samples"),
    "list cut short": _told("list-full"),
    "parts in no list": _told("never-drawn"),
    "parts left out": _told(""),
    "answers lost": _told(""),
    "traversal stops short": _told(""),
    # Of the reported faults alone.
    "origin in the view": _told("pivot"),
    "boxes about another origin": _told("origin-forgotten"),
    "box across every side": _told(""),
    "plane's arithmetic wrong": _told(""),
    "a point for the whole": _told(""),
    "eighth of the resolution": _told("coarse-depth-1/8"),
    "occluders through another lens": _told(""),
    "depth from another eye": _told(""),
    "answer two frames late": _told("two-frames-late"),
    "answer several frames late": _told("n-frames-late"),
    # What nothing else had the place of gets its own answer, and that two frames late.
    "answer of what had its place": _told("two-frames-late"),
    # The answer is as many frames late as the eye has stood still.
    "answer kept on the spot": _told("one-frame-late two-frames-late n-frames-late"),
    "answer from before a cut": _told("across-a-cut"),
    # What has been outside the view since the first frame stands there at rest.
    "box of when it was hidden": _told("rest-pose"),
    "outside at first, never drawn": _told("never-drawn"),
    "another level of detail": _told("absent-lod"),
    "cut off by height": _told(""),
    "eye outside the grid": _told("nothing-drawn"),
    "no level drawn": _told(""),
    "parent by its child": _told(""),
    "first of the group for those seen": _told(""),
    # What is asked is a small square in the middle: it does not hold the thing, nor does what it
    # covers of the image.
    "small box asked in its place": _told("bounds-too-small rectangle-too-small"),
    # Gaps are filled in, and by that what hides grows.
    "small holes of occluders closed": _told("gap-too-narrow occluders-too-large"),
    "no far plane": _told("nothing-drawn"),
    # Two-sided things have then no side left from which they are drawn.
    "both sides culled": _told("back-faces never-drawn"),
    "first of several windows": _told(""),
    "depth of another projection": _told(""),
    # Of what was drawn in the frame before, its pose then; of what never was, that at rest.
    "box of the last drawn frame": _told("old-pose rest-pose"),
    "answer of the former user": _told(""),
    "list as long as the frame before": _told("list-full"),
    # No other level stands in for it.
    "level never drawn": _told("never-drawn"),
    "parent by its children's boxes": _told("bounds-too-small"),
    # A level of the pyramid that has no texels reads as the nearest depth.
    "level without texels": _told(""),
    # Rays stop at both.
    "glass and masks solid": _told("glass-solid masks-solid"),
    "narrow openings left out": _told("gap-too-narrow"),
    # What is left out is found from what stands next to it, whatever the view.
    "slabs hide like cubes": _told("occluders-too-large never-drawn"),
    # A flat one-sided sheet is seen from its front alone.
    "front of flat things for back": _told("back-faces never-drawn"),
    # The near plane is moved out to what lies nearest, and what touches it then counts as outside.
    "planes fitted to what is there": _told("near-larger on-the-plane"),
    # The eye stands and looks the same way: only the lens is another since.
    "answer kept while the lens changes": _told(
        "other-lens one-frame-late two-frames-late n-frames-late"
    ),
    "answer from before it was replaced": _told("n-frames-late"),
    "list made too early": _told("nothing-drawn"),
    "box carried along with its parent": _told("bounds-too-small"),
    # Compared with far are the box's centre and its straight distance.
    "centre's distance against far": _told("centre-only euclidean-depth far-nearer"),
    # Nothing is looked for once the box of the tree's root is out of the view, and that box does
    # not hold what lies beyond it.
    "root of the tree too small": _told("nothing-drawn bounds-too-small"),
}
