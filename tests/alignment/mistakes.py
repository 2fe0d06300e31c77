"""Ordinary mistakes made on purpose: what a user hands in instead of the right path, recording or
scene. Written against the words of the mistake, not against what undoes it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from visref.camera_path import CameraPath, Frame
from visref.scene import Scene

SHIFTED = (9.0, 13.0)


@dataclass(frozen=True)
class Mistake:
    """`named`: the hypothesis that has to come first. `change`: of (scene, path, sets), by frame
    and view. `shift`, `stereo`, `one_sided`: what the right inputs need for it to show at all."""

    named: str
    change: Any
    shift: tuple[float, float] = (0.0, 0.0)
    stereo: bool = False
    one_sided: bool = False
    only: str = ""


def _cameras(path: CameraPath, change) -> CameraPath:
    return CameraPath([Frame(tuple(map(change, f.cameras))) for f in path.frames])


def on_pose(change):
    def made(scene, path, sets):
        def one(camera):
            pose = np.eye(4)
            pose[:3] = change(camera.world_from_camera.copy())[:3]
            return replace(camera, world_from_camera=pose)

        return scene, _cameras(path, one), sets

    return made


def on_camera(change):
    return lambda scene, path, sets: (scene, _cameras(path, change), sets)


def on_sets(change):
    return lambda scene, path, sets: (scene, path, change(scene, sets))


def opencv(m):
    m[:, 1] *= -1
    m[:, 2] *= -1
    return m


def unreal_forward(m):
    m[:, 0] *= -1
    m[:, 2] *= -1
    return m


def mirrored(axis):
    def change(m):
        m[axis, :] *= -1
        m[:, axis] *= -1
        return m

    return change


def z_up(m):
    x, y, z = m[0].copy(), m[1].copy(), m[2].copy()
    m[0], m[1], m[2] = x, -z, y
    return m


def y_up(m):
    x, y, z = m[0].copy(), m[1].copy(), m[2].copy()
    m[0], m[1], m[2] = x, z, -y
    return m


def camera_from_world(m):
    return np.linalg.inv(m)


def transposed(m):
    m[:3, :3] = m[:3, :3].T.copy()
    return m


def in_units(factor):
    def change(camera):
        pose = camera.world_from_camera.copy()
        pose[:3, 3] *= factor
        return replace(
            camera, world_from_camera=pose, near=camera.near * factor, far=camera.far * factor
        )

    return on_camera(change)


def lens(**change):
    return on_camera(lambda camera: replace(camera, **{k: f(camera) for k, f in change.items()}))


def aspect(camera):
    return camera.width / camera.height


def frames_by(by):
    """The set of a frame is written `by` frames later; those without one keep the nearest."""

    def change(scene, sets):
        last = max(sets)
        return {f: sets[min(max(f - by, 0), last)] for f in sets}

    return on_sets(change)


def each(change):
    return on_sets(
        lambda scene, sets: {
            f: {v: change(scene, ids) for v, ids in views.items()} for f, views in sets.items()
        }
    )


def ids_by(by):
    def change(scene, ids):
        moved = np.asarray(ids) + by
        return moved[(moved >= 0) & (moved < scene.object_count)]

    return each(change)


def wound(scene: Scene) -> Scene:
    return replace(scene, triangles=scene.triangles[:, ::-1].copy())


def at_origin(point_of):
    def change(scene, path, sets):
        low, high = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
        point = point_of(low.astype(float), high.astype(float))

        def one(camera):
            pose = camera.world_from_camera.copy()
            pose[:3, 3] -= point
            return replace(camera, world_from_camera=pose)

        return scene, _cameras(path, one), sets

    return change


def floor_middle(low, high):
    middle = (low + high) / 2
    middle[1] = low[1]
    return middle


MISTAKES = {
    "looks along +Z, +Y up": Mistake("looks along +Z", on_pose(unreal_forward)),
    "OpenCV's axes": Mistake("looks along +Z", on_pose(opencv)),
    "left-handed, x": Mistake("mirrored in x", on_pose(mirrored(0))),
    "left-handed, y": Mistake("mirrored in y", on_pose(mirrored(1))),
    "left-handed, z": Mistake("mirrored in z", on_pose(mirrored(2))),
    "Z up": Mistake("path is Z up", on_pose(z_up)),
    "scene Z up": Mistake("scene is Z up", on_pose(y_up)),
    "Z up and left-handed": Mistake(
        "path is Z up, left-handed", on_pose(lambda m: z_up(mirrored(2)(m)))
    ),
    "camera_from_world": Mistake("inverse matrix", on_pose(camera_from_world)),
    "transposed rotation": Mistake("transposed rotation", on_pose(transposed)),
    "centimetres": Mistake("units × 0.01", in_units(100.0)),
    "millimetres": Mistake("units × 0.001", in_units(1000.0)),
    "hundreds of metres": Mistake("units × 100", in_units(0.01)),
    "kilometres": Mistake("units × 1000", in_units(0.001)),
    "radians twice": Mistake("degrees for radians", lens(yfov=lambda c: math.radians(c.yfov))),
    "horizontal for vertical": Mistake(
        "horizontal field of view",
        lens(yfov=lambda c: 2 * math.atan(math.tan(c.yfov / 2) * aspect(c))),
    ),
    "vertical for horizontal": Mistake(
        "vertical taken as horizontal",
        lens(yfov=lambda c: 2 * math.atan(math.tan(c.yfov / 2) / aspect(c))),
    ),
    "twice the angle": Mistake("half the field of view", lens(yfov=lambda c: 2 * c.yfov)),
    "half the angle": Mistake("double the field of view", lens(yfov=lambda c: c.yfov / 2)),
    "width and height swapped": Mistake(
        "width and height swapped", lens(width=lambda c: c.height, height=lambda c: c.width)
    ),
    "near too large": Mistake("near and far ignored", lens(near=lambda c: 20.0), only="owners"),
    "shift x": Mistake(
        "lens shift's sign in x", lens(shift_x_px=lambda c: -c.shift_x_px), shift=(20.0, 0.0)
    ),
    "shift y (y up)": Mistake(
        "lens shift's sign in y", lens(shift_y_px=lambda c: -c.shift_y_px), shift=(0.0, 20.0)
    ),
    "shift x and y": Mistake(
        "lens shift's sign in x and y",
        lens(shift_x_px=lambda c: -c.shift_x_px, shift_y_px=lambda c: -c.shift_y_px),
        shift=(18.0, 14.0),
    ),
    **{
        f"frames {by:+d}": Mistake(f"frames {by:+d}", frames_by(by)) for by in (1, 2, 3, -1, -2, -3)
    },
    "reversed": Mistake(
        "reversed path",
        on_sets(lambda scene, sets: {f: sets[max(sets) - f] for f in sets}),
    ),
    "ids from 1": Mistake("ids +1", ids_by(1)),
    "ids from -1": Mistake("ids -1", ids_by(-1)),
    "what was culled": Mistake(
        "complement", each(lambda scene, ids: np.setdiff1d(np.arange(scene.object_count), ids))
    ),
    "inside out": Mistake(
        "inside out",
        lambda scene, path, sets: (wound(scene), path, sets),
        one_sided=True,
        only="owners",
    ),
    "eyes swapped": Mistake(
        "eyes swapped",
        on_sets(
            lambda scene, sets: {
                f: {"left": s["right"], "right": s["left"]} for f, s in sets.items()
            }
        ),
        stereo=True,
    ),
    "origin in the middle": Mistake(
        "origin at middle", at_origin(lambda low, high: (low + high) / 2)
    ),
    "origin in the floor's middle": Mistake(
        "origin at middle of its floor", at_origin(floor_middle)
    ),
    "origin at the lowest corner": Mistake(
        "origin at lowest corner", at_origin(lambda low, high: low)
    ),
}
