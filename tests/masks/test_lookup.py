"""Lookups against an enumeration of texels in exact arithmetic."""

from __future__ import annotations

import math
from fractions import Fraction as Q

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.masks import oracle
from visref.masks import lookup
from visref.masks.materials import MaskMaterial, Sampler, Wrap
from visref.masks.store import Masks
from visref.masks.textures import AlphaImage

pytestmark = pytest.mark.slow

MODES = [mode.name for mode in Wrap]
FIXED = settings(derandomize=True, deadline=None, max_examples=400)
# What rounding may add, in texels: BOX_ROUNDING times texel coordinates below 2^8, both ways.
ROUNDING = Q(1, 1 << 40)


def masks_of(texture: oracle.Texture, cutoff: float = 0.5, factor: float = 1.0) -> Masks:
    sampler = Sampler(Wrap[texture.wrap_s], Wrap[texture.wrap_t], texture.nearest)
    material = MaskMaterial(0, sampler, factor, cutoff)
    uv = np.zeros((1, 3, 2))
    image = AlphaImage(texture.texels.astype(np.uint8), 255)
    return Masks.build([0], [0], uv, np.ones((1, 3)), [material], [image])


def box_state(masks: Masks, box: list[float], low: float = 1.0, high: float = 1.0) -> int:
    return int(lookup.mask_states(masks, [0], [box], [low], [high])[0])


def spans(found: tuple[int, int, int, int]) -> set[int]:
    a0, a1, b0, b1 = found
    return set(range(a0, a1 + 1)) | set(range(b0, b1 + 1))


@st.composite
def textures(draw: st.DrawFn, widest: int = 17, highest: int = 9) -> oracle.Texture:
    width, height = draw(st.integers(1, widest)), draw(st.integers(1, highest))
    random = np.random.default_rng(draw(st.integers(0, 1 << 20)))
    few = draw(st.booleans())
    texels = random.integers(0, 2, (height, width)) * 255 if few else None
    if texels is None:
        texels = random.integers(0, 256, (height, width))
    # All the same is stored as one texel: another matter, tested by itself.
    if texels.size > 1:
        texels[0, 0], texels[-1, -1] = 0, 255
    modes = st.sampled_from(MODES)
    return oracle.Texture(texels, draw(modes), draw(modes), draw(st.booleans()))


places = st.one_of(
    st.integers(-320, 320).map(lambda k: k / 64),
    st.floats(-8, 8, allow_subnormal=False),
)
halves = st.one_of(
    st.sampled_from([0.0, 1 / 64, 1 / 8, 1.0, 3.0]),
    st.floats(0, 1, allow_subnormal=False),
    st.floats(0, 0.1, allow_subnormal=False),
)
boxes = st.builds(
    lambda u, v, du, dv, e: [u, v, du, dv, e, e],
    places,
    places,
    halves,
    halves,
    st.sampled_from([0.0, 2.0**-44]),
)


@FIXED
@given(textures(), boxes)
def test_texels_taken_are_those_that_the_box_touches(
    texture: oracle.Texture, box: list[float]
) -> None:
    arrays = masks_of(texture).arrays
    if texture.texels.size == 1:
        return
    found = lookup.touched(arrays, 0, *box)
    exact, wider = oracle.touched(texture, box), oracle.touched(texture, box, ROUNDING)
    for side in range(2):
        assert exact[side] <= spans(found[side]) <= wider[side]
    # Within 2^-45 of a border the two differ; else, and on a border, nothing is in doubt.
    if all((x * 4096).is_integer() for x in box):
        assert exact == wider


@FIXED
@given(textures(), boxes, st.integers(0, 255), st.sampled_from([1.0, 0.5]))
def test_state_is_that_of_the_least_and_greatest_texel(
    texture: oracle.Texture, box: list[float], level: int, factor: float
) -> None:
    # Between two values that a texel may have: no tie.
    cutoff = (level + 0.5) / 255 * factor
    found = box_state(masks_of(texture, cutoff, factor), box)
    wanted = set()
    for wider in (Q(0), ROUNDING):
        least, greatest = oracle.extremes(texture, *oracle.touched(texture, box, wider))
        scale = Q(factor) / 255
        wanted.add(oracle.state(least * scale, greatest * scale, Q(cutoff)))
    assert found in wanted
    if len(wanted) > 1:
        assert found == lookup.BETWEEN


