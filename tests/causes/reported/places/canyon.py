"""A canyon, with needles of rock and pines of several levels of detail."""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.causes.reported.places.making import (
    Objects,
    Place,
    heading,
    prism,
    put,
    views,
    with_levels,
)
from visref.camera_path import CameraPath, Frame
from visref.conformance.building import together
from visref.scene import Group

# The levels of the pines end at so many metres.
PINE_ENDS = (11.0, 24.0)
PINES, TILE = 36, 8.0


def _rock(x, z):
    away = np.abs(x - 5 * np.sin(z / 14))
    return 10.0 / (1.0 + np.exp(0.9 * (7.5 - away))) + 0.5 * np.sin(x / 1.9) * np.cos(z / 2.3)


def _tiles() -> Objects:
    steps = np.linspace(0, TILE, 6)
    grid = np.array([[i * 6 + j, i * 6 + j + 1] for i in range(5) for j in range(5)])
    faces = np.concatenate([[(a, b, b + 6), (a, b + 6, a + 6)] for a, b in grid])
    objects: Objects = []
    for i in range(6):
        for k in range(14):
            x, z = np.meshgrid(TILE * (i - 3) + steps, TILE * (k - 12) + steps)
            points = np.stack([x.ravel(), _rock(x, z).ravel(), z.ravel()], axis=1)
            objects.append((f"tile {i}-{k}", (points, faces[:, ::-1])))
    return objects


@cache
def canyon(**lens) -> Place:
    """One goes into it and backs out, three times, while looking about."""
    rng = np.random.default_rng(205)
    objects = _tiles()
    groups, centres = [], []
    for n in range(PINES):
        z = 6.0 - 2.4 * n
        x = 5 * np.sin(z / 14) + rng.uniform(2.0, 6.5) * (-1, 1)[n % 2]
        tall, levels = rng.uniform(2.5, 4.5), []
        for level, sides in enumerate((8, 5, 3)):
            trunk, crown = prism(sides, 0.15, tall), prism(sides, 0.8, 0.6 * tall)
            mesh = together(trunk, put(crown, (0, 0.35 * tall, 0)))
            levels.append((len(objects),))
            objects.append((f"pine {n} level {level}", put(mesh, (x, float(_rock(x, z)), z))))
        every = tuple(one for level in levels for one in level)
        groups.append(Group(f"pine {n}", f"pine {n}", every, levels=tuple(levels)))
        centres.append((x, float(_rock(x, z)) + tall / 2, z))
    for n in range(70):
        z = rng.uniform(-90, 8)
        x = 5 * np.sin(z / 14) + rng.uniform(1.8, 6.5) * rng.choice((-1, 1))
        rock = prism(int(rng.integers(4, 8)), rng.uniform(0.3, 1.3), rng.uniform(0.4, 2.2))
        objects.append((f"boulder {n}", put(rock, (x, float(_rock(x, z)) - 0.2, z))))
    for n in range(16):
        z = 1.0 - 5.0 * n
        x = 5 * np.sin(z / 14) + rng.uniform(2.5, 5.0) * (-1, 1)[n // 2 % 2]
        needle = prism(7, rng.uniform(1.1, 1.8), rng.uniform(7.0, 10.0))
        objects.append((f"needle {n}", put(needle, (x, float(_rock(x, z)) - 0.5, z))))
    scene = with_levels(objects, groups)
    t = np.linspace(0, 1, 40)
    z = 8 - 26 * (1 - np.cos(6 * np.pi * t))
    x = 5 * np.sin(z / 14) + 1.2 * np.sin(19 * t)
    eyes = np.stack([x, _rock(x, z) + 1.7, z], axis=1)
    frames = []
    for one in views(eyes, heading(0.9 * np.sin(23 * t), 0.05 * np.sin(7 * t)), **lens):
        away = np.linalg.norm(np.array(centres) - one.eye, axis=1)
        levels = {f"pine {n}": int(v) for n, v in enumerate(np.searchsorted(PINE_ENDS, away))}
        frames.append(Frame((one,), levels=levels))
    return Place(scene, CameraPath(frames))
