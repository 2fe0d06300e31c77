"""The suite that strangers run: it passes the sound, fails the broken, and asks real questions."""

from __future__ import annotations

import re
from dataclasses import replace
from unittest import SkipTest

import numpy as np
import pytest

from tests.support.toy_culler import ToyCuller
from tests.wrong_cullers.exact import OneTriangleEach
from visref.conformance import Status, assert_conforms, check_culler, conformance_checks
from visref.conformance import suite as conformance
from visref.conformance.scenes import SCENES, Case
from visref.culler import Culler, DrawnSet, Promise
from visref.engines.exact import ExactEngine
from visref.errors import InputError, NothingToJudge
from visref.scene import Units
from visref.timeline import Timeline
from visref.visibility import objects_seen

CHECKS = conformance_checks()
WITHOUT_VISIBLE = {"empty_scene"}
# Checks that ask nothing of what is drawn, only how.
ABOUT_THE_CONTRACT = {"answers_repeat", "close_at_any_time"}
QUICK = [check for check in CHECKS if check.name in ("glass", "slivers", "close_at_any_time")]


class DrawsAll(Culler):
    name = "draws-all"

    def prepare(self, scene):
        self.everything = np.arange(scene.object_count, dtype=np.int32)
        return scene.object_units()

    def update(self, scene):
        """All that moved is drawn too."""

    def cull(self, camera):
        return DrawnSet(self.everything)


class DrawsNothing(Culler):
    name = "draws-nothing"

    def update(self, scene):
        """Nothing is drawn of what moved either."""

    def cull(self, camera):
        return DrawnSet(np.zeros(0, np.int32))


def named(*names):
    return [check for check in CHECKS if check.name in names]


def statuses(results):
    return {result.check: result.status for result in results}


@pytest.mark.slow
@pytest.mark.parametrize("check", CHECKS, ids=str)
def test_culler_that_draws_everything_conforms(check):
    assert_conforms(DrawsAll, checks=[check])


@pytest.mark.slow
@pytest.mark.parametrize("check", CHECKS, ids=str)
def test_culler_that_draws_nothing_fails_wherever_something_is_visible(check):
    (found,) = check_culler(DrawsNothing, checks=[check])
    if check.name in WITHOUT_VISIBLE | ABOUT_THE_CONTRACT:
        assert found.ok
    else:
        assert found.status is Status.FAILED
        assert found.missed > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 7])
@pytest.mark.parametrize("made", SCENES, ids=lambda made: made.name)
def test_every_scene_has_something_visible_in_each_frame(made, seed):
    scene, path = conformance.case(made.name, seed=seed)
    if made.name in WITHOUT_VISIBLE:
        assert scene.triangle_count == 0
        return
    truths = conformance.exact_truths(Case(scene, path))
    timeline = Timeline(scene, path)
    moments = [timeline.at(k) for k, frame in enumerate(path.frames) for _ in frame.cameras]
    seen = np.array([objects_seen(*pair).visible for pair in zip(truths, moments, strict=True)])
    assert seen.any(axis=1).all()
    # And something to leave out, or culling would not be tried.
    assert not seen.all()


def test_scenes_are_the_same_for_a_seed_and_others_for_another():
    for made in SCENES:
        first, again = (conformance.case(made.name, seed=3) for _ in range(2))
        assert first[0].digest == again[0].digest
        assert first[1].to_json() == again[1].to_json()
    random = [conformance.case("crowd", seed=seed)[0].digest for seed in (0, 1)]
    assert random[0] != random[1]


def test_names_are_unique_and_every_check_states_claim_and_trap():
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    assert all(check.claim and check.trap for check in CHECKS)


def test_sound_culler_with_hidden_objects_left_out_conforms():
    drawn = []

    class Watched(ToyCuller):
        def cull(self, camera):
            answer = super().cull(camera)
            drawn.append(len(answer.unit_ids) / max(1, self.scene.object_count))
            return answer

    assert_conforms(
        Watched, checks=named("peeking_by_a_pixel", "glass", "large_object_at_the_edge")
    )
    # It does cull: the pass is not that of a culler that draws everything.
    assert np.mean(drawn) < 0.9


