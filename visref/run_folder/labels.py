"""Names written into small pictures: none over another, with a line to what is too small for one.

A label is tried inside its object first, then ever farther from it; the first place that is free
is taken, in a fixed order, so that the same picture gets the same labels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw, ImageFont

from visref.scene import Int64
from visref.wording import legible

FONT_PX = 12
_PAD = 3
_GAP = 2
# A label outside its object stands so far from it, in steps.
_RINGS = 14
_RING_PX = 13
_WAYS = 16
_LONGEST, _HEAD = 24, 6
_PAPER, _INK, _LINE = (255, 255, 255), (27, 32, 38), (60, 66, 72)


class Named(NamedTuple):
    """Something to name: its text, and the picture's pixels that it covers, (h, w) bool."""

    text: str
    where: NDArray[np.bool_]


class Label(NamedTuple):
    """A label's box, (left, top, right, bottom) in pixels, and the point that it names. `inside`:
    whether the box lies in what it names."""

    text: str
    box: tuple[int, int, int, int]
    anchor: tuple[int, int]
    inside: bool


@cache
def font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """The one that comes with Pillow."""
    return ImageFont.load_default(FONT_PX)


def shown_texts(texts: Sequence[str]) -> list[str]:
    """Names as a picture shows them: in letters that the font has, "?" for the others; without the
    end that all of them share, and without the middle where they are long."""
    plain = [
        "".join(c if 32 <= ord(c) < 127 or 160 < ord(c) < 256 else "?" for c in legible(one))
        for one in texts
    ]
    if len(set(plain)) > 1:
        # Parts of a path or of a name, as exporters add them.
        ends = {one[at:] for one in plain[:1] for at, letter in enumerate(one) if letter in "/_.:"}
        shared = [
            end for end in ends if all(one.endswith(end) and len(one) > len(end) for one in plain)
        ]
        if shared:
            plain = [one[: -max(map(len, shared))] for one in plain]
    return [
        one if len(one) <= _LONGEST else f"{one[:_HEAD]}...{one[_HEAD + 3 - _LONGEST :]}"
        for one in plain
    ]


def place(
    named: Sequence[Named], shape: tuple[int, int], taken: Sequence[tuple[int, int, int, int]] = ()
) -> list[Label]:
    """Where the labels go in a picture of `shape` (height, width), none over another or over the
    boxes that are `taken`; what has no place is left out. The first come first."""
    boxes = list(taken)
    labels = []
    for one, words in zip(named, shown_texts([one.text for one in named]), strict=True):
        size = width_of(words) + 2 * _PAD, FONT_PX + 2 * _PAD
        anchor = _middle(one.where)
        for box in _places(anchor, size):
            free = all(_apart(box, other) for other in boxes)
            if free and box[0] >= 0 and box[1] >= 0 and box[2] <= shape[1] and box[3] <= shape[0]:
                inside = bool(one.where[box[1] : box[3], box[0] : box[2]].all())
                if inside or not _over(box, anchor):
                    labels.append(Label(words, box, anchor, inside))
                    boxes.append(box)
                    break
    return labels


def write(pen: ImageDraw.ImageDraw, labels: Sequence[Label]) -> None:
    """Draw the labels, the lines first."""
    for label in labels:
        if not label.inside:
            left, top, right, bottom = label.box
            x, y = label.anchor
            end = min(max(x, left), right - 1), min(max(y, top), bottom - 1)
            pen.line((x, y, *end), _PAPER, 3)
            pen.line((x, y, *end), _LINE, 1)
            pen.ellipse((x - 2, y - 2, x + 2, y + 2), _LINE, _PAPER)
    for label in labels:
        left, top, right, bottom = label.box
        pen.rounded_rectangle((left, top, right - 1, bottom - 1), 3, _PAPER, _LINE, 1)
        text(pen, (left + _PAD, top + _PAD), label.text)


def text(pen: ImageDraw.ImageDraw, at: tuple[float, float], words: str) -> None:
    """Write words with their top left corner at a point."""
    pen.text((at[0], at[1] - 1), words, _INK, font())


def width_of(words: str) -> int:
    left, _top, right, _bottom = font().getbbox(words)
    return int(right - left)


def _places(anchor: tuple[int, int], size: tuple[int, int]) -> Iterator[tuple[int, int, int, int]]:
    """Boxes about a point, and ever farther off."""
    for ring in range(_RINGS):
        for way in range(_WAYS if ring else 1):
            turn = 2.0 * np.pi * way / _WAYS
            reach_x = ring and size[0] / 2 + _RING_PX * ring
            reach_y = ring and size[1] / 2 + _RING_PX * ring
            x = round(anchor[0] + reach_x * float(np.cos(turn)) - size[0] / 2)
            y = round(anchor[1] - reach_y * float(np.sin(turn)) - size[1] / 2)
            yield x, y, x + size[0], y + size[1]


def _over(box: tuple[int, int, int, int], point: tuple[int, int]) -> bool:
    return box[0] <= point[0] < box[2] and box[1] <= point[1] < box[3]


def _apart(one: tuple[int, int, int, int], other: tuple[int, int, int, int]) -> bool:
    return (
        one[2] + _GAP <= other[0]
        or other[2] + _GAP <= one[0]
        or one[3] + _GAP <= other[1]
        or other[3] + _GAP <= one[1]
    )


def _middle(where: NDArray[np.bool_]) -> tuple[int, int]:
    """The pixel (x, y) about which the greatest square lies inside, the middle one of equals."""
    padded = np.pad(where, 1).astype(np.int64)
    best, at = -1, (0, 0)
    # Where a square fits, so does each smaller one: the greatest is found by halving.
    sums = padded.cumsum(axis=0).cumsum(axis=1)
    height, width = where.shape
    low, high = 0, max(height, width)
    while low <= high:
        reach = (low + high) // 2
        found = _square_inside(sums, height, width, reach)
        if found is None:
            high = reach - 1
        else:
            low, best, at = reach + 1, reach, found
    return at if best >= 0 else (width // 2, height // 2)


def _square_inside(sums: Int64, height: int, width: int, reach: int) -> tuple[int, int] | None:
    """The first pixel (x, y) about which a square of that reach lies inside, None for none."""
    side = 2 * reach + 1
    if side > min(height, width):
        return None
    # sums[i, j] counts the pixels before row i and column j, both included by the padding.
    full = (
        sums[side:-1, side:-1] - sums[: -side - 1, side:-1]
        - sums[side:-1, : -side - 1] + sums[: -side - 1, : -side - 1]
    )  # fmt: skip
    rows, columns = np.nonzero(full == side * side)
    if not len(rows):
        return None
    # The middle one of them, as near as there is one.
    y, x = float(rows.mean()), float(columns.mean())
    nearest = int(np.argmin((rows - y) ** 2 + (columns - x) ** 2))
    return int(columns[nearest]) + reach, int(rows[nearest]) + reach
