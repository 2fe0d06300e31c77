"""A ray replayed from plain numbers gives the hits of the brute force, in exact order."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from tests.support.exact_brute import hits
from tests.support.exact_scenes import HALF, SIDE, pose, random_case
from visref.camera import Camera
from visref.errors import InputError
from visref.exact.ray import Ray, along_ray


@pytest.mark.slow
def test_replayed_rays_equal_the_brute_force() -> None:
    by_floats = exactly = bounded = 0
    for index in range(60):
        scene, camera = random_case(41, index)
        corners = scene.vertices[scene.triangles]
        definition = json.loads(json.dumps(camera.definition()))
        expected = hits(scene, camera)
        for sample in range(0, SIDE * SIDE, 5):
            ray = Ray.from_definition(definition, sample % SIDE, sample // SIDE)
            found = along_ray(ray, corners, scene.one_sided)
            assert [
                (Fraction(int(h.numerator), int(h.denominator)), h.triangle) for h in found
            ] == (sorted(expected[sample]))
            depths = [t for t, _ in sorted(expected[sample])]
            assert [h.order for h in found] == [sorted(set(depths)).index(t) for t in depths]
            for hit, t in zip(found, depths, strict=True):
                assert hit.depth == t.numerator / t.denominator
                by_floats += hit.by_floats
                exactly += not hit.by_floats
                if np.isfinite(hit.bound):
                    bounded += 1
                    assert abs(Fraction(hit.depth_float64) - t) <= Fraction(hit.bound)
    assert min(by_floats, exactly, bounded) > 50


def test_tied_hits_share_their_order_and_are_not_decided_by_floats() -> None:
    camera = Camera(pose(np.eye(3), np.zeros(3)), 3, 3, 0.5, 9.0, yfov=HALF)
    ray = Ray.from_definition(camera.definition(), 1, 1)
    wall = np.array([[9, 0, -4], [-9, 9, -5], [-9, -9, -6]], np.float32)
    found = along_ray(ray, np.stack([wall, wall[::-1], wall - np.float32(0.5)]))
    assert [(h.triangle, h.order) for h in found] == [(0, 0), (1, 0), (2, 1)]
    assert [h.by_floats for h in found] == [False, False, True]


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"e": None}, "samples.e"),
        ({"R": ["0x1p0", "0x1p0"]}, "samples.R"),
        ({"U": ["0x1p0", "0x1p0", "up"]}, "samples.U"),
        ({"near": 1.0}, "samples.near"),
        ({"width": "8"}, "samples.width"),
    ],
)
def test_malformed_definitions_name_their_entry(change: dict[str, object], place: str) -> None:
    _, camera = random_case(41, 0)
    with pytest.raises(InputError) as caught:
        Ray.from_definition({**camera.definition(), **change}, 0, 0)
    assert caught.value.place == place
    flat = {**camera.definition(), "R": camera.definition()["U"]}
    with pytest.raises(InputError, match="one plane"):
        along_ray(Ray.from_definition(flat, 0, 0), np.eye(3)[None])
    definition = camera.definition()
    del definition["far"]
    with pytest.raises(InputError, match="'far' is missing"):
        Ray.from_definition(definition, 0, 0)
