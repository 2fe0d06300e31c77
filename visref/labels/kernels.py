"""Silhouettes: which samples an object covers, whatever lies before it, in one pass over triangles.

The sample rule is the truth's own: the closed triangle in exact arithmetic. Each row of a triangle
is an interval, between the edges' half-lines: `visref.exact.filters` gives each edge as an affine
function with a proven bound, a computed affine function is monotonic in a as rounding is, and so
the samples that are covered for certain are an interval, and those that may be a wider one. Its
ends are found by a division and put right by walking, so that a row costs the same however long it
is. The few samples between the two intervals are handed to exact arithmetic.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.exact.filters import (
    BOUND_0,
    DOUBTFUL,
    EDGE_0,
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
from visref.exact.screen import X0, X1, Y0, Y1

# Samples of an object's box that are looked at together: what a core's cache holds.
BAND = 1 << 21
# Rows of what is found, at first.
_ROOM = 1 << 10


class Mesh(NamedTuple):
    """All triangles in cluster order: `corners` (t, 9) float32, `one_sided` (t,) bool, `ids` (t,)
    int32, each one's id in the scene."""

    corners: NDArray[np.float32]
    one_sided: NDArray[np.bool_]
    ids: NDArray[np.int32]


class Parts(NamedTuple):
    """What may cover samples, an object after another: `found` (f,) int32 places in the mesh,
    `boxes` (f, 4) int32 as of `visref.exact.screen`, `check` (f,) bool, whether near and far may
    cut; object i of those at hand has `offsets[i]:offsets[i + 1]`."""

    found: NDArray[np.int32]
    boxes: NDArray[np.int32]
    check: NDArray[np.bool_]
    offsets: NDArray[np.int64]


class Grid(NamedTuple):
    """A window's samples: `a` (width,) and `b` (height,) float64, and the filters' view of it."""

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    view: View


class Painted(NamedTuple):
    """What `paint` finds. `runs`: (r, 4) int64, place of the object, row, first and last column,
    ascending. Of each object, (k,) arrays: `samples` int64, how many it covers for certain; `boxes`
    (k, 4) int64, their first and last column and row; `best` (k, 2) int64, the sample (flat) where
    it is nearest, and the triangle, -1 for none. `open`: (d, 3) int64, place of the object, sample,
    triangle: what else it may cover."""

    runs: NDArray[np.int64]
    samples: NDArray[np.int64]
    boxes: NDArray[np.int64]
    best: NDArray[np.int64]
    open: NDArray[np.int64]


class Hits(NamedTuple):
    """Every sample that a triangle covers or may: (h,) arrays, `sample` int64 (flat), `triangle`
    int32 ids, `certain` bool, `low` and `high` float64, bounds of its key."""

    sample: NDArray[np.int64]
    triangle: NDArray[np.int32]
    certain: NDArray[np.bool_]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


@njit(error_model="numpy", inline="always")
def _bound_of(
    a: NDArray[Any], row: float, slope: float, limit: float, first: int, last: int
) -> tuple[int, int]:
    """The columns from `first` to `last` where row + a slope >= limit: (first, last) of them, maybe
    empty. `a` ascends."""
    if slope == 0.0:
        return (first, last) if row >= limit else (first, first - 1)
    guess = first + 0.5 * ((limit - row) / slope - a[first])
    # Also where the guess is not a number.
    x = first
    if guess > first:
        x = last if guess > last else int(guess)
    if slope > 0.0:
        while x > first and row + a[x - 1] * slope >= limit:
            x -= 1
        while x <= last and not row + a[x] * slope >= limit:
            x += 1
        return x, last
    while x < last and row + a[x + 1] * slope >= limit:
        x += 1
    while x >= first and not row + a[x] * slope >= limit:
        x -= 1
    return first, x


@njit(error_model="numpy")
def _row(
    a: NDArray[Any], w: NDArray[Any], b: float, first: int, last: int
) -> tuple[int, int, int, int]:
    """The columns of a row that a triangle, set up in `w`, covers for certain, and those that it
    may: (first, last) of either, maybe empty."""
    sure0, sure1, may0, may1 = first, last, first, last
    for i in range(3):
        at = EDGE_0 + 3 * i
        row, slope, bound = w[at] + b * w[at + 2], w[at + 1], w[BOUND_0 + i]
        if not (abs(row) < np.inf and abs(slope) < np.inf and bound < np.inf):
            # Nothing is known.
            sure1 = sure0 - 1
            continue
        x0, x1 = _bound_of(a, row, slope, -bound, first, last)
        may0, may1 = max(may0, x0), min(may1, x1)
        x0, x1 = _bound_of(a, row, slope, bound, first, last)
        sure0, sure1 = max(sure0, x0), min(sure1, x1)
    return sure0, sure1, may0, may1


