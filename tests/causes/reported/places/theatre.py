"""A theatre, in which the set changes from act to act."""

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

ACTS, LONG = 6, 5
# Since which frame.
TAKEN_OUT = ((4, "seat 1-3"), (12, "seat 0-9"), (20, "seat 2-6"))


def _house(rng: np.random.Generator) -> Objects:
    objects: Objects = [
        ("floor", box((-12, -0.4, -2), (12, 0, 22))),
        ("stage", box((-12, -0.4, -14), (12, 1.0, -2))),
        ("ceiling", box((-12, 9, -14), (12, 9.4, 22))),
        ("back wall", box((-12, 0, -14.4), (12, 9, -14))),
        ("left wall", box((-12.4, 0, -14), (-12, 9, 22))),
        ("right wall", box((12, 0, -14), (12.4, 9, 22))),
        ("rear wall", box((-12, 0, 22), (12, 9, 22.4))),
        ("arch", together(box((-12, 1, -2.4), (-8, 9, -2)), box((8, 1, -2.4), (12, 9, -2)))),
        ("balcony", box((-12, 4.6, 15), (12, 5.0, 22))),
    ]
    for row in range(9):
        y, z = 0.18 * row, 1.5 + 1.9 * row
        for n in range(14):
            x = 1.45 * (n - 7) + (0.2 if n < 7 else 1.0)
            seat = together(
                box((x, y, z), (x + 1.0, y + 0.5, z + 0.6)),
                box((x, y + 0.5, z + 0.5), (x + 1.0, y + rng.uniform(1.1, 1.5), z + 0.6)),
            )
            objects.append((f"seat {row}-{n}", seat))
    for n in range(6):
        x, z = (-11, 11)[n % 2], 2.0 + 7.0 * (n // 2)
        objects.append((f"column {n}", put(prism(8, 0.4, 9.0), (x, 0, z))))
    return objects


@cache
def theatre(*, zooming: bool = False, cleared: bool = False) -> Place:
    """The set of each act stands for some frames, and one strolls in the aisle. `zooming`: one
    stands, looks about, and zooms out before each turn of the head. `cleared`: the set of the first
    act stays, and a few seats are taken out."""
    rng = np.random.default_rng(83)
    objects = _house(rng)
    act_of = {}
    for act in range(ACTS):
        for n in range(9):
            low = np.array([rng.uniform(-7.5, 6.5), 1.0, rng.uniform(-12, -3)])
            size = rng.uniform((0.3, 0.5, 0.3), (2.2, 3.2, 0.8))
            act_of[f"prop {act}-{n}"] = act
            objects.append((f"prop {act}-{n}", box(low, low + size)))
    count = ACTS * LONG
    k = np.arange(count)
    if zooming:
        spell = k // LONG
        turn = 0.75 * np.sin(1.9 * spell + 0.4)
        eyes = np.stack([0.1 * np.cos(spell), np.full(count, 2.9), 16.5 - 1.4 * spell], axis=1)
        cameras = [
            replace(one, yfov=0.4 + 0.17 * (at % LONG))
            for at, one in enumerate(views(eyes, heading(turn, -0.12)))
        ]
    else:
        # Before and after one of the acts one turns fast.
        turn = 0.45 * np.sin(0.5 * k) + np.where(k // LONG == 2, 0.7, 0.0)
        eyes = np.stack([0.1 * np.sin(k), np.full(count, 2.2), 14.0 - 0.3 * k], axis=1)
        cameras = views(eyes, heading(turn, -0.06))
    frames = []
    for at, one in enumerate(cameras):
        shown = 0 if cleared else at // LONG
        absent = [name for name, act in act_of.items() if act != shown]
        if cleared:
            absent += [name for since, name in TAKEN_OUT if at >= since]
        frames.append(Frame((one,), absent=tuple(absent)))
    return Place(scene_of(objects), CameraPath(frames))