def test_scenes_and_checks_are_marked_as_moving_where_something_moves():
    found = {made.name for made in SCENES if Timeline(*conformance.case(made.name)).moves}
    assert found == {made.name for made in SCENES if made.moves}
    assert found == {check.name for check in CHECKS if check.moves}
    still = [check.name for check in conformance_checks(moving=False)]
    assert still == [check.name for check in CHECKS if check.name not in found]
    assert 0 < len(found) < len(still)


def test_static_culler_skips_what_moves_by_name_and_passes_none_of_it():
    moving = named("sliding_door", "two_views")
    results = check_culler(ToyCuller, checks=[*named("glass"), *moving])
    told = "'toy' has no update(): it is for scenes that stand still"
    assert [(r.status, r.reason) for r in results] == [
        (Status.PASSED, ""),
        (Status.SKIPPED, told),
        (Status.SKIPPED, told),
    ]
    with pytest.raises(SkipTest, match="sliding_door: 'toy' has no update"):
        assert_conforms(ToyCuller, checks=moving)
    assert_conforms(ToyCuller, checks=[*moving, *named("glass")])


def test_loss_is_told_with_its_view():
    (found,) = check_culler(DrawsNothing, checks=named("two_views"))
    assert re.search(r"frame \d, view '(left|right)' \((64 x 48|48 x 64)\)", found.problems[0])


def test_failure_is_told_with_witness_trap_and_a_way_to_the_scene():
    with pytest.raises(AssertionError) as raised:
        assert_conforms(DrawsNothing, checks=named("objects_of_one_sample", "empty_scene"), seed=5)
    text = str(raised.value)
    assert "1 of 2 conformance checks failed (seed 5)" in text
    assert "FAILED objects_of_one_sample: an object of a single sample is drawn" in text
    assert "MISSED_OBJECT: frame 0 (64 x 48): 'wall' (object 0) lost" in text
    assert re.search(r"witness: pixel \(\d+, \d+\), triangle [0-3] at depth 20\b", text)
    assert "conformance.case('objects_of_one_sample', seed=5)" in text


def test_witness_is_a_sample_that_the_truth_gives_to_the_lost_object():
    (found,) = check_culler(DrawsNothing, checks=named("slivers"))
    scene, path = conformance.case("slivers")
    for line in found.problems[: conformance.LINES_PER_CHECK]:
        told = re.search(
            r"frame (\d+) .* lost (\d+) of its (\d+) .* \((\d+), (\d+)\), triangle (\d+)", line
        )
        frame, lost, owned, x, y, triangle = map(int, told.groups())
        truth = ExactEngine(scene).frame(path.cameras[frame])
        assert truth.buffer.triangle[y, x] == triangle
        pixels = objects_seen(truth, scene).samples[scene.object_of_triangle[triangle]]
        assert lost == owned == pixels
    assert re.fullmatch(r"... and \d+ objects more", found.problems[-1])


def test_expected_failure_is_accepted_and_an_unexpected_pass_is_an_error():
    reasons = {"glass": "draws nothing at all", "slivers": "draws nothing at all"}
    results = check_culler(DrawsNothing, checks=QUICK, expected_failures=reasons)
    assert statuses(results) == {
        "glass": Status.EXPECTED_FAILURE,
        "slivers": Status.EXPECTED_FAILURE,
        "close_at_any_time": Status.PASSED,
    }
    assert_conforms(DrawsNothing, checks=QUICK, expected_failures=reasons)
    with pytest.raises(AssertionError, match=r"UNEXPECTED PASS glass.*\n.*because: no reason"):
        assert_conforms(DrawsAll, checks=QUICK, expected_failures={"glass": "no reason any more"})


