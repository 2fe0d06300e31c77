"""A path gone through again and again, each time from a little aside.

A check convicts with as few frames as it can, before a scene that is as plain and symmetrical as
can be: there, many a mistake loses the same objects. Those who ask for causes have paths of many
frames; so has what the table is made from.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.placing import somewhere
from visref.scene import Float64, Scene

# Frames in all, at least; passes, at most; the seed.
FRAMES, PASSES, SEED = 24, 8, 17
# How far aside, of the objects' middle distance from the first camera, and by how many degrees.
ASIDE, TURNED = 0.03, 4.0


def longer(scene: Scene, path: CameraPath) -> CameraPath:
    """The path, and passes more over its frames, each with all of its cameras moved and turned
    alike by a draw of its own. Each pass begins with a cut."""
    rng = np.random.Generator(np.random.PCG64(SEED))
    centres = somewhere(scene.object_bounds).mean(axis=1)
    away = float(np.median(np.linalg.norm(centres - path.frames[0].cameras[0].eye, axis=1)))
    frames = list(path.frames)
    passes = min(PASSES, -(-FRAMES // len(frames)))
    for _ in range(passes - 1):
        for place, frame in enumerate(path.frames):
            step = rng.uniform(-ASIDE, ASIDE, 3) * away
            turn = _rotation(rng.uniform(-TURNED, TURNED, 3))
            cameras = tuple(
                _moved(one, step, turn, cut=one.cut or not place) for one in frame.cameras
            )
            frames.append(replace(frame, cameras=cameras))
    return CameraPath(frames)


def _moved(camera: Camera, step: Float64, turn: Float64, *, cut: bool) -> Camera:
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = turn @ pose[:3, :3]
    pose[:3, 3] += step
    return replace(camera, world_from_camera=pose, cut=cut)


def _rotation(degrees: Float64) -> Float64:
    """(3, 3), about x, then y, then z."""
    result = np.eye(3)
    for axis, angle in enumerate(np.radians(degrees)):
        a, b = [i for i in range(3) if i != axis]
        one = np.eye(3)
        one[a, a] = one[b, b] = np.cos(angle)
        one[a, b], one[b, a] = -np.sin(angle), np.sin(angle)
        result = one @ result
    return result
