"""A masked texture in a box of texture coordinates: solid, a hole, or in between.

The box is a pixel's footprint, doubled: the image, in texture coordinates, of a square two
pixels wide around the sample. Engines filter and choose levels differently, and any alpha
that is a weighted mean of texels under the box lies between the least and the greatest of
them. Which texels are those? In texel coordinates (u times the width), texel i is the closed
interval [i, i + 1].

- A bilinear lookup at x reads the texels whose centres lie less than one texel from x: those
  that reach into (x - 1/2, x + 1/2). So a filtering sampler widens the box by half a texel on
  each side, and with it stands for each bilinear lookup in the full image at each point of the
  doubled footprint, and for every mean of such lookups: supersampling, multisampling at any
  place in the pixel, anisotropic filtering.
- A texel of mip level k is a mean of a block of texels, so a lookup in a mip level stays
  between the bounds where the blocks that it reads lie in the widened box. The usual choice,
  the level whose texels are as long as the longer side of the pixel's footprint, does not
  promise that: its outer tap may lie half outside the doubled footprint, and that of the next
  coarser level, which a trilinear lookup mixes in, more. Where the footprint is about square,
  or the filter anisotropic, at most 26 % of a trilinear lookup's weight lies outside (the
  maximum over places and levels, two axes). A box of nothing but ones, or nothing but zeros,
  as boxes off the edges of a cut-out are, is then still right for cutoffs from 0.26 to 0.74.
  It need not be for a coarser choice: the nearest of two levels instead of a mixture (50 %),
  or an isotropic filter on a surface seen at a grazing angle. Widening the box for these to
  three times the doubled footprint would leave about twice as many samples in between.
- A sampler that does not interpolate reads the texel at the point: no widening. Where it takes
  the full image and the pixel's own footprint is under a texel, the one texel at the hit is
  the answer; both, where rounding does not say on which side of a border the hit lies.

Everything rounds outward: a texel too many can only make an answer "in between". Alphas are
compared in float64, texel / scale * factor * vertex alpha, in this order.

The box is looked up in the finest level of the pyramid in which it has at most FINEST_ENTRIES
entries; level 0, hence exactly the texels above, for boxes that small. Blocks of that level
that the box touches count whole. A coarser level comes first: where it decides, it is right,
as its blocks hold all texels that the finer ones hold.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.masks.store import CLAMP, MIRROR, REPEAT, MaskArrays, Masks
from visref.masks.store import words_of_row as _words_of_row

HOLE, SOLID, BETWEEN = 0, 1, 2
# In place of these: what a short way leaves to the long one.
UNSURE = -1

# How many entries of the pyramid a lookup visits, at most, at its two levels. Measured on a
# 256 x 256 texture of leaves, pixels of 6 texels: in between are 54 % of random places with 16
# at the finest, 48 % with 64, 45 % with 256, and 43 % with no bound, with which a lookup on a far,
# slanted card takes 24 times as long as with 256.
FINEST_ENTRIES = 256
FIRST_ENTRIES = 16

# How many squares of `MaskArrays.bits` are looked at before levels are.
MOST_SQUARES = 64

# Rounding of (u ± (half + error)) * size ± reach, as a multiple of (|u| + half + error) * size
# + 1: two sums, a product and two sums make at most 5 u, u = 2^-53. 8 u also holds the rounding
# of the bound itself and the second-order terms.
BOX_ROUNDING = 8.0 * 2.0**-53
# From here on float64 texel coordinates are whole numbers at best: any texel may be meant.
FAR_TEXEL = 2.0**52


@njit(error_model="numpy", makes_arrays=False)
def texel_intervals(
    centre: float, half: float, error: float, size: int, wrap: int, reach: float
) -> Any:
    """Texels that [centre - half, centre + half], `error` wide of that, touches along an axis.

    Returns (a0, a1, b0, b1), two closed intervals of texel indices in 0…size - 1; the second is
    empty, b1 < b0, unless the box runs over a repeated texture's edge. `reach` in texels.
    """
    spread = half + error
    slack = BOX_ROUNDING * ((abs(centre) + spread) * size + 1.0)
    low = np.floor((centre - spread) * size - reach - slack)
    high = np.floor((centre + spread) * size + reach + slack)
    return wrapped(low, high, size, wrap)


@njit(error_model="numpy", makes_arrays=False)
def wrapped(low: float, high: float, size: int, wrap: int) -> Any:
    """The texels of `texel_intervals` that stand at the places from `low` to `high`, whole numbers
    (or what is no number) of the row of texels that goes on forever."""
    if wrap == CLAMP:
        first = np.int64(min(max(low, 0.0), size - 1.0))
        last = np.int64(min(max(high, 0.0), size - 1.0))
        return first, last, np.int64(0), np.int64(-1)
    if low >= 0.0 and high < size:
        return np.int64(low), np.int64(high), np.int64(0), np.int64(-1)
    period = 2 * size if wrap == MIRROR else size
    if not (low > -FAR_TEXEL and high < FAR_TEXEL and high - low + 1.0 < period):
        return np.int64(0), np.int64(size - 1), np.int64(0), np.int64(-1)
    first = np.int64(low) % period
    last = first + np.int64(high - low)
    if wrap == REPEAT:
        if last < size:
            return first, last, np.int64(0), np.int64(-1)
        return first, np.int64(size - 1), np.int64(0), last - size
    # Mirrored: 0…n-1, n-1…0, 0…n-1, n-1…0, so the image of an interval is an interval. It holds
    # texel n - 1 if it holds a place where that stands, and texel 0 likewise.
    from_first = first if first < size else period - 1 - first
    turned = last % period
    from_last = turned if turned < size else period - 1 - turned
    least, greatest = min(from_first, from_last), max(from_first, from_last)
    if (first <= size - 1 and last >= size - 1) or last >= 3 * size - 1:
        greatest = np.int64(size - 1)
    if first <= 2 * size - 1 and last >= 2 * size - 1:
        least = np.int64(0)
    return least, greatest, np.int64(0), np.int64(-1)


@njit(error_model="numpy", makes_arrays=False)
def touched(
    m: MaskArrays, material: int, u: float, v: float, du: float, dv: float, eu: float, ev: float
) -> Any:
    """Intervals of columns and of rows, see `texel_intervals`, that a lookup takes into account."""
    of = m.materials[material]
    image = m.textures[of.texture]
    width, height = image.width, image.height
    reach = 0.5
    if of.nearest:
        reach = 0.0
        # Half of the doubled footprint is all of the pixel's own.
        if du * width < 1.0 and dv * height < 1.0:
            du = dv = 0.0
    columns = texel_intervals(u, du, eu, width, of.wrap_s, reach)
    rows = texel_intervals(v, dv, ev, height, of.wrap_t, reach)
    return columns, rows


@njit(inline="always")
def _blocks(spans, k):  # type: ignore[no-untyped-def]
    """How many blocks of level k two intervals of texels touch."""
    a0, a1, b0, b1 = spans
    count = (a1 >> k) - (a0 >> k) + 1
    if b1 >= b0:
        count += (b1 >> k) - (b0 >> k) + 1
    return count


words_of_row = njit(inline="always")(_words_of_row)


@njit(inline="always")
def _across(first, last, square):  # type: ignore[no-untyped-def]
    """Of a word of `MaskArrays.bits` the bits of columns `first` to `last`; `square` is the word's
    column. Of these, some are there."""
    low = np.uint64(max(first - 8 * square, 0))
    high = np.uint64(7 - min(last - 8 * square, 7))
    byte = (np.uint64(0xFF) << low) & (np.uint64(0xFF) >> high)
    return byte * np.uint64(0x0101010101010101)


@njit(inline="always")
def _down(first, last, square):  # type: ignore[no-untyped-def]
    """As `_across`, of rows."""
    low = np.uint64(8 * max(first - 8 * square, 0))
    high = np.uint64(8 * (7 - min(last - 8 * square, 7)))
    return (~np.uint64(0) << low) & (~np.uint64(0) >> high)


@njit(inline="always")
def kinds_in_four_squares(bits, start, stride, across, down):  # type: ignore[no-untyped-def]
    """Of texels that are in no more than two squares of `MaskArrays.bits` each way, first and last
    across and down: two words, of which one is not zero where some texel is solid, and the other
    where some is a hole. Without a branch. `start` and `stride` are the material's first word and
    `words_of_row`."""
    (x0, x1), (y0, y1) = across, down
    column0, column1, row0, row1 = x0 >> 3, x1 >> 3, y0 >> 3, y1 >> 3
    left, right = _across(x0, x1, column0), _across(x0, x1, column1)
    above, below = _down(y0, y1, row0), _down(y0, y1, row1)
    upper, lower = start + row0 * stride, start + row1 * stride
    # Indices without a sign: none counts from the end.
    a, b = bits[np.uint64(upper + column0)], bits[np.uint64(upper + column1)]
    c, d = bits[np.uint64(lower + column0)], bits[np.uint64(lower + column1)]
    solids = (((a & left) | (b & right)) & above) | (((c & left) | (d & right)) & below)
    holes = (((~a & left) | (~b & right)) & above) | (((~c & left) | (~d & right)) & below)
    return solids, holes


@njit(makes_arrays=False)
def level_for(columns: Any, rows: Any, entries: int) -> int:
    """The finest level in which the texels take at most so many entries."""
    k = 0
    while _blocks(columns, k) * _blocks(rows, k) > entries:
        k += 1
    return k


@njit(inline="always")
def _whole_blocks(first, last, size, k):  # type: ignore[no-untyped-def]
    """From which texel to which the blocks of level k reach that these texels touch."""
    return (first >> k) << k, min((((last >> k) + 1) << k) - 1, size - 1)


@njit(error_model="numpy", makes_arrays=False)
def state_of_bits(bits: NDArray[Any], start: int, size: Any, columns: Any, rows: Any) -> int:
    """SOLID, HOLE or BETWEEN where a lookup under a vertex alpha of one takes these texels, by a
    material's `MaskArrays.bits`, which begin at `start`; `UNSURE` where that takes too many words.
    `size`: the texture's, (2,) integers."""
    # Of the level that decides, all texels of the blocks count.
    k = level_for(columns, rows, FINEST_ENTRIES)
    stride = words_of_row(size[0])
    seen = 0
    holes, solids = np.uint64(0), np.uint64(0)
    for part in range(4):
        x0, x1 = (columns[2], columns[3]) if part & 1 else (columns[0], columns[1])
        y0, y1 = (rows[2], rows[3]) if part & 2 else (rows[0], rows[1])
        if x1 < x0 or y1 < y0:
            continue
        x0, x1 = _whole_blocks(x0, x1, size[0], k)
        y0, y1 = _whole_blocks(y0, y1, size[1], k)
        first, count = y0 >> 3, (y1 >> 3) - (y0 >> 3) + 1
        for i in range(count):
            # From the middle on: a picture's margins are often of one kind.
            row = first + i + (count >> 1)
            row -= count if row >= first + count else 0
            down = _down(y0, y1, row)
            for column in range(x0 >> 3, (x1 >> 3) + 1):
                mask = down & _across(x0, x1, column)
                word = bits[start + row * stride + column]
                solids |= word & mask
                holes |= ~word & mask
                if holes and solids:
                    return BETWEEN
                seen += 1
                if seen > MOST_SQUARES:
                    return UNSURE
    return HOLE if holes else SOLID


