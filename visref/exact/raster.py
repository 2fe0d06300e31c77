"""A tiled homogeneous rasteriser that never decides what it cannot prove.

After Olano and Greer, "Triangle Scan Conversion using 2D Homogeneous Coordinates" (1997), with
the hierarchical depth rejection of Greene, Kass and Miller (1993). Departures: nothing is
clipped or snapped, every comparison carries the bound of `visref.exact.filters`, and where a
bound cannot decide, the triangle goes on a list of contenders instead of being drawn or dropped.

`visref.exact.screen` sorts clusters, and triangles of those that are large on the screen, into
tiles, front to back; `rasterise` fills tiles. What comes out: per sample the certainly covering
triangle with the greatest lower bound of its key, and every other triangle that may still be as
near.

What is culled, and why nothing that owns a sample is. A tile keeps for each sample the greatest
lower bound of the keys of what certainly covers it (`LOW`), and for each block of samples the
least of those. No key of an entry exceeds its bound, so where that is below the least of every
block that its box meets, at each of its samples something is nearer. `LEFT` bounds the keys of all
entries to come: below the least of the whole tile, the tile is done. Within a block, a computed
affine function (c + b cb) + a ca is monotonic in a and in b, as rounding is: no sample's value
exceeds that at the best corner, so what is below the negative bound there is so everywhere.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.exact import lanes
from visref.exact.filters import (
    BOUND_0,
    BOUND_1,
    BOUND_2,
    EDGE_0,
    EDGE_1,
    EDGE_2,
    KEY_BOUND,
    KEY_PLANE,
    SIGN,
    SIGN_BOUND,
    U,
    View,
    clip_state,
)
from visref.exact.lanes import BOX, FUNCTION, LANE_ROWS, LANE_STRIDE, NEAREST, ORIENTED, RANGED
from visref.exact.screen import (
    BLOCK,
    BLOCK_SHIFT,
    CHECK,
    GREATEST,
    LEFT,
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

# So many neighbours are worth a vector loop.
RUN = 4

NOT_WANTED = -2

# What is known of a contender.
POSSIBLE, COVERING, NEARER = 0, 1, 2

# A tile's samples and blocks in one array of float64, so that loops over neighbours read and write
# at fixed distances and are made into vector instructions. Of each sample the bounds of its owner's
# key, the owner (a triangle's id is a float64 too), and its a; of each block the least LOW.
SAMPLES, BLOCKS = TILE * TILE, (TILE // BLOCK) ** 2
LOW, HIGH, OWN, COLUMN, LEAST = 0, SAMPLES, 2 * SAMPLES, 3 * SAMPLES, 4 * SAMPLES
BUFFER = LEAST + BLOCKS


class ClusteredTriangles(NamedTuple):
    """All triangles in cluster order: `corners` (t, 9) float32, `one_sided` (t,) bool, `ids` (t,)
    int32, each one's id in the scene; `usable` (t,) bool, which of them exist. `offsets`: (c + 1,)
    int64, where each cluster begins, and `bounds`: (c, 2, 3) float32, where it lies."""

    corners: NDArray[np.float32]
    one_sided: NDArray[np.bool_]
    ids: NDArray[np.int32]
    usable: NDArray[np.bool_]
    offsets: NDArray[np.int64]
    bounds: NDArray[np.float32]


class Owned(NamedTuple):
    """Who certainly owns each sample. `owner`: (height, width) int32 ids, -1 for none. `floor`,
    `ceiling`: (height, width) float64, bounds of that owner's key, -inf for none; or (0, 0), where
    nobody asks for them."""

    owner: NDArray[np.int32]
    floor: NDArray[np.float64]
    ceiling: NDArray[np.float64]


class Contenders(NamedTuple):
    """Triangles that may own samples: (k,) each, `sample` int64 flat, `triangle` int32 ids,
    `known` uint8, what is known of it, and `most` float64, the greatest key that it may have."""

    sample: NDArray[np.int64]
    triangle: NDArray[np.int32]
    known: NDArray[np.uint8]
    most: NDArray[np.float64]


def room_for(count: int) -> Contenders:
    """Arrays for so many."""
    return Contenders(
        np.empty(count, np.int64),
        np.empty(count, np.int32),
        np.empty(count, np.uint8),
        np.empty(count),
    )


@njit(error_model="numpy", inline="always")
def _greatest(w: NDArray[Any], at: int, a0: float, a1: float, b0: float, b1: float) -> float:
    """The greatest computed value of an affine function over a rectangle's corners."""
    ca, cb = w[at + LANE_STRIDE], w[at + 2 * LANE_STRIDE]
    b = b1 if cb > 0.0 else b0
    a = a1 if ca > 0.0 else a0
    value: float = (w[at] + b * cb) + a * ca
    return value


