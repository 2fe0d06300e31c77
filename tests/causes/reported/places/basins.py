"""A moon with deep basins."""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.causes.reported.places.making import Objects, Place, scene_of, views
from visref.camera_path import CameraPath
from visref.conformance.building import box


def _ground(lat, lon):
    """Points on the ground of the moon, whose mean radius is 100."""
    hollow = np.maximum(0.0, np.sin(4 * lon + 0.4) * np.cos(3 * lat))
    r = 100.0 - 4.0 * hollow + 0.4 * np.sin(11 * lat) * np.cos(13 * lon)
    return np.stack(
        [r * np.cos(lat) * np.sin(lon), r * np.sin(lat), r * np.cos(lat) * np.cos(lon)], axis=-1
    )


@cache
def basins() -> Place:
    """Tiles of the moon, and rocks on it, from low above it."""
    rng = np.random.default_rng(67)
    objects: Objects = []
    n = 5
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack(e, -1).reshape(-1, 3) for e in ((a, b, c), (a, c, d))])
    for i in range(10):
        for k in range(22):
            lats = -0.5 + 0.1 * (i + np.linspace(0, 1, n + 1))
            lons = -0.8 + 0.1 * (k + np.linspace(0, 1, n + 1))
            lat, lon = np.meshgrid(lats, lons, indexing="ij")
            objects.append((f"tile {i}-{k}", (_ground(lat, lon).reshape(-1, 3), faces)))
    for k in range(60):
        foot = _ground(np.array(rng.uniform(-0.4, 0.4)), np.array(rng.uniform(-0.7, 1.3)))
        size = rng.uniform(0.3, 1.2, 3)
        objects.append((f"rock {k}", box(foot - size, foot + size)))
    t = np.linspace(0, 1, 28)
    lat, lon = 0.2 * np.sin(5 * t), -0.5 + 1.0 * t
    up = _ground(lat, lon) / np.linalg.norm(_ground(lat, lon), axis=1, keepdims=True)
    eyes = 102.0 * up
    ahead = _ground(lat + 0.1 * np.sin(9 * t), lon + 0.3) - eyes
    return Place(scene_of(objects), CameraPath(views(eyes, ahead, near=0.3)))
