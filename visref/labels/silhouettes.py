"""Each object alone: the samples that would be its own if nothing else were there, exactly.

One pass over all triangles (`visref.labels.kernels`) decides what float64 can, `visref.exact` the
rest. What an alpha mask leaves open is decided as for the truth of a scene that holds the object
alone: a sample is undecided where a triangle that may be a hole there lies before all that is
certain, or level with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.exact.filters import View, view_of
from visref.exact.rational import ExactFrame
from visref.exact.scene import ExactScene
from visref.exact.screen import CHECK
from visref.labels.kernels import Grid, Hits, Mesh, Parts, collect, paint
from visref.labels.windows import Window
from visref.masks.lookup import BETWEEN, HOLE, SOLID
from visref.scene import Alpha, Float64, Int64, Scene
from visref.visibility import mask_states

Bool = NDArray[np.bool_]


@dataclass(eq=False)
class Silhouettes:
    """Objects alone in a window. `runs`: (r, 4) int64, object, row, first and last column, sorted,
    none touching the next; of none where nobody asked for them. By object, (n,) arrays: `samples`
    int64; `boxes` (n, 4) int64, first and last column and row, of what has samples; `depth`
    float64, the least view depth of its samples, inf where it has none. `undecided`: (u, 2) int64,
    object and sample (flat), sorted, which a mask leaves open."""

    window: Window
    runs: Int64
    samples: Int64
    boxes: Int64
    depth: Float64
    undecided: Int64

    def add(self, objects: Int64, samples: Int64, *, keep: bool = True) -> None:
        """Add samples (flat, (k,) int64) to objects, (k,) int64, that do not have them; no pair
        twice. `keep`: in `runs` too."""
        if not len(objects):
            return
        y, x = np.divmod(samples, self.window.width)
        np.add.at(self.samples, objects, 1)
        for column, places, worst in ((0, x, np.minimum), (1, x, np.maximum),
                                      (2, y, np.minimum), (3, y, np.maximum)):  # fmt: skip
            worst.at(self.boxes[:, column], objects, places)
        if keep:
            more = np.stack([objects, y, x, x], axis=1)
            self.runs = _merged(np.concatenate([self.runs, more]))


def silhouettes(exact: ExactScene, window: Window, wanted: Bool, *, keep: bool) -> Silhouettes:
    """The silhouettes of the objects `wanted`, (n,) bool, in a window of a camera that is relative
    to the scene's origin; with `keep` their runs too."""
    scene = exact.scene
    mesh = Mesh(exact.corners, exact.one_sided, exact.order)
    view = view_of(window)
    grid = Grid(window.column_a, window.row_b, view)
    objects, parts = _parts(exact, view, wanted)
    result = Silhouettes(
        window,
        np.zeros((0, 4), np.int64),
        np.zeros(scene.object_count, np.int64),
        np.tile(np.array([window.width, -1, window.height, -1]), (scene.object_count, 1)),
        np.full(scene.object_count, np.inf),
        np.zeros((0, 2), np.int64),
    )
    masks = np.zeros(scene.object_count, np.bool_)
    masks[scene.object_of_triangle[scene.alpha == Alpha.MASK]] = True
    plain, masked = np.flatnonzero(~masks[objects]), np.flatnonzero(masks[objects])

    def work(some: Int64) -> list[tuple[Int64, ...]]:
        return [
            (*paint(mesh, parts, grid, int(first), int(last), keep), np.arange(first, last))
            for first, last in _stretches(some)
        ]

    painted = [one for part in exact.in_parallel(work, plain) for one in part]
    if painted:
        _take(result, scene, objects, painted, keep)
    alone = exact.in_parallel(
        lambda some: [_masked(scene, window, collect(mesh, parts, grid, int(i))) for i in some],
        masked,
    )
    found = [one for part in alone for one in part]
    for place, one in zip(masked.tolist(), found, strict=True):
        own = int(objects[place])
        result.add(np.full(len(one.samples), own), one.samples, keep=False)
        result.depth[own] = one.depth
    if found:
        sizes = [len(one.samples) for one in found]
        y, x = np.divmod(np.concatenate([one.samples for one in found]), window.width)
        owners = np.repeat(objects[masked], sizes)
        if keep:
            more = np.stack([owners, y, x, x], axis=1)
            result.runs = _merged(np.concatenate([result.runs, more]))
        open_ = [
            np.stack([np.full(len(one.undecided), own), one.undecided], axis=1)
            for own, one in zip(objects[masked], found, strict=True)
        ]
        result.undecided = np.concatenate(open_)
    return result


def _stretches(some: Int64) -> list[tuple[int, int]]:
    """Ascending places as (first, last + 1) of those without gaps."""
    breaks = np.flatnonzero(np.diff(some) != 1) + 1
    return [(int(one[0]), int(one[-1]) + 1) for one in np.split(some, breaks) if len(one)]


def _parts(exact: ExactScene, view: View, wanted: Bool) -> tuple[Int64, Parts]:
    """The objects, (k,) ids, of which a triangle may be seen, and these triangles."""
    scene = exact.scene
    of_place = scene.object_of_triangle[exact.order]
    found, boxes, keys = exact.project(view, wanted[of_place], np.zeros((0, 0), np.bool_), 0.0)
    owner = of_place[found]
    # Then by triangle, so that nothing depends on how clusters are cut.
    order = np.lexsort((exact.order[found], owner))
    objects, starts = np.unique(owner[order], return_index=True)
    offsets = np.append(starts, len(order)).astype(np.int64)
    check = keys[order, CHECK] != 0.0
    return objects.astype(np.int64), Parts(found[order], boxes[order], check, offsets)


