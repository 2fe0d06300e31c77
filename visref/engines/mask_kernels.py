"""Compiled loops that look through masked triangles, front to back, as far as anything shows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines.mask_blocks import (
    BLOCK_HEIGHT,
    BLOCK_WIDTH,
    FOUND,
    Blocks,
    InView,
    find_in_view,
    look_through,
)
from visref.engines.ray_kernels import SampleGrid, Triangles
from visref.masks.store import Masks
from visref.visibility import BACKGROUND


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
        left = Open(np.empty(room, np.int64), np.empty(room, np.int64), np.empty(0, np.int32), np.empty(room))
        return cls(Blocks.of(grid, rows), np.empty(room, FOUND), left)


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


def in_view(which: NDArray[np.int32], mesh: Triangles, grid: SampleGrid) -> InView:
    """Those of the triangles `which`, (k,), that may cover samples, in their order."""
    room = InView(
        np.empty(len(which), np.int32), np.empty((len(which), 4), np.int32), np.empty(len(which))
    )
    count = find_in_view(which, mesh, grid, room)
    return InView._make(column[:count] for column in room)


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
    """Let the nearest SOLID hit of masked triangles own its sample, where it lies before the `owner`,
    (samples,) int32, changed in place, in some rows of the image; and say what BETWEEN leaves open.

    `seen`: the triangles, best from near to far: in whatever order, the same is found. `axes`: (4,
    3) float64, e, F, R, U.
    """
    top, bottom = rows
    blocks, hits, begin, count = scratch.blocks.at(grid, top, bottom), scratch.hits, 0, 0
    width = len(grid.column_a)
    while True:
        begin, count = look_through(
            seen, begin, mesh, grid, bottom, owner, masks.arrays, masks.row, axes, blocks, hits, count
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
    """Write down who owns the samples of `blocks`, and what is not hidden of the hits, in order, into
    `left`: how many samples, and hits. `depth`: room for as many."""
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
