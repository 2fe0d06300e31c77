"""A railway yard, with trains on curves, their smoke, and birds."""

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
from visref.conformance.building import box
from visref.conformance.moving import about, moved

# Of each track: where its circle has its middle and its radius, and by how much a train turns.
TRACKS = (
    ((-34.0, -22.0), 34.0, 0.07),
    ((30.0, -30.0), 31.0, -0.065),
    ((2.0, -38.0), 16.0, 0.11),
    ((-6.0, -46.0), 30.0, -0.08),
)
WAGONS, PUFFS, BIRDS = 5, 10, 60


@cache
def railway() -> Place:
    """Trains go around and leave puffs of smoke, which stay where they were left and rise; birds
    fly across, and spread their wings as they do."""
    rng = np.random.default_rng(311)
    objects: Objects = [("ground", box((-80, -0.4, -95), (80, 0, 25)))]
    for n, ((x, z), radius, _) in enumerate(TRACKS):
        for m in range(WAGONS + 1):
            a = 2 * np.pi * 0.12 * n - np.sign(TRACKS[n][2]) * 5.6 * m / radius
            at = (x + radius * np.cos(a), 0.3, z - radius * np.sin(a))
            body = box((-0.9, 0, -2.5), (0.9, 2.4 if m else 3.0, 2.5))
            name = f"wagon {n}-{m}" if m else f"engine {n}"
            objects.append((name, put(body, at, turn=-a)))
            if not m:
                for p in range(PUFFS):
                    puff = prism(7, rng.uniform(0.4, 0.7), rng.uniform(0.8, 1.4))
                    objects.append((f"puff {n}-{p}", put(puff, (at[0], 3.4, at[2]))))
    for n in range(44):
        x, z = rng.uniform(-45, 45), rng.uniform(-80, 6)
        size = rng.uniform((1.5, 1.5, 1.5), (5.0, 4.0, 4.0))
        objects.append((f"shed {n}", box((x, 0, z), (x + size[0], size[1], z + size[2]))))
    for n in range(30):
        at = (rng.uniform(-35, 35), 0, rng.uniform(-70, 10))
        objects.append((f"signal {n}", put(prism(5, 0.12, rng.uniform(3, 5)), at)))
    flights = []
    for n in range(BIRDS):
        at = np.array([rng.uniform(-16, 16), rng.uniform(1.5, 5.0), rng.uniform(-28, 8)])
        objects.append((f"bird {n}", put(box((-0.45, -0.12, -0.3), (0.45, 0.12, 0.3)), at)))
        flights.append((f"bird {n}", at, rng.uniform(-1, 1, 3) * (0.7, 0.03, 0.4)))
    t = np.linspace(0, 1, 32)
    eyes = np.stack([-8 + 18 * t, np.full(32, 2.2), 14 - 20 * t], axis=1)
    cameras = views(eyes, heading(0.85 * np.sin(9 * t), 0.08 * np.cos(8 * t)))
    frames = []
    for k, one in enumerate(cameras):
        poses = {}
        for n, ((x, z), _, pace) in enumerate(TRACKS):
            for name in (f"engine {n}", *(f"wagon {n}-{m}" for m in range(1, WAGONS + 1))):
                poses[name] = about((x, 0.0, z), pace * k, axis=1)
            for p in range(PUFFS):
                # Each is left anew after so many frames.
                since = (k + p) % PUFFS
                left = about((x, 0.0, z), pace * (k - since), axis=1)
                poses[f"puff {n}-{p}"] = moved(y=0.2 * since) @ left
        for name, at, pace in flights:
            wide = np.diag([3.6 + 2.2 * np.sin(0.8 * k + at[0]), 1.0, 1.0, 1.0])
            poses[name] = moved(*(k * pace)) @ moved(*at) @ wide @ moved(*-at)
        frames.append(Frame((one,), world_from_object=poses))
    return Place(scene_of(objects), CameraPath(frames))