def _take(
    result: Silhouettes, scene: Scene, objects: Int64, painted: list[tuple[Int64, ...]], keep: bool
) -> None:
    """Take over what was painted, and decide what that left open."""
    runs, samples, boxes, best, open_, places = (
        np.concatenate(column) for column in zip(*painted, strict=True)
    )
    own = objects[places]
    result.samples[own], result.boxes[own] = samples, boxes
    runs[:, 0] = objects[runs[:, 0]]
    result.runs = runs
    near = np.flatnonzero(best[:, 1] >= 0)
    if len(near):
        which = best[near, 1]
        frame = _exact_frame(scene, result.window, which)
        result.depth[own[near]] = frame.depth(np.arange(len(near)), best[near, 0])
    if len(open_):
        unique, which = np.unique(open_[:, 2], return_inverse=True)
        frame = _exact_frame(scene, result.window, unique)
        covers = frame.covers(which, open_[:, 1])
        at, which = open_[covers], which[covers]
        owners = objects[at[:, 0]]
        np.minimum.at(result.depth, owners, frame.depth(which, at[:, 1]))
        pairs = np.unique(np.stack([owners, at[:, 1]], axis=1), axis=0)
        result.add(pairs[:, 0], pairs[:, 1], keep=keep)


def _exact_frame(scene: Scene, window: Window, triangles: NDArray[Any]) -> ExactFrame:
    return ExactFrame(
        window, scene.vertices[scene.triangles[triangles]], scene.one_sided[triangles]
    )


@dataclass(frozen=True)
class _Alone:
    """One object's samples and those that are undecided, (k,) int64 flat, ascending, and its least
    view depth."""

    samples: Int64
    undecided: Int64
    depth: float


def _masked(scene: Scene, window: Window, hits: Hits) -> _Alone:
    """What an object with alpha masks has, of all hits of its triangles."""
    sample, triangle, certain, low, high = hits
    if not certain.all():
        covers = certain.copy()
        open_ = np.flatnonzero(~certain)
        unique, which = np.unique(triangle[open_], return_inverse=True)
        covers[open_] = _exact_frame(scene, window, unique).covers(which, sample[open_])
        sample, triangle, low, high = sample[covers], triangle[covers], low[covers], high[covers]
    alpha = scene.alpha[triangle]
    masked = np.flatnonzero(alpha == Alpha.MASK)
    state = np.full(len(sample), SOLID, np.uint8)
    # A window has all of a camera that is looked at here.
    looks = cast(Camera, window)
    state[masked] = mask_states(scene, looks, sample[masked], triangle[masked])
    there = state != HOLE
    order = np.argsort(sample[there], kind="stable")
    sample, triangle, low, high = (
        one[there][order] for one in (sample, triangle, low, high)
    )  # fmt: skip
    between = (state == BETWEEN)[there][order]
    blended = (alpha == Alpha.BLEND)[there][order]
    samples, starts = np.unique(sample, return_index=True)
    if not len(samples):
        return _Alone(samples, samples, np.inf)
    rank = np.repeat(np.arange(len(samples)), np.diff(np.append(starts, len(sample))))

    def greatest(some: Bool, keys: Float64) -> Float64:
        return np.maximum.reduceat(np.where(some, keys, -np.inf), starts)

    solid = ~between & ~blended
    doubtful = greatest(between, np.ones(len(sample))) > 0.0
    # Something that is certain lies before all that is open; or glass does.
    decided = greatest(solid, low) > greatest(between, high)
    decided |= greatest(blended, low) > greatest(between, high)
    never = np.maximum(greatest(solid, high), greatest(blended, high)) < greatest(between, low)
    for place in np.flatnonzero(doubtful & ~decided & ~never):
        some = np.flatnonzero(rank == place)
        frame = _exact_frame(scene, window, triangle[some])
        quotients = frame.quotients(np.arange(len(some)), sample[some])
        depths = np.array([Fraction(*one) for one in quotients], object)
        first = min(depths[between[some]])
        decided[place] = any(depth < first for depth in depths[~between[some]])
    undecided = doubtful & ~decided
    # Its nearest decided sample, by the key's lower bound.
    depth = np.inf
    kept = ~undecided[rank] & ~between
    if kept.any():
        nearest = int(np.argmax(np.where(kept, low, -np.inf)))
        if not kept[nearest]:
            nearest = int(np.argmax(kept))
        frame = _exact_frame(scene, window, triangle[nearest : nearest + 1])
        depth = float(frame.depth(np.zeros(1, np.int64), sample[nearest : nearest + 1])[0])
    return _Alone(samples[~undecided], samples[undecided], depth)


def _merged(runs: Int64) -> Int64:
    """Runs that do not overlap, sorted, those that touch made one."""
    runs = runs[np.lexsort((runs[:, 2], runs[:, 1], runs[:, 0]))]
    if not len(runs):
        return runs
    fresh = np.ones(len(runs), np.bool_)
    fresh[1:] = (np.diff(runs[:, :2], axis=0) != 0).any(axis=1) | (runs[1:, 2] > runs[:-1, 3] + 1)
    starts = np.flatnonzero(fresh)
    ends = np.append(starts[1:], len(runs)) - 1
    result = runs[starts]
    result[:, 3] = runs[ends, 3]
    return result
