"""`make bench`: a benchmark of each kind runs, peers that are missing are said to be, and the page
in the repository is that of the JSON files there."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.measuring import Skipped, Turns
from benchmarks.page import HISTORY, KINDS, PAGE, page, tables

ROOT = Path(__file__).parent.parent.parent


def test_page_is_made_of_the_json_in_the_repository():
    assert PAGE.read_text(encoding="utf-8") == page(sorted(HISTORY.glob("*.json")))


def test_history_holds_known_kinds_machine_commit_and_versions():
    for file in sorted(HISTORY.glob("*.json")):
        run = json.loads(file.read_text(encoding="utf-8"))
        kinds = {one["extra_info"]["kind"] for one in run["benchmarks"]}
        # A run may be of some kinds alone: the page says what the last one measured.
        assert kinds, file.name
        assert kinds <= set(KINDS) - {"table"}, file.name
        assert run["commit_info"]["id"]
        machine = run["machine_info"]
        assert not machine["quick"]
        assert {"cpu", "cores", "versions"} <= set(machine)
        assert {"visref", "numpy", "embreex"} <= set(machine["versions"])


def a_run(day: int, figure: float) -> dict[str, object]:
    """A run as pytest-benchmark's JSON has it, with a benchmark of one kind."""
    job = {"wall_s": 2.0, "cpu_s": 1.0}
    info = {
        "kind": "check",
        "name": "a clean culler",
        "clock": "cpu",
        "jobs": {"100 frames": {**job, "speed": 1.0}, "truth given": {**job, "speed": 7.25}},
        "said": {"ms per frame": figure},
    }
    return {
        "datetime": f"2026-11-{day:02}T10:00:00",
        "commit_info": {"id": f"{day:040x}", "dirty": False},
        "machine_info": {
            "cpu": "a processor",
            "cores": 2,
            "system": "Linux",
            "machine": "x86_64",
            "python_version": "3.11",
            "versions": {"visref": "0.1.0"},
            "quick": False,
        },
        "benchmarks": [{"extra_info": info}],
    }


def test_page_shows_the_newest_run_and_the_figures_of_all(tmp_path):
    files = []
    for day, figure in ((1, 52.5), (2, 8.25)):
        files.append(tmp_path / f"{day}.json")
        files[-1].write_text(json.dumps(a_run(day, figure)), encoding="utf-8")
    lines = page(files).splitlines()
    assert "|  | truth given | 1 | 2 | 7.25 |" in lines
    assert "- a clean culler: ms per frame 8.25." in lines
    columns = "| figure | 2026-11-02 000000000000 | 2026-11-01 000000000000 |"
    assert columns in lines
    assert "| check: ms per frame | 8.25 | 52.5 |" in lines


@pytest.mark.slow
@pytest.mark.parametrize(
    ("chosen", "kind"),
    [
        ("cast and town", "cast"),
        ("run_by_workers", "run"),
        ("clean_check", "check"),
        ("judging", "judging"),
        ("misses", "misses"),
        ("start and not fresh", "start"),
        ("loading", "loading"),
    ],
)
def test_benchmark_of_each_kind_runs_on_a_tiny_scene(chosen, kind, tmp_path):
    out = tmp_path / "out.json"
    words = [sys.executable, "-m", "benchmarks", "--quick", "--only", chosen, "--json", str(out)]
    # Where tests are shared among processes, it would not measure.
    env = {name: value for name, value in os.environ.items() if "XDIST" not in name}
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stdout + done.stderr
    measured = json.loads(out.read_text(encoding="utf-8"))
    assert measured["benchmarks"]
    for one in measured["benchmarks"]:
        info = one["extra_info"]
        assert info["kind"] == kind
        for job in info["jobs"].values():
            assert "skipped" in job or (job["wall_s"] > 0.0 and job["cpu_s"] > 0.0)
    assert f"## {KINDS[kind]}" in done.stdout


class Recorded:
    """In place of pytest-benchmark's fixture: it runs what it is given, and keeps what is said."""

    def __init__(self) -> None:
        self.extra_info: dict[str, object] = {}

    def pedantic(self, target, setup, rounds, warmup_rounds):
        for _ in range(rounds + warmup_rounds):
            setup()
            target()


def test_jobs_take_turns_and_a_missing_peer_is_named():
    order: list[str] = []
    recorded = Recorded()
    jobs = {
        "ours": lambda: order.append("ours"),
        "theirs": lambda: order.append("theirs"),
        "other": Skipped("it is not installed"),
    }
    spent = Turns(recorded, quick=False).run("cast", "a scene", jobs, rounds=2)
    assert order == ["theirs", "ours"] * 3
    assert len(spent["ours"].cpu_s) == len(spent["theirs"].wall_s) == 2  # the first is not counted
    assert recorded.extra_info["jobs"]["other"] == {"skipped": "it is not installed"}
    told = tables({"benchmarks": [{"extra_info": recorded.extra_info}]})
    assert any("skipped: it is not installed" in line for line in told)


def test_speed_is_the_median_of_the_rounds_ratios(monkeypatch):
    clock = [0.0]
    takes = {"ours": iter([2.0, 20.0, 6.0]), "theirs": iter([1.0, 5.0, 6.0])}
    monkeypatch.setattr("benchmarks.measuring.cpu_seconds", lambda: clock[0])

    def job(name):
        def work():
            clock[0] += next(takes[name])

        return work

    recorded = Recorded()
    jobs = {name: job(name) for name in takes}
    Turns(recorded, quick=False).run("cast", "a scene", jobs, rounds=3, warm=False)
    assert recorded.extra_info["jobs"]["theirs"] == {
        "wall_s": pytest.approx(0.0, abs=1.0),
        "cpu_s": 5.0,
        "speed": 2.0,  # of 2, 4 and 1
    }
