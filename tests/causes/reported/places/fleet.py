"""Ships and debris in space, far from the world's origin."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from tests.causes.reported.places.making import Objects, Place, put, scene_of, views
from visref.camera_path import CameraPath
from visref.conformance.building import Mesh, box, together

ORIGIN = np.array([-(2.0**25), 2.0**24, 2.0**26])


def _moon(radius: float) -> Mesh:
    lat, lon = np.meshgrid(np.linspace(-1.5, 1.5, 9), np.linspace(0, 2 * np.pi, 13), indexing="ij")
    points = np.stack([np.cos(lat) * np.sin(lon), np.sin(lat), np.cos(lat) * np.cos(lon)], axis=-1)
    index = np.arange(9 * 13).reshape(9, 13)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = [np.stack(each, -1).reshape(-1, 3) for each in ((a, b, c), (a, c, d))]
    return radius * points.reshape(-1, 3), np.concatenate(faces)


@cache
def fleet(*, deep: bool = False, **lens) -> Place:
    """A flight between ships, close to debris. `deep`: in some frames the far plane is as far off
    as anything can be."""
    rng = np.random.default_rng(61)
    objects: Objects = [
        ("moon", put(_moon(60.0), (90, -30, -210))),
        ("small moon", put(_moon(9.0), (-50, 25, -120))),
    ]
    for n in range(44):
        long, wide = rng.uniform(3, 14), rng.uniform(0.8, 2.5)
        hull = box((-wide, -0.6, -long), (wide, 0.6, long))
        tower = box((-0.4, 0.6, -0.3 * long), (0.4, 0.6 + wide, 0.2 * long))
        fins = box((-2 * wide, -0.1, 0.5 * long), (2 * wide, 0.1, long))
        at = (rng.uniform(-45, 45), rng.uniform(-14, 14), rng.uniform(-120, 5))
        mesh = together(hull, tower, fins)
        objects.append((f"ship {n}", put(mesh, at, turn=rng.uniform(0, 2 * np.pi))))
    for n in range(160):
        z = rng.uniform(-75, 18)
        low = np.array([5 * np.sin(0.07 * z), 0, z]) + rng.normal(0, 1, 3) * (7, 4, 1)
        objects.append((f"debris {n}", box(low, low + rng.uniform(0.12, 0.7, 3))))
    t = np.linspace(0, 1, 32)
    z = 16 - 70 * t
    eyes = np.stack([5 * np.sin(0.07 * z), 0.6 * np.sin(9 * t), z], axis=1)
    turn, dip = 0.7 * np.sin(7 * t), 0.25 * np.sin(5 * t)
    ahead = np.stack([np.sin(turn), dip, -np.cos(turn)], axis=1)
    cameras = views(eyes, ahead, **{"near": 2.0, "far": 400.0, **lens})
    if deep:
        cameras = [replace(c, far=1e8) if k % 9 > 6 else c for k, c in enumerate(cameras)]
    made = []
    for one in cameras:
        pose = one.world_from_camera.copy()
        pose[:3, 3] += ORIGIN
        made.append(replace(one, world_from_camera=pose))
    return Place(replace(scene_of(objects), origin=ORIGIN), CameraPath(made))
