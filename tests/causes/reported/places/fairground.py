"""A fairground, on which almost everything turns."""

from __future__ import annotations

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
from visref.conformance.moving import about, moved


@cache
def fairground() -> Place:
    """Carousels, a big wheel and swing boats between stalls, and a stroll past them."""
    rng = np.random.default_rng(52)
    objects: Objects = [("lawn", box((-45, -0.3, -50), (45, 0, 25)))]
    turns = []
    for n, (x, z) in enumerate(((-13.0, -6.0), (12.0, -11.0), (-3.0, -26.0), (16.0, -31.0))):
        objects.append((f"platform {n}", put(prism(10, 4.6, 0.3), (x, 0, z))))
        objects.append((f"pole {n}", put(prism(6, 0.5, 3.4), (x, 0.3, z))))
        objects.append((f"canopy {n}", put(prism(10, 4.8, 0.5), (x, 3.4, z))))
        for m in range(9):
            a = 2 * np.pi * m / 9
            at = (x + 3.8 * np.cos(a), 0.6, z + 3.8 * np.sin(a))
            objects.append((f"horse {n}-{m}", put(box((-0.2, 0, -0.6), (0.2, 1.1, 0.6)), at)))
            turns.append((f"horse {n}-{m}", (x, 0.0, z), 0.22 + 0.06 * n))
    hub = np.array([1.0, 11.0, -16.0])
    legs = (box((0.4, 0, -17), (1.6, 11, -16.7)), box((0.4, 0, -15.3), (1.6, 11, -15)))
    objects.append(("wheel legs", together(*legs)))
    for n in range(14):
        objects.append((f"cabin {n}", put(box((-0.7, -1.2, -0.6), (0.7, 0.4, 0.6)), hub)))
    for n in range(6):
        at = np.array([-24.0 + 8.5 * n, 0, -20.0 - 1.5 * (n % 2)])
        frame = together(box((-0.2, 0, -0.2), (0.2, 4.5, 0.2)), box((-2, 0, -0.3), (2, 0.3, 0.3)))
        objects.append((f"gallows {n}", put(frame, at)))
        objects.append((f"boat {n}", put(box((-2.4, 0.5, 0.3), (2.4, 1.2, 1.3)), at)))
        turns.append((f"boat {n}", (at[0], 4.5, at[2]), None))
    for n in range(34):
        side = (-1, 1)[n % 2]
        x, z = side * rng.uniform(4.5, 7.5) + 8 * side * (n % 3), 14.0 - 1.7 * n
        wide, tall = rng.uniform(1.5, 2.8), rng.uniform(1.8, 2.9)
        stall = box((-wide / 2, 0, -0.9), (wide / 2, tall, 0.9))
        objects.append((f"stall {n}", put(stall, (x, 0, z), turn=rng.uniform(0, 3))))
        crate = box((-0.3, 0, -0.3), (0.3, 0.6, 0.3))
        objects.append((f"crate {n}", put(crate, (x - side * rng.uniform(1.6, 2.4), 0, z))))
    t = np.linspace(0, 1, 30)
    eyes = np.stack([2.5 * np.sin(5 * t), np.full(30, 1.7), 17 - 30 * t], axis=1)
    cameras = views(eyes, heading(0.85 * np.sin(8 * t), 0.12))
    frames = []
    for k, one in enumerate(cameras):
        poses = {}
        for n, (name, centre, pace) in enumerate(turns):
            swing = 1.1 * np.sin(0.9 * k + n)
            poses[name] = (
                about(centre, swing, axis=2) if pace is None else about(centre, pace * k, axis=1)
            )
        for n in range(14):
            a = 2 * np.pi * n / 14 + 0.24 * k
            poses[f"cabin {n}"] = moved(8.8 * np.cos(a), 8.8 * np.sin(a), 0.0)
        frames.append(Frame((one,), world_from_object=poses))
    return Place(scene_of(objects), CameraPath(frames))
