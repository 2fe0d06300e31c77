"""What shrinking leaves still convicts, by the word of a judge that shrinking did not ask; it is
small, and the same every time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from tests.wrong_cullers import WRONG
from visref.conformance.building import box, camera, case
from visref.conformance.scenes import SCENES
from visref.culler import Culler, DrawnSet
from visref.errors import InputError
from visref.judging.status import Status
from visref.search import edits
from visref.search.case import Case
from visref.search.holding import Effort, Holding, Wanted
from visref.search.judging import Kind, Verdict, verdict_of
from visref.search.shrinking import Shrunk, cost_of, shrink
from visref.search.suspects import Made

BUILD = {maker.name: maker.build for maker in SCENES}

# One of each class of faults, the scene it is shrunk from, and how many frames, objects and
# triangles are to be left: fewer cannot show it.
FAULTS = {
    "shift-ignored": ("beside_the_unshifted_view", (1, 1, 1)),
    "nearest-of-the-rectangle": ("coplanar_ties", (1, 2, 2)),
    "glass-occludes": ("glass", (1, 2, 2)),
    "clip-plane-ignored": ("cut_by_a_plane", (1, 2, 2)),
    "two-sided-turned-away": ("slivers", (1, 1, 1)),
    "last-answer": ("large_object_at_the_edge", (2, 1, 1)),
    "depth-at-rest": ("sliding_door", (2, 2, 2)),
    "boxes-of-joints": ("bending_reeds", (2, 2, 2)),
    "removed-still-hides": ("appearing_and_vanishing", (2, 2, 3)),
    "first-views-frustum": ("two_views_of_a_changing_city", (1, 1, 1)),
    "last-cluster-lost": ("coplanar_ties", (1, 1, 1)),
    "hidden-drawn-though-exact": ("objects_without_triangles", (1, 1, 1)),
}


def suspect_of(name: str) -> Made:
    return Made(name, WRONG[name].culler)


def violating(name: str, scene: str) -> tuple[Case, Wanted]:
    """A scene up to the first frame in which a wrong culler violates its promise, and how."""
    built = BUILD[scene](np.random.default_rng(0))
    whole = Case.of(built.scene, built.path)
    first = verdict_of(whole, suspect_of(name)).violations[0]
    return edits.only_frames(whole, range(first.frame + 1)), Wanted.of(first)


def size(made: Case) -> tuple[int, int, int]:
    return len(made.path), made.scene.object_count, made.scene.triangle_count


class Watched(Holding):
    """A holding that keeps what it was asked, and whether that held."""

    def __init__(self, *given: object, **named: object) -> None:
        super().__init__(*given, **named)
        self.asked: list[tuple[Case, bool]] = []

    def at(self, case):
        found = super().at(case)
        self.asked.append((case, found is not None))
        return found


@dataclass(frozen=True)
class Course:
    """A case shrunk, and how it went: the cases that were taken, from the first on."""

    holding: Watched
    steps: list[Case]
    shrunk: Shrunk


def course_of(name: str) -> Course:
    before, wanted = violating(name, FAULTS[name][0])
    holding, steps = Watched(suspect_of(name), wanted), [before]

    def tell(step: str, trials: int, now: Case) -> None:
        if now is not steps[-1]:
            steps.append(now)

    return Course(holding, steps, shrink(before, holding, tell))


once = cache(course_of)


SLOW = ("boxes-of-joints", "depth-at-rest", "shift-ignored", "first-views-frustum")


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.slow] * (one in SLOW)) for one in FAULTS]
)
def test_a_fault_is_shrunk_to_what_shows_it(name):
    course = once(name)
    shrunk = course.shrunk
    assert size(shrunk.case) == FAULTS[name][1]
    assert shrunk.whole
    # Embree judged each step; exact arithmetic agrees, on the files.
    verdict = verdict_of(shrunk.case.read_back(), suspect_of(name), engine="exact")
    found = course.holding.wanted.among(verdict, len(shrunk.case.path) - 1)
    assert found is not None
    assert (found.kind, found.samples) == (shrunk.violation.kind, shrunk.violation.samples)


def test_every_step_was_judged_and_is_simpler_than_the_one_before():
    course = once("removed-still-hides")
    assert len(course.steps) > 10
    held = {one.digest for one, holds in course.holding.asked if holds}
    assert {one.digest for one in [*course.steps, course.shrunk.case]} <= held
    costs = [cost_of(one) for one in course.steps]
    assert costs == sorted(costs, reverse=True)
    # And nothing was tried twice.
    assert course.shrunk.trials == len({one.digest for one, _ in course.holding.asked})


@pytest.mark.parametrize("name", ["last-answer", "clip-plane-ignored"])
def test_the_same_is_left_every_time(name):
    one, other = once(name).shrunk, course_of(name).shrunk
    assert one.case.files() == other.case.files()
    assert (one.trials, one.violation) == (other.trials, other.violation)


class Draws(Culler):
    """Decides by a rule over how many triangles each object has, and how many objects there are."""

    name = "draws"

    def __init__(self, rule: Callable[[Counter[int]], Callable[[int], bool]]) -> None:
        self.rule = rule

    def prepare(self, scene):
        sizes = np.diff(scene.object_offsets).tolist()
        drawn = self.rule(Counter(sizes))
        self.ids = [index for index, count in enumerate(sizes) if drawn(count)]
        return scene.object_units()

    def cull(self, camera):
        return DrawnSet(np.array(self.ids, np.int32))


def crowd(count: int) -> Case:
    """Boxes beside each other, each seen whole."""
    boxes = [box((i - 4.0, -0.4, -9.0), (i - 3.2, 0.4, -8.2)) for i in range(count)]
    built = case([(f"b{i}", mesh) for i, mesh in enumerate(boxes)], [camera()])
    return Case.of(built.scene, built.path)


def shrunk_crowd(rule: Callable[[Counter[int]], Callable[[int], bool]]) -> Shrunk:
    wanted = Wanted("b3", left_out=True)
    return shrink(crowd(8), Holding(Made("draws", lambda: Draws(rule)), wanted))


def test_what_takes_three_objects_is_shrunk_to_three():
    shrunk = shrunk_crowd(lambda sizes: lambda _: sizes.total() < 3)
    assert size(shrunk.case) == (1, 3, 1)


def test_what_takes_four_triangles_is_shrunk_to_four():
    shrunk = shrunk_crowd(lambda _: lambda count: count < 4)
    assert size(shrunk.case) == (1, 1, 4)


def test_what_is_left_has_short_numbers():
    shrunk = shrunk_crowd(lambda _: lambda _: False)
    # A box of less than a unit is no more whole numbers.
    vertices = shrunk.case.scene.vertices
    assert (vertices == np.round(vertices, 1)).all()
    assert np.count_nonzero((vertices != np.round(vertices)).any(axis=1)) == 1
    (view,) = shrunk.case.path.frames[0].cameras
    assert (view.world_from_camera == np.eye(4)).all()
    assert (view.near, view.yfov) == (1.0, 1.0)


def test_another_object_s_fault_is_no_step():
    """Two objects are lost; the one that was not asked about goes."""
    shrunk = shrunk_crowd(lambda _: lambda _: False)
    assert shrunk.case.scene.names == ("b3",)


def test_what_shows_no_fault_is_not_shrunk():
    holding = Holding(Made("draws", lambda: Draws(lambda _: lambda _: True)), Wanted("b3", True))
    with pytest.raises(InputError, match="is not lost in the last frame"):
        shrink(crowd(8), holding)


def test_a_spent_effort_leaves_what_was_reached_and_says_so():
    before, wanted = violating("depth-at-rest", "sliding_door")
    holding = Holding(suspect_of("depth-at-rest"), wanted, effort=Effort(trials=10))
    shrunk = shrink(before, holding)
    assert (shrunk.trials, shrunk.whole) == (10, False)
    assert cost_of(shrunk.case) < cost_of(before)
    verdict = verdict_of(shrunk.case, suspect_of("depth-at-rest"))
    assert wanted.among(verdict, len(shrunk.case.path) - 1) is not None


def test_a_cause_that_is_wanted_is_kept():
    """A verdict's miss with another cause is not what is wanted."""
    made = crowd(4)
    verdict = verdict_of(made, Made("draws", lambda: Draws(lambda _: lambda _: False)))
    (miss,) = (one for one in verdict.violations if one.name == "b3")
    assert Wanted.of(miss, cause="one-frame-late").among(verdict, 0) is None
    assert Wanted.of(miss).among(verdict, 0) == miss


def test_a_verdict_that_fails_no_run_shows_no_fault():
    made = crowd(4)
    verdict = verdict_of(made, Made("draws", lambda: Draws(lambda _: lambda _: False)))
    assert verdict.status is Status.VIOLATION
    assert {one.kind for one in verdict.violations} == {Kind.MISSED}
    excused = Verdict(verdict.violations, Status.INCONCLUSIVE, verdict.promise, verdict.counts)
    assert Wanted("b3", left_out=True).among(excused, 0) is None
