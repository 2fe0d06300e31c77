"""Depth at lower resolution: texels of several samples, and how they may be got wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import within
from visref.causes.layers import Layers
from visref.causes.rectangles import asked, kept
from visref.causes.sights import At, Tell, Told
from visref.scene import Float64

Bool = NDArray[np.bool_]


def coarse_inward(texel: int) -> Tell:
    """Texels that hold the farthest of their pixels, of which those within the rectangle."""

    def tell(at: At) -> Told:
        layers = at.now.kept(("farthest", texel), lambda: farthest_of_texel(at, texel))
        rectangles = within(at.camera, at.boxes.spans, texel=texel, inward=True)
        return kept(at, asked(at, rectangles, at.boxes.nearest, layers=layers).passing > 0)

    return tell


def coarse_rounded(texel: int) -> Tell:
    def tell(at: At) -> Told:
        layers = at.now.kept(("farthest", texel), lambda: farthest_of_texel(at, texel))
        low = np.rint((at.boxes.spans[:, :2] + 0.5) / texel)
        high = np.maximum(np.rint((at.boxes.spans[:, 2:] + 0.5) / texel), low + 1) - 1
        sides = np.array(layers.owner.shape[::-1])
        clipped = np.concatenate([np.clip(low, 0, sides), np.clip(high, -1, sides - 1)], axis=1)
        found = asked(at, clipped.astype(np.int32), at.boxes.nearest, layers=layers)
        return kept(at, found.passing > 0)

    return tell


def blocks(layers: Layers, texel: int, how: Any, *, whole_only: bool = False) -> Layers:
    """Depths of `texel` by `texel` samples taken together, `how`: by `np.min`, `np.max` or
    `np.mean`. Where a texel is of one owner, both depths are kept apart; elsewhere nobody owns it.
    `whole_only`: without the texels of an odd side's rest."""
    height, width = layers.owner.shape
    if whole_only:
        height, width = height // texel * texel, width // texel * texel
    rows, columns = -(-height // texel), -(-width // texel)

    def padded(image: NDArray[Any], fill: float) -> NDArray[Any]:
        """(rows, texel, columns * texel)"""
        wide = np.full((rows * texel, columns * texel), fill, image.dtype)
        wide[:height, :width] = image[:height, :width]
        return wide.reshape(rows, texel, columns * texel)

    def extreme(image: NDArray[Any], of: np.ufunc, fill: float) -> NDArray[Any]:
        by_rows = of.reduce(padded(image, fill), axis=1)
        return np.asarray(of.reduce(by_rows.reshape(rows, columns, texel), axis=2))

    def mean(image: Float64) -> Float64:
        each = padded(image, 0.0).reshape(rows, texel, columns, texel)
        total = np.moveaxis(each, 2, 1).reshape(rows, columns, -1).sum(axis=2)
        tall, wide = (
            np.minimum(texel, side - texel * np.arange(count))
            for side, count in ((height, rows), (width, columns))
        )
        return np.asarray(total / (tall[:, None] * wide))

    def taken(image: Float64) -> Float64:
        if how is np.mean:
            return mean(image)
        if how is np.max:
            return extreme(image, np.maximum, -np.inf)
        return extreme(image, np.minimum, np.inf)

    nearest, second = taken(layers.nearest), taken(layers.second)
    low = extreme(layers.owner, np.minimum, np.iinfo(np.int32).max)
    alone = low == extreme(layers.owner, np.maximum, -1)
    own = np.where(alone, low, -1).astype(np.int32)
    return Layers(nearest, own, np.where(alone, second, nearest))


def coarse(texel: int, make: Callable[[At, int], Layers], key: str) -> Tell:
    def tell(at: At) -> Told:
        if min(at.camera.width, at.camera.height) < 2 * texel:
            return None
        layers = at.now.kept((key, texel), lambda: make(at, texel))
        height, width = layers.owner.shape
        rectangles = within(at.camera, at.boxes.spans, texel=texel)
        rectangles[:, 2] = np.minimum(rectangles[:, 2], width - 1)
        rectangles[:, 3] = np.minimum(rectangles[:, 3], height - 1)
        return kept(at, asked(at, rectangles, at.boxes.nearest, layers=layers).passing > 0)

    return tell


def first_of_texel(at: At, texel: int) -> Layers:
    return at.now.layers().picked(slice(None, None, texel), slice(None, None, texel))


def middle_of_texel(at: At, texel: int) -> Layers:
    start = texel // 2
    layers = at.now.layers()
    height, width = layers.owner.shape
    rows = np.minimum(np.arange(-(-height // texel)) * texel + start, height - 1)
    columns = np.minimum(np.arange(-(-width // texel)) * texel + start, width - 1)
    return layers.picked(rows, columns)


def last_of_texel(at: At, texel: int) -> Layers:
    layers = at.now.layers()
    height, width = layers.owner.shape
    rows = np.minimum(np.arange(-(-height // texel)) * texel + texel - 1, height - 1)
    columns = np.minimum(np.arange(-(-width // texel)) * texel + texel - 1, width - 1)
    return layers.picked(rows, columns)


def mean_of_texel(at: At, texel: int) -> Layers:
    far = finite_far(at)
    layers = at.now.layers().mapped(lambda image: np.minimum(image, far))
    return blocks(layers, texel, np.mean)


def window_mean_of_texel(at: At, texel: int) -> Layers:
    """The mean of window depths."""
    far = finite_far(at)

    def there(image: Float64) -> Float64:
        return np.asarray(1.0 / np.minimum(image, far))

    if not at.camera.is_perspective:
        return mean_of_texel(at, texel)
    mean = blocks(at.now.layers().mapped(there), texel, np.mean)
    return mean.mapped(lambda image: np.asarray(1.0 / image))


def nearest_of_texel(at: At, texel: int) -> Layers:
    return blocks(at.now.layers(), texel, np.min)


def farthest_of_texel(at: At, texel: int) -> Layers:
    return blocks(at.now.layers(), texel, np.max)


def whole_texels(at: At, texel: int) -> Layers:
    return blocks(at.now.layers(), texel, np.max, whole_only=True)


def finite_far(at: At) -> float:
    """Far, or what lies behind everything."""
    if math.isfinite(at.camera.far):
        return at.camera.far
    depths = at.now.layers().nearest
    seen = depths[np.isfinite(depths)]
    return 2.0 * float(seen.max()) if len(seen) else 2.0 * max(at.camera.near, 1.0)


def odd_size(at: At, texel: int) -> bool:
    return at.camera.width % texel != 0 or at.camera.height % texel != 0


def at_the_edge(texel: int, *, from_below: bool = False) -> Tell:
    """What shows only beyond the last whole texel is left out, as of an image of whole tiles,
    counted from the upper row or from the lowest."""

    def tell(at: At) -> Told:
        if not odd_size(at, texel) or min(at.camera.width, at.camera.height) < texel:
            return None
        height, width = at.camera.height, at.camera.width
        rows = height // texel * texel
        whole = slice(height - rows, None) if from_below else slice(rows)
        inner = at.now.seen_in(whole, slice(width // texel * texel))
        return (inner | ~at.now.seen_anywhere)[at.ids]

    return tell


def odd(texel: int) -> Tell:
    told = coarse(texel, whole_texels, "whole")

    def tell(at: At) -> Told:
        return told(at) if odd_size(at, texel) else None

    return tell
