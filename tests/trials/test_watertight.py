"""The watertight test: its rays do aim at vertices and edges, and it can fail."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from visref.camera import Camera
from visref.engines import make_engine
from visref.engines.base import TruthEngine
from visref.scene import Scene
from visref.trials.watertight import AWAY, SIDE, closed_surface, leaks_line, watertight_rates
from visref.visibility import BACKGROUND, FrameTruth


@pytest.mark.slow
@pytest.mark.parametrize("away", AWAY)
@pytest.mark.parametrize("perspective", [False, True])
def test_every_ray_aims_at_a_vertex_or_an_edge(away: float, perspective: bool) -> None:
    scene, camera, front = closed_surface(SIDE, away, perspective=perspective)
    corners = scene.vertices[scene.triangles[:front]].astype(np.float64) - camera.eye
    depth = corners @ camera.forward
    reach = depth if perspective else 1.0
    # The steps are powers of two, so nothing is rounded here.
    a = corners[..., 0] / reach / camera.right_step[0]
    b = corners[..., 1] / reach / camera.up_step[1]
    assert (a == np.rint(a)).all()
    points = np.stack([a, b], axis=-1)
    middles = (points + np.roll(points, 1, axis=1)) / 2.0
    met = {tuple(p) for p in np.concatenate([points, middles]).reshape(-1, 2).tolist()}
    wanted = {(x, y) for x in camera.column_a.tolist() for y in camera.row_b.tolist()}
    assert wanted <= met
    x, y = 5, 77
    origin, direction = camera.ray(x, y)
    exact = [Fraction(v) for v in camera.right_step]
    assert (
        Fraction(origin[0] if not perspective else direction[0])
        - (Fraction(float(camera.eye[0])) if not perspective else 0)
        == Fraction(float(camera.column_a[x])) * exact[0]
    )


def test_surface_is_closed_and_the_same_wherever_it_is() -> None:
    near, _, _ = closed_surface(SIDE, 0.0, perspective=True)
    edges = near.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    assert sorted(map(tuple, edges.tolist())) == sorted(map(tuple, edges[:, ::-1].tolist()))
    for away in AWAY[1:]:
        scene, camera, _ = closed_surface(SIDE, away, perspective=True)
        moved = scene.vertices.astype(np.float64) - camera.eye
        np.testing.assert_array_equal(moved, near.vertices.astype(np.float64))


def test_exact_engine_is_watertight() -> None:
    assert [leak.missed for leak in watertight_rates("exact")] == [0, 0, 0]


def test_embree_robust_is_watertight_near_and_far() -> None:
    leaks = watertight_rates("embree")
    assert [(leak.away, leak.missed) for leak in leaks] == [(away, 0) for away in AWAY]
    assert leaks_line(leaks) == (
        "0 of 32,768 rays at vertices and edges missed (near), 0 (1e5 away), 0 (1e6 away)"
    )


class Leaky(TruthEngine):
    """Loses every fourth column of samples: to the background, or to what is behind."""

    name = "leaky"
    summary = "for tests"
    to_background = True

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._engine = make_engine("embree", scene)

    def frame(self, camera: Camera) -> FrameTruth:
        truth = self._engine.frame(camera)
        behind = self.scene.triangle_count - 1
        truth.buffer.triangle[:, ::4] = BACKGROUND if self.to_background else behind
        return truth


@pytest.mark.parametrize("to_background", [True, False])
def test_engine_that_lets_rays_through_shows_its_rate(to_background: bool) -> None:
    def make(name: str, scene: Scene) -> TruthEngine:
        engine = Leaky(scene)
        engine.to_background = to_background
        return engine

    assert [leak.rate for leak in watertight_rates("leaky", make)] == [0.25, 0.25, 0.25]