def test_expected_failure_needs_a_known_check_and_a_reason():
    with pytest.raises(InputError, match="did you mean 'glass'"):
        check_culler(DrawsAll, checks=QUICK, expected_failures={"glas": "typo"})
    with pytest.raises(InputError, match="has no reason; say why"):
        check_culler(DrawsAll, checks=QUICK, expected_failures={"glass": " "})
    with pytest.raises(InputError, match="no conformance check is named 'nonsense'"):
        conformance.case("nonsense")
    with pytest.raises(InputError, match="has no scene of its own"):
        conformance.case("answers_repeat")


def test_checks_of_somebody_s_own_are_told_as_those_of_the_catalogue():
    (known,) = named("glass")
    own = replace(known, name="my_window", claim="what stands behind my window is drawn")
    # Once, as a generator gives them.
    with pytest.raises(AssertionError) as raised:
        assert_conforms(DrawsNothing, checks=iter([own]))
    text = str(raised.value)
    assert "FAILED my_window: what stands behind my window is drawn" in text
    assert "MISSED_OBJECT" in text
    assert "conformance.case" not in text
    assert_conforms(DrawsNothing, checks=[own], expected_failures={"my_window": "draws nothing"})
    with pytest.raises(AssertionError, match="UNEXPECTED PASS my_window"):
        assert_conforms(DrawsAll, checks=[own], expected_failures={"my_window": "no reason"})
    with pytest.raises(InputError, match="did you mean 'my_window'"):
        check_culler(DrawsAll, checks=[own], expected_failures={"my_windw": "typo"})
    # One that has taken a name of the catalogue is told as its own.
    with pytest.raises(AssertionError) as raised:
        assert_conforms(DrawsNothing, checks=[replace(own, name="glass")])
    assert "FAILED glass: what stands behind my window is drawn" in str(raised.value)
    assert "conformance.case" not in str(raised.value)


def test_culler_that_promises_less_is_measured_and_not_convicted():
    class Modest(DrawsNothing):
        promise = Promise.APPROXIMATE

    (found,) = check_culler(Modest, checks=named("glass"))
    assert found.status is Status.PASSED
    assert found.missed > 0


def test_one_triangle_of_each_visible_object_is_not_enough():
    checks = named("walk_through_a_city", "crowd", "glass", "one_sided_walls")
    results = check_culler(OneTriangleEach, checks=checks)
    assert set(statuses(results).values()) == {Status.FAILED}
    assert all(result.missed > 0 for result in results)
    assert all("MISSED_OBJECT" in result.problems[0] for result in results)


@pytest.mark.parametrize(
    ("promise", "status"),
    [
        (Promise.EXACT, Status.FAILED),
        (Promise.AGGRESSIVE, Status.FAILED),
        (Promise.CONSERVATIVE, Status.PASSED),
        (Promise.APPROXIMATE, Status.PASSED),
    ],
)
def test_drawing_everything_fails_where_the_promise_forbids_it(promise, status):
    class Draws(DrawsAll):
        pass

    Draws.promise = promise
    (found,) = check_culler(Draws, checks=named("walk_through_a_city"))
    assert found.status is status
    if status is Status.FAILED:
        assert re.search(
            r"DRAWN_HIDDEN: frame \d+: object \d+ was drawn and (is hidden at all of its \d+ "
            r"samples, at pixel \(\d+, \d+\) by '.+' \(object \d+\)|covers no sample)",
            found.problems[0],
        )


class Raises(DrawsAll):
    def cull(self, camera):
        raise ZeroDivisionError("boxes per object")


class DrawsTwice(DrawsAll):
    def cull(self, camera):
        return DrawnSet(np.repeat(self.everything, 2))


class OutOfRange(DrawsAll):
    def cull(self, camera):
        return DrawnSet(self.everything + 1)


class ReturnsAList(DrawsAll):
    def cull(self, camera):
        return self.everything.tolist()


class RefusesToPrepare(DrawsAll):
    def prepare(self, scene):
        raise RuntimeError("no scene for me")


class UnitsOfNothing(DrawsAll):
    def prepare(self, scene):
        super().prepare(scene)
        return Units(np.array([0, 1]), np.array([scene.triangle_count], np.int32))


