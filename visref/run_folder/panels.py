"""The pictures of a witness's surroundings: what ought to be seen, what was drawn, and the pixels
around the sample at closer sight; with names, a scale, and the lost object outlined.

They are drawn from the witness's line alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from visref.run_folder.colours import BRIGHTEST, DARKEST, MISSED_RGB, pastel, srgb
from visref.run_folder.labels import FONT_PX, Named, place, text, width_of, write
from visref.run_folder.layout import CLOSE_CELLS, CLOSE_PX, CLOSE_SIDE, OTHERS, SHADES
from visref.run_folder.silhouettes import borders
from visref.scene import Float64, Int64

# A panel's side. A cell is at most so wide, so that a picture of few samples looks like one.
PANEL_PX = 384
_MOST_ZOOM = 48
_LARGE_CELL = 16
MAX_LABELS = 8
# An object of fewer of the panel's pixels is not named, unless it is the lost one.
_LEAST_NAMED_PX = 60
_SKY, _MATTE, _OTHER = (0.86, 0.90, 0.94), (0.80, 0.80, 0.78), (0.62, 0.62, 0.60)
_INK, _PAPER = (27, 32, 38), (255, 255, 255)
_TITLE_PX = 22
# How strongly glass tints what is behind it.
_GLASS = 0.45


class Panel(NamedTuple):
    """A picture of `PANEL_PX` x `PANEL_PX`, what it shows, and how wide a cell is in it."""

    what: str
    title: str
    image: Image.Image


class _Seen(NamedTuple):
    """A picture's cells, (h, w): appearances, and objects (-1 others, -2 the background)."""

    colour: Float64
    object: Int64
    glass: Int64


class _View(NamedTuple):
    """Where cells stand in a panel: (x, y) = offset + cell * zoom."""

    zoom: int
    left: int
    top: int

    def grown(self, cells: NDArray[Any], fill: Any) -> NDArray[Any]:
        """The cells as a panel's pixels, `fill` around them."""
        big = cells.repeat(self.zoom, axis=0).repeat(self.zoom, axis=1)
        panel = np.empty((PANEL_PX, PANEL_PX, *cells.shape[2:]), cells.dtype)
        panel[...] = fill
        panel[self.top : self.top + big.shape[0], self.left : self.left + big.shape[1]] = big
        return panel


_NO_OBJECT = -2


def panels(witness: Mapping[str, Any]) -> list[Panel]:
    """What ought to be seen around a witness, what was drawn, and the closer sight: of a witness
    that has surroundings."""
    around = witness["surroundings"]
    shape = around["height"], around["width"]
    truth, drawn = (_seen(witness, around[name], shape) for name in ("truth", "drawn"))
    close = _seen(witness, around["close"], (CLOSE_SIDE, CLOSE_SIDE), own=True)
    lost = np.array([a["lost"] for a in around["appearances"]], np.bool_)[
        unrun(around["truth"], shape)
    ]
    view = _fitted(shape)
    sample = tuple((witness[k] - around[k]) / around["step"] for k in ("x", "y"))
    mark = _Mark(
        view.left + (sample[0] + 0.5) * view.zoom,
        view.top + (sample[1] + 0.5) * view.zoom,
        (witness["margin_px"] or 0.0) * view.zoom / around["step"],
        # Around the sample's cell, or, where that is large, in it.
        4.0 + 0.71 * view.zoom if view.zoom < _LARGE_CELL else 5.0,
    )
    per_sample = view.zoom / around["step"]
    near = _fitted((CLOSE_SIDE, CLOSE_SIDE))
    middle = near.left + (CLOSE_PX + 0.5) * CLOSE_CELLS * near.zoom
    reach = (witness["margin_px"] or 0.0) * CLOSE_CELLS * near.zoom
    own = close.object == witness["object"]
    ought = _panel(witness, truth, lost, view, per_sample, mark)
    was = _panel(witness, drawn, lost, view, per_sample, mark)
    per_close, at = float(CLOSE_CELLS * near.zoom), _Mark(middle, middle, reach, 5.0)
    sight = _panel(witness, close, own, near, per_close, at, dots=True)
    side = 2 * CLOSE_PX + 1
    return [
        Panel("ought", "what ought to be seen", ought),
        Panel("drawn", "what was drawn", was),
        Panel("close", f"{side} x {side} pixels around the sample", sight),
    ]


