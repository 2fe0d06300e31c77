"""Terraces of cubes, slabs and stairs, drawn as a map is."""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.causes.reported.places.making import Objects, Place, put, scene_of, views
from visref.camera_path import CameraPath
from visref.conformance.building import box, together

WIDE = 10


@cache
def terraces() -> Place:
    """Seen without perspective from above, along a diagonal: the eye is far off towards +X, +Y and
    +Z. A name ends in the cell of the grid that a thing stands in."""
    rng = np.random.default_rng(163)
    objects: Objects = [("rock", box((-4, -2, -4), (WIDE + 4, 0, WIDE + 4)))]
    stairs = together(box((0, 0, 0), (1, 0.5, 1)), box((0, 0.5, 0), (0.5, 1, 1)))
    for i in range(WIDE):
        for k in range(WIDE):
            # It falls towards the eye.
            tall = max(0, round(4.3 - 0.24 * (i + k) + rng.uniform(-0.9, 0.9)))
            for up in range(tall):
                objects.append((f"cube {i} {up} {k}", box((i, up, k), (i + 1, up + 1, k + 1))))
            kind = rng.uniform()
            if kind < 0.45:
                slab = box((i, tall, k), (i + 1, tall + 0.5, k + 1))
                objects.append((f"slab {i} {tall} {k}", slab))
            elif kind < 0.6:
                objects.append((f"stairs {i} {tall} {k}", put(stairs, (i, tall, k))))
    t = np.linspace(0, 1, 28)
    ahead = np.tile([-1.0, -0.95, -1.0], (28, 1))
    aside = np.array([1.0, 0, -1.0])
    middle = np.array([5.0, 1.5, 5.0]) + 3.5 * np.sin(7 * t)[:, None] * aside
    eyes = middle - 30 * ahead + 2.0 * np.sin(4 * t)[:, None] * np.array([0, 1.0, 0])
    path = CameraPath(views(eyes, ahead, ymag=3.4, near=1.0, far=120.0))
    return Place(scene_of(objects), path)
