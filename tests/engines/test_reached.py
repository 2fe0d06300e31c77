"""No ray is cast where nothing can be met, and none is missed by that."""

from __future__ import annotations

import numpy as np
import pytest

from tests.engines.test_packets import assert_cast_alike
from tests.support.motion import moments
from visref.camera import Camera, look_at
from visref.engines.embree import EmbreeEngine
from visref.engines.embree_packets import PacketScene
from visref.engines.grids import sample_grid
from visref.engines.reached import LEAST_RUN, boxes_of_runs
from visref.scene import Scene

SEEDS = 24


def clumps(seed: int, *, at=(0.0, 0.0, 0.0), size: float = 1.0) -> Scene:
    """Some clumps of small triangles, as many each as make a run, wide apart."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-9.0, 9.0, (12, 3))
    triangles = LEAST_RUN * len(middles)
    away = rng.normal(0.0, 0.4, (triangles, 1, 3)) + rng.normal(0.0, 0.15, (triangles, 3, 3))
    corners = (np.repeat(middles, LEAST_RUN, axis=0)[:, None] + away) * size + at
    return Scene(
        corners.reshape(-1, 3).astype(np.float32),
        np.arange(3 * triangles, dtype=np.int32).reshape(-1, 3),
        np.array([0, triangles]),
        ["clumps"],
    )


def cameras(seed: int, *, at=(0.0, 0.0, 0.0), size: float = 1.0):
    """From among the clumps, from within one, and from afar, of both kinds."""
    rng = np.random.default_rng([seed, 1])
    width, height = rng.integers(30, 140, 2).tolist()
    for away in (3.0, 30.0):
        eye, target = (rng.uniform(-away, away, 3) * size + at for _ in range(2))
        pose = look_at(eye, target)
        near, far = 0.01 * size, 80.0 * size
        yfov = rng.uniform(0.2, 2.5)
        yield Camera(pose, width, height, near, far, yfov=yfov, shift_x_px=0.3 * width)
        yield Camera(pose, height, width, -far, far, ymag=rng.uniform(1.0, 15.0) * size)


def reached(engine: EmbreeEngine, camera: Camera):
    """(r, c) bool by block, and columns and rows of a block."""
    casts, grid = engine._casts, sample_grid(camera)
    assert isinstance(casts, PacketScene)
    slack = engine._start(grid)[1]
    flags = casts.reached(grid, engine.rebase, engine.scale, slack) > 0
    return flags, (4, casts.lanes // 4)


@pytest.mark.parametrize("seed", range(SEEDS))
def test_what_is_cast_in_some_blocks_is_what_rays_say_everywhere(seed: int) -> None:
    engine = EmbreeEngine(clumps(seed))
    for camera in cameras(seed):
        assert_cast_alike(engine, camera)
    engine.close()


@pytest.mark.parametrize(("at", "size"), [((4e5, 0.0, -2e5), 1.0), ((0.0, 0.0, 0.0), 1e-4)])
@pytest.mark.parametrize("seed", range(0, SEEDS, 4))
def test_neither_far_away_nor_tiny_is_any_missed(seed: int, at, size: float) -> None:
    engine = EmbreeEngine(clumps(seed, at=at, size=size))
    for camera in cameras(seed, at=at, size=size):
        assert_cast_alike(engine, camera)
    engine.close()


@pytest.mark.parametrize("seed", range(0, SEEDS, 4))
def test_nor_is_what_moves(seed: int) -> None:
    scenes = moments(clumps(seed), seed, 3, share=0.5)
    engine = EmbreeEngine(scenes[0])
    for scene in scenes:
        engine.pose(scene)
        for camera in cameras(seed):
            assert_cast_alike(engine, camera)
    engine.close()


def test_most_of_an_empty_image_is_not_cast() -> None:
    shares = []
    for seed in range(SEEDS):
        engine = EmbreeEngine(clumps(seed))
        shares += [reached(engine, camera)[0].mean() for camera in cameras(seed)]
        engine.close()
    assert np.median(shares) < 0.6
    assert min(shares) < 0.1
    assert max(shares) > 0.5


def test_a_rectangle_is_a_pixel_wider_all_round() -> None:
    """Of a square from (13.5, 7.5) to (33.5, 17.5) in pixels: from 12.5 to 34.5 and 6.5 to 18.5."""
    corners = np.array([[13.5, 7.5], [33.5, 7.5], [33.5, 17.5], [13.5, 17.5]])
    points = np.column_stack([corners[:, 0] - 31.5, 23.5 - corners[:, 1], np.full(4, -5.0)])
    scene = Scene(
        points.astype(np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.array([0, 2]),
        ["square"],
    )
    engine = EmbreeEngine(scene)
    flags, (columns, rows) = reached(engine, Camera(np.eye(4), 64, 48, 1.0, 10.0, ymag=24.0))
    engine.close()
    wanted = np.zeros_like(flags)
    wanted[6 // rows : 18 // rows + 1, 12 // columns : 34 // columns + 1] = True
    assert (flags == wanted).all()


def test_boxes_hold_their_runs() -> None:
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(300, 3)).astype(np.float32)
    triangles = rng.integers(0, 300, (1000, 3)).astype(np.int32)
    boxes = boxes_of_runs(vertices, triangles)
    assert len(boxes) == -(-1000 // LEAST_RUN)
    for g, (low, high) in enumerate(boxes):
        points = vertices[triangles[g * LEAST_RUN : (g + 1) * LEAST_RUN]].reshape(-1, 3)
        assert (low == points.min(axis=0)).all()
        assert (high == points.max(axis=0)).all()
