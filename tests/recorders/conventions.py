"""The conventions of engines, in closed form, as their documentation states them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

import numpy as np

# Pitch and yaw of a camera, in radians, and where it is. The first looks along an axis.
POSES = (
    (0.0, 0.0, (1.0, 2.0, 3.0)),
    (0.0, math.pi / 2, (-4.0, 0.5, 2.0)),
    (0.4, -2.1, (3.0, -7.0, 0.25)),
)
POINTS = np.random.default_rng(8).normal(size=(20, 3)) * 10
# A dozen roundings of float64 of numbers up to some 30.
CLOSE = {"rtol": 0, "atol": 1e-13}
# As many of float32.
CLOSE_FLOAT = {"rtol": 0, "atol": 3e-5}


def seen(camera: dict, points: np.ndarray) -> np.ndarray:
    """Points of the scene in the camera of a recording's line: to the right, up, ahead."""
    if "world_from_camera" in camera:
        matrix = np.linalg.inv(np.array(camera["world_from_camera"], float))
    else:
        matrix = np.array(camera["camera_from_world"], float)
    rotation = matrix[:3, :3]
    assert np.allclose(rotation @ rotation.T, np.eye(3), **CLOSE_FLOAT)
    assert np.linalg.det(rotation) > 0, "a mirrored camera"
    assert np.array_equal(matrix[3], (0, 0, 0, 1))
    return (points @ rotation.T + matrix[:3, 3]) * (1, 1, -1)


def from_axes(points: np.ndarray, eye: Sequence[float], *axes: Sequence[float]) -> np.ndarray:
    return (points - np.array(eye)) @ np.array(axes).T


# The engines, each in its own world.


def unreal(pitch: float, yaw: float) -> tuple[list[float], list[float], list[float]]:
    """The X, Y and Z axes of FRotator(pitch, yaw, 0): forward, right, up."""
    cp, sp, cy, sy = math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    return [cp * cy, cp * sy, sp], [-sy, cy, 0.0], [-sp * cy, -sp * sy, cp]


def in_unreal(points: np.ndarray) -> np.ndarray:
    return points[:, (0, 2, 1)] * 100


def look_at_lh(eye: Sequence[float], pitch: float, yaw: float) -> tuple[np.ndarray, tuple]:
    """Direct3D's LookAtLH with +Y up, for row vectors; and right, up, forward."""
    forward = np.array(
        [math.cos(pitch) * math.sin(yaw), math.sin(pitch), math.cos(pitch) * math.cos(yaw)]
    )
    right = np.cross([0, 1, 0], forward)
    right /= np.linalg.norm(right)
    up = np.cross(forward, right)
    view = np.eye(4)
    view[:3, 0], view[:3, 1], view[:3, 2] = right, up, forward
    view[3, :3] = -right @ eye, -up @ eye, -forward @ eye
    return view, (right, up, forward)


def negated(points: np.ndarray, axis: int) -> np.ndarray:
    return points * np.where(np.arange(3) == axis, -1.0, 1.0)


def y_down(eye: Sequence[float], pitch: float, yaw: float) -> tuple[np.ndarray, tuple]:
    """A view matrix for column vectors, x right, y down, z ahead; the world is right-handed."""
    forward = np.array(
        [math.cos(pitch) * math.sin(yaw), math.sin(pitch), -math.cos(pitch) * math.cos(yaw)]
    )
    right = np.array([math.cos(yaw), 0.0, math.sin(yaw)])
    up = np.cross(right, forward)
    view = np.eye(4)
    view[:3, :3] = right, -up, forward
    view[:3, 3] = -view[:3, :3] @ eye
    return view, (right, up, forward)


def lines_of(told: str) -> list:
    return [json.loads(line) for line in told.splitlines()]


def columns(numbers: Sequence[float]) -> dict:
    return {"camera_from_world": np.reshape(numbers, (4, 4)).T}


def projection(w: int, h: int, yfov: float, shift: tuple[float, float]) -> np.ndarray:
    """glFrustum's matrix; the frustum's window is moved by so many pixels to the right and down."""
    top, near, far = 0.1 * math.tan(yfov / 2), 0.1, 100.0
    per_pixel = 2 * top / h
    left, right = -top * w / h + shift[0] * per_pixel, top * w / h + shift[0] * per_pixel
    bottom, top = -top - shift[1] * per_pixel, top - shift[1] * per_pixel
    return np.array([
        [2 * near / (right - left), 0, (right + left) / (right - left), 0],
        [0, 2 * near / (top - bottom), (top + bottom) / (top - bottom), 0],
        [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
        [0, 0, -1, 0],
    ])  # fmt: skip


def orthographic(w: int, h: int, ymag: float, shift: tuple[float, float]) -> np.ndarray:
    """glOrtho's matrix, likewise."""
    per_pixel = 2 * ymag / h
    x, y = shift[0] * per_pixel, -shift[1] * per_pixel
    across = ymag * w / h
    return np.array(
        [
            [1 / across, 0, 0, -x / across],
            [0, 1 / ymag, 0, -y / ymag],
            [0, 0, -0.02, -1],
            [0, 0, 0, 1],
        ]
    )


LENSES = (
    ("yfov", 0.9, (0.0, 0.0)),
    ("yfov", 1.2, (0.25, -3.5)),
    ("ymag", 4.0, (0.0, 0.0)),
    ("ymag", 2.5, (-1.5, 0.75)),
)


def lens_matrix(kind: str, size: float, shift: tuple[float, float]) -> np.ndarray:
    return (projection if kind == "yfov" else orthographic)(64, 48, size, shift)


def check_lens(
    line: dict, kind: str, size: float, shift: tuple[float, float], tolerance: float
) -> None:
    assert math.isclose(line[kind], size, rel_tol=tolerance)
    assert ("yfov" in line) != ("ymag" in line)
    told = (line.get("shift_x_px", 0.0), line.get("shift_y_px", 0.0))
    assert np.allclose(told, shift, rtol=0, atol=64 * tolerance)


def check_left_handed(
    x: Sequence[float], z: Sequence[float], eye, pitch: float, yaw: float
) -> None:
    _, axes = look_at_lh(eye, pitch, yaw)
    for axis, matrix in ((0, x), (2, z)):
        assert np.allclose(
            seen(columns(matrix), POINTS), from_axes(negated(POINTS, axis), eye, *axes), **CLOSE
        )


def check_y_down(matrix: Sequence[float], eye, pitch: float, yaw: float) -> None:
    _, axes = y_down(eye, pitch, yaw)
    assert np.allclose(seen(columns(matrix), POINTS), from_axes(POINTS, eye, *axes), **CLOSE)


def check_yfov(yfov: float) -> None:
    """90 degrees across at 16:9: half the height is 9/16 of half the width, the distance."""
    assert math.isclose(math.tan(yfov / 2), 9 / 16, rel_tol=1e-15)
