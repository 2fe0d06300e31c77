"""The exact engine against Embree: seconds a frame, and in how many samples Embree differs."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.measuring import alternate
from benchmarks.scenes import cameras, town
from visref.camera import Camera, look_at
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.exact import ExactScene
from visref.scene import Scene
from visref.visibility import FrameTruth

TITLE = "Certified truth per frame, 1280x960"

ROUNDS = 7
DISPUTED = 1000
TERRAIN_CELLS = 707


def terrain(seed: int = 3) -> tuple[Scene, Camera]:
    """Hills of a million triangles in a hundred strips, all of them before the camera."""
    rng = np.random.default_rng(seed)
    line = np.linspace(-500.0, 500.0, TERRAIN_CELLS + 1)
    x, z = np.meshgrid(line, line)
    phase = rng.uniform(0.0, 2.0 * math.pi, (6, 2))
    y = sum(
        60.0 / 2**k * np.sin(0.008 * 2**k * x + p) * np.sin(0.008 * 2**k * z + q)
        for k, (p, q) in enumerate(phase)
    )
    points = np.stack([x, y, z], -1).reshape(-1, 3)
    side = TERRAIN_CELLS + 1
    corner = np.arange(TERRAIN_CELLS * side).reshape(TERRAIN_CELLS, side)[:, :-1]
    quads = corner.reshape(-1, 1, 1) + np.array([[0, side, side + 1], [0, side + 1, 1]])
    faces = quads.reshape(-1, 3).astype(np.int32)
    cuts = np.linspace(0, len(faces), 101).astype(np.int64)
    names = tuple(f"strip {i}" for i in range(100))
    camera = Camera(
        look_at((0.0, 150.0, 560.0), (0.0, 0.0, 0.0)), 1280, 960, 0.1, math.inf, yfov=1.0472
    )
    return Scene(points.astype(np.float32), faces, cuts, names), camera


def doubled_wall() -> tuple[Scene, Camera]:
    """Two walls in the same place before the whole image: every sample is a tie."""
    line = np.linspace(-9.0, 9.0, 101)
    x, y = np.meshgrid(line, line)
    points = np.stack([x, y, np.full_like(x, -5.0)], -1).reshape(-1, 3)
    corner = np.arange(100 * 101).reshape(100, 101)[:, :-1]
    faces = (corner.reshape(-1, 1, 1) + np.array([[0, 1, 102], [0, 102, 101]])).reshape(-1, 3)
    camera = Camera(np.eye(4), 1280, 960, 0.1, math.inf, yfov=1.0472)
    return Scene.from_objects([("wall", points, faces), ("its twin", points, faces)]), camera


def run() -> list[dict[str, str]]:
    rows = []
    boxes = town()
    cases = [(f"town, {name}", boxes, camera) for name, camera in cameras().items()]
    cases += [("hills", *terrain()), ("two walls in one place", *doubled_wall())]
    for title, scene, camera in cases:
        embree, exact = EmbreeEngine(scene), ExactEngine(scene)
        wrong = differing(embree.frame(camera), exact.frame(camera))
        samples = np.random.default_rng(1).integers(0, camera.samples, DISPUTED)
        few = ExactScene(scene)
        fast, sure, some = alternate(
            [
                lambda camera=camera, embree=embree: embree.frame(camera),
                lambda camera=camera, exact=exact: exact.frame(camera),
                lambda camera=camera, few=few, samples=samples: few.decide(camera, samples),
            ],
            ROUNDS,
        )
        rows.append(
            {
                "scene": title,
                "triangles": f"{scene.triangle_count:,}",
                "embree ms": f"{1e3 * fast:.0f}",
                "exact ms": f"{1e3 * sure:.0f}",
                "exact / embree": f"{sure / fast:.2f}",
                f"{DISPUTED:,} samples ms": f"{1e3 * some:.0f}",
                "embree wrong": f"{wrong:,}",
                "tied samples": f"{len(np.unique(exact.frame(camera).ties.sample)):,}",
            }
        )
    return rows


def differing(embree: FrameTruth, exact: FrameTruth) -> int:
    """Samples that Embree gives to a triangle which is not among the exact owners."""
    wrong = embree.buffer.triangle != exact.buffer.triangle
    tied = exact.ties
    right = embree.buffer.triangle.reshape(-1)[tied.sample] == tied.triangle
    wrong.reshape(-1)[tied.sample[right]] = False
    return int(wrong.sum())
