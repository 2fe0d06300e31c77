"""The tables' files say what the results say, in every form, and the status with them."""

from __future__ import annotations

import csv
import json
import re

import pytest

from tests.support import chromium, tables_runs
from tests.support.tables_runs import ALL, NOTHING, SIZE, STOPPED, TOWN, Steps, paper
from visref.cli import main as cli
from visref.cli import tables as tables_command
from visref.cli.tables import rows_of
from visref.judging.status import Exit
from visref.papers.contents import Experiment, JudgedRun
from visref.tables import run_all, runs, write_tables

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def own_experiments(monkeypatch):
    tables_runs.All.cameras.clear()
    monkeypatch.setattr(runs, "load_entry", lambda group, name, kind: getattr(tables_runs, name))


@pytest.fixture
def measured(tmp_path):
    return run_all([paper()], tmp_path, Steps(), frames=2)


def texts(folder):
    return {file.suffix: file.read_text() for file in folder.glob("tables.*")}


def test_every_form_has_the_same_numbers(measured):
    page, status = write_tables(measured)
    assert status is Exit.NO_VIOLATION
    found = texts(page.parent)
    assert sorted(found) == [".csv", ".html", ".md", ".tex"]
    for suffix in (".html", ".md", ".tex"):
        flat = re.sub(r"\s+", " ", found[suffix].replace("\\%", "%"))
        assert "queries a frame" in flat
        assert "25.0 %" in flat
        assert "12.5 %" in flat
        assert "fewer queries than the paper" in flat
    rows = list(csv.DictReader(found[".csv"].splitlines()))
    queries = next(row for row in rows if row["quantity"] == "queries a frame")
    assert (queries["paper"], queries["published"], queries["ours"]) == ("toy", "14", "7")
    assert queries["ratio"] == "0.5"
    graded = {row["quantity"]: row for row in rows if row["grade"]}
    assert {name: (row["kind"], row["grade"]) for name, row in graded.items()} == {
        "fewer queries than the paper": ("claim", "holds"),
        "fewer than eight": ("own", "holds"),
    }
    held = graded["fewer queries than the paper"]
    assert [held[name] for name in ("ours", "low", "high", "published")] == ["7", "7", "7", "14"]


def test_rows_for_programs_are_those_of_the_csv(measured):
    page, _ = write_tables(measured)
    text = texts(page.parent)[".csv"]
    rows = rows_of(text)
    assert json.loads(json.dumps(rows, allow_nan=False)) == rows
    queries = next(row for row in rows if row["quantity"] == "queries a frame")
    assert (queries["published"], queries["ours"], queries["ratio"]) == (14.0, 7.0, 0.5)
    assert queries["grade"] is None
    assert [row["quantity"] for row in rows] == [
        row["quantity"] for row in csv.DictReader(text.splitlines())
    ]
    # An interval that is as wide as can be, and words in place of a number.
    (row,) = rows_of("ours,low,high,published,note\n2,-inf,inf,up to 3,1\n")
    assert list(row.values()) == [2.0, None, None, "up to 3", "1"]


def test_walks_stand_with_their_verdicts_and_rates(measured):
    page, _ = write_tables(measured)
    line = next(x for x in texts(page.parent)[".md"].splitlines() if "tables\\_runs:All" in x)
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[2:4] == ["conservative", "2"]
    assert cells[5:9] == ["0", "0", "0", "0 %"]


def test_the_same_records_give_the_same_bytes(measured):
    page, _ = write_tables(measured)
    before = {file.name: file.read_bytes() for file in page.parent.glob("t*.*")}
    write_tables(measured)
    assert before == {file.name: file.read_bytes() for file in page.parent.glob("t*.*")}
    assert len(before) == 4


def test_a_violation_is_the_status_and_is_counted_on_the_page(tmp_path):
    walk = JudgedRun("first", TOWN, (ALL, NOTHING), size=SIZE)
    measured = run_all([paper((walk,), ())], tmp_path, Steps(), frames=2)
    page, status = write_tables(measured)
    assert status is Exit.VIOLATION
    assert "0 violations" not in page.read_text()
    assert 'data-exit-status="1"' in page.read_text()


