"""Hypothesis' scenes under a sun, and with sprites in them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.effect_scenes import Stage, particle_verdict, shadow_verdict
from tests.support.strategies import cases
from visref.effects.light import sun
from visref.effects.solid import solid
from visref.effects.sprites import Sprites

pytestmark = [pytest.mark.gl, pytest.mark.slow]

directions = st.tuples(*[st.sampled_from((-1.0, -0.3, 0.0, 0.4))] * 3).filter(any)


@given(cases(), directions, st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_no_shadow_and_no_sprite_is_lost(case, direction, seed):
    scene = solid(case.scene)
    cameras = tuple(camera for camera in case.path if camera.is_perspective)
    if not scene.triangle_count or not cameras:
        return
    stage = Stage(scene, sun(direction, scene, 16), cameras)
    assert shadow_verdict(stage).status != "violation"
    low, high = scene.bounds
    places = np.random.default_rng(seed).uniform(low - 1.0, high + 1.0, (50, 3))
    sprites = Sprites(places.astype(np.float32), 4)
    assert particle_verdict(stage, sprites).status != "violation"
