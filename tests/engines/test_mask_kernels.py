"""Masked triangles are looked through front to back, and no further than anything shows."""

from __future__ import annotations

import numpy as np
import pytest

from visref.engines.mask_kernels import front_to_back
from visref.engines.splat_kernels import Hits


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
