"""A drawing on a board."""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.causes.reported.places.making import Objects, Place, scene_of, views
from visref.camera_path import CameraPath
from visref.conformance.building import box, panel


@cache
def drawing() -> Place:
    """Flat strokes on three sheets, seen without perspective: straight on, or askew in some
    frames."""
    rng = np.random.default_rng(167)
    objects: Objects = [("board", box((-14, -9, -0.3), (14, 9, 0)))]
    for n in range(170):
        x, y = rng.uniform(-12, 12), rng.uniform(-8, 8)
        long, thin = rng.uniform(0.5, 3.0), rng.uniform(0.1, 0.4)
        wide, high = (long, thin) if n % 2 else (thin, long)
        sheet = n % 3
        stroke = panel((x, x + wide), (y, y + high), 0.02 * (sheet + 1))
        objects.append((f"stroke {sheet}-{n}", stroke))
    t = np.linspace(0, 1, 24)
    eyes = np.stack([-8 + 16 * t, 3.5 * np.sin(7 * t), np.full(24, 12.0)], axis=1)
    ahead = np.tile([0.0, 0.0, -1.0], (24, 1))
    ahead[3::4, 0], ahead[2::4, 1] = 0.25, 0.3
    return Place(scene_of(objects), CameraPath(views(eyes, ahead, ymag=2.6, near=0.5, far=60.0)))
