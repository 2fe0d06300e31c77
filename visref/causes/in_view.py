"""Wrong tests of what is in the view."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.causes.boxes import Boxes, edges, every, some, within
from visref.causes.lenses import (
    first_lens,
    first_viewport,
    lens,
    ninety,
    other_extent,
    radians_as_degrees,
    rolled,
    scaled_extent,
    shift,
    wide_as_pyramid,
)
from visref.causes.rectangles import asked
from visref.causes.sights import At, Hypothesis, Sight, Tell, Told
from visref.scene import Float64

Bool = NDArray[np.bool_]

LEFT, RIGHT, BOTTOM, TOP, NEAR, FAR = range(6)
SIDES = [LEFT, RIGHT, BOTTOM, TOP]


def corners_only(at: At) -> Told:
    return ~every(some(at.boxes.planes, 2), 1) | ~at.boxes.there


def corners_only_sides(at: At) -> Told:
    """Near and far are tested as they should."""
    planes = at.boxes.planes
    inside = ~every(some(planes[:, :, SIDES], 2) | (at.boxes.depths <= 0), 1)
    return (inside & ~some(every(planes[:, :, [NEAR, FAR]], 1), 1)) | ~at.boxes.there


def corners_or_centre(at: At) -> Told:
    corner = ~every(some(at.boxes.planes, 2), 1)
    return corner | ~at.boxes.beyond(at.boxes.centres).any(axis=1) | ~at.boxes.there


def centre_only(at: At) -> Told:
    return ~at.boxes.beyond(at.boxes.centres).any(axis=1) | ~at.boxes.there


def origins(at: At) -> Float64:
    """(k, 3) the objects' origins, where none is known the middles of their boxes."""
    worlds = at.sights.moments.timeline.worlds(at.frame)
    boxes = np.where(at.boxes.there[:, None, None], at.boxes.boxes, 0.0)
    middles: Float64 = boxes.mean(axis=1)
    if worlds is None:
        return middles
    objects = at.objects()
    points = worlds[np.maximum(objects, 0), :3, 3] - at.scene.origin
    return np.asarray(np.where((objects >= 0)[:, None], points, middles))


def pivot(at: At) -> Told:
    if at.sights.moments.timeline.worlds(at.frame) is None:
        return None
    known = (at.objects() >= 0) & at.boxes.there
    return ~at.boxes.beyond(at.boxes.local(origins(at))).any(axis=1) | ~known


def any_corner_behind(at: At) -> Told:
    if not at.camera.is_perspective:
        return None
    return ~(at.boxes.depths < at.camera.near).any(axis=1) | ~at.boxes.there


def any_corner_behind_eye(at: At) -> Told:
    if not at.camera.is_perspective:
        return None
    return ~(at.boxes.depths <= 0.0).any(axis=1) | ~at.boxes.there


def _image(boxes: Boxes, pixels: Float64, sane: Bool) -> Bool:
    """(k,) whether the rectangle about pixels, (k, 8, 2), those `sane`, (k, 8), meets the image."""
    low = np.where(sane[..., None], pixels, np.inf).min(axis=1)
    high = np.where(sane[..., None], pixels, -np.inf).max(axis=1)
    side = np.array([boxes.camera.width, boxes.camera.height])
    found: Bool = ((high >= -0.5) & (low <= side - 0.5)).all(axis=1)
    return found


def wrongly_projected(boxes: Boxes, how: str) -> tuple[Float64, Bool]:
    """(k, 8, 2) pixels of corners, those behind the eye `mirrored` (divided by their depth all the
    same), `clamped` to near, `folded` to the front, or `dropped`, and (k, 8) which count."""
    local = boxes.seen_from.copy()
    depth = local[..., 2]
    counts = np.ones(depth.shape, np.bool_)
    if how == "clamped":
        local[..., 2] = np.maximum(depth, boxes.camera.near)
    elif how == "folded":
        local[..., 2] = np.abs(depth)
    elif how == "dropped":
        counts = depth > 0.0
    elif how == "dropped-at-near":
        counts = depth >= boxes.camera.near
    pixels = boxes.pixels(local)
    return pixels, counts & np.isfinite(pixels).all(axis=2)


def behind(how: str) -> Tell:
    def tell(at: At) -> Told:
        boxes = at.boxes
        if not boxes.camera.is_perspective:
            return None
        pixels, counts = wrongly_projected(boxes, how)
        in_image = _image(boxes, pixels, counts)
        return (in_image | ~boxes.crossing) & boxes.in_view | ~boxes.there

    return tell


