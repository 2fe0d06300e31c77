"""What is said of a verdict is true, and says why: parts, undecided samples, what is hidden."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import pyarrow.parquet as pq
import pytest

from tests.support.page_reader import Reader
from tests.support.report_runs import (
    ALSO_HIDDEN,
    HIDDEN,
    OUTSIDE,
    PILLAR,
    VISIBLE,
    WALL,
    Scripted,
    scene,
    write_run,
    write_runs,
)
from visref.cli.main import main
from visref.culler import Raster, RasterTolerance
from visref.judging.status import Status
from visref.report.summary import summarise
from visref.report.words import culler_sentence, decided, declared, why_inconclusive
from visref.report.writing import write_report
from visref.run_folder.read import read_run

pytestmark = pytest.mark.slow


class Declared(Raster):
    """Known by its declaration alone."""

    tolerance = RasterTolerance(0.004, None)

    def item_buffer(self, camera):
        return None


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return write_runs(tmp_path_factory.mktemp("runs"))


def texts(folder, out):
    write_report([folder], out)
    return {
        name: (out / name).read_text(encoding="utf-8")
        for name in ("report.html", "junit.xml", "summary.md")
    }


def sentence(folder, culler, **counts):
    run = read_run(folder)
    row = summarise(run, culler)
    return culler_sentence(replace(row, counts=replace(row.counts, **counts)))


def test_half_of_an_object_lost_is_said_everywhere_and_nobody_says_that_all_was_drawn(
    runs, tmp_path
):
    folder = runs["partly"]
    verdict = json.loads((folder / "verdict.json").read_text())["cullers"]["halves"]
    assert (verdict["missed"], verdict["partly_missed"], verdict["missed_units"]) == (0, 1, 1)
    (row,) = [r for r in pq.read_table(folder / "objects.parquet").to_pylist() if r["partly"]]
    assert (row["object"], row["kind"]) == (PILLAR, "confirmed")
    (lost,) = read_run(folder).lost_objects("halves")
    assert (lost.misses, lost.partly, lost.samples) == (1, 1, verdict["missed_pixels"])
    said = f"Of 3 visible objects, 1 was partly missed: {lost.samples} samples lost."
    for name, text in texts(folder, tmp_path).items():
        assert said in text, name
        assert "partly missed" in text
        assert "was drawn wherever" not in text
    assert "<failure" in (tmp_path / "junit.xml").read_text()


def test_what_was_drawn_against_the_promise_is_listed_with_what_hides_it(runs, tmp_path):
    folder = runs["exact"]
    verdict = json.loads((folder / "verdict.json").read_text())["cullers"]["greedy"]
    assert (verdict["status"], verdict["superfluous_confirmed"]) == ("violation", 3)
    hidden = {one.unit: one for one in read_run(folder).hidden_units("greedy")}
    assert set(hidden) == {HIDDEN, ALSO_HIDDEN, OUTSIDE}
    one = hidden[HIDDEN]
    assert (one.name, one.frame, one.frames, one.occluder_name) == ("hidden", 0, 1, "wall")
    # A square of six units before a camera of a sample for each unit.
    assert one.samples == 36
    assert scene().object_of_triangle[one.occluder] == WALL
    assert (hidden[OUTSIDE].samples, hidden[OUTSIDE].occluder, hidden[OUTSIDE].x) == (0, None, None)
    rows = pq.read_table(folder / "objects.parquet").to_pylist()
    recorded = {(r["frame"], r["unit"]) for r in rows if r["samples"] is not None}
    assert recorded == {(0, HIDDEN), (0, ALSO_HIDDEN), (0, OUTSIDE)}
    found = texts(folder, tmp_path)
    for name, text in found.items():
        assert "hidden at all 36 samples that it covers, nearest by triangle" in text, name
        assert "it covers no sample" in text, name
        assert "3 times a hidden object was drawn (3 different), which the promise" in text, name
    units = [a["data-unit"] for a, _ in Reader(found["report.html"]).find("li") if "data-unit" in a]
    assert sorted(map(int, units)) == [HIDDEN, ALSO_HIDDEN, OUTSIDE]
    cases = ET.fromstring(found["junit.xml"]).iter("testcase")
    failed = {case.get("name"): case.find("failure") for case in cases}
    failure = failed[f"also hidden, object {ALSO_HIDDEN}, drawn though hidden"]
    assert "hidden at all" in failure.get("message")


def test_a_conservative_cullers_caution_is_no_record_of_hidden_units(runs):
    run = read_run(runs["violation"])
    assert run.hidden_units("none") == []
    assert run.verdict.cullers["none"].superfluous > 0


def test_each_object_was_drawn_is_said_only_where_nothing_was_lost(runs):
    folder, all_drawn = runs["clean"], "was drawn wherever it is seen"
    assert all_drawn in sentence(folder, "only")
    for lost in ({"missed": 1, "ties": 1}, {"partly_missed": 1, "within_raster_tolerance": 1}):
        assert all_drawn not in sentence(folder, "only", **lost)
    assert all_drawn not in sentence(folder, "only", partly_missed=None)
    assert "seen for certain" in sentence(folder, "only", undecided_samples=5)


def test_what_was_excused_is_counted_with_the_tolerance_that_excused_it(runs):
    row = summarise(read_run(runs["clean"]), "only")
    counts = replace(row.counts, missed=2, within_raster_tolerance=2)
    excused = replace(row, counts=counts, raster=RasterTolerance(0.004, 24))
    assert "2 within the rasteriser's tolerance (snap 0.004 px, 24 bits of depth)" in (
        culler_sentence(excused)
    )
    counted = culler_sentence(replace(excused, excused_samples=7))
    assert "24 bits of depth) with 7 samples lost" in counted
    assert declared(RasterTolerance(0.25, None)) == "snap 0.250 px, float depth"


def test_undecided_samples_are_told_as_a_share():
    assert decided(200, 0) == "Every sample that the verdict hangs on was decided."
    assert decided(200, 124).startswith("62.0 % of the 200 owned samples hang on alpha masks: ")
    assert "alpha masks or rounded vertices" in decided(200, 124, rounded=True)
    assert decided(None, None) == decided(0, 0) == ""


@pytest.mark.parametrize(
    ("frames", "visible", "undecided", "failed", "unsteady", "why"),
    [
        (0, 0, 0, True, False, "judged no frame"),
        (3, 5, 0, True, True, "broke down"),
        (3, 0, 0, False, True, "No object is visible"),
        (3, 0, 100, False, False, "Nothing is decided"),
        (3, 5, 60, False, True, "more than the 50.0 % that may stay undecided"),
        (3, 5, 0, False, True, "not deterministic"),
    ],
)
def test_an_inconclusive_verdict_says_why(frames, visible, undecided, failed, unsteady, why):
    said = why_inconclusive(
        frames=frames,
        visible=visible,
        owned=100,
        undecided=undecided,
        failed=failed,
        unsteady=unsteady,
        max_undecided=0.5,
    )
    assert why in said


def test_the_report_exits_by_the_records(runs, tmp_path):
    def exit_of(*names):
        folders = [str(runs[name]) for name in names]
        return main(["report", *folders, "--out", str(tmp_path / "page")])

    assert exit_of("clean") == exit_of("measured") == exit_of("clean", "measured") == 0
    assert exit_of("clean", "inconclusive") == 3
    assert exit_of("inconclusive", "violation", "clean") == 1
    page = (tmp_path / "page" / "report.html").read_text()
    ((header, _),) = Reader(page).find("header")
    assert (header["data-status"], header["data-exit-status"]) == ("violation", "1")
    assert exit_of("measured", "measured") == 0
    page = (tmp_path / "page" / "report.html").read_text()
    ((header, _),) = Reader(page).find("header")
    assert header["data-status"] == Status.MEASURED


def test_declared_tolerances_are_in_the_manifest(tmp_path):
    class Declares(Scripted):
        raster = Declared()

    folder = write_run(
        tmp_path / "run", [("snaps", Declares(VISIBLE)), ("rays", Scripted(VISIBLE))], frames=1
    )
    manifest = json.loads((folder / "manifest.json").read_text())["cullers"]
    assert manifest["snaps"]["raster"] == {"snap_px": 0.004, "depth_bits": None}
    assert manifest["rays"]["raster"] is None
    run = read_run(folder)
    assert run.manifest.cullers["snaps"].raster == RasterTolerance(0.004, None)
    assert "snap 0.004 px, float depth" in texts(folder, tmp_path / "page")["report.html"]
