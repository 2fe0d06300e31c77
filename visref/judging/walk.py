"""The walk over a frame's samples: what a drawn set shows of each object, and what it loses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref import kernels
from visref.scene import Int64, Scene
from visref.visibility import FrameTruth


@dataclass(frozen=True, eq=False)
class SampleWalk:
    """One pass over a frame's decided samples, (n,) arrays over all objects.

    `shows` bool: one of the object's own triangles was drawn where it is nearest. `lost`
    int64: its samples at which nothing at the nearest depth was drawn; `lost_sample` int64:
    the first of them, -1 if none. `missed_pixels`: such samples, each counted once.
    """

    shows: NDArray[np.bool_]
    lost: Int64
    lost_sample: Int64
    missed_pixels: int


def walk_samples(truth: FrameTruth, scene: Scene, drawn: NDArray[np.bool_]) -> SampleWalk:
    """What `drawn` ((t,) bool) shows of each object, and what it loses."""
    count = scene.object_count
    shows, lost = np.zeros(count, np.bool_), np.zeros(count, np.int64)
    lost_sample = np.full(count, -1, np.int64)
    missed_pixels = kernels.judge_samples(
        truth.buffer.triangle.reshape(-1),
        truth.decided,
        truth.ties.sample,
        truth.ties.triangle,
        drawn,
        scene.object_of_triangle,
        shows,
        lost,
        lost_sample,
    )
    return SampleWalk(shows, lost, lost_sample, int(missed_pixels))
