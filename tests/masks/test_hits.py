"""Hits, footprints and vertex alpha against rational arithmetic."""

from __future__ import annotations

import math
from fractions import Fraction as Q

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.masks import oracle
from tests.masks.test_lookup import BOARD, masks_of
from visref.masks import hits, lookup
from visref.masks.materials import MaskMaterial
from visref.masks.store import Masks

pytestmark = pytest.mark.slow

Float64 = NDArray[np.float64]
SQUARE = [(x, y) for x in (-2, 2) for y in (-2, 2)]


def masks_with(uv: Float64, alpha: Float64, cutoff: float = 0.5) -> Masks:
    return Masks.build([0], [0], uv[None], alpha[None], [MaskMaterial(-1, cutoff=cutoff)], [])


def with_uv(masks: Masks, uv: Float64) -> Masks:
    triangles = masks.arrays.triangles.copy()
    triangles["uv"] = uv
    return Masks(masks.row, masks.arrays._replace(triangles=triangles))


def box_of(
    masks: Masks, axes: Float64, a: float, b: float, perspective: bool, corners: Float64
) -> list[float]:
    points = [tuple(float(x) for x in corner) for corner in corners]
    return [float(x) for x in hits.lookup_box(masks.arrays, 0, axes, a, b, perspective, *points)]


def attribute(weights: tuple[Q, Q, Q], values: Float64) -> Q:
    return sum((w * Q(float(f)) for w, f in zip(weights, values, strict=True)), Q(0))


def random_rotation(random: np.random.Generator) -> Float64:
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def random_case(
    random: np.random.Generator, origin: float, perspective: bool, tilt: float
) -> tuple[Float64, float, float, Float64]:
    """Axes, a, b and a triangle that the ray meets; its plane is `tilt` radians from edge-on."""
    back = random_rotation(random)
    scale = 10.0 ** random.uniform(-4, -2)
    eye = random.uniform(-1, 1, 3) * origin
    axes = np.stack([eye, -back[2], back[0] * scale, back[1] * scale])
    a, b = (float(x) for x in random.integers(-900, 900, 2))
    depth = 10.0 ** random.uniform(0, 2)
    way = axes[1] + a * axes[2] + b * axes[3] if perspective else axes[1]
    start = eye if perspective else eye + a * axes[2] + b * axes[3]
    middle = start + depth * way
    # Two directions in the plane: one nearly along the ray, one across it.
    across = np.cross(way, random.normal(size=3))
    across /= np.linalg.norm(across)
    normal = np.cross(way, across)
    along = way / np.linalg.norm(way) * math.cos(tilt)
    along += normal / np.linalg.norm(normal) * math.sin(tilt)
    size = 10.0 ** random.uniform(-2, 1)
    angles = random.uniform(0, 0.8, 3) + np.array([0, 2.1, 4.2])
    corners = np.array(
        [middle + size * (math.cos(t) * across + math.sin(t) * along) for t in angles]
    )
    # The corners are float32, as a scene's are.
    return axes, a, b, corners.astype(np.float32).astype(np.float64)


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("origin", [1.0, 1000.0])
@pytest.mark.parametrize("tilt", [1.2, 0.1])
def test_hit_and_footprint_are_those_of_rational_arithmetic(
    perspective: bool, origin: float, tilt: float
) -> None:
    random = np.random.default_rng(11)
    met = finite = 0
    for _ in range(120):
        axes, a, b, corners = random_case(random, origin, perspective, tilt)
        weights = oracle.barycentrics(axes, Q(a), Q(b), perspective, corners)
        if weights is None or min(weights) < 0:
            continue
        met += 1
        uv, alpha = random.uniform(-3, 3, (3, 2)), random.uniform(0, 1, 3)
        u, v, du, dv, eu, ev, low, high = box_of(
            masks_with(uv, alpha), axes, a, b, perspective, corners
        )
        ends = [
            oracle.barycentrics(axes, Q(a) + x, Q(b) + y, perspective, corners) for x, y in SQUARE
        ]
        for k, (value, half, error) in enumerate(((u, du, eu), (v, dv, ev))):
            exact = attribute(weights, uv[:, k])
            assert abs(Q(value) - exact) <= Q(error)
            # At float32's resolution of the corners' place a bound this wide says nothing.
            assert error < 1e-6
            if any(end is None for end in ends):
                assert half == math.inf
                continue
            finite += 1
            changes = [abs(attribute(end, uv[:, k]) - exact) for end in ends if end is not None]
            assert max(changes) <= Q(half)
            assert Q(half) <= max(changes) * (1 + Q(1, 10**6)) + Q(1, 10**9)
            # The derivative's extent, by a difference over a millionth of a pixel.
            steps = [(Q(1, 500000), Q(0)), (Q(0), Q(1, 500000))]
            near = [
                oracle.barycentrics(axes, Q(a) + x, Q(b) + y, perspective, corners)
                for x, y in steps
            ]
            slopes = [abs(attribute(w, uv[:, k]) - exact) * 10**6 for w in near if w is not None]
            assert sum(slopes) <= Q(half) * (1 + Q(1, 1000))
        exact = attribute(weights, alpha)
        assert Q(low) <= exact <= Q(high)
        assert min(alpha) <= low
        assert high <= max(alpha)
        inside = [end for end in ends if end is not None and min(end) >= 0]
        assert all(Q(low) <= attribute(end, alpha) <= Q(high) for end in inside)
    assert met > 80
    assert finite > (80 if tilt > 1 or not perspective else 20)


