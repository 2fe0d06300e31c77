"""Every float64 bound holds, is needed, and is asked for in earnest."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from tests.support.exact_brute import truth
from tests.support.exact_scenes import HALF, pose, random_case, rotation
from visref.camera import Camera
from visref.exact import ExactScene, compare_depths, filters
from visref.exact.filters import CERTAIN, DOUBTFUL, KEY_BOUND, SIGN, SIGN_BOUND
from visref.scene import Scene

Exact = list[Fraction]


def _exact(values: np.ndarray) -> Exact:
    return [Fraction(float(v)) for v in values]


def _minus(p: Exact, q: Exact) -> Exact:
    return [x - y for x, y in zip(p, q, strict=True)]


def _cross(p: Exact, q: Exact) -> Exact:
    return [p[i - 2] * q[i - 1] - p[i - 1] * q[i - 2] for i in range(3)]


def _dot(p: Exact, q: Exact) -> Fraction:
    return sum((x * y for x, y in zip(p, q, strict=True)), Fraction(0))


def by_the_book(
    corners: np.ndarray, camera: Camera, x: int, y: int
) -> tuple[list[Fraction], Fraction, Fraction]:
    """(edges, N, D) of a triangle along a sample's ray, from their definitions."""
    a, b = Fraction(camera.column_a[x]), Fraction(camera.row_b[y])
    e, f, r, u = map(_exact, (camera.eye, camera.forward, camera.right_step, camera.up_step))
    offset = [a * p + b * q for p, q in zip(r, u, strict=True)]
    origin = e if camera.is_perspective else [p + q for p, q in zip(e, offset, strict=True)]
    ray = [p + q for p, q in zip(f, offset, strict=True)] if camera.is_perspective else f
    w = [_minus(_exact(corner), origin) for corner in corners.reshape(3, 3)]
    normal = _cross(_minus(w[1], w[0]), _minus(w[2], w[0]))
    edges = [_dot(ray, _cross(w[(i + 1) % 3], w[(i + 2) % 3])) for i in range(3)]
    return edges, _dot(w[0], normal), _dot(ray, normal)


def set_up(corners: np.ndarray, view: filters.View, terms: np.ndarray) -> int:
    return int(filters.set_up(corners, False, view.perspective, view.lens, terms))


def loose_triangle(rng: np.random.Generator, centre: np.ndarray) -> np.ndarray:
    """(3, 3) float64 holding float32 values, near `centre`."""
    corners = centre + rng.normal(size=(3, 3)) * rng.choice([1e-2, 1.0, 1e3])
    return corners.astype(np.float32).astype(np.float64)


def camera_at(
    rng: np.random.Generator, eye: np.ndarray, turn: np.ndarray, perspective: bool
) -> Camera:
    projection = {"yfov": float(rng.uniform(0.2, 2.5))} if perspective else {"ymag": 3.7}
    return Camera(pose(turn, eye), 32, 32, 1e-6, math.inf, **projection)


def aimed(
    rng: np.random.Generator, target: np.ndarray, perspective: bool
) -> tuple[Camera, int, int]:
    """A camera of which one sample's ray goes through the target but for rounding."""
    turn = rotation(rng, aligned=rng.random() < 0.3)
    camera = camera_at(rng, np.zeros(3), turn, perspective)
    x, y = (int(v) for v in rng.integers(0, 32, 2))
    origin, ray = camera.ray(x, y)
    eye = target - origin - ray * rng.choice([1.0, 7.3, 1e3])
    return replace(camera, world_from_camera=pose(turn, eye)), x, y


def on_an_edge(rng: np.random.Generator, perspective: bool) -> tuple[np.ndarray, Camera, int, int]:
    """A triangle with an edge through a sample, but for float64's rounding."""
    v = loose_triangle(rng, rng.normal(size=3) * rng.choice([0.0, 1e3, 1e6]))
    part = rng.uniform(0.0, 1.0)
    camera, x, y = aimed(rng, v[0] + part * (v[1] - v[0]), perspective)
    return v, camera, x, y