def test_what_could_not_be_measured_is_said_with_its_reason_and_is_no_pass(tmp_path):
    walks = (JudgedRun("first", TOWN, (ALL,), size=SIZE),)
    broken = (Experiment("count", "without_gl"),)
    measured = run_all([paper(walks, broken)], tmp_path, Steps(), frames=1)
    page, status = write_tables(measured)
    assert status is Exit.NOTHING_JUDGED
    for suffix in (".html", ".md"):
        assert "no OpenGL here" in texts(page.parent)[suffix]


def test_claims_are_counted_and_those_not_measured_apart(tmp_path):
    measured = run_all([paper((), ())], tmp_path, Steps(), frames=1)
    page, _ = write_tables(measured)
    assert "0 of 0 claims of the papers hold here, 1 not measured" in page.read_text()
    assert "? not measured" in (tmp_path / "claims.md").read_text()


def test_a_claim_of_ours_is_in_no_count(measured):
    page, _ = write_tables(measured)
    assert "1 of 1 claim of the papers hold here" in page.read_text()
    summary = (page.parent / "summary.md").read_text()
    assert summary.startswith("1 of 1 claim of the papers hold here. On 2 frames")
    assert "A Paper" in summary
    assert "|" not in summary
    assert summary in texts(page.parent)[".md"]
    theirs, _, own = (page.parent / "claims.md").read_text().partition("Claims of ours")
    assert "fewer than eight" in own
    assert "fewer than eight" not in theirs


def test_names_of_a_paper_are_text_on_the_page_and_no_markup(measured):
    page, _ = write_tables(measured)
    assert "share of &lt;all&gt;" in page.read_text()
    assert "A Paper &amp; Its Tables" in page.read_text()


@pytest.mark.slow
@pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium on this machine")
def test_the_page_opens_offline_at_any_width_without_complaint(measured):
    page_file, _ = write_tables(measured)
    with chromium.browser() as page:
        for width in (360, 768, 1280):
            page.open(page_file, width=width)
            assert page.run("document.documentElement.scrollWidth") <= width
        assert page.problems == []
        assert [url for url in page.requests if not url.startswith(("file:", "data:"))] == []


def test_another_seed_and_other_frames_are_said_and_measured_anew(tmp_path):
    run_all([paper()], tmp_path, Steps(), frames=2)
    usual = len(tables_runs.All.cameras)
    again = run_all([paper()], tmp_path, Steps(), frames=2, shift=0.25, seed=5)
    assert len(tables_runs.All.cameras) == 2 * usual
    page, _ = write_tables(again)
    told = "2 frames at most of each camera path, moved by +0.25 of the way from one to the next, "
    assert f"{told}scenes of seed 5" in texts(page.parent)[".md"]
    manifest = (tmp_path / "records" / "toy" / "first" / "manifest.json").read_text()
    assert f"{TOWN},seed=5" in manifest


# The command.


def test_the_command_measures_writes_and_prints_the_claims(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(tables_command, "load_paper", lambda name: paper())
    out = tmp_path / "out"
    assert cli.main(["tables", "--paper", "toy", "--frames", "2", "--out", str(out)]) == 0
    assert "fewer queries than the paper" in capsys.readouterr().out
    assert (out / "tables.html").is_file()


def test_an_interrupted_command_says_that_it_can_go_on(tmp_path, monkeypatch, capsys):
    first, second = paper().runs
    stopped = JudgedRun(second.key, TOWN, (STOPPED,), size=SIZE)
    monkeypatch.setattr(tables_command, "load_paper", lambda name: paper((first, stopped), ()))
    out = tmp_path / "out"
    line = ["tables", "--paper", "toy", "--frames", "1", "--workers", "1", "--out", str(out)]
    assert cli.main(line) == 130
    assert "the same command continues from there" in capsys.readouterr().err
    assert (out / "records" / "toy" / first.key / "manifest.json").is_file()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--paper", "hey2002"], "known are"),
        (["--frames", "0"], "--frames is 0"),
        (["--shift", "0.6"], "--shift is 0.6"),
        (["--seed", "-1"], "--seed is -1"),
    ],
)
def test_wrong_arguments_are_one_line_and_status_2(tmp_path, capsys, arguments, told):
    assert cli.main(["tables", *arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
