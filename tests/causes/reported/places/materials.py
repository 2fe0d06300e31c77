"""Glass, lattices, water and leaf cards."""

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
    views,
)
from visref.camera_path import CameraPath
from visref.conformance.building import Cutout, box, case, cut_out, panel
from visref.inputs import open_scene
from visref.scene import Alpha

_UV = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])


@cache
def glasshouse() -> Place:
    """Glass walls and pools between plants and benches, lattices, and solid walls."""
    rng = np.random.default_rng(14)
    objects: Objects = [("floor", box((-25, -0.3, -40), (25, 0, 14)))]
    glass, lattices = [], {}
    texels = np.kron(rng.random((6, 6)) < 0.45, np.ones((2, 2))).astype(np.uint8) * 255
    for n in range(26):
        x, z = rng.uniform(-20, 16), rng.uniform(-32, 4)
        wide = rng.uniform(2, 5)
        if n % 2:
            glass.append(f"pane {n}")
            objects.append((glass[-1], panel((x, x + wide), (0, 2.8), z)))
        else:
            lattices[f"lattice {n}"] = Cutout(_UV, np.roll(texels, n, axis=1))
            objects.append((f"lattice {n}", panel((x, x + wide), (0.1, 2.4), z)))
    for n in range(6):
        x, z = rng.uniform(-20, 16), rng.uniform(-28, 2)
        objects.append((f"wall {n}", box((x, 0, z), (x + 3, 2.6, z + 0.2))))
    for n in range(120):
        at = (rng.uniform(-21, 21), 0, rng.uniform(-36, 5))
        if n % 3:
            plant = prism(5, rng.uniform(0.15, 0.4), rng.uniform(0.5, 1.6))
        else:
            plant = box((0, 0, 0), rng.uniform((0.3, 0.3, 0.3), (1.2, 0.6, 0.6)))
        objects.append((f"plant {n}", put(plant, at)))
    t = np.linspace(0, 1, 24)
    eyes = np.stack([-9 + 19 * t, np.full(24, 1.6), 11 - 12 * t], axis=1)
    cameras = views(eyes, heading(0.55 * np.sin(6 * t), -0.05))
    alpha = dict.fromkeys(glass, Alpha.BLEND) | dict.fromkeys(lattices, Alpha.MASK)
    built = cut_out(case(objects, cameras, alpha=alpha), lattices)
    return Place(built.scene, CameraPath(cameras))


@cache
def lake() -> Place:
    """A lake, whose water is glass, with wrecks under it and posts in it; one looks down."""
    rng = np.random.default_rng(15)
    objects: Objects = [
        ("bed", box((-30, -5, -40), (30, -4.5, 20))),
        ("shore", box((-40, -5, 12), (40, 0.3, 24))),
    ]
    water = []
    for i in range(6):
        for k in range(6):
            water.append(f"water {i}-{k}")
            x, z = 10.0 * (i - 3), 8.0 * (k - 4) - 4
            flat = np.array([[x, 0, z], [x, 0, z + 8], [x + 10, 0, z + 8], [x + 10, 0, z]])
            objects.append((water[-1], (flat, np.array([[0, 1, 2], [0, 2, 3]]))))
    for n in range(70):
        x, z = rng.uniform(-27, 26), rng.uniform(-36, 10)
        if n % 5 == 0:
            objects.append((f"post {n}", put(prism(6, 0.2, 6.0), (x, -4.5, z))))
        else:
            size = rng.uniform((0.4, 0.3, 0.4), (2.0, 1.2, 2.0))
            low = np.array([x, rng.uniform(-4.5, -1.5), z])
            objects.append((f"wreck {n}", box(low, low + size)))
    t = np.linspace(0, 1, 15)
    eyes = np.stack([-12 + 22 * t, 2.5 + np.sin(5 * t), 16 - 14 * t], axis=1)
    cameras = views(eyes, heading(0.5 * np.sin(6 * t), -0.45))
    built = case(objects, cameras, alpha=dict.fromkeys(water, Alpha.BLEND))
    return Place(built.scene, CameraPath(cameras))


@cache
def forest() -> Place:
    """A generated wood of leaf cards, and a walk of our own in it."""
    scene, path, _ = open_scene("forest:scale=0.03,seed=4")
    assert path is not None
    made = []
    for k, one in enumerate(path.cameras[::3]):
        pose = one.world_from_camera.copy()
        c, s = np.cos(0.25 * k), np.sin(0.25 * k)
        pose[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ pose[:3, :3]
        made.append(replace(one, world_from_camera=pose, width=160, height=100, cut=False))
    return Place(scene, CameraPath(made))
