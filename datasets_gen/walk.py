"""The walk through the city: round one corner, a cut, round another."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError

EYE_HEIGHT_M = 1.7
LEG_M = (42.0, 34.0)
CORNER_RADIUS_M = 5.0


def walk(
    columns: int, rows: int, pitch_m: tuple[float, float], street_m: float, frames: int
) -> CameraPath:
    """A path of `frames` cameras along the middle of the streets near the city's centre."""
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    extent = math.hypot(columns * pitch_m[0], rows * pitch_m[1])
    first = frames - frames // 3
    cameras = []
    turns = corners(columns, rows, pitch_m, street_m)
    for count, (corner, way) in zip((first, frames - first), turns, strict=True):
        cameras += _corner(corner, way, count, far=max(1000.0, math.ceil(extent)))
    if first < frames:
        cameras[first] = replace(cameras[first], cut=True)
    return CameraPath(tuple(cameras))


def corners(
    columns: int, rows: int, pitch_m: tuple[float, float], street_m: float
) -> list[tuple[NDArray[np.float64], float]]:
    """The x and z, (2,) float64, of the two crossings where the walk turns, and its sense:
    it comes along z times that, and leaves along x against it."""
    i, j = (columns + 1) // 2, (rows + 1) // 2
    # The next crossing, unless that would be at the rim: two blocks have one inner crossing.
    other = (i if columns == 2 else i - 1, j if rows == 2 else j - 1)
    return [
        (np.array([column * pitch_m[0], row * pitch_m[1]]) - street_m / 2, way)
        for (column, row), way in (((i, j), 1.0), (other, -1.0))
    ]


def _corner(corner: NDArray[np.float64], way: float, count: int, *, far: float) -> list[Camera]:
    """Come along z times `way`, turn right, leave along x times -`way`."""
    arc = CORNER_RADIUS_M * math.pi / 2
    straight = LEG_M[0] - CORNER_RADIUS_M
    total = straight + arc + LEG_M[1] - CORNER_RADIUS_M
    cameras = []
    for k in range(count):
        s = total * (k + 0.5) / count
        turn = min(max((s - straight) / arc, 0.0), 1.0) * math.pi / 2
        before, after = min(s, straight), max(s - straight - arc, 0.0)
        z = before - LEG_M[0] + CORNER_RADIUS_M * math.sin(turn)
        x = CORNER_RADIUS_M * (math.cos(turn) - 1.0) - after
        # Eyes lead the turn and wander a little, as a walker's do.
        ahead = min(max((s + 4.0 - straight) / (arc + 4.0), 0.0), 1.0) * math.pi / 2
        yaw = ahead + 0.14 * math.sin(2.0 * math.pi * s / 23.0)
        pitch = 0.06 + 0.05 * math.sin(2.0 * math.pi * s / 31.0)
        eye = np.array([corner[0] + way * x, EYE_HEIGHT_M, corner[1] + way * z])
        gaze = [-way * math.sin(yaw), math.tan(pitch), way * math.cos(yaw)]
        cameras.append(
            Camera(
                world_from_camera=look_at(eye, eye + gaze),
                width=1280,
                height=960,
                near=0.1,
                far=far,
                yfov=math.pi / 3,
            )
        )
    return cameras