@FIXED
@given(textures(70, 41), boxes)
def test_a_level_takes_whole_blocks_that_the_box_touches_and_no_more(
    texture: oracle.Texture, box: list[float]
) -> None:
    if texture.texels.size == 1:
        return
    arrays = masks_of(texture).arrays
    columns, rows = lookup.touched(arrays, 0, *box)
    height, width = texture.texels.shape
    for k in range(int(arrays.textures["levels"][0])):
        wide = {x for x in range(width) if x >> k in {c >> k for c in spans(columns)}}
        high = {y for y in range(height) if y >> k in {r >> k for r in spans(rows)}}
        wanted = oracle.extremes(texture, wide, high)
        assert lookup.extremes(arrays, 0, columns, rows, k) == wanted
    finest = lookup.level_for(columns, rows, lookup.FINEST_ENTRIES)
    texels = len(spans(columns)) * len(spans(rows))
    assert (finest == 0) == (texels <= lookup.FINEST_ENTRIES)


@FIXED
@given(textures(70, 41), boxes, st.integers(0, 254))
def test_coarse_level_first_changes_no_answer(
    texture: oracle.Texture, box: list[float], level: int
) -> None:
    cutoff = (level + 0.5) / 255
    masks = masks_of(texture, cutoff)
    arrays = masks.arrays
    columns, rows = lookup.touched(arrays, 0, *box)
    finest = lookup.level_for(columns, rows, lookup.FINEST_ENTRIES)
    least, greatest = lookup.extremes(arrays, 0, columns, rows, finest)
    wanted = oracle.state(Q(int(least), 255), Q(int(greatest), 255), Q(cutoff))
    assert box_state(masks, box) == wanted


def test_no_lookup_in_the_doubled_footprint_leaves_the_bounds() -> None:
    random = np.random.default_rng(5)
    for _ in range(150):
        shape = (int(random.integers(2, 10)), int(random.integers(2, 18)))
        modes = [MODES[i] for i in random.integers(0, 3, 2)]
        texels = random.integers(0, 256, shape)
        texture = oracle.Texture(texels, *modes, bool(random.integers(2)))
        arrays = masks_of(texture).arrays
        u, v = random.uniform(-2, 2, 2)
        du, dv = random.uniform(0, 1, 2) ** 3
        columns, rows = lookup.touched(arrays, 0, u, v, du, dv, 0.0, 0.0)
        k = lookup.level_for(columns, rows, lookup.FINEST_ENTRIES)
        least, greatest = lookup.extremes(arrays, 0, columns, rows, k)
        if texture.nearest and du * shape[1] < 1 and dv * shape[0] < 1:
            # Only the hit itself counts.
            du = dv = 0.0
        points = random.uniform(-1, 1, (60, 2))
        values = [oracle.filtered(texture, u + x * du, v + y * dv) for x, y in points]
        # A weighted mean of four numbers below 256 rounds by less than 2^-44.
        assert least - 2**-44 <= min(values)
        assert max(values) <= greatest + 2**-44


def grid_of_boxes() -> list[list[float]]:
    random = np.random.default_rng(9)
    places = random.uniform(-2, 2, (300, 2))
    halves = random.uniform(0.01, 0.3, (300, 2))
    return [[*p, *h, 0.0, 0.0] for p, h in zip(places.tolist(), halves.tolist(), strict=True)]


def disagreements(masks: Masks, texture: oracle.Texture, shift: float = 0.0) -> int:
    """How many boxes, moved by `shift` texels, the masks and the oracle answer differently."""
    count = 0
    width = texture.texels.shape[1]
    for box in grid_of_boxes():
        least, greatest = oracle.extremes(texture, *oracle.touched(texture, box))
        wanted = oracle.state(Q(least, 255), Q(greatest, 255), Q(1, 2))
        count += box_state(masks, [box[0] + shift / width, *box[1:]]) != wanted
    return count