@njit(error_model="numpy")
def _block_least(z: NDArray[Any], start: int, before: float) -> float:
    """The least key in a block, which was `before` and can only have grown."""
    least = np.inf
    for y in range(BLOCK):
        for x in range(BLOCK):
            value = z[start + (y << TILE_SHIFT) + x]
            if value <= before:
                return before
            if value < least:
                least = value
    return least


@njit(error_model="numpy")
def _hidden(z: NDArray[Any], greatest: float, box: tuple[int, int, int, int]) -> bool:
    """Whether a key is below the least of every block that a box of pixels in the tile meets."""
    x0, x1, y0, y1 = box
    for j in range(y0 >> BLOCK_SHIFT, (y1 >> BLOCK_SHIFT) + 1):
        for i in range(x0 >> BLOCK_SHIFT, (x1 >> BLOCK_SHIFT) + 1):
            if not greatest < z[LEAST + (j << (TILE_SHIFT - BLOCK_SHIFT)) + i]:
                return False
    return True


@njit(error_model="numpy")
def _doubt(
    z: NDArray[Any],
    w: NDArray[Any],
    lane: int,
    t: int,
    width: int,
    perspective: bool,
    near: float,
    rays: tuple[NDArray[Any], NDArray[Any]],
    corner: tuple[int, int],
    out: Contenders,
    count: int,
) -> int:
    """Note a triangle of doubtful orientation at every sample that it is not certain to miss:
    where two edges certainly differ in sign it misses, and where it is certainly too near.

    `rays`: column_a and row_b. `corner`: the tile's first column and row. Returns how many
    contenders there are then.
    """
    column_a, row_b = rays
    left, top = corner
    at, s = FUNCTION * LANE_STRIDE + lane, LANE_STRIDE
    bound0, bound1, bound2 = w[at + BOUND_0 * s], w[at + BOUND_1 * s], w[at + BOUND_2 * s]
    for y in range(int(w[(BOX + Y0) * s + lane]), int(w[(BOX + Y1) * s + lane]) + 1):
        b = row_b[y]
        for x in range(int(w[(BOX + X0) * s + lane]), int(w[(BOX + X1) * s + lane]) + 1):
            if z[OWN + ((y - top) << TILE_SHIFT) + x - left] == NOT_WANTED:
                continue
            a = column_a[x]
            e0 = (w[at] + b * w[at + 2 * s]) + a * w[at + s]
            e1 = (w[at + 3 * s] + b * w[at + 5 * s]) + a * w[at + 4 * s]
            e2 = (w[at + 6 * s] + b * w[at + 8 * s]) + a * w[at + 7 * s]
            if (e0 > bound0 or e1 > bound1 or e2 > bound2) and (
                e0 < -bound0 or e1 < -bound1 or e2 < -bound2
            ):
                continue
            if perspective:
                # t = |N| / |D|; 4 u for the roundings.
                least = abs((w[at + 9 * s] + b * w[at + 11 * s]) + a * w[at + 10 * s])
                least -= w[at + KEY_BOUND * s]
                size = abs(w[at + SIGN * s]) + w[at + SIGN_BOUND * s]
                if size < near * least * (1.0 - 4.0 * U):
                    continue
            out.sample[count], out.triangle[count] = y * width + x, t
            out.known[count], out.most[count] = POSSIBLE, np.inf
            count += 1
    return count


