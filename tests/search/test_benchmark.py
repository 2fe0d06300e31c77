"""The benchmark's search goes on without a fault that takes its process along."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass

import numpy as np

from tests.search.benchmark import Part, Progress, Step, searched
from tests.search.subjects import Subject
from visref.culler import Culler, DrawnSet


class DrawsNothing(Culler):
    name = "draws-nothing"

    def cull(self, camera):
        return DrawnSet(np.zeros(0, np.int32))


class EndsItsProcess(Culler):
    name = "ends-its-process"

    def cull(self, camera):
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError("it goes on")


@dataclass(frozen=True)
class Two(Part):
    @property
    def subjects(self):
        return [
            Subject(culler.name, culler.name, "", culler, moves=False)
            for culler in (EndsItsProcess, DrawsNothing)
        ]


def test_who_ends_its_process_is_out_and_not_found_and_the_others_go_on(tmp_path):
    part = Two(0, 1, "random", 0, 600.0, guided=True, one_each=False)
    row = searched(part, tmp_path / "beside").row(part.subjects)
    assert row["crashed"] == {"ends-its-process": 1}
    assert list(row["found"]) == ["draws-nothing"]
    assert row["not_found"] == {}


def test_whose_turn_it_is_has_spent_least_and_is_out_once_found():
    progress = Progress.of(2)
    assert progress.next == 0
    progress.take(Step(0, 0, 2.0, 3.0, ""))
    progress.take(Step(1, 0, 1.0, 4.0, ""))
    assert (progress.next, progress.number) == (1, {0: 1, 1: 1})
    progress.take(Step(1, 1, 5.0, 9.0, "MISSED_OBJECT"))
    assert (progress.next, progress.number, progress.seconds) == (0, {0: 1}, 9.0)
    assert progress.found[1].number == 1
