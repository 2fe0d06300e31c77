"""The maps themselves: bits for tiles, what a shape sets, and the traversal over all shapes.

A map is (WORDS,) uint32, a bit a tile, rows of WORDS_PER_ROW words, the least bit first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Float64, Int32, Int64
from visref_culling.boxes.conservative import inflate_box
from visref_culling.boxes.rectangles import rectangle_of_box

TILES = 128  # a side
WORDS_PER_ROW = TILES // 32
WORDS = TILES * WORDS_PER_ROW  # 512 of 32 bits

# What becomes of a shape; lists count from 1.
OUTSIDE, DRAW_NOW, UNDECIDED = -1, 0, -2


class Grid(NamedTuple):
    """How tiles lie on the window: pixels `x0`, `y0` of the first, `width` and `height` of each."""

    x0: int
    y0: int
    width: int
    height: int


class Projection(NamedTuple):
    """What projects a box in the world to pixels: the arguments of `inflate_box` and
    `rectangle_of_box`."""

    eye: Float64
    growth: Float64
    rows: Float64
    near: float
    window: Int64


class Parts(NamedTuple):
    """What drawing a shape marks: the tiles under each of its parts.

    `bounds`: (m, 2, 3) float64, boxes in the world of all parts of all units; `first_bounds`: (k,)
    int64, where those of each of the frame's k shapes begin. `first`: (k + 1,) int64 and `tiles`:
    (q, 4) int32: shape i, once it is marked, marked `tiles[first[i]:first[i + 1]]`, columns and
    rows c0, r0, c1, r1, inclusive; empty (c1 < c0) for a part out of view, and until then.
    """

    bounds: Float64
    first_bounds: Int64
    first: Int64
    tiles: Int32


@dataclass(frozen=True, eq=False)
class Tiles:
    """The tiles of the k shapes of a frame. `under`: (k, 4) int32 columns and rows, inclusive,
    under each shape's rectangle, which is what a lookup asks about."""

    under: Int32
    parts: Parts
    projection: Projection
    grid: Grid


@njit()
def tiles_under(rectangles: NDArray[Any], grid: Grid) -> NDArray[Any]:
    """(k, 4) int32 columns and rows of tiles under rectangles of pixels, (k, 4) int32."""
    result = np.empty((len(rectangles), 4), np.int32)
    for i in range(len(rectangles)):
        tiles_under_rectangle(rectangles[i], grid, result[i])
    return result


