"""N-buffers: levels are exact on the CPU and the GPU, and squares cover what they must."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from visref_culling.n_buffer.cover import ceil_log2, four_squares, one_square
from visref_culling.n_buffer.levels import build_levels, level_count, look_up

SIZES = [(1, 1), (1, 4096), (4096, 1), (2, 3), (17, 5), (33, 64), (61, 47), (641, 479)]


def brute_level(depth, level, join):
    side = 1 << level
    height, width = depth.shape
    return np.array(
        [[join(depth[y : y + side, x : x + side]) for x in range(width)] for y in range(height)],
        np.float32,
    )


def random_depth(width, height, seed=0):
    rng = np.random.default_rng([seed, width, height])
    return rng.random((height, width), np.float32)


@pytest.mark.parametrize(
    ("size", "count"), [((256, 256), 8), ((512, 512), 9), ((640, 480), 10), ((1024, 1024), 10)]
)
def test_level_counts_are_those_of_table_1(size, count):
    assert level_count(*size) == count


@settings(max_examples=40, derandomize=True, deadline=None)
@given(size=st.tuples(st.integers(1, 24), st.integers(1, 24)), farthest=st.booleans())
@example(size=(1, 40), farthest=True)
def test_every_level_equals_brute_force(size, farthest):
    depth = random_depth(*size)
    levels = build_levels(depth, farthest=farthest)
    assert len(levels) == level_count(*size) + 1
    for level, made in enumerate(levels):
        expected = brute_level(depth, level, np.max if farthest else np.min)
        np.testing.assert_array_equal(made, expected)


def test_the_last_level_knows_the_whole_image():
    depth = random_depth(61, 47)
    assert build_levels(depth)[-1, 0, 0] == depth.max()
    assert build_levels(depth, farthest=False)[-1, 0, 0] == depth.min()


def rectangles(width, height):
    """Every rectangle of an image."""
    x0, x1, y0, y1 = np.indices((width, width, height, height)).reshape(4, -1)
    kept = (x0 <= x1) & (y0 <= y1)
    return np.stack([x0, y0, x1, y1], axis=1)[kept].astype(np.int32)


@pytest.mark.parametrize("cover", [one_square, four_squares])
@pytest.mark.parametrize("size", [(1, 1), (5, 11), (13, 9)])
def test_squares_start_inside_and_cover_the_whole_rectangle(cover, size):
    width, height = size
    every = rectangles(width, height)
    squares = cover(every)
    side = 1 << squares.level
    assert squares.x.min() >= 0
    assert squares.y.min() >= 0
    assert squares.x.max() < width
    assert squares.y.max() < height
    assert squares.level.max() <= level_count(width, height)
    for (x0, y0, x1, y1), x, y, s in zip(every, squares.x, squares.y, side, strict=True):
        inside = np.zeros((height, width), bool)
        for left, top in zip(x, y, strict=True):
            inside[top : top + s, left : left + s] = True
        assert inside[y0 : y1 + 1, x0 : x1 + 1].all()


@pytest.mark.parametrize("farthest", [True, False])
def test_lookups_bound_the_true_depth_and_four_squares_are_exact_where_the_paper_says(farthest):
    width, height = 13, 9
    depth = random_depth(width, height)
    levels = build_levels(depth, farthest=farthest)
    every = rectangles(width, height)
    join = np.max if farthest else np.min
    true = np.array([join(depth[y0 : y1 + 1, x0 : x1 + 1]) for x0, y0, x1, y1 in every])
    one = look_up(levels, one_square(every), farthest=farthest)
    four = look_up(levels, four_squares(every), farthest=farthest)
    outward = np.less_equal if farthest else np.greater_equal
    assert outward(true, four).all()
    assert outward(four, one).all()
    assert (one != true).any()
    sizes = every[:, 2:] - every[:, :2] + 1
    low = 1 << np.maximum(ceil_log2(sizes.max(axis=1)) - 1, 0)
    exact = sizes.min(axis=1) > low
    assert (four[exact] == true[exact]).all()


@settings(deadline=None)
@given(st.integers(1, 2**31 - 1))
def test_level_is_the_smallest_whose_square_is_as_large(number):
    level = int(ceil_log2(np.array([number]))[0])
    assert 2**level >= number
    assert level == 0 or 2 ** (level - 1) < number


def test_squares_that_the_paper_draws():
    """Fig. 3's five cases, in a square of side 8."""
    cases = {
        (0, 0, 6, 5): (2, [0, 3, 0, 3], [0, 0, 2, 2]),
        (0, 0, 6, 3): (2, [0, 3, 0, 3], [0, 0, 0, 0]),
        (0, 0, 6, 1): (1, [0, 2, 4, 5], [0, 0, 0, 0]),
        (0, 0, 3, 6): (2, [0, 0, 0, 0], [0, 0, 3, 3]),
        (0, 0, 1, 6): (1, [0, 0, 0, 0], [0, 2, 4, 5]),
    }
    found = four_squares(np.array(list(cases), np.int32))
    for k, (level, x, y) in enumerate(cases.values()):
        assert found.level[k] == level
        assert found.x[k].tolist() == x
        assert found.y[k].tolist() == y


