"""The box tree against brute force."""

import numpy as np
import pytest

from tests.support.culling_scenes import random_camera
from visref.scene import Scene
from visref_culling.boxes.conservative import inflated, meets_frustum
from visref_culling.boxes.hierarchy import BoxTree, front_to_back
from visref_culling.gl.view import View

EMPTY = Scene.from_objects([])


def random_bounds(rng, count):
    centres = rng.normal(size=(count, 3)) * 3.0
    half = 10.0 ** rng.uniform(-3, 0, (count, 3))
    bounds = np.stack([centres - half, centres + half], axis=1)
    empty = rng.random(count) < 0.1
    bounds[empty, 0], bounds[empty, 1] = np.inf, -np.inf
    return bounds, empty


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 64, 65, 1000])
def test_tree_finds_what_a_test_of_every_box_finds(count):
    rng = np.random.default_rng(count)
    bounds, empty = random_bounds(rng, count)
    tree = BoxTree(bounds)
    found_any = False
    for _ in range(10):
        view = View.of(random_camera(rng, 32, 24), EMPTY, 8)
        filled = np.flatnonzero(~empty)
        expected = filled[meets_frustum(view, inflated(view, bounds[filled]))]
        assert tree.in_frustum(view).tolist() == expected.tolist()
        found_any |= len(expected) > 0
    assert found_any or count < 7


def test_nodes_hold_their_children():
    bounds, empty = random_bounds(np.random.default_rng(1), 300)
    tree = BoxTree(bounds)
    assert sorted(tree.ids) == np.flatnonzero(~empty).tolist()
    assert len(tree.levels[-1]) == 1
    for below, above in zip(tree.levels, tree.levels[1:], strict=False):
        parents = np.arange(len(below)) // 8
        assert (above[parents, 0] <= below[:, 0]).all()
        assert (above[parents, 1] >= below[:, 1]).all()


def test_neighbours_share_a_node():
    """Two clusters far apart: no leaf group may span them."""
    rng = np.random.default_rng(2)
    centres = rng.normal(size=(64, 3)) + np.where(np.arange(64) % 2, 0.0, 1e6)[:, None]
    tree = BoxTree(np.stack([centres, centres + 1.0], axis=1))
    sizes = (tree.levels[1][:, 1] - tree.levels[1][:, 0]).max(axis=1)
    assert (sizes < 100.0).all()


def test_order_is_by_depth_then_by_id():
    ids = np.array([4, 7, 9, 1])
    order = front_to_back(ids, np.array([2.0, 1.0, 2.0, 2.0]))
    assert ids[order].tolist() == [7, 1, 4, 9]
