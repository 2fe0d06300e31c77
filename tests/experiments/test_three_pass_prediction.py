"""The predictors of the occlusion error, on cases with known answers."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from visref.camera import Camera, look_at
from visref_datasets_gen.dataset import scene_of
from visref_datasets_gen.seismic import seismic
from visref_experiments import three_pass
from visref_experiments.three_pass import (
    MEASURES,
    nearest_points,
    pearson,
    prediction,
    root_mean_square_across,
    spearman,
)

TRIANGLE = np.array([[[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]])


@pytest.mark.parametrize(
    ("point", "nearest"),
    [
        ((1, 1, 3), (1, 1, 0)),  # over the face
        ((2, -5, 0), (2, 0, 0)),  # beside a side
        ((4, 4, 1), (2, 2, 0)),  # beside the long side
        ((-1, -2, 7), (0, 0, 0)),  # beyond a corner
        ((9, 0, 0), (4, 0, 0)),
    ],
)
def test_nearest_point_of_a_triangle(point, nearest):
    found = nearest_points(np.array([point], float), TRIANGLE)
    assert found[0] == pytest.approx(nearest, abs=1e-15)


@settings(derandomize=True, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_nearest_point_is_no_farther_than_any_of_a_dense_sampling(seed):
    rng = np.random.default_rng(seed)
    triangles, points = rng.normal(size=(6, 3, 3)), rng.normal(scale=2.0, size=(5, 3))
    weights = rng.dirichlet(np.ones(3), 400)
    sampled = np.einsum("wc,tci->twi", weights, triangles).reshape(-1, 3)
    away = np.linalg.norm(nearest_points(points, triangles) - points, axis=1)
    best = np.linalg.norm(sampled[None] - points[:, None], axis=2).min(axis=1)
    assert (away <= best + 1e-12).all()
    # And the point is on some triangle: it is its own nearest.
    again = nearest_points(nearest_points(points, triangles), triangles)
    assert again == pytest.approx(nearest_points(points, triangles), abs=1e-9)


def test_flat_triangle_is_its_longest_side():
    line = np.array([[[0.0, 0, 0], [2, 0, 0], [4, 0, 0]]])
    assert nearest_points(np.array([[3.0, 1, 0]]), line)[0].tolist() == [3.0, 0.0, 0.0]


def test_offset_along_the_line_of_sight_moves_nothing_and_one_across_it_its_pixels():
    camera = Camera(look_at((0, 0, 0), (0, 0, -1)), 100, 100, 0.1, yfov=np.pi / 2)
    points = np.array([[0.0, 0.0, -10.0], [0.0, 0.0, 5.0]])  # the other lies behind the eye
    # At depth 10 the image is 20 wide: a pixel is 0.2.
    for offset, pixels in (((0, 0, 3), 0.0), ((0.6, 0, 0), 3.0), ((0, 0.8, 2), 4.0)):
        offsets = np.array([offset, (9.0, 9.0, 9.0)])
        assert root_mean_square_across(camera, points, offsets) == pytest.approx(pixels)
    parallel = Camera(look_at((0, 0, 0), (0, 0, -1)), 100, 100, 0.1, far=50.0, ymag=10.0)
    offsets = np.array([[0.6, 0, 3], [9.0, 9, 9]])
    assert root_mean_square_across(parallel, points, offsets) == pytest.approx(3.0)


def test_correlations_of_known_lists():
    x = np.array([1.0, 2.0, 3.0, 4.0])
    assert pearson(x, 3.0 - 2.0 * x) == pytest.approx(-1.0)
    assert spearman(x, np.exp(5.0 * x)) == pytest.approx(1.0)
    assert pearson(x, np.ones(4)) is None
    # Ranks 1, 2.5, 2.5, 4 against 1, 2, 3, 4: by hand 4.5 / sqrt(4.5 * 5).
    assert spearman(np.array([1.0, 7.0, 7.0, 9.0]), x) == pytest.approx(4.5 / np.sqrt(22.5))


@pytest.mark.slow
@pytest.mark.gl
def test_errors_grow_with_reduction_and_the_outline_foretells_them(monkeypatch):
    monkeypatch.setattr(three_pass, "REDUCTIONS", (1, 5, 30))
    monkeypatch.setattr(three_pass, "EXTRA", 10)
    made = seismic(scale=0.02, frames=6)
    found = prediction(scene_of(made), made.path.resized(160, 120))
    assert json.loads(json.dumps(found)) == found
    whole, few, fewest = found["reductions"]
    # A stand-in that is its object errs nowhere, and all measures say so.
    assert whole["wrong"] == whole["missed"] == 0.0
    assert all(whole[measure]["mean"] == 0.0 for measure in MEASURES)
    assert 0.0 < few["wrong"] < fewest["wrong"]
    assert 0.0 <= few["missed"] < fewest["missed"]
    for one in (few, fewest):
        assert one["outline"]["spearman"] > max(0.5, one["deviation"]["spearman"])
        # In number too, within a factor of two.
        assert 0.5 < one["wrong"] / sum(one["frame_outline"]) < 2.0
