"""Tiles of hills, and of a globe."""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.causes.reported.places.making import (
    Objects,
    Place,
    heading,
    scene_of,
    views,
)
from visref.camera_path import CameraPath
from visref.conformance.building import box
from visref.scene import Float64


def height(x, z) -> Float64:
    """Of the hills, at any place."""
    ridge = 7 * np.exp(-((x - 8 * np.sin(z / 17)) ** 2) / 60) + 9 * np.exp(-((z + 25) ** 2) / 40)
    peaks = 5 * np.maximum(0, np.sin(x / 3.1) * np.sin(z / 3.7)) ** 3
    return ridge * (0.6 + 0.4 * np.sin(x / 9)) + peaks


@cache
def hills() -> Place:
    """A hundred and sixty-nine tiles of hilly ground, with huts, and a low flight over it."""
    objects: Objects = []
    steps = np.linspace(0, 8.0, 9)
    grid = np.array([[i * 9 + j, i * 9 + j + 1] for i in range(8) for j in range(8)])
    faces = np.concatenate([[(a, b, b + 9), (a, b + 9, a + 9)] for a, b in grid])
    for i in range(13):
        for k in range(13):
            x, z = np.meshgrid(8.0 * (i - 6.5) + steps, 8.0 * (k - 8.5) + steps)
            points = np.stack([x.ravel(), height(x, z).ravel(), z.ravel()], axis=1)
            objects.append((f"tile {i}-{k}", (points, faces[:, ::-1])))
    rng = np.random.default_rng(2)
    for n in range(40):
        x, z = rng.uniform(-45, 45), rng.uniform(-60, 28)
        y = float(height(x, z)) - 0.3
        objects.append((f"hut {n}", box((x, y, z), (x + 2, y + 1.9, z + 1.6))))
    t = np.linspace(0, 1, 28)
    x, z = 12 * np.sin(3 * t), 30 - 48 * t
    eyes = np.stack([x, height(x, z) + 2.4, z], axis=1)
    path = CameraPath(views(eyes, heading(0.8 * np.sin(5 * t), 0.08)))
    return Place(scene_of(objects), path)


@cache
def globe() -> Place:
    """Tiles of a rough globe, and towers on it, from an orbit low above it. Its radius is 100."""
    rng = np.random.default_rng(6)
    objects: Objects = []

    def point(lat, lon):
        r = 100 + 1.2 * np.sin(9 * lat) * np.cos(7 * lon)
        return np.stack(
            [r * np.cos(lat) * np.sin(lon), r * np.sin(lat), r * np.cos(lat) * np.cos(lon)], -1
        )

    n = 4
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    for i in range(12):
        for k in range(20):
            lats = np.linspace(-1.5 + 0.25 * i, -1.5 + 0.25 * (i + 1), n + 1)
            lons = np.linspace(0.1 * np.pi * k, 0.1 * np.pi * (k + 1), n + 1)
            lat, lon = np.meshgrid(lats, lons, indexing="ij")
            objects.append((f"tile {i}-{k}", (point(lat, lon).reshape(-1, 3), faces)))
    for k in range(60):
        foot = point(np.array(rng.uniform(-0.5, 0.5)), np.array(rng.uniform(-1.2, 1.8)))
        up = foot / np.linalg.norm(foot)
        east = np.cross((0, 1, 0), up)
        basis = np.stack([east / np.linalg.norm(east), up, np.cross(east, up)])
        points, tower = box((-0.8, -1, -0.8), (0.8, rng.uniform(2, 7), 0.8))
        objects.append((f"tower {k}", (points @ basis + foot, tower)))
    t = np.linspace(0, 1, 26)
    lat, lon = 0.3 * np.sin(4 * t), -0.6 + 1.2 * t
    eyes = 1.07 * point(lat, lon)
    ahead = point(lat + 0.1 * np.cos(9 * t), lon + 0.35) - eyes
    return Place(scene_of(objects), CameraPath(views(eyes, ahead, near=0.5)))
