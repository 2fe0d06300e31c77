"""Distances to triangles, against the least of a quadratic function on a prism, in fractions."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from visref.paths.clearance import cell_distances, distance_to_triangles
from visref.scene import Scene

whole = st.integers(-6, 6)
point = st.tuples(whole, whole, whole).map(lambda p: np.array(p, np.float64))


def scene_of(*triangles) -> Scene:
    return Scene.from_objects(
        [(f"t{i}", np.array(corners), [[0, 1, 2]]) for i, corners in enumerate(triangles)]
    )


# A triangle's points are a + v (b - a) + w (c - a): its inside, edges and corners, each a place and
# the directions in (v, w) that stay on it; and the same of a segment's points p + s (q - p).
TRIANGLE = [((0, 0), [(1, 0), (0, 1)]), ((0, 0), [(1, 0)]), ((0, 0), [(0, 1)]),
            ((1, 0), [(-1, 1)]), ((0, 0), []), ((1, 0), []), ((0, 1), [])]  # fmt: skip
SEGMENT = [(0, [1]), (0, []), (1, [])]


def least(p, q, a, b, c) -> float:
    """The least distance: the squared distance is convex in (s, v, w), so it is the least of those
    of its stationary points on every face of prism (0 <= s <= 1, triangle) that lie on the face.
    Where a face has many, a smaller face has one of them."""
    base = [q - p, a - b, a - c]  # (p - a) + s base[0] + v base[1] + w base[2]
    base = [[int(x) for x in row] for row in base]
    offset = [int(x) for x in p - a]
    best = None
    for (s, along), ((v, w), inside) in itertools.product(SEGMENT, TRIANGLE):
        directions = [(1, 0, 0)] * len(along) + [(0, *way) for way in inside]
        ways = [combined(direction, base) for direction in directions]
        start = [x + y for x, y in zip(offset, combined((s, v, w), base), strict=True)]
        steps = solved([[dot(m, n) for n in ways] for m in ways], [-dot(m, start) for m in ways])
        if steps is None:
            continue
        at = [
            x + sum(step * direction[i] for step, direction in zip(steps, directions, strict=True))
            for i, x in enumerate((s, v, w))
        ]
        if not (0 <= at[0] <= 1 and at[1] >= 0 and at[2] >= 0 and at[1] + at[2] <= 1):
            continue
        between = [x + y for x, y in zip(offset, combined(at, base), strict=True)]
        squared = dot(between, between)
        best = squared if best is None else min(best, squared)
    return math.sqrt(best)


def dot(m, n):
    return sum(x * y for x, y in zip(m, n, strict=True))


def combined(factors, rows):
    return [dot(factors, column) for column in zip(*rows, strict=True)]


def solved(matrix, right):
    """By elimination, in fractions; None for a singular matrix."""
    rows = [[Fraction(x) for x in (*row, y)] for row, y in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        pivot = next((i for i in range(k, len(rows)) if rows[i][k]), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(len(rows)):
            if i != k:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [row[-1] for row in rows]


@settings(deadline=None)  # the first one compiles
@given(point, point, point, point, point)
def test_the_distance_of_a_segment_is_the_least_between_its_points_and_the_triangle_s(
    p, q, a, b, c
):
    found, triangle = distance_to_triangles(scene_of((a, b, c)), p, q)
    # Numbers of up to 12 and a few dozen roundings of products of four of them, over determinants
    # of 1 at least: a millionth is far above what they leave, and below what a wrong case does.
    assert found == pytest.approx(least(p, q, a, b, c), abs=1e-6)
    assert triangle == 0


def test_known_distances():
    square = ((0, 0, 0), (4, 0, 0), (0, 4, 0))
    scene = scene_of(square)

    def away(p, q):
        return distance_to_triangles(scene, np.array(p, float), np.array(q, float))[0]

    assert away((1, 1, 3), (1, 1, 2)) == 2.0  # over the face, by its end
    assert away((1, 1, 3), (1, 1, -3)) == 0.0  # through it
    assert away((-3, 1, 0), (-3, 2, 0)) == 3.0  # beside an edge, in its plane
    assert away((-3, -4, 0), (-3, -4, 9)) == 5.0  # beside a corner
    assert away((4, 4, -5), (4, 4, 5)) == pytest.approx(math.sqrt(8))  # past the long edge
    assert away((-1, 2, 1), (-1, 2, -1)) == 1.0  # past an edge, crossing its plane outside
    assert away((1, 1, 0), (2, 1, 0)) == 0.0  # within it


def test_nearest_of_many_is_named_and_what_is_absent_is_not_there():
    near, far = ((0, 0, 1), (1, 0, 1), (0, 1, 1)), ((0, 0, 5), (1, 0, 5), (0, 1, 5))
    both = scene_of(far, near)
    origin = np.zeros(3)
    assert distance_to_triangles(both, origin, origin) == (1.0, 1)
    gone = Scene(both.vertices, both.triangles, both.object_offsets, both.names,
                 absent=np.array([False, True]))  # fmt: skip
    assert distance_to_triangles(gone, origin, origin) == (5.0, 0)
    assert distance_to_triangles(both, origin, origin, limit=0.5) == (math.inf, -1)


def test_cells_hold_the_distance_from_their_centres():
    rng = np.random.default_rng(5)
    scene = scene_of(*rng.uniform(-2, 2, (6, 3, 3)), ((-2, 0, -2), (2, 0, -2), (2, 0, 2)))
    low, size, reach = np.array([-2.5, -2.0, -2.25]), 0.75, 1.25
    grid = np.full((6, 5, 7), reach, np.float32)
    cell_distances(scene.vertices, scene.triangles, scene.present, low, size, reach, grid)
    for y, z, x in itertools.product(*map(range, grid.shape)):
        centre = low + size * np.array((x, y, z))
        expected, _ = distance_to_triangles(scene, centre, centre)
        # Rounded once to float32.
        assert grid[y, z, x] == pytest.approx(min(expected, reach), rel=2.0**-24)
    assert (grid < reach).sum() > 50
    assert (grid == reach).any()


def test_what_lies_out_of_all_reach_is_in_no_cell():
    low, grid = np.zeros(3), np.full((3, 3, 3), 1.0, np.float32)
    for at in (1e30, -1e30):
        far = scene_of(np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)]) * 1e29 + at)
        cell_distances(far.vertices, far.triangles, far.present, low, 0.5, 1.0, grid)
        assert (grid == 1.0).all()
    # One that goes through the grid from far out to far out.
    through = scene_of([(-1e30, 0.5, -1e30), (1e30, 0.5, -1e30), (0, 0.5, 1e30)])
    cell_distances(through.vertices, through.triangles, through.present, low, 0.5, 1.0, grid)
    assert grid[:, 1, 1].tolist() == [0.5, 0.0, 0.5]
