"""A tiled homogeneous rasteriser that never decides what it cannot prove.

After Olano and Greer, "Triangle Scan Conversion using 2D Homogeneous Coordinates" (1997), with
the hierarchical depth rejection of Greene, Kass and Miller (1993). Departures: nothing is
clipped or snapped, every comparison carries the bound of `visref.exact.filters`, and where a
bound cannot decide, the triangle goes on a list of contenders instead of being drawn or dropped.

`visref.exact.screen` finds the triangles whose screen box holds a sample and sorts them into
tiles, `rasterise` fills tiles. What comes out: per sample the certainly covering triangle with
the greatest lower bound of its key, and every other triangle that may still be as near.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.exact.filters import (
    BOUND_0,
    BOUND_1,
    BOUND_2,
    CERTAIN,
    EDGE_0,
    EDGE_1,
    EDGE_2,
    KEY_BOUND,
    KEY_PLANE,
    NOTHING,
    SET_UP_SIZE,
    SIGN,
    SIGN_BOUND,
    U,
    View,
    clip_state,
    set_up,
)
from visref.exact.screen import (
    BLOCK,
    BLOCK_SHIFT,
    CHECK,
    GREATEST,
    TILE,
    TILE_SHIFT,
    X0,
    X1,
    Y0,
    Y1,
    Binned,
)

# Testing a rectangle's corners costs as much as this many samples.
CORNER_TESTS_PAY = 8

NOT_WANTED = -2

# What is known of a contender.
POSSIBLE, COVERING, NEARER = 0, 1, 2

# The columns of the contenders: see `rasterise`.
SAMPLE, TRIANGLE, KNOWN, KEY_AT_MOST = range(4)


class ClusteredTriangles(NamedTuple):
    """All triangles in cluster order: `corners` (t, 9) float32, `one_sided` (t,) bool, `ids` (t,)
    int32, each one's id in the scene."""

    corners: NDArray[np.float32]
    one_sided: NDArray[np.bool_]
    ids: NDArray[np.int32]


class Owned(NamedTuple):
    """Who certainly owns each sample. `owner`: (height, width) int32 ids, -1 for none. `floor`,
    `ceiling`: (height, width) float64, bounds of that owner's key, -inf for none; or (0, 0), where
    nobody asks for them."""

    owner: NDArray[np.int32]
    floor: NDArray[np.float64]
    ceiling: NDArray[np.float64]


@njit(error_model="numpy", inline="always")
def _greatest(c: NDArray[Any], k: int, a0: float, a1: float, b0: float, b1: float) -> float:
    """The greatest computed value of an affine function over a rectangle's corners."""
    b = b1 if c[k + 2] > 0.0 else b0
    a = a1 if c[k + 1] > 0.0 else a0
    value: float = (c[k] + b * c[k + 2]) + a * c[k + 1]
    return value


@njit(error_model="numpy")
def _block_least(low: NDArray[Any], start: int, before: float) -> float:
    """The least key in a block, which was `before` and can only have grown."""
    least = np.inf
    for y in range(BLOCK):
        for x in range(BLOCK):
            value = low[start + (y << TILE_SHIFT) + x]
            if value <= before:
                return before
            if value < least:
                least = value
    return least


@njit(error_model="numpy")
def _with_room(out: NDArray[Any], count: int, more: int) -> NDArray[Any]:
    if count + more <= len(out):
        return out
    grown = np.empty((max(2 * len(out), count + more), 4))
    for index in range(count):
        for k in range(4):
            grown[index, k] = out[index, k]
    return grown


@njit(error_model="numpy")
def _doubt(
    c: NDArray[Any],
    t: int,
    view: View,
    rays: tuple[NDArray[Any], NDArray[Any]],
    rectangle: tuple[int, int, int, int],
    tile: tuple[int, int, NDArray[Any]],
    out: NDArray[Any],
    count: int,
) -> tuple[NDArray[Any], int]:
    """Note a triangle of doubtful orientation at every sample that it is not certain to miss:
    where two edges certainly differ in sign it misses, and where it is certainly too near.

    `rays`: column_a and row_b. `rectangle`: pixels x0, x1, y0, y1, inclusive. `tile`: its first
    column and row, and the owners of its samples.
    """
    column_a, row_b = rays
    x0, x1, y0, y1 = rectangle
    left, top, own = tile
    bound0, bound1, bound2 = c[BOUND_0], c[BOUND_1], c[BOUND_2]
    for y in range(y0, y1 + 1):
        out = _with_room(out, count, x1 - x0 + 1)
        b = row_b[y]
        for x in range(x0, x1 + 1):
            if own[((y - top) << TILE_SHIFT) + x - left] == NOT_WANTED:
                continue
            a = column_a[x]
            e0 = (c[EDGE_0] + b * c[EDGE_0 + 2]) + a * c[EDGE_0 + 1]
            e1 = (c[EDGE_1] + b * c[EDGE_1 + 2]) + a * c[EDGE_1 + 1]
            e2 = (c[EDGE_2] + b * c[EDGE_2 + 2]) + a * c[EDGE_2 + 1]
            if (e0 > bound0 or e1 > bound1 or e2 > bound2) and (
                e0 < -bound0 or e1 < -bound1 or e2 < -bound2
            ):
                continue
            if view.perspective:
                # t = |N| / |D|; 4 u for the roundings.
                least = abs((c[KEY_PLANE] + b * c[KEY_PLANE + 2]) + a * c[KEY_PLANE + 1])
                least -= c[KEY_BOUND]
                if abs(c[SIGN]) + c[SIGN_BOUND] < view.near * least * (1.0 - 4.0 * U):
                    continue
            out[count, SAMPLE], out[count, TRIANGLE] = y * view.width + x, t
            out[count, KNOWN], out[count, KEY_AT_MOST] = POSSIBLE, np.inf
            count += 1
    return out, count