def edge_on(rng: np.random.Generator, perspective: bool) -> tuple[np.ndarray, Camera, int, int]:
    """A triangle whose plane holds the eye (orthographic: the view's direction), nearly."""
    v = loose_triangle(rng, rng.normal(size=3) * rng.choice([0.0, 1e3]))
    along, aside = v[1] - v[0], v[2] - v[0]
    s, t = rng.normal(size=2) * 3.0
    eye = v[0] + s * along + t * aside
    turn = rotation(rng, aligned=False)
    if not perspective:
        back = along / np.linalg.norm(along)
        right = np.cross(rng.normal(size=3), back)
        right /= np.linalg.norm(right)
        turn = np.column_stack([right, np.cross(back, right), back])
    x, y = (int(v) for v in rng.integers(0, 32, 2))
    return v, camera_at(rng, eye, turn, perspective), x, y


@pytest.mark.slow
@pytest.mark.parametrize("perspective", [True, False])
def test_bounds_hold_and_the_float_path_alone_would_be_wrong(perspective: bool) -> None:
    rng = np.random.default_rng(2026)
    terms = np.empty(filters.SET_UP_SIZE)
    wrong = {"edge": 0, "sign": 0}
    tightest = {"edge": 0.0, "sign": 0.0, "key": 0.0}
    for index in range(800):
        make = edge_on if index % 2 else on_an_edge
        v, camera, x, y = make(rng, perspective)
        corners = v.astype(np.float32).reshape(9)
        view = filters.view_of(camera)
        a, b = camera.column_a[x], camera.row_b[y]
        state = set_up(corners, view, terms)
        edges, n, d = by_the_book(corners, camera, x, y)
        deciding = n if perspective else d
        error = abs(Fraction(terms[SIGN]) - deciding)
        assert error <= Fraction(terms[SIGN_BOUND])
        tightest["sign"] = max(tightest["sign"], float(error / Fraction(terms[SIGN_BOUND])))
        if np.sign(terms[SIGN]) != (deciding > 0) - (deciding < 0):
            wrong["sign"] += 1
            assert state == DOUBTFUL
        turn = -1 if state == CERTAIN and deciding < 0 else 1
        for i, edge in enumerate(edges):
            value = (terms[3 * i] + b * terms[3 * i + 2]) + a * terms[3 * i + 1]
            bound = terms[12 + i]
            error = abs(Fraction(value) - turn * edge)
            assert error <= Fraction(bound)
            tightest["edge"] = max(tightest["edge"], float(error / Fraction(bound)))
            if np.sign(value) != ((edge > 0) - (edge < 0)) * turn:
                wrong["edge"] += 1
                assert abs(value) <= bound
        if state == CERTAIN:
            value = (terms[9] + b * terms[11]) + a * terms[10]
            key = d / n if perspective else -n / d
            error = abs(Fraction(value) - key)
            assert error <= Fraction(terms[KEY_BOUND])
            tightest["key"] = max(tightest["key"], float(error / Fraction(terms[KEY_BOUND])))
    assert min(wrong.values()) > 0, wrong
    # Bounds a thousand times too wide would prove nothing about their derivation.
    assert min(tightest.values()) > 1e-3, tightest


@pytest.mark.slow
@pytest.mark.parametrize("perspective", [True, False])
def test_coverage_is_right_where_float64_alone_is_wrong(perspective: bool) -> None:
    rng = np.random.default_rng(8)
    terms = np.empty(filters.SET_UP_SIZE)
    contradicted = 0
    for _ in range(200):
        v, camera, x, y = on_an_edge(rng, perspective)
        corners = v.astype(np.float32).reshape(9)
        owners = ExactScene(scene_of(v), threads=1).decide(camera, np.array([32 * y + x]))
        edges, n, d = by_the_book(corners, camera, x, y)
        expected = d != 0 and n / d >= camera.near
        expected = expected and min(edge if d > 0 else -edge for edge in edges) >= 0
        assert bool(owners.offsets[1]) == expected
        if set_up(corners, filters.view_of(camera), terms) == CERTAIN:
            a, b = camera.column_a[x], camera.row_b[y]
            by_floats = min((terms[i] + b * terms[i + 2]) + a * terms[i + 1] for i in (0, 3, 6))
            if (by_floats >= 0.0) != expected:
                contradicted += 1
                assert owners.rational > 0
    assert contradicted > 3


