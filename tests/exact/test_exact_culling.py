"""What the rasteriser culls on the way to an answer changes nothing in it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.exact.test_exact_frames import cameras, town
from tests.support.exact_scenes import pose
from visref.camera import Camera
from visref.exact import ExactScene, scene
from visref.scene import Scene
from visref.visibility import FrameTruth


def doubled(side: int) -> tuple[Scene, Camera]:
    """Two walls in one place, which fill several tiles with ties."""
    line = np.linspace(-9.0, 9.0, side + 1)
    x, y = np.meshgrid(line, line)
    points = np.stack([x, y, np.full_like(x, -5.0)], -1).reshape(-1, 3)
    corner = np.arange(side * (side + 1)).reshape(side, side + 1)[:, :-1]
    quad = np.array([[0, 1, side + 2], [0, side + 2, side + 1]])
    faces = (corner.reshape(-1, 1, 1) + quad).reshape(-1, 3)
    camera = Camera(pose(np.eye(3), np.zeros(3)), 640, 640, 0.1, math.inf, yfov=1.0)
    return Scene.from_objects([("wall", points, faces), ("its twin", points, faces)]), camera


def same(one: FrameTruth, other: FrameTruth) -> None:
    for a, b in (
        (one.buffer.triangle, other.buffer.triangle),
        (one.buffer.depth, other.buffer.depth),
        (one.ties.sample, other.ties.sample),
        (one.ties.triangle, other.ties.triangle),
    ):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("which", range(6))
def test_clusters_looked_into_late_give_what_all_triangles_in_all_tiles_give(
    which: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng([31, which])
    made = town(rng, 120)
    camera = cameras(rng)[which]
    late = ExactScene(made).certify(camera).copy()
    assert (late.buffer.triangle >= 0).any()
    project = ExactScene.project

    def one_by_one(self: ExactScene, *given: object, whole: bool = False) -> object:
        return project(self, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(ExactScene, "project", one_by_one)
    same(late, ExactScene(made).certify(camera))


def test_too_little_room_for_contenders_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    made, camera = doubled(9)
    roomy = ExactScene(made).certify(camera).copy()
    assert len(roomy.ties.sample) >= camera.samples
    # A part has three tiles, and room for little more than one: it goes on with more room in each.
    monkeypatch.setattr(scene, "ROOM", 1 << 13)
    same(roomy, ExactScene(made, threads=1).certify(camera))
