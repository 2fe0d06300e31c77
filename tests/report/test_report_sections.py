"""The report's sections: misses by kind, causes, speed against error, the papers' tables."""

from __future__ import annotations

import collections
import json
import re
import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace

import pyarrow.parquet as pq
import pytest

from tests.support.page_reader import Reader
from tests.support.report_runs import BROKEN, HEIGHT, LOOSE, WIDTH, bench_folder, write_runs
from visref import papers
from visref.errors import InputError
from visref.papers.contents import Claim, Printed, Row, Sense, Table, single
from visref.report.words import percent
from visref.report.writing import write_report


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return write_runs(tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module")
def violation(runs, tmp_path_factory):
    """The page and the Markdown of the run with a violation."""
    out = tmp_path_factory.mktemp("page")
    page = write_report([runs["violation"]], out)
    return page.read_text(), (out / "summary.md").read_text()


def test_misses_are_told_by_kind_and_the_kinds_add_up(runs, violation):
    page, _ = violation
    table = page[page.index(">Misses by kind</h2>") :]
    rows = re.findall(r"<tr><th scope=\"row\"><code>(.*?)</code></th>(.*?)</tr>", table)
    verdict = json.loads((runs["violation"] / "verdict.json").read_text())["cullers"]
    assert {culler for culler, _ in rows} == {BROKEN, LOOSE}
    for culler, cells in rows:
        missed, partly, *kinds, undecided = map(int, re.findall(r"<td>(\d+)</td>", cells))
        assert missed == verdict[culler]["missed"]
        assert missed + partly == sum(kinds)
        assert kinds[0] == verdict[culler]["violations"]
        assert (kinds[0] > 0) == (culler == BROKEN)
        assert undecided == 0


def test_what_was_drawn_for_nothing_is_told_by_cause_as_recorded(runs, violation):
    shown = {
        (attrs["data-culler-name"], attrs["data-cause"]): text
        for attrs, text in Reader(violation[0]).find("td")
        if "data-cause" in attrs
    }
    rows = pq.read_table(runs["violation"] / "objects.parquet").to_pylist()
    recorded = collections.Counter(
        (row["culler"], row["cause"]) for row in rows if row["cause"] is not None
    )
    explained = collections.Counter(row["culler"] for row in rows if row["cause"] is not None)
    assert recorded
    assert {key for key, text in shown.items() if text != "0"} == set(recorded)
    for (culler, cause), number in recorded.items():
        text = shown[culler, cause]
        assert text == f"{number:,}{percent(number / explained[culler])}"
    # A wall hides it; the scripted culler does not tell when it asked.
    assert "- tight: hidden, culler silent 100 %" in violation[1]


def test_a_run_folder_from_before_causes_and_rates_by_pixel_is_still_shown(runs, tmp_path):
    folder = shutil.copytree(runs["violation"], tmp_path / "run")
    for name, column in (("objects", "cause"), ("frames", "owned")):
        table = pq.read_table(folder / f"{name}.parquet")
        pq.write_table(table.drop_columns([column]), folder / f"{name}.parquet")
    page = write_report([folder], tmp_path / "page").read_text()
    assert "Drawn for nothing, and why" not in page
    cells = [text for attrs, text in Reader(page).find("td", data_measure="fnr_px")]
    assert set(cells) == {"–"}


def test_a_finding_of_a_newer_version_is_shown_by_what_its_record_says(runs, tmp_path):
    folder = shutil.copytree(runs["clean"], tmp_path / "run")
    verdict = json.loads((folder / "verdict.json").read_text())
    shape = {"culler": "", "frame": None, "object": ""}
    verdict["findings"] += [
        {"code": "NO_GL", "severity": "warning", "message": "of this one", **shape},
        {"code": "LATER_CODE", "severity": "error", "message": "of a later one", **shape},
    ]
    (folder / "verdict.json").write_text(json.dumps(verdict))
    page = write_report([folder], tmp_path / "page").read_text()
    assert page.index("of a later one") < page.index("of this one")  # the gravest first
    assert "<code>LATER_CODE</code>" in page


def test_the_junit_case_says_how_to_replay_and_the_rates(runs, tmp_path):
    write_report([runs["violation"]], tmp_path / "a" / "b")
    suite = ET.parse(tmp_path / "a" / "b" / "junit.xml").getroot()
    _, failure = suite.iter("failure")
    command = re.search(r"visref explain (\S+) --frame \d+ --object \d+", failure.text)
    assert (tmp_path / "a" / "b" / command[1]).resolve() == runs["violation"].resolve()
    (case,) = [case for case in suite.iter("testcase") if case.get("name") == "tight"]
    assert "FNR 0 %, partly 0 %, FPR " in case.find("system-out").text


def test_a_bench_folder_among_the_runs_is_shown_as_speed_against_error(runs, tmp_path):
    bench = bench_folder(tmp_path / "bench")
    page = write_report([bench, runs["clean"]], tmp_path / "page").read_text()
    assert page == write_report([runs["clean"], bench], tmp_path / "page").read_text()
    reader = Reader(page)
    ((_, section),) = reader.find("section", **{"class": "bench"})
    for text in ("Stop at <b>", "Exact costs more.", "city.glb, 2 frames", "../bench"):
        assert text in section
    assert any(attrs["src"].startswith("data:image/svg+xml") for attrs, _ in reader.find("img"))
    markdown = (tmp_path / "page" / "summary.md").read_text()
    assert "Speed against error, city.glb**: Stop at" in markdown
    with pytest.raises(InputError, match="no run folder"):
        write_report([bench], tmp_path / "other")


def without_plot(folder):
    (folder / "bench.svg").unlink()


def newer(folder):
    record = json.loads((folder / "bench.json").read_text())
    (folder / "bench.json").write_text(json.dumps(record | {"version": 2}))


def no_json(folder):
    (folder / "bench.json").write_text("{")


@pytest.mark.parametrize("spoil", [without_plot, newer, no_json])
def test_a_spoilt_bench_folder_is_an_error_in_one_line(runs, tmp_path, spoil):
    bench = bench_folder(tmp_path / "bench")
    spoil(bench)
    with pytest.raises(InputError) as caught:
        write_report([runs["clean"], bench], tmp_path / "page")
    assert str(bench) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_run_that_is_a_papers_walk_is_set_beside_it(runs, tmp_path, monkeypatch):
    """Only the rows and the claims that this run measures."""
    wanted = papers.JudgedRun("squares", "folder/squares.glb", ("only",), size=(WIDTH, HEIGHT))

    def tables(results):
        run = results.run("squares")
        assert results.experiment("any") is None
        drawn = None if run is None else run.verdict.cullers["only"].drawn
        all_drawn = Printed(30, "Fig. 7", "drawn")
        rows = (Row("drawn | all", all_drawn, drawn), Row("elsewhere", all_drawn, None))
        claims = (
            Claim("fewer drawn", Sense.AT_MOST, single(15.0), all_drawn, even=None),
            Claim("not of this run", Sense.AT_MOST, None),
        )
        return [
            Table("Drawn <units>", "Fig. 7", rows, claims),
            Table("Empty", "Fig. 8", rows[1:]),
        ]

    for walk, shown in ((wanted, True), (replace(wanted, size=(9, 9)), False),
                        (replace(wanted, cullers=("only", "other")), False),
                        (replace(wanted, cull_backfaces=True), False),
                        (replace(wanted, scene="city"), False)):  # fmt: skip
        paper = papers.Paper("p", "A. Author: A Title", (walk,), (), tables)
        monkeypatch.setattr(papers, "paper_names", lambda: ["p"])
        monkeypatch.setattr(papers, "load_paper", lambda name, paper=paper: paper)
        page = write_report([runs["clean"]], tmp_path).read_text()
        assert ("Beside the papers" in page) is shown
        markdown = (tmp_path / "summary.md").read_text()
        assert ("## Beside A. Author" in markdown) is shown
        if shown:
            (found,) = Reader(page).find("section", **{"class": "paper-table"})
            assert "drawn | all" in found[1]
            assert "0.500" in found[1]
            assert "elsewhere" not in found[1]
            assert "Fig. 8" not in page
            assert "fewer drawn" in page
            assert "not of this run" not in page
            assert "| drawn \\| all | 30 | 15 | 0.500 |" in markdown
