"""Compiled loops over a block of samples: masked triangles tested in float64, many samples at once.

A block knows beyond which depth none of its samples shows anything: what lies behind is left out
whole. Loops over its samples hold no branches, so that a compiler makes vectors of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines.ray_kernels import SampleGrid, depth_interval, facet_of, plane
from visref.engines.splat_kernels import at_sample
from visref.masks.by_edges import state_by_places, touched_by_edges
from visref.masks.lookup import (
    BETWEEN,
    HOLE,
    SOLID,
    UNSURE,
    kinds_in_four_squares,
    state_of_bits,
    wrapped,
)
from visref.visibility import BACKGROUND

BLOCK_WIDTH, BLOCK_HEIGHT = 8, 4
BLOCK = BLOCK_WIDTH * BLOCK_HEIGHT
# Farther than any place of a texel.
FAR = 1 << 40


class Blocks(NamedTuple):
    """The samples of some whole rows of an image, by blocks, row by row.

    `a`: (c, BLOCK), by column of blocks, and `b`: (r, BLOCK), by row of them, of each sample;
    beyond the image they go on. `begun`: by block, whether anything stands in what follows; `open`,
    whether a mask leaves any of its samples open. `farthest`: of a block's limits the greatest.

    By block and sample: `limit`, beyond what depth nothing is seen, -inf beyond the image; `depth`
    and `solid`, the nearest solid hit of a masked triangle before the owner, else the owner's depth
    and `BACKGROUND`; `last`, the last of the sample's FOUND, negative for none.

    The rest is for the block at hand, by sample: `owners`; `z` and `error`, a triangle's depths
    there, and whether it is `kept`; in `order`, those that are; in `places`, and whether `certain`,
    which texels a lookup touches.
    """

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    top: int
    begun: NDArray[np.bool_]
    open: NDArray[np.bool_]
    farthest: NDArray[np.float64]
    limit: NDArray[np.float64]
    depth: NDArray[np.float64]
    solid: NDArray[np.int32]
    owners: NDArray[np.int32]
    z: NDArray[np.float64]
    error: NDArray[np.float64]
    kept: NDArray[np.uint8]
    order: NDArray[np.int64]
    places: NDArray[np.float64]
    certain: NDArray[np.uint8]
    last: NDArray[np.int32]

    @classmethod
    def of(cls, grid: SampleGrid, rows: int) -> Blocks:
        """For so many rows of an image, which `at` places."""
        across, down = -(-len(grid.column_a) // BLOCK_WIDTH), -(-rows // BLOCK_HEIGHT)
        count = across * down
        blocks = cls(
            np.empty((across, BLOCK)),
            np.empty((down, BLOCK)),
            0,
            np.empty(count, np.bool_),
            np.empty(count, np.bool_),
            np.empty(count),
            np.empty((count, BLOCK)),
            np.empty((count, BLOCK)),
            np.empty((count, BLOCK), np.int32),
            np.empty(BLOCK, np.int32),
            np.empty(BLOCK),
            np.empty(BLOCK),
            np.empty(BLOCK, np.uint8),
            np.empty(BLOCK, np.int64),
            np.empty((4, BLOCK)),
            np.empty(BLOCK, np.uint8),
            np.empty((count, BLOCK), np.int32),
        )
        return blocks.seeing(grid)

    def seeing(self, grid: SampleGrid) -> Blocks:
        """The same arrays for the columns of a grid that is as wide."""
        columns = grid.column_a[0] + 2.0 * np.arange(len(self.a) * BLOCK_WIDTH)
        columns[: len(grid.column_a)] = grid.column_a
        self.a.reshape(-1, BLOCK_HEIGHT, BLOCK_WIDTH)[:] = columns.reshape(-1, 1, BLOCK_WIDTH)
        return self

    def at(self, grid: SampleGrid, top: int, bottom: int) -> Blocks:
        """The same arrays for the rows from `top` to `bottom`, with nothing in them."""
        rows = grid.row_b[top] - 2.0 * np.arange(len(self.b) * BLOCK_HEIGHT)
        rows[: bottom - top] = grid.row_b[top:bottom]
        self.b[:] = np.repeat(rows.reshape(-1, BLOCK_HEIGHT), BLOCK_WIDTH, axis=1)
        self.begun.fill(False)
        self.open.fill(False)
        self.farthest.fill(np.inf)
        return self._replace(top=top)


# A hit of a masked triangle that is BETWEEN: `bound` is that of the depth's error, `next` the
# sample's next, in the order in which they were met; after its last (`Blocks.last`) its first.
FOUND = np.dtype([("depth", "f8"), ("bound", "f8"), ("triangle", "i4"), ("next", "i4")])


@njit(inline="always")
def _see_owner(blocks, block, row, column, mesh, grid, t):  # type: ignore[no-untyped-def]
    """Let a block know the depths of one of its owners."""
    facet = facet_of(mesh, grid, t)
    for k in range(BLOCK):
        here = blocks.owners[k] == t
        behind, slack = depth_interval(facet, grid, blocks.a[column, k], blocks.b[row, k])
        # What is no number hides nothing.
        reached = behind + slack
        limited = here & (reached < np.inf)
        blocks.depth[block, k] = behind if here else blocks.depth[block, k]
        blocks.limit[block, k] = reached if limited else blocks.limit[block, k]


@njit(inline="always")
def begin_block(blocks, block, row, column, mesh, grid, owner):  # type: ignore[no-untyped-def]
    """Let a block know its owners' depths."""
    width, height = len(grid.column_a), len(grid.row_b)
    left, top = column * BLOCK_WIDTH, blocks.top + row * BLOCK_HEIGHT
    for y in range(BLOCK_HEIGHT):
        for x in range(BLOCK_WIDTH):
            k = y * BLOCK_WIDTH + x
            there = left + x < width and top + y < height
            t = owner[(top + y) * width + left + x] if there else BACKGROUND
            blocks.owners[k] = t
            blocks.limit[block, k] = np.inf if there else -np.inf
            blocks.depth[block, k] = np.inf
            blocks.solid[block, k] = blocks.last[block, k] = BACKGROUND
    # Most blocks have one owner or two: these for all samples at once.
    first, last = blocks.owners[0], blocks.owners[BLOCK - 1]
    if first >= 0:
        _see_owner(blocks, block, row, column, mesh, grid, first)
    if last >= 0 and last != first:
        _see_owner(blocks, block, row, column, mesh, grid, last)
    known, facet = -1, facet_of(mesh, grid, 0)
    for k in range(BLOCK):
        t = blocks.owners[k]
        if t < 0 or t in (first, last):
            continue
        if t != known:
            known, facet = t, facet_of(mesh, grid, t)
        behind, slack = depth_interval(facet, grid, blocks.a[column, k], blocks.b[row, k])
        blocks.depth[block, k] = behind
        if behind + slack < np.inf:
            blocks.limit[block, k] = behind + slack
    blocks.begun[block] = True
    _see_farthest(blocks, block)


