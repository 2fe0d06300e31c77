"""What the page says runs on a cluster cost is what the measurements give, and the schedule behind
it is one."""

from __future__ import annotations

import importlib.util
import json
from importlib.machinery import SourceFileLoader
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tool():
    loader = SourceFileLoader("cluster_costs", str(ROOT / "tools" / "cluster-costs"))
    spec = importlib.util.spec_from_loader(loader.name, loader)
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


COSTS = {"pictures": 3.0, "worker": 10.0, "task": 1.0, "frame": 0.5, "run": 5.0, "merged": 0.01}


def test_the_page_has_what_the_measurements_give(tool):
    figures = json.loads((ROOT / "docs" / "cluster-costs.json").read_text(encoding="utf-8"))
    page = (ROOT / "docs" / "cluster.md").read_text(encoding="utf-8")
    assert f"{tool.BEGIN}{tool.tables(figures)}{tool.END}" in page


def test_the_fit_finds_the_costs_that_made_its_figures(tool):
    shapes = [(1, 16, 1), (1, 16, 4), (2, 32, 4), (1, 32, 4), (4, 32, 4)]
    rows = [
        [workers, frames, tasks, 5.0, 3.0 + 10.0 * workers + tasks + 0.5 * frames]
        for workers, frames, tasks in shapes
    ]
    figures = {"rows": rows, "merging": {"frames": 8, "seconds": 0.08}}
    assert tool.model(figures) == pytest.approx(COSTS)


def test_one_worker_and_one_run_at_a_time_take_the_sum_of_all(tool):
    tasks = tool.FRAMES // tool.TASK_FRAMES
    run = 5.0 + 3.0 + 10.0 + tasks * (1.0 + 0.5 * tool.TASK_FRAMES) + 0.01 * tool.FRAMES
    hours, spent = tool.schedule(COSTS, 1, 1)
    assert hours == pytest.approx(tool.SCENES * run / 3600)
    assert spent == pytest.approx(hours)


@pytest.mark.parametrize("at_once", [1, 2, 8])
def test_no_schedule_is_quicker_than_its_work_or_its_longest_run_allow(tool, at_once):
    tasks = tool.FRAMES // tool.TASK_FRAMES
    work = tool.SCENES * tasks * (1.0 + 0.5 * tool.TASK_FRAMES) / 3600
    alone = (5.0 + 10.0 + 51.0 + 0.01 * tool.FRAMES) / 3600
    before = float("inf")
    for workers in (1, 3, 16, 500):
        hours, _ = tool.schedule(COSTS, workers, at_once)
        assert hours >= work / workers
        assert hours >= alone * tool.SCENES / at_once
        assert hours <= before
        before = hours