@njit(error_model="numpy")
def _run(
    z: NDArray[Any],
    at: int,
    count: int,
    row: tuple[float, float, float, float],
    slope: tuple[float, float, float, float],
    bounds: tuple[float, float, float, float],
    t: int,
) -> tuple[bool, bool]:
    """Neighbouring samples of a row at once, if at each of them the triangle certainly covers and
    is nearer than all before, or certainly does not or is farther: (whether that is so, and then
    whether any was taken). Nothing is written otherwise.

    `at`: the first sample in the tile; `count`: how many. `row`, `slope`, `bounds`: of the key and
    the three edges, the values at the row where a = 0, what they grow by with a, and the bounds of
    their errors.
    """
    q0, e0, e1, e2 = row
    qa, ea0, ea1, ea2 = slope
    error, bound0, bound1, bound2 = bounds
    # Without sign, so that no index may count from the end; else no vector instructions come of it.
    # Nor do they where the compiler knows `count` and unrolls the loop.
    low, high, column = np.uint64(LOW + at), np.uint64(HIGH + at), np.uint64(COLUMN + at)
    owner = np.uint64(OWN + at)
    open_, taken = 0, 0
    for k in range(np.uint64(count)):
        a = z[column + k]
        q = q0 + a * qa
        v0, v1, v2 = e0 + a * ea0, e1 + a * ea1, e2 + a * ea2
        upper = q + error
        missed = (upper < z[low + k]) | (v0 < -bound0) | (v1 < -bound1) | (v2 < -bound2)
        clear = (v0 >= bound0) & (v1 >= bound1) & (v2 >= bound2)
        clear = clear & (q - error > z[high + k]) & (upper < np.inf)
        taken += 0 if missed else 1
        open_ += 0 if missed | clear else 1
    if open_:
        return False, False
    if not taken:
        return True, False
    own = float(t)
    # All that is not missed is clear: of that one comparison is left, and the edges.
    for k in range(np.uint64(count)):
        a = z[column + k]
        q = q0 + a * qa
        v0, v1, v2 = e0 + a * ea0, e1 + a * ea1, e2 + a * ea2
        take = (v0 >= bound0) & (v1 >= bound1) & (v2 >= bound2) & (q - error > z[high + k])
        z[low + k] = q - error if take else z[low + k]
        z[high + k] = q + error if take else z[high + k]
        z[owner + k] = own if take else z[owner + k]
    return True, True


@njit(error_model="numpy")
def _keep_near(
    z: NDArray[Any], out: Contenders, start: int, count: int, corner: tuple[int, int], width: int
) -> int:
    """Drop a tile's contenders, from `start` on, that something is certainly nearer than."""
    sample, triangle, known, most = out
    left, top = corner
    kept = start
    for index in range(start, count):
        y = sample[index] // width
        place = ((y - top) << TILE_SHIFT) + sample[index] - y * width - left
        if not most[index] < z[LOW + place]:
            sample[kept], triangle[kept] = sample[index], triangle[index]
            known[kept], most[kept] = known[index], most[index]
            kept += 1
    return kept


