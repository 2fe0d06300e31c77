"""Whose samples a silhouette's are: visible, undecided, or another object's."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Scene
from visref.visibility import BACKGROUND, FrameTruth, blended_beside

# What `Owners.at` says besides an object's id. Below the last: number -(value - TIED) of the ties.
UNDECIDED, TIED = -2, -3


class Owners(NamedTuple):
    """A frame's truth by object. `at`: (samples,) int32, the owner's id, `BACKGROUND`, `UNDECIDED`,
    or a tie; tie i is between the objects `tied[offsets[i]:offsets[i + 1]]`, ascending. Glass that
    is seen: object o is at the samples `glass[glass_offsets[o]:glass_offsets[o + 1]]`, ascending,
    that it does not own besides."""

    at: NDArray[np.int32]
    offsets: NDArray[np.int64]
    tied: NDArray[np.int32]
    glass_offsets: NDArray[np.int64]
    glass: NDArray[np.int64]


class Tally(NamedTuple):
    """By object, (n,) int64 arrays: its `visible` samples, those of its silhouette that are
    `undecided`, and that have a depth at all (`hit`). `boxes`: (n, 4) int64, first and last column
    and row of what is visible. `hidden`: (h, 3) int64, object, who hides it, and at how many
    samples; ascending objects."""

    visible: NDArray[np.int64]
    undecided: NDArray[np.int64]
    hit: NDArray[np.int64]
    boxes: NDArray[np.int64]
    hidden: NDArray[np.int64]


def owners_of(truth: FrameTruth, scene: Scene) -> Owners:
    """A frame's truth by object."""
    triangle = truth.buffer.triangle.reshape(-1)
    objects = scene.object_of_triangle
    at = np.full(len(triangle), BACKGROUND, np.int32)
    owned = triangle >= 0
    at[owned] = objects[triangle[owned]]
    tied, offsets = np.zeros(0, np.int32), np.zeros(1, np.int64)
    if len(truth.ties.sample):
        samples = np.unique(truth.ties.sample)
        pairs = np.concatenate(
            [
                np.stack([truth.ties.sample, objects[truth.ties.triangle]], axis=1),
                np.stack([samples, at[samples]], axis=1),
            ]
        )
        pairs = np.unique(pairs, axis=0)
        first, counts = np.unique(pairs[:, 0], return_counts=True)
        # Of several objects, not of one object's triangles.
        kept = np.repeat(counts > 1, counts)
        tied = pairs[kept, 1].astype(np.int32)
        several = counts[counts > 1]
        offsets = np.concatenate([[0], np.cumsum(several)]).astype(np.int64)
        at[first[counts > 1]] = TIED - np.arange(len(several))
    at[truth.undecided] = UNDECIDED
    glass = blended_beside(truth, scene)
    seen = np.unique(np.stack([glass.object.astype(np.int64), glass.sample], axis=1), axis=0)
    edges = np.searchsorted(seen[:, 0], np.arange(scene.object_count + 1))
    return Owners(at, offsets, tied, edges.astype(np.int64), seen[:, 1].copy())


@njit(error_model="numpy", inline="always")
def _is_tied(owners: Owners, value: int, object_: int) -> bool:
    tie = TIED - value
    for i in range(owners.offsets[tie], owners.offsets[tie + 1]):
        if owners.tied[i] == object_:
            return True
    return False


@njit(error_model="numpy")
def owned_outside(runs: NDArray[Any], width: int, owners: Owners) -> NDArray[np.int64]:
    """Samples that an object owns, or where its glass is seen, and its silhouette lacks: (k, 2)
    int64, object and sample. An engine that rounds has such at edges."""
    at = owners.at
    inside = np.zeros(len(at), np.bool_)
    glass_inside = np.zeros(len(owners.glass), np.bool_)
    for r in range(len(runs)):
        o, start = runs[r, 0], runs[r, 1] * width
        for sample in range(start + runs[r, 2], start + runs[r, 3] + 1):
            if at[sample] == o:
                inside[sample] = True
        first, last = owners.glass_offsets[o], owners.glass_offsets[o + 1]
        if first < last:
            own = owners.glass[first:last]
            low = np.searchsorted(own, start + runs[r, 2])
            high = np.searchsorted(own, start + runs[r, 3] + 1)
            glass_inside[first + low : first + high] = True
    count = 0
    for sample in range(len(at)):
        count += 1 if at[sample] >= 0 and not inside[sample] else 0
    for i in range(len(glass_inside)):
        count += 0 if glass_inside[i] else 1
    result = np.empty((count, 2), np.int64)
    count = 0
    for sample in range(len(at)):
        if at[sample] >= 0 and not inside[sample]:
            result[count, 0], result[count, 1] = at[sample], sample
            count += 1
    for o in range(len(owners.glass_offsets) - 1):
        for i in range(owners.glass_offsets[o], owners.glass_offsets[o + 1]):
            if not glass_inside[i]:
                result[count, 0], result[count, 1] = o, owners.glass[i]
                count += 1
    return result