def blocky(rows: int, columns: int) -> NDArray[np.int64]:
    """Alpha 0 or 255 in blocks of 3 x 2 texels, so that boxes are often decided."""
    random = np.random.default_rng(3)
    small = random.integers(0, 2, (rows // 2 + 1, columns // 3 + 1)) * 255
    return np.repeat(np.repeat(small, 2, 0), 3, 1)[:rows, :columns]


def test_comparison_sees_planted_faults() -> None:
    right = oracle.Texture(blocky(13, 13), "REPEAT", "CLAMP_TO_EDGE")
    assert disagreements(masks_of(right), right) == 0
    faults = {
        "transposed": oracle.Texture(right.texels.T, right.wrap_s, right.wrap_t),
        "upside down": oracle.Texture(right.texels[::-1], right.wrap_s, right.wrap_t),
        "no half texel": oracle.Texture(right.texels, right.wrap_s, right.wrap_t, nearest=True),
        "u mirrored": oracle.Texture(right.texels, "MIRRORED_REPEAT", right.wrap_t),
        "v repeated": oracle.Texture(right.texels, right.wrap_s, "REPEAT"),
        "wraps exchanged": oracle.Texture(right.texels, right.wrap_t, right.wrap_s),
    }
    for name, wrong in faults.items():
        assert disagreements(masks_of(wrong), right) > 5, name
    assert disagreements(masks_of(right), right, shift=0.5) > 5
    assert disagreements(masks_of(right), right, shift=-0.5) > 5


BOARD = oracle.Texture(np.indices((8, 8)).sum(axis=0) % 2 * 255, "REPEAT", "REPEAT")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("place", [1e18, -1e18, 1e300, 2.0**52, -(2.0**60)])
def test_huge_coordinates_are_looked_up_everywhere_or_at_the_edge(mode: str, place: float) -> None:
    texture = oracle.Texture(BOARD.texels, mode, mode)
    wanted = lookup.BETWEEN
    if mode == "CLAMP_TO_EDGE":
        # The first row holds both values; the last column and row meet in one texel.
        wanted = lookup.HOLE
    assert BOARD.texels[-1, -1] == BOARD.texels[0, 0] == 0
    assert box_state(masks_of(texture), [place, place, 0.0, 0.0, 0.0, 0.0]) == wanted


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(6))
def test_what_is_no_number_decides_nothing(bad: float, place: int) -> None:
    box = [0.3, 0.3, 0.01, 0.01, 0.0, 0.0]
    box[place] = bad
    assert box_state(masks_of(BOARD), box) == lookup.BETWEEN


def test_infinite_footprint_takes_the_whole_texture() -> None:
    box = [0.3, 0.3, math.inf, math.inf, 0.0, 0.0]
    for value, wanted in ((255, lookup.SOLID), (3, lookup.HOLE)):
        texels = np.full((5, 4), value)
        # Not all the same, so it is not stored as one texel.
        texels[2, 1] -= 1
        for mode in MODES:
            texture = oracle.Texture(texels, mode, mode)
            assert box_state(masks_of(texture), box) == wanted
    assert box_state(masks_of(BOARD), box) == lookup.BETWEEN


def test_nearest_takes_one_texel_and_two_on_a_border() -> None:
    texture = oracle.Texture(BOARD.texels, "REPEAT", "REPEAT", nearest=True)
    masks = masks_of(texture)
    small = 1 / 8 - 2.0**-40
    inside = box_state(masks, [0.1, 0.3, small, small, 2.0**-52, 2.0**-52])
    assert inside == (lookup.SOLID if BOARD.texels[2, 0] else lookup.HOLE)
    assert box_state(masks, [1 / 8, 0.3, small, small, 0.0, 0.0]) == lookup.BETWEEN
    off = 1 / 8 + 2.0**-50
    assert box_state(masks, [off, 0.3, small, small, 2.0**-52, 0.0]) != lookup.BETWEEN
    assert box_state(masks, [off, 0.3, small, small, 2.0**-49, 0.0]) == lookup.BETWEEN
    # A footprint of a texel and more: a lookup may fall on a neighbour.
    assert box_state(masks, [0.1, 0.3, 1 / 8, small, 0.0, 0.0]) == lookup.BETWEEN


@pytest.mark.parametrize("unknown", ["", "no decoder for KTX2"])
def test_cutoff_zero_is_solid_and_one_beyond_reach_is_a_hole(unknown: str) -> None:
    image = AlphaImage(BOARD.texels.astype(np.uint8), 255)
    for cutoff, wanted in ((0.0, lookup.SOLID), (1.0001, lookup.HOLE), (0.5, lookup.BETWEEN)):
        material = MaskMaterial(0, cutoff=cutoff, unknown=unknown)
        masks = Masks.build([0], [0], np.zeros((1, 3, 2)), np.ones((1, 3)), [material], [image])
        assert box_state(masks, [0.3, 0.3, 0.5, 0.5, 0.0, 0.0]) == wanted
        assert masks.reasons == ((unknown,) if unknown else ())


def test_alpha_equal_to_the_cutoff_is_solid() -> None:
    # glTF: rendered where alpha >= alphaCutoff. 51 / 255 is 0.2 in float64 as in decimals.
    texture = oracle.Texture(np.full((2, 2), 51), "REPEAT", "REPEAT")
    box = [0.3, 0.3, 0.5, 0.5, 0.0, 0.0]
    assert box_state(masks_of(texture, 0.2), box) == lookup.SOLID
    assert box_state(masks_of(texture, float(np.nextafter(0.2, 1))), box) == lookup.HOLE


def test_factor_and_vertex_alpha_multiply_the_texture() -> None:
    material = MaskMaterial(-1, factor=0.8, cutoff=0.5)
    masks = Masks.build([0], [0], np.zeros((1, 3, 2)), np.ones((1, 3)), [material], [])
    box = [0.0] * 6
    assert box_state(masks, box, 0.7, 0.9) == lookup.SOLID
    assert box_state(masks, box, 0.2, 0.6) == lookup.HOLE
    assert box_state(masks, box, 0.6, 0.7) == lookup.BETWEEN
    assert box_state(masks, box, math.nan, math.nan) == lookup.BETWEEN
