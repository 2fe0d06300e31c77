"""A warehouse of rooms."""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.causes.reported.places.making import (
    Objects,
    Place,
    heading,
    put,
    scene_of,
    views,
)
from visref.camera_path import CameraPath
from visref.conformance.building import Mesh, box, together


@cache
def hall(**lens) -> Place:
    """Rooms of a warehouse in a row and beside each other, with doors, racks, pillars and goods."""
    rng = np.random.default_rng(8)
    objects: Objects = [
        ("floor", box((0, -0.3, 0), (48, 0, 36))),
        ("ceiling", box((0, 4.2, 0), (48, 4.5, 36))),
        ("north wall", box((0, 0, -0.3), (48, 4.2, 0))),
        ("south wall", box((0, 0, 36), (48, 4.2, 36.3))),
        ("west wall", box((-0.3, 0, 0), (0, 4.2, 36))),
        ("east wall", box((48, 0, 0), (48.3, 4.2, 36))),
    ]
    cells = [-1] * len(objects)

    def add(name: str, mesh: Mesh, cell: int) -> None:
        objects.append((name, mesh))
        cells.append(cell)

    for i in range(4):
        for k in range(3):
            x, z, cell = 12.0 * i, 12.0 * k, 3 * i + k
            gap = rng.uniform(2.0, 8.0)
            if i:
                ends = ((z, z + gap), (z + gap + 1.8, z + 12))
                walls = [box((x - 0.1, 0, a), (x + 0.1, 4.2, b)) for a, b in ends]
                add(f"wall {i}-{k} x", together(*walls), -1)
            if k:
                ends = ((x, x + gap), (x + gap + 1.8, x + 12))
                walls = [box((a, 0, z - 0.1), (b, 4.2, z + 0.1)) for a, b in ends]
                add(f"wall {i}-{k} z", together(*walls), -1)
            for n in range(3):
                at = np.array([x + 2.2 + 3.1 * n, 0, z + rng.uniform(1.5, 6.5)])
                rack = [box((0, y, 0), (0.9, y + 0.08, 3.4)) for y in (0.1, 1.1, 2.1, 3.0)]
                add(f"rack {cell}-{n}", put(together(*rack), at), cell)
                for shelf in range(4):
                    up = (0.18, 1.18, 2.18, 3.08)[shelf]
                    low = at + np.array([0.15, up, rng.uniform(0.1, 2.4)])
                    size = rng.uniform((0.3, 0.25, 0.3), (0.6, 0.7, 0.9))
                    add(f"goods {cell}-{n}-{shelf}", box(low, low + size), cell)
            for n in range(4):
                at = np.array([x + rng.uniform(1, 11), 0, z + rng.uniform(9.0, 11.3)])
                add(f"crate {cell}-{n}", box(at, at + rng.uniform(0.4, 1.1, 3)), cell)
    t = np.linspace(0, 1, 30)
    x = np.interp(t, [0, 0.4, 0.7, 1], [2, 20, 28, 45])
    z = np.interp(t, [0, 0.4, 0.7, 1], [11, 8.6, 20.5, 22])
    turn = np.interp(t, [0, 0.2, 0.4, 0.6, 0.8, 1], [1.6, 0.9, 2.0, 3.0, 1.4, 0.4])
    eyes = np.stack([x, np.full(30, 1.75), z], axis=1)
    path = CameraPath(views(eyes, heading(turn, -0.07), **{"yfov": 1.05, **lens}))
    return Place(scene_of(objects), path, cells=cells)
