"""What hides, taken for larger than it is: spread, as boxes, as rectangles, as a horizon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import Boxes
from visref.causes.layers import Layers, draw
from visref.causes.rectangles import by_box, by_sample
from visref.causes.sights import At, Tell, Told
from visref.scene import Float64, Int32

Bool = NDArray[np.bool_]

# Of so many samples in all, at most, boxes are drawn one by one.
MOST_SAMPLES = 20_000_000
# Rectangles, too, are drawn one by one, so many at most.
MOST_RECTANGLES = 4096
_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ],
    np.int32,
)  # fmt: skip


def dilated(at: At) -> Told:
    """What hides spreads to the neighbours of its samples, beside and aslant."""
    layers = at.now.kept("dilated", lambda: _spread(at.now.layers()))
    return by_box(at, layers)


def merged(one: Layers, other: Layers) -> Layers:
    """The nearest depth of both at each sample, whose it is, and the nearest of others."""
    same, nearer = other.owner == one.owner, other.nearest < one.nearest
    others = np.where(
        nearer,
        np.minimum(one.nearest, other.second),
        np.minimum(one.second, other.nearest),
    )
    return Layers(
        np.minimum(one.nearest, other.nearest),
        np.where(nearer, other.owner, one.owner),
        np.where(same, np.minimum(one.second, other.second), others),
    )


def _spread(layers: Layers) -> Layers:
    """Of each three by three samples the nearest."""
    height, width = layers.owner.shape
    nearest: Float64 = np.pad(layers.nearest, 1, constant_values=np.inf)
    second: Float64 = np.pad(layers.second, 1, constant_values=np.inf)
    owner: Int32 = np.pad(layers.owner, 1, constant_values=-1)
    found = Layers.empty(height, width)
    for i in range(3):
        for j in range(3):
            here = slice(i, i + height), slice(j, j + width)
            found = merged(found, Layers(nearest[here], owner[here], second[here]))
    return found


def horizon(at: At) -> Told:
    """What hides is held to reach down to the image's last row."""
    layers = at.now.kept("horizon", lambda: _downwards(at.now.layers()))
    return by_box(at, layers)


def _downwards(layers: Layers) -> Layers:
    height = len(layers.owner)
    rows = [layers.picked(slice(y, y + 1), slice(None)) for y in range(height)]
    for y in range(1, height):
        rows[y] = merged(rows[y - 1], rows[y])
    parts = zip(*((row.nearest, row.owner, row.second) for row in rows), strict=True)
    return Layers(*(np.concatenate(part) for part in parts))


def rectangles_hide(depth: Callable[[Boxes], Float64], name: str) -> Tell:
    """The rectangle about each box hides, at one of its depths."""

    def tell(at: At) -> Told:
        camera = at.camera
        boxes = Boxes(camera, at.now.place.bounds)
        hiding = np.flatnonzero(boxes.in_view & ~boxes.crossing).astype(np.int32)
        sides = boxes.rectangles[hiding].astype(np.int64)
        area = (sides[:, 2:] - sides[:, :2] + 1).clip(0).prod(axis=1)
        if len(hiding) > MOST_RECTANGLES or area.sum() > MOST_SAMPLES:
            return None

        def make() -> Layers:
            found = Layers.empty(camera.height, camera.width)
            depths = depth(boxes)
            for unit, (x0, y0, x1, y1) in zip(hiding.tolist(), sides.tolist(), strict=True):
                here = slice(y0, y1 + 1), slice(x0, x1 + 1)
                part = Layers(found.nearest[here], found.owner[here], found.second[here])
                shape = part.owner.shape
                flat = Layers(
                    np.full(shape, depths[unit]), np.full(shape, unit), np.full(shape, np.inf)
                )
                new = merged(part, flat)
                found.nearest[here], found.owner[here] = new.nearest, new.owner
                found.second[here] = new.second
            return found

        return by_box(at, at.now.kept(("rectangles", name), make))

    return tell


def _faces(at: At, bounds: Float64, units: Int32) -> Layers:
    """The faces of (k, 2, 3) boxes, which are those of (k,) units."""
    camera = at.camera
    corners = Boxes(camera, bounds).corners.reshape(-1, 3)
    triangles = (_FACES[None] + 8 * np.arange(len(units))[:, None, None]).reshape(-1, 3)
    layers = Layers.empty(camera.height, camera.width)
    owner = np.repeat(units, 12)
    draw(layers, corners, triangles.astype(np.int32), camera, np.arange(len(owner)), owner)
    return layers


def _all_boxes(at: At) -> Layers:
    def make() -> Layers:
        bounds = at.now.place.bounds
        some = np.flatnonzero(np.isfinite(bounds).all(axis=(1, 2))).astype(np.int32)
        return _faces(at, bounds[some], some)

    return at.now.kept("boxes", make)


def boxes_hide(at: At) -> Told:
    return by_box(at, _all_boxes(at))


def boxes_hide_boxes(at: At) -> Told:
    """No face of its box is before those of all others."""
    return by_sample(at, _all_boxes(at)) & at.boxes.in_view | at.boxes.crossing | ~at.boxes.there


def eye_inside_asked(at: At) -> Told:
    """Of a box that holds the eye the far faces alone are drawn, and asked about."""
    crossing = np.flatnonzero(at.boxes.crossing & at.boxes.there)
    if not len(crossing) or len(crossing) * at.camera.samples > MOST_SAMPLES:
        return None
    kept_ones = np.ones(len(at.ids), np.bool_)
    others = at.now.layers()
    for i in crossing.tolist():
        unit = at.ids[i : i + 1]
        faces = _faces(at, at.boxes.boxes[i : i + 1], unit).nearest
        depth = np.where(others.owner == unit, others.second, others.nearest)
        kept_ones[i] = bool((np.isfinite(faces) & (faces <= depth)).any())
    return kept_ones


TOO_LARGE: dict[str, Tell] = {
    "dilated": dilated,
    "boxes": boxes_hide,
    "rectangles, farthest": rectangles_hide(lambda boxes: boxes.depths.max(axis=1), "farthest"),
    "rectangles, nearest": rectangles_hide(lambda boxes: boxes.nearest, "nearest"),
    "horizon": horizon,
}
