"""Scenes measured at once leave what measuring one after the other leaves."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from tests.support import tables_runs
from tests.support.tables_runs import ALL, BROKEN, NOTHING, SIZE, TOWN, Steps, paper
from visref.errors import InputError
from visref.papers.contents import Experiment, JudgedRun
from visref.run_folder.layout import MANIFEST
from visref.run_folder.read import read_run
from visref.tables import runs
from visref.tables.at_once import cores_of
from visref.tables.plan import side_by_side, tasks
from visref.tables.runs import run_all

OTHER = "city:scale=0.02,frames=4"
WALKS = (
    JudgedRun("first", TOWN, (ALL, NOTHING), size=SIZE),
    JudgedRun("second", OTHER, (ALL,), size=SIZE),
    JudgedRun("whole", OTHER, (ALL,), size=SIZE, alone=True),
)
COUNTED = (Experiment("count", "counting", OTHER, size=SIZE), Experiment("none", "counting"))


@pytest.fixture(autouse=True)
def own_experiments(monkeypatch):
    monkeypatch.setattr(runs, "load_entry", lambda group, name, kind: getattr(tables_runs, name))


def drawn(out: Path):
    """All that is no time."""
    found = {}
    for manifest in sorted(out.glob(f"records/*/*/{MANIFEST}")):
        found[manifest.parent.name] = read_run(manifest.parent).frames
    for file in sorted(out.glob("records/*/*/experiment.json")):
        found[file.parent.name] = json.loads(file.read_text())["result"]
    return found


@pytest.mark.slow
def test_two_at_once_leave_what_one_leaves_and_each_task_is_done_once(tmp_path):
    alone, beside = Steps(), Steps()
    run_all([paper(WALKS, COUNTED)], tmp_path / "one", alone, frames=2)
    measured = run_all([paper(WALKS, COUNTED)], tmp_path / "two", beside, frames=2, workers=2)
    assert measured.failures == {}
    assert drawn(tmp_path / "two") == drawn(tmp_path / "one")
    assert set(drawn(tmp_path / "two")) == {"first", "second", "whole", "count", "none"}
    assert sorted(beside.labels) == sorted(alone.labels)
    assert beside.all == alone.all
    assert beside.done == pytest.approx(beside.all)


@pytest.mark.slow
def test_what_fails_at_once_is_told_and_the_others_stand(tmp_path):
    walks = (*WALKS[:2], JudgedRun("broken", "city:scale=0.02,frames=3", (BROKEN,), size=SIZE))
    steps = Steps()
    measured = run_all([paper(walks, ())], tmp_path, steps, frames=1, workers=2)
    (label,) = measured.failures
    assert label == "toy/broken"
    assert "it fell over" in measured.failures[label]
    assert set(drawn(tmp_path)) == {"first", "second"}


@pytest.mark.slow
def test_a_worker_that_is_killed_is_told(tmp_path, monkeypatch):
    parent = os.getpid()

    def die(scene, path):
        assert os.getpid() != parent
        os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr(tables_runs, "dying", die, raising=False)
    work = (Experiment("dying", "dying"),)
    with pytest.raises(RuntimeError, match="by signal 9"):
        run_all([paper(WALKS[:1], work)], tmp_path, Steps(), frames=1, workers=2)


@pytest.mark.slow
def test_each_worker_has_cores_of_its_own_and_what_is_alone_has_all(tmp_path, monkeypatch):
    def cores(scene, path):
        return sorted(os.sched_getaffinity(0))

    monkeypatch.setattr(tables_runs, "cores", cores, raising=False)
    work = tuple(Experiment(f"on-{n}", "cores", f"city:scale=0.02,frames={n}") for n in (3, 4))
    alone = Experiment("alone", "cores", "city:scale=0.02,frames=3", alone=True)
    run_all([paper((), (*work, alone))], tmp_path, Steps(), frames=1, workers=2)
    found = drawn(tmp_path)
    everything = sorted(os.sched_getaffinity(0))
    assert found["alone"] == everything
    shares = cores_of(2)
    for key in ("on-3", "on-4"):
        assert found[key] in [share or everything for share in shares]


@pytest.mark.parametrize("workers", [1, 2, 3, 5])
def test_no_core_is_given_twice(workers):
    available = sorted(os.sched_getaffinity(0))
    shares = cores_of(workers)
    assert len(shares) == workers
    if len(available) < workers:
        assert not any(shares)
    else:
        assert sorted(core for share in shares for core in share) == available
        assert all(shares)


def test_the_longest_group_comes_first_and_neither_large_nor_lonely_ones_are_in_any():
    large = replace(WALKS[1], key="large", large=True)
    todo = tasks([paper((*WALKS, large), COUNTED)], large=True)
    groups = side_by_side(todo, 100)
    assert [[task.work.key for task in group] for group in groups] == [
        ["first"],
        ["second", "count"],
        ["none"],
    ]


def test_no_workers_are_refused(tmp_path):
    with pytest.raises(InputError, match="--workers is 0"):
        run_all([paper()], tmp_path, Steps(), workers=0)
