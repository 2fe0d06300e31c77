"""A station in orbit, and what flies about it."""

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
from visref.conformance.moving import moved
from visref.scene import Float64

# Where the station is, far from where the world has its origin.
ORBIT = np.array([9.0e7, -2.1e7, 6.3e7])
SHIPS = 16


def _objects() -> tuple[Objects, Float64, Float64]:
    """The objects, and (SHIPS, 3) where each ship starts, and how far it flies in a frame."""
    rng = np.random.default_rng(108)
    tubes = (
        box((-9, -1, -1), (9, 1, 1)),
        box((-1, -7, -1), (1, 7, 1)),
        box((-1, -1, -6), (1, 1, 6)),
    )
    objects: Objects = [("station", put(together(*tubes), (0, 0, -22)))]
    for n in range(10):
        low = np.array([-9.0 + 1.9 * n, 1.0, -24.0])
        objects.append((f"panel {n}", box(low, np.add(low, (1.5, 4.5, 0.1)))))
    for n in range(70):
        at = rng.uniform((-34, -18, -60), (34, 18, 8))
        rock = prism(int(rng.integers(4, 8)), rng.uniform(0.4, 2.2), rng.uniform(0.6, 3.0))
        objects.append((f"rock {n}", put(rock, at, turn=rng.uniform(0, 6))))
    for n in range(50):
        at = rng.uniform((-26, -12, -50), (26, 12, 4))
        objects.append((f"pod {n}", put(box((-0.4, -0.3, -0.6), (0.4, 0.3, 0.6)), at)))
    starts = rng.uniform((-26, -8, -46), (26, 8, -6), (SHIPS, 3))
    speeds = rng.uniform(0.5, 1.5, SHIPS) * rng.choice((-1, 1), SHIPS)
    for n, (at, speed) in enumerate(zip(starts, speeds, strict=True)):
        hull = box((-0.9, -0.25, -0.4), (0.9, 0.25, 0.4))
        objects.append((f"ship {n}", put(hull, at)))
        end = np.add(at, (np.sign(speed), 0.12, 0.12))
        low, high = np.minimum(at, end), np.maximum(at, end)
        objects.append((f"trail {n}", box(low, high)))
    return objects, starts, speeds


@cache
def space(*, zooming: bool = False, far: bool = False) -> Place:
    """Rocks and pods around a station, through which ships fly, each at the head of a trail that
    grows. `zooming`: as its camera zooms out. `far`: at rest, a long way out."""
    objects, starts, speeds = _objects()
    scene = scene_of(objects)
    n = 30
    t = np.linspace(0, 1, n)
    eyes = np.stack([6 * np.sin(4 * t), 3 * np.cos(3 * t), 16 - 12 * t], axis=1)
    cameras = views(eyes, heading(0.7 * np.sin(6 * t), 0.2 * np.cos(5 * t)))
    if far:
        made = []
        for one in cameras:
            pose = one.world_from_camera.copy()
            pose[:3, 3] += ORBIT
            made.append(replace(one, world_from_camera=pose))
        return Place(replace(scene, origin=ORBIT), CameraPath(made))
    if zooming:
        cameras = [replace(one, yfov=0.42 + 0.022 * k) for k, one in enumerate(cameras)]
    frames = []
    for k, one in enumerate(cameras):
        poses = {}
        for m, (at, speed) in enumerate(zip(starts, speeds, strict=True)):
            poses[f"ship {m}"] = moved(speed * k)
            longer = np.diag([1.0 + abs(speed) * k, 1.0, 1.0, 1.0])
            poses[f"trail {m}"] = moved(*at) @ longer @ moved(*-at)
        frames.append(Frame((one,), world_from_object=poses))
    return Place(scene, CameraPath(frames))