@njit(inline="always")
def extremes(m, texture, columns, rows, k):  # type: ignore[no-untyped-def]
    """Least and greatest alpha, as stored, of the blocks of level k that the texels touch."""
    image = m.textures[texture]
    level = m.levels[image.level + min(k, image.levels - 1)]
    least, greatest = np.int64(65535), np.int64(0)
    for part in range(4):
        x0, x1 = (columns[2], columns[3]) if part & 1 else (columns[0], columns[1])
        y0, y1 = (rows[2], rows[3]) if part & 2 else (rows[0], rows[1])
        if x1 < x0:
            continue
        for y in range(y0 >> k, (y1 >> k) + 1):
            start = y * level.width + (x0 >> k)
            # Indices without a sign: none counts from the end, and a row is one stretch.
            low, high = np.uint64(level.least + start), np.uint64(level.greatest + start)
            for i in range(np.uint64((x1 >> k) - (x0 >> k) + 1)):
                least = min(least, np.int64(m.alpha[low + i]))
                greatest = max(greatest, np.int64(m.alpha[high + i]))
    return least, greatest


@njit(error_model="numpy", makes_arrays=False)
def _decide(
    least: float, greatest: float, factor: float, low: float, high: float, cutoff: float
) -> int:
    """Of texture alphas least…greatest and vertex alphas low…high. NaN decides nothing."""
    # A vertex alpha below zero, which no file should have, turns the order round.
    if (least if low >= 0.0 else greatest) * factor * low >= cutoff:
        return SOLID
    if (greatest if high >= 0.0 else least) * factor * high < cutoff:
        return HOLE
    return BETWEEN


