"""A stadium that fills."""

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

# Views of the fan, and how far they lie apart.
FAN, APART = 4, 2.4


@cache
def stadium(*, fan: bool = False) -> Place:
    """Stands around a field, in front of which spectators come and go. `fan`: four cameras side by
    side, as a display that is looked at from many sides needs."""
    rng = np.random.default_rng(86)
    objects: Objects = [("field", box((-30, -0.3, -20), (30, 0, 20)))]
    for ring in range(4):
        for n in range(26):
            a = 2 * np.pi * n / 26
            at = ((30 + 2.2 * ring) * np.sin(a), 0, (21 + 2.2 * ring) * np.cos(a))
            stand = box((-3.4, 0, -1.0), (3.4, 1.2 + 1.1 * ring, 1.0))
            objects.append((f"stand {ring}-{n}", put(stand, at, turn=-a)))
    for n in range(8):
        a = 2 * np.pi * (n + 0.5) / 8
        lamps = together(prism(6, 0.3, 13.0), box((-1.8, 11.5, -0.3), (1.8, 13.5, 0.3)))
        objects.append((f"mast {n}", put(lamps, (41 * np.sin(a), 0, 31 * np.cos(a)), turn=-a)))
    for n, x in enumerate((-26, 26)):
        posts = [box((x, 0, z - 0.1), (x + 0.2, 2.5, z + 0.1)) for z in (-3.6, 3.6)]
        bar = box((x, 2.4, -3.6), (x + 0.2, 2.6, 3.6))
        objects.append((f"goal {n}", together(*posts, bar)))
    come, gone = {}, {}
    for n in range(90):
        a = rng.uniform(0, 2 * np.pi)
        at = (27 * np.sin(a) * rng.uniform(0.75, 1.0), 0, 18 * np.cos(a) * rng.uniform(0.75, 1.0))
        name = f"person {n}"
        objects.append((name, put(box((-0.3, 0, -0.2), (0.3, rng.uniform(1.5, 1.9), 0.2)), at)))
        come[name], gone[name] = n // 4, n // 4 + rng.integers(7, 24)
    t = np.linspace(0, 1, 30)
    eyes = np.stack([9 * np.sin(4 * t), np.full(30, 2.0), 4 - 9 * t], axis=1)
    cameras = views(eyes, heading(4.6 * t + 0.5 * np.sin(9 * t), 0.05))
    frames = []
    for k, one in enumerate(cameras):
        absent = [name for name in come if not come[name] <= k <= gone[name]]
        each = [one]
        if fan:
            right = one.world_from_camera[:3, 0]
            each = []
            for n in range(FAN):
                pose = one.world_from_camera.copy()
                pose[:3, 3] += (n - FAN / 2 + 0.5) * APART * right
                small = replace(one, world_from_camera=pose, width=96, height=96)
                each.append(replace(small, view=f"view {n}"))
        frames.append(Frame(tuple(each), absent=tuple(absent)))
    return Place(scene_of(objects), CameraPath(frames))