@njit()
def tiles_under_rectangle(pixels: NDArray[Any], grid: Grid, result: NDArray[Any]) -> None:
    """`tiles_under` of one rectangle, (4,) int32, into `result`, (4,) int32."""
    if pixels[2] < pixels[0] or pixels[3] < pixels[1]:
        result[0] = result[1] = 0
        result[2] = result[3] = -1
        return
    for side in range(4):
        first, size = (grid.x0, grid.width) if side % 2 == 0 else (grid.y0, grid.height)
        # An inflated box may reach a pixel over the scene's own rectangle.
        result[side] = min(max((pixels[side] - first) // size, 0), TILES - 1)


@njit(inline="always")
def covered(words: NDArray[Any], c0: int, r0: int, c1: int, r1: int) -> bool:
    """Whether every tile of columns c0...c1 and rows r0...r1 is set in a map, (WORDS,) uint32."""
    first, last = c0 >> 5, c1 >> 5
    for row in range(r0, r1 + 1):
        for word in range(first, last + 1):
            mask = np.uint32(0xFFFFFFFF)
            if word == first:
                mask &= np.uint32(0xFFFFFFFF) << np.uint32(c0 & 31)
            if word == last:
                mask &= np.uint32(0xFFFFFFFF) >> np.uint32(31 - (c1 & 31))
            if words[row * WORDS_PER_ROW + word] & mask != mask:
                return False
    return True


@njit(inline="always")
def mark(words: NDArray[Any], c0: int, r0: int, c1: int, r1: int) -> None:
    """Set every tile of columns c0...c1 and rows r0...r1 in a map, (WORDS,) uint32."""
    first, last = c0 >> 5, c1 >> 5
    for row in range(r0, r1 + 1):
        for word in range(first, last + 1):
            mask = np.uint32(0xFFFFFFFF)
            if word == first:
                mask &= np.uint32(0xFFFFFFFF) << np.uint32(c0 & 31)
            if word == last:
                mask &= np.uint32(0xFFFFFFFF) >> np.uint32(31 - (c1 & 31))
            words[row * WORDS_PER_ROW + word] |= mask


@njit()
def _mark_shape(
    words: NDArray[Any],
    place: int,
    parts: Parts,
    projection: Projection,
    grid: Grid,
    box: NDArray[Any],
    at: NDArray[Any],
    pixels: NDArray[Any],
) -> None:
    """Set the tiles under each part of the shape at `place`. `box`: (2, 3) and `at`: (8, 4)
    float64 and `pixels`: (4,) int32 are written over."""
    first = parts.first[place]
    for p in range(first, parts.first[place + 1]):
        bounds = parts.bounds[parts.first_bounds[place] + p - first]
        inflate_box(bounds, projection.eye, projection.growth, box)
        rectangle_of_box(box, projection.rows, projection.near, projection.window, 0, at, pixels)
        tiles = parts.tiles[p]
        tiles_under_rectangle(pixels, grid, tiles)
        mark(words, tiles[0], tiles[1], tiles[2], tiles[3])


@njit()
def mark_shapes(
    words: NDArray[Any], parts: Parts, projection: Projection, grid: Grid, places: NDArray[Any]
) -> None:
    """Set the tiles of every part of the shapes at `places`, (n,), in a map, (WORDS,) uint32."""
    box, at, pixels = np.empty((2, 3)), np.empty((8, 4)), np.empty(4, np.int32)
    for place in places:
        _mark_shape(words, place, parts, projection, grid, box, at, pixels)


@njit()
def arrange(
    under: NDArray[Any],
    parts: Parts,
    projection: Projection,
    grid: Grid,
    sure: NDArray[Any],
    words: NDArray[Any],
    list_of: NDArray[Any],
    start: int,
    stop_after_run: bool,
) -> int:
    """Decide shapes from `start` on, front to back, by the first map: drawn at once, and marked,
    where it has an unset tile under them, else in list 1. Returns where it stopped.

    With `stop_after_run` it stops before a shape that would be drawn at once where some between
    are in the list: their answers may yet set its tiles. What is covered stays so, whatever the
    answers.

    `under`, `parts`, `projection`, `grid`: as of `Tiles`; `sure`: (k,) bool, to be drawn whatever
    the map says; `words`: (WORDS,) uint32; `list_of`: (k,) int8.
    """
    box, at, pixels = np.empty((2, 3)), np.empty((8, 4)), np.empty(4, np.int32)
    asked = False
    for i in range(start, len(under)):
        if list_of[i] != UNDECIDED:
            continue
        c0, r0, c1, r1 = under[i, 0], under[i, 1], under[i, 2], under[i, 3]
        if not sure[i] and covered(words, c0, r0, c1, r1):
            list_of[i] = 1
            asked = True
            continue
        if asked and stop_after_run:
            return i
        list_of[i] = DRAW_NOW
        _mark_shape(words, i, parts, projection, grid, box, at, pixels)
    return len(under)


@njit()
def arrange_lists(under: NDArray[Any], maps: NDArray[Any], list_of: NDArray[Any]) -> None:
    """Spread the shapes of list 1 over the lists: each joins the first list whose map, of those
    after the first, has an unset tile under it, and marks that map; what all show as covered
    joins the last. `under`: (k, 4); `maps`: (maps, WORDS) uint32; `list_of`: (k,) int8."""
    for i in range(len(under)):
        if list_of[i] != 1:
            continue
        c0, r0, c1, r1 = under[i, 0], under[i, 1], under[i, 2], under[i, 3]
        list_of[i] = len(maps)
        for number in range(1, len(maps)):
            if not covered(maps[number], c0, r0, c1, r1):
                list_of[i] = number
                mark(maps[number], c0, r0, c1, r1)
                break
