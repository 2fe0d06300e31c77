"""Trees of several levels of detail."""

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
    with_levels,
)
from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.conformance.building import box, together
from visref.scene import Float64, Group


@cache
def avenue(*, by_distance: bool = True) -> Place:
    """An avenue of trees, each with three levels of detail that follow one another with the
    distance, as a camera goes along it. Not `by_distance`: by their size in a zooming camera."""
    rng = np.random.default_rng(31)
    objects: Objects = [("road", box((-8, -0.3, -90), (8, 0, 15)))]
    groups, centres = [], []
    for n in range(44):
        x, z = (4.5 if n % 2 else -4.5) + rng.uniform(-1, 1), 4.0 - 2.0 * n
        height = rng.uniform(3.0, 6.0)
        levels = []
        for level, sides in enumerate((9, 6, 3)):
            trunk, crown = prism(sides, 0.2, height), prism(sides, 1.1, 0.55 * height)
            mesh = together(trunk, put(crown, (0, 0.45 * height, 0)))
            levels.append((len(objects),))
            objects.append((f"tree {n} level {level}", put(mesh, (x, 0, z))))
        every = tuple(one for level in levels for one in level)
        groups.append(Group(f"tree {n}", f"tree {n}", every, levels=tuple(levels)))
        centres.append((x, height / 2, z))
    for n in range(20):
        low = np.array([rng.uniform(-7, 7), 0, rng.uniform(-80, 5)])
        objects.append((f"bench {n}", box(low, np.add(low, (0.5, 0.5, 1.4)))))
    scene = with_levels(objects, groups)
    eyes = np.stack([0.8 * np.sin(np.arange(28)), np.full(28, 1.7), 12 - 1.7 * np.arange(28)], 1)
    cameras = views(eyes, heading(0.25 * np.sin(0.45 * np.arange(28))))
    if not by_distance:
        cameras = [replace(one, yfov=1.05 - 0.028 * k) for k, one in enumerate(cameras)]
    frames = []
    for one in cameras:
        away = np.linalg.norm(np.array(centres) - one.eye, axis=1)
        levels = {f"tree {n}": int(level) for n, level in enumerate(level_of(one, away))}
        frames.append(Frame((one,), levels=levels))
    return Place(scene, CameraPath(frames))


# The levels of the avenue's trees end at so many metres in a view of 0.95 radians.
LEVEL_ENDS = (14.0, 32.0)


def level_of(camera: Camera, away: Float64) -> Float64:
    """(n,) the level of a tree at each distance, as large as it is in this camera's view."""
    scale = np.tan(camera.yfov / 2) / np.tan(0.95 / 2)
    return np.searchsorted(LEVEL_ENDS, away * scale)
