"""Wrong tests of what hides a box: a rectangle and a depth against the depth of others."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.causes.boxes import Boxes, within
from visref.causes.layers import Layers
from visref.causes.points import POINTS
from visref.causes.quantised import QUANTISED
from visref.causes.rectangles import any_asked, asked, by_box, by_sample, kept
from visref.causes.shapes import TOO_LARGE, boxes_hide_boxes, eye_inside_asked
from visref.causes.sights import CLIP_PLANE, OWN_TOO, At, Tell, Told
from visref.causes.texels import (
    at_the_edge,
    coarse,
    coarse_inward,
    coarse_rounded,
    first_of_texel,
    last_of_texel,
    mean_of_texel,
    middle_of_texel,
    nearest_of_texel,
    odd,
    window_mean_of_texel,
)
from visref.scene import Float64, Int32

Bool = NDArray[np.bool_]


def other_depth(depth: Callable[[At], Float64], *, outward: bool = True) -> Tell:
    """Another depth for the box's nearest, over its rectangle, rounded `outward` or to whole
    pixels."""

    def tell(at: At) -> Told:
        rectangles = at.boxes.rectangles if outward else rounded_sides(at.boxes).astype(np.int32)
        return kept(at, asked(at, rectangles, depth(at)).passing > 0)

    return tell


def centre(at: At) -> Float64:
    return np.asarray(at.boxes.centres[:, 2])


def farthest(at: At) -> Float64:
    return np.asarray(at.boxes.depths.max(axis=1))


def straight(at: At) -> Float64:
    return np.asarray(np.linalg.norm(at.boxes.closest - at.camera.eye, axis=1))


def straight_corner(at: At) -> Float64:
    away = np.linalg.norm(at.boxes.corners - at.camera.eye, axis=2)
    return np.asarray(away.min(axis=1))


def straight_centre(at: At) -> Float64:
    away = np.linalg.norm(at.boxes.corners.mean(axis=1) - at.camera.eye, axis=1)
    return np.asarray(away)


def of_the_closest(at: At) -> Float64:
    return np.asarray(at.boxes.local(at.boxes.closest)[:, 2])


def straight_both(at: At) -> Told:
    """The depth of others is straight distance, that of the box view depth."""
    camera = at.camera
    if not camera.is_perspective:
        return None
    step = camera.half_pixel
    a, b = np.meshgrid(camera.column_a * step, camera.row_b * step)
    longer = np.sqrt(1.0 + a * a + b * b)
    near = at.now.layers()
    layers = at.now.kept("shorter", lambda: near.mapped(lambda image: image / longer))
    return by_box(at, layers)


def some_of(pick: Callable[[Float64], Float64]) -> Tell:
    """Some points of the rectangle; `pick`: from (k, 4) x0, y0, x1, y1 to (k, m, 2)."""

    def tell(at: At) -> Told:
        sides = at.boxes.rectangles.astype(np.float64)
        filled = sides[:, 2] >= sides[:, 0]
        points = np.floor(pick(sides)).astype(np.int32)
        ones = np.concatenate([points, points], axis=2)
        ones[~filled] = (0, 0, -1, -1)
        depths = np.broadcast_to(at.boxes.nearest[:, None], ones.shape[:2])
        return kept(at, any_asked(at, ones, depths))

    return tell


def _middle(sides: Float64) -> Float64:
    return ((sides[:, :2] + sides[:, 2:]) / 2.0)[:, None]


def _ends(sides: Float64) -> Float64:
    return np.stack([sides[:, [x, y]] for x in (0, 2) for y in (1, 3)], axis=1)


def _five(sides: Float64) -> Float64:
    return np.concatenate([_middle(sides), _ends(sides)], axis=1)


def rectangle(change: Callable[[Boxes], Int32]) -> Tell:
    def tell(at: At) -> Told:
        rectangles = change(at.boxes).astype(np.int32)
        return kept(at, asked(at, rectangles, at.boxes.nearest).passing > 0)

    return tell


def cut(columns: int, rows: int) -> Callable[[Boxes], Int32]:
    def change(boxes: Boxes) -> Int32:
        fewer = np.array([0, 0, columns, rows], np.int32)
        return boxes.rectangles - fewer

    return change


def inward(texel: int) -> Callable[[Boxes], Int32]:
    def change(boxes: Boxes) -> Int32:
        return within(boxes.camera, boxes.spans, texel=texel, inward=True)

    return change


def rounded_sides(boxes: Boxes) -> Int32:
    low, high = np.rint(boxes.spans[:, :2] + 0.5), np.rint(boxes.spans[:, 2:] + 0.5) - 1
    sides = np.array([boxes.camera.width, boxes.camera.height])
    return np.asarray(
        np.concatenate([np.clip(low, 0, sides), np.clip(high, -1, sides - 1)], axis=1)
    )


def quarter(*, left: bool, top: bool) -> Callable[[Boxes], Int32]:
    """Half of each side, from a corner."""

    def change(boxes: Boxes) -> Int32:
        x0, y0, x1, y1 = boxes.rectangles.T
        x, y = (x0 + x1) // 2, (y0 + y1) // 2
        columns = (x0, x) if left else (x + 1, x1)
        rows = (y0, y) if top else (y + 1, y1)
        return np.stack([columns[0], rows[0], columns[1], rows[1]], axis=1)

    return change


def half_rectangle(boxes: Boxes) -> Int32:
    middle = (boxes.spans[:, :2] + boxes.spans[:, 2:]) / 2.0
    half = (boxes.spans[:, 2:] - boxes.spans[:, :2]) / 4.0
    return within(boxes.camera, np.concatenate([middle - half, middle + half], axis=1))


def two_projected(boxes: Boxes) -> Int32:
    ends = boxes.pixels(boxes.seen_from[:, [0, 7]])
    return within(boxes.camera, np.concatenate([ends.min(axis=1), ends.max(axis=1)], axis=1))


def smaller_image(by: int) -> Tell:
    """What shows in an image of a fraction of the size."""

    def tell(at: At) -> Told:
        if _too_small(at.camera, by):
            return None
        layers = at.now.layers(by=by, masks=True, glass=True)
        return by_sample(at, layers) & at.boxes.in_view | ~at.boxes.there

    return tell


def _too_small(camera: Camera, by: int) -> bool:
    """Whether a fraction of the size says nothing."""
    return min(camera.width, camera.height) < 2 * by


def smaller_depth(by: int) -> Tell:
    """Boxes against the depth that is drawn at a fraction of the size."""

    def tell(at: At) -> Told:
        if _too_small(at.camera, by):
            return None
        layers = at.now.layers(by=by)
        rectangles = within(at.camera, at.boxes.spans, texel=by)
        found = asked(at, rectangles, at.boxes.nearest, layers=layers).passing > 0
        return kept(at, found)

    return tell


def nearest_of_rectangle(at: At) -> Told:
    found = asked(at, at.boxes.rectangles, at.boxes.nearest, whole=True)
    return kept(at, found.nearest >= at.boxes.nearest * (1.0 - 1e-9))


def flipped(x: bool, y: bool) -> Tell:
    def tell(at: At) -> Told:
        rows = slice(None, None, -1 if y else 1)
        columns = slice(None, None, -1 if x else 1)
        layers = at.now.kept(("flip", x, y), lambda: at.now.layers().picked(rows, columns))
        return by_box(at, layers)

    return tell


def own_depth(at: At) -> Told:
    layers = at.now.layers(glass=True)
    found = asked(at, at.boxes.rectangles, at.boxes.nearest, layers=layers, own=True)
    return kept(at, found.beyond > 0)


def all_hidden(at: At) -> Told:
    """The objects themselves are compared with their own depth: nothing is drawn but what crosses
    the near plane."""
    return at.boxes.crossing | ~at.boxes.there


def equal_depth(at: At) -> Told:
    return kept(at, asked(at, at.boxes.rectangles, at.boxes.nearest).beyond > 0)


def anything_covers(at: At) -> Told:
    far = np.full(len(at.ids), np.finfo(np.float64).max)
    return kept(at, asked(at, at.boxes.rectangles, far).passing > 0)


def background_hides(at: At) -> Told:
    layers = at.now.kept(
        "background",
        lambda: at.now.layers().mapped(lambda image: np.where(np.isinf(image), 0.0, image)),
    )
    return by_box(at, layers)


def _is_cut(at: At) -> bool:
    """Whether the near plane cuts what might hide."""
    return bool(Boxes(at.camera, at.now.place.bounds).crossing.any())


def among(
    *,
    masks: bool = False,
    glass: bool = False,
    back_faces: bool = False,
    unclipped: bool = False,
    before_near: bool = False,
) -> dict[str, Tell]:
    """Other occluders, asked about boxes and about samples."""

    def layers(at: At) -> Layers | None:
        scene = at.scene
        known = (
            (masks and scene.has_mask)
            or (glass and scene.has_blend)
            or (back_faces and scene.has_one_sided)
            or (unclipped and at.camera.clip_plane is not None)
            or (before_near and _is_cut(at))
        )
        if not known:
            return None
        return at.now.layers(
            masks=masks,
            glass=glass,
            back_faces=back_faces,
            unclipped=unclipped,
            before_near=before_near,
        )

    def box(at: At) -> Told:
        found = layers(at)
        return None if found is None else by_box(at, found)

    def sample(at: At) -> Told:
        found = layers(at)
        if found is None:
            return None
        return by_sample(at, found) & at.boxes.in_view | ~at.boxes.there

    return {"boxes": box, "samples": sample}


def own_too(tell: Tell) -> Tell:
    """The depth asked about holds the unit itself."""
    return lambda at: tell(at.with_own)


def either_way(groups: Mapping[str, Mapping[str, Tell]]) -> dict[str, dict[str, Tell]]:
    """Each of them also for cullers whose depth holds what they ask about."""
    return {
        cause: {
            **variants,
            **{name + OWN_TOO: own_too(tell) for name, tell in variants.items()},
        }
        for cause, variants in groups.items()
    }


_HIDDEN: dict[str, dict[str, Tell]] = {
    "euclidean-depth": {
        "nearest point": other_depth(straight),
        "nearest corner": other_depth(straight_corner),
        "centre": other_depth(straight_centre),
        "depth of the nearest point": other_depth(of_the_closest),
        "occluders": straight_both,
        "nearest point, whole pixels": other_depth(straight, outward=False),
        "depth of the nearest point, whole pixels": other_depth(of_the_closest, outward=False),
    },
    "centre-depth": {"": other_depth(centre)},
    "farthest-depth": {"": other_depth(farthest)},
    "own-depth": {"own": own_depth, "equal": equal_depth},
    "few-samples": {
        "middle": some_of(_middle),
        "corners": some_of(_ends),
        "five": some_of(_five),
        **POINTS,
    },
    "rectangle-too-small": {
        "a row less": rectangle(cut(0, 1)),
        "a column less": rectangle(cut(1, 0)),
        "both less": rectangle(cut(1, 1)),
        "inward": rectangle(inward(1)),
        "rounded": rectangle(rounded_sides),
        "two corners": rectangle(two_projected),
        "half": rectangle(half_rectangle),
        "upper left quarter": rectangle(quarter(left=True, top=True)),
        "lower left quarter": rectangle(quarter(left=True, top=False)),
        "texels of 2 inward": coarse_inward(2),
        "texels of 4 inward": coarse_inward(4),
    },
    **{
        f"coarse-depth-1/{n}": {
            "first": coarse(n, first_of_texel, "first"),
            "middle": coarse(n, middle_of_texel, "middle"),
            "last": coarse(n, last_of_texel, "last"),
            "mean": coarse(n, mean_of_texel, "mean"),
            "mean of window depth": coarse(n, window_mean_of_texel, "window mean"),
            "drawn small": smaller_depth(n),
        }
        for n in (2, 4, 8, 16)
    },
    "odd-size-pyramid": {f"texels of {n}": odd(n) for n in (2, 4, 8, 16)},
    "nearest-of-region": {
        "rectangle": nearest_of_rectangle,
        **{f"texels of {n}": coarse(n, nearest_of_texel, "nearest") for n in (2, 4, 8, 16)},
    },
    "flipped": {
        "y": flipped(False, True),
        "x": flipped(True, False),
        "both": flipped(True, True),
    },
    "quantised-depth": QUANTISED,
    "occluders-too-large": TOO_LARGE,
    "depth-not-compared": {"": anything_covers},
    "empty-hides": {"": background_hides},
}
HIDDEN: dict[str, dict[str, Tell]] = {
    **either_way(_HIDDEN),
    "occluders-too-large": {
        **either_way(_HIDDEN)["occluders-too-large"],
        "boxes before boxes": boxes_hide_boxes,
    },
    "eye-inside-box": {"asked": eye_inside_asked},
    "odd-size-pyramid": {
        **either_way(_HIDDEN)["odd-size-pyramid"],
        **{f"tiles of {n}": at_the_edge(n) for n in (4, 8, 16, 32, 64)},
        **{
            f"tiles of {n}, from below": at_the_edge(n, from_below=True) for n in (4, 8, 16, 32, 64)
        },
    },
}
# What says that all is lost, whatever is there.
SWEEPING: dict[str, dict[str, Tell]] = {"own-depth": {"samples": all_hidden}}
SELDOM_HIDDEN: dict[str, dict[str, Tell]] = {
    "rectangle-too-small": {
        **{f"texels of {n} inward": coarse_inward(n) for n in (8, 16)},
        **{f"texels of {n} rounded": coarse_rounded(n) for n in (2, 4, 8, 16)},
    },
    **{f"coarse-depth-1/{n}": {"smaller image": smaller_image(n)} for n in (2, 4, 8, 16)},
}
MATERIALS: dict[str, dict[str, Tell]] = {
    "masks-solid": among(masks=True),
    "glass-solid": among(glass=True),
    "wrong-occluder-clip": {
        **{f"{CLIP_PLANE}, {how}": tell for how, tell in among(unclipped=True).items()},
        **{f"near, {how}": tell for how, tell in among(before_near=True).items()},
    },
    "back-faces": {f"hide, by {how}": tell for how, tell in among(back_faces=True).items()},
}