class _Mark(NamedTuple):
    """The witness in a panel, how far around it the claim holds, and the radius of the ring that
    marks it, in pixels of the panel."""

    x: float
    y: float
    reach: float
    ring: float


def unrun(runs: list[int], shape: tuple[int, int]) -> Int64:
    """The cells of a picture from its run lengths: (h, w) int64."""
    pairs = np.array(runs, np.int64).reshape(-1, 2)
    return np.repeat(pairs[:, 1], pairs[:, 0]).reshape(shape)


def composed(parts: Sequence[Panel]) -> Image.Image:
    """The panels side by side, each under its title."""
    gap = 12
    picture = Image.new(
        "RGB", (len(parts) * (PANEL_PX + gap) + gap, PANEL_PX + _TITLE_PX + gap), _PAPER
    )
    pen = ImageDraw.Draw(picture)
    for index, one in enumerate(parts):
        left = gap + index * (PANEL_PX + gap)
        text(pen, (left, (_TITLE_PX - FONT_PX) // 2), one.title)
        picture.paste(one.image, (left, _TITLE_PX))
    return picture


def world_per_sample(witness: Mapping[str, Any]) -> float:
    """How wide a sample is at the witness's depth, in world units."""
    samples = witness["samples"]
    step = math.hypot(*(float.fromhex(value) for value in samples["R"]))
    depth = witness["depth"] if samples["projection"] == "perspective" else 1.0
    return 2.0 * step * abs(float(depth))


def _seen(
    witness: Mapping[str, Any], runs: list[int], shape: tuple[int, int], *, own: bool = False
) -> _Seen:
    """A picture's cells. `own`: whether all of the witness's object is in the colour of what is
    lost, and not only what is."""
    looks = witness["surroundings"]["appearances"]
    objects = np.array([_NO_OBJECT if a["object"] is None else a["object"] for a in looks])
    glass = np.array([_NO_OBJECT if a["glass"] is None else a["glass"] for a in looks])
    share = np.array([a["shade"] for a in looks]) / (SHADES - 1)
    light = DARKEST + share * (BRIGHTEST - DARKEST)
    missed = np.array(MISSED_RGB) / 255.0
    colour = srgb(pastel(np.maximum(objects, 0)) * light[:, None])
    colour[objects == OTHERS] = _OTHER
    colour[objects == _NO_OBJECT] = _SKY
    lost = np.array([a["lost"] for a in looks], np.bool_)
    solid = (lost | own) & (objects == witness["object"])
    colour[solid] = missed * np.clip(0.55 + 0.45 * light[solid], 0.0, 1.0)[:, None]
    tinted = glass >= 0
    tint = srgb(pastel(np.maximum(glass, 0)))
    tint[lost & (glass == witness["object"])] = missed
    colour[tinted] += _GLASS * (tint[tinted] - colour[tinted])
    place_of = unrun(runs, shape)
    return _Seen(colour[place_of], objects[place_of], glass[place_of])


def _fitted(shape: tuple[int, int]) -> _View:
    zoom = max(1, min(_MOST_ZOOM, PANEL_PX // max(shape)))
    return _View(zoom, (PANEL_PX - shape[1] * zoom) // 2, (PANEL_PX - shape[0] * zoom) // 2)


def _panel(
    witness: Mapping[str, Any],
    seen: _Seen,
    outlined: NDArray[np.bool_],
    view: _View,
    per_sample: float,
    mark: _Mark,
    *,
    dots: bool = False,
) -> Image.Image:
    """One picture. `outlined`: the cells around which the outline goes; `per_sample`: how many of
    the panel's pixels a sample has."""
    pixels = np.round(view.grown(seen.colour, _MATTE) * 255.0).astype(np.uint8)
    objects = view.grown(np.where(seen.glass >= 0, seen.glass, seen.object), -3)
    edge = borders(objects) if view.zoom >= 3 else np.zeros(objects.shape, np.bool_)
    pixels[edge] = (pixels[edge] * 0.62).astype(np.uint8)
    region = view.grown(outlined, fill=False)
    # Two pixels of vermilion inside, one of white around it.
    inner = region & ~_shrunk(_shrunk(region))
    around = _grown(region) & ~region
    pixels[inner], pixels[around] = MISSED_RGB, _PAPER
    image = Image.fromarray(pixels)
    pen = ImageDraw.Draw(image)
    if dots:
        for row in range(2 * CLOSE_PX + 1):
            for column in range(2 * CLOSE_PX + 1):
                x = view.left + (column + 0.5) * per_sample
                y = view.top + (row + 0.5) * per_sample
                pen.ellipse((x - 2, y - 2, x + 2, y + 2), _INK, _PAPER)
    bar, words, length = _scale(witness, per_sample)
    _draw_mark(pen, mark)
    taken = [bar, _box_of(mark)]
    rows, columns = np.nonzero(region)
    if len(rows) and np.ptp(rows) < PANEL_PX // 3 and np.ptp(columns) < PANEL_PX // 3:
        taken.append((int(columns.min()), int(rows.min()), int(columns.max()), int(rows.max())))
    write(pen, place(_named(witness, objects, region), (PANEL_PX, PANEL_PX), taken))
    _draw_scale(pen, bar, words, length)
    return image


def _named(witness: Mapping[str, Any], objects: Int64, region: NDArray[np.bool_]) -> list[Named]:
    """The lost object, and those that cover most of the panel."""
    names = {one["object"]: one["name"] for one in witness["surroundings"]["objects"]}
    lost = witness["object"]
    found = [Named(witness["object_name"], region)] if region.any() else []
    ids, counts = np.unique(objects, return_counts=True)
    for index in np.lexsort((ids, -counts)):
        obj = int(ids[index])
        if obj in names and obj != lost and counts[index] >= _LEAST_NAMED_PX:
            found.append(Named(names[obj], (objects == obj) & ~region))
    if not region.any() and (objects == lost).any():
        found.insert(0, Named(witness["object_name"], objects == lost))
    return [one for one in found if one.where.any()][:MAX_LABELS]


def _draw_mark(pen: ImageDraw.ImageDraw, mark: _Mark) -> None:
    """The witness's sample, and around it how far the claim holds at least."""
    x, y = mark.x, mark.y
    if mark.reach >= mark.ring + 1.0:
        reach = mark.reach
        pen.ellipse((x - reach, y - reach, x + reach, y + reach), None, _PAPER, 3)
        pen.ellipse((x - reach, y - reach, x + reach, y + reach), None, _INK, 1)
    ring = mark.ring
    pen.ellipse((x - ring, y - ring, x + ring, y + ring), None, _PAPER, 3)
    pen.ellipse((x - ring + 1, y - ring + 1, x + ring - 1, y + ring - 1), None, _INK, 1)


def _box_of(mark: _Mark) -> tuple[int, int, int, int]:
    x, y, ring = round(mark.x), round(mark.y), round(mark.ring)
    return x - ring, y - ring, x + ring, y + ring


def _scale(
    witness: Mapping[str, Any], per_sample: float
) -> tuple[tuple[int, int, int, int], str, int]:
    """The scale's box at the foot, its words, and the bar's length in pixels of the panel."""
    samples = _round_number(PANEL_PX / 4 / per_sample)
    length = max(1, round(samples * per_sample))
    world = samples * world_per_sample(witness)
    words = f"{samples:g} px = {world:.3g} units"
    width = max(length, width_of(words)) + 12
    return (6, PANEL_PX - 30, 6 + width, PANEL_PX - 6), words, length


def _draw_scale(
    pen: ImageDraw.ImageDraw, bar: tuple[int, int, int, int], words: str, length: int
) -> None:
    left, top, right, bottom = bar
    pen.rounded_rectangle((left, top, right - 1, bottom - 1), 3, _PAPER, _INK, 1)
    text(pen, (left + 6, top + 3), words)
    pen.rectangle((left + 6, bottom - 6, left + 5 + length, bottom - 4), _INK)


def _round_number(most: float) -> float:
    """The greatest of 1, 2, 5, 10, … (or 0.1, 0.2, …) that is at most this; 1 at least."""
    if most < 1.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(most))
    return max(m * power for m in (1.0, 2.0, 5.0) if m * power <= most)


def _grown(region: NDArray[np.bool_]) -> NDArray[np.bool_]:
    padded = np.pad(region, 1)
    return (
        padded[1:-1, 1:-1] | padded[:-2, 1:-1] | padded[2:, 1:-1]
        | padded[1:-1, :-2] | padded[1:-1, 2:]
    )  # fmt: skip


def _shrunk(region: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return ~_grown(~np.pad(region, 1))[1:-1, 1:-1]
