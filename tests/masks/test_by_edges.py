"""The short way to a mask's state, by edge functions and bits, against the long way."""

from __future__ import annotations

import numpy as np
import pytest

from tests.masks.test_hits import random_case
from tests.support.mask_by_edges import state_by_edges
from visref.compiled import njit
from visref.engines.ray_kernels import SampleGrid, minus
from visref.engines.splat_kernels import at_sample, edge
from visref.masks.by_edges import facing, reach_of
from visref.masks.hits import state_at
from visref.masks.lookup import (
    BETWEEN,
    FINEST_ENTRIES,
    HOLE,
    SOLID,
    UNSURE,
    extremes,
    kinds_in_four_squares,
    level_for,
    state_of_bits,
    state_of_places,
    words_of_row,
)
from visref.masks.materials import MaskMaterial, Sampler, Wrap
from visref.masks.store import Masks
from visref.masks.textures import AlphaImage


@njit()
def by_edges(m, row, grid, v0, v1, v2):
    eye = (grid.axes[0, 0], grid.axes[0, 1], grid.axes[0, 2])
    p0, p1, p2 = minus(v0, eye), minus(v1, eye), minus(v2, eye)
    edges = (edge(grid, p0, p1), edge(grid, p1, p2), edge(grid, p2, p0))
    face = facing(m, row, edges, (p0, p1, p2), reach_of(grid, (0, 1, 0, 1)))
    return state_by_edges(m, face, at_sample(edges, grid.column_a[0], grid.row_b[0]))


@njit()
def by_bits(m, material, columns, rows):
    of = m.textures[m.materials[material].texture]
    size = of.width, of.height
    return state_of_bits(m.bits, m.bits_of_material[material], size, columns, rows)


@njit()
def by_places(m, material, columns, rows):
    return state_of_places(m, material, columns, rows)


@njit()
def by_four(bits, start, stride, x0, x1, y0, y1):
    return kinds_in_four_squares(bits, start, stride, (x0, x1), (y0, y1))


