"""The suite's wrong cullers: as they are on the checks that convict them, and as recordings of
engines on the scenes of `tests.alignment`, with right inputs.

Those that lose no object are left out: what draws too much, and what breaks down.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial

from tests.alignment.faulty import recorded
from tests.alignment.scenes import SCENES, two_eyes
from tests.alignment.trying import open_shells
from tests.causes.fault import Fault, Input
from tests.causes.longer import longer
from tests.conformance.test_wrong_cullers import CONVICTED_BY
from tests.wrong_cullers import WRONG
from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.conformance.suite import built_case
from visref.culler import Culler, QueryStats
from visref.recordings.visible_sets import Replay, VisibleSets
from visref.scene import Scene

# The family of each, by what its code does.
LABELS = {
    # depth
    "distance-for-depth": "distance for depth",
    "depth-of-the-nearest-by-distance": "distance for depth",
    "centre-depth": "centre's depth",
    "far-corner-depth": "farthest depth",
    "corners-behind-taken": "corners behind the eye",
    "y-flipped": "upside down",
    "x-flipped": "upside down",
    "nearest-of-the-rectangle": "nearest of the region",
    "centre-of-the-rectangle": "some samples of the rectangle",
    "four-corners-of-the-rectangle": "some samples of the rectangle",
    "point-sampled": "quarter of the resolution",
    "averaged": "quarter of the resolution",
    "odd-sides-cut": "last texels left out",
    "eight-bits": "few bits",
    "sixteen-bits": "few bits",
    "strict-own-depth": "own depth",
    "threshold-of-two": "threshold of samples",
    "threshold-of-eight": "threshold of samples",
    "rounded-inward": "rectangle too small",
    "last-row-left-out": "rectangle too small",
    "last-column-left-out": "rectangle too small",
    "boxes-occlude": "occluders too large",
    "clip-plane-ignored": "clip plane left out",
    "occluders-before-near": "occluders not clipped",
    "occluders-dilated": "occluders too large",
    "only-the-background-shows": "no depth compared",
    "background-is-near": "background hides",
    # frustum
    "corners-only": "one corner in the view",
    "centre-only": "centre in the view",
    "any-corner-behind": "corners behind the eye",
    "corners-behind-projected": "corners behind the eye",
    "sphere-of-half-the-side": "box or sphere too small",
    # The box in the camera's axes that two corners span does not hold the other six.
    "two-corners": "two corners of eight",
    "shift-ignored": "lens shift left out",
    "shift-x-ignored": "lens shift left out",
    "shift-y-ignored": "lens shift left out",
    "shift-x-reversed": "lens shift reversed",
    "shift-y-reversed": "lens shift reversed",
    "shift-halved": "lens shift halved, all beyond",
    "orthographic-shift-ignored": "lens shift left out",
    "aspect-ignored": "other lens",
    "aspect-inverted": "other lens",
    "horizontal-field-of-view": "other lens",
    "field-of-view-of-the-first-frame": "other lens",
    "viewport-of-the-first-frame": "other lens",
    "up-assumed": "roll left out",
    "orthographic-as-perspective": "other lens",
    "height-halved": "other lens",
    "near-too-large": "near too large",
    "far-too-near": "far too near",
    "far-halved": "far too near",
    "on-far-dropped": "on a plane",
    "on-near-dropped": "on a plane",
    "distance-for-far": "distance against far",
    "eye-inside-dropped": "eye inside the box",
    "small-dropped": "threshold of samples",
    "thin-dropped": "box without thickness",
    "origin-forgotten": "origin forgotten",
    "float-world": "rounded coordinates",
    "half-float-boxes": "rounded boxes",
    # exact
    "one-triangle-each": "parts left out",
    "samples-of-half-the-size": "half the resolution",
    "nearest-of-a-tie": "own depth",
    # materials
    "glass-occludes": "glass solid",
    "masks-are-solid": "masks solid",
    "glass-dropped": "glass left out",
    "masks-dropped": "masks left out",
    "back-faces-occlude": "one-sided taken for two-sided",
    "two-sided-turned-away": "two-sided taken for one-sided",
    "winding-reversed": "front for back",
    "facing-by-the-view-axis": "front for back",
    "facing-by-the-eye-in-orthographic": "front for back",
    "facing-by-the-first-triangle": "front for back",
    # memory
    "last-answer": "answer a frame late, nothing moves",
    "last-depth": "earlier depth",
    "last-frustum": "answer a frame late, nothing moves",
    "first-answer": "first answer kept",
    "cut-ignored": "answer a frame late at cuts",
    "cut-alone-heeded": "first answer kept",
    # By induction: what was hidden once is never drawn again.
    "hidden-stays-hidden": "first answer kept",
    # moving
    "boxes-at-rest": "pose at rest",
    "boxes-of-the-frame-before": "pose of the frame before",
    "frustum-of-boxes-at-rest": "pose at rest",
    # A reed's first vertex is its foot, which stays: the box does too.
    "moved-without-a-turn": "box at rest, too small",
    "boxes-of-joints": "box or sphere too small",
    "depth-at-its-old-place": "occluders at their old place",
    "depth-at-rest": "occluders at rest",
    "removed-still-hides": "removed still hides",
    "appeared-unknown": "appeared unknown",
    "vanished-for-good": "appeared unknown",
    "answer-of-the-other-view": "the other view",
    "hidden-in-the-other-view": "the other view",
    "first-views-frustum": "the first view",
    # units
    "half-of-the-clusters": "parts left out",
    "first-cluster-alone": "parts left out",
    "last-cluster-lost": "parts in no list",
    "every-second-triangle-lost": "parts in no list",
    "last-triangle-lost": "parts in no list",
    "cells-of-centroids": "box or sphere too small",
    "numbers-off-by-one": "answers shifted",
    "numbers-of-one-byte": "ids wrap",
    "answers-shifted": "answers shifted",
    "last-answer-lost": "list cut short",
    "at-most-a-hundred": "list cut short",
    "same-names-merged": "same names",
}

# They lose no object: what is hidden is drawn, or nothing is answered at all.
LOSE_NOTHING = {
    "hidden-drawn-though-exact",
    "hidden-drawn-though-aggressive",
    "beyond-far-drawn-though-exact",
    "empty-object-breaks",
    "empty-scene-breaks",
}

# Another check than the first that convicts it, where that has too few frames or objects to tell
# its mistake from another: a first answer kept from one a frame late, a shift from a loss.
CHECKS = {
    "first-answer": "revealed_behind_glass",
    "cut-ignored": "jump_cuts",
    "numbers-off-by-one": "crowd",
    "answers-shifted": "crowd",
}

# The scene of `tests.alignment` on which its recording loses objects; those not named lose none on
# any, or are slow there.
RECORDED_ON = {
    "rooms": """
        centre-depth y-flipped x-flipped
        nearest-of-the-rectangle centre-of-the-rectangle four-corners-of-the-rectangle
        threshold-of-eight rounded-inward occluders-dilated only-the-background-shows
        background-is-near corners-only any-corner-behind two-corners near-too-large
        one-triangle-each samples-of-half-the-size nearest-of-a-tie back-faces-occlude
        facing-by-the-first-triangle last-answer last-depth last-frustum first-answer
        cut-ignored cut-alone-heeded hidden-stays-hidden answer-of-the-other-view
        hidden-in-the-other-view first-views-frustum half-of-the-clusters
        first-cluster-alone last-cluster-lost every-second-triangle-lost
        last-triangle-lost cells-of-centroids numbers-off-by-one numbers-of-one-byte
        answers-shifted at-most-a-hundred
    """,
    "yard": """
        point-sampled last-column-left-out boxes-occlude centre-only shift-ignored
        shift-x-ignored shift-x-reversed shift-y-reversed shift-halved aspect-ignored
        aspect-inverted horizontal-field-of-view small-dropped winding-reversed
        last-answer-lost
    """,
    "city": """
        sphere-of-half-the-side far-too-near thin-dropped
    """,
}

# What is another mistake on those scenes than on the check: no cut is in their paths, and what is
# seen lies all over them.
RECORDED_LABELS = {
    "cut-ignored": "answer a frame late, nothing moves",
    "shift-halved": "lens shift halved",
}

# In samples of the scene's own images, for those that get the lens shift wrong.
SHIFT = (22.0, -12.0)
# Of the frames of a path every third, in images of half the sides: wrong cullers take their time.
STRIDE, SIDES = 3, 2


def wrong() -> Iterator[Fault]:
    for name, label in LABELS.items():
        found = WRONG[name]
        check = CHECKS.get(name, CONVICTED_BY[name].split()[0])
        mistake = f"wrong/{found.kind}/{name}"
        yield Fault(mistake, label, mistake, found.rule, partial(_checked, found.culler, check))


def recordings() -> Iterator[Fault]:
    for name, scene in ((n, scene) for scene, names in RECORDED_ON.items() for n in names.split()):
        found = WRONG[name]
        yield Fault(
            f"faulty/{scene}/{name}",
            RECORDED_LABELS.get(name, LABELS[name]),
            f"wrong/{found.kind}/{name}",
            found.rule,
            partial(_recorded, found.culler, scene, staging(name)),
        )


def _checked(culler: type[Culler], check: str) -> Input:
    built = built_case(check, 0)[0]
    return Input(built.scene, longer(built.scene, built.path), culler())


def _recorded(culler: type[Culler], scene: str, staged: str) -> Input:
    seen, path = place(scene, staged)
    _, found = recorded(culler, seen, path)
    stats = {number: QueryStats() for number in found.sets}
    sets = VisibleSets(found.sets, stats, found.units)
    return Input(seen, path, Replay(sets, path))


def staging(name: str) -> str:
    """What a scene has to have for a mistake to show."""
    if "shift" in name:
        return "shifted"
    if WRONG[name].kind == "materials":
        return "one-sided"
    return "two views" if WRONG[name].kind == "moving" else ""


def smaller(camera: Camera) -> Camera:
    """The same view in an image of fewer samples."""
    return replace(
        camera,
        width=camera.width // SIDES,
        height=camera.height // SIDES,
        shift_x_px=camera.shift_x_px / SIDES,
        shift_y_px=camera.shift_y_px / SIDES,
    )


@cache
def place(name: str, staged: str) -> tuple[Scene, CameraPath]:
    """A scene of `tests.alignment` and some frames of its path."""
    scene, path = SCENES[name](SHIFT if staged == "shifted" else (0.0, 0.0))
    path = CameraPath([smaller(frame.cameras[0]) for frame in path.frames[::STRIDE]])
    if staged == "one-sided":
        scene = open_shells(scene)
    return scene, two_eyes(path) if staged == "two views" else path
