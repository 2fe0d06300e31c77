"""Small seeded scenes full of close calls, and cameras whose samples can be hit exactly."""

from __future__ import annotations

import math

import numpy as np

from visref.camera import Camera
from visref.scene import Scene

SIDE = 8
FAMILIES = (
    "grid",
    "loose",
    "on samples",
    "one plane",
    "slivers",
    "around the eye",
    "crossing",
    "tessellated",
)


def exact_yfov(half_height: float) -> float:
    """A field of view whose half-angle's tangent is exactly this float64."""
    guess = 2.0 * math.atan(half_height)
    for direction in (math.inf, 0.0):
        candidate = guess
        for _ in range(50):
            if math.tan(candidate / 2) == half_height:
                return candidate
            candidate = math.nextafter(candidate, direction)
    raise AssertionError(f"no float64 angle has the tangent {half_height}")


HALF = exact_yfov(0.5)


def rotation(rng: np.random.Generator, *, aligned: bool) -> np.ndarray:
    if aligned:
        matrix = np.eye(3)[:, rng.permutation(3)] * rng.choice([-1.0, 1.0], 3)
    else:
        matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    if np.linalg.det(matrix) < 0:
        matrix[:, 0] *= -1.0
    return matrix


def pose(rotation_: np.ndarray, eye: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation_, eye
    return matrix


def random_camera(rng: np.random.Generator) -> Camera:
    aligned = rng.random() < 0.5
    perspective = rng.random() < 0.6
    if aligned:
        eye = rng.integers(-4, 5, 3).astype(float)
    else:
        eye = rng.normal(size=3) * rng.choice([0.0, 1.0, 10.0, 1e5])
    near = float(rng.choice([0.125, 1.0, 2.0, 0.1]))
    if not perspective and rng.random() < 0.3:
        near = -float(rng.integers(0, 5))
    options: dict[str, float] = {}
    if perspective:
        options["yfov"] = HALF if rng.random() < 0.7 else float(rng.uniform(0.1, 3.0))
    else:
        options["ymag"] = float(rng.choice([4.0, 8.0, 3.3]))
    if rng.random() < 0.2:
        options["shift_x_px"] = float(rng.choice([0.5, -1.0, 0.3]))
        options["shift_y_px"] = float(rng.choice([0.5, 2.0, 1e-3]))
    far = float(rng.choice([8.0, 100.0, math.inf]))
    matrix = pose(rotation(rng, aligned=aligned), eye)
    return Camera(matrix, SIDE, SIDE, near, far, **options)


def points(rng: np.random.Generator, family: str, camera: Camera, count: int) -> np.ndarray:
    """(count, 3) float64 world points."""
    world_from_camera = camera.world_from_camera
    if family == "grid":
        local = rng.integers((-4, -4, -8), (5, 5, 2), (count, 3)) * rng.choice([1.0, 2.0, 0.5])
    elif family == "loose":
        local = rng.normal(size=(count, 3)) * rng.choice([1.0, 5.0, 1e6])
        local[:, 2] -= 5.0
    elif family == "on samples":
        x, y = rng.integers(0, SIDE, (2, count))
        t = rng.choice([1.0, 2.0, 4.0, 8.0, 8.0, -2.0, 0.125], count)
        rays = [camera.ray(int(i), int(j)) for i, j in zip(x, y, strict=True)]
        return np.array([o + s * d for (o, d), s in zip(rays, t, strict=True)])
    elif family == "one plane":
        origin = rng.integers((-3, -3, -8), (4, 4, 0))
        a, b = rng.integers(-3, 4, (2, 3))
        local = origin + rng.integers(-3, 4, (count, 1)) * a + rng.integers(-3, 4, (count, 1)) * b
    elif family == "slivers":
        start, along = rng.normal(size=3) * 2.0 - (0.0, 0.0, 4.0), rng.normal(size=3)
        local = start + rng.normal(size=(count, 1)) * 5.0 * along
        local = local + rng.normal(size=(count, 3)) * rng.choice([0.0, 1e-7, 1e-4, 0.1])
    elif family == "around the eye":
        local = rng.normal(size=(count, 3)) * rng.choice([1e-3, 1.0, 100.0])
    elif family == "crossing":
        local = rng.uniform((-9, -9, -20), (9, 9, 10), (count, 3))
    else:
        grid = np.stack(np.meshgrid(np.arange(4), np.arange(4)), -1).reshape(-1, 2)[:count]
        local = np.column_stack([grid * 2.0 - 3.0, np.full(len(grid), -4.0)])
        if rng.random() < 0.5:
            local[:, 2] += rng.integers(-1, 2, len(grid))
    return local @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]


def random_scene(rng: np.random.Generator, camera: Camera) -> Scene:
    family = str(rng.choice(FAMILIES))
    vertices = points(rng, family, camera, 16 if family == "tessellated" else 10)
    if family == "tessellated":
        corner = np.array([4 * i + j for i in range(3) for j in range(3)])
        triangles = np.concatenate([corner[:, None] + (0, 1, 5), corner[:, None] + (0, 5, 4)])
    else:
        triangles = rng.integers(0, len(vertices), (int(rng.integers(1, 12)), 3))
    if rng.random() < 0.4:
        copies = triangles[rng.integers(0, len(triangles), 2)]
        triangles = np.concatenate([triangles, copies[:, [1, 0, 2]]])
    count = len(triangles)
    cuts = np.sort(rng.integers(0, count + 1, 2))
    alpha = np.zeros(count, np.uint8)
    if rng.random() < 0.3:
        alpha = rng.integers(0, 3, count).astype(np.uint8)
    one_sided = rng.random(count) < (0.5 if rng.random() < 0.3 else 0.0)
    return Scene(
        vertices=vertices.astype(np.float32),
        triangles=triangles.astype(np.int32),
        object_offsets=np.array([0, *cuts, count]),
        names=("a", "b", "c"),
        one_sided=one_sided,
        alpha=alpha,
    )


def random_case(*seed: int) -> tuple[Scene, Camera]:
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    return random_scene(rng, camera), camera
