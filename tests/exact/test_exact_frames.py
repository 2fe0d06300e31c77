"""Frames of many clusters and tiles: nothing that owns a sample is culled on the way to it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.support.exact_scenes import pose, rotation
from visref.camera import Camera
from visref.exact import ExactScene
from visref.exact.rational import ExactFrame
from visref.scene import Scene

pytestmark = pytest.mark.slow

WIDTH, HEIGHT = 200, 141


def town(rng: np.random.Generator, count: int) -> Scene:
    """Boxes, a few great triangles, crumbs and twins, all around the origin."""
    faces = [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 7, 3], [1, 5, 7]]
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    objects = []
    for i in range(count):
        at = rng.integers(-40, 40, 3) if i % 3 else rng.uniform(-40, 40, 3)
        size = rng.choice([0.02, 0.5, 3.0], p=[0.3, 0.5, 0.2]) * rng.uniform(0.5, 2.0, 3)
        box = corner * size + at
        objects.append((f"box {i}", box, np.array(faces)))
        if i % 20 == 0:
            objects.append((f"twin {i}", box, np.array(faces)))
    ground = np.array([[-300, -3, -300], [300, -3, -300], [300, -3, 300], [-300, -3, 300]])
    objects.append(("ground", ground, np.array([[0, 1, 2], [0, 2, 3]])))
    return Scene.from_objects(objects)


def cameras(rng: np.random.Generator) -> list[Camera]:
    def camera(
        eye: object, *, near: float = 0.1, aligned: bool = False, **options: float
    ) -> Camera:
        matrix = pose(rotation(rng, aligned=aligned), np.asarray(eye, float))
        return Camera(matrix, WIDTH, HEIGHT, near, options.pop("far", math.inf), **options)

    return [
        camera((0, 0, 0), yfov=1.2),
        camera((0, 1, 0), yfov=2.9, aligned=True),
        camera((0.3, 9.7, 0.2), yfov=1.6, near=1e-3, far=30.0),
        camera(rng.integers(-30, 30, 3), yfov=1.0, shift_x_px=13.25, shift_y_px=-70.0),
        camera((0, 0, 0), ymag=30.0, near=-100.0, far=100.0),
        camera((0.5, 0, 0), ymag=35.25, near=-5.0, far=50.0, aligned=True),
        camera((4e4, 3e4, -2e4), yfov=1.0),
    ]


@pytest.mark.parametrize("which", range(7))
def test_frames_equal_a_census_of_all_triangles_at_some_samples(which: int) -> None:
    rng = np.random.default_rng([12, which])
    scene = town(rng, 150)
    camera = cameras(rng)[which]
    if which == 6:
        # Look from afar at where the town is.
        to_town = -camera.eye / np.linalg.norm(camera.eye)
        right = np.cross(to_town, (0.0, 1.0, 0.0))
        right /= np.linalg.norm(right)
        turn = np.column_stack([right, np.cross(right, to_town), -to_town])
        camera = Camera(pose(turn, camera.eye), WIDTH, HEIGHT, 0.1, math.inf, yfov=0.002)
    frame = ExactScene(scene).certify(camera)
    flat = frame.buffer.triangle.reshape(-1)
    assert (flat >= 0).any()
    # Half of the samples where owners change: there something may be lost.
    changes = np.flatnonzero(np.diff(flat))
    assert len(changes)
    samples = np.concatenate([rng.choice(changes, 60), rng.integers(0, camera.samples, 60)])
    everything = np.arange(scene.triangle_count)
    exact = ExactFrame(camera, scene.vertices[scene.triangles], scene.one_sided)
    for sample in samples:
        at = np.full(len(everything), sample)
        hit = np.flatnonzero(exact.covers(everything, at))
        quotients = exact.quotients(hit, at[: len(hit)])
        nearest: list[int] = []
        for t, (n, d) in zip(hit, quotients, strict=True):
            if nearest:
                bn, bd = quotients[int(np.searchsorted(hit, nearest[0]))]
                order = n * bd - bn * d
                if order > 0:
                    continue
                if order < 0:
                    nearest = []
            nearest.append(int(t))
        own = [int(flat[sample])] if flat[sample] >= 0 else []
        assert own + frame.ties.triangle[frame.ties.sample == sample].tolist() == nearest
