"""Places in which things move, bend, come and go."""

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
from visref.conformance.moving import Bending, about, bent, moved, rigged


@cache
def plaza(*, leaving: bool = False, turning: bool = False, growing: bool = False) -> Place:
    """People walk in rings about columns and kiosks, as a camera strolls by. `leaving`: kiosks are
    taken down one by one, and people come. `turning`: what walks are long carts. `growing`: what
    stands there are balloons that are blown up."""
    rng = np.random.default_rng(23)
    objects: Objects = [("pavement", box((-40, -0.3, -40), (40, 0, 40)))]
    for n in range(22):
        a = 2 * np.pi * n / 22
        at = (19 * np.sin(a), 0, 19 * np.cos(a))
        objects.append((f"column {n}", put(prism(8, 0.55, 6.0), at)))
    for n in range(14):
        x, z = rng.uniform(-14, 14, 2)
        kiosk = box((-1.6, 0, -1.2), (1.6, 2.7, 1.2))
        objects.append((f"kiosk {n}", put(kiosk, (x, 0, z), turn=rng.uniform(0, 3))))
    walkers = []
    for n in range(70):
        radius, start = rng.uniform(4, 26), rng.uniform(0, 6.3)
        pace = rng.uniform(0.03, 0.11) * rng.choice((-1, 1))
        length = rng.uniform(1.0, 2.2) if turning else rng.uniform(0.15, 0.25)
        tall = rng.uniform(0.35, 0.6) if growing else rng.uniform(1.4, 1.9)
        where = np.array([radius * np.sin(start), 0, radius * np.cos(start)])
        figure = box((-0.22, 0.0, -length), (0.22, tall, length))
        objects.append((f"walker {n}", put(figure, where)))
        walkers.append((f"walker {n}", pace, where))
    eyes = np.stack([np.linspace(-9, 12, 28), np.full(28, 1.7), np.linspace(24, 9, 28)], axis=1)
    cameras = views(eyes, heading(0.2 + 0.55 * np.sin(0.33 * np.arange(28)), -0.03))
    frames = []
    for k, one in enumerate(cameras):
        poses = {}
        for name, pace, where in walkers:
            if growing:
                size = np.diag([*(3 * [1 + 0.13 * k * (abs(pace) / 0.07)]), 1.0])
                poses[name] = moved(*where) @ size @ moved(*-where)
            else:
                poses[name] = about((0.0, 0.0, 0.0), pace * k, axis=1)
        gone = [f"kiosk {n}" for n in range(14) if k > 3 + 1.6 * n]
        gone += [f"walker {n}" for n in range(70) if n % 3 == 0 and k < 2 + n / 3]
        absent = tuple(gone) if leaving else ()
        frames.append(Frame((one,), world_from_object=poses, absent=absent))
    return Place(scene_of(objects), CameraPath(frames))


@cache
def passages() -> Place:
    """Behind a row of gates, which slide up and down, lie shops full of things."""
    rng = np.random.default_rng(77)
    objects: Objects = [("road", box((-40, -0.3, -22), (40, 0, 14)))]
    gates = []
    for n in range(10):
        x = 6.0 * n - 30
        objects.append((f"pier {n}", box((x - 1.2, 0, -6), (x + 1.2, 4, -4))))
        objects.append((f"lintel {n}", box((x + 1.2, 2.9, -6), (x + 4.8, 4, -4))))
        objects.append((f"gate {n}", box((x + 1.1, 0, -5.1), (x + 4.9, 3.1, -4.9))))
        gates.append(f"gate {n}")
        for m in range(9):
            low = np.array([x + rng.uniform(0.3, 5), 0, -6.5 - rng.uniform(0, 5)])
            size = rng.uniform((0.3, 0.3, 0.3), (0.9, 2.0, 0.9))
            objects.append((f"ware {n}-{m}", box(low, low + size)))
    eyes = np.stack([np.linspace(-24, 22, 28), np.full(28, 1.7), np.full(28, 4.0)], axis=1)
    cameras = views(eyes, heading(0.5 * np.sin(0.4 * np.arange(28))))
    frames = []
    for k, one in enumerate(cameras):
        up = 1.5 - 1.5 * np.cos(0.45 * (k - 1.3 * np.arange(10)) - 0.4)
        poses = {name: moved(y=float(height)) for name, height in zip(gates, up, strict=True)}
        frames.append(Frame((one,), world_from_object=poses))
    return Place(scene_of(objects), CameraPath(frames))


@cache
def reed_bed() -> Place:
    """Reeds that grow and bend far out of their places, between walls, and a walk along them."""
    rng = np.random.default_rng(5)
    objects: Objects = [("bank", box((-30, -0.5, -30), (30, 0, 12)))]
    for n in range(12):
        low = np.array([rng.uniform(-24, 24), 0, rng.uniform(-20, 0)])
        objects.append((f"wall {n}", box(low, low + rng.uniform((1, 0.6, 0.3), (5, 1.8, 0.8)))))
    reeds = []
    for n in range(60):
        at = np.array([rng.uniform(-24, 24), 0, rng.uniform(-22, 4)])
        steps = np.linspace(0, 1.4, 8)
        points = np.array([[side, y, 0.0] for y in steps for side in (-0.09, 0.09)]) + at
        faces = [f for k in range(0, 14, 2) for f in ((k, k + 1, k + 3), (k, k + 3, k + 2))]
        reeds.append(len(objects))
        objects.append((f"reed {n}", (points, np.array(faces))))
    ways = rng.uniform(-1.6, 1.6, len(reeds))
    positions = [points.astype(np.float32) for _, (points, _) in objects]
    grown = {at: bent(positions[at], way) for at, way in zip(reeds, ways, strict=True)}
    scene = rigged(scene_of(objects), positions, Bending(positions, grown))
    eyes = np.stack([np.linspace(-14, 14, 26), np.full(26, 1.6), np.full(26, 9.0)], axis=1)
    cameras = views(eyes, heading(0.6 * np.sin(0.5 * np.arange(26)), -0.05))
    frames = [Frame((one,), time_s=0.16 * k) for k, one in enumerate(cameras)]
    return Place(scene, CameraPath(frames))