def behind_and_hidden(how: str) -> Tell:
    """The same, and the rectangle is tested against depth."""

    def tell(at: At) -> Told:
        boxes = at.boxes
        if not boxes.camera.is_perspective:
            return None
        pixels, counts = wrongly_projected(boxes, how)
        counts = counts & boxes.crossing[:, None] | ~boxes.crossing[:, None]
        low = np.where(counts[..., None], pixels, np.inf).min(axis=1)
        high = np.where(counts[..., None], pixels, -np.inf).max(axis=1)
        rectangles = within(boxes.camera, np.concatenate([low, high], axis=1))
        depth = np.where(boxes.depths > 0.0, boxes.depths, np.inf).min(axis=1)
        kept = asked(at, rectangles, depth).passing > 0
        return kept & boxes.in_view | ~boxes.there

    return tell


def eye_inside(at: At) -> Told:
    eye = at.camera.eye
    inside = every((at.boxes.boxes[:, 0] <= eye) & (eye <= at.boxes.boxes[:, 1]), 1)
    return ~inside


def flat(at: At) -> Told:
    sides = at.boxes.boxes[:, 1] - at.boxes.boxes[:, 0]
    return (sides > 0.0).all(axis=1) | ~at.boxes.there


def edge_on(at: At) -> Told:
    """A flat box that is seen edge-on counts as empty: its rectangle has no area."""
    spans = at.boxes.spans
    thin = (spans[:, 2] - spans[:, 0] < 1e-6) | (spans[:, 3] - spans[:, 1] < 1e-6)
    return ~thin | at.boxes.crossing | ~at.boxes.there


def two_corners(at: At) -> Told:
    ends = at.boxes.planes[:, [0, 7]]
    return ~some(every(ends, 1), 1) | ~at.boxes.there


def sphere(radius: Callable[[Float64], Float64]) -> Tell:
    """A sphere about the box's centre that may be too small."""

    def tell(at: At) -> Told:
        boxes = at.boxes
        sides = np.where(boxes.there[:, None], boxes.boxes[:, 1] - boxes.boxes[:, 0], 0.0)
        r = radius(sides)
        x, y, z = boxes.centres.T
        camera = boxes.camera
        left, right, bottom, top = edges(camera)
        outside = (z + r < camera.near) | (z - r > camera.far)
        for side, across, sign in ((left, x, 1), (right, x, -1), (bottom, y, 1), (top, y, -1)):
            if camera.is_perspective:
                outside |= sign * (across - side * z) / math.hypot(1.0, side) < -r
            else:
                outside |= sign * (across - side) < -r
        return np.asarray(~outside | ~boxes.there)

    return tell


def of_centroids(at: At) -> Float64:
    """Boxes that hold their triangles' centroids."""
    scene, units = at.scene, at.sights.units.take(at.ids)
    middle = scene.vertices[scene.triangles[units.triangles]].astype(np.float64).mean(axis=1)
    boxes = np.full((units.count, 2, 3), np.inf)
    filled = units.sizes > 0
    if filled.any():
        starts = units.offsets[:-1][filled]
        boxes[filled, 0] = np.minimum.reduceat(middle, starts)
        boxes[filled, 1] = np.maximum.reduceat(middle, starts)
    boxes[~at.boxes.there] = np.inf
    return boxes


def of_size(share: float) -> Callable[[At], Float64]:
    """Boxes about the same middle, of a share of the sides."""

    def make(at: At) -> Float64:
        boxes = np.where(at.boxes.there[:, None, None], at.boxes.boxes, 0.0)
        middle = boxes.mean(axis=1, keepdims=True)
        return np.where(
            at.boxes.there[:, None, None], middle + share * (boxes - middle), at.boxes.boxes
        )

    return make


def of_what_moves(make: Callable[[At], Float64]) -> Callable[[At], Float64]:
    """Other boxes of what moves, as those about its joints alone."""

    def made(at: At) -> Float64:
        moving = at.scene.moving
        if moving is None:
            return at.boxes.boxes
        objects = at.objects()
        moves = (objects >= 0) & moving[np.maximum(objects, 0)]
        return np.where(moves[:, None, None], make(at), at.boxes.boxes)

    return made


def smaller(make: Callable[[At], Float64], *, hidden: bool) -> Tell:
    """Other boxes in the view, and (`hidden`) against the depth of others."""

    def tell(at: At) -> Told:
        boxes = Boxes(at.camera, make(at))
        return (kept_by_depth(at, boxes) if hidden else boxes.in_view) | ~at.boxes.there

    return tell


def kept_by_depth(at: At, boxes: Boxes, sight: Sight | None = None) -> Bool:
    """(k,) in the view, and not hidden by the right depth of others."""
    found = asked(at, boxes.rectangles, boxes.nearest, sight=sight).passing > 0
    return boxes.in_view & (boxes.crossing | found)