@njit(error_model="numpy", makes_arrays=False)
def _state_at_level(
    m: MaskArrays, material: int, columns: Any, rows: Any, k: int, low: float, high: float
) -> int:
    """`state_of_texels`, by the least and the greatest alpha of blocks of level k."""
    of = m.materials[material]
    scale = np.float64(m.textures[of.texture].scale)
    least, greatest, state = 65536, -1, BETWEEN
    for part in range(2):
        y0, y1 = (rows[2], rows[3]) if part else (rows[0], rows[1])
        for y in range(y0 >> k, (y1 >> k) + 1):
            row = (y << k, y << k, 0, -1)
            lesser, greater = extremes(m, of.texture, columns, row, k)
            if lesser >= least and greater <= greatest:
                continue
            least, greatest = min(least, lesser), max(greatest, greater)
            state = _decide(least / scale, greatest / scale, of.factor, low, high, of.cutoff)
            if state == BETWEEN:
                # More texels leave it so.
                return BETWEEN
    return state


@njit(inline="always")
def state_of_texels(m, material, columns, rows, low, high):  # type: ignore[no-untyped-def]
    """SOLID, HOLE or BETWEEN where a lookup under vertex alphas low…high takes these texels."""
    first = level_for(columns, rows, FIRST_ENTRIES)
    state = _state_at_level(m, material, columns, rows, first, low, high)
    if state != BETWEEN or first == 0:
        return state
    finest = level_for(columns, rows, FINEST_ENTRIES)
    if finest == first:
        return state
    return _state_at_level(m, material, columns, rows, finest, low, high)


