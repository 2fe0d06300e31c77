"""Blocks that are broken out of a rock face."""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.causes.reported.places.making import Objects, Place, heading, scene_of, views
from visref.camera_path import CameraPath, Frame
from visref.conformance.building import box

# Blocks of the face, along X, upwards and into the rock, and the side of a block.
FACE, SIDE = (13, 4, 5), 2.0


@cache
def quarry() -> Place:
    """A rock face of blocks, named by their places in it, which are broken out from the front."""
    rng = np.random.default_rng(75)
    objects: Objects = [("floor", box((-30, -0.5, -30), (30, 0, 20)))]
    wide, tall, deep = FACE
    cells = [(i, j, k) for i in range(wide) for j in range(tall) for k in range(deep)]
    for i, j, k in cells:
        low = np.array([SIDE * (i - wide / 2), SIDE * j, -SIDE * (k + 1) - 4.0])
        objects.append((f"block {i} {j} {k}", box(low, low + SIDE)))
    t = np.linspace(0, 1, 28)
    eyes = np.stack([-7 + 14 * t, np.full(28, 3.0), 5 + 2 * np.cos(6 * t)], axis=1)
    cameras = views(eyes, heading(0.35 * np.sin(5 * t), 0.04))
    broken: list[tuple[int, int, int]] = []
    frames = []
    for number, one in enumerate(cameras):
        frames.append(Frame((one,), absent=tuple(f"block {i} {j} {k}" for i, j, k in broken)))
        at = (wide - 1) * number / 27
        for _ in range(6):
            left = [cell for cell in cells if cell not in broken and cell[2] < deep - 1]
            open_ = [(i, j, k) for i, j, k in left if k == 0 or (i, j, k - 1) in broken]
            near = sorted(open_, key=lambda cell: abs(cell[0] - at) + rng.uniform(0, 9.0))
            broken.append(near[0])
    return Place(scene_of(objects), CameraPath(frames))