@pytest.mark.slow
@pytest.mark.parametrize("perspective", [True, False])
def test_depth_order_is_right_where_float64_alone_is_wrong(perspective: bool) -> None:
    rng = np.random.default_rng(9)
    terms = np.empty(filters.SET_UP_SIZE)
    contradicted = met = 0
    for _ in range(200):
        first = loose_triangle(rng, rng.normal(size=3))
        target = first.T @ rng.dirichlet(np.ones(3))
        # A second triangle through about the same point; the camera aims at where they meet.
        second = loose_triangle(rng, target)
        second[2] = (3.0 * target - second[0] - second[1]).astype(np.float32)
        normals = [np.cross(t[1] - t[0], t[2] - t[0]) for t in (first, second)]
        along = np.cross(*normals)
        if not np.linalg.norm(along) > 0.0:
            continue
        rows = np.array([*normals, along])
        right = [normals[0] @ first[0], normals[1] @ second[0], along @ target]
        camera, x, y = aimed(rng, np.linalg.solve(rows, right), perspective)
        sample = 32 * y + x
        scene = scene_of(first, second)
        depths, keys = [], []
        for triangle in (first, second):
            corners = triangle.astype(np.float32).reshape(9)
            edges, n, d = by_the_book(corners, camera, x, y)
            covered = d != 0 and min(edge if d > 0 else -edge for edge in edges) >= 0
            if not covered or set_up(corners, filters.view_of(camera), terms) != CERTAIN:
                break
            a, b = camera.column_a[x], camera.row_b[y]
            depths.append(n / d)
            keys.append(float((terms[9] + b * terms[11]) + a * terms[10]))
        if len(depths) < 2 or min(depths) < camera.near:
            continue
        met += 1
        order = (depths[0] > depths[1]) - (depths[0] < depths[1])
        assert compare_depths(scene, camera, sample, 0, 1) == order
        assert compare_depths(scene, camera, sample, 1, 0) == -order
        owners = ExactScene(scene, threads=1).decide(camera, np.array([sample]))
        nearest = min(depths)
        assert owners.triangles.tolist() == [i for i in (0, 1) if depths[i] == nearest]
        if (keys[0] < keys[1]) - (keys[0] > keys[1]) != order:
            contradicted += 1
            assert owners.rational > 0
    assert met > 100
    assert contradicted > 3