@njit(inline="always")
def _see_farthest(blocks, block):  # type: ignore[no-untyped-def]
    # In steps, of which the first makes vectors, and none waits long for another.
    half = BLOCK // 4
    for k in range(half):
        one, two = blocks.limit[block, k], blocks.limit[block, half + k]
        three, four = blocks.limit[block, 2 * half + k], blocks.limit[block, 3 * half + k]
        blocks.z[k] = _farther(_farther(one, two), _farther(three, four))
    z = blocks.z
    one, two = _farther(z[0], z[1]), _farther(z[2], z[3])
    three, four = _farther(z[4], z[5]), _farther(z[6], z[7])
    blocks.farthest[block] = _farther(_farther(one, two), _farther(three, four))


@njit(inline="always")
def _farther(one, other):  # type: ignore[no-untyped-def]
    return one if other <= one else other


@njit(inline="always")
def _range(at_edge, low, high):  # type: ignore[no-untyped-def]
    """Between what values an edge's function, as `at_sample` computes it, is where a and b are
    from `low` to `high`. Rounding never turns an order round, so that the corners tell."""
    constant, by_a, by_b = at_edge
    a0, a1 = low[0] * by_a, high[0] * by_a
    b0, b1 = low[1] * by_b, high[1] * by_b
    return constant + (min(a0, a1) + min(b0, b1)), constant + (max(a0, a1) + max(b0, b1))


@njit(inline="always")
def misses(edges, low, high):  # type: ignore[no-untyped-def]
    """Whether `splat_kernels.meets` is False at all samples from `low` to `high`, (a, b) each."""
    low0, high0 = _range(edges[0], low, high)
    low1, high1 = _range(edges[1], low, high)
    low2, high2 = _range(edges[2], low, high)
    return min(high0, high1, high2) < 0.0 and max(low0, low1, low2) > 0.0