def and_hidden(hypothesis: Hypothesis) -> Hypothesis:
    """The same, of a culler that leaves out as well, as it should, what is hidden."""

    def tell(at: At) -> Told:
        kept = hypothesis.tell(at)
        return None if kept is None else kept & kept_by_depth(at, at.boxes)

    variant = f"{hypothesis.variant}, and hidden"
    return replace(hypothesis, variant=variant, tell=tell, depth=True)


def found_too_small(at: At) -> Told:
    """As the boxes' audit found. Such a box need not lose its unit: it says something only of what
    was left out. Units that share triangles need not hold them, each by itself."""
    if not at.too_small.any() or at.sights.shares_triangles:
        return None
    now = at.sights.answers.at(at.frame, at.view)
    return ~at.too_small if now is None else ~at.too_small | now[at.ids]


def near_at(depth: Callable[[Camera], float]) -> Tell:
    def tell(at: At) -> Told:
        near = depth(at.camera)
        return (
            ~(at.boxes.depths < near).all(axis=1) | ~at.boxes.there
            if near > at.camera.near
            else None
        )

    return tell


def far_at(depth: Callable[[Camera], float]) -> Tell:
    def tell(at: At) -> Told:
        far = depth(at.camera)
        return (
            ~(at.boxes.depths > far).all(axis=1) | ~at.boxes.there if far < at.camera.far else None
        )

    return tell


def straight_far(at: At) -> Told:
    camera = at.camera
    if math.isinf(camera.far):
        return None
    away = np.linalg.norm(at.boxes.closest - camera.eye, axis=1)
    return np.asarray((away <= camera.far) | ~at.boxes.there)


def on_a_plane(at: At) -> Told:
    """No corner lies farther in than a plane, up to roundings."""
    boxes, camera = at.boxes, at.camera
    local = boxes.seen_from
    # The view shrunk by a hair.
    hair = 1e-9 * (np.abs(local).max(initial=1.0) + camera.near)
    z = local[..., 2]
    scale = z if camera.is_perspective else np.ones_like(z)
    left, right, bottom, top = edges(camera)
    x, y = local[..., 0], local[..., 1]
    beyond = np.stack(
        [
            x <= left * scale + hair,
            x >= right * scale - hair,
            y <= bottom * scale + hair,
            y >= top * scale - hair,
            z <= camera.near + hair,
            z >= camera.far - hair,
        ],
        axis=-1,
    )
    return ~some(every(beyond, 1), 1) | ~boxes.there


def rounded(kind: type[np.floating], *, world: bool, hidden: bool = False) -> Tell:
    """Box and eye in floats, in the world or about the scene's origin."""

    def tell(at: At) -> Told:
        if world and not at.scene.origin.any():
            return None
        origin = at.scene.origin if world else np.zeros(3)
        with np.errstate(over="ignore", invalid="ignore"):
            boxes = (at.boxes.boxes + origin).astype(kind).astype(np.float64)
            pose = at.camera.world_from_camera.copy()
            pose[:3, 3] = (pose[:3, 3] + origin).astype(kind)
        if not np.isfinite(pose).all():
            return None
        seen = Boxes(replace(at.camera, world_from_camera=pose, clip_plane=None), boxes)
        return (kept_by_depth(at, seen) if hidden else seen.in_view) | ~at.boxes.there

    return tell


def rounded_middle(at: At) -> Told:
    """The box's middle in float32 in the world, its size kept."""
    if not at.scene.origin.any():
        return None
    boxes = np.where(at.boxes.there[:, None, None], at.boxes.boxes, 0.0)
    middle = boxes.mean(axis=1, keepdims=True) + at.scene.origin
    rounded_to = middle.astype(np.float32).astype(np.float64)
    return Boxes(at.camera, boxes + (rounded_to - middle)).in_view | ~at.boxes.there


def to_whole(grid: float, how: Callable[[Float64], Float64]) -> Tell:
    """Boxes whose ends are rounded to multiples."""

    def tell(at: At) -> Told:
        boxes = how((at.boxes.boxes + at.scene.origin) / grid) * grid - at.scene.origin
        return Boxes(at.camera, boxes).in_view | ~at.boxes.there

    return tell


def origin_forgotten(at: At) -> Told:
    """The camera in the world, boxes about the scene's origin."""
    if not at.scene.origin.any():
        return None
    pose = at.camera.world_from_camera.copy()
    pose[:3, 3] += at.scene.origin
    seen = Boxes(replace(at.camera, world_from_camera=pose), at.boxes.boxes)
    return seen.in_view | ~at.boxes.there


def small_on_screen(at: At) -> Told:
    """A rectangle of less than a pixel's area, or side."""
    spans = at.boxes.spans
    area = (spans[:, 2] - spans[:, 0]) * (spans[:, 3] - spans[:, 1])
    return (area >= 1.0) | at.boxes.crossing | ~at.boxes.there


