"""A culler that says that it looks back at no frame answers, and counts, as if there were none."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from tests.support.culling_scenes import random_camera, random_scene
from visref.registry import CULLERS, available, make_culler

RNG = np.random.default_rng(5)
SCENE = random_scene(RNG, 40)
CAMERAS = [random_camera(RNG, 96, 64) for _ in range(5)]
FORGETFUL = [name for name in sorted(available(CULLERS)) if make_culler(name).memory == 0]


def answer(culler, camera):
    drawn = culler.cull(camera)
    counted = {name: value for name, value in asdict(drawn.stats).items() if name != "ms"}
    return np.unique(drawn.unit_ids).tolist(), counted


@pytest.mark.parametrize("name", FORGETFUL)
def test_what_was_asked_before_changes_no_answer(name):
    remembers = make_culler(name)
    remembers.prepare(SCENE)
    for camera in CAMERAS:
        fresh = make_culler(name)
        fresh.prepare(SCENE)
        assert answer(remembers, camera) == answer(fresh, camera)
        fresh.close()
    remembers.close()


def test_a_method_that_begins_with_what_it_drew_before_says_so():
    assert make_culler("n-buffer").memory is None
    assert "occlusion-query" in FORGETFUL
