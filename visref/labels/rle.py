"""Masks as COCO has them: run lengths down the columns, and their compressed text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Int64


def by_object(runs: Int64) -> Iterator[tuple[int, Int64]]:
    """Each object of some sorted runs, and its own."""
    objects, starts = np.unique(runs[:, 0], return_index=True)
    for object_id, own in zip(objects.tolist(), np.split(runs, starts[1:]), strict=False):
        if len(own):
            yield object_id, own


def segmentation(runs: Int64, width: int, height: int) -> dict[str, Any]:
    """A mask as COCO's compressed run lengths. `runs`: (r, 4) int64 of one object: itself, row,
    first and last column, sorted."""
    letters = _letters(_counts(runs, width, height))
    return {"size": [height, width], "counts": letters.tobytes().decode("ascii")}


def mask_of(runs: Int64, width: int, height: int) -> NDArray[np.bool_]:
    """(height, width) bool, the samples of some runs."""
    mask = np.zeros((height, width), np.bool_)
    _fill(runs, mask)
    return mask


@njit(error_model="numpy")
def _fill(runs: NDArray[Any], mask: NDArray[Any]) -> None:
    for r in range(len(runs)):
        mask[runs[r, 1], runs[r, 2] : runs[r, 3] + 1] = True


@njit(error_model="numpy")
def _counts(runs: NDArray[Any], width: int, height: int) -> NDArray[np.int64]:
    """How many samples are outside, inside, outside, …, down one column after another."""
    counts = np.empty(256, np.int64)
    if not len(runs):
        counts[0] = width * height
        return counts[:1]
    x0, x1 = runs[:, 2].min(), runs[:, 3].max()
    y0, y1 = runs[0, 1], runs[len(runs) - 1, 1]
    bits = np.zeros((x1 - x0 + 1, y1 - y0 + 1), np.bool_)
    for r in range(len(runs)):
        for x in range(runs[r, 2], runs[r, 3] + 1):
            bits[x - x0, runs[r, 1] - y0] = True
    # Of the run at hand; one that goes on in the next column is one.
    count, outside_from, begin, end = 0, 0, -1, -1
    for i in range(len(bits) + 1):
        for j in range(y1 - y0 + 1):
            last = i == len(bits)
            if not last and not bits[i, j]:
                continue
            at = (x0 + i) * height + y0 + j
            if not last and at == end and begin >= 0:
                end += 1
                continue
            if begin >= 0:
                if count + 3 > len(counts):
                    more = np.empty(2 * len(counts), np.int64)
                    more[:count] = counts[:count]
                    counts = more
                counts[count], counts[count + 1] = begin - outside_from, end - begin
                count, outside_from = count + 2, end
            if last:
                break
            begin, end = at, at + 1
    if outside_from < width * height:
        counts[count] = width * height - outside_from
        count += 1
    return counts[:count].copy()


@njit(error_model="numpy")
def _letters(counts: NDArray[Any]) -> NDArray[np.uint8]:
    """COCO's text of run lengths: each, from the third on less the one two before, in groups of
    five bits, the lowest first, with a bit that says whether more follow, as letters from '0'."""
    # A difference of two numbers below 2^31 takes seven groups.
    letters = np.empty(7 * len(counts), np.uint8)
    place = 0
    for i in range(len(counts)):
        value = counts[i]
        if i > 2:
            value -= counts[i - 2]
        more = True
        while more:
            group = value & 31
            value >>= 5
            more = value != (-1 if group & 16 else 0)
            letters[place] = group + (32 if more else 0) + 48
            place += 1
    return letters[:place].copy()
