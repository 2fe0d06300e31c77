"""An engine's rows: what is run, how it ends, and that the wrong ones are convicted there too."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from tests.conformance.test_wrong_cullers import CONVICTED_BY
from tests.support.shares import share
from tests.wrong_cullers import RIGHT, WRONG
from visref.conformance.contest import (
    counts_of,
    exit_of,
    results_json,
    rows_of_culler,
    rows_of_files,
    run_rows,
)
from visref.conformance.declared import Declared
from visref.conformance.files import written_cases
from visref.conformance.suite import Status, conformance_checks
from visref.culler import Culler, CullerError, DrawnSet, Promise
from visref.errors import NothingToJudge
from visref.judging.status import Exit
from visref.plug_ins import Making, making_cullers
from visref.registry import make_culler
from visref.scene import Units

EVERYTHING = Declared()


def spec_of(culler):
    return f"{culler.__module__}:{culler.__name__}"


def rows(spec, only):
    """As the command line makes them, in this process."""

    @contextmanager
    def maker():
        made = []

        def make():
            context = making_cullers([spec], Making(in_process=True))
            made.append(context)
            return context.__enter__()[0][1]

        yield make
        for context in made:
            context.__exit__(None, None, None)

    return [row for row in rows_of_culler(spec, maker, 0) if row.name in only]


@pytest.mark.slow
@pytest.mark.parametrize("name", share(list(WRONG), 0))
def test_wrong_culler_is_convicted_by_its_name_as_by_its_class(name):
    only = CONVICTED_BY[name].split()
    ended = list(run_rows(rows(spec_of(WRONG[name].culler), only), EVERYTHING))
    assert [one.result.status for one in ended] == [Status.FAILED] * len(only)
    assert exit_of(ended) is Exit.VIOLATION


def test_rows_of_a_culler_are_the_catalogue_and_ask_for_no_clusters():
    made = rows("none", [check.name for check in conformance_checks()])
    assert [row.name for row in made] == [check.name for check in conformance_checks()]
    assert not any("clusters" in row.classes for row in made)
    assert any("views" in row.classes for row in made)


class Draws:
    """An engine that answers files with a culler of ours."""

    name = "draws"

    def __init__(self, culler):
        self.made = culler

    @contextmanager
    def culler(self, case):
        yield self.made()


class All(Culler):
    name = "all"

    def prepare(self, scene):
        self.count = scene.object_count
        return scene.object_units()

    def update(self, scene):
        """All of it is drawn wherever it is."""

    def cull(self, camera):
        return DrawnSet(list(range(self.count)))


class FirstHalf(All):
    """Decides about halves of objects, and draws the first alone."""

    def prepare(self, scene):
        self.count = 1
        half = scene.triangle_count // 2
        every = scene.object_units().triangles
        return Units(np.array([0, half, scene.triangle_count]), every, "half")


def ended_on(entrant, cases, declared=EVERYTHING):
    return list(run_rows(rows_of_files(entrant, cases, declared), declared))


def some(*names):
    return [case for case in written_cases() if case.name in names]


CLUSTERS = "half_of_a_wall_of_two_clusters"


def test_each_way_to_end_is_counted_by_itself():
    cases = some("crowd", "two_eyes", "glass", "slivers", CLUSTERS)
    declared = Declared(
        frozenset({"blending", "masks", "clusters"}),
        {"crowd": "no reason any more", CLUSTERS: "it has no clusters yet"},
    )
    ended = ended_on(Draws(All), cases, declared)
    assert {one.row.name: one.result.status for one in ended} == {
        "crowd": Status.UNEXPECTED_PASS,
        "glass": Status.PASSED,
        "slivers": Status.PASSED,
        "two_eyes": Status.SKIPPED,
        CLUSTERS: Status.EXPECTED_FAILURE,
    }
    assert {k: v for k, v in counts_of(ended).items() if v} == {
        Status.PASSED: 2,
        Status.EXPECTED_FAILURE: 1,
        Status.UNEXPECTED_PASS: 1,
        Status.SKIPPED: 1,
    }
    assert exit_of(ended) is Exit.VIOLATION
    written = results_json("draws", 0, ended)
    assert written["counts"]["not run"] == 1
    assert written["exit_status"] == 1


def test_clusters_are_asked_for_and_half_of_them_is_not_enough():
    (row,) = rows_of_files(Draws(FirstHalf), some(CLUSTERS), EVERYTHING)
    judged = row.run()
    assert judged.unit_kind == "half"
    assert judged.missed > 0
    assert not any("it lists objects" in problem for problem in judged.problems)


def test_who_lists_objects_has_not_answered_a_case_about_clusters():
    (one,) = ended_on(Draws(All), some(CLUSTERS))
    told = "it lists objects, and the case is about clusters"
    assert (one.result.status, one.result.reason) == (Status.SKIPPED, told)
    (one,) = ended_on(Draws(All), some(CLUSTERS), Declared(frozenset({"clusters"})))
    assert (one.result.status, one.result.problems) == (Status.FAILED, (told,))

    class Nothing(All):
        def cull(self, camera):
            return DrawnSet([])

    # What is lost is told whatever was declared.
    (one,) = ended_on(Draws(Nothing), some(CLUSTERS))
    assert one.result.status is Status.FAILED
    assert one.first.startswith("MISSED_OBJECT")


def test_engine_that_breaks_down_on_a_case_fails_it_and_goes_on():
    class Breaks(Draws):
        @contextmanager
        def culler(self, case):
            if case.name == "crowd":
                raise CullerError("it ended with status 3")
            yield self.made()

    ended = ended_on(Breaks(All), some("crowd", "slivers"))
    assert [one.result.status for one in ended] == [Status.FAILED, Status.PASSED]
    assert ended[0].first == "it ended with status 3"


def test_what_promises_nothing_is_measured_and_never_passes():
    class Modest(All):
        promise = Promise.APPROXIMATE

        def cull(self, camera):
            return DrawnSet([])

    ended = ended_on(Draws(Modest), some("crowd"))
    assert [one.result.status for one in ended] == [Status.MEASURED]
    assert ended[0].result.missed > 0
    assert exit_of(ended) is Exit.NO_VIOLATION


def test_where_there_is_no_gl_nothing_is_judged():
    class NeedsGL(All):
        def prepare(self, scene):
            raise NothingToJudge("no OpenGL context")

    expected = Declared(None, {"crowd": "for another reason"})
    with pytest.raises(NothingToJudge, match="no OpenGL context"):
        ended_on(Draws(NeedsGL), some("crowd"), expected)


def test_no_row_and_no_row_that_was_run_is_no_pass():
    assert exit_of([]) is Exit.NOTHING_JUDGED
    ended = ended_on(Draws(All), some("two_eyes"), Declared(frozenset()))
    assert exit_of(ended) is Exit.NOTHING_JUDGED


def test_rows_are_run_when_they_are_asked_for():
    class Never(Draws):
        def culler(self, case):
            raise AssertionError("it was asked for a case that it is not made for")

    nothing = Declared(frozenset())
    with pytest.raises(AssertionError):
        ended_on(Never(All), some("crowd"), nothing)
    (one,) = ended_on(Never(All), some("two_eyes"), nothing)
    assert one.result.status is Status.SKIPPED


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGHT)
def test_right_culler_passes_the_cases_as_files(name):
    """What is judged there is the same as what the catalogue builds; a share of it here."""
    culler = make_culler(spec_of(RIGHT[name]))
    cases = [case for case in written_cases() if culler.moves or not case.made.moves]
    whole = [case for case in cases if case.units is None]
    ended = ended_on(Draws(RIGHT[name]), share(whole, list(RIGHT).index(name)))
    assert {one.result.status for one in ended} == {Status.PASSED}
