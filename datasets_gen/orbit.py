"""The camera path around a model: turned about its axes, then from nearer and back."""

from __future__ import annotations

import math

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref_datasets_gen.graph import Node
from visref_datasets_gen.shapes import Float64

Place = tuple[float, float, float]

YFOV = math.radians(40.0)
SIZE_PX = (876, 584)


def check_frames(frames: int) -> None:
    """Raises InputError for a path without frames: at once, a model takes seconds to make."""
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")


def orbit(frames: int, nodes: tuple[Node, ...], detail: Place, *, nearest: float) -> CameraPath:
    """Two thirds of the frames turn the model about its own y, x and z axes, all in view; the
    rest move in on it and back.

    The path of Staneker, Bartz and Meissner ("Improving Occlusion Query Efficiency with
    Occupancy Maps", 2003, section 5.1), at their 876 by 584. A sphere that holds `nodes`, which
    have no children, fills the image's height at first; `detail`: where the zoom ends,
    `nearest`: how far from it, as a share of the first distance. Raises InputError for a path
    without frames.
    """
    check_frames(frames)
    centre, radius = _sphere(nodes)
    away = radius / math.sin(YFOV / 2)
    turning = frames - frames // 3
    cameras = []
    for k in range(frames):
        distance, axis, angle = away, 1, 0.0
        target = centre
        if k < turning:
            turn = 3.0 * (k + 0.5) / turning
            axis, angle = (1, 0, 2)[int(turn)], 2.0 * math.pi * (turn % 1.0)
        else:
            near = 0.5 - 0.5 * math.cos(2.0 * math.pi * (k + 0.5 - turning) / (frames - turning))
            distance = away * (1.0 - (1.0 - nearest) * near)
            target = centre + near * (np.array(detail) - centre)
            angle = 0.6 * near
        pose = np.eye(4)
        pose[:3, :3] = _rotation(axis, angle)
        pose[:3, 3] = pose[:3, :3] @ [0.0, 0.0, distance] + target
        cameras.append(Camera(pose, *SIZE_PX, near=0.03 * away, far=4.0 * away, yfov=YFOV))
    return CameraPath(tuple(cameras))


def _sphere(nodes: tuple[Node, ...]) -> tuple[Float64, float]:
    """Around all vertices, about the middle of their box: centre and radius."""
    points = np.concatenate(
        [
            primitive.vertices @ node.parent_from_node[:3, :3].T + node.parent_from_node[:3, 3]
            for node in nodes
            if node.mesh is not None
            for primitive in node.mesh.primitives
        ]
    )
    centre = np.asarray((points.min(axis=0) + points.max(axis=0)) / 2.0)
    return centre, float(np.linalg.norm(points - centre, axis=1).max())


def _rotation(axis: int, angle: float) -> Float64:
    result = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    result[[i, j], [i, j]] = math.cos(angle)
    result[i, j], result[j, i] = -math.sin(angle), math.sin(angle)
    return result