@pytest.mark.parametrize(
    ("culler", "told"),
    [
        (Raises, "ZeroDivisionError: boxes per object"),
        (DrawsTwice, "a unit is drawn twice"),
        (OutOfRange, "a unit id is outside"),
        (ReturnsAList, "no DrawnSet"),
        (RefusesToPrepare, "no scene for me"),
        (UnitsOfNothing, "a unit names a triangle that the scene lacks"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_culler_that_breaks_the_contract_fails(culler, told):
    (found,) = check_culler(culler, checks=named("glass"))
    assert found.status is Status.FAILED
    assert told in found.problems[0]


def test_culler_that_breaks_down_on_an_empty_scene_fails():
    class NeedsAnObject(DrawsAll):
        def prepare(self, scene):
            scene.object_bounds[0]
            return super().prepare(scene)

    assert statuses(check_culler(NeedsAnObject, checks=named("empty_scene", "slivers"))) == {
        "empty_scene": Status.FAILED,
        "slivers": Status.PASSED,
    }


def test_state_shared_between_cullers_is_found():
    class Shared(DrawsAll):
        drawn_before = 0

        def cull(self, camera):
            Shared.drawn_before += 1
            return DrawnSet(self.everything[: 1 + Shared.drawn_before % 7])

    (found,) = check_culler(Shared, checks=named("answers_repeat"))
    assert found.status is Status.FAILED
    assert "frame 0" in found.problems[0]


def test_close_that_frees_twice_or_too_early_is_found():
    class FreesTwice(DrawsAll):
        def prepare(self, scene):
            self.held = [scene]
            return super().prepare(scene)

        def close(self):
            self.held.pop()

    (found,) = check_culler(FreesTwice, checks=named("close_at_any_time"))
    assert found.status is Status.FAILED
    assert [problem.partition(":")[0] for problem in found.problems] == [
        "the first close() before prepare()",
        "the second close() before prepare()",
        "the second close() after a frame",
    ]


def test_where_no_culler_can_be_made_nothing_is_judged():
    def no_gl():
        raise NothingToJudge("no OpenGL context")

    with pytest.raises(NothingToJudge):
        check_culler(no_gl, checks=QUICK)


def test_no_gl_at_prepare_is_no_pass():
    class NeedsGL(DrawsAll):
        def prepare(self, scene):
            raise NothingToJudge("no OpenGL context")

    (found,) = check_culler(NeedsGL, checks=named("glass"))
    assert found.problems == ("NO_GL: no OpenGL context",)


class OneSetForAll(DrawsAll):
    """Of all but one object; which, `left_out` says."""

    joint = True

    def cull_joint(self, cameras):
        return DrawnSet(np.delete(self.everything, self.left_out))


@pytest.mark.parametrize(("left_out", "view"), [("aside", "left"), ("aside#2", "right")])
def test_loss_of_a_set_for_all_views_is_told_with_the_view_that_loses(left_out, view):
    """What one eye alone sees."""
    scene, _ = conformance.case("two_eyes")
    culler = type("Leaves", (OneSetForAll,), {"left_out": scene.id_of_name[left_out]})
    (found,) = check_culler(culler, checks=named("two_eyes"))
    (problem,) = found.problems
    told = (
        rf"MISSED_OBJECT: frame \d, view '{view}' \(64 x 48\): '{left_out}' .*pixel \((\d+), \d+\)"
    )
    pixel = re.match(told, problem)
    assert pixel
    # The left eye sees past the board's left side, and the right eye past its right.
    assert (int(pixel[1]) < 32) == (view == "left")


def test_hidden_unit_of_a_set_for_all_views_is_told_with_a_view():
    class Draws(DrawsAll):
        joint, promise = True, Promise.EXACT

        def cull_joint(self, cameras):
            return DrawnSet(self.everything)

    (found,) = check_culler(Draws, checks=named("two_eyes"))
    assert found.status is Status.FAILED
    assert re.match(r"DRAWN_HIDDEN: frame \d, view '(left|right)': object \d+", found.problems[0])
