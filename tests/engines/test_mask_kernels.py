"""Masked triangles are looked through front to back, and no further than anything shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.masks.test_by_edges import blobs
from tests.support.mask_by_edges import state_by_edges
from visref.camera import Camera
from visref.compiled import njit
from visref.engines import make_engine
from visref.engines.deciding import Deciding, OwnerDepths
from visref.engines.grids import sample_grid
from visref.engines.mask_kernels import Scratch, in_view, shown
from visref.engines.ray_kernels import (
    SampleGrid,
    Triangles,
    corner,
    counts,
    depth_interval,
    facet_of,
    minus,
)
from visref.engines.splat_kernels import at_sample, edge, meets, window_of
from visref.masks.by_edges import facing, reach_of
from visref.masks.hits import state_at
from visref.masks.lookup import BETWEEN, SOLID, UNSURE
from visref.masks.materials import MaskMaterial, Sampler, Wrap
from visref.masks.store import MaskArrays, Masks
from visref.scene import Alpha, Scene
from visref.visibility import BACKGROUND, FrameTruth
from visref_datasets_gen.dataset import scene_of
from visref_datasets_gen.leaf_cards import leaves

WIDTH, HEIGHT = 37, 21
OPAQUE, MASKED = 3, 14


@njit(error_model="numpy")
def hit(
    t: int,
    x: int,
    y: int,
    mesh: Triangles,
    grid: SampleGrid,
    owner: NDArray[np.int32],
    masks: MaskArrays,
    row: int,
    axes: NDArray[np.float64],
) -> tuple[int, float, float]:
    """What a triangle's mask says at a sample, -2 where it is not met or lies behind the owner for
    certain; its depth, and a bound of that: one sample at a time, and one rule after another."""
    eye = (axes[0, 0], axes[0, 1], axes[0, 2])
    v0, v1, v2 = corner(mesh, t, 0), corner(mesh, t, 1), corner(mesh, t, 2)
    p0, p1, p2 = minus(v0, eye), minus(v1, eye), minus(v2, eye)
    a, b = grid.column_a[x], grid.row_b[y]
    x0, x1, y0, y1 = window_of(grid, (p0, p1, p2), (0, len(grid.column_a), 0, len(grid.row_b)))
    if not (x0 <= x < x1 and y0 <= y < y1):
        return -2, 0.0, 0.0
    edges = (edge(grid, p0, p1), edge(grid, p1, p2), edge(grid, p2, p0))
    facet, sides = facet_of(mesh, grid, t), at_sample(edges, a, b)
    if not meets(sides, facet, mesh, grid, t, a, b):
        return -2, 0.0, 0.0
    z, error = depth_interval(facet, grid, a, b)
    if not counts(grid, z, a, b):
        return -2, 0.0, 0.0
    behind = owner[y * len(grid.column_a) + x]
    if behind >= 0:
        depth, slack = depth_interval(facet_of(mesh, grid, behind), grid, a, b)
        if z - error > depth + slack:
            return -2, 0.0, 0.0
    if row < 0:
        return BETWEEN, z, error
    reach = reach_of(grid, (0, len(grid.column_a), 0, len(grid.row_b)))
    state = state_by_edges(masks, facing(masks, row, edges, (p0, p1, p2), reach), sides)
    if state == UNSURE:
        state = state_at(masks, row, axes, a, b, grid.perspective, v0, v1, v2)
    return state, z, error


def random_scene(seed: int) -> tuple[Scene, Camera, NDArray[np.int32]]:
    """A few opaque triangles and more masked ones before a camera; and owners of its samples."""
    rng = np.random.default_rng(seed)
    camera = Camera(
        np.eye(4), WIDTH, HEIGHT, near=0.5, far=float(rng.choice([6.0, np.inf])),
        **({"yfov": 1.0} if rng.random() < 0.7 else {"ymag": 2.0}),
        clip_plane=(0.3, 0.2, 0.1, 1.0) if rng.random() < 0.2 else None,
    )  # fmt: skip
    count = OPAQUE + MASKED
    size = rng.choice([0.2, 1.0, 4.0], (count, 1, 1))
    centre = rng.uniform([-3, -2, -8], [3, 2, -0.5], (count, 3))[:, None]
    corners = centre + size * rng.uniform(-1, 1, (count, 3, 3))
    if rng.random() < 0.3:
        # On a grid, so that edges run through samples, and planes coincide.
        corners = np.round(2.0 * corners) / 2.0
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    scene = Scene.from_objects([("all", corners.reshape(-1, 3), triangles)])
    alpha = np.full(count, Alpha.MASK, scene.alpha.dtype)
    alpha[:OPAQUE] = Alpha.OPAQUE
    image = blobs(rng, int(rng.integers(1, 90)), int(rng.integers(1, 150)))
    modes = list(Wrap)
    materials = [
        MaskMaterial(
            0, Sampler(modes[rng.integers(3)], modes[rng.integers(3)], nearest=i == 3), cutoff=0.5
        )
        for i in range(4)
    ]
    row = np.arange(count) - OPAQUE
    row[rng.random(count) < 0.1] = -1
    uv = rng.uniform(-0.2, 1.2, (MASKED, 3, 2)) * rng.choice([0.1, 1.0, 8.0], (MASKED, 1, 1))
    vertex_alpha = np.where(rng.random((MASKED, 1)) < 0.8, 1.0, rng.uniform(0.4, 1.0, (MASKED, 3)))
    row = np.where(row < 0, -1, row)
    masks = Masks.build(row, rng.integers(0, 4, MASKED), uv, vertex_alpha, materials, [image])
    one_sided = rng.random(count) < 0.3
    owner = np.repeat(rng.integers(-1, OPAQUE, WIDTH * HEIGHT // 7), 7).astype(np.int32)
    return replace(scene, alpha=alpha, masks=masks, one_sided=one_sided), camera, owner


@pytest.mark.parametrize("seed", range(8))
def test_an_engine_finds_in_each_view_what_a_fresh_one_finds(seed: int) -> None:
    """Room for what is looked through serves again: for views of any size and kind."""
    scene, camera, _ = random_scene(seed)
    rng = np.random.default_rng(seed)
    views = [
        replace(camera, width=int(width), height=int(height))
        for width, height in zip(
            rng.choice([9, 37, 70], 6), rng.choice([5, 21, 80], 6), strict=True
        )
    ]
    views += [replace(camera, shift_x_px=3.0), camera]
    engine = make_engine("embree", scene)
    found = engine.frames(views)
    for view, truth in zip(views, found, strict=True):
        fresh = make_engine("embree", scene)
        alone = fresh.frame(view)
        assert np.array_equal(truth.buffer.triangle, alone.buffer.triangle)
        for one, other in zip(astuple(truth.doubt), astuple(alone.doubt), strict=True):
            assert np.array_equal(one, other)
        fresh.close()
    assert any(len(truth.doubt) for truth in found)
    engine.close()


@pytest.mark.parametrize("seed", range(40))
def test_blocks_find_what_is_found_sample_by_sample(seed: int) -> None:
    scene, camera, owner = random_scene(seed)
    mesh = Triangles(scene.vertices, scene.triangles, scene.one_sided, scene.object_of_triangle)
    grid, masks = sample_grid(camera), scene.masks
    assert masks is not None
    axes = np.stack([camera.eye, camera.forward, camera.right_step, camera.up_step])
    which = np.random.default_rng(seed).permutation(np.arange(OPAQUE, OPAQUE + MASKED))
    seen = in_view(which.astype(np.int32), mesh, grid)
    wanted, open_ = owner.copy(), {}
    for s in range(WIDTH * HEIGHT):
        found = []
        for t in range(OPAQUE, OPAQUE + MASKED):
            told = hit(
                t, s % WIDTH, s // WIDTH, mesh, grid, owner, masks.arrays, masks.row[t], axes
            )
            found.append((*told, t))
        solid = [(z, t) for state, z, _, t in found if state == SOLID]
        behind = min((z + error for state, z, error, _ in found if state == SOLID), default=np.inf)
        before = OwnerDepths(mesh, grid)(owner[s : s + 1], np.array([s]))[0]
        if solid and min(solid)[0] < before:
            wanted[s] = min(solid)[1]
        left = [(z, t, z - e) for state, z, e, t in found if state == BETWEEN and z - e <= behind]
        if left:
            open_[s] = [t for _, t, _ in sorted(left)], min(least for *_, least in left)
    # In bands that hold whole blocks and others, as they may come.
    scratch, found = Scratch.of(grid, 8), owner.copy()
    parts = [
        shown(seen, mesh, grid, (top, min(top + 7, HEIGHT)), found, masks, axes, scratch)
        for top in range(0, HEIGHT, 7)
    ]
    assert (found == wanted).all()
    sample, many, triangle, least = (np.concatenate(part) for part in zip(*parts, strict=True))
    assert sample.tolist() == list(open_)
    assert many.tolist() == [len(which) for which, _ in open_.values()]
    assert triangle.tolist() == [t for which, _ in open_.values() for t in which]
    assert least.tolist() == [depth for _, depth in open_.values()]


def test_random_scenes_hold_all_that_matters() -> None:
    # Else nothing was compared.
    owned, left = 0, 0
    for seed in range(40):
        scene, camera, _ = random_scene(seed)
        engine = make_engine("embree", scene, threads=1)
        truth = engine.frame(camera)
        owned += np.count_nonzero(truth.buffer.triangle >= OPAQUE)
        left += len(truth.doubt)
        engine.close()
    assert owned > 2000
    assert left > 2000


@pytest.mark.parametrize("room", [1, 50])
def test_hits_that_find_no_room_are_not_lost(room: int) -> None:
    scene, camera, owner = random_scene(2)
    owner[:] = BACKGROUND
    mesh = Triangles(scene.vertices, scene.triangles, scene.one_sided, scene.object_of_triangle)
    grid = sample_grid(camera)
    masks = Masks.none(scene.triangle_count)
    axes = np.stack([camera.eye, camera.forward, camera.right_step, camera.up_step])
    seen = in_view(np.arange(OPAQUE, OPAQUE + MASKED, dtype=np.int32), mesh, grid)
    scratch = Scratch.of(grid, HEIGHT)
    usual = shown(seen, mesh, grid, (0, HEIGHT), owner.copy(), masks, axes, scratch)
    assert len(usual.triangle) > 200
    small = scratch._replace(hits=np.empty(room, scratch.hits.dtype))
    again = shown(seen, mesh, grid, (0, HEIGHT), owner.copy(), masks, axes, small)
    for one, same in zip(usual, again, strict=True):
        assert (one == same).all()


@pytest.mark.parametrize("view", range(3))
def test_the_order_in_which_masked_triangles_are_looked_at_is_seen_by_nobody(
    view: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = leaves(scale=0.1, frames=3)
    scene, camera = scene_of(dataset), dataset.path.cameras[view]
    camera = replace(camera, width=160, height=120)

    def seen() -> FrameTruth:
        engine = make_engine("embree", scene, threads=2)
        try:
            return engine.frame(camera).copy()
        finally:
            engine.close()

    usual = seen()
    assert len(usual.doubt) > 100
    rng = np.random.default_rng(view)
    orders: list[Callable[[int], NDArray[np.int64]]] = [
        lambda count: np.arange(count)[::-1],
        lambda count: rng.permutation(count),
    ]
    for order in orders:
        monkeypatch.setattr(Deciding, "_by_depth", lambda self, nearest: order(len(nearest)))  # noqa: B023
        other = seen()
        assert (other.buffer.triangle == usual.buffer.triangle).all()
        for one, same in zip(astuple(other.doubt), astuple(usual.doubt), strict=True):
            assert (one == same).all()
