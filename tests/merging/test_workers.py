"""Several workers leave what one would have left, and a failure of one is the run's."""

from __future__ import annotations

import os
import signal
from contextlib import contextmanager

import pytest

from tests.merging.scenes import FRAMES, Forgets, cullers, stereo, switched
from tests.merging.test_merge import POLICIES
from tests.support.same_bytes import differing
from visref.errors import InputError, NothingToJudge
from visref.forked import at_work
from visref.runs import judge_to_folder
from visref.workers import default_workers, judging_at_once


def making(kind):
    @contextmanager
    def anew():
        yield cullers(kind)

    return anew


def by(workers, out, kind, inputs=switched, **given):
    """The run folder of so many workers, and the frames that were told."""
    told = []
    with judging_at_once(inputs(), making(kind), out, workers=workers, **given) as finish:
        finish(told.append)
    return told


@pytest.mark.parametrize(
    ("kind", "workers", "inputs"),
    [("objects", 2, switched), ("broken", 3, switched), ("units", FRAMES, switched),
     ("views", 2, stereo)],
)  # fmt: skip
def test_any_number_of_workers_leaves_the_same_bytes(kind, workers, inputs, tmp_path):
    given = {"policy": POLICIES["late"], "pictures": 2, "repeat": 2}
    judge_to_folder(inputs(), cullers(kind), tmp_path / "one", anew=making(kind), **given)
    told = by(workers, tmp_path / "many", kind, inputs, **given)
    assert differing(tmp_path / "one", tmp_path / "many") == []
    assert sorted(told) == list(inputs().frames)
    assert sorted(os.listdir(tmp_path)) == ["many", "one"]


@pytest.mark.parametrize("kind", ["objects", "units"])
def test_all_superfluous_rows_are_the_same_by_any_number_of_workers(kind, tmp_path):
    given = {"superfluous_rows": True, "pictures": 1}
    judge_to_folder(switched(), cullers(kind), tmp_path / "one", **given)
    by(3, tmp_path / "many", kind, **given)
    assert differing(tmp_path / "one", tmp_path / "many") == []


class Dies(Forgets):
    """Ends its process in the fourth frame."""

    how = None

    def draw(self, camera):
        if camera.eye[0] == 3.0:
            self.how()
        return super().draw(camera)


def _kill():
    os.kill(os.getpid(), signal.SIGKILL)


def _raise(error):
    def how():
        raise error

    return how


@pytest.mark.parametrize(
    ("how", "error", "problem"),
    [
        (_kill, RuntimeError, "by signal 9"),
        (lambda: os._exit(0), RuntimeError, "with status 0"),
        (_raise(InputError("it is odd", fix="mend it", source="x")), InputError, "x: it is odd"),
    ],
)
def test_a_worker_that_ends_before_its_part_is_judged_ends_the_run(how, error, problem, tmp_path):
    @contextmanager
    def anew():
        culler = Dies()
        culler.how = how
        yield [("dies", culler)]

    with (
        pytest.raises(error, match=problem),
        judging_at_once(switched(), anew, tmp_path / "out", workers=2) as finish,
    ):
        finish(lambda frame: None)
    assert os.listdir(tmp_path) == []


def test_what_a_copy_raises_is_raised_and_the_others_end(tmp_path):
    def waits(tell):
        signal.pause()

    def fails(tell):
        tell(1)
        raise NothingToJudge("no GL here")

    told = []
    with pytest.raises(NothingToJudge, match="no GL here"), at_work([waits, fails]) as copies:
        copies.wait(told.append)
    assert told == [1]


def test_a_fault_in_a_copy_is_told_with_where_it_was(tmp_path):
    def fails(tell):
        raise KeyError("what is missing")

    with pytest.raises(RuntimeError, match="what is missing"), at_work([fails]) as copies:
        copies.wait(lambda told: None)


@pytest.mark.parametrize("workers", [0, FRAMES + 1])
def test_workers_are_at_least_one_and_at_most_as_many_as_frames(workers, tmp_path):
    with pytest.raises(InputError, match="--workers"):
        by(workers, tmp_path / "out", "units")


def test_a_run_of_few_frames_is_worth_one_worker():
    assert default_workers(switched()) == 1


def test_a_recording_is_worth_more_workers_with_many_frames_only(monkeypatch):
    from dataclasses import replace

    monkeypatch.setattr("visref.workers.available_threads", lambda: 2)
    path = switched(64).path
    for frames, workers in ((64, 1), (511, 1), (512, 2)):
        inputs = replace(switched(), path=path, frames=range(frames))
        monkeypatch.setattr(type(path), "views", lambda *_: path.frames[0].cameras)
        assert default_workers(inputs, recorded=True) == workers
        assert default_workers(inputs) == 2


def test_there_are_no_more_workers_than_cores_and_memory_allow(monkeypatch):
    from dataclasses import replace

    inputs = switched()
    many = replace(inputs, path=switched(64).path, frames=range(64))
    monkeypatch.setattr("visref.workers.available_threads", lambda: 4)
    assert default_workers(many) == 4
    monkeypatch.setattr("visref.workers.default_budget", lambda: 3 * (300 << 20))
    assert default_workers(many) == 3
    monkeypatch.setattr("visref.workers.default_budget", lambda: 1 << 20)
    assert default_workers(many) == 1