@njit(inline="always")
def keep(blocks, block, row, column, within, edges, facet, grid, two_sided):  # type: ignore[no-untyped-def]
    """Depths of a triangle at a block's samples, and at which of them, with a and b `within` (least
    and greatest a, and b), it is met (`splat_kernels.meets`) and not beyond the limit: how many."""
    found = 0
    a0, a1, b0, b1 = within
    near, far, clips = grid.near, grid.far, grid.clips
    c = grid.clip
    c0, c1, c2, c3, c4, c5 = c[0], c[1], c[2], c[3], c[4], c[5]
    for k in range(BLOCK):
        a, b = blocks.a[column, k], blocks.b[row, k]
        s0, s1, s2 = at_sample(edges, a, b)
        outside = (min(s0, s1, s2) < 0.0) & (max(s0, s1, s2) > 0.0)
        denominator = plane(facet, grid, a, b)[1]
        faced = (denominator < 0.0) | ((denominator > 0.0) & two_sided)
        z, error = depth_interval(facet, grid, a, b)
        blocks.z[k], blocks.error[k] = z, error
        beyond = z - error > blocks.limit[block, k]
        # As `ray_kernels.counts`.
        before_plane = c0 + a * c1 + b * c2 + z * (c3 + a * c4 + b * c5) >= 0.0
        ranged = (z >= near) & (z <= far) & (before_plane | (not clips))
        inside = (a >= a0) & (a <= a1) & (b >= b0) & (b <= b1)
        kept = inside & ranged & faced & (not outside) & (not beyond)
        blocks.kept[k] = kept
        found += kept
    return found


@njit(inline="always")
def touch(blocks, row, column, face, extent, edges):  # type: ignore[no-untyped-def]
    """Which texels a lookup touches at each of a block's samples (`by_edges.touched_by_edges`); and
    which the lookups at all that are kept touch together, where all are certain."""
    x_first, y_first = np.int64(FAR), np.int64(FAR)
    x_last, y_last = np.int64(-FAR), np.int64(-FAR)
    open_ = 0
    for k in range(BLOCK):
        sides = at_sample(edges, blocks.a[column, k], blocks.b[row, k])
        x0, x1, y0, y1, certain = touched_by_edges(face, extent, sides)
        blocks.places[0, k], blocks.places[1, k] = x0, x1
        blocks.places[2, k], blocks.places[3, k] = y0, y1
        blocks.certain[k] = certain
        kept = blocks.kept[k] != 0
        open_ += kept & (not certain)
        # Whole numbers, of which a compiler finds the least in a vector.
        taken = kept & certain
        x_first = min(x_first, np.int64(x0 if taken else FAR))
        x_last = max(x_last, np.int64(x1 if taken else -FAR))
        y_first = min(y_first, np.int64(y0 if taken else FAR))
        y_last = max(y_last, np.int64(y1 if taken else -FAR))
    return x_first, x_last, y_first, y_last, open_ == 0


@njit(inline="always")
def _middle(first, last):  # type: ignore[no-untyped-def]
    """Of these texels along an axis those that are in two squares of bits, about the middle."""
    square = max(first >> 3, min((((first + last) >> 1) - 4) >> 3, (last >> 3) - 1))
    return max(first, 8 * square), min(last, 8 * square + 15)


@njit(inline="always")
def state_of_all(masks, material, size, together, plain, start, stride):  # type: ignore[no-untyped-def]
    """SOLID or HOLE, if a lookup of the texels of all lookups is that: then is each of them.
    `plain`, `start`, `stride`: as of `state_of_one`."""
    x0, x1, y0, y1, certain = together
    if not certain or x1 - x0 + 1 >= size[0] or y1 - y0 + 1 >= size[1]:
        # As many texels as a row has, and a lookup may run over an edge that this one does not.
        return UNSURE
    if plain:
        across, down = _middle(x0, x1), _middle(y0, y1)
        solid, hole = kinds_in_four_squares(masks.bits, start, stride, across, down)
        if solid != 0 and hole != 0:
            return UNSURE
        if across == (x0, x1) and down == (y0, y1):
            return SOLID if solid != 0 else HOLE
    of = masks.materials[material]
    texels = np.int64(size[0]), np.int64(size[1])
    columns = wrapped(np.float64(x0), np.float64(x1), texels[0], of.wrap_s)
    rows = wrapped(np.float64(y0), np.float64(y1), texels[1], of.wrap_t)
    state = state_of_bits(masks.bits, masks.bits_of_material[material], texels, columns, rows)
    return UNSURE if state == BETWEEN else state


