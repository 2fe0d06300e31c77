"""A frame in which things move, pose and cast, as a share of a frame in which all stands still."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.measuring import alternate
from benchmarks.scenes import cameras, town
from visref.camera import Camera
from visref.engines.base import TruthEngine
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.engines.open3d import Open3DEngine
from visref.scene import Scene

# Of 192 triangles each: a million.
OBJECTS = 5209
TITLE = "Posing and casting a frame, shares of a still frame, 1280x960"

ROUNDS = 7
SHARES = (0.01, 0.1, 1.0)
ENGINES: list[tuple[Callable[[Scene], TruthEngine], int]] = [
    # Engines, and how many times smaller in each direction their images are.
    (EmbreeEngine, 1),
    (Open3DEngine, 1),
    (ExactEngine, 4),
]


def poses(still: Scene, share: float, count: int = 2, seed: int = 5) -> list[Scene]:
    """The scene at so many moments, a share of its objects shaken by up to half their size."""
    rng = np.random.default_rng(seed)
    moving = np.zeros(still.object_count, np.bool_)
    moving[rng.permutation(len(moving))[: max(1, round(share * len(moving)))]] = True
    result = []
    for _ in range(count):
        way = np.where(moving[:, None], rng.uniform(-5.0, 5.0, (len(moving), 3)), 0.0)
        of_vertex = np.zeros(len(still.vertices), np.int32)
        of_vertex[still.triangles.ravel()] = np.repeat(still.object_of_triangle, 3)
        vertices = (still.vertices + way[of_vertex]).astype(np.float32)
        result.append(replace(still, vertices=vertices, moving=moving))
    return result


def run() -> list[dict[str, str]]:
    scene, views = town(count=OBJECTS), cameras()
    return [
        _row(make, size, scene, share, name, camera)
        for make, size in ENGINES
        for share in SHARES
        for name, camera in views.items()
    ]


def _row(
    make: Callable[[Scene], TruthEngine],
    smaller: int,
    scene: Scene,
    share: float,
    name: str,
    camera: Camera,
) -> dict[str, str]:
    camera = replace(camera, width=camera.width // smaller, height=camera.height // smaller)
    moments = poses(scene, share)
    moved = make(moments[0])
    plain = make(replace(moments[0], moving=None))
    turn = iter(range(1 << 30))

    def pose() -> None:
        moved.pose(moments[next(turn) % 2])

    def frame() -> None:
        pose()
        moved.frame(camera)

    seconds = alternate([lambda: plain.frame(camera), frame, pose], ROUNDS)
    for engine in (moved, plain):
        engine.close()
    return {
        "engine": moved.name,
        "moving": f"{100 * share:g} %",
        "view": name,
        "still frame": f"{seconds[0] * 1e3:.0f} ms",
        "pose": f"{seconds[2] * 1e3:.1f} ms",
        "pose and frame": f"{seconds[1] * 1e3:.0f} ms",
        "ratio": f"{seconds[1] / seconds[0]:.2f}",
    }