@njit(error_model="numpy")
def _draw(
    z: NDArray[Any],
    w: NDArray[Any],
    kept: int,
    which: NDArray[Any],
    triangles: tuple[NDArray[Any], NDArray[Any]],
    rays: tuple[NDArray[Any], NDArray[Any]],
    view: tuple[int, bool, float, bool, NDArray[Any], tuple[float, float, float, float]],
    corner: tuple[int, int],
    ceiling: NDArray[Any],
    collect: bool,
    out: Contenders,
    start: int,
    count: int,
) -> tuple[int, bool]:
    """Draw the first lanes' triangles into the tile, or collect them: how many contenders there
    are then, -1 if there is no room for them, and whether anything was drawn.

    `triangles`: one_sided and ids; `which`: their places. `view`: width, perspective, near, clips,
    clip and the four limits of the key, as `View` has them. `start`: the tile's first contender.
    """
    # Unpacked here: inside the loops numba would count references to every array of a tuple.
    column_a, row_b = rays
    one_sided, ids = triangles
    out_sample, out_triangle, out_known, out_most = out
    left, top = corner
    width, perspective, near, clips, clip, (too_near, near_enough, far_enough, too_far) = view
    s = LANE_STRIDE
    drawn = False
    for lane in range(kept):
        if count + SAMPLES > len(out_sample):
            # What is beaten by now makes room.
            count = _keep_near(z, out, start, count, corner, width)
            if count + SAMPLES > len(out_sample):
                return -1, drawn
        t = ids[which[lane]]
        if w[ORIENTED * s + lane] == 0.0:
            count = _doubt(z, w, lane, t, width, perspective, near, rays, corner, out, count)
            continue
        if one_sided[which[lane]] and w[(FUNCTION + SIGN) * s + lane] > 0.0:
            continue
        x0, x1 = int(w[(BOX + X0) * s + lane]), int(w[(BOX + X1) * s + lane])
        y0, y1 = int(w[(BOX + Y0) * s + lane]), int(w[(BOX + Y1) * s + lane])
        greatest = w[NEAREST * s + lane]
        check = w[RANGED * s + lane] != 0.0 or clips
        at = FUNCTION * s + lane
        c0, ca0, cb0 = w[at + EDGE_0 * s], w[at + (EDGE_0 + 1) * s], w[at + (EDGE_0 + 2) * s]
        c1, ca1, cb1 = w[at + EDGE_1 * s], w[at + (EDGE_1 + 1) * s], w[at + (EDGE_1 + 2) * s]
        c2, ca2, cb2 = w[at + EDGE_2 * s], w[at + (EDGE_2 + 1) * s], w[at + (EDGE_2 + 2) * s]
        q0, qa, qb = w[at + KEY_PLANE * s], w[at + (KEY_PLANE + 1) * s], w[at + (KEY_PLANE + 2) * s]
        bound0, bound1, bound2 = w[at + BOUND_0 * s], w[at + BOUND_1 * s], w[at + BOUND_2 * s]
        error = w[at + KEY_BOUND * s]
        for j in range((y0 - top) >> BLOCK_SHIFT, ((y1 - top) >> BLOCK_SHIFT) + 1):
            for i in range((x0 - left) >> BLOCK_SHIFT, ((x1 - left) >> BLOCK_SHIFT) + 1):
                least = z[LEAST + (j << (TILE_SHIFT - BLOCK_SHIFT)) + i]
                if greatest < least:
                    continue
                bx0 = max(x0, left + (i << BLOCK_SHIFT))
                bx1 = min(x1, left + (i << BLOCK_SHIFT) + BLOCK - 1)
                by0 = max(y0, top + (j << BLOCK_SHIFT))
                by1 = min(y1, top + (j << BLOCK_SHIFT) + BLOCK - 1)
                if (bx1 - bx0 + 1) * (by1 - by0 + 1) > CORNER_TESTS_PAY:
                    a0, a1 = column_a[bx0], column_a[bx1]
                    b0, b1 = row_b[by1], row_b[by0]
                    if (
                        _greatest(w, at + EDGE_0 * s, a0, a1, b0, b1) < -bound0
                        or _greatest(w, at + EDGE_1 * s, a0, a1, b0, b1) < -bound1
                        or _greatest(w, at + EDGE_2 * s, a0, a1, b0, b1) < -bound2
                        or _greatest(w, at + KEY_PLANE * s, a0, a1, b0, b1) + error < least
                    ):
                        continue
                at_once = bx1 - bx0 + 1 >= RUN and not check and not collect
                changed = False
                for y in range(by0, by1 + 1):
                    b = row_b[y]
                    row0, row1, row2 = c0 + b * cb0, c1 + b * cb1, c2 + b * cb2
                    row_q = q0 + b * qb
                    row = ((y - top) << TILE_SHIFT) - left
                    if at_once:
                        done, took = _run(
                            z,
                            row + bx0,
                            bx1 - bx0 + 1,
                            (row_q, row0, row1, row2),
                            (qa, ca0, ca1, ca2),
                            (error, bound0, bound1, bound2),
                            t,
                        )
                        changed = changed or took
                        if done:
                            continue
                    for x in range(bx0, bx1 + 1):
                        a = column_a[np.uint64(x)]
                        place = np.uint64(row + x)
                        high_place = np.uint64(row + x + HIGH)
                        # One branch, not four: which of these fails is anyone's guess.
                        q = row_q + a * qa
                        e0, e1, e2 = row0 + a * ca0, row1 + a * ca1, row2 + a * ca2
                        upper = q + error
                        if (upper < z[place]) | (e0 < -bound0) | (e1 < -bound1) | (e2 < -bound2):
                            continue
                        certain = (e0 >= bound0) & (e1 >= bound1) & (e2 >= bound2)
                        lower = q - error
                        if check:
                            if lower > too_near or upper < too_far:
                                continue
                            certain = certain and upper <= near_enough and lower >= far_enough
                            if clips:
                                counts = clip_state(clip, lower, upper, a, b)
                                if counts < 0:
                                    continue
                                certain = certain and counts > 0
                        own_place = np.uint64(row + x + OWN)
                        own = z[own_place]
                        if own == NOT_WANTED:
                            continue
                        if certain and not collect and lower > z[place]:
                            if z[high_place] >= lower:
                                out_sample[count], out_triangle[count] = y * width + x, int(own)
                                out_known[count], out_most[count] = COVERING, z[high_place]
                                count += 1
                            z[own_place], z[place], z[high_place] = float(t), lower, upper
                            changed = True
                            continue
                        known = COVERING if certain else POSSIBLE
                        if collect and certain and lower > ceiling[y, x]:
                            known = NEARER
                        out_sample[count], out_triangle[count] = y * width + x, t
                        out_known[count], out_most[count] = known, upper
                        count += 1
                if changed:
                    drawn = True
                    block = (j << (TILE_SHIFT + BLOCK_SHIFT)) + (i << BLOCK_SHIFT)
                    z[LEAST + (j << (TILE_SHIFT - BLOCK_SHIFT)) + i] = _block_least(z, block, least)
    return count, drawn


