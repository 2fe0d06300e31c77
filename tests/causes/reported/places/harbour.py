"""A harbour: containers, cranes, marks on the quay, lamps on masts, and one-sided screens."""

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
from visref.camera_path import CameraPath
from visref.conformance.building import Mesh, box, panel, together


def screen(wide: float, high: float, mirrored: bool) -> Mesh:
    """Two panels at a right angle: one faces +Z, the other +X, or -X if it is mirrored."""
    points, faces = together(
        panel((0.0, wide), (0.0, high), 0.0),
        put(panel((0.0, wide), (0.0, high), 0.0), (wide, 0, 0), turn=np.pi / 2),
    )
    return (points * (-1, 1, 1), faces[:, ::-1]) if mirrored else (points, faces)


@cache
def harbour() -> Place:
    """One walks along the quay, over the marks on it. All is one-sided but nets and masts."""
    rng = np.random.default_rng(43)
    objects: Objects = [
        ("quay", box((-60, -2, -16), (60, 0, 14))),
        ("sea", box((-90, -4, -160), (90, -2.5, -16))),
        ("mole", box((-70, -3, -70), (70, 0.5, -66))),
    ]
    for n in range(30):
        x, z = 4.4 * (n % 15) - 32, -11.0 if n < 15 else 8.5
        for up in range(int(rng.integers(1, 3))):
            low = np.array([x + rng.uniform(-0.2, 0.2), 2.5 * up, z])
            objects.append(
                (f"container {n}-{up}", box(low, np.add(low, (rng.uniform(2.4, 4), 2.5, 2.5))))
            )
    for n in range(5):
        x = 15.0 * n - 32
        parts = [
            box((x + a, 0, -14.5 + b), (x + a + 0.4, 9, -14.1 + b)) for a in (0, 4) for b in (0, 2)
        ]
        parts.append(box((x, 9, -30), (x + 4.4, 9.8, -9)))
        objects.append((f"crane {n}", together(*parts)))
    for n in range(44):
        x, z = rng.uniform(-30, 30), rng.uniform(-7.5, 7.0)
        wide, deep = rng.uniform(1.5, 7.0, 2)
        flat = np.array([[x, 0, z], [x, 0, z + deep], [x + wide, 0, z + deep], [x + wide, 0, z]])
        objects.append(
            (f"mark {n}", (np.add(flat, (0, 0.02, 0)), np.array([[0, 1, 2], [0, 2, 3]])))
        )
    for n in range(24):
        at = np.array([rng.uniform(-32, 32), 0, rng.uniform(-7.5, 6.5)])
        name = "mirrored screen" if n % 2 else "screen"
        shell = screen(rng.uniform(0.8, 1.6), rng.uniform(0.9, 1.5), n % 2 == 1)
        objects.append((f"{name} {n}", put(shell, at, turn=rng.uniform(-0.6, 0.6))))
    for n in range(20):
        at = np.array([rng.uniform(-32, 32), 0, rng.uniform(-8, 7)])
        net = panel((0, rng.uniform(0.8, 1.8)), (0.1, rng.uniform(0.7, 1.3)), 0)
        objects.append((f"net {n}", put(net, at, turn=rng.uniform(-1, 1))))
    for n in range(32):
        x = 4.2 * n - 66
        y, z = (rng.uniform(4, 7), -68) if n % 2 else (rng.uniform(5, 8), -14)
        objects.append((f"mast {n}", put(prism(4, 0.06, y), (x, 0.0, z))))
        low = np.array([x - 0.35, y, z - 0.35])
        objects.append((f"lamp {n}", box(low, np.add(low, (0.7, 0.5, 0.7)))))
    t = np.linspace(0, 1, 36)
    eyes = np.stack([-28 + 54 * t, np.full(36, 1.65), 1.5 * np.sin(6 * t)], axis=1)
    turn = 0.9 + 0.75 * np.sin(11 * t)
    scene = scene_of(objects)
    owners = [scene.names[i] for i in scene.object_of_triangle]
    sided = np.array([not name.startswith(("net", "mast")) for name in owners])
    path = CameraPath(views(eyes, heading(turn, -0.16 + 0.1 * np.sin(23 * t))))
    return Place(replace(scene, one_sided=sided), path)