@njit(inline="always")
def state_of_places(m, material, columns, rows):  # type: ignore[no-untyped-def]
    """`state_of_texels` under a vertex alpha of one, by bits where these serve."""
    texture = m.textures[m.materials[material].texture]
    size = texture.width, texture.height
    state = state_of_bits(m.bits, m.bits_of_material[material], size, columns, rows)
    return state_of_texels(m, material, columns, rows, 1.0, 1.0) if state == UNSURE else state


@njit(error_model="numpy", makes_arrays=False)
def mask_state(
    m: MaskArrays,
    row: int,
    u: float,
    v: float,
    du: float,
    dv: float,
    eu: float,
    ev: float,
    vertex_alpha_low: float,
    vertex_alpha_high: float,
) -> Any:
    """SOLID, HOLE or BETWEEN for masked triangle `row`, looked up at (u, v).

    `du`, `dv`: half the doubled footprint's extent, so all of the extent of the pixel's own;
    infinite ones take the whole texture. `eu`, `ev`: bounds of the rounding error of u and v.
    A lookup that cannot be done, or that is not at a number, takes texture alphas from 0 to 1.
    """
    material = m.triangles[row].material
    of = m.materials[material]
    factor, cutoff = of.factor, of.cutoff
    if cutoff <= 0.0:
        return SOLID
    low, high = vertex_alpha_low, vertex_alpha_high
    if of.unknown:
        return _decide(0.0, 1.0, factor, low, high, cutoff)
    texture = of.texture
    if texture < 0:
        return _decide(1.0, 1.0, factor, low, high, cutoff)
    # A box without a number in it: a sum with NaN, or of infinities, is NaN or infinite.
    if not (np.isfinite(u + v) and du + dv >= 0.0 and eu + ev >= 0.0):
        return _decide(0.0, 1.0, factor, low, high, cutoff)
    columns, rows = touched(m, material, u, v, du, dv, eu, ev)
    return state_of_texels(m, material, columns, rows, low, high)


@njit(makes_arrays=False)
def _mask_states(
    m: MaskArrays, row: Any, box: Any, low: Any, high: Any, result: NDArray[Any]
) -> None:
    for i in range(len(row)):
        result[i] = mask_state(
            m,
            row[i],
            box[i, 0],
            box[i, 1],
            box[i, 2],
            box[i, 3],
            box[i, 4],
            box[i, 5],
            low[i],
            high[i],
        )


def mask_states(
    masks: Masks,
    row: NDArray[Any],
    box: NDArray[Any],
    vertex_alpha_low: NDArray[Any],
    vertex_alpha_high: NDArray[Any],
) -> NDArray[np.uint8]:
    """(n,) uint8, `mask_state` of n lookups: rows (n,), boxes (n, 6) of u, v, du, dv, eu and
    ev, vertex alphas (n,)."""
    result = np.empty(len(row), np.uint8)
    _mask_states(
        masks.arrays,
        np.ascontiguousarray(row, np.int64),
        np.ascontiguousarray(box, np.float64).reshape(-1, 6),
        np.ascontiguousarray(vertex_alpha_low, np.float64),
        np.ascontiguousarray(vertex_alpha_high, np.float64),
        result,
    )
    return result
