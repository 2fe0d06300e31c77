"""What lies before the opaque owners: masked triangles, by their textures, and blended ones."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.exact.contests import Contest
from visref.masks.lookup import BETWEEN, SOLID
from visref.picking import distinct
from visref.scene import Float64, Int32, Int64, Scene
from visref.visibility import BACKGROUND, BlendVisibility, Doubt, Ties, mask_states


class Arithmetic(Protocol):
    """What is asked of `visref.exact.scene.ExactScene` here.

    `compare`: of (k,) pairs of int32 triangle ids at (k,) int64 flat samples, (k,) int8, -1 where
    the first is nearer. `front`: changes `owner`, (samples,) int32, in place and returns who is
    tied, (k,) int64 samples and (k,) int32 triangle ids. `depth_by_layer`: of (k,) samples and
    triangle ids, (k,) float64 view depths.
    """

    scene: Scene

    def compare(
        self, camera: Camera, first: Int32, second: Int32, samples: Int64
    ) -> NDArray[np.int8]: ...

    def front(self, camera: Camera, contest: Contest, owner: Int32) -> tuple[Int64, Int32]: ...

    def depth_by_layer(self, camera: Camera, sample: Int64, triangle: Int32) -> Float64: ...


def masked(
    exact: Arithmetic, camera: Camera, hits: Contest, owner: Int32, ties: Ties
) -> tuple[Ties, Doubt, Int64]:
    """Let masked triangles own, or put in doubt, the samples where they are met.

    `hits`: every hit of a masked triangle before its sample's owner or level with it. A solid
    one contends with `owner`, (samples,) int32, which is changed in place; a hole is nothing;
    what is in between puts the sample in doubt. Returns the ties, the doubt, and the samples
    whose owner has changed, ascending.
    """
    state = mask_states(exact.scene, camera, hits.sample, hits.triangle)
    solid, between = hits.where(state == SOLID), hits.where(state == BETWEEN)
    moved = np.zeros(0, np.int64)
    if len(solid.sample):
        moved = distinct(solid.sample)
        before = owner[moved]
        at, triangle = exact.front(camera, solid, owner)
        # Who was tied with an owner that is hidden now is hidden too.
        still = owner[moved] == before
        still |= np.isin(moved * len(exact.scene.triangles) + before,
                         at * len(exact.scene.triangles) + triangle)  # fmt: skip
        kept = ~np.isin(ties.sample, moved[~still])
        sample = np.concatenate([ties.sample[kept], at])
        triangles = np.concatenate([ties.triangle[kept], triangle])
        order = np.lexsort((triangles, sample))
        ties = Ties(sample[order], triangles[order])
    behind = owner[between.sample]
    kept = np.ones(len(between.sample), np.bool_)
    some = np.flatnonzero(behind != BACKGROUND)
    result = exact.compare(camera, between.triangle[some], behind[some], between.sample[some])
    kept[some] = result <= 0
    between = between.where(kept)
    depth = exact.depth_by_layer(camera, between.sample, between.triangle)
    order = np.lexsort((between.triangle, depth, between.sample))
    return ties, Doubt.of(between.sample[order], between.triangle[order]), moved


def blended(
    exact: Arithmetic, camera: Camera, hits: Contest, doubt: Doubt
) -> tuple[BlendVisibility, Int32]:
    """Blended triangles that are seen for certain, of `hits` before their samples' owners: where
    a mask leaves the owner open, those before all that it may be. And the triangles, (k,) int32
    ids, ascending, that are seen where one of those is a hole."""
    kept = np.ones(len(hits.sample), np.bool_)
    place = np.searchsorted(doubt.sample, hits.sample)
    place[place == len(doubt)] = 0
    open_ = np.flatnonzero(doubt.sample[place] == hits.sample) if len(doubt) else place[:0]
    sizes = np.diff(doubt.offsets)
    for rank in range(int(sizes.max(initial=0))):
        some = open_[sizes[place[open_]] > rank]
        rival = doubt.triangle[doubt.offsets[place[some]] + rank]
        kept[some] &= exact.compare(camera, hits.triangle[some], rival, hits.sample[some]) < 0
    veiled = np.unique(hits.triangle[~kept])
    hits = hits.where(kept)
    depth = exact.depth_by_layer(camera, hits.sample, hits.triangle)
    return BlendVisibility.of(exact.scene, hits.sample, hits.triangle, depth), veiled
