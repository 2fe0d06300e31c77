"""Compiled loops that look through masked triangles, front to back, as far as anything shows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines.mask_blocks import (
    BLOCK_HEIGHT,
    BLOCK_WIDTH,
    Blocks,
    InView,
    find_in_view,
    look_through,
)
from visref.engines.ray_kernels import SampleGrid, Triangles
from visref.engines.splat_kernels import Hits
from visref.masks.store import Masks
from visref.visibility import BACKGROUND


class Open(NamedTuple):
    """Samples that masks leave open, ascending, how many triangles may be seen there, and the least
    depth of these: (k,) each; and the triangles, front to back at each sample, (h,)."""

    sample: NDArray[np.int64]
    many: NDArray[np.int64]
    triangle: NDArray[np.int32]
    least: NDArray[np.float64]


@njit()
def front_to_back(
    hits: Hits, window: tuple[int, int, int, int], width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The hits of a window (`splat_kernels.splat`) in order: by sample, depth, then triangle; and
    where each of the window's samples begins among them. (h,) and (samples of the window + 1,)
    int64, its samples row by row; `width` is the image's."""
    sample, triangle, depth, _ = hits
    x0, x1, y0, y1 = window
    across = x1 - x0
    starts = np.zeros(across * (y1 - y0) + 1, np.int64)
    place = np.empty(len(sample), np.int64)
    for k in range(len(sample)):
        place[k] = (sample[k] // width - y0) * across + sample[k] % width - x0
        starts[place[k] + 1] += 1
    for i in range(len(starts) - 1):
        starts[i + 1] += starts[i]
    order, filled = np.empty(len(sample), np.int64), starts[:-1].copy()
    for k in range(len(sample)):
        order[filled[place[k]]] = k
        filled[place[k]] += 1
    for i in range(len(starts) - 1):
        begin, end = starts[i], starts[i + 1]
        # Shell's method: a sample has a few hits, rarely hundreds.
        gap = (end - begin) // 2
        while gap > 0:
            for j in range(begin + gap, end):
                k, at = order[j], j
                while at - gap >= begin:
                    other = order[at - gap]
                    if depth[other] < depth[k] or (
                        depth[other] == depth[k] and triangle[other] < triangle[k]
                    ):
                        break
                    order[at] = other
                    at -= gap
                order[at] = k
            gap //= 2
    return order, starts


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
) -> Open:
    """Let the nearest SOLID hit of masked triangles own its sample, where it lies before the `owner`,
    (samples,) int32, changed in place, in some rows of the image; and say what BETWEEN leaves open.

    `seen`: the triangles, best from near to far: in whatever order, the same is found. `axes`: (4,
    3) float64, e, F, R, U.
    """
    top, bottom = rows
    blocks = Blocks.of(grid, top, bottom)
    parts: list[Hits] = []
    begin, room = 0, 1 << 14
    while True:
        hits = Hits(
            np.empty(room, np.int64), np.empty(room, np.int32), np.empty(room), np.empty(room)
        )
        begin, count = look_through(
            seen, begin, mesh, grid, bottom, owner, masks.arrays, masks.row, axes, blocks, hits
        )
        parts.append(Hits._make(column[:count] for column in hits))
        if begin == len(seen.triangle):
            break
        # A triangle may have a hit at each sample of the rows.
        room = max(2 * room, (bottom - top) * len(grid.column_a))
    hits = Hits._make(np.concatenate(column) for column in zip(*parts, strict=True))
    settled = _settle(hits, blocks, len(grid.column_a), bottom, owner)
    hits = Hits._make(column[:settled] for column in hits)
    order, starts = front_to_back(hits, (0, len(grid.column_a), top, bottom), len(grid.column_a))
    most = len(order)
    left = Open(
        np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int32), np.empty(most)
    )
    samples = _leave_open(hits, order, starts, top * len(grid.column_a), left)
    return Open(left.sample[:samples], left.many[:samples], left.triangle, left.least[:samples])


@njit(error_model="numpy", makes_arrays=False)
def _settle(hits: Hits, blocks: Blocks, width: int, bottom: int, owner: NDArray[Any]) -> int:
    """Write down who owns samples of `blocks`, and keep those of the hits, in their order and in
    place, that are not hidden: how many."""
    across = len(blocks.a)
    for block in range(len(blocks.begun)):
        if not blocks.begun[block]:
            continue
        left = block % across * BLOCK_WIDTH
        top = blocks.top + block // across * BLOCK_HEIGHT
        for y in range(top, min(top + BLOCK_HEIGHT, bottom)):
            for x in range(left, min(left + BLOCK_WIDTH, width)):
                solid = blocks.solid[block, (y - top) * BLOCK_WIDTH + x - left]
                if solid != BACKGROUND:
                    owner[y * width + x] = solid
    count = 0
    for h in range(len(hits.sample)):
        s = hits.sample[h]
        x, y = s % width, s // width - blocks.top
        block = y // BLOCK_HEIGHT * across + x // BLOCK_WIDTH
        k = y % BLOCK_HEIGHT * BLOCK_WIDTH + x % BLOCK_WIDTH
        if hits.depth[h] - hits.bound[h] > blocks.limit[block, k]:
            continue
        hits.sample[count], hits.triangle[count] = s, hits.triangle[h]
        hits.depth[count], hits.bound[count] = hits.depth[h], hits.bound[h]
        count += 1
    return count


@njit(error_model="numpy", makes_arrays=False)
def _leave_open(
    hits: Hits, order: NDArray[Any], starts: NDArray[Any], first: int, left: Open
) -> int:
    """The hits of samples from `first` on, in order (`front_to_back`), into `left`: how many
    samples."""
    samples = 0
    for place in range(len(starts) - 1):
        begin, end = starts[place], starts[place + 1]
        if begin == end:
            continue
        least = np.inf
        for at in range(begin, end):
            k = order[at]
            left.triangle[at] = hits.triangle[k]
            least = min(least, hits.depth[k] - hits.bound[k])
        left.sample[samples], left.many[samples] = first + place, end - begin
        left.least[samples] = least
        samples += 1
    return samples
