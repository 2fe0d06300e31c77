"""Which pixels a box may touch: its rectangle on the screen, clipped at the near plane."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Float64, Int32, Int64
from visref_culling.gl.view import View


def screen_rectangles(view: View, boxes: Float64, *, clip_to_window: bool = True) -> Int32:
    """Pixels that boxes relative to the eye may touch: (k, 4) int32 x0, y0, x1, y1, inclusive.

    The rectangle of the box's part beyond the near plane, in whole pixels. Outward: every
    pixel whose square it meets; empty (x1 < x0) where the part or the rectangle is.
    Not clipped, it is kept within a window's side around the window.
    """
    rows, near, window = projection_of(view)
    result = np.empty((len(boxes), 4), np.int32)
    _screen_rectangles(boxes, rows, near, window, 0 if clip_to_window else 1, result)
    return result


def projection_of(view: View) -> tuple[Float64, float, Int64]:
    """What `rectangle_of_box` needs of a view: (4, 4) float64 rows that give clip x, y, w and view
    depth of a position relative to the eye; the near plane's depth; (2,) int64 pixels of the
    window."""
    camera = view.camera
    clip = view.clip_from_relative
    rows = np.stack([clip[0], clip[1], clip[3], np.append(view.depth_row, 0.0)])
    return rows, float(camera.near), np.array([camera.width, camera.height])


@njit()
def _screen_rectangles(
    boxes: NDArray[Any],
    rows: NDArray[Any],
    near: float,
    window: NDArray[Any],
    windows_around: int,
    result: NDArray[Any],
) -> None:
    at = np.empty((8, 4))
    for i in range(len(boxes)):
        rectangle_of_box(boxes[i], rows, near, window, windows_around, at, result[i])


@njit()
def rectangle_of_box(
    box: NDArray[Any],
    rows: NDArray[Any],
    near: float,
    window: NDArray[Any],
    windows_around: int,
    at: NDArray[Any],
    result: NDArray[Any],
) -> None:
    """`screen_rectangles` of one box, (2, 3) float64, into `result`, (4,) int32. `rows`, `near`,
    `window`: of `projection_of`; it is kept within `windows_around` windows around the window.
    `at`: (8, 4) float64, is written over: clip x, y, w and view depth of each corner."""
    for corner in range(8):
        x = box[corner & 1, 0]
        y = box[(corner >> 1) & 1, 1]
        z = box[(corner >> 2) & 1, 2]
        for k in range(4):
            at[corner, k] = rows[k, 0] * x + rows[k, 1] * y + rows[k, 2] * z + rows[k, 3]
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    for corner in range(8):
        depth = at[corner, 3]
        if depth >= near:
            # Window coordinates: pixel k's square is k ... k + 1, y down.
            x = 0.5 * window[0] * (1.0 + at[corner, 0] / at[corner, 2])
            y = 0.5 * window[1] * (1.0 - at[corner, 1] / at[corner, 2])
            low_x, high_x = min(low_x, x), max(high_x, x)
            low_y, high_y = min(low_y, y), max(high_y, y)
        for axis in range(3):
            other = corner ^ (1 << axis)
            other_depth = at[other, 3]
            if depth < near <= other_depth:
                # Where the edge meets the near plane.
                t = (near - depth) / (other_depth - depth)
                # There w is view depth, thus near; interpolating it loses that in a
                # box of 1e30. An orthographic w is 1.
                w = 1.0 if rows[2, 3] == 1.0 else near
                x = (at[corner, 0] + t * (at[other, 0] - at[corner, 0])) / w
                y = (at[corner, 1] + t * (at[other, 1] - at[corner, 1])) / w
                x = 0.5 * window[0] * (1.0 + x)
                y = 0.5 * window[1] * (1.0 - y)
                low_x, high_x = min(low_x, x), max(high_x, x)
                low_y, high_y = min(low_y, y), max(high_y, y)
    # Kept within bounds while still floating point: a far side need not fit an integer.
    # One pixel beyond the bounds makes the rectangle empty where it lies outside them.
    around_x, around_y = windows_around * window[0], windows_around * window[1]
    result[0] = np.floor(min(max(low_x, -around_x), around_x + window[0]))
    result[1] = np.floor(min(max(low_y, -around_y), around_y + window[1]))
    result[2] = np.floor(max(min(high_x, around_x + window[0] - 1.0), -around_x - 1.0))
    result[3] = np.floor(max(min(high_y, around_y + window[1] - 1.0), -around_y - 1.0))
