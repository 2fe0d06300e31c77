"""The few compiled loops over samples that NumPy would make several passes of."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit

# Where int32 begins, and how many of its numbers are negative.
_LEAST, _NEGATIVES = np.int32(-(2**31)), np.uint32(2**31)


@njit(makes_arrays=False)
def gather_objects(
    triangle: NDArray[Any],
    undecided: NDArray[Any],
    tie_sample: NDArray[Any],
    tie_triangle: NDArray[Any],
    object_of_triangle: NDArray[Any],
    object_offsets: NDArray[Any],
    pixels: NDArray[Any],
    alone: NDArray[Any],
    alone_sample: NDArray[Any],
    tied_sample: NDArray[Any],
) -> int:
    """Per object, all changed in place: samples owned, those of them owned alone, the first of
    either kind (alone, tied). Returns how many decided samples are owned. Ties are sorted by
    sample, then triangle; since triangles are grouped by object, those of one object at a sample
    stand together.

    `triangle` int32: (samples,). `undecided` int64: flat samples, ascending, that are left out.
    `tie_sample` int64 and `tie_triangle` int32: (k,), one per tie. `object_of_triangle`: (t,)
    int32. `object_offsets`: (n + 1,) int64, where an object's triangles begin. The rest: (n,)
    int64, one per object; `pixels` and `alone` come as zeros, samples negative.
    """
    k, u, s, total = 0, 0, 0, 0
    count = triangle.size
    # The object met last, -1 for the background, and its triangles: neighbours are mostly of one
    # object, and a triangle of its own is no reason to look that up.
    owner, first_of, span = -1, np.int32(0), np.uint32(0)
    while s < count:
        # Up to the next sample at which there is more than an owner.
        stop = count
        if k < tie_sample.size:
            stop = tie_sample[k]
        if u < undecided.size:
            stop = min(stop, undecided[u])
        since, part = 0, triangle[s:stop]
        for at in range(len(part)):
            t = part[at]
            if np.uint32(t - first_of) >= span:
                if owner >= 0:
                    alone[owner] += at - since
                since = at
                if t < 0:
                    owner, first_of, span = -1, _LEAST, _NEGATIVES
                else:
                    owner = object_of_triangle[t]
                    first_of = np.int32(object_offsets[owner])
                    span = np.uint32(object_offsets[owner + 1] - object_offsets[owner])
                    if alone_sample[owner] < 0:
                        alone_sample[owner] = s + at
        if owner >= 0:
            alone[owner] += len(part) - since
        s = stop
        if s == count:
            break
        t = triangle[s]
        start = k
        while k < tie_sample.size and tie_sample[k] == s:
            k += 1
        open_ = u < undecided.size and undecided[u] == s
        if open_:
            u += 1
        if t >= 0 and not open_:
            mine = object_of_triangle[t]
            others, last = 0, mine
            for j in range(start, k):
                o = object_of_triangle[tie_triangle[j]]
                if o in (mine, last):
                    continue
                others, last = others + 1, o
                pixels[o] += 1
                if tied_sample[o] < 0:
                    tied_sample[o] = s
            if others == 0:
                alone[mine] += 1
                if alone_sample[mine] < 0:
                    alone_sample[mine] = s
            else:
                total += 1
                pixels[mine] += 1
                if tied_sample[mine] < 0:
                    tied_sample[mine] = s
        s += 1
    for o in range(len(alone)):
        total += alone[o]
        pixels[o] += alone[o]
    return total


@njit(makes_arrays=False)
def nearest_of_objects(
    triangle: NDArray[Any],
    depth: NDArray[Any],
    undecided: NDArray[Any],
    tie_sample: NDArray[Any],
    tie_triangle: NDArray[Any],
    object_of_triangle: NDArray[Any],
    nearest: NDArray[Any],
) -> None:
    """The least depth at which each object owns or shares a decided sample, into `nearest`, (n,)
    float64. `depth`: (samples,) float64; the rest as `gather_objects`."""
    k, u = 0, 0
    for s in range(triangle.size):
        start = k
        while k < tie_sample.size and tie_sample[k] == s:
            k += 1
        if u < undecided.size and undecided[u] == s:
            u += 1
            continue
        if triangle[s] < 0:
            continue
        owner = object_of_triangle[triangle[s]]
        nearest[owner] = min(nearest[owner], depth[s])
        for j in range(start, k):
            o = object_of_triangle[tie_triangle[j]]
            nearest[o] = min(nearest[o], depth[s])


# What `judge_samples` says of a sample at which something was left out: nothing, or all that it
# shows is lost for certain, or whether anything is lost hangs on an alpha mask.
KEPT, LOST, UNDECIDED = 0, 1, 2


class Owned(NamedTuple):
    """Who owns which samples of a frame: `triangle`, flat, -1 for none; further triangles at
    the owner's depth, `tie_triangle` at `tie_sample`, ascending; and at the samples
    `doubt_sample`, ascending, the triangles that may be seen before the owner,
    `doubt_triangle[doubt_offsets[i]:doubt_offsets[i + 1]]`."""

    triangle: NDArray[np.int32]
    tie_sample: NDArray[np.int64]
    tie_triangle: NDArray[np.int32]
    doubt_sample: NDArray[np.int64]
    doubt_offsets: NDArray[np.int64]
    doubt_triangle: NDArray[np.int32]


class Tally(NamedTuple):
    """What a drawn set shows and loses, (n,) arrays over objects, filled in by `judge_samples`:
    `shows`, `lost`, `lost_sample`, and `charged`: an object's samples, lost for certain,
    at which a mask leaves open whether it would be seen itself. `lost_triangle`: (t,) bool, those
    that own a lost sample."""

    shows: NDArray[np.bool_]
    lost: NDArray[np.int64]
    lost_sample: NDArray[np.int64]
    charged: NDArray[np.int64]
    lost_triangle: NDArray[np.bool_]


@njit()
def judge_samples(
    owned: Owned,
    drawn: NDArray[Any],
    object_of_triangle: NDArray[Any],
    tally: Tally,
    lost_at: NDArray[Any],
) -> tuple[int, int]:
    """One pass over a frame's samples; returns how many are lost, and how many undecided.

    A decided sample is lost if no triangle at its nearest depth was drawn. Where a mask leaves
    the owner open, the sample is kept if all that may be seen was drawn, lost if none of it was
    and the last of it is certain, and undecided otherwise. `lost_at`: (samples,) uint8, what
    was said where anything was left out.
    """
    # Each array by a name of its own: numba counts references to a tuple's at every access.
    triangle, tie_sample, tie_triangle = owned.triangle, owned.tie_sample, owned.tie_triangle
    doubt_sample, doubt_offsets = owned.doubt_sample, owned.doubt_offsets
    doubt_triangle = owned.doubt_triangle
    shows, lost, lost_sample = tally.shows, tally.lost, tally.lost_sample
    charged, lost_triangle = tally.charged, tally.lost_triangle
    lost_samples, undecided = 0, 0
    k, d = 0, 0
    next_tie = tie_sample[0] if tie_sample.size else triangle.size
    next_doubt = doubt_sample[0] if doubt_sample.size else triangle.size
    for s in range(triangle.size):
        t = triangle[s]
        if s < next_tie and s < next_doubt:
            # One owner or none, for certain: nearly every sample.
            if t < 0:
                continue
            o = object_of_triangle[t]
            if drawn[t]:
                shows[o] = True
                continue
            lost_samples += 1
            lost_at[s] = LOST
            lost_triangle[t] = True
            if lost_sample[o] < 0:
                lost_sample[o] = s
            lost[o] += 1
            continue
        start = k
        while k < tie_sample.size and tie_sample[k] == s:
            k += 1
        next_tie = tie_sample[k] if k < tie_sample.size else triangle.size
        shown = t >= 0 and drawn[t]
        for j in range(start, k):
            shown = shown or drawn[tie_triangle[j]]
        in_doubt = s == next_doubt
        if in_doubt:
            any_before, all_before = False, True
            for j in range(doubt_offsets[d], doubt_offsets[d + 1]):
                here = drawn[doubt_triangle[j]]
                any_before, all_before = any_before or here, all_before and here
            d += 1
            next_doubt = doubt_sample[d] if d < doubt_sample.size else triangle.size
            if all_before and (t < 0 or shown):
                continue
            if any_before or t < 0 or shown:
                undecided += 1
                lost_at[s] = UNDECIDED
                continue
        elif t < 0:
            continue
        if not shown:
            lost_samples += 1
            lost_at[s] = LOST
        for j in range(start - 1, k):
            u = t if j < start else tie_triangle[j]
            o = object_of_triangle[u]
            if drawn[u]:
                shows[o] = True
            elif not shown:
                lost_triangle[u] = True
                if lost_sample[o] < 0:
                    lost_sample[o] = s
                # Ties at a sample are sorted by triangle, so each object counts once.
                repeated = False
                for i in range(start - 1, j):
                    earlier = t if i < start else tie_triangle[i]
                    repeated = repeated or object_of_triangle[earlier] == o
                if not repeated:
                    lost[o] += 1
                    if in_doubt:
                        charged[o] += 1
    return lost_samples, undecided


@njit()
def unit_bounds(
    vertices: NDArray[Any],
    triangles: NDArray[Any],
    offsets: NDArray[Any],
    unit_triangles: NDArray[Any],
    bounds: NDArray[Any],
) -> None:
    """Fill in each unit's least and greatest corner, (u, 2, 3); (+inf, -inf) if it is empty.
    Triangles that are not there, all of one vertex, count for nothing."""
    for unit in range(len(offsets) - 1):
        for axis in range(3):
            bounds[unit, 0, axis], bounds[unit, 1, axis] = np.inf, -np.inf
        for k in range(offsets[unit], offsets[unit + 1]):
            t = unit_triangles[k]
            if triangles[t, 0] == triangles[t, 1] == triangles[t, 2]:
                continue
            for corner in range(3):
                vertex = triangles[t, corner]
                for axis in range(3):
                    value = vertices[vertex, axis]
                    bounds[unit, 0, axis] = min(bounds[unit, 0, axis], value)
                    bounds[unit, 1, axis] = max(bounds[unit, 1, axis], value)
