"""A container terminal, in which things are carried about."""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.causes.reported.places.making import Objects, Place, heading, scene_of, views
from visref.camera_path import CameraPath, Frame
from visref.conformance.building import box
from visref.conformance.moving import about, moved


@cache
def terminal() -> Place:
    """Stacks of containers that are put down and fetched, cranes that travel and turn their booms,
    and lorries, some of which keep up with the camera."""
    rng = np.random.default_rng(64)
    objects: Objects = [("quay", box((-60, -1, -34), (70, 0, 12)))]
    boxes = []
    for row, z in enumerate((-9.0, -13.0, -21.0, -25.0)):
        for n in range(11):
            x = -45.0 + 9.0 * n + rng.uniform(-1, 1)
            for level in range(rng.integers(1, 4)):
                name = f"container {row}-{n}-{level}"
                low = np.array([x, 2.6 * level, z])
                objects.append((name, box(low, np.add(low, (6.1, 2.59, 2.44)))))
                boxes.append(name)
    cranes = []
    for n in range(10):
        x, z = -42.0 + 10.0 * n, (-6.0, -17.0, 7.5)[n % 3]
        objects.append((f"tower {n}", box((x - 0.6, 0, z - 0.6), (x + 0.6, 10, z + 0.6))))
        objects.append((f"boom {n}", box((x - 3, 9.0, z - 0.5), (x + 15, 9.8, z + 0.5))))
        cranes.append((n, (x, 0.0, z), rng.uniform(-0.7, 0.7), rng.uniform(0.1, 0.3)))
    lorries = []
    for n in range(14):
        low = np.array([rng.uniform(-50, 20), 0.2, (-3.5, 4.5, -17.5)[n % 3]])
        objects.append((f"lorry {n}", box(low, np.add(low, (5.5, 2.6, 2.2)))))
        lorries.append((f"lorry {n}", rng.uniform(1.3, 2.3) if n % 3 < 2 else -1.0))
    for n in range(40):
        low = np.array([rng.uniform(-50, 60), 0, rng.uniform(-8, 10)])
        low[2] = low[2] if abs(low[2] - 1.0) > 1.0 else low[2] - 3.0
        objects.append((f"bollard {n}", box(low, low + rng.uniform(0.3, 0.8, 3))))
    t = np.linspace(0, 1, 32)
    eyes = np.stack([-42 + 62 * t, np.full(32, 1.9), np.full(32, 1.0)], axis=1)
    cameras = views(eyes, heading(0.75 + 0.7 * np.sin(7 * t), 0.16))
    come, gone = rng.integers(1, 30, len(boxes)), rng.integers(4, 60, len(boxes))
    frames = []
    for k, one in enumerate(cameras):
        poses = {name: moved(pace * k) for name, pace in lorries}
        for n, foot, pace, turn in cranes:
            travel = moved(pace * k)
            poses[f"tower {n}"] = travel
            poses[f"boom {n}"] = travel @ about(foot, turn * k + n, axis=1)
        absent = [
            name for i, name in enumerate(boxes) if (i % 3 == 0 and k < come[i]) or k > gone[i]
        ]
        frames.append(Frame((one,), world_from_object=poses, absent=tuple(absent)))
    return Place(scene_of(objects), CameraPath(frames))