@njit(error_model="numpy")
def rasterise(
    tiles: NDArray[Any],
    view: View,
    rays: tuple[NDArray[Any], NDArray[Any]],
    triangles: ClusteredTriangles,
    binned: Binned,
    wanted: NDArray[Any],
    collect: bool,
    owned: Owned,
) -> NDArray[np.float64]:
    """Fill some tiles: `owned` is written.

    `tiles`: (n,) int64. `rays`: column_a and row_b. With `collect` the bounds of `owned` are read
    instead, nothing is drawn, and every triangle that may reach the floor comes back. `wanted`:
    (height, width) bool, or (0, 0) for all samples.
    Returns contenders, (k, 4) float64: flat SAMPLE, TRIANGLE id, what is KNOWN (POSSIBLE,
    COVERING or, only with `collect`, NEARER: covering and above the ceiling), and KEY_AT_MOST,
    the greatest key that it may have.
    """
    # Unpacked here: inside the loops numba would count references to every array of a tuple.
    column_a, row_b = rays
    corners, one_sided, ids = triangles
    found, boxes, keys, bin_offsets, bin_entries, tile_columns = binned
    owner, floor, ceiling = owned
    width, height = view.width, view.height
    low = np.empty(TILE * TILE)
    high = np.empty(TILE * TILE)
    own = np.empty(TILE * TILE, np.int32)
    blocks = TILE >> BLOCK_SHIFT
    block_low = np.empty((blocks, blocks))
    c = np.empty(SET_UP_SIZE)
    out = np.empty((1024, 4))
    # Of a type, not a literal: for that numba would compile all it is given to a second time.
    count = np.int64(0)
    for tile in tiles:
        left, top = (tile % tile_columns) * TILE, (tile // tile_columns) * TILE
        right, bottom = min(left + TILE, width), min(top + TILE, height)
        tile_start = count
        low[:], high[:], own[:] = np.inf, -np.inf, NOT_WANTED
        block_low[:] = np.inf
        for y in range(top, bottom):
            for x in range(left, right):
                if wanted.size == 0 or wanted[y, x]:
                    place = ((y - top) << TILE_SHIFT) + x - left
                    low[place] = floor[y, x] if collect else -np.inf
                    own[place] = -1
                    j, i = (y - top) >> BLOCK_SHIFT, (x - left) >> BLOCK_SHIFT
                    block_low[j, i] = min(block_low[j, i], low[place])
        for entry in range(bin_offsets[tile], bin_offsets[tile + 1]):
            k = bin_entries[entry]
            x0, x1 = max(boxes[k, X0], left), min(boxes[k, X1], right - 1)
            y0, y1 = max(boxes[k, Y0], top), min(boxes[k, Y1], bottom - 1)
            j0, j1 = (y0 - top) >> BLOCK_SHIFT, (y1 - top) >> BLOCK_SHIFT
            i0, i1 = (x0 - left) >> BLOCK_SHIFT, (x1 - left) >> BLOCK_SHIFT
            greatest = keys[k, GREATEST]
            hidden = True
            for j in range(j0, j1 + 1):
                for i in range(i0, i1 + 1):
                    hidden = hidden and greatest < block_low[j, i]
            if hidden:
                continue
            t = found[k]
            state = set_up(corners[t], one_sided[t], view.perspective, view.lens, c)
            t = ids[t]
            if state == NOTHING:
                continue
            if state != CERTAIN:
                rectangle = (x0, x1, y0, y1)
                out, count = _doubt(
                    c, t, view, (column_a, row_b), rectangle, (left, top, own), out, count
                )
                continue
            check = keys[k, CHECK] != 0.0 or view.clips
            c0, ca0, cb0, c1, ca1, cb1, c2, ca2, cb2 = (
                c[EDGE_0], c[EDGE_0 + 1], c[EDGE_0 + 2],
                c[EDGE_1], c[EDGE_1 + 1], c[EDGE_1 + 2],
                c[EDGE_2], c[EDGE_2 + 1], c[EDGE_2 + 2],
            )  # fmt: skip
            q0, qa, qb = c[KEY_PLANE], c[KEY_PLANE + 1], c[KEY_PLANE + 2]
            bound0, bound1, bound2, error = c[BOUND_0], c[BOUND_1], c[BOUND_2], c[KEY_BOUND]
            for j in range(j0, j1 + 1):
                for i in range(i0, i1 + 1):
                    if greatest < block_low[j, i]:
                        continue
                    bx0 = max(x0, left + (i << BLOCK_SHIFT))
                    bx1 = min(x1, left + (i << BLOCK_SHIFT) + BLOCK - 1)
                    by0 = max(y0, top + (j << BLOCK_SHIFT))
                    by1 = min(y1, top + (j << BLOCK_SHIFT) + BLOCK - 1)
                    if (bx1 - bx0 + 1) * (by1 - by0 + 1) > CORNER_TESTS_PAY:
                        a0, a1 = column_a[bx0], column_a[bx1]
                        b0, b1 = row_b[by1], row_b[by0]
                        if (
                            _greatest(c, EDGE_0, a0, a1, b0, b1) < -bound0
                            or _greatest(c, EDGE_1, a0, a1, b0, b1) < -bound1
                            or _greatest(c, EDGE_2, a0, a1, b0, b1) < -bound2
                            or _greatest(c, KEY_PLANE, a0, a1, b0, b1) + error < block_low[j, i]
                        ):
                            continue
                    if count + BLOCK * BLOCK > len(out):
                        out = _with_room(out, count, BLOCK * BLOCK)
                    changed = False
                    for y in range(by0, by1 + 1):
                        b = row_b[y]
                        row0, row1, row2 = c0 + b * cb0, c1 + b * cb1, c2 + b * cb2
                        row_q = q0 + b * qb
                        row = ((y - top) << TILE_SHIFT) - left
                        for x in range(bx0, bx1 + 1):
                            a = column_a[np.uint64(x)]
                            place = np.uint64(row + x)
                            # One branch, not four: which of these fails is anyone's guess.
                            q = row_q + a * qa
                            e0, e1, e2 = row0 + a * ca0, row1 + a * ca1, row2 + a * ca2
                            upper = q + error
                            if (
                                (upper < low[place])
                                | (e0 < -bound0)
                                | (e1 < -bound1)
                                | (e2 < -bound2)
                            ):
                                continue
                            certain = (e0 >= bound0) & (e1 >= bound1) & (e2 >= bound2)
                            lower = q - error
                            if check:
                                if lower > view.too_near or upper < view.too_far:
                                    continue
                                certain = (
                                    certain
                                    and upper <= view.near_enough
                                    and lower >= view.far_enough
                                )
                                if view.clips:
                                    counts = clip_state(view, lower, upper, a, b)
                                    if counts < 0:
                                        continue
                                    certain = certain and counts > 0
                            if own[place] == NOT_WANTED:
                                continue
                            if certain and not collect and lower > low[place]:
                                if high[place] >= lower:
                                    out[count, SAMPLE] = y * width + x
                                    out[count, TRIANGLE] = own[place]
                                    out[count, KNOWN] = COVERING
                                    out[count, KEY_AT_MOST] = high[place]
                                    count += 1
                                own[place], low[place], high[place] = t, lower, upper
                                changed = True
                                continue
                            out[count, SAMPLE], out[count, TRIANGLE] = y * width + x, t
                            out[count, KNOWN] = COVERING if certain else POSSIBLE
                            if collect and certain and lower > ceiling[y, x]:
                                out[count, KNOWN] = NEARER
                            out[count, KEY_AT_MOST] = upper
                            count += 1
                    if changed:
                        start = (j << (TILE_SHIFT + BLOCK_SHIFT)) + (i << BLOCK_SHIFT)
                        block_low[j, i] = _block_least(low, start, block_low[j, i])
        kept = tile_start
        for index in range(tile_start, count):
            sample = int(out[index, SAMPLE])
            place = ((sample // width - top) << TILE_SHIFT) + sample % width - left
            if not out[index, KEY_AT_MOST] < low[place]:
                for column in range(4):
                    out[kept, column] = out[index, column]
                kept += 1
        count = kept
        if not collect:
            for y in range(top, bottom):
                for x in range(left, right):
                    place = ((y - top) << TILE_SHIFT) + x - left
                    owner[y, x] = max(own[place], -1)
                    if floor.size:
                        floor[y, x] = low[place]
                        ceiling[y, x] = high[place]
    return out[:count]