def wall(*, z: float, half: float = 4.0, at: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    x, y = at
    return np.array(
        [[x - half, y - half, z], [x + half, y - half, z], [x + half, y + half, z]], float
    )


def scene_of(*soups: np.ndarray) -> Scene:
    return Scene.from_objects(
        [(f"o{i}", soup, np.arange(len(soup)).reshape(-1, 3)) for i, soup in enumerate(soups)]
    )


def looking_down(eye: tuple[float, float, float], **options: float) -> Camera:
    return Camera(pose(np.eye(3), np.array(eye)), 8, 8, options.pop("near", 0.5), 100.0, **options)


@pytest.mark.parametrize("projection", [{"yfov": HALF}, {"ymag": 4.0}])
def test_edges_through_samples_take_the_rational_path(projection: dict[str, float]) -> None:
    camera = looking_down((0.0, 0.0, 0.0), **projection)
    # Its diagonal runs through the samples of the image's diagonal.
    scene = scene_of(wall(z=-4.0))
    owners = ExactScene(scene).decide(camera, np.arange(64))
    assert owners.rational >= 8
    owned = np.diff(owners.offsets).reshape(8, 8) > 0
    assert np.array_equal(owned, np.fliplr(np.tri(8, dtype=bool)))


@pytest.mark.parametrize("limit", ["near", "far"])
def test_range_is_closed_and_decided_by_integers(limit: str) -> None:
    def hits(near: float, far: float, z: float) -> tuple[int, int]:
        camera = Camera(pose(np.eye(3), np.array([0.0, 0.0, 1.0])), 8, 8, near, far, yfov=HALF)
        owners = ExactScene(scene_of(wall(z=z, half=50.0))).decide(camera, np.arange(64))
        return int(np.diff(owners.offsets).sum()), owners.rational

    third = float(np.float32(1.0) - np.float32(1.0) / np.float32(3.0))
    depth = 1.0 - third
    before, after = math.nextafter(depth, 0.0), math.nextafter(depth, 2.0)
    whole = hits(0.01, 100.0, third)[0]
    assert whole >= 36
    inside = (depth, 100.0) if limit == "near" else (0.01, depth)
    outside = (after, 100.0) if limit == "near" else (0.01, before)
    count, rational = hits(*inside, third)
    assert count == whole
    assert rational >= whole
    assert hits(*outside, third)[0] == 0


@pytest.mark.parametrize("projection", [{"yfov": HALF}, {"ymag": 4.0}])
def test_edge_on_and_degenerate_triangles_cover_nothing(projection: dict[str, float]) -> None:
    # Along the middle column of samples, in a plane that holds the eye and the view.
    camera = Camera(pose(np.eye(3), np.zeros(3)), 9, 9, 0.5, 100.0, **projection)
    edge_on = np.array([[0.0, -5, -2], [0.0, 5, -2], [0.0, 0, -9]])
    line = np.array([[0.0, -5, -4], [0.0, 5, -4], [0.0, 1, -4]])
    dot = np.tile((0.0, 0.0, -3.0), (3, 1))
    scene = scene_of(edge_on, line, dot, wall(z=-20.0, half=100.0))
    owners = ExactScene(scene).decide(camera, np.arange(81))
    assert set(owners.triangles.tolist()) == {3}
    assert owners.rational > 0


def test_eye_on_a_surface_does_not_see_it() -> None:
    camera = looking_down((0.0, 0.0, 0.0), yfov=HALF)
    around = np.array([[-5.0, -1, 0], [5.0, -1, 0], [0, 9.0, 0]])
    tilted = np.array([[-5.0, -1, 1], [5.0, -1, 1], [0, 1.0, -1]])
    owners = ExactScene(scene_of(around, tilted)).decide(camera, np.arange(64))
    assert not len(owners.triangles)


def test_one_sided_triangles_show_their_front_alone() -> None:
    front = wall(z=-4.0, half=40.0)
    for projection in ({"yfov": HALF}, {"ymag": 4.0}):
        camera = looking_down((0.0, 0.0, 0.0), **projection)
        for turned in (False, True):
            corners = front[::-1] if turned else front
            scene = Scene(
                corners.astype(np.float32),
                np.array([[0, 1, 2]], np.int32),
                np.array([0, 1]),
                ("wall",),
                one_sided=np.array([True]),
            )
            seen = ExactScene(scene).certify(camera).buffer.triangle >= 0
            assert seen.any() != turned


def test_extreme_magnitudes_stay_exact() -> None:
    camera = looking_down((0.0, 0.0, 0.0), ymag=4.0)
    tiny = wall(z=-4.0)
    tiny[0] = (-1e-42, -3.4e38, -4.0)
    scene = scene_of(tiny, wall(z=-8.0, half=3e38))
    from tests.exact.test_exact_brute_force import assert_equal

    assert_equal(scene, camera, ExactScene(scene).certify(camera), truth(scene, camera))


def test_random_cases_use_both_paths() -> None:
    decisions = 0
    for index in range(40):
        scene, camera = random_case(77, index)
        decisions += ExactScene(scene, threads=1).decide(camera, np.arange(64)).rational
    assert decisions > 0
