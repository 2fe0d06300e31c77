"""OpenGL sees a scene in other units as it is, or says that its float32 cannot hold it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.engines.test_scales import BASE, CAMERAS, camera_times, scene_times
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.errors import InputError
from visref.judging.referee import Referee
from visref.registry import CULLERS, available, make_culler
from visref_culling.gl.view import GREATEST_LENGTH, LEAST_LENGTH

# Within the soup's magnitudes of the limits: its coordinates are below 2^4, the eye's distance
# below 2^5, a pixel above 2^-6.
POWERS = (-95, -60, -1, 57, 60, 97)
BEYOND = (-148, -126, -115, 105, 120)


def test_the_limits_are_those_of_float32_less_a_mantissa():
    info = np.finfo(np.float32)
    assert float(info.tiny) * 2.0**24 == LEAST_LENGTH
    assert float(info.max) * 2.0**-25 < GREATEST_LENGTH < float(info.max) * 2.0**-24


@pytest.mark.parametrize("spec", ["gl", "gl:depth=24"])
def test_a_power_of_two_changes_no_owner_in_the_item_buffer(spec):
    engine = make_engine(spec, BASE)
    expected = [engine.frame(camera).buffer.triangle.copy() for camera in CAMERAS]
    for power in POWERS:
        scaled = make_engine(spec, scene_times(2.0**power))
        for camera, right in zip(CAMERAS, expected, strict=True):
            found = scaled.frame(camera_times(camera, 2.0**power)).buffer.triangle
            np.testing.assert_array_equal(found, right)
    for power in BEYOND:
        scaled = make_engine(spec, scene_times(2.0**power))
        for camera in CAMERAS:
            with pytest.raises(InputError, match="float32 of OpenGL"):
                scaled.frame(camera_times(camera, 2.0**power))


@pytest.mark.parametrize("name", sorted(available(CULLERS)))
def test_a_power_of_two_changes_no_cullers_verdict(name):
    def verdicts(power: int):
        scene = scene_times(2.0**power)
        cameras = tuple(camera_times(camera, 2.0**power) for camera in CAMERAS)
        outcome = Referee(scene, lambda: make_engine("exact", scene)).run(
            CameraPath(cameras), range(len(cameras)), [(name, make_culler(name))]
        )
        (record,) = outcome.cullers
        assert not record.failed
        return record.status, [frame.verdict.counts for frame in record.frames]

    expected = verdicts(0)
    for power in (-95, -60, 57, 97):
        assert verdicts(power) == expected


class Everything(Culler):
    """Draws everything, without a GL."""

    def prepare(self, scene):
        self.units = scene.object_units()
        return self.units

    def cull(self, camera):
        return DrawnSet(np.arange(self.units.count, dtype=np.int32))


@pytest.mark.parametrize("name", sorted(available(CULLERS)))
def test_a_scene_beyond_gl_fails_the_cullers_on_gl_and_nobody_else(name):
    scene = scene_times(2.0**-126)
    cameras = tuple(camera_times(camera, 2.0**-126) for camera in CAMERAS)
    outcome = Referee(scene, lambda: make_engine("exact", scene)).run(
        CameraPath(cameras),
        range(len(cameras)),
        [(name, make_culler(name)), ("everything", Everything())],
    )
    on_gl, other = outcome.cullers
    assert on_gl.failed
    assert not other.failed
    assert len(other.frames) == len(cameras)
    (told,) = [finding for finding in outcome.findings if finding.code == "CULLER_FAILED"]
    assert told.culler == name
    assert "float32 of OpenGL" in told.message
