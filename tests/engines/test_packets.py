"""Rays go by blocks of an image, in packets, and mostly with float32 alone: what they say is what
rays say that are cast and decided one by one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.support.motion import moments
from tests.support.truth_scenes import random_soup
from visref.camera import Camera, look_at
from visref.engines.embree import EmbreeEngine
from visref.engines.embree_packets import PacketScene
from visref.engines.grids import sample_grid
from visref.engines.packet_loops import well_shaped
from visref.engines.ray_kernels import PENDING
from visref.engines.rays import RayEngine
from visref.scene import Int32, Scene
from visref.visibility import BACKGROUND

SEEDS = 40


def cameras(seed: int) -> Iterator[Camera]:
    """Of either kind, with near and far through the soup, their sides of any remainder by four."""
    rng = np.random.default_rng([seed, 1])
    eye, target = rng.uniform(-1, 1, 3), rng.uniform((-1, -1, -6), (1, 1, -4))
    width, height = rng.integers(1, 70, 2).tolist()
    near, far = rng.uniform(0.1, 4.0), rng.uniform(4.0, 9.0)
    yield Camera(look_at(eye, target), width, height, near, far, yfov=rng.uniform(0.3, 2.0))
    yield Camera(look_at(eye, target), height, width, -near, far, ymag=3.0)


def soup(seed: int) -> Scene:
    """Triangles of which no two lie in one plane, of all shapes, some one-sided."""
    plain = random_soup(seed, triangles=150)
    rng = np.random.default_rng([seed, 2])
    corners = plain.vertices[plain.triangles]
    thin = rng.random(len(corners)) < 0.2
    corners[thin, 1] = corners[thin, 0] + 1e-4 * (corners[thin, 1] - corners[thin, 0])
    return Scene(
        corners.reshape(-1, 3),
        np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3),
        plain.object_offsets,
        plain.names,
        one_sided=rng.random(len(corners)) < 0.4,
    )


def owners(engine: EmbreeEngine, camera: Camera, *, one_by_one: bool = False) -> Int32:
    """(samples,) int32, what is cast before anything pending is settled."""
    return owners_of_views(engine, [camera], one_by_one=one_by_one)[0]


def owners_of_views(
    engine: EmbreeEngine, cameras: Sequence[Camera], *, one_by_one: bool = False
) -> Int32:
    """(v, samples) int32, the same of several views of one size, cast together."""
    grids = [sample_grid(camera) for camera in cameras]
    triangle = np.empty((len(cameras), cameras[0].samples), np.int32)
    cast = RayEngine._cast_all if one_by_one else EmbreeEngine._cast_all
    cast(engine, grids, [engine._start(grid) for grid in grids], triangle)
    return triangle


def assert_cast_alike(engine: EmbreeEngine, camera: Camera) -> None:
    """In blocks, and ray by ray."""
    assert (owners(engine, camera) == owners(engine, camera, one_by_one=True)).all()


@pytest.mark.parametrize("seed", range(SEEDS))
def test_blocks_are_rays_one_by_one(seed: int) -> None:
    engine = EmbreeEngine(soup(seed))
    for camera in cameras(seed):
        assert_cast_alike(engine, camera)
    engine.close()


@pytest.mark.parametrize("seed", range(SEEDS))
def test_eight_lanes_say_what_sixteen_say(seed: int) -> None:
    engine = EmbreeEngine(soup(seed))
    for camera in cameras(seed):
        found = []
        for lanes in (8, 16):
            casts = engine._casts
            assert isinstance(casts, PacketScene)
            if lanes > casts.lanes:
                pytest.skip("this machine has vectors of eight")
            casts.lanes = lanes
            found.append(owners(engine, camera))
            casts.lanes = 16
        assert (found[0] == found[1]).all()
    engine.close()


@pytest.mark.parametrize("seed", range(0, SEEDS, 4))
def test_views_cast_together_are_views_cast_alone(seed: int) -> None:
    """Of both kinds in one call, near and far, starts and reached blocks each its own."""
    engine = EmbreeEngine(soup(seed))
    some = [
        replace(camera, width=37, height=53)
        for number in range(seed, seed + 3)
        for camera in cameras(number)
    ]
    together = owners_of_views(engine, some)
    for camera, found in zip(some, together, strict=True):
        assert (found == owners(engine, camera)).all()
    assert len(np.unique(together, axis=0)) > 1
    engine.close()


@pytest.mark.parametrize("seed", range(0, SEEDS, 4))
def test_blocks_are_rays_one_by_one_where_something_moves(seed: int) -> None:
    scenes = moments(soup(seed), seed, 3, share=0.5)
    engine = EmbreeEngine(scenes[0])
    for scene in scenes:
        engine.pose(scene)
        for camera in cameras(seed):
            assert_cast_alike(engine, camera)
    engine.close()


def test_most_of_what_is_met_is_told_without_its_corners() -> None:
    """Else float64 would decide all, and nothing here could fail for what float32 says."""
    engine = EmbreeEngine(soup(0))
    camera = next(cameras(0))
    told = owners(engine, camera)
    # Corners that are nowhere: a triangle that is asked in float64 is no hit any more.
    engine._mesh = engine._mesh._replace(vertices=np.full_like(engine._mesh.vertices, np.nan))
    without = owners(engine, camera)
    hit = told >= 0
    assert np.mean(without[hit] == told[hit]) > 0.5
    assert (without[hit] != told[hit]).any()
    engine.close()


def square(z: float, *, facing: bool) -> np.ndarray:
    corners = np.array([[-1, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]], np.float32)
    return corners if facing else corners[::-1]


@pytest.mark.parametrize("facing", [False, True])
def test_a_side_is_told_of_the_triangle_that_is_named(facing: bool) -> None:
    """What moves lies in the very plane of what stands still, its other side to the eye: of both,
    the one is named and the other's normal is what the packet holds."""
    vertices = np.concatenate([square(-4, facing=facing), square(-4, facing=not facing)])
    scene = Scene(
        vertices.astype(np.float32),
        np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32),
        np.array([0, 2, 4], np.int64),
        ("still", "moving"),
        one_sided=np.ones(4, np.bool_),
        moving=np.array([False, True]),
    )
    engine = EmbreeEngine(scene)
    camera = Camera(np.eye(4), 16, 12, 0.5, 9.0, yfov=0.3)
    owner = engine.frame(camera).buffer.triangle
    assert np.isin(owner, [0, 1] if facing else [2, 3]).all()
    engine.close()


