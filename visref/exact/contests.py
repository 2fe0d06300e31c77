"""Contests: the samples that the bounds leave open, with every triangle that may own them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Int32, Int64


class Contest(NamedTuple):
    """(sample, triangle) pairs: `sample` (k,) int64 flat indices, `triangle` (k,) int32 ids,
    `state` (k,) uint8, what `visref.exact.raster` knows of each."""

    sample: Int64
    triangle: Int32
    state: NDArray[np.uint8]

    def where(self, kept: NDArray[Any]) -> Contest:
        """The pairs that `kept`, (k,) bool or indices, picks."""
        return Contest(self.sample[kept], self.triangle[kept], self.state[kept])


@njit(error_model="numpy")
def group(
    sample: NDArray[Any],
    triangle: NDArray[Any],
    state: NDArray[Any],
    owner: NDArray[Any],
    owner_state: int,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.uint8]]:
    """A contest sorted by sample, then triangle, each sample's owner among them.

    `sample`, `triangle`, `state`: (k,), as of a `Contest`, in any order. `owner`: (samples,)
    int32 triangle ids, -1 for none; owners come with `owner_state`. Returns the same three, one
    entry more for each sample that has an owner.
    """
    ends = np.zeros(len(owner) + 1, np.int64)
    for s in sample:
        if ends[s + 1] == 0 and owner[s] >= 0:
            ends[s + 1] = 1
        ends[s + 1] += 1
    for s in range(len(owner)):
        ends[s + 1] += ends[s]
    total = ends[len(owner)]
    out_sample = np.full(total, -1, np.int64)
    out_triangle = np.empty(total, np.int32)
    out_state = np.empty(total, np.uint8)
    # Owners come first; then `ends[s]` moves on to the end of s's group.
    for s in range(len(owner)):
        if ends[s + 1] > ends[s] and owner[s] >= 0:
            out_sample[ends[s]], out_triangle[ends[s]] = s, owner[s]
            out_state[ends[s]] = owner_state
            ends[s] += 1
    for index in range(len(sample)):
        s = sample[index]
        place = ends[s]
        ends[s] += 1
        t, what = triangle[index], state[index]
        while place > 0 and out_sample[place - 1] == s and out_triangle[place - 1] > t:
            out_triangle[place] = out_triangle[place - 1]
            out_state[place] = out_state[place - 1]
            out_sample[place] = s
            place -= 1
        out_sample[place], out_triangle[place], out_state[place] = s, t, what
    return out_sample, out_triangle, out_state


@njit(error_model="numpy")
def level_groups(
    sample: NDArray[Any], triangle: NDArray[Any], plane: NDArray[Any]
) -> NDArray[np.bool_]:
    """Of a grouped contest of covering triangles, (k,), which pairs belong to samples where all
    lie in one plane: they tie. (k,) bool. `plane`: (t,) int64, each triangle's plane."""
    result = np.zeros(len(sample), np.bool_)
    start = 0
    while start < len(sample):
        end, level = start + 1, True
        while end < len(sample) and sample[end] == sample[start]:
            level = level and plane[triangle[end]] == plane[triangle[start]]
            end += 1
        result[start:end] = level
        start = end
    return result


@njit(error_model="numpy")
def crown(
    sample: NDArray[Any], triangle: NDArray[Any], level: NDArray[Any], owner: NDArray[Any]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Of a grouped contest's `level` pairs, the nearest ones, write the least triangle of each
    sample to `owner` (-1 where none is level), and return the others.

    `sample`, `triangle`, `level`: (k,) int64, int32 and bool; `owner`: (samples,) int32. The
    others: two (n,) arrays, samples and triangles.
    """
    further_sample = np.empty(len(sample), np.int64)
    further_triangle = np.empty(len(sample), np.int32)
    count = 0
    for s in sample:
        owner[s] = -1
    for index in range(len(sample)):
        s, t = sample[index], triangle[index]
        if not level[index]:
            continue
        if owner[s] < 0:
            owner[s] = t
        else:
            further_sample[count], further_triangle[count] = s, t
            count += 1
    return further_sample[:count].copy(), further_triangle[:count].copy()
