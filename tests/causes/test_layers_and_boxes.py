"""What hypotheses rest on: boxes before a camera, and two depths per sample, each against plain
loops that share nothing with them."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from tests.support.culling_scenes import random_camera, random_scene
from visref.causes.boxes import Boxes, within
from visref.causes.evidence import Membership
from visref.causes.layers import Layers, ask, draw
from visref.causes.shapes import _spread
from visref.causes.texels import blocks
from visref.conformance.building import camera
from visref.scene import Units

SEEDS = range(6)


def place(seed, **changes):
    rng = np.random.default_rng(seed)
    return random_scene(rng, 14), replace(random_camera(rng, 19, 13), **changes)


# Boxes.


@pytest.mark.parametrize("seed", SEEDS)
def test_corners_lie_where_extended_precision_puts_them(seed):
    """Right, up and depth, and pixels before the eye. Float64 errs by a few 2^-53 of the sums, and
    extended precision by far less; 1e-12 of the greatest summand is above both."""
    scene, view = place(seed)
    boxes = Boxes(view, scene.object_bounds)
    pose = view.world_from_camera.astype(np.longdouble)
    step = np.longdouble(np.linalg.norm(view.right_step))
    for k, (low, high) in enumerate(scene.object_bounds.astype(np.longdouble)):
        size = float(max(abs(low).max(), abs(high).max(), abs(pose[:3, 3]).max()))
        for c, pick in enumerate(product((0, 1), repeat=3)):
            corner = np.array([(low, high)[side][axis] for axis, side in enumerate(pick)])
            offset = corner - pose[:3, 3]
            right, up, back = (offset @ pose[:3, axis] for axis in range(3))
            found = boxes.seen_from[k, c]
            assert np.allclose(found, [float(right), float(up), float(-back)], atol=1e-12 * size)
            depth = -back if view.is_perspective else np.longdouble(1)
            if depth > 1e-3:
                x = (right / (step * depth) - view.column_a[0]) / 2
                y = (view.row_b[0] - up / (step * depth)) / 2
                told = boxes.pixels(boxes.seen_from)[k, c]
                # Pixels are so many steps of a depth.
                error = 1e-12 * size / float(step * depth)
                assert np.allclose(told, [float(x), float(y)], atol=error, rtol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_plane_by_plane_a_corner_is_beyond_as_clip_space_has_it(seed):
    scene, view = place(seed, far=50.0)
    boxes = Boxes(view, scene.object_bounds)
    corners = np.concatenate([boxes.corners, np.ones((*boxes.corners.shape[:2], 1))], axis=2)
    clip = corners @ view.clip_from_world().T
    x, y, z, w = np.moveaxis(clip, 2, 0)
    wanted = np.stack([x < -w, x > w, y < -w, y > w, z < -w, z > w], axis=2)
    gap = np.abs(np.stack([x + w, x - w, y + w, y - w, z + w, z - w], axis=2))
    # What is no farther from a plane than roundings is on either side.
    sure = gap > 1e-9 * (1.0 + np.abs(clip).max())
    assert (boxes.planes == wanted)[sure].all()
    assert sure.mean() > 0.9


def test_box_of_what_is_not_there_lies_nowhere():
    boxes = Boxes(camera(), np.array([[[np.inf] * 3, [-np.inf] * 3], [[-1, -1, -9], [1, 1, -8]]]))
    assert boxes.there.tolist() == [False, True]
    assert boxes.in_view.tolist() == [False, True]


@pytest.mark.parametrize("texel", [1, 2, 4])
@pytest.mark.parametrize("inward", [False, True])
def test_rectangle_holds_the_samples_a_span_touches_or_the_texels_within_it(texel, inward):
    view = camera(width=21, height=13)
    rng = np.random.default_rng(texel)
    low = rng.uniform(-6.0, 20.0, (200, 2))
    spans = np.concatenate([low, low + rng.uniform(0.0, 9.0, (200, 2))], axis=1)
    found = within(view, spans, texel=texel, inward=inward)
    for (x0, y0, x1, y1), rectangle in zip(spans.tolist(), found.tolist(), strict=True):
        for first, last, side, low_end, high_end in (
            (rectangle[0], rectangle[2], 21, x0, x1),
            (rectangle[1], rectangle[3], 13, y0, y1),
        ):
            texels = range(-(-side // texel))
            told = {i for i in texels if first <= i <= last}
            # Texel i is the pixels from i n to i n + n - 1, a pixel half a one about it.
            if inward:
                wanted = {
                    i
                    for i in texels
                    if low_end <= i * texel - 0.5 and i * texel + texel - 0.5 <= high_end
                }
                assert told == wanted
            else:
                pixels = range(len(texels) * texel)
                touched = [s for s in pixels if low_end - 1 < s < high_end + 1]
                assert told == {s // texel for s in touched}


# Layers.


def depths_by_ray(scene, view):
    """(h, w, t) view depths of each triangle at each sample, inf for none, and (h, w) by how
    much the answer is sure: the least barycentric coordinate or share of near and far that would
    change it."""
    corners = scene.vertices.astype(np.float64)[scene.triangles]
    found = np.full((view.height, view.width, len(corners)), np.inf)
    sure = np.full((view.height, view.width), np.inf)
    for y, x in np.ndindex(view.height, view.width):
        start, way = view.ray(x, y)
        a, b, c = (corners[:, i] - start for i in range(3))
        weights = np.stack([np.cross(b, c) @ way, np.cross(c, a) @ way, np.cross(a, b) @ way], 1)
        normal = np.cross(b - a, c - a)
        with np.errstate(all="ignore"):
            weights /= weights.sum(axis=1, keepdims=True)
            t = np.einsum("ij,ij->i", normal, a) / (normal @ way)
        there = np.isfinite(t) & np.isfinite(weights).all(axis=1)
        hit = there & (weights.min(axis=1) >= 0.0) & (t >= view.near) & (t <= view.far)
        found[y, x, hit] = t[hit]
        edges = np.abs(weights[there].min(axis=1))
        ends = [np.abs(t[there] / end - 1.0) for end in (view.near, view.far) if end]
        sure[y, x] = min([edges.min(initial=np.inf), *(e.min(initial=np.inf) for e in ends)])
    return found, sure


@pytest.mark.parametrize("seed", SEEDS)
def test_layers_hold_the_nearest_depth_whose_it_is_and_that_of_the_others(seed):
    scene, view = place(seed)
    owner = scene.object_of_triangle
    layers = Layers.empty(view.height, view.width)
    every = np.arange(scene.triangle_count)
    draw(layers, scene.vertices, scene.triangles, view, every, owner)
    depth, sure = depths_by_ray(scene, view)
    checked = 0
    for y, x in np.ndindex(view.height, view.width):
        if sure[y, x] < 1e-6:
            continue
        checked += 1
        of_object = [depth[y, x, owner == o].min(initial=np.inf) for o in range(scene.object_count)]
        order = np.argsort(of_object, kind="stable")
        nearest, second = (of_object[o] for o in order[:2])
        assert layers.nearest[y, x] == pytest.approx(nearest, rel=1e-6)
        assert layers.second[y, x] == pytest.approx(second, rel=1e-6)
        if np.isfinite(nearest) and second > nearest * (1 + 1e-5):
            assert layers.owner[y, x] == order[0]
        elif np.isinf(nearest):
            assert layers.owner[y, x] == -1
    assert checked > 0.8 * view.samples


def test_triangles_across_the_near_plane_are_cut_there():
    """A ramp from (0, -1, 3) behind the eye to (0, -1, -9): at 45 degrees down it is 1 deep."""
    ramp = np.array([[-50, -1, 3], [50, -1, 3], [50, -1, -9], [-50, -1, -9.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    view = camera(width=1, height=64, yfov=np.pi / 2, near=2.0)
    layers = Layers.empty(64, 1)
    draw(layers, ramp, faces, view, np.arange(2), np.zeros(2, np.int32))
    for y in range(64):
        slope = (2 * y + 1 - 64) / 64
        depth = 1.0 / slope if slope > 0 else np.inf
        wanted = depth if 2.0 <= depth <= 9.0 else np.inf
        assert layers.nearest[y, 0] == pytest.approx(wanted)


def test_clip_plane_cuts_what_lies_before_it():
    """Of a sheet at depth 5 what is left of x = 1 is cut: x - 1 >= 0 counts."""
    sheet = np.array([[-9, -9, -5], [9, -9, -5], [9, 9, -5], [-9, 9, -5.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    view = camera(width=8, height=4, ymag=2.0, clip_plane=(1.0, 0.0, 0.0, -1.0))
    layers = Layers.empty(4, 8)
    draw(layers, sheet, faces, view, np.arange(2), np.zeros(2, np.int32))
    # Samples at -3.5 ... 3.5.
    assert np.isfinite(layers.nearest[0]).tolist() == [False] * 5 + [True] * 3


def random_layers(rng, height=11, width=9):
    owner = rng.integers(-1, 4, (height, width)).astype(np.int32)
    nearest = np.where(owner < 0, np.inf, rng.integers(1, 9, (height, width)))
    second = np.where(rng.random((height, width)) < 0.2, np.inf, nearest + rng.integers(0, 3))
    return Layers(nearest, owner, np.where(owner < 0, np.inf, second))


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_rectangle_is_told_the_depths_of_all_others(seed, own):
    rng = np.random.default_rng(seed)
    layers = random_layers(rng)
    low = rng.integers(0, 9, (40, 2))
    rectangles = np.concatenate([low, low + rng.integers(-1, 5, (40, 2))], axis=1)
    rectangles[:, 2:] = np.minimum(rectangles[:, 2:], (8, 10))
    depths, units = rng.integers(1, 9, 40).astype(float), rng.integers(0, 4, 40).astype(np.int32)
    found = ask(layers, rectangles.astype(np.int32), depths, units, own=own, whole=True)
    early = ask(layers, rectangles.astype(np.int32), depths, units, own=own)
    for k, (x0, y0, x1, y1) in enumerate(rectangles.tolist()):
        there = [
            layers.second[y, x]
            if layers.owner[y, x] == units[k] and not own
            else layers.nearest[y, x]
            for y in range(y0, y1 + 1)
            for x in range(x0, x1 + 1)
        ]
        assert found.farthest[k] == max(there, default=-np.inf)
        assert found.nearest[k] == min(there, default=np.inf)
        assert found.passing[k] == sum(z >= depths[k] for z in there)
        assert found.beyond[k] == sum(z > depths[k] for z in there)
        assert (early.passing[k] > 0, early.beyond[k] > 0) == (
            found.passing[k] > 0,
            found.beyond[k] > 0,
        )


@pytest.mark.parametrize("seed", range(3))
def test_spread_holds_for_every_unit_the_nearest_of_others_about_a_sample(seed):
    layers = random_layers(np.random.default_rng(seed))
    found = _spread(layers)
    height, width = layers.owner.shape
    for y, x in np.ndindex(height, width):
        about = [
            (i, j)
            for i in range(max(y - 1, 0), min(y + 2, height))
            for j in range(max(x - 1, 0), min(x + 2, width))
        ]
        for unit in range(4):
            wanted = min(
                layers.second[at] if layers.owner[at] == unit else layers.nearest[at]
                for at in about
            )
            told = found.second if found.owner[y, x] == unit else found.nearest
            assert told[y, x] == wanted


@pytest.mark.parametrize(("how", "plain"), [(np.max, max), (np.min, min), (np.mean, None)])
@pytest.mark.parametrize("texel", [2, 4])
@pytest.mark.parametrize("whole_only", [False, True])
def test_texels_take_their_pixels_together(how, plain, texel, whole_only):
    layers = random_layers(np.random.default_rng(texel))
    height, width = layers.owner.shape
    found = blocks(layers, texel, how, whole_only=whole_only)
    rows, columns = (side // texel if whole_only else -(-side // texel) for side in (height, width))
    assert found.owner.shape == (rows, columns)
    for i, j in np.ndindex(rows, columns):
        part = slice(i * texel, (i + 1) * texel), slice(j * texel, (j + 1) * texel)
        owners = set(layers.owner[part].reshape(-1).tolist())
        near = layers.nearest[part].reshape(-1).tolist()
        wanted = plain(near) if plain else sum(near) / len(near)
        assert found.nearest[i, j] == pytest.approx(wanted)
        if len(owners) == 1:
            second = layers.second[part].reshape(-1).tolist()
            wanted = plain(second) if plain else sum(second) / len(second)
            assert found.owner[i, j] == owners.pop()
        else:
            assert found.owner[i, j] == -1
        assert found.second[i, j] == pytest.approx(wanted)


# Units that share triangles.


def test_every_unit_that_holds_a_triangle_is_found():
    offsets = np.array([0, 3, 3, 5, 6])
    units = Units(offsets, np.array([0, 2, 4, 2, 5, 2], np.int32))
    held = Membership(units)
    unit, at = held.units(np.array([2, 1, 5, 0]))
    assert sorted(zip(at.tolist(), unit.tolist(), strict=True)) == [
        (0, 0),
        (0, 2),
        (0, 3),
        (2, 2),
        (3, 0),
    ]
    first = held.first_of(7)
    assert first[[1, 3, 6]].tolist() == [-1, -1, -1]
    assert first[[0, 4, 5]].tolist() == [0, 0, 2]
    assert first[2] in (0, 2, 3)