@njit(error_model="numpy", inline="always")
def _in_range(view: View, w: NDArray[Any], a: float, b: float) -> int:
    """Whether a triangle's hit at a sample counts: -1 where it does not, 1 where it does, 0 where
    that is open."""
    q = (w[KEY_PLANE] + b * w[KEY_PLANE + 2]) + a * w[KEY_PLANE + 1]
    lower, upper = q - w[KEY_BOUND], q + w[KEY_BOUND]
    if lower > view.too_near or upper < view.too_far:
        return -1
    certain = upper <= view.near_enough and lower >= view.far_enough
    if view.clips:
        counts = clip_state(view.clip, lower, upper, a, b)
        if counts < 0:
            return -1
        certain = certain and counts > 0
    return 1 if certain else 0


@njit(error_model="numpy", inline="always")
def _may_cover(view: View, w: NDArray[Any], a: float, b: float) -> bool:
    """Whether a triangle of doubtful orientation may cover a sample: not where two edges certainly
    differ in sign, nor where it is certainly too near."""
    above, below = False, False
    for i in range(3):
        at = EDGE_0 + 3 * i
        e = (w[at] + b * w[at + 2]) + a * w[at + 1]
        above = above or e > w[BOUND_0 + i]
        below = below or e < -w[BOUND_0 + i]
    if above and below:
        return False
    if view.perspective:
        # t = |N| / |D|; 4 u for the roundings.
        least = abs((w[KEY_PLANE] + b * w[KEY_PLANE + 2]) + a * w[KEY_PLANE + 1]) - w[KEY_BOUND]
        if abs(w[SIGN]) + w[SIGN_BOUND] < view.near * least * (1.0 - 4.0 * U):
            return False
    return True


@njit(error_model="numpy")
def _grown(rows: NDArray[Any], count: int) -> NDArray[Any]:
    """The same rows, with room for one more after the first `count`."""
    if count < len(rows):
        return rows
    more = np.empty((2 * len(rows), rows.shape[1]), rows.dtype)
    more[:count] = rows[:count]
    return more


