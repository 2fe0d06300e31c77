"""Masked triangles are looked through front to back, and no further than anything shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from visref.engines import make_engine
from visref.engines.mask_kernels import front_to_back
from visref.engines.rays import RayEngine
from visref.engines.splat_kernels import Hits
from visref.visibility import FrameTruth
from visref_datasets_gen.dataset import scene_of
from visref_datasets_gen.leaf_cards import leaves


@pytest.mark.parametrize("seed", range(20))
def test_hits_stand_front_to_back_by_sample(seed: int) -> None:
    rng = np.random.default_rng(seed)
    width, (x0, x1, y0, y1) = 17, (3, 12, 5, 9)
    count = int(rng.integers(0, 3000))
    sample = rng.integers(y0, y1, count) * width + rng.integers(x0, x1, count)
    # Few depths, so that many are alike, and those of one triangle never.
    hits = Hits(
        sample.astype(np.int64),
        rng.permutation(count).astype(np.int32),
        rng.integers(0, 4, count).astype(np.float64),
        np.zeros(count),
    )
    order, starts = front_to_back(hits, (x0, x1, y0, y1), width)
    assert (order == np.lexsort((hits.triangle, hits.depth, hits.sample))).all()
    inside = (np.arange(y0, y1)[:, None] * width + np.arange(x0, x1)).ravel()
    assert (starts[:-1] == np.searchsorted(sample[order], inside)).all()
    assert starts[-1] == count


@pytest.mark.parametrize("view", range(3))
def test_the_order_in_which_masked_triangles_are_looked_at_is_seen_by_nobody(
    view: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = leaves(scale=0.1, frames=3)
    scene, camera = scene_of(dataset), dataset.path.cameras[view]
    camera = replace(camera, width=160, height=120)

    def seen() -> FrameTruth:
        engine = make_engine("embree", scene, threads=2)
        try:
            return engine.frame(camera).copy()
        finally:
            engine.close()

    usual = seen()
    assert len(usual.doubt) > 100
    rng = np.random.default_rng(view)
    orders: list[Callable[[int], NDArray[np.int64]]] = [
        lambda count: np.arange(count)[::-1],
        lambda count: rng.permutation(count),
    ]
    for order in orders:
        monkeypatch.setattr(RayEngine, "_by_depth", lambda self, nearest: order(len(nearest)))  # noqa: B023
        other = seen()
        assert (other.buffer.triangle == usual.buffer.triangle).all()
        for one, same in zip(astuple(other.doubt), astuple(usual.doubt), strict=True):
            assert (one == same).all()
