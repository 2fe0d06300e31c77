"""Copies of meshes, and patches of plants."""

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
from visref.conformance.building import box
from visref.conformance.moving import about, moved
from visref.formats.placed import transformed
from visref.rig import Rig


@cache
def strewn(kind: str = "turned") -> Place:
    """Copies of a few long meshes, "turned", "scaled" or "mirrored" into place among walls, with
    their origin at one end."""
    rng = np.random.default_rng(12)
    objects: Objects = [("ground", box((-40, -0.4, -60), (40, 0, 20)))]
    homes, worlds = [objects[0][1]], [np.eye(4)]
    for _ in range(16):
        low = np.array([rng.uniform(-22, 22), 0, rng.uniform(-45, 4)])
        mesh = box(low, low + rng.uniform((2, 1.5, 0.3), (6, 3.2, 0.8)))
        objects.append(("wall", mesh))
        homes.append(mesh)
        worlds.append(np.eye(4))
    meshes = (
        box((0, 0, 0), (3.6, 0.5, 0.4)),
        box((0, 0, -1.9), (0.5, 0.9, 1.2)),
        put(prism(5, 0.35, 2.6), (0.9, 0, 0.4)),
    )
    for n in range(140):
        home = meshes[n % 3]
        size = np.ones(3)
        if kind == "scaled":
            size = np.exp(rng.uniform(np.log(0.5), np.log((4.0, 2.0, 4.5))))
        if kind == "mirrored":
            size = np.array([-1.0, 1.0, 1.0]) * rng.uniform(0.8, 1.3)
        a = rng.uniform(0, 2 * np.pi)
        world = moved(rng.uniform(-22, 22), 0.0, rng.uniform(-48, 6))
        world = world @ about((0.0, 0.0, 0.0), a, axis=1) @ np.diag([*size, 1.0])
        points, _ = transformed(world[None], home[0].astype(np.float32), np.zeros(3))
        faces = home[1][:, ::-1] if np.linalg.det(world[:3, :3]) < 0 else home[1]
        objects.append((f"piece {n}", (points[0], faces)))
        homes.append(home)
        worlds.append(world)
    scene = scene_of(objects)
    positions = [np.asarray(points, np.float32) for points, _ in homes]
    starts = np.cumsum([0, *map(len, positions)])
    rig = Rig(positions, np.arange(len(homes)), np.array(worlds), starts)
    boxes = np.array([[points.min(axis=0), points.max(axis=0)] for points in positions], float)
    t = np.linspace(0, 1, 28)
    eyes = np.stack([-6 + 12 * t, np.full(28, 1.7), 12 - 34 * t], axis=1)
    path = CameraPath(views(eyes, heading(0.9 * np.sin(7 * t), -0.08)))
    return Place(replace(scene, rig=rig), path, rigs=(boxes, np.array(worlds)))


@cache
def groves() -> Place:
    """Meadow plants in patches, each patch an instanced mesh: `cells` says which."""
    rng = np.random.default_rng(19)
    objects: Objects = [("meadow", box((-40, -0.3, -60), (40, 0, 20)))]
    cells = [-1]
    for n in range(10):
        low = np.array([rng.uniform(-25, 25), 0, rng.uniform(-45, 6)])
        objects.append((f"rock {n}", box(low, low + rng.uniform(0.8, 3.0, 3))))
        cells.append(-1)
    for patch in range(18):
        centre = np.array([rng.uniform(-24, 24), 0, rng.uniform(-46, 6)])
        for n in range(10):
            at = centre + rng.uniform((-5, 0, -5), (5, 0, 5))
            plant = prism(5, rng.uniform(0.2, 0.5), rng.uniform(0.6, 1.8))
            objects.append((f"plant {patch}-{n}", put(plant, at)))
            cells.append(patch)
    t = np.linspace(0, 1, 28)
    eyes = np.stack([8 * np.sin(4 * t), np.full(28, 1.8), 14 - 40 * t], axis=1)
    path = CameraPath(views(eyes, heading(0.8 * np.sin(6 * t), -0.1)))
    return Place(scene_of(objects), path, cells=cells)


@cache
def moving_groves() -> Place:
    """The meadow of which patches drift about, every plant with its patch."""
    still = groves()
    rng = np.random.default_rng(3)
    drift = rng.uniform((-1.1, 0, -0.6), (1.1, 0, 0.6), (18, 3))
    names = still.scene.names
    frames = []
    for k, one in enumerate(still.path.cameras):
        poses = {
            names[i]: moved(*(k * drift[cell])) for i, cell in enumerate(still.cells) if cell >= 0
        }
        frames.append(Frame((one,), world_from_object=poses))
    return Place(still.scene, CameraPath(frames), cells=still.cells)
