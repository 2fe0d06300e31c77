"""The path along the busy street: on the pavement, a cut into a house, a cut to the lift."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from visref.camera import look_at
from visref.errors import InputError
from visref_datasets_gen.shapes import Float64, snap

CLIP_S = 10.0
EYE_M = 1.7
# Between the eyes, metres.
APART_M = 0.064
NEAR_M, FAR_M = 0.1, 400.0
SIZES = {"mono": (1280, 960), "stereo": (960, 960), "cube": (512, 512)}
# Of a cube map's camera in the frame's: forward and up.
_FACES = {
    "front": ((0, 0, -1), (0, 1, 0)),
    "right": ((1, 0, 0), (0, 1, 0)),
    "back": ((0, 0, 1), (0, 1, 0)),
    "left": ((-1, 0, 0), (0, 1, 0)),
    "up": ((0, 1, 0), (0, 0, 1)),
    "down": ((0, -1, 0), (0, 0, -1)),
}

# Where the eye is at a time, and where it looks, each (3,) metres.
Shot = Callable[[float], tuple[Float64, Float64]]


@dataclass(frozen=True)
class Shots:
    """`spans`: the seconds at which each of `shots` begins. `levels`: of things with levels of
    detail, where each stands and from what distances on, metres, its coarser levels are there.
    `absent`: objects that are unloaded from one time to another. `drone`: its place by time."""

    spans: tuple[float, ...]
    shots: tuple[Shot, ...]
    levels: Mapping[str, tuple[Float64, tuple[float, ...]]]
    absent: Sequence[tuple[str, float, float]]
    drone: Callable[[float], Float64]


def path_of(plan: Shots, frames: int, views: str) -> dict[str, Any]:
    """The path file's value: `frames` moments, evenly over the animation's ten seconds. Raises
    InputError for no frames, or other views than mono, stereo and cube."""
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    if views not in SIZES:
        raise InputError(
            f"the views are '{views}'", place="views", fix=f"give one of {', '.join(SIZES)}"
        )
    width, height = SIZES[views]
    rows: list[dict[str, Any]] = []
    shot_before = 0
    for frame in range(frames):
        time = frame * CLIP_S / frames
        shot = sum(time >= start for start in plan.spans) - 1
        eye, target = plan.shots[shot](time)
        row = _cameras(look_at(eye, target), views)
        row["levels"] = {
            name: sum(float(np.linalg.norm(eye - place)) >= limit for limit in limits)
            for name, (place, limits) in plan.levels.items()
        }
        gone = [name for name, start, end in plan.absent if start <= time < end]
        if gone:
            row["absent"] = gone
        drone = np.eye(4)
        drone[:3, 3] = snap(plan.drone(time))
        row["world_from_object"] = {"drone": drone.tolist()}
        if shot != shot_before:
            row["cut"] = True
        shot_before = shot
        rows.append(row)
    return {
        "format": "visref-path",
        "version": 1,
        "width": width,
        "height": height,
        "near": NEAR_M,
        "far": FAR_M,
        "yfov": math.pi / 2 if views == "cube" else math.pi / 3,
        "fps": frames / CLIP_S,
        "frames": rows,
    }


def _cameras(pose: Float64, views: str) -> dict[str, Any]:
    if views == "mono":
        return {"world_from_camera": pose.tolist()}
    if views == "stereo":
        poses = {}
        for name, side in (("left", -1.0), ("right", 1.0)):
            poses[name] = pose.copy()
            poses[name][:3, 3] += side * APART_M / 2.0 * pose[:3, 0]
    else:
        poses = {name: _face(pose, *axes) for name, axes in _FACES.items()}
    return {"views": {name: {"world_from_camera": one.tolist()} for name, one in poses.items()}}


def _face(pose: Float64, forward: Sequence[int], up: Sequence[int]) -> Float64:
    back = -np.array(forward, np.float64)
    turn = np.stack([np.cross(np.array(up, np.float64), back), up, back], axis=1)
    result = pose.copy()
    # A product with 0, 1 and -1: the same columns in another order.
    result[:3, :3] = np.stack([(pose[:3, :3] * column).sum(axis=1) for column in turn.T], axis=1)
    return result
