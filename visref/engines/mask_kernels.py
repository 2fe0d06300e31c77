"""Masked triangles are looked through, front to back, as far as anything shows.

Where they are solid they own samples, where a mask is in between they leave them open. Both hang on
nothing but the triangles: an owner is the nearest solid hit, and open is what is not behind one for
certain. So the order in which triangles are met, and which rows of an image are looked at together,
changes how long it takes, and nothing else.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines.mask_blocks import (
    BLOCK,
    BLOCK_HEIGHT,
    BLOCK_WIDTH,
    FOUND,
    Blocks,
    begin_block,
    keep,
    keep_only,
    leave_open,
    list_kept,
    look_up,
    lowest_bit,
    misses,
    put_before,
    state_of_all,
    state_of_one,
    touch,
    with_bit,
    within_texture,
)
from visref.engines.ray_kernels import (
    SampleGrid,
    Triangles,
    corner,
    corners_from,
    dot,
    facet_of,
    minus,
)
from visref.engines.splat_kernels import edge, window_of
from visref.masks.by_edges import extent_of, facing, reach_of
from visref.masks.hits import UNIT, state_at
from visref.masks.lookup import BETWEEN, HOLE, SOLID, UNSURE, words_of_row
from visref.masks.store import MaskArrays, Masks
from visref.visibility import BACKGROUND


class InView(NamedTuple):
    """Masked triangles that may cover samples: ids, the windows of samples (x0, x1, y0, y1; x1, y1
    excluded), (k, 4), and the least depths, (k,)."""

    triangle: NDArray[np.int32]
    window: NDArray[np.int32]
    nearest: NDArray[np.float64]

    def taken(self, which: NDArray[Any]) -> InView:
        return InView._make(column[which] for column in self)


class Open(NamedTuple):
    """Samples that masks leave open, ascending, how many triangles may be seen there, and the least
    depth of these: (k,) each; and the triangles, front to back at each sample, (h,)."""

    sample: NDArray[np.int64]
    many: NDArray[np.int64]
    triangle: NDArray[np.int32]
    least: NDArray[np.float64]


class Scratch(NamedTuple):
    """What a thread needs of its own while it looks through some rows of an image: it may serve for
    other rows afterwards, no more than so many."""

    blocks: Blocks
    hits: NDArray[Any]
    left: Open

    @classmethod
    def of(cls, grid: SampleGrid, rows: int) -> Scratch:
        # A triangle may have a hit at each sample.
        room = rows * len(grid.column_a)
        left = Open(
            np.empty(room, np.int64),
            np.empty(room, np.int64),
            np.empty(0, np.int32),
            np.empty(room),
        )
        return cls(Blocks.of(grid, rows), np.empty(room, FOUND), left)

    def seeing(self, grid: SampleGrid, rows: int) -> Scratch:
        """The same for another grid, in the same memory where that is as large."""
        if len(self.left.sample) != rows * len(grid.column_a):
            return Scratch.of(grid, rows)
        return self._replace(blocks=self.blocks.seeing(grid))


@njit(inline="always")
def _sort(depth, triangle, begin, end):  # type: ignore[no-untyped-def]
    """Put the hits of a sample, some places of two arrays, in order: by depth, then triangle."""
    # Shell's method: a sample has a few hits, rarely hundreds.
    gap = (end - begin) // 2
    while gap > 0:
        for j in range(begin + gap, end):
            z, t, at = depth[j], triangle[j], j
            while at - gap >= begin:
                other = at - gap
                if depth[other] < z or (depth[other] == z and triangle[other] < t):
                    break
                depth[at], triangle[at] = depth[other], triangle[other]
                at = other
            depth[at], triangle[at] = z, t
        gap //= 2


@njit(inline="always")
def _depth_at_least(grid, p):  # type: ignore[no-untyped-def]
    """A view depth, less what rounding may have added; in `p` too, which is relative to the eye,
    and in the axes, with room to spare."""
    f = grid.axes[4]
    size = abs(p[0] * f[0]) + abs(p[1] * f[1]) + abs(p[2] * f[2])
    return dot(p, f) - 64.0 * UNIT * size


@njit(error_model="numpy", makes_arrays=False)
def find_in_view(which: NDArray[Any], mesh: Triangles, grid: SampleGrid, found: InView) -> int:
    """Those of the triangles `which` that may cover samples, into `found`: how many."""
    m = grid.axes
    eye = (m[0, 0], m[0, 1], m[0, 2])
    whole = (0, len(grid.column_a), 0, len(grid.row_b))
    count = 0
    for t in which:
        p0, p1, p2 = corners_from(eye, mesh, t)
        x0, x1, y0, y1 = window_of(grid, (p0, p1, p2), whole)
        if x0 >= x1 or y0 >= y1:
            continue
        found.triangle[count] = t
        found.window[count, 0], found.window[count, 1] = x0, x1
        found.window[count, 2], found.window[count, 3] = y0, y1
        found.nearest[count] = min(
            _depth_at_least(grid, p0), _depth_at_least(grid, p1), _depth_at_least(grid, p2)
        )
        count += 1
    return count


def in_view(which: NDArray[np.int32], mesh: Triangles, grid: SampleGrid) -> InView:
    """Those of the triangles `which`, (k,), that may cover samples, in their order."""
    room = InView(
        np.empty(len(which), np.int32), np.empty((len(which), 4), np.int32), np.empty(len(which))
    )
    count = find_in_view(which, mesh, grid, room)
    return InView._make(column[:count] for column in room)


@njit(inline="always")
def _first_before(blocks, nearest, rows, columns):  # type: ignore[no-untyped-def]
    """The first row of blocks in which what begins at a depth may be seen; their end for none."""
    for row in range(rows[0], rows[1]):
        start = row * len(blocks.a)
        for block in range(start + columns[0], start + columns[1]):
            if nearest <= blocks.farthest[block]:
                return row
    return rows[1]


@njit(error_model="numpy", makes_arrays=False)
def look_through(
    seen: InView,
    begin: int,
    mesh: Triangles,
    grid: SampleGrid,
    bottom: int,
    owner: NDArray[Any],
    masks: MaskArrays,
    row_of_triangle: NDArray[Any],
    axes: NDArray[Any],
    blocks: Blocks,
    hits: NDArray[Any],
    count: int,
) -> tuple[int, int]:
    """Let masked triangles from `begin` on be met in `blocks`, of the rows before `bottom`. What is
    BETWEEN, and not known to be hidden, goes into `hits`, FOUND, which holds `count`, as far as
    there is room: the index of the first triangle that is left, and how many hits there are then.

    `row_of_triangle`: (t,) int, which of `masks` a triangle has, negative where that is not known:
    then it is BETWEEN.
    """
    m = grid.axes
    eye = (m[0, 0], m[0, 1], m[0, 2])
    width, across = len(grid.column_a), len(blocks.a)
    perspective = grid.perspective
    # Of the whole image: no answer hangs on which rows are looked at together.
    reach = reach_of(grid, (0, width, 0, len(grid.row_b)))
    nowhere = ((1.0, 1.0), ((0.0, 0.0), (0.0, 0.0)))
    for index in range(begin, len(seen.triangle)):
        x0, x1 = seen.window[index, 0], seen.window[index, 1]
        y0, y1 = max(seen.window[index, 2], blocks.top), min(seen.window[index, 3], bottom)
        if y0 >= y1:
            continue
        if count + (x1 - x0) * (y1 - y0) > len(hits):
            return index, count
        nearest = seen.nearest[index]
        columns = x0 // BLOCK_WIDTH, (x1 - 1) // BLOCK_WIDTH + 1
        rows = (y0 - blocks.top) // BLOCK_HEIGHT, (y1 - 1 - blocks.top) // BLOCK_HEIGHT + 1
        first = _first_before(blocks, nearest, rows, columns)
        if first == rows[1]:
            continue
        t = seen.triangle[index]
        v0, v1, v2 = corner(mesh, t, 0), corner(mesh, t, 1), corner(mesh, t, 2)
        p0, p1, p2 = minus(v0, eye), minus(v1, eye), minus(v2, eye)
        edges = (edge(grid, p0, p1), edge(grid, p1, p2), edge(grid, p2, p0))
        facet = facet_of(mesh, grid, t)
        mask_row = row_of_triangle[t]
        face = facing(masks, mask_row, edges, (p0, p1, p2), reach)
        within = grid.column_a[x0], grid.column_a[x1 - 1], grid.row_b[y1 - 1], grid.row_b[y0]
        extent, start, stride = nowhere, np.int64(-1), np.int64(0)
        if face[1]:
            extent, start = extent_of(masks, face[0]), masks.bits_of_material[face[0]]
            stride = words_of_row(np.int64(extent[0][0]))
        two_sided = not mesh.one_sided[t]
        for row in range(first, rows[1]):
            for column in range(columns[0], columns[1]):
                block = row * across + column
                if nearest > blocks.farthest[block]:
                    continue
                low = blocks.a[column, 0], blocks.b[row, BLOCK - 1]
                high = blocks.a[column, BLOCK - 1], blocks.b[row, 0]
                if misses(edges, low, high):
                    continue
                if not blocks.begun[block]:
                    begin_block(blocks, block, row, column, mesh, grid, owner)
                found = keep(blocks, block, row, column, within, edges, facet, grid, two_sided)
                if not found:
                    continue
                plain: Any = False
                if face[1]:
                    together = touch(blocks, row, column, face, extent, edges)
                    plain = start >= 0 and within_texture(together, extent[0])
                    of_all = state_of_all(masks, face[0], extent[0], together, plain, start, stride)
                    if of_all == HOLE:
                        continue
                    if of_all == SOLID:
                        put_before(blocks, block, t)
                        continue
                if plain:
                    solids, holes, more = look_up(blocks, masks.bits, start, stride)
                    while more != 0:
                        k = lowest_bit(more)
                        more &= more - np.uint64(1)
                        if state_of_one(blocks, k, masks, face[0]) == BETWEEN:
                            solids, holes = with_bit(solids, k), with_bit(holes, k)
                    between = solids & holes
                    while between != 0:
                        leave_open(blocks, block, lowest_bit(between), t, hits, count)
                        between &= between - np.uint64(1)
                        count += 1
                    keep_only(blocks, solids & ~holes)
                    put_before(blocks, block, t)
                    continue
                for i in range(list_kept(blocks)):
                    k, state = blocks.order[i], BETWEEN
                    if face[1]:
                        state = state_of_one(blocks, k, masks, face[0])
                    if mask_row >= 0 and (state == UNSURE or not face[1]):
                        a, b = blocks.a[column, k], blocks.b[row, k]
                        state = state_at(masks, mask_row, axes, a, b, perspective, v0, v1, v2)
                    if state == BETWEEN:
                        leave_open(blocks, block, k, t, hits, count)
                        count += 1
                    blocks.kept[k] = state == SOLID
                put_before(blocks, block, t)
    return len(seen.triangle), count


def shown(
    seen: InView,
    mesh: Triangles,
    grid: SampleGrid,
    rows: tuple[int, int],
    owner: NDArray[np.int32],
    masks: Masks,
    axes: NDArray[np.float64],
    scratch: Scratch,
) -> Open:
    """In some rows of the image, let the nearest SOLID hit of masked triangles own its sample,
    where it lies before the `owner`, (samples,) int32, changed in place; and say what BETWEEN
    leaves open.

    `seen`: the triangles, best from near to far: in whatever order, the same is found. `axes`: (4,
    3) float64, e, F, R, U.
    """
    top, bottom = rows
    blocks, hits, begin, count = scratch.blocks.at(grid, top, bottom), scratch.hits, 0, 0
    width = len(grid.column_a)
    while True:
        begin, count = look_through(
            seen,
            begin,
            mesh,
            grid,
            bottom,
            owner,
            masks.arrays,
            masks.row,
            axes,
            blocks,
            hits,
            count,
        )
        if begin == len(seen.triangle):
            break
        hits = np.concatenate([hits, np.empty(len(hits), FOUND)])
    left = scratch.left._replace(triangle=np.empty(count, np.int32))
    samples, kept = _settle(hits, blocks, width, bottom, owner, left, np.empty(count))
    # Copies: the room is that of all that could be, and serves again.
    return Open(
        left.sample[:samples].copy(),
        left.many[:samples].copy(),
        left.triangle[:kept].copy(),
        left.least[:samples].copy(),
    )


@njit(error_model="numpy", makes_arrays=False)
def _settle(
    hits: NDArray[Any],
    blocks: Blocks,
    width: int,
    bottom: int,
    owner: NDArray[Any],
    left: Open,
    depth: NDArray[Any],
) -> tuple[int, int]:
    """Write down who owns the samples of `blocks`; and into `left` what is not hidden of the hits,
    FOUND, in order: how many samples, and hits. `depth`: room for as many."""
    across = len(blocks.a)
    samples, count = 0, 0
    for y in range(blocks.top, bottom):
        row, in_block = (y - blocks.top) // BLOCK_HEIGHT, (y - blocks.top) % BLOCK_HEIGHT
        for column in range(across):
            block = row * across + column
            if not blocks.begun[block]:
                continue
            first = column * BLOCK_WIDTH
            start, there = y * width + first, min(BLOCK_WIDTH, width - first)
            for x in range(there):
                solid = blocks.solid[block, in_block * BLOCK_WIDTH + x]
                owner[start + x] = owner[start + x] if solid == BACKGROUND else solid
            if not blocks.open[block]:
                continue
            for x in range(there):
                k = in_block * BLOCK_WIDTH + x
                last = blocks.last[block, k]
                if last < 0:
                    continue
                begin, least, limit, h = count, np.inf, blocks.limit[block, k], last
                while True:
                    h = hits[h].next
                    hit = hits[h]
                    if not hit.depth - hit.bound > limit:
                        left.triangle[count], depth[count] = hit.triangle, hit.depth
                        least = min(least, hit.depth - hit.bound)
                        count += 1
                    if h == last:
                        break
                if count > begin:
                    _sort(depth, left.triangle, begin, count)
                    left.sample[samples], left.many[samples] = start + x, count - begin
                    left.least[samples] = least
                    samples += 1
    return samples, count