# On the GPU.


@pytest.fixture
def gpu():
    from visref_culling.gl.device import device

    return device()


@pytest.mark.gl
@pytest.mark.parametrize("farthest", [True, False])
@pytest.mark.parametrize("size", SIZES)
def test_levels_on_the_gpu_are_those_on_the_cpu_bit_for_bit(gpu, size, farthest):
    from visref_culling.n_buffer.gpu import NBufferTexture

    depth = random_depth(*size)
    made = NBufferTexture(gpu, *size, farthest=farthest)
    layers = np.zeros((made.levels, *depth.shape), np.float32)
    layers[0] = depth
    made.texture.write(layers.tobytes())
    made.join()
    np.testing.assert_array_equal(made.read(), build_levels(depth, farthest=farthest))
    made.release()


@pytest.mark.gl
@pytest.mark.parametrize("depth_bits", [24, 32])
def test_level_0_is_the_depth_buffer_with_the_top_row_first(gpu, depth_bits):
    from visref_culling.gl.device import State
    from visref_culling.n_buffer.gpu import NBufferTexture

    target = gpu.target(9, 7, depth_bits)
    program = gpu.program("rectangle.vert", "plain.frag")
    gpu.begin_frame()
    gpu.clear(State(target.framebuffer, program))
    array = gpu.context.vertex_array(program, [])
    gpu.apply(State(target.framebuffer, program))
    # The lower left quarter, at a third of the range.
    program["sides_ndc"] = (-1.0, -1.0, 0.0, 0.0)
    program["depth_ndc"] = -1.0 / 3.0
    array.render(mode=gpu.context.TRIANGLE_STRIP, vertices=4)
    array.release()
    made = NBufferTexture(gpu, 9, 7)
    made.build(target)
    found = made.read()
    np.testing.assert_array_equal(found[0], target.read_depth())
    assert found[0, 0].min() == 1.0
    assert found[0, 6, 0] < 1.0
    np.testing.assert_array_equal(found, build_levels(target.read_depth()))
    made.release()


LOOKUP = """
#version 450
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Rectangles { ivec4 rectangles[]; };
layout(std430, binding = 2) buffer Found { vec2 found[]; };
#include "n_buffer.glsl"
void main() {
    uint k = gl_GlobalInvocationID.x;
    if (k < rectangles.length()) {
        found[k] = vec2(n_buffer_one(rectangles[k]), n_buffer_four(rectangles[k]));
    }
}
"""


@pytest.mark.gl
@pytest.mark.parametrize("farthest", [True, False])
def test_lookups_in_a_shader_are_those_on_the_cpu(gpu, farthest):
    from importlib.resources import files

    from visref_culling.n_buffer.gpu import NBufferTexture

    depth = random_depth(13, 9)
    made = NBufferTexture(gpu, 13, 9, farthest=farthest)
    levels = build_levels(depth, farthest=farthest)
    made.texture.write(levels.tobytes())
    every = rectangles(13, 9)
    snippet = (files("visref_culling") / "shaders" / "n_buffer.glsl").read_text()
    shader = gpu.context.compute_shader(LOOKUP.strip().replace('#include "n_buffer.glsl"', snippet))
    asked = gpu.context.buffer(every.tobytes())
    answered = gpu.context.buffer(reserve=8 * len(every))
    asked.bind_to_storage_buffer(1)
    answered.bind_to_storage_buffer(2)
    made.use(shader)
    shader.run(-(-len(every) // 64))
    found = np.frombuffer(answered.read(), np.float32).reshape(-1, 2)
    for column, cover in enumerate((one_square, four_squares)):
        expected = look_up(levels, cover(every), farthest=farthest)
        np.testing.assert_array_equal(found[:, column], expected)
    for part in (shader, asked, answered, made):
        part.release()