def blobs(rng: np.random.Generator, height: int, width: int) -> AlphaImage:
    """Patches of solid and hole, some of them as large as boxes are."""
    coarse = rng.random((-(-height // 6), -(-width // 6))) < 0.5
    alpha = np.kron(coarse, np.ones((6, 6)))[:height, :width] * 255
    return AlphaImage(alpha.astype(np.uint8), 255)


def masks_of(
    image: AlphaImage, uv: np.ndarray, wrap: Wrap = Wrap.REPEAT, alpha: float = 1.0
) -> Masks:
    material = MaskMaterial(0, Sampler(wrap, wrap), cutoff=0.5)
    return Masks.build([0], [0], uv[None], np.full((1, 3), alpha), [material], [image])


def told(
    rng: np.random.Generator, perspective: bool, origin: float, tilt: float, factor: float = 1.0
) -> tuple[int, int]:
    """What both ways say of a random triangle at a random sample; the long way is told that pixels
    are larger by `factor`, a power of two."""
    axes, a, b, corners = random_case(rng, origin, perspective, tilt)
    image = blobs(rng, int(rng.integers(1, 90)), int(rng.integers(1, 150)))
    uv = rng.uniform(-1, 2, (3, 2)) * 10.0 ** rng.uniform(-2, 0)
    masks = masks_of(image, uv, list(Wrap)[rng.integers(3)])
    one, other = np.array([a]), np.array([b])
    grid = SampleGrid(np.concatenate([axes, np.zeros((3, 3))]), perspective, 0.0, 1.0, one, other)
    points = [tuple(map(float, corner)) for corner in corners]
    short = by_edges(masks.arrays, 0, grid, *points)
    axes[2:] *= factor
    a, b = a / factor, b / factor
    return int(short), int(state_at(masks.arrays, 0, axes, a, b, perspective, *points))


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("origin", [1.0, 1000.0])
@pytest.mark.parametrize("tilt", [1.2, 0.05, 0.001])
def test_what_the_short_way_says_the_long_way_says(
    perspective: bool, origin: float, tilt: float
) -> None:
    rng = np.random.default_rng(int(tilt * 1e4) + int(origin) + perspective)
    both = np.array([told(rng, perspective, origin, tilt) for _ in range(1000)])
    short, long = both.T
    said = short != UNSURE
    assert (short[said] == long[said]).all()
    # It has something to say, of each kind: else nothing was compared.
    assert said.mean() > (0.4 if tilt > 0.1 else 0.02)
    if tilt > 0.1:
        assert {SOLID, HOLE, BETWEEN} == set(short[said].tolist())


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_comparison_sees_footprints_of_another_size(factor: float) -> None:
    rng = np.random.default_rng(3)
    both = np.array([told(rng, True, 1.0, 1.2, factor) for _ in range(1000)])
    short, long = both[both[:, 0] != UNSURE].T
    assert (short != long).any()


def test_bits_are_the_texels_over_any_rectangle_of_a_row_of_words() -> None:
    rng = np.random.default_rng(8)
    image = blobs(rng, 23, 151)
    masks = masks_of(image, np.zeros((3, 2)))
    solid = image.alpha >= 127.5
    seen = set()
    for _ in range(4000):
        y0, x0 = int(rng.integers(23)), int(rng.integers(151))
        y1, x1 = min(y0 + int(rng.integers(7)), 22), min(x0 + int(rng.integers(36)), 150)
        part = solid[y0 : y1 + 1, x0 : x1 + 1]
        if part.size > 256:
            continue
        right = SOLID if part.all() else BETWEEN if part.any() else HOLE
        assert by_bits(masks.arrays, 0, (x0, x1, 0, -1), (y0, y1, 0, -1)) == right
        seen.add(right)
    assert seen == {SOLID, HOLE, BETWEEN}


def random_span(rng: np.random.Generator, size: int, most: int) -> tuple[int, int, int, int]:
    """Texels along an axis, sometimes over the edge of what repeats."""
    first, count = int(rng.integers(size)), min(1 + int(rng.integers(most)), size)
    if first + count <= size:
        return first, first + count - 1, 0, -1
    return first, size - 1, 0, first + count - 1 - size


def test_bits_say_what_the_level_that_decides_says_of_any_box() -> None:
    rng = np.random.default_rng(4)
    seen = set()
    for _ in range(3000):
        image = blobs(rng, int(rng.integers(2, 90)), int(rng.integers(2, 151)))
        if rng.random() < 0.5:
            # Large patches: boxes of many texels, all alike.
            alpha = np.kron(image.alpha[:20, :20], np.ones((8, 8), np.uint8))
            image = AlphaImage(alpha, 255)
        masks = masks_of(image, np.zeros((3, 2)))
        height, width = (int(masks.arrays.textures[side][0]) for side in ("height", "width"))
        most = int(rng.choice([3, 12, 40, 151]))
        columns, rows = random_span(rng, width, most), random_span(rng, height, most)
        k = level_for(columns, rows, FINEST_ENTRIES)
        least, greatest = extremes(masks.arrays, 0, columns, rows, k)
        right = SOLID if least >= 127.5 else HOLE if greatest < 127.5 else BETWEEN
        said = by_bits(masks.arrays, 0, columns, rows)
        assert said in (right, UNSURE)
        assert by_places(masks.arrays, 0, columns, rows) == right
        seen.add((said, k > 0, columns[3] >= 0))
    every = {(state, large) for state in (SOLID, HOLE, BETWEEN) for large in (False, True)}
    assert every <= {(state, large) for state, large, _ in seen}
    assert {split for *_, split in seen} == {False, True}


def test_four_squares_say_what_all_bits_say() -> None:
    rng = np.random.default_rng(5)
    image = blobs(rng, 43, 61)
    masks = masks_of(image, np.zeros((3, 2)))
    seen = set()
    for _ in range(4000):
        y0, x0 = int(rng.integers(43)), int(rng.integers(61))
        y1, x1 = min(y0 + int(rng.integers(16)), 42), min(x0 + int(rng.integers(16)), 60)
        if x1 // 8 - x0 // 8 > 1 or y1 // 8 - y0 // 8 > 1:
            continue
        solid, hole = by_four(masks.arrays.bits, 0, words_of_row(61), x0, x1, y0, y1)
        said = BETWEEN if solid and hole else SOLID if solid else HOLE
        assert said == by_bits(masks.arrays, 0, (x0, x1, 0, -1), (y0, y1, 0, -1))
        seen.add(said)
    assert seen == {SOLID, HOLE, BETWEEN}


def test_many_words_of_one_kind_are_left_to_levels() -> None:
    masks = masks_of(AlphaImage(np.eye(300, dtype=np.uint8), 1), np.zeros((3, 2)))
    assert by_bits(masks.arrays, 0, (180, 299, 0, -1), (0, 90, 0, -1)) == UNSURE
    assert by_places(masks.arrays, 0, (180, 299, 0, -1), (0, 90, 0, -1)) == HOLE


def test_another_vertex_alpha_is_left_to_the_long_way() -> None:
    # The bits are for a vertex alpha of one.
    corners = ((-1.0, -1.0, -2.0), (3.0, -1.0, -2.0), (-1.0, 3.0, -2.0))
    axes = np.array([[0.0, 0, 0], [0, 0, -1], [0.001, 0, 0], [0, 0.001, 0]])
    middle = np.array([0.5])
    grid = SampleGrid(np.concatenate([axes, np.zeros((3, 3))]), True, 0.0, 9.0, middle, middle)
    image = AlphaImage(np.full((8, 8), 200, np.uint8), 255)
    uv = np.array([[0.2, 0.2], [0.6, 0.2], [0.2, 0.6]])
    told = [
        by_edges(masks_of(image, uv, alpha=alpha).arrays, 0, grid, *corners) for alpha in (1.0, 0.5)
    ]
    assert told == [SOLID, UNSURE]


def test_factor_and_cutoff_decide_the_bits() -> None:
    image = AlphaImage(np.array([[127, 128, 255]], np.uint8), 255)
    materials = [
        MaskMaterial(0, cutoff=0.5),
        MaskMaterial(0, factor=0.5, cutoff=0.5),
        MaskMaterial(0, cutoff=128 / 255),
        MaskMaterial(-1),
    ]
    masks = Masks.build([0], [0], np.zeros((1, 3, 2)), np.ones((1, 3)), materials, [image])
    starts = masks.arrays.bits_of_material
    assert starts[3] == -1
    assert starts[0] == starts[2]
    assert [int(masks.arrays.bits[at]) for at in starts[:3]] == [0b110, 0b100, 0b110]
