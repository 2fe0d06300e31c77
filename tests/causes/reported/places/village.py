"""A village, seen along its street, from above, and in two views."""

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
from visref.scene import Float64


def _village() -> Objects:
    rng = np.random.default_rng(41)
    objects: Objects = [("ground", box((-45, -0.4, -45), (45, 0, 45)))]
    for i in range(7):
        for k in range(7):
            if (i, k) in {(3, 3), (1, 4)}:
                continue
            x, z = 11.0 * (i - 3) - 5.5, 11.0 * (k - 3) - 5.5
            wide, deep, tall = rng.uniform((4.5, 4.5, 2.8), (7.4, 7.4, 7.0))
            low = np.array([x - wide / 2, 0, z - deep / 2])
            objects.append((f"house {i}-{k}", box(low, np.add(low, (wide, tall, deep)))))
            roof = prism(4, 0.72 * max(wide, deep), 0.5)
            objects.append((f"roof {i}-{k}", put(roof, (x, tall, z), turn=np.pi / 4)))
            objects.append((f"chimney {i}-{k}", box((x, tall, z), (x + 0.6, tall + 1.7, z + 0.5))))
            objects.append(
                (f"fence {i}-{k}", box(np.add(low, (-0.9, 0, -0.9)), np.add(low, (wide, 1, -0.85))))
            )
    for n in range(110):
        along, aside = rng.uniform(-36, 36), rng.choice((-1.4, 1.4)) + rng.uniform(-0.3, 0.3)
        street = 11.0 * rng.integers(-3, 3)
        x, z = (street + aside, along) if n % 2 else (along, street + aside)
        if n % 5 == 0:
            objects.append((f"lamp {n}", put(prism(6, 0.09, 3.4), (x, 0, z))))
        elif n % 5 == 1:
            objects.append((f"cart {n}", put(box((-1, 0.3, -0.5), (1, 1.1, 0.5)), (x, 0, z))))
        else:
            objects.append((f"barrel {n}", put(prism(7, 0.35, 0.9), (x, 0, z))))
    return objects


def _street(frames: int = 30) -> tuple[Float64, Float64]:
    """Up a street, round a corner with a look back, and down a lane."""
    t = np.linspace(0, 1, frames)
    z = np.where(t < 0.55, 30 - 52 * t, 30 - 52 * 0.55)
    x = np.where(t < 0.55, 0.1, 0.1 + 44 * (t - 0.55))
    turn = np.interp(t, [0, 0.2, 0.4, 0.55, 0.7, 0.85, 1], [0, 0.5, -0.45, 0.2, 1.6, 2.2, 1.1])
    eyes = np.stack([x, np.full(frames, 1.7), z], axis=1)
    return eyes, heading(turn, -0.04)


@cache
def village(frames: int = 30, **lens) -> Place:
    return Place(scene_of(_village()), CameraPath(views(*_street(frames), **lens)))


@cache
def village_from_above(rolled: bool = False, zoomed: bool = False) -> Place:
    """The village in an orthographic map that pans, and turns or zooms."""
    n = 24
    t = np.linspace(0, 1, n)
    eyes = np.stack([-18 + 34 * t, np.full(n, 55.0), 34 - 22 * t], axis=1)
    made = []
    for k, one in enumerate(views(eyes, np.tile([0, -0.85, -0.53], (n, 1)), ymag=9.0, far=200.0)):
        if rolled:
            one = replace(one, world_from_camera=_rolled(one.world_from_camera, 0.06 * k))
        made.append(replace(one, ymag=9.0 + 0.2 * k) if zoomed else one)
    return Place(scene_of(_village()), CameraPath(made))


def _rolled(pose: Float64, angle: float) -> Float64:
    c, s = np.cos(angle), np.sin(angle)
    result = pose.copy()
    result[:3, :3] = pose[:3, :3] @ [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    return result


@cache
def village_with(change: str) -> Place:
    """The village along its street: "zoomed" out, in a "resized" window, banking to and "fro", by a
    camera that "stands" and looks about, or that "jumps" and then waits."""
    made = views(*_street(30))
    if change == "zoomed":
        made = [replace(one, yfov=0.5 + 0.022 * k) for k, one in enumerate(made)]
    elif change == "resized":
        wide = [replace(one, width=120, height=120) for one in made[:8]]
        made = wide + [replace(one, width=216, height=108) for one in made[8:]]
    elif change == "fro":
        made = [
            replace(one, world_from_camera=_rolled(one.world_from_camera, 0.7 * np.sin(0.5 * k)))
            for k, one in enumerate(made)
        ]
    elif change == "stands":
        eyes, _ = _street(30)
        stops = np.repeat(eyes[[0, 9, 15, 21, 27]], 6, axis=0)
        made = views(stops, heading(np.tile(0.32 * np.arange(6), 5) - 0.4, -0.04))
    elif change == "jumps":
        eyes, ahead = _street(30)
        order = np.repeat([2, 20, 8, 26, 12, 29], 4)
        step = np.tile([0.0, 0.0, 0.0, 0.6], 6)
        made = views(eyes[order] + step[:, None] * np.array([0.3, 0, -1]), ahead[order])
        made = [replace(one, cut=k % 4 == 0 and k > 0) for k, one in enumerate(made)]
    return Place(scene_of(_village()), CameraPath(made))


@cache
def village_twice(eyes: str = "split") -> Place:
    """The village in two views: a "split" screen of two players, or a "headset" whose lenses are
    shifted outward; or with a "mirror", which looks back, or a "probe" that hangs above."""
    at, ahead = _street(28)
    frames = []
    for k in range(len(at)):
        right = np.cross(ahead[k], (0, 1, 0))
        right /= np.linalg.norm(right)
        first = {"width": 132, "height": 120}
        if eyes == "headset":
            left = at[k] - 0.032 * right
            one, two = views([left, at[k] + 0.032 * right], [ahead[k]] * 2, yfov=1.5, **first)
            one = replace(one, shift_x_px=-17.0, shift_y_px=5.0)
            two = replace(two, shift_x_px=17.0, shift_y_px=5.0)
        elif eyes == "mirror":
            one, two = views([at[k], at[k] + 0.5 * right], [ahead[k], (1, 1, -1) * -ahead[k]])
            two = replace(two, width=96, height=60)
        elif eyes == "probe":
            one, two = views([at[k], at[k] + (0, 5.5, 0)], [ahead[k], ahead[k] - (0, 0.3, 0)])
            two = replace(two, width=96, height=60)
        else:
            other = (k + 11) % len(at)
            one, two = views([at[k], at[other]], [ahead[k], ahead[other]], **first)
        names = ("main", eyes) if eyes in ("mirror", "probe") else ("left", "right")
        frames.append(
            Frame(tuple(replace(c, view=n) for c, n in zip((one, two), names, strict=True)))
        )
    return Place(scene_of(_village()), CameraPath(frames))


@cache
def far_village() -> Place:
    """The village a hundred thousand kilometres out, on a grid that float64 still holds finely."""
    near = village()
    origin = np.array([2.0**27, 0.0, -(2.0**26)])
    scene = replace(near.scene, origin=origin)
    cameras = []
    for one in near.path.cameras:
        pose = one.world_from_camera.copy()
        pose[:3, 3] += origin
        cameras.append(replace(one, world_from_camera=pose))
    return Place(scene, CameraPath(cameras))
