"""Random scenes at several moments: things move, bend, come and go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.scene import Scene


def moments(
    scene: Scene, seed: int, count: int, *, share: float = 0.5, size: float = 1.0
) -> list[Scene]:
    """The scene at `count` moments, each made of the still one. A share of its objects moves: by
    a rotation and a way of about `size`, or with every vertex by itself; one in four of them
    is absent. Objects do not share vertices with others that stand still."""
    rng = np.random.default_rng(seed)
    moving = rng.random(scene.object_count) < share
    if scene.object_count:
        moving[rng.integers(scene.object_count)] = True
    return [_posed(scene, moving, rng, size) for _ in range(count)]


def _posed(scene: Scene, moving: NDArray[np.bool_], rng: np.random.Generator, size: float) -> Scene:
    vertices = scene.vertices.astype(np.float64)
    for each in np.flatnonzero(moving):
        first, last = scene.object_offsets[each : each + 2]
        rows = np.unique(scene.triangles[first:last])
        if not len(rows):
            continue
        if rng.random() < 0.5:
            turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            centre = vertices[rows].mean(axis=0)
            vertices[rows] = (vertices[rows] - centre) @ turn.T + centre
            vertices[rows] += rng.normal(size=3) * size
        elif rng.random() < 0.8:
            vertices[rows] += rng.normal(size=(len(rows), 3)) * 0.3 * size
    absent = moving & (rng.random(scene.object_count) < 0.25)
    return replace(scene, vertices=vertices.astype(np.float32), absent=absent, moving=moving.copy())


def with_own_vertices(scene: Scene) -> Scene:
    """The same scene, every triangle with vertices of its own."""
    count = scene.triangle_count
    return replace(
        scene,
        vertices=scene.vertices[scene.triangles].reshape(-1, 3),
        triangles=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        moved=None,
    )
