"""Rays to some points of a box, in place of a test of all of its rectangle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import some
from visref.causes.in_view import origins
from visref.causes.rectangles import any_asked, kept
from visref.causes.sights import At, Tell, Told
from visref.scene import Float64

Bool = NDArray[np.bool_]

# Points of a box, from its middle in halves of its sides.
_ENDS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_FACES = np.array([s * np.eye(3)[i] for i in range(3) for s in (-1, 1)])
_MIDDLE = np.zeros((1, 3))


def of_box(steps: Float64) -> Callable[[At], Float64]:
    """(k, m, 3) points of boxes, at (m, 3) steps from the middle."""

    def make(at: At) -> Float64:
        boxes = np.where(at.boxes.there[:, None, None], at.boxes.boxes, 0.0)
        half = (boxes[:, 1] - boxes[:, 0])[:, None] / 2.0
        return np.asarray(boxes.mean(axis=1)[:, None] + steps * half)

    return make


def rays(points: Callable[[At], Float64], *, in_image: bool) -> Tell:
    """Kept if a ray to one of the points meets nobody else before it. `in_image`: a point beyond
    the image shows nothing; otherwise nothing is known that hides it."""

    def tell(at: At) -> Told:
        local = at.boxes.local(points(at))
        pixels = at.boxes.pixels(local)
        width, height = at.camera.width, at.camera.height
        with np.errstate(invalid="ignore"):
            inside = ((pixels > -0.5) & (pixels < (width - 0.5, height - 0.5))).all(axis=2)
        inside &= local[..., 2] > at.camera.near
        places = np.where(inside[..., None], np.rint(np.where(inside[..., None], pixels, 0.0)), 0)
        places = np.minimum(np.maximum(places, 0), (width - 1, height - 1)).astype(np.int32)
        reached = any_asked(at, np.concatenate([places, places], axis=2), local[..., 2], inside)
        if not in_image:
            reached |= some(~inside, 1)
        return kept(at, reached)

    return tell


def _pivot(at: At) -> Float64:
    return origins(at)[:, None]


_POINTS: dict[str, Callable[[At], Float64]] = {
    "ray to the middle": of_box(_MIDDLE),
    "rays to the corners": of_box(_ENDS),
    "rays to the corners and the middle": of_box(np.concatenate([_MIDDLE, _ENDS])),
    "rays to the faces": of_box(_FACES),
    "rays to points within": of_box(np.concatenate([_MIDDLE, 0.5 * _ENDS])),
    "ray to the origin": _pivot,
}
POINTS: dict[str, Tell] = {
    f"{name}{', in the image' * in_image}": rays(points, in_image=in_image)
    for name, points in _POINTS.items()
    for in_image in (False, True)
}
