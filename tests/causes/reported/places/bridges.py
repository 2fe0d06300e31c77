"""A town on a canal."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from tests.causes.reported.places.making import (
    Objects,
    Place,
    heading,
    prism,
    put,
    scene_of,
    views,
)
from visref.camera_path import CameraPath, Frame
from visref.conformance.building import box, together


@cache
def bridges(*, headset: bool = False) -> Place:
    """Quarters of a town on both sides of a canal, with bridges, poplars and moored boats, from a
    boat. `cells`: the quarter of a street and of the houses in it. `headset`: in two views, whose
    lenses are shifted outward."""
    rng = np.random.default_rng(97)
    objects: Objects = [("water", box((-5, -2.2, -90), (5, -2, 20)))]
    cells = [-1]

    def add(name, mesh, cell=-1):
        objects.append((name, mesh))
        cells.append(cell)

    for n in range(9):
        z = 12.0 - 11.0 * n
        for side in (-1, 1):
            cell = 2 * n + (side > 0)
            low, high = sorted((side * 5.2, side * 22.0))
            add(f"street {cell}", box((low, -2.2, z - 10.8), (high, 0, z)), cell)
            for m in range(5):
                x, deep = side * rng.uniform(10, 18), rng.uniform(3.0, 4.5)
                at = (x, 0, z - 2.0 - 2.0 * m)
                house = box((-deep / 2, 0, -0.9), (deep / 2, rng.uniform(3, 8), 0.9))
                add(f"house {cell}-{m}", put(house, at), cell)
            for m in range(2):
                x, tall = side * rng.uniform(5.6, 6.4), rng.uniform(5.0, 9.0)
                poplar = prism(6, 0.35, tall)
                add(f"poplar {cell}-{m}", put(poplar, (x, 0, z - 2.5 - 5 * m)))
        if n % 2:
            pier = [box((x, -2, z - 6), (x + 0.6, 1.0, z - 4)) for x in (-5.4, 4.8)]
            deck = box((-6, 1.0, z - 6.2), (6, 1.4, z - 3.8))
            add(f"bridge {n}", together(*pier, deck))
        for m in range(3):
            at = ((-4.0, 3.6, 4.1)[m], -2.0, z - rng.uniform(1, 9))
            add(f"barge {n}-{m}", put(box((-0.5, 0, -1.5), (0.5, 0.9, 1.5)), at))
    t = np.linspace(0, 1, 30)
    eyes = np.stack([1.6 * np.sin(5 * t), np.full(30, -0.4), 15 - 58 * t], axis=1)
    ahead = heading(0.95 * np.sin(8 * t), 0.22 + 0.34 * np.sin(11 * t))
    cameras = views(eyes, ahead, **({"yfov": 1.2, "width": 132} if headset else {}))
    frames = []
    for one in cameras:
        each = [one]
        if headset:
            right, each = one.world_from_camera[:3, 0], []
            for name, way in (("left", -1), ("right", 1)):
                pose = one.world_from_camera.copy()
                pose[:3, 3] += 0.032 * way * right
                eye = replace(one, world_from_camera=pose, shift_x_px=way * 16.0)
                each.append(replace(eye, shift_y_px=3.0, view=name))
        frames.append(Frame(tuple(each)))
    return Place(scene_of(objects), CameraPath(frames), cells=cells)