def camera(depth: float = 5.0, step: float = 0.001) -> Float64:
    return np.array([[0, 0, depth], [0, 0, -1], [step, 0, 0], [0, step, 0]])


CARD = np.array([[-1.0, -1, 0], [1, -1, 0], [-1, 1, 0]])
CARD_UV = np.array([[0.0, 1], [1, 1], [0, 0]])


@pytest.mark.parametrize("perspective", [True, False])
def test_card_that_faces_the_camera_in_closed_form(perspective: bool) -> None:
    # Five units away a step of 0.001 is 0.005, twice that a pixel; u is (x + 1) / 2.
    grows = 5.0 if perspective else 1.0
    masks = masks_with(CARD_UV, np.array([1.0, 0.0, 1.0]))
    u, v, du, dv, eu, ev, low, high = box_of(masks, camera(), -50.0, -30.0, perspective, CARD)
    assert u == pytest.approx((1 - 0.05 * grows) / 2, abs=1e-15)
    # v points down the image.
    assert v == pytest.approx((1 + 0.03 * grows) / 2, abs=1e-15)
    assert du == pytest.approx(0.001 * grows, rel=1e-12)
    assert dv == pytest.approx(0.001 * grows, rel=1e-12)
    assert 0 < eu < 1e-14
    assert 0 < ev < 1e-14
    # Alpha is 1 - u.
    assert (low, high) == pytest.approx((1 - u - du, 1 - u + du), abs=1e-12)


def test_equal_vertex_alpha_is_taken_as_it_is() -> None:
    box = box_of(masks_with(CARD_UV, np.full(3, 0.3)), camera(), -50.0, -30.0, True, CARD)
    assert box[6:] == [0.3, 0.3]


def test_footprint_over_the_horizon_takes_the_whole_texture() -> None:
    # The ground a millimetre below the eye, looked at so flatly that the square of the doubled
    # footprint reaches the horizon.
    ground = np.array([[-100.0, -0.001, 100], [100, -0.001, 100], [0, -0.001, -100]])
    axes = camera(0.0)
    uv = np.array([[0.0, 0], [1, 0], [0, 1]])
    box = box_of(masks_with(uv, np.ones(3)), axes, 0.0, -1.0, True, ground)
    assert box[2:4] == [math.inf, math.inf]
    assert np.isfinite(box[:2]).all()
    for texels, wanted in ((BOARD.texels, lookup.BETWEEN), (BOARD.texels // 2 + 128, lookup.SOLID)):
        masks = masks_of(oracle.Texture(texels, "REPEAT", "REPEAT"))
        masks = with_uv(masks, uv)
        found = hits.states_at(masks, [0], axes, [[0.0, -1.0]], True, ground[None])
        assert found[0] == wanted
    # A pixel further down it ends before the horizon.
    box = box_of(masks_with(uv, np.ones(3)), axes, 0.0, -3.0, True, ground)
    assert np.isfinite(box).all()


@pytest.mark.parametrize(
    "corners",
    [
        pytest.param(CARD[[0, 0, 1]], id="no area"),
        pytest.param(CARD[:, [2, 1, 0]], id="edge-on"),
    ],
)
def test_triangle_without_a_hit_is_in_between(corners: Float64) -> None:
    masks = masks_of(BOARD)
    found = hits.states_at(masks, [0], camera(), [[0.0, 0.0]], True, corners[None])
    assert found[0] == lookup.BETWEEN


def test_states_at_samples_are_those_of_their_exact_boxes() -> None:
    random = np.random.default_rng(2)
    texels = np.repeat(np.repeat(random.integers(0, 2, (4, 4)) * 255, 4, 0), 4, 1)
    texture = oracle.Texture(texels, "REPEAT", "CLAMP_TO_EDGE")
    masks = masks_of(texture)
    masks = with_uv(masks, CARD_UV * 1.5)
    samples = random.integers(-190, 0, (300, 2)).astype(np.float64)
    axes = camera()
    found = hits.states_at(masks, np.zeros(300, int), axes, samples, True, np.array([CARD] * 300))
    counts = [0, 0, 0]
    for (a, b), state in zip(samples, found, strict=True):
        weights = oracle.barycentrics(axes, Q(float(a)), Q(float(b)), True, CARD)
        assert weights is not None
        ends = [
            oracle.barycentrics(axes, Q(float(a)) + x, Q(float(b)) + y, True, CARD)
            for x, y in SQUARE
        ]
        uv = CARD_UV * 1.5
        centre = [attribute(weights, uv[:, k]) for k in (0, 1)]
        half = [
            max(abs(attribute(end, uv[:, k]) - centre[k]) for end in ends if end is not None)
            for k in (0, 1)
        ]
        wanted = set()
        for wider in (Q(0), Q(1, 1 << 30)):
            box = [*centre, *half, Q(0), Q(0)]
            columns, rows = oracle.touched(texture, box, wider)  # type: ignore[arg-type]
            least, greatest = oracle.extremes(texture, columns, rows)
            wanted.add(oracle.state(Q(least, 255), Q(greatest, 255), Q(1, 2)))
        assert state in wanted
        counts[state] += 1
    assert min(counts) > 10
