"""Where on the screen triangles may be: conservative boxes, and the tiles that they meet.

All bounds are outward: too great a box only costs time. The boxes alone use a clip at the near
plane; nothing that is decided depends on it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.exact.filters import PIXEL_SLACK, PROJECT, PROJECT_CLIPPED, U, View

TILE_SHIFT, BLOCK_SHIFT = 6, 3
TILE, BLOCK = 1 << TILE_SHIFT, 1 << BLOCK_SHIFT
# The clip for screen boxes lies this much before the near plane, so that an error of a vertex's
# depth up to `near` times this cannot cut off a point that a sample might hit.
CLIP_SLACK = 2.0**-10

# The columns of a triangle's screen box: first and last pixel column, first and last pixel row.
X0, X1, Y0, Y1 = range(4)
# The columns of `keys`: an upper bound of the key; 1.0 where the depth range must be checked at
# each sample, else 0.0; an upper bound of the keys of this entry and all after it.
GREATEST, CHECK, LEFT = range(3)
# A cluster that meets at most so many tiles is projected in each of them, where nothing hides it;
# of others each triangle goes to the tiles that it meets.
FEW_TILES = 6
# The factor by which a number that goes through a few products stays far from overflow.
GREATEST_PIXEL = 2.0**400


class Binned(NamedTuple):
    """Triangles that may reach some samples, sorted into the screen's tiles.

    `found`: (f,) int32, places in cluster order, or -1 - i for cluster i as a whole; `boxes`:
    (f, 4) int32, columns X0 to Y1; `keys`: (f, 3) float64, columns GREATEST to LEFT. Tile i, row by
    row, meets the boxes `entries[offsets[i]:offsets[i + 1]]`, int32 in ascending order;
    `offsets`: (tiles + 1,) int64. `columns`: how many tiles a row of them has.
    """

    found: NDArray[np.int32]
    boxes: NDArray[np.int32]
    keys: NDArray[np.float64]
    offsets: NDArray[np.int64]
    entries: NDArray[np.int32]
    columns: int


class _Axis(NamedTuple):
    """A screen axis of so many `pixels`: one is at `scale` (dual . w / depth) + `middle`.
    `dual`: (3,) float64; `norm`: |dual|_1."""

    dual: NDArray[Any]
    norm: float
    middle: float
    scale: float
    pixels: int


@njit(error_model="numpy", inline="always")
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
    """How many samples of `wanted`, (height, width) bool, lie in the blocks above and left of each
    block corner: (block rows + 1, block columns + 1) int64."""
    height, width = wanted.shape
    rows, columns = -(-height // BLOCK), -(-width // BLOCK)
    blocks = np.zeros((rows * BLOCK, columns * BLOCK), np.int64)
    blocks[:height, :width] = wanted
    blocks = blocks.reshape(rows, BLOCK, columns, BLOCK).sum(axis=(1, 3))
    return np.pad(blocks.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))


@njit(error_model="numpy", inline="always")
def _none_wanted(sums: NDArray[Any], x0: int, x1: int, y0: int, y1: int) -> bool:
    """Whether no block that meets a pixel rectangle holds a wanted sample."""
    i0, i1 = x0 >> BLOCK_SHIFT, (x1 >> BLOCK_SHIFT) + 1
    j0, j1 = y0 >> BLOCK_SHIFT, (y1 >> BLOCK_SHIFT) + 1
    none: bool = sums[j1, i1] - sums[j0, i1] - sums[j1, i0] + sums[j0, i0] == 0
    return none


@njit(error_model="numpy")
def _box_range(
    low: NDArray[Any],
    high: NDArray[Any],
    depths: tuple[float, float],
    axis: _Axis,
    grow: float,
    perspective: bool,
) -> tuple[int, int]:
    """The pixels (columns or rows) that a box before the eye may cover, by interval arithmetic.

    Its corners are `low`, `high` relative to the eye, `depths` its least and greatest.
    """
    z_least, z_greatest = depths
    dual, norm, middle, scale, count = axis
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


@njit(error_model="numpy")
def cluster_depths(
    bounds: NDArray[Any],
    view: View,
    grow: float,
    sums: NDArray[Any],
    nearest: NDArray[Any],
    boxes: NDArray[Any],
) -> None:
    """The least view depth of each cluster into `nearest`, inf where it certainly owns nothing,
    and into `boxes`, (c, 4) int32, the pixels X0 to Y1 that it may cover; X0 is -1 where they are
    not known.

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
    middle_x = 0.5 * (view.width - 1) - view.shift_x_px
    middle_y = 0.5 * (view.height - 1) - view.shift_y_px
    columns = _Axis(view.x_dual, view.x_norm, middle_x, 0.5, view.width)
    rows = _Axis(view.y_dual, view.y_norm, middle_y, -0.5, view.height)
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
        boxes[c, X0] = -1
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
            # Every depth in the box is far above its error, and no pixel is near overflow: see
            # `visref.exact.lanes.project`.
            reach = max(view.x_norm, view.y_norm) * size
            if view.perspective:
                known = least - error > view.near and error < (least - error) * (0.5 * CLIP_SLACK)
                known = known and reach < GREATEST_PIXEL * (least - error)
            else:
                known = reach < GREATEST_PIXEL
            if known and not outside:
                depths = (least - error, greatest + error)
                x0, x1 = _box_range(low, high, depths, columns, grow, view.perspective)
                y0, y1 = _box_range(low, high, depths, rows, grow, view.perspective)
                outside = x0 > x1 or y0 > y1
                if sums.size and not outside:
                    outside = _none_wanted(sums, x0, x1, y0, y1)
                boxes[c, X0], boxes[c, X1], boxes[c, Y0], boxes[c, Y1] = x0, x1, y0, y1
        if outside:
            nearest[c] = np.inf