@njit(inline="always")
def put_before(blocks, block, t):  # type: ignore[no-untyped-def]
    """Triangle t is SOLID at all samples that are kept."""
    for k in range(BLOCK):
        kept = blocks.kept[k] != 0
        z = blocks.z[k]
        limit, depth, solid = blocks.limit[block, k], blocks.depth[block, k], blocks.solid[block, k]
        reached = z + blocks.error[k]
        nearer = kept & ((z < depth) | ((z == depth) & (t < solid)))
        blocks.limit[block, k] = reached if kept & (reached < limit) else limit
        blocks.depth[block, k] = z if nearer else depth
        blocks.solid[block, k] = t if nearer else solid
    _see_farthest(blocks, block)


@njit(inline="always")
def within_texture(together, size):  # type: ignore[no-untyped-def]
    """Whether the texels of all lookups are certain, and none beyond the texture's edges."""
    x0, x1, y0, y1, certain = together
    return certain and x0 >= 0 and y0 >= 0 and x1 < size[0] and y1 < size[1]


@njit(inline="always")
def look_up(blocks, bits, start, stride):  # type: ignore[no-untyped-def]
    """Which of a block's lookups take solid texels, and which take holes, where it is
    `within_texture`; and which may take others than were looked at, and so be BETWEEN too: a bit
    for each of the samples that are kept. `start`, `stride`: see `lookup.kinds_in_four_squares`."""
    of = blocks.places
    solids, holes, more = np.uint64(0), np.uint64(0), np.uint64(0)
    # Nothing is written: whatever is, a compiler takes for something that is read in the next turn.
    for k in range(BLOCK):
        kept = blocks.kept[k] != 0
        # Elsewhere no texels may be there: the first is asked for.
        x0, x1 = np.int64(of[0, k] if kept else 0.0), np.int64(of[1, k] if kept else 0.0)
        y0, y1 = np.int64(of[2, k] if kept else 0.0), np.int64(of[3, k] if kept else 0.0)
        across, down = _middle(x0, x1), _middle(y0, y1)
        solid, hole = kinds_in_four_squares(bits, start, stride, across, down)
        all_of_them = (across[0] == x0) & (across[1] == x1) & (down[0] == y0) & (down[1] == y1)
        between = (solid != 0) & (hole != 0)
        bit = np.uint64(kept) << np.uint64(k)
        solids |= bit if solid != 0 else np.uint64(0)
        holes |= bit if hole != 0 else np.uint64(0)
        more |= np.uint64(0) if all_of_them | between else bit
    return solids, holes, more


@intrinsic
def lowest_bit(typing_context: Any, bits: Any) -> Any:
    """Which bit of a uint64, some of which are there, is the lowest that is."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        never_zero = context.get_constant(types.boolean, True)
        return builder.cttz(arguments[0], never_zero)

    return types.int64(types.uint64), generate


@njit(inline="always")
def with_bit(bits, k):  # type: ignore[no-untyped-def]
    return bits | (np.uint64(1) << np.uint64(k))


@njit(inline="always")
def keep_only(blocks, bits):  # type: ignore[no-untyped-def]
    """Of the samples that are kept, those whose bit is there."""
    for k in range(BLOCK):
        blocks.kept[k] = (bits >> np.uint64(k)) & np.uint64(1)


@njit(inline="always")
def state_of_one(blocks, k, masks, material):  # type: ignore[no-untyped-def]
    """SOLID, HOLE or BETWEEN at one of the samples (`touch`), else `UNSURE`."""
    of = blocks.places
    places = (of[0, k], of[1, k], of[2, k], of[3, k], blocks.certain[k])
    return state_by_places(masks, material, places)


@njit(inline="always")
def leave_open(blocks, block, k, t, hits, count):  # type: ignore[no-untyped-def]
    """Triangle t is BETWEEN at a sample: that is one of FOUND more than `count`."""
    hit, before = hits[count], blocks.last[block, k]
    hit.triangle, hit.depth, hit.bound, hit.next = t, blocks.z[k], blocks.error[k], count
    if before >= 0:
        hit.next, hits[before].next = hits[before].next, count
    blocks.last[block, k] = count
    blocks.open[block] = True


@njit(inline="always")
def list_kept(blocks):  # type: ignore[no-untyped-def]
    """Which samples are kept, in order: how many."""
    count = 0
    for k in range(BLOCK):
        blocks.order[count] = k
        count += blocks.kept[k] != 0
    return count