@pytest.mark.parametrize(
    ("corners", "well"),
    [
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], True),
        # Thinner than one in a thousand, though large.
        ([(0, 0, 0), (1, 0, 0), (0, 2.0**-11, 0)], False),
        # Of good shape, but of the size of float32's rounding where it lies.
        ([(1, 0, 0), (1 + 2.0**-20, 0, 0), (1, 2.0**-20, 0)], False),
        ([(0, 0, 0), (0, 0, 0), (1, 1, 1)], False),
        ([(0, 0, 0), (0.5, 0.5, 0.5), (1, 1, 1)], False),
    ],
)
def test_a_normal_is_trusted_where_rounding_cannot_turn_it(
    corners: list[tuple[float, float, float]], well: bool
) -> None:
    shaped = well_shaped(np.array(corners, np.float32), np.array([[0, 1, 2]], np.int32))
    assert shaped.tolist() == [well]


def test_depth_is_that_of_the_owner_as_it_was_cast() -> None:
    """Depths are asked for late: another frame cast meanwhile does not change them."""
    scene = soup(3)
    engine, other = EmbreeEngine(scene), EmbreeEngine(scene)
    first, second = cameras(3)
    truth = engine.frame(first).copy()
    engine.frame(second)
    right = other.frame(first)
    assert (right.buffer.triangle != BACKGROUND).any()
    assert truth.buffer.depth.tobytes() == right.buffer.depth.tobytes()
    engine.close()
    other.close()


@pytest.mark.parametrize("off", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("seed", range(4))
def test_what_is_met_edge_on_is_asked_in_float64(seed: int, off: float) -> None:
    """Triangles in the planes of the image's rows, but for some of a pixel: float32 meets those
    planes anywhere, and half of what it says of the closest is no hit."""
    rng = np.random.default_rng([seed, 3])
    camera, count = Camera(np.eye(4), 200, 150, 0.5, 9.0, yfov=1.5), 3000
    b = camera.row_b[rng.integers(camera.height, size=count)][:, None, None]
    b = b + off * rng.normal(size=(count, 3, 1))
    a = rng.uniform(camera.column_a.min(), camera.column_a.max(), (count, 3, 1))
    depth = rng.uniform(1, 8, (count, 3, 1))
    corners = depth * (camera.forward + a * camera.right_step + b * camera.up_step)
    scene = Scene(
        corners.reshape(-1, 3).astype(np.float32),
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        np.array([0, count], np.int64),
        ("edge-on",),
    )
    engine = EmbreeEngine(scene)
    told = owners(engine, camera)
    assert off > 1e-4 or (told == PENDING).sum() > 0.01 * (told >= 0).sum() > 0
    # The same rays, and nothing told by float32.
    engine._sides = np.zeros(count, np.uint8)
    assert (told == owners(engine, camera)).all()
    engine.close()
