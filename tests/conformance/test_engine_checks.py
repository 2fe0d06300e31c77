"""The suite for engines passes the sound ones, and fails each kind of mistake."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from visref.conformance import (
    assert_engine_conforms,
    engine_checks,
    parametrize_with_engine_checks,
)
from visref.conformance.scenes import SCENES
from visref.engines.base import TruthEngine
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.scene import Scene
from visref.visibility import BlendVisibility, Ties, VisibilityBuffer

pytestmark = pytest.mark.slow

CHECKS = {check.name: check for check in engine_checks()}


@parametrize_with_engine_checks([EmbreeEngine, ExactEngine])
def test_engine_on_board_conforms(make_engine, check):
    assert_engine_conforms(make_engine, checks=[check])


class Changed(ExactEngine):
    """An exact engine whose answers are changed after."""

    def frame(self, camera):
        return self.change(super().frame(camera).copy())


class ForgetsTies(Changed):
    def change(self, truth):
        return replace(truth, ties=Ties())


class ForgetsGlass(Changed):
    def change(self, truth):
        return replace(truth, blend=BlendVisibility())


class ShiftsByAPixel(Changed):
    exact = False

    def change(self, truth):
        moved = np.roll(truth.buffer.triangle, 1, axis=1)
        return replace(truth, buffer=VisibilityBuffer(moved, truth.buffer.depth))


class SeesNothing(Changed):
    exact = False

    def change(self, truth):
        truth.buffer.triangle[:] = -1
        return truth


class FillsTheBackground(Changed):
    exact = False

    def change(self, truth):
        truth.buffer.triangle[truth.buffer.triangle < 0] = 0
        return truth


class DependsOnThreads(Changed):
    def change(self, truth):
        if self.threads == 2:
            truth.buffer.depth[:] += 1.0
        return truth


class Remembers(Changed):
    asked = 0

    def change(self, truth):
        self.asked += 1
        truth.buffer.depth[:] += self.asked
        return truth


class GivesTheFirstForAll(ExactEngine):
    def frames(self, cameras):
        return [self.frame(cameras[0]).copy() for _ in cameras]


class TurnsThemRound(ExactEngine):
    def frames(self, cameras):
        return super().frames(cameras[::-1])


class LeavesOneOut(ExactEngine):
    def frames(self, cameras):
        return super().frames(cameras[:-1])


class UsesItsArraysAgain(ExactEngine):
    """Of `frames`, in what it gives: whoever holds a truth sees the next one."""

    last = None

    def frames(self, cameras):
        truths = super().frames(cameras)
        self.last = self.last or truths
        for held, truth in zip(self.last, truths, strict=False):
            if held.buffer.triangle.shape == truth.buffer.triangle.shape:
                held.buffer.triangle[:] = truth.buffer.triangle
        return truths


class SaysAhead(ExactEngine):
    """Its truths are in the same arrays each time, though it says that each has its own."""

    ahead = True
    room = None

    def frame(self, camera):
        truth = super().frame(camera)
        if self.room is None or self.room.shape != truth.buffer.triangle.shape:
            self.room = truth.buffer.triangle
        self.room[:] = truth.buffer.triangle
        return replace(truth, buffer=VisibilityBuffer(self.room, truth.buffer.depth))


class StaysBehind(ExactEngine):
    """Says that it follows, and answers for where things were."""

    def pose(self, scene):
        self.scene = scene


class FailsToCloseTwice(ExactEngine):
    closed = False

    def close(self):
        if self.closed:
            raise RuntimeError("closed already")
        self.closed = True


@pytest.mark.parametrize(
    ("engine", "check"),
    [
        (ForgetsTies, "coplanar_ties"),
        (ForgetsGlass, "glass"),
        (ShiftsByAPixel, "walk_through_a_city"),
        (SeesNothing, "walk_through_a_city"),
        (FillsTheBackground, "walk_through_a_city"),
        (DependsOnThreads, "same_answer_again"),
        (Remembers, "same_answer_again"),
        (GivesTheFirstForAll, "frames_together"),
        (TurnsThemRound, "frames_together"),
        (LeavesOneOut, "frames_together"),
        (UsesItsArraysAgain, "frames_together"),
        (SaysAhead, "frames_together"),
        (StaysBehind, "in_motion"),
        (FailsToCloseTwice, "close_at_any_time"),
    ],
)
def test_wrong_engine_fails_its_check(engine, check):
    with pytest.raises(AssertionError, match=check):
        assert_engine_conforms(engine, checks=[CHECKS[check]])


def test_engines_are_asked_for_every_scene_that_stands_still_and_for_no_other():
    about_scenes = CHECKS.keys() & {made.name for made in SCENES}
    assert about_scenes == {made.name for made in SCENES if not made.moves}


class StandsStill(TruthEngine):
    name, summary = "still", "an engine for scenes that stand still"

    def frame(self, camera):
        raise AssertionError("it was asked for a scene that moves")


def test_an_engine_that_does_not_pose_is_not_asked_to():
    assert not StandsStill(Scene.from_objects([])).poses
    assert ExactEngine(Scene.from_objects([])).poses
    assert_engine_conforms(StandsStill, checks=[CHECKS["in_motion"]])
