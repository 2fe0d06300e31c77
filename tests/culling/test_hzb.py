"""Pyramids of depth, lookups in them, and the two cullers that use them."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.support.culling_scenes import ASIDE, FROM, WALLED, drawn_by
from visref.camera import Camera
from visref.registry import make_culler
from visref.scene import Scene
from visref_culling.boxes.commands import view_bytes
from visref_culling.gl.device import device, shader_source
from visref_culling.gl.view import View
from visref_culling.hzb.pyramid import DepthPyramid

pytestmark = pytest.mark.gl

SIZES = [(1, 1), (2, 1), (5, 1), (1, 7), (37, 23), (64, 48), (65, 47), (127, 129)]


def pyramid_of(base: np.ndarray) -> DepthPyramid:
    """The levels above a base that is written as it is, (h, w) float32."""
    made = DepthPyramid(device(), base.shape[1], base.shape[0])
    made.texture.write(base.tobytes())
    made.reduce()
    return made


def random_depths(size: tuple[int, int]) -> np.ndarray:
    return np.random.default_rng(size).random(size[::-1]).astype(np.float32)


@pytest.mark.parametrize("size", SIZES)
def test_a_texel_holds_the_farthest_of_all_its_pixels_and_every_pixel_is_in_one(size):
    base = random_depths(size)
    pyramid = pyramid_of(base)
    levels = pyramid.read()
    pyramid.release()
    assert levels[-1].shape == (1, 1)
    for level, found in enumerate(levels):
        rows, columns = (np.minimum(np.arange(n) >> level, m - 1)
                         for n, m in zip(base.shape, found.shape, strict=True))  # fmt: skip
        wanted = np.full(found.shape, -np.inf, np.float32)
        np.maximum.at(wanted, (rows[:, None], columns[None, :]), base)
        assert (found == wanted).all(), level


LOOKUPS = """#version 450
layout(local_size_x = 64) in;
layout(std430, binding = 0) buffer Rectangles { ivec4 rectangles[]; };
layout(std430, binding = 1) buffer Found { float found[]; };
uniform int side;
%s
void main() {
    uint k = gl_GlobalInvocationID.x;
    if (k < rectangles.length()) {
        found[k] = hzb_farthest(rectangles[k], side);
    }
}
"""


def looked_up(pyramid: DepthPyramid, rectangles: np.ndarray, side: int) -> np.ndarray:
    context = device().context
    shader = context.compute_shader(LOOKUPS % shader_source("hzb.glsl"))
    given = context.buffer(rectangles.astype(np.int32).tobytes())
    found = context.buffer(reserve=4 * len(rectangles))
    given.bind_to_storage_buffer(0)
    found.bind_to_storage_buffer(1)
    pyramid.use(shader)
    shader["side"] = side
    shader.run(-(-len(rectangles) // 64))
    context.memory_barrier()
    result = np.frombuffer(found.read(), np.float32)
    for one in (given, found, shader):
        one.release()
    return result


def blocks_around(base: np.ndarray, rectangle: np.ndarray, side: int) -> float:
    """The farthest depth over the least blocks of pixels, powers of two wide, of which `side` each
    way hold the rectangle: pixel by pixel."""
    height, width = base.shape
    for level in itertools.count():
        across, down = max(1, width >> level), max(1, height >> level)
        columns = np.minimum(np.arange(width) >> level, across - 1)
        rows = np.minimum(np.arange(height) >> level, down - 1)
        x0, y0, x1, y1 = columns[rectangle[0]], rows[rectangle[1]], columns[rectangle[2]], rows[rectangle[3]]  # fmt: skip # noqa: E501
        if x1 - x0 < side and y1 - y0 < side:
            within = ((rows >= y0) & (rows <= y1))[:, None] & ((columns >= x0) & (columns <= x1))
            return float(base[within].max())
    raise AssertionError


@pytest.mark.parametrize("side", [1, 2])
@pytest.mark.parametrize("size", SIZES)
def test_a_lookup_holds_its_rectangle_and_the_least_blocks_around_it(size, side):
    base = random_depths(size)
    rng = np.random.default_rng(side)
    x = np.sort(rng.integers(0, size[0], (300, 2)), axis=1)
    y = np.sort(rng.integers(0, size[1], (300, 2)), axis=1)
    rectangles = np.stack([x[:, 0], y[:, 0], x[:, 1], y[:, 1]], axis=1)
    pyramid = pyramid_of(base)
    # Neighbours of one group look into different levels.
    found = looked_up(pyramid, rectangles, side)
    pyramid.release()
    inside = [base[y0 : y1 + 1, x0 : x1 + 1].max() for x0, y0, x1, y1 in rectangles]
    assert (found >= inside).all()
    assert found.tolist() == [blocks_around(base, one, side) for one in rectangles]


SPHERES = """#version 450
layout(local_size_x = 1) in;
%s
layout(std430, binding = 8) buffer Found { dvec4 found; };
layout(std430, binding = 9) readonly buffer Asked { dvec4 ball; };
%s
void main() {
    found = sphere_window(ball.w, ball.xyz);
}
"""


@pytest.mark.parametrize("seed", range(12))
def test_a_spheres_rectangle_is_what_its_points_project_to(seed):
    rng = np.random.default_rng(seed)
    perspective = seed % 4 > 0
    lens = {"yfov": float(rng.uniform(0.3, 2.0))} if perspective else {"ymag": 6.0}
    pose = np.eye(4)
    camera = Camera(pose, 64, 48, near=0.1, far=200.0, shift_x_px=5.0 if seed % 2 else 0.0, **lens)
    centre = np.array([*rng.uniform(-4.0, 4.0, 2), -rng.uniform(3.0, 30.0)])
    radius = float(rng.uniform(0.1, 0.95)) * (-centre[2] - camera.near)
    points = rng.normal(size=(400_000, 3))
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    places, depth = camera.pixel_of(points + centre)
    assert depth.min() > camera.near
    # `pixel_of` has integers at centres, the window at edges.
    low, high = places.min(axis=0) + 0.5, places.max(axis=0) + 0.5
    found = sphere_rectangle(camera, centre, radius)
    size = high - low
    assert (found[:2] <= low + 1e-9).all()
    assert (found[2:] >= high - 1e-9).all()
    # So many points come near the ends; a rectangle about the centre would be off by far more.
    assert (low - found[:2] < 0.01 * size + 1e-3).all()
    assert (found[2:] - high < 0.01 * size + 1e-3).all()


def sphere_rectangle(camera: Camera, centre: np.ndarray, radius: float) -> np.ndarray:
    source = shader_source("hzb_cull.comp")
    start = source.index("dvec4 sphere_window")
    end = source.index("bool shows()")
    commands = shader_source("box_commands.glsl")
    context = device().context
    shader = context.compute_shader(SPHERES % (commands, source[start:end]))
    scene = Scene.from_objects([("point", np.array([[0, 0, -1.0], [1, 0, -1], [0, 1, -1]]), np.array([[0, 1, 2]]))])  # fmt: skip # noqa: E501
    view = context.buffer(view_bytes(View.of(camera, scene, 8), 1))
    asked = context.buffer(np.array([*centre, radius]).tobytes())
    found = context.buffer(reserve=32)
    for place, one in ((7, view), (8, found), (9, asked)):
        one.bind_to_storage_buffer(place)
    shader.run(1)
    context.memory_barrier()
    result = np.frombuffer(found.read(), np.float64)
    for one in (view, asked, found, shader):
        one.release()
    return result


@pytest.mark.parametrize("way", ["", ",texels=1", ",projection=sphere"])
def test_by_the_last_frame_alone_what_comes_into_view_is_late_by_one_frame(way):
    spec = "last-frame-hzb:depth=24" + way
    # All is drawn where nothing is known of the last frame.
    assert drawn_by(spec, [FROM, FROM, FROM]) == [[0, 1, 2], [0, 2], [0, 2]]
    assert drawn_by(spec, [FROM, FROM, ASIDE, ASIDE])[2:] == [[2], [1, 2]]
    assert drawn_by(spec, [FROM, FROM, replace(ASIDE, cut=True)])[2] == [1, 2]


@pytest.mark.parametrize("way", ["", ",texels=1", ",projection=sphere", ",first=pyramid"])
def test_in_two_passes_nothing_is_late_and_what_is_hidden_is_forgotten(way):
    spec = "two-pass-hzb:depth=24" + way
    drawn = drawn_by(spec, [FROM] * 3 + [ASIDE] * 2 + [FROM] * 3)
    assert drawn[3] == drawn[4] == [1, 2]
    # Seen before, it is drawn once for nothing where what was seen is drawn first.
    assert drawn[2] == drawn[-1] == [0, 2]


def test_each_view_remembers_what_it_saw_itself():
    culler = make_culler("last-frame-hzb")
    culler.prepare(WALLED)
    left, right = replace(FROM, view="left"), replace(ASIDE, view="right")
    try:
        for _ in range(3):
            drawn = [sorted(culler.cull(one).unit_ids.tolist()) for one in (left, right)]
    finally:
        culler.close()
    assert drawn == [[0, 2], [1, 2]]