@njit(error_model="numpy")
def paint(mesh: Mesh, parts: Parts, grid: Grid, first: int, last: int, keep: bool) -> Painted:
    """The silhouettes of the objects at hand from `first` up to `last`; with `keep` their runs."""
    corners, one_sided, ids = mesh
    found, boxes, check, offsets = parts
    a, b, view = grid
    width = view.width
    runs = np.empty((_ROOM, 4), np.int64)
    open_ = np.empty((_ROOM, 3), np.int64)
    run_count, open_count = 0, 0
    samples = np.zeros(last - first, np.int64)
    where = np.empty((last - first, 4), np.int64)
    best = np.full((last - first, 2), -1, np.int64)
    bits = np.zeros(1, np.uint8)
    w = np.empty(SET_UP_SIZE)
    for o in range(first, last):
        start, stop = offsets[o], offsets[o + 1]
        left, right, top, bottom = width, -1, view.height, -1
        for k in range(start, stop):
            left, right = min(left, boxes[k, X0]), max(right, boxes[k, X1])
            top, bottom = min(top, boxes[k, Y0]), max(bottom, boxes[k, Y1])
        across = right - left + 1
        x_least, x_most, y_least, y_most = width, -1, view.height, -1
        nearest = -np.inf
        band_rows = max(1, BAND // max(1, across))
        for band in range(top, bottom + 1, band_rows):
            end = min(band + band_rows, bottom + 1)
            if across * (end - band) > len(bits):
                bits = np.zeros(across * (end - band), np.uint8)
            reach = np.empty((end - band, 2), np.int64)
            reach[:, 0], reach[:, 1] = right + 1, left - 1
            opened = open_count
            for k in range(start, stop):
                y0, y1 = max(boxes[k, Y0], band), min(boxes[k, Y1], end - 1)
                if y0 > y1:
                    continue
                t = found[k]
                state = set_up(corners[t], one_sided[t], view.perspective, view.lens, w)
                if state == NOTHING:
                    continue
                each = check[k] or view.clips
                for y in range(y0, y1 + 1):
                    at = (y - band) * across - left
                    if state == DOUBTFUL:
                        for x in range(boxes[k, X0], boxes[k, X1] + 1):
                            if bits[at + x] == 0 and _may_cover(view, w, a[x], b[y]):
                                open_ = _grown(open_, open_count)
                                open_[open_count, 0] = o
                                open_[open_count, 1] = y * width + x
                                open_[open_count, 2] = ids[t]
                                open_count += 1
                        continue
                    sure0, sure1, may0, may1 = _row(a, w, b[y], boxes[k, X0], boxes[k, X1])
                    if may0 > may1:
                        continue
                    if sure0 > sure1:
                        sure0, sure1 = may1 + 1, may1
                    if each:
                        for x in range(may0, may1 + 1):
                            state_here = _in_range(view, w, a[x], b[y])
                            if state_here < 0:
                                continue
                            if state_here > 0 and sure0 <= x <= sure1:
                                bits[at + x] = 1
                                row = y - band
                                reach[row, 0] = min(reach[row, 0], x)
                                reach[row, 1] = max(reach[row, 1], x)
                                q = w[KEY_PLANE] + b[y] * w[KEY_PLANE + 2]
                                q += a[x] * w[KEY_PLANE + 1]
                                if q > nearest:
                                    nearest = q
                                    best[o - first, 0] = y * width + x
                                    best[o - first, 1] = ids[t]
                            elif bits[at + x] == 0:
                                open_ = _grown(open_, open_count)
                                open_[open_count, 0] = o
                                open_[open_count, 1] = y * width + x
                                open_[open_count, 2] = ids[t]
                                open_count += 1
                        continue
                    if sure0 <= sure1:
                        bits[at + sure0 : at + sure1 + 1] = 1
                        row = y - band
                        reach[row, 0] = min(reach[row, 0], sure0)
                        reach[row, 1] = max(reach[row, 1], sure1)
                        # Over a row the key is least and greatest at the ends.
                        x = sure1 if w[KEY_PLANE + 1] > 0.0 else sure0
                        q = (w[KEY_PLANE] + b[y] * w[KEY_PLANE + 2]) + a[x] * w[KEY_PLANE + 1]
                        if q > nearest:
                            nearest = q
                            best[o - first, 0], best[o - first, 1] = y * width + x, ids[t]
                    for x in range(may0, may1 + 1):
                        if sure0 <= x <= sure1 or bits[at + x] != 0:
                            continue
                        open_ = _grown(open_, open_count)
                        open_[open_count, 0] = o
                        open_[open_count, 1] = y * width + x
                        open_[open_count, 2] = ids[t]
                        open_count += 1
            # What another triangle of the object covers for certain is open no more.
            kept = opened
            for i in range(opened, open_count):
                y, x = open_[i, 1] // width, open_[i, 1] % width
                if bits[(y - band) * across + x - left] == 0:
                    open_[kept, :] = open_[i, :]
                    kept += 1
            open_count = kept
            for y in range(band, end):
                x, x_end = reach[y - band, 0], reach[y - band, 1]
                if x > x_end:
                    continue
                y_least, y_most = min(y_least, y), max(y_most, y)
                x_least, x_most = min(x_least, x), max(x_most, x_end)
                at = (y - band) * across - left
                if not keep:
                    total = 0
                    for place in range(at + x, at + x_end + 1):
                        total += bits[place]
                    samples[o - first] += total
                    bits[at + x : at + x_end + 1] = 0
                    continue
                while x <= x_end:
                    if bits[at + x] == 0:
                        x += 1
                        continue
                    begin = x
                    while x <= x_end and bits[at + x] != 0:
                        bits[at + x] = 0
                        x += 1
                    samples[o - first] += x - begin
                    runs = _grown(runs, run_count)
                    runs[run_count, 0], runs[run_count, 1] = o, y
                    runs[run_count, 2], runs[run_count, 3] = begin, x - 1
                    run_count += 1
        where[o - first, 0], where[o - first, 1] = x_least, x_most
        where[o - first, 2], where[o - first, 3] = y_least, y_most
    return Painted(runs[:run_count].copy(), samples, where, best, open_[:open_count].copy())


@njit(error_model="numpy")
def collect(mesh: Mesh, parts: Parts, grid: Grid, object_: int) -> Hits:
    """Every hit of the triangles of one of the objects at hand, certain or not."""
    corners, one_sided, ids = mesh
    found, boxes, check, offsets = parts
    a, b, view = grid
    width = view.width
    where = np.empty((_ROOM, 3), np.int64)
    keys = np.empty((_ROOM, 2))
    count = 0
    w = np.empty(SET_UP_SIZE)
    for k in range(offsets[object_], offsets[object_ + 1]):
        t = found[k]
        state = set_up(corners[t], one_sided[t], view.perspective, view.lens, w)
        if state == NOTHING:
            continue
        each = check[k] or view.clips
        for y in range(boxes[k, Y0], boxes[k, Y1] + 1):
            sure0, sure1, may0, may1 = 0, -1, boxes[k, X0], boxes[k, X1]
            if state != DOUBTFUL:
                sure0, sure1, may0, may1 = _row(a, w, b[y], boxes[k, X0], boxes[k, X1])
            for x in range(may0, may1 + 1):
                low, high = -np.inf, np.inf
                certain = sure0 <= x <= sure1
                if state == DOUBTFUL:
                    if not _may_cover(view, w, a[x], b[y]):
                        continue
                else:
                    if each:
                        counts = _in_range(view, w, a[x], b[y])
                        if counts < 0:
                            continue
                        certain = certain and counts > 0
                    q = (w[KEY_PLANE] + b[y] * w[KEY_PLANE + 2]) + a[x] * w[KEY_PLANE + 1]
                    low, high = q - w[KEY_BOUND], q + w[KEY_BOUND]
                where, keys = _grown(where, count), _grown(keys, count)
                where[count, 0], where[count, 1] = y * width + x, ids[t]
                where[count, 2] = 1 if certain else 0
                keys[count, 0], keys[count, 1] = low, high
                count += 1
    return Hits(
        where[:count, 0].copy(),
        where[:count, 1].astype(np.int32),
        where[:count, 2] != 0,
        keys[:count, 0].copy(),
        keys[:count, 1].copy(),
    )
