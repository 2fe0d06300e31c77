"""Compiled loops that look through masked triangles, front to back, as far as anything shows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines.ray_kernels import (
    SampleGrid,
    Triangles,
    corner,
    counts,
    depth_interval,
    dot,
    facet_of,
    minus,
    plane,
)
from visref.engines.splat_kernels import Hits, at_sample, edge, meets, window_of
from visref.masks.by_edges import facing, reach_of, state_by_edges
from visref.masks.hits import UNIT, state_at
from visref.masks.lookup import BETWEEN, HOLE, SOLID, UNSURE
from visref.masks.store import MaskArrays, Masks


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


def shown(
    which: NDArray[np.int32],
    mesh: Triangles,
    grid: SampleGrid,
    window: tuple[int, int, int, int],
    owner: NDArray[np.int32],
    masks: Masks,
    axes: NDArray[np.float64],
    limit: NDArray[np.float64],
) -> tuple[Hits, NDArray[np.uint8]]:
    """Hits of masked triangles in `window` (as of `splat_kernels.splat`) that are SOLID or BETWEEN,
    and which: all of them that may be seen, and of those that lie behind a SOLID one or the
    opaque `owner`, (samples,) int32, for certain such as were met too early.

    `which`: (k,) int32, the triangles, best from near to far. `axes`: (4, 3) float64, e, F, R, U.
    `limit`: (samples,) float64, NaN in the window: beyond what depth nothing is seen, in the end.
    """
    parts: list[tuple[Hits, NDArray[np.uint8]]] = []
    begin, room = 0, 1 << 14
    while True:
        hits = Hits(
            np.empty(room, np.int64), np.empty(room, np.int32), np.empty(room), np.empty(room)
        )
        state = np.empty(room, np.uint8)
        begin, count = _shown(
            which,
            begin,
            mesh,
            grid,
            window,
            owner,
            masks.arrays,
            masks.row,
            axes,
            limit,
            hits,
            state,
        )
        parts.append((Hits._make(column[:count] for column in hits), state[:count]))
        if begin == len(which):
            break
        # A triangle may have a hit at each sample of the window.
        room = max(2 * room, (window[1] - window[0]) * (window[3] - window[2]))
    columns = zip(*(hits for hits, _ in parts), strict=True)
    return (
        Hits._make(np.concatenate(column) for column in columns),
        np.concatenate([state for _, state in parts]),
    )


def settle(
    hits: Hits,
    state: NDArray[np.uint8],
    window: tuple[int, int, int, int],
    mesh: Triangles,
    grid: SampleGrid,
    triangle: NDArray[np.int32],
) -> Open:
    """Let the nearest SOLID of a window's hits (`shown`) own its sample, where it lies before the
    owner in `triangle`, (samples,) int32, changed in place; and say what BETWEEN leaves open."""
    order, starts = front_to_back(hits, window, len(grid.column_a))
    most = np.count_nonzero(state == BETWEEN)
    room = Open(
        np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int32), np.empty(most)
    )
    samples, count = _settle(hits, state, order, starts, window, mesh, grid, triangle, room)
    return Open(
        room.sample[:samples], room.many[:samples], room.triangle[:count], room.least[:samples]
    )


@njit(error_model="numpy", makes_arrays=False)
def _settle(
    hits: Hits,
    state: NDArray[Any],
    order: NDArray[Any],
    starts: NDArray[Any],
    window: tuple[int, int, int, int],
    mesh: Triangles,
    grid: SampleGrid,
    triangle: NDArray[Any],
    left: Open,
) -> tuple[int, int]:
    """`settle`, into `left`: how many samples, and how many hits, are left open."""
    x0, x1, y0, _ = window
    width = len(grid.column_a)
    last, facet = -1, facet_of(mesh, grid, 0)
    samples, count = 0, 0
    for place in range(len(starts) - 1):
        begin, end = starts[place], starts[place + 1]
        if begin == end:
            continue
        x, y = x0 + place % (x1 - x0), y0 + place // (x1 - x0)
        s = y * width + x
        nearest, behind = -1, np.inf
        for at in range(begin, end):
            k = order[at]
            if state[k] == SOLID:
                if nearest < 0:
                    nearest = k
                # In whatever order they were met, nothing beyond this was left out too soon.
                behind = min(behind, hits.depth[k] + hits.bound[k])
        if nearest >= 0:
            owner, depth = triangle[s], np.inf
            if owner >= 0:
                if owner != last:
                    last, facet = owner, facet_of(mesh, grid, owner)
                numerator, denominator = plane(facet, grid, grid.column_a[x], grid.row_b[y])
                depth = numerator / denominator
            if hits.depth[nearest] < depth:
                triangle[s] = hits.triangle[nearest]
        before, least = count, np.inf
        for at in range(begin, end):
            k = order[at]
            if state[k] == BETWEEN and hits.depth[k] - hits.bound[k] <= behind:
                left.triangle[count] = hits.triangle[k]
                least = min(least, hits.depth[k] - hits.bound[k])
                count += 1
        if count > before:
            left.sample[samples], left.many[samples] = s, count - before
            left.least[samples] = least
            samples += 1
    return samples, count


@njit(inline="always")
def _depth_at_least(grid, p):  # type: ignore[no-untyped-def]
    """A view depth, less what rounding may have added; in `p` too, which is relative to the eye,
    and in the axes, with room to spare."""
    f = grid.axes[4]
    size = abs(p[0] * f[0]) + abs(p[1] * f[1]) + abs(p[2] * f[2])
    return dot(p, f) - 64.0 * UNIT * size


@njit(error_model="numpy", makes_arrays=False)
def _shown(
    which: NDArray[Any],
    begin: int,
    mesh: Triangles,
    grid: SampleGrid,
    window: tuple[int, int, int, int],
    owner: NDArray[Any],
    masks: MaskArrays,
    row_of_triangle: NDArray[Any],
    axes: NDArray[Any],
    limit: NDArray[Any],
    hits: Hits,
    state: NDArray[Any],
) -> tuple[int, int]:
    """`shown` of the triangles from `begin` on, into `hits` and `state`, as far as there is room:
    the index of the first triangle that is left, and how many hits there are.

    `row_of_triangle`: (t,) int, which of `masks` a triangle has, negative where that is not known:
    then it is BETWEEN.
    """
    m = grid.axes
    eye = (m[0, 0], m[0, 1], m[0, 2])
    width = len(grid.column_a)
    perspective = grid.perspective
    reach = reach_of(grid, window)
    count = 0
    last, behind_of = -1, facet_of(mesh, grid, 0)
    for index in range(begin, len(which)):
        t = which[index]
        v0, v1, v2 = corner(mesh, t, 0), corner(mesh, t, 1), corner(mesh, t, 2)
        p0, p1, p2 = minus(v0, eye), minus(v1, eye), minus(v2, eye)
        x0, x1, y0, y1 = window_of(grid, (p0, p1, p2), window)
        if x0 >= x1 or y0 >= y1:
            continue
        if count + (x1 - x0) * (y1 - y0) > len(state):
            return index, count
        edges = (edge(grid, p0, p1), edge(grid, p1, p2), edge(grid, p2, p0))
        facet = facet_of(mesh, grid, t)
        row = row_of_triangle[t]
        face = facing(masks, row, edges, (p0, p1, p2), reach)
        nearest = min(
            _depth_at_least(grid, p0), _depth_at_least(grid, p1), _depth_at_least(grid, p2)
        )
        for y in range(y0, y1):
            b = grid.row_b[y]
            for x in range(x0, x1):
                s = y * width + x
                least = limit[s]
                if nearest > least:
                    continue
                a = grid.column_a[x]
                sides = at_sample(edges, a, b)
                if not meets(sides, facet, mesh, grid, t, a, b):
                    continue
                z, error = depth_interval(facet, grid, a, b)
                if least != least:
                    least = np.inf
                    if owner[s] >= 0:
                        # Neighbouring samples mostly share their owner.
                        if owner[s] != last:
                            last, behind_of = owner[s], facet_of(mesh, grid, owner[s])
                        behind, slack = depth_interval(behind_of, grid, a, b)
                        least = behind + slack
                    limit[s] = least
                if z - error > least or not counts(grid, z, a, b):
                    continue
                found = BETWEEN
                if row >= 0:
                    found = state_by_edges(masks, face, sides)
                    if found == UNSURE:
                        found = state_at(masks, row, axes, a, b, perspective, v0, v1, v2)
                if found == HOLE:
                    continue
                if found == SOLID:
                    limit[s] = min(least, z + error)
                hits.sample[count], hits.triangle[count] = s, t
                hits.depth[count], hits.bound[count] = z, error
                state[count] = found
                count += 1
    return len(which), count
