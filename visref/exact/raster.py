"""A tiled homogeneous rasteriser that never decides what it cannot prove.

After Olano and Greer, "Triangle Scan Conversion using 2D Homogeneous Coordinates" (1997), with
the hierarchical depth rejection of Greene, Kass and Miller (1993). Departures: nothing is
clipped or snapped (screen boxes alone use a clip at the near plane, rounded outward), every
comparison carries the bound of `visref.exact.filters`, and where a bound cannot decide the
triangle is put on a list of contenders instead of being drawn or dropped.

`project` finds the triangles whose screen box holds a sample, `bin_boxes` sorts them into
tiles, `rasterise` fills tiles. What comes out: per sample the certainly covering triangle with
the greatest lower bound of its key, and every other triangle that may still be as near.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from visref.exact.filters import (
    CERTAIN,
    KEY_BOUND,
    NOTHING,
    PIXEL_SLACK,
    PROJECT,
    PROJECT_CLIPPED,
    SET_UP_SIZE,
    SIGN,
    SIGN_BOUND,
    U,
    View,
    set_up,
)

TILE_SHIFT, BLOCK_SHIFT = 6, 3
TILE, BLOCK = 1 << TILE_SHIFT, 1 << BLOCK_SHIFT
# The clip for screen boxes lies this much before the near plane, so that an error of a vertex's
# depth up to `near` times this cannot cut off a point that a sample might hit.
CLIP_SLACK = 2.0**-10

# Testing a rectangle's corners costs as much as this many samples.
CORNER_TESTS_PAY = 8

NOT_WANTED = -2

# What is known of a contender.
POSSIBLE, COVERING, NEARER = 0, 1, 2


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _pixel_range(low: float, high: float, grow: float, count: int) -> tuple[int, int]:
    """The pixels between two coordinates, outward and NaN-proof: (first, last), maybe empty."""
    low -= grow + PIXEL_SLACK
    high += grow + PIXEL_SLACK
    first = 0
    if low > 0.0:
        first = count if low > count else math.ceil(low)
    last = count - 1
    if high < count - 1:
        last = -1 if high < 0.0 else math.floor(high)
    return first, last


def count_wanted(wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many wanted samples lie in the blocks above and left of each block corner:
    (block rows + 1, block columns + 1) int64."""
    height, width = wanted.shape
    rows, columns = -(-height // BLOCK), -(-width // BLOCK)
    blocks = np.zeros((rows * BLOCK, columns * BLOCK), np.int64)
    blocks[:height, :width] = wanted
    blocks = blocks.reshape(rows, BLOCK, columns, BLOCK).sum(axis=(1, 3))
    return np.pad(blocks.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _none_wanted(sums: NDArray[Any], x0: int, x1: int, y0: int, y1: int) -> bool:
    """Whether no block that meets a pixel rectangle holds a wanted sample."""
    i0, i1 = x0 >> BLOCK_SHIFT, (x1 >> BLOCK_SHIFT) + 1
    j0, j1 = y0 >> BLOCK_SHIFT, (y1 >> BLOCK_SHIFT) + 1
    none: bool = sums[j1, i1] - sums[j0, i1] - sums[j1, i0] + sums[j0, i0] == 0
    return none


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _box_range(
    low: NDArray[Any],
    high: NDArray[Any],
    dual: NDArray[Any],
    norm: float,
    z_least: float,
    z_greatest: float,
    middle: float,
    scale: float,
    grow: float,
    count: int,
    perspective: bool,
) -> tuple[int, int]:
    """The pixels (columns or rows) that a box before the eye may cover, by interval arithmetic.

    Its corners are `low`, `high` relative to the eye, its depths in z_least..z_greatest.
    """
    least, greatest, size = 0.0, 0.0, 0.0
    for k in range(3):
        p = dual[k]
        least += p * low[k] if p > 0.0 else p * high[k]
        greatest += p * high[k] if p > 0.0 else p * low[k]
        size = max(size, max(abs(low[k]), abs(high[k])))
    error = PROJECT * norm * size
    least, greatest = least - error, greatest + error
    if perspective:
        # 4 u: the subtraction and the division, of either sign.
        least /= z_greatest if least > 0.0 else z_least
        greatest /= z_least if greatest > 0.0 else z_greatest
        least -= 4.0 * U * abs(least)
        greatest += 4.0 * U * abs(greatest)
    if scale < 0.0:
        least, greatest = greatest, least
    pixels: tuple[int, int] = _pixel_range(
        scale * least + middle, scale * greatest + middle, grow, count
    )
    return pixels


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cluster_depths(
    bounds: NDArray[Any], view: View, grow: float, sums: NDArray[Any], nearest: NDArray[Any]
) -> None:
    """The least view depth of each cluster into `nearest`, inf where it certainly owns nothing.

    `bounds`: (c, 2, 3) float32. Outward: a cluster is left out only where every point of its
    box is beyond one plane of the frustum, `grow` pixels out, by more than the rounding; or
    where its box's screen box holds no wanted sample (`sums` of `count_wanted`, (0, 0) for all).
    """
    # One unit of a and b (half a pixel) to spare; the error term covers the rest.
    spare = 1.0 + 2.0 * grow
    planes = np.zeros((4, 3))
    norms = np.zeros(4)
    offsets = np.zeros(4)
    limits = (view.a_least, view.a_greatest, view.b_least, view.b_greatest)
    for i in range(4):
        dual = view.x_dual if i < 2 else view.y_dual
        toward = 1.0 if i % 2 == 0 else -1.0
        limit = limits[i] - toward * spare
        for k in range(3):
            if view.perspective:
                planes[i, k] = toward * (dual[k] - limit * view.z_dual[k])
                norms[i] += abs(dual[k]) + abs(limit * view.z_dual[k])
            else:
                planes[i, k] = toward * dual[k]
                norms[i] += abs(dual[k])
        if not view.perspective:
            offsets[i] = toward * limit
    low = np.empty(3)
    high = np.empty(3)
    for c in range(len(bounds)):
        size = 0.0
        least, greatest = 0.0, 0.0
        for k in range(3):
            low[k] = np.float64(bounds[c, 0, k]) - view.e[k]
            high[k] = np.float64(bounds[c, 1, k]) - view.e[k]
            size = max(size, max(abs(low[k]), abs(high[k])))
            z = view.z_dual[k]
            least += z * low[k] if z > 0.0 else z * high[k]
            greatest += z * high[k] if z > 0.0 else z * low[k]
        error = PROJECT * view.z_norm * size
        nearest[c] = least - error
        outside = greatest + error < view.near or least - error > view.far
        if view.boxes:
            for i in range(4):
                value = 0.0
                for k in range(3):
                    p = planes[i, k]
                    value += p * high[k] if p > 0.0 else p * low[k]
                # 16 u: the plane's own roundings (3) and the offset's come on top of PROJECT's.
                if value - offsets[i] < -16.0 * U * (norms[i] * size + abs(offsets[i])):
                    outside = True
            if sums.size and not outside and (least - error > view.near or not view.perspective):
                x0, x1 = _box_range(
                    low, high, view.x_dual, view.x_norm, least - error, greatest + error,
                    0.5 * (view.width - 1) - view.shift_x_px, 0.5, grow, view.width,
                    view.perspective,
                )  # fmt: skip
                y0, y1 = _box_range(
                    low, high, view.y_dual, view.y_norm, least - error, greatest + error,
                    0.5 * (view.height - 1) - view.shift_y_px, -0.5, grow, view.height,
                    view.perspective,
                )  # fmt: skip
                outside = x0 > x1 or y0 > y1 or _none_wanted(sums, x0, x1, y0, y1)
        if outside:
            nearest[c] = np.inf


@numba.njit(cache=True, nogil=True, error_model="numpy")
def project(
    clusters: NDArray[Any],
    cluster_offsets: NDArray[Any],
    corners: NDArray[Any],
    usable: NDArray[Any],
    view: View,
    grow: float,
    sums: NDArray[Any],
    found: NDArray[Any],
    boxes: NDArray[Any],
    keys: NDArray[Any],
) -> int:
    """Find the triangles whose screen box, grown by `grow` pixels, holds a sample, and meets a
    block of wanted samples (`sums` of `count_wanted`, (0, 0) for all).

    Goes through `clusters` in order; `corners`: (t, 9) float32 in cluster order; `usable`: (t,)
    bool. Writes to `found` the triangle's place in cluster order, to `boxes` its first and last
    pixel column and row, to `keys` (upper bound of the key, 1.0 if its depth range must be
    checked at each sample). Returns how many were found. All bounds are outward.
    """
    count = 0
    z = np.empty(3)
    x = np.empty(3)
    y = np.empty(3)
    for index in range(len(clusters)):
        cluster = clusters[index]
        for t in range(cluster_offsets[cluster], cluster_offsets[cluster + 1]):
            if not usable[t]:
                continue
            size = 0.0
            for i in range(3):
                wx = np.float64(corners[t, 3 * i]) - view.e[0]
                wy = np.float64(corners[t, 3 * i + 1]) - view.e[1]
                wz = np.float64(corners[t, 3 * i + 2]) - view.e[2]
                size = max(size, max(abs(wx), max(abs(wy), abs(wz))))
                x[i] = view.x_dual[0] * wx + view.x_dual[1] * wy + view.x_dual[2] * wz
                y[i] = view.y_dual[0] * wx + view.y_dual[1] * wy + view.y_dual[2] * wz
                z[i] = view.z_dual[0] * wx + view.z_dual[1] * wy + view.z_dual[2] * wz
            z_error = PROJECT * view.z_norm * size
            z_least = min(z[0], min(z[1], z[2])) - z_error
            z_greatest = max(z[0], max(z[1], z[2])) + z_error
            if z_greatest < view.near or z_least > view.far:
                continue
            check = not (z_least > view.near and z_greatest < view.far)
            x0, x1, y0, y1 = 0, view.width - 1, 0, view.height - 1
            if view.boxes:
                x_error = PROJECT_CLIPPED * view.x_norm * size
                y_error = PROJECT_CLIPPED * view.y_norm * size
                a0, a1, b0, b1 = np.inf, -np.inf, np.inf, -np.inf
                bounded = True
                if view.perspective:
                    clip = view.near * (1.0 - CLIP_SLACK)
                    bounded = z_error < view.near * (0.5 * CLIP_SLACK)
                    for i in range(3):
                        if z[i] >= clip:
                            inverse = 1.0 / z[i]
                            a, b = x[i] * inverse, y[i] * inverse
                            a_error = 2.0 * (x_error + abs(a) * z_error) * inverse
                            b_error = 2.0 * (y_error + abs(b) * z_error) * inverse
                            a0, a1 = min(a0, a - a_error), max(a1, a + a_error)
                            b0, b1 = min(b0, b - b_error), max(b1, b + b_error)
                        j = i + 1 if i < 2 else 0
                        if (z[i] >= clip) != (z[j] >= clip):
                            part = (clip - z[i]) / (z[j] - z[i])
                            inverse = 1.0 / clip
                            a = (x[i] + part * (x[j] - x[i])) * inverse
                            b = (y[i] + part * (y[j] - y[i])) * inverse
                            a_error = 2.0 * (x_error + abs(a) * z_error) * inverse
                            b_error = 2.0 * (y_error + abs(b) * z_error) * inverse
                            a0, a1 = min(a0, a - a_error), max(a1, a + a_error)
                            b0, b1 = min(b0, b - b_error), max(b1, b + b_error)
                else:
                    a0 = min(x[0], min(x[1], x[2])) - x_error
                    a1 = max(x[0], max(x[1], x[2])) + x_error
                    b0 = min(y[0], min(y[1], y[2])) - y_error
                    b1 = max(y[0], max(y[1], y[2])) + y_error
                if bounded:
                    middle = 0.5 * (view.width - 1) - view.shift_x_px
                    x0, x1 = _pixel_range(0.5 * a0 + middle, 0.5 * a1 + middle, grow, view.width)
                    middle = 0.5 * (view.height - 1) - view.shift_y_px
                    y0, y1 = _pixel_range(middle - 0.5 * b1, middle - 0.5 * b0, grow, view.height)
                    if x0 > x1 or y0 > y1:
                        continue
            if sums.size and _none_wanted(sums, x0, x1, y0, y1):
                continue
            found[count] = t
            boxes[count, 0] = x0
            boxes[count, 1] = x1
            boxes[count, 2] = y0
            boxes[count, 3] = y1
            if view.perspective:
                # A hit has t >= near too. Two roundings of normal numbers; 4 u is upward.
                keys[count, 0] = (1.0 / max(z_least, view.near)) * (1.0 + 4.0 * U)
            else:
                keys[count, 0] = -z_least
            keys[count, 1] = 1.0 if check else 0.0
            count += 1
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def bin_boxes(
    boxes: NDArray[Any], tile_wanted: NDArray[Any], tile_columns: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """For each wanted tile the boxes that meet it, in order: (offsets, box indices)."""
    tiles = len(tile_wanted)
    offsets = np.zeros(tiles + 1, np.int64)
    for k in range(len(boxes)):
        for row in range((boxes[k, 2] >> TILE_SHIFT), (boxes[k, 3] >> TILE_SHIFT) + 1):
            for column in range((boxes[k, 0] >> TILE_SHIFT), (boxes[k, 1] >> TILE_SHIFT) + 1):
                tile = row * tile_columns + column
                if tile_wanted[tile]:
                    offsets[tile + 1] += 1
    for tile in range(tiles):
        offsets[tile + 1] += offsets[tile]
    entries = np.empty(offsets[tiles], np.int32)
    place = offsets[:-1].copy()
    for k in range(len(boxes)):
        for row in range((boxes[k, 2] >> TILE_SHIFT), (boxes[k, 3] >> TILE_SHIFT) + 1):
            for column in range((boxes[k, 0] >> TILE_SHIFT), (boxes[k, 1] >> TILE_SHIFT) + 1):
                tile = row * tile_columns + column
                if tile_wanted[tile]:
                    entries[place[tile]] = k
                    place[tile] += 1
    return offsets, entries


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _greatest(c: NDArray[Any], k: int, a0: float, a1: float, b0: float, b1: float) -> float:
    """The greatest computed value of an affine function over a rectangle's corners."""
    b = b1 if c[k + 2] > 0.0 else b0
    a = a1 if c[k + 1] > 0.0 else a0
    value: float = (c[k] + b * c[k + 2]) + a * c[k + 1]
    return value


@numba.njit(cache=True, nogil=True, error_model="numpy")
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _with_room(out: NDArray[Any], count: int, more: int) -> NDArray[Any]:
    if count + more <= len(out):
        return out
    grown = np.empty((max(2 * len(out), count + more), 4))
    for index in range(count):
        for k in range(4):
            grown[index, k] = out[index, k]
    return grown


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _doubt(
    c: NDArray[Any],
    t: int,
    view: View,
    column_a: NDArray[Any],
    row_b: NDArray[Any],
    rectangle: tuple[int, int, int, int],
    left: int,
    top: int,
    own: NDArray[Any],
    out: NDArray[Any],
    count: int,
) -> tuple[NDArray[Any], int]:
    """Note a triangle of doubtful orientation at every sample that it is not certain to miss:
    where two edges certainly differ in sign it misses, and where it is certainly too near."""
    x0, x1, y0, y1 = rectangle
    bound0, bound1, bound2 = c[12], c[13], c[14]
    for y in range(y0, y1 + 1):
        out = _with_room(out, count, x1 - x0 + 1)
        b = row_b[y]
        for x in range(x0, x1 + 1):
            if own[((y - top) << TILE_SHIFT) + x - left] == NOT_WANTED:
                continue
            a = column_a[x]
            e0 = (c[0] + b * c[2]) + a * c[1]
            e1 = (c[3] + b * c[5]) + a * c[4]
            e2 = (c[6] + b * c[8]) + a * c[7]
            if (e0 > bound0 or e1 > bound1 or e2 > bound2) and (
                e0 < -bound0 or e1 < -bound1 or e2 < -bound2
            ):
                continue
            if view.perspective:
                # t = |N| / |D|; 4 u for the roundings.
                least = abs((c[9] + b * c[11]) + a * c[10]) - c[KEY_BOUND]
                if abs(c[SIGN]) + c[SIGN_BOUND] < view.near * least * (1.0 - 4.0 * U):
                    continue
            out[count, 0], out[count, 1] = y * view.width + x, t
            out[count, 2], out[count, 3] = POSSIBLE, np.inf
            count += 1
    return out, count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def rasterise(
    tiles: NDArray[Any],
    tile_columns: int,
    view: View,
    column_a: NDArray[Any],
    row_b: NDArray[Any],
    corners: NDArray[Any],
    one_sided: NDArray[Any],
    ids: NDArray[Any],
    found: NDArray[Any],
    boxes: NDArray[Any],
    keys: NDArray[Any],
    bin_offsets: NDArray[Any],
    bin_entries: NDArray[Any],
    wanted: NDArray[Any],
    collect: bool,
    owner: NDArray[Any],
    floor: NDArray[Any],
    ceiling: NDArray[Any],
) -> NDArray[np.float64]:
    """Fill some tiles.

    `ids`: (t,) int32, triangle ids in cluster order. `owner`: (height, width) int32, the
    certain owner's id (-1 for none) is written. `floor`, `ceiling`: (height, width) float64,
    bounds of that owner's key (-inf for none), written unless their shape is (0, 0). With
    `collect` they are read instead, nothing is drawn, and every triangle that may reach the
    floor comes back. `wanted`: (height, width) bool, or (0, 0) for all samples.
    Returns contenders, (k, 4) float64: flat sample, triangle id, what is known (POSSIBLE,
    COVERING or, only with `collect`, NEARER: covering and above the ceiling), and the greatest
    key that it may have.
    """
    width, height = view.width, view.height
    low = np.empty(TILE * TILE)
    high = np.empty(TILE * TILE)
    own = np.empty(TILE * TILE, np.int32)
    blocks = TILE >> BLOCK_SHIFT
    block_low = np.empty((blocks, blocks))
    c = np.empty(SET_UP_SIZE)
    out = np.empty((1024, 4))
    count = 0
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
            x0, x1 = max(boxes[k, 0], left), min(boxes[k, 1], right - 1)
            y0, y1 = max(boxes[k, 2], top), min(boxes[k, 3], bottom - 1)
            j0, j1 = (y0 - top) >> BLOCK_SHIFT, (y1 - top) >> BLOCK_SHIFT
            i0, i1 = (x0 - left) >> BLOCK_SHIFT, (x1 - left) >> BLOCK_SHIFT
            greatest = keys[k, 0]
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
                    c, t, view, column_a, row_b, rectangle, left, top, own, out, count
                )
                continue
            check = keys[k, 1] != 0.0
            c0, ca0, cb0, c1, ca1, cb1, c2, ca2, cb2 = (
                c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8],
            )  # fmt: skip
            q0, qa, qb, bound0, bound1, bound2, error = (
                c[9], c[10], c[11], c[12], c[13], c[14], c[KEY_BOUND],
            )  # fmt: skip
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
                            _greatest(c, 0, a0, a1, b0, b1) < -bound0
                            or _greatest(c, 3, a0, a1, b0, b1) < -bound1
                            or _greatest(c, 6, a0, a1, b0, b1) < -bound2
                            or _greatest(c, 9, a0, a1, b0, b1) + error < block_low[j, i]
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
                            if own[place] == NOT_WANTED:
                                continue
                            if certain and not collect and lower > low[place]:
                                if high[place] >= lower:
                                    out[count, 0], out[count, 1] = y * width + x, own[place]
                                    out[count, 2], out[count, 3] = COVERING, high[place]
                                    count += 1
                                own[place], low[place], high[place] = t, lower, upper
                                changed = True
                                continue
                            out[count, 0], out[count, 1] = y * width + x, t
                            out[count, 2] = COVERING if certain else POSSIBLE
                            if collect and certain and lower > ceiling[y, x]:
                                out[count, 2] = NEARER
                            out[count, 3] = upper
                            count += 1
                    if changed:
                        start = (j << (TILE_SHIFT + BLOCK_SHIFT)) + (i << BLOCK_SHIFT)
                        block_low[j, i] = _block_least(low, start, block_low[j, i])
        kept = tile_start
        for index in range(tile_start, count):
            sample = int(out[index, 0])
            place = ((sample // width - top) << TILE_SHIFT) + sample % width - left
            if not out[index, 3] < low[place]:
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