@njit(error_model="numpy")
def tally(runs: NDArray[Any], width: int, objects: int, owners: Owners) -> Tally:
    """Go over the samples of all silhouettes; `runs` as `Silhouettes` has them, which hold all that
    anything owns."""
    at, offsets, tied, glass_offsets, glass = owners
    visible = np.zeros(objects, np.int64)
    undecided = np.zeros(objects, np.int64)
    hit = np.zeros(objects, np.int64)
    boxes = np.empty((objects, 4), np.int64)
    for o in range(objects):
        boxes[o, 0], boxes[o, 1] = width, -1
        boxes[o, 2], boxes[o, 3] = len(at), -1
    by = np.zeros(objects, np.int64)
    touched = np.empty(objects, np.int64)
    hidden = np.empty((1024, 3), np.int64)
    count, touching = 0, 0
    next_glass = 0
    for r in range(len(runs)):
        o, y = runs[r, 0], runs[r, 1]
        if r == 0 or runs[r - 1, 0] != o:
            next_glass = glass_offsets[o]
        for x in range(runs[r, 2], runs[r, 3] + 1):
            sample = y * width + x
            value = at[sample]
            if value >= 0 or value <= TIED:
                hit[o] += 1
            while next_glass < glass_offsets[o + 1] and glass[next_glass] < sample:
                next_glass += 1
            seen = next_glass < glass_offsets[o + 1] and glass[next_glass] == sample
            seen = seen or value == o or (value <= TIED and _is_tied(owners, value, o))
            if seen:
                visible[o] += 1
                boxes[o, 0], boxes[o, 1] = min(boxes[o, 0], x), max(boxes[o, 1], x)
                boxes[o, 2], boxes[o, 3] = min(boxes[o, 2], y), max(boxes[o, 3], y)
            elif value == UNDECIDED:
                undecided[o] += 1
            elif value >= 0:
                if by[value] == 0:
                    touched[touching] = value
                    touching += 1
                by[value] += 1
            elif value <= TIED:
                for i in range(offsets[TIED - value], offsets[TIED - value + 1]):
                    if by[tied[i]] == 0:
                        touched[touching] = tied[i]
                        touching += 1
                    by[tied[i]] += 1
        if r == len(runs) - 1 or runs[r + 1, 0] != o:
            if count + touching > len(hidden):
                more = np.empty((2 * (count + touching), 3), np.int64)
                more[:count] = hidden[:count]
                hidden = more
            for i in range(touching):
                hidden[count, 0], hidden[count, 1] = o, touched[i]
                hidden[count, 2] = by[touched[i]]
                by[touched[i]] = 0
                count += 1
            touching = 0
    return Tally(visible, undecided, hit, boxes, hidden[:count].copy())


@njit(error_model="numpy")
def visible_runs(runs: NDArray[Any], width: int, owners: Owners) -> NDArray[np.int64]:
    """Of silhouettes that hold all that anything owns, what is visible, as runs too."""
    at, glass_offsets, glass = owners.at, owners.glass_offsets, owners.glass
    result = np.empty((1024, 4), np.int64)
    count = 0
    for r in range(len(runs)):
        o, y = runs[r, 0], runs[r, 1]
        own = glass[glass_offsets[o] : glass_offsets[o + 1]]
        next_glass = np.searchsorted(own, y * width + runs[r, 2])
        begin = -1
        for x in range(runs[r, 2], runs[r, 3] + 2):
            seen = False
            if x <= runs[r, 3]:
                sample = y * width + x
                value = at[sample]
                seen = value == o or (value <= TIED and _is_tied(owners, value, o))
                if next_glass < len(own) and own[next_glass] == sample:
                    seen = True
                    next_glass += 1
            if seen and begin < 0:
                begin = x
            if not seen and begin >= 0:
                if count == len(result):
                    more = np.empty((2 * count, 4), np.int64)
                    more[:count] = result
                    result = more
                result[count, 0], result[count, 1] = o, y
                result[count, 2], result[count, 3] = begin, x - 1
                count += 1
                begin = -1
    return result[:count].copy()