def narrow_on_screen(at: At) -> Told:
    spans = at.boxes.spans
    narrow = (spans[:, 2] - spans[:, 0] < 1.0) & (spans[:, 3] - spans[:, 1] < 1.0)
    return ~narrow | at.boxes.crossing | ~at.boxes.there


IN_VIEW: dict[str, dict[str, Tell]] = {
    "no-lens-shift": {
        "both": lens(shift(0, 0)),
        "x": lens(shift(0, 1)),
        "y": lens(shift(1, 0)),
        "half": lens(shift(0.5, 0.5)),
    },
    "lens-shift-reversed": {
        "both": lens(shift(-1, -1)),
        "x": lens(shift(-1, 1)),
        "y": lens(shift(1, -1)),
    },
    "roll-ignored": {"": lens(rolled)},
    "corners-only": {
        "all planes": corners_only,
        "sides": corners_only_sides,
        "or the centre": corners_or_centre,
    },
    "centre-only": {"": centre_only},
    "pivot": {"": pivot},
    "corners-behind-eye": {
        "any before near": any_corner_behind,
        "any behind the eye": any_corner_behind_eye,
        **{
            how: behind(how)
            for how in ("mirrored", "clamped", "folded", "dropped", "dropped-at-near")
        },
        **{
            how + ", hidden": behind_and_hidden(how)
            for how in ("mirrored", "clamped", "folded", "dropped", "dropped-at-near")
        },
    },
    "eye-inside-box": {"": eye_inside},
    "near-larger": {
        "ten times": near_at(lambda camera: 10 * camera.near),
        "twice": near_at(lambda camera: 2 * camera.near),
        "0.1": near_at(lambda camera: 0.1),
        "1": near_at(lambda camera: 1.0),
    },
    "far-nearer": {
        "half": far_at(lambda camera: camera.far / 2),
        "100": far_at(lambda camera: 100.0),
        "1000": far_at(lambda camera: 1000.0),
        "10000": far_at(lambda camera: 10000.0),
    },
    "origin-forgotten": {"": origin_forgotten},
    "rounded-coordinates": {
        "float32 in the world": rounded(np.float32, world=True),
        "float32 in the world, hidden": rounded(np.float32, world=True, hidden=True),
        "float32 in the world, the middle": rounded_middle,
    },
    "other-lens": {
        "as wide as high": other_extent(lambda w, h: (h, h)),
        "as high as wide": other_extent(lambda w, h: (w, w)),
        "aspect inverted": other_extent(lambda w, h: (h * h / w, h)),
        "horizontal for vertical": other_extent(lambda w, h: (h, h * h / w)),
        "half": scaled_extent(0.5),
        "pyramid of 45 degrees": wide_as_pyramid,
        "pyramid of 90 degrees": ninety,
        "first frame's": first_lens,
        "first frame's viewport": first_viewport,
    },
    "bounds-too-small": {
        "found": found_too_small,
        "two corners": two_corners,
        "sphere to the faces": sphere(lambda sides: np.asarray(sides.max(axis=1) / 2)),
    },
    "flat-box": {"": flat, "edge-on": edge_on},
    "on-the-plane": {"": on_a_plane},
    "too-few-samples": {"less than a pixel": small_on_screen, "narrow": narrow_on_screen},
}

# Less ordinary, and tried last.
SELDOM: dict[str, dict[str, Tell]] = {
    "other-lens": {"degrees for radians": radians_as_degrees},
    "euclidean-depth": {"against far": straight_far},
    "rounded-coordinates": {
        "float16": rounded(np.float16, world=False),
        "float16 in the world": rounded(np.float16, world=True),
        "float16, hidden": rounded(np.float16, world=False, hidden=True),
        **{
            f"multiples of {grid:g}, {name}": to_whole(grid, how)
            for grid in (0.5, 1.0, 2.0)
            for name, how in (("nearest", np.rint), ("down", np.floor), ("towards 0", np.trunc))
        },
    },
    "bounds-too-small": {
        "sphere of least side": sphere(lambda sides: np.asarray(sides.min(axis=1) / 2)),
        "sphere of mean side": sphere(lambda sides: np.asarray(sides.mean(axis=1) / 2)),
        "centroids": smaller(of_centroids, hidden=False),
        "centroids, hidden": smaller(of_centroids, hidden=True),
        **{
            f"{share} of the sides{', of what moves' * moves}{', hidden' * hidden}": smaller(
                of_what_moves(of_size(share)) if moves else of_size(share), hidden=hidden
            )
            for share in (0.5, 0.25)
            for moves in (False, True)
            for hidden in (False, True)
        },
    },
}