@njit(error_model="numpy")
def project(
    clusters: NDArray[Any],
    cluster_offsets: NDArray[Any],
    corners: NDArray[Any],
    usable: NDArray[Any],
    view: View,
    grow: float,
    sums: NDArray[Any],
    nearest: NDArray[Any],
    cluster_boxes: NDArray[Any],
    into: tuple[NDArray[Any], NDArray[Any], NDArray[Any]],
) -> int:
    """Find the triangles whose screen box, grown by `grow` pixels, holds a sample, and meets a
    block of wanted samples (`sums` of `count_wanted`, (0, 0) for all).

    Goes through `clusters` in order; `corners`: (t, 9) float32 in cluster order; `usable`: (t,)
    bool. `nearest`, `cluster_boxes`: of `cluster_depths`, for all clusters; one whose box meets
    `FEW_TILES` or fewer is found as a whole, none where `cluster_boxes` is (0, 4).
    Writes to `into` the `found`, `boxes` and `keys` of a `Binned`, which have room for all
    triangles of the clusters. Returns how many were found. All bounds are outward.
    """
    found, boxes, keys = into
    count = 0
    z = np.empty(3)
    x = np.empty(3)
    y = np.empty(3)
    for index in range(len(clusters)):
        cluster = clusters[index]
        # Two roundings of normal numbers; 4 u is upward. What comes later is no nearer.
        left = -nearest[cluster]
        if view.perspective:
            left = (1.0 / max(nearest[cluster], view.near)) * (1.0 + 4.0 * U)
        if len(cluster_boxes) and cluster_boxes[cluster, X0] >= 0:
            x0, x1 = cluster_boxes[cluster, X0], cluster_boxes[cluster, X1]
            y0, y1 = cluster_boxes[cluster, Y0], cluster_boxes[cluster, Y1]
            across = (x1 >> TILE_SHIFT) - (x0 >> TILE_SHIFT) + 1
            if across * ((y1 >> TILE_SHIFT) - (y0 >> TILE_SHIFT) + 1) <= FEW_TILES:
                found[count] = -1 - cluster
                boxes[count, X0], boxes[count, X1] = x0, x1
                boxes[count, Y0], boxes[count, Y1] = y0, y1
                keys[count, GREATEST], keys[count, CHECK], keys[count, LEFT] = left, 0.0, left
                count += 1
                continue
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
            boxes[count, X0] = x0
            boxes[count, X1] = x1
            boxes[count, Y0] = y0
            boxes[count, Y1] = y1
            if view.perspective:
                # A hit has t >= near too. Two roundings of normal numbers; 4 u is upward.
                keys[count, GREATEST] = (1.0 / max(z_least, view.near)) * (1.0 + 4.0 * U)
            else:
                keys[count, GREATEST] = -z_least
            keys[count, CHECK] = 1.0 if check else 0.0
            keys[count, LEFT] = left
            count += 1
    return count


@njit(error_model="numpy")
def bin_boxes(
    boxes: NDArray[Any], tile_wanted: NDArray[Any], tile_columns: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """For each wanted tile the boxes that meet it, in order: `offsets` and `entries` of `Binned`.

    `boxes`: (f, 4) int32; `tile_wanted`: (tiles,) bool, row by row, `tile_columns` in a row.
    """
    tiles = len(tile_wanted)
    offsets = np.zeros(tiles + 1, np.int64)
    for k in range(len(boxes)):
        for row in range((boxes[k, Y0] >> TILE_SHIFT), (boxes[k, Y1] >> TILE_SHIFT) + 1):
            for column in range((boxes[k, X0] >> TILE_SHIFT), (boxes[k, X1] >> TILE_SHIFT) + 1):
                tile = row * tile_columns + column
                if tile_wanted[tile]:
                    offsets[tile + 1] += 1
    for tile in range(tiles):
        offsets[tile + 1] += offsets[tile]
    entries = np.empty(offsets[tiles], np.int32)
    place = offsets[:-1].copy()
    for k in range(len(boxes)):
        for row in range((boxes[k, Y0] >> TILE_SHIFT), (boxes[k, Y1] >> TILE_SHIFT) + 1):
            for column in range((boxes[k, X0] >> TILE_SHIFT), (boxes[k, X1] >> TILE_SHIFT) + 1):
                tile = row * tile_columns + column
                if tile_wanted[tile]:
                    entries[place[tile]] = k
                    place[tile] += 1
    return offsets, entries