@njit(error_model="numpy")
def _gather(
    z: NDArray[Any],
    w: NDArray[Any],
    triangles: tuple[NDArray[Any], NDArray[Any]],
    range_: tuple[int, int],
    size: float,
    view: tuple[Any, ...],
    tile: tuple[int, int, int, int],
    which: NDArray[Any],
) -> int:
    """Load and project a cluster: how many of its triangles may be seen in the tile. They are in
    the first lanes then, and `which` has their places in cluster order.

    `triangles`: corners and usable. `range_`: the cluster's first place, and the end. `view`: as
    `visref.exact.lanes.project` has it. `tile`: first and last column and row.
    """
    corners, usable = triangles
    start, end = range_
    perspective, axes, image = view
    left, right, top, bottom = tile
    lanes.load(corners, start, end - start, w)
    on_screen = float(left), float(right), float(top), float(bottom)
    lanes.project(w, end - start, size, perspective, axes, image, on_screen)
    kept = 0
    for i in range(end - start):
        x0, x1 = w[(BOX + X0) * LANE_STRIDE + i], w[(BOX + X1) * LANE_STRIDE + i]
        y0, y1 = w[(BOX + Y0) * LANE_STRIDE + i], w[(BOX + Y1) * LANE_STRIDE + i]
        if x0 > x1 or y0 > y1 or not usable[start + i]:
            continue
        box = int(x0) - left, int(x1) - left, int(y0) - top, int(y1) - top
        if _hidden(z, w[NEAREST * LANE_STRIDE + i], box):
            continue
        if kept != i:
            lanes.move(w, i, kept)
        which[kept] = start + i
        kept += 1
    return kept


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
    out: Contenders,
) -> tuple[int, int]:
    """Fill some tiles: `owned` is written.

    `tiles`: (n,) int64. `rays`: column_a and row_b. With `collect` the bounds of `owned` are read
    instead, nothing is drawn, and every triangle that may reach the floor is a contender. `wanted`:
    (height, width) bool, or (0, 0) for all samples. `out` gets the contenders; what is KNOWN is
    POSSIBLE, COVERING or, only with `collect`, NEARER: covering and above the ceiling.
    Returns how many tiles are done, which is all unless `out` was too small, and how many
    contenders those have.
    """
    # Unpacked here: inside the loops numba would count references to every array of a tuple.
    column_a, row_b = rays
    corners, one_sided, ids, usable, offsets, bounds = triangles
    found, boxes, keys, bin_offsets, bin_entries, tile_columns = binned
    owner, floor, ceiling = owned
    width, height, perspective, lens = view.width, view.height, view.perspective, view.lens
    e = view.e[0], view.e[1], view.e[2]
    axes = (
        e,
        (view.x_dual[0], view.x_dual[1], view.x_dual[2]),
        (view.y_dual[0], view.y_dual[1], view.y_dual[2]),
        (view.z_dual[0], view.z_dual[1], view.z_dual[2]),
        (view.x_norm, view.y_norm, view.z_norm),
    )
    middle = 0.5 * (width - 1) - view.shift_x_px, 0.5 * (height - 1) - view.shift_y_px
    projection = perspective, axes, (middle[0], middle[1], view.near, view.far)
    keys_of_range = view.too_near, view.near_enough, view.far_enough, view.too_far
    limits = width, perspective, view.near, view.clips, view.clip, keys_of_range
    z = np.zeros(BUFFER)
    w = np.zeros(LANE_ROWS * LANE_STRIDE)
    which = np.zeros(LANE_STRIDE, np.int64)
    # Of a type, not a literal: for that numba would compile all it is given to a second time.
    count = np.int64(0)
    for number in range(len(tiles)):
        tile = tiles[number]
        left, top = (tile % tile_columns) * TILE, (tile // tile_columns) * TILE
        right, bottom = min(left + TILE, width), min(top + TILE, height)
        tile_start = count
        z[LOW:HIGH], z[HIGH:OWN], z[OWN:COLUMN], z[LEAST:BUFFER] = (
            np.inf,
            np.inf,
            NOT_WANTED,
            np.inf,
        )
        for y in range(top, bottom):
            for x in range(left, right):
                z[COLUMN + ((y - top) << TILE_SHIFT) + x - left] = column_a[x]
        for y in range(top, bottom):
            for x in range(left, right):
                if wanted.size == 0 or wanted[y, x]:
                    place = ((y - top) << TILE_SHIFT) + x - left
                    z[LOW + place] = floor[y, x] if collect else -np.inf
                    z[HIGH + place] = -np.inf
                    z[OWN + place] = -1
                    block = ((y - top) >> BLOCK_SHIFT) << (TILE_SHIFT - BLOCK_SHIFT)
                    block += (x - left) >> BLOCK_SHIFT
                    z[LEAST + block] = min(z[LEAST + block], z[LOW + place])
        whole = z[LEAST:BUFFER].min()
        for entry in range(bin_offsets[tile], bin_offsets[tile + 1]):
            k = bin_entries[entry]
            if keys[k, LEFT] < whole:
                break
            x0, x1 = max(boxes[k, X0], left), min(boxes[k, X1], right - 1)
            y0, y1 = max(boxes[k, Y0], top), min(boxes[k, Y1], bottom - 1)
            if _hidden(z, keys[k, GREATEST], (x0 - left, x1 - left, y0 - top, y1 - top)):
                continue
            if found[k] < 0:
                c = -1 - found[k]
                size = 0.0
                for axis in range(3):
                    for side in range(2):
                        size = max(size, abs(np.float64(bounds[c, side, axis]) - e[axis]))
                kept = _gather(
                    z,
                    w,
                    (corners, usable),
                    (offsets[c], offsets[c + 1]),
                    size,
                    projection,
                    (left, right - 1, top, bottom - 1),
                    which,
                )
            else:
                lanes.load(corners, found[k], 1, w)
                which[0], kept = found[k], 1
                w[(BOX + X0) * LANE_STRIDE], w[(BOX + X1) * LANE_STRIDE] = x0, x1
                w[(BOX + Y0) * LANE_STRIDE], w[(BOX + Y1) * LANE_STRIDE] = y0, y1
                w[NEAREST * LANE_STRIDE] = keys[k, GREATEST]
                w[RANGED * LANE_STRIDE] = keys[k, CHECK]
            if not kept:
                continue
            lanes.set_up_lanes(w, kept, perspective, lens)
            count, drawn = _draw(
                z,
                w,
                kept,
                which,
                (one_sided, ids),
                (column_a, row_b),
                limits,
                (left, top),
                ceiling,
                collect,
                out,
                tile_start,
                count,
            )
            if count < 0:
                return number, int(tile_start)
            if drawn:
                whole = z[LEAST]
                for block in range(1, BLOCKS):
                    whole = min(whole, z[LEAST + block])
        count = _keep_near(z, out, tile_start, count, (left, top), width)
        if not collect:
            for y in range(top, bottom):
                for x in range(left, right):
                    place = ((y - top) << TILE_SHIFT) + x - left
                    owner[y, x] = max(int(z[OWN + place]), -1)
                    if floor.size:
                        floor[y, x] = z[LOW + place]
                        unwanted = z[OWN + place] == NOT_WANTED
                        ceiling[y, x] = -np.inf if unwanted else z[HIGH + place]
    return len(tiles), int(count)
