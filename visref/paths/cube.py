"""Cube maps: six views of one eye, which together see every direction once, but for ties on the
borders."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from visref.camera import Camera
from visref.camera_path import Frame
from visref.errors import InputError
from visref.scene import Float64

# Each face's view by the axis along which it looks, and where right and up point in its image.
FACES = {
    "px": ((0, 0, 1), (0, 1, 0)),
    "nx": ((0, 0, -1), (0, 1, 0)),
    "py": ((1, 0, 0), (0, 0, 1)),
    "ny": ((1, 0, 0), (0, 0, -1)),
    "pz": ((-1, 0, 0), (0, 1, 0)),
    "nz": ((1, 0, 0), (0, 1, 0)),
}


def cube_views(
    eye: Float64, size: int, near: float, far: float = math.inf, *, cut: bool = False
) -> tuple[Camera, ...]:
    """Six square views of `size` pixels a side and 90 degrees, along the axes of the world, from
    `eye`, (3,) float64. They keep the world's handedness. Raises InputError as `Camera` does."""
    cameras = []
    for view, (right, up) in FACES.items():
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, up, np.cross(right, up)
        pose[:3, 3] = eye
        cameras.append(Camera(pose, size, size, near, far, yfov=math.pi / 2, cut=cut, view=view))
    return tuple(cameras)


def cube_frame(
    frame: Frame, size: int, near: float | None = None, far: float | None = None
) -> Frame:
    """A frame with the six views of its eye in place of its own, and their range unless another is
    given. Raises InputError where its views have several eyes."""
    first, *others = frame.cameras
    if any(not np.array_equal(first.eye, other.eye) for other in others):
        raise InputError("its views have several eyes", fix="give a path whose frames have one eye")
    eye = first.eye + np.array(first.origin)
    near, far = first.near if near is None else near, first.far if far is None else far
    return replace(frame, cameras=cube_views(eye, size, near, far, cut=first.cut))
