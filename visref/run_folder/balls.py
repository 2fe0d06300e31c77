"""Balls about neighbouring triangles, so that whole blocks of them are passed over at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Triangles that share a ball, which a ray tests first: neighbours in a mesh are near each other.
BLOCK = 64
# The ball test takes some 20 roundings (2^-53) on the sizes of its terms, and |d| |w| is at most
# three times the sums of components: far outward, since a ball too large only costs time.
BALL_ERROR = 2.0**-40


def balls_about(corners: NDArray[Any]) -> NDArray[np.float64]:
    """(blocks, 4) float64: a ball about the box of each `BLOCK` triangles."""
    starts = np.arange(0, len(corners), BLOCK)
    if not len(starts):
        return np.zeros((0, 4))
    low = np.minimum.reduceat(corners.min(axis=1), starts, axis=0).astype(np.float64)
    high = np.maximum.reduceat(corners.max(axis=1), starts, axis=0).astype(np.float64)
    # Half the diagonal; BALL_ERROR covers the roundings of centre and radius.
    centre, radius = (low + high) / 2.0, np.linalg.norm(high - low, axis=1) / 2.0
    size = np.abs(centre).sum(axis=1) + radius
    return np.column_stack([centre, radius + BALL_ERROR * size])
