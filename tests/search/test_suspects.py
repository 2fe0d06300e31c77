"""A suspect is made anew for each case; what it does in one leaves the next alone."""

from __future__ import annotations

import os

import numpy as np
import pytest

from visref.conformance.building import box, camera, case
from visref.culler import Culler, DrawnSet
from visref.errors import InputError
from visref.judging.status import Status
from visref.plug_ins.command import Command
from visref.plug_ins.making import Making
from visref.search.case import Case
from visref.search.judging import Drawn, verdict_of
from visref.search.suspects import Program, suspect_of

HERE = "tests.search.test_suspects:"


class Counting(Culler):
    """Draws as many objects as scenes were prepared, by itself (`own`) and by its module."""

    name = "counting"
    module = 0

    def __init__(self):
        self.own = 0

    def prepare(self, scene):
        self.own += 1
        Counting.module += 1
        return scene.object_units()

    def cull(self, camera):
        return DrawnSet(np.unique(np.array([self.own, Counting.module], np.int32)))


class Dies(Counting):
    """Ends its process where there are four objects."""

    name = "dies"

    def prepare(self, scene):
        if scene.object_count == 4:
            os._exit(3)
        return super().prepare(scene)


def row(count: int) -> Case:
    boxes = [box((i - 4.0, -0.4, -9.0), (i - 3.2, 0.4, -8.2)) for i in range(count)]
    built = case([(f"b{i}", mesh) for i, mesh in enumerate(boxes)], [camera()])
    return Case.of(built.scene, built.path)


def drawn_by(suspect, made: Case) -> list[int]:
    drawn = Drawn()
    verdict_of(made, suspect, listeners=[drawn])
    return drawn.drawn[0, ""].tolist()


def test_a_culler_is_made_anew_for_each_case_in_a_process_that_stays_until_it_is_forgotten():
    with suspect_of(f"{HERE}Counting", Making()) as suspect:
        assert drawn_by(suspect, row(6)) == [1]
        assert drawn_by(suspect, row(6)) == [1, 2]
        assert drawn_by(suspect, row(5)) == [1, 3]
        suspect.forget()
        assert drawn_by(suspect, row(6)) == [1]
    assert Counting.module == 0


def test_a_culler_whose_process_ends_has_a_new_one_in_the_next_case():
    with suspect_of(f"{HERE}Dies", Making()) as suspect:
        assert drawn_by(suspect, row(6)) == [1]
        verdict = verdict_of(row(4), suspect)
        assert verdict.status is Status.INCONCLUSIVE
        assert "ended" in verdict.failed or "exit" in verdict.failed
        assert drawn_by(suspect, row(6)) == [1]


def test_a_program_is_told_as_the_command_line_tells_it():
    text = "cat {scene} {path} {visible}"
    assert Program(Command.parse(text)).arguments == ["--command", text]


@pytest.mark.parametrize("spec", ["no-such-culler", "tests.search.test_suspects:Nobody"])
def test_who_is_not_there_is_refused_before_any_case(spec):
    with pytest.raises(InputError):
        suspect_of(spec, Making())
