"""What the places of the reported faults are made of, and a way through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.conformance.building import Mesh
from visref.rig import Rig
from visref.scene import Float64, Group, Scene

WIDTH, HEIGHT = 192, 120

Objects = list[tuple[str, Mesh]]


@dataclass(frozen=True, eq=False)
class Place:
    """`rigs`: of a place whose objects are copies of a few meshes, each one's box at home,
    (n, 2, 3), and world_from_object, (n, 4, 4). `cells`: by object, the cell that it belongs to,
    -1 for none."""

    scene: Scene
    path: CameraPath
    rigs: tuple[Float64, Float64] | None = None
    cells: Sequence[int] = ()


def views(eyes, ahead, **lens) -> list[Camera]:
    """A camera at each eye, (n, 3), that looks along `ahead`, (n, 3)."""
    values = {"width": WIDTH, "height": HEIGHT, "near": 0.2, "far": 300.0, "yfov": 0.95, **lens}
    if "ymag" in values:
        del values["yfov"]
    return [Camera(look_at(e, e + a), **values) for e, a in zip(eyes, ahead, strict=True)]


def heading(angles, dip=0.0) -> Float64:
    """(n, 3): level directions, 0 along -Z and growing to the right, that dip by so much."""
    angles = np.asarray(angles, float)
    dips = np.broadcast_to(dip, angles.shape)
    return np.stack([np.sin(angles), dips, -np.cos(angles)], axis=1)


def scene_of(objects: Objects) -> Scene:
    return Scene.from_objects([(name, *mesh) for name, mesh in objects], source="reported")


def put(mesh: Mesh, at, *, turn=0.0, size=1.0) -> Mesh:
    """A mesh turned about the upright, scaled and moved."""
    points, faces = mesh
    c, s = np.cos(turn), np.sin(turn)
    return (points * size) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + at, faces


def prism(sides: int, radius: float, height: float) -> Mesh:
    """A closed upright prism on the ground."""
    a = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([radius * np.cos(a), np.zeros(sides), -radius * np.sin(a)], axis=1)
    points = np.concatenate([ring, np.add(ring, (0, height, 0)), [(0, 0, 0), (0, height, 0)]])
    faces = []
    for i in range(sides):
        j = (i + 1) % sides
        faces += [(i, j, sides + j), (i, sides + j, sides + i)]
        faces += [(2 * sides, j, i), (2 * sides + 1, sides + i, sides + j)]
    return points, np.array(faces)


def with_levels(objects: Objects, groups: Sequence[Group]) -> Scene:
    """A scene of groups of several levels of detail, of which the coarser are absent at rest."""
    scene = scene_of(objects)
    positions = [points.astype(np.float32) for _, (points, _) in objects]
    starts = np.cumsum([0, *map(len, positions)])
    worlds = np.tile(np.eye(4), (len(objects), 1, 1))
    coarse = np.zeros(len(objects), np.bool_)
    for group in groups:
        for level in group.levels[1:]:
            coarse[list(level)] = True
    rig = Rig(positions, np.arange(len(objects)), worlds, starts, triangles=scene.triangles)
    return replace(scene, groups=tuple(groups), rig=rig, absent=coarse)
