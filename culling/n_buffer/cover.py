"""Covering a rectangle of pixels by squares whose sides are powers of two.

Décoret 2005, section 2 and Fig. 3. One square: the smallest that covers the rectangle, from its
top left corner. Four squares, in five cases by how the rectangle lies in that square, of side S:

    wider and higher than S/2     four of side S/2, one in each corner: exact
    wider, at most S/2 high       side S/2, the two lower ones are the upper ones
    wider, at most S/4 high       side S/4, the four side by side
    (and the last two with width and height exchanged)

A rectangle from x to x + d inclusive has d + 1 pixels: the level is the smallest i with
2^i >= d + 1, where the text says d. Squares that are one and the same are still looked up, so
that a test always costs what the paper says: one comparison a square.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from visref.scene import Int32, Int64

ONE, FOUR = 1, 4


class Cover(NamedTuple):
    """Squares over k rectangles: `level` (k,) int64, and the pixels (x, y) at which they start,
    (k, 1) or (k, 4) int64, inside the image."""

    level: Int64
    x: Int64
    y: Int64


def one_square(rectangles: Int32) -> Cover:
    """The smallest square over each rectangle, (k, 4) x0, y0, x1, y1 inclusive, not empty."""
    x0, y0, x1, y1 = rectangles.astype(np.int64).T
    level = ceil_log2(np.maximum(x1 - x0, y1 - y0) + 1)
    return Cover(level, x0[:, None], y0[:, None])


def four_squares(rectangles: Int32) -> Cover:
    """Four squares over each rectangle, (k, 4) x0, y0, x1, y1 inclusive, not empty."""
    x0, y0, x1, y1 = rectangles.astype(np.int64).T
    width, height = x1 - x0 + 1, y1 - y0 + 1
    level = np.maximum(ceil_log2(np.maximum(width, height)) - 1, 0)
    # At most half of such a square high (wide): a row (column) of four that are half as large.
    half = (1 << level) >> 1
    row, column = height <= half, width <= half
    level = level - (row | column)
    side = 1 << level
    # Where the squares start: the first from the rectangle's start, the last up to its end.
    # Never before the start: a square that is wider than the rectangle hangs from its top left.
    last_x, last_y = np.maximum(x1 - side + 1, x0), np.maximum(y1 - side + 1, y0)
    corners_x = np.stack([x0, last_x, x0, last_x], axis=1)
    corners_y = np.stack([y0, y0, last_y, last_y], axis=1)
    along_x = np.minimum(x0[:, None] + side[:, None] * np.arange(FOUR), last_x[:, None])
    along_y = np.minimum(y0[:, None] + side[:, None] * np.arange(FOUR), last_y[:, None])
    x = np.where(row[:, None], along_x, np.where(column[:, None], x0[:, None], corners_x))
    y = np.where(column[:, None], along_y, np.where(row[:, None], y0[:, None], corners_y))
    return Cover(level, x, y)


def ceil_log2(numbers: Int64) -> Int64:
    """The smallest i with 2**i >= n, of positive integers below 2**31: int64 of any shape."""
    # frexp is exact: n - 1 = m * 2**e with m in [1/2, 1), so 2**e is the least power above n - 1.
    return np.frexp((numbers - 1).astype(np.float64))[1].astype(np.int64)
