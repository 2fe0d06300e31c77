"""The reports say what the record says, escape what is not theirs, and need nothing else."""

from __future__ import annotations

import collections
import itertools
import json
import re
import shutil
import statistics
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import chromium
from tests.report_runs import (
    ALSO_HIDDEN,
    EVERYTHING,
    HEIGHT,
    HIDDEN,
    NASTY,
    NASTY_ID,
    OUTSIDE,
    PILLAR,
    VISIBLE,
    WALL,
    WIDTH,
    Scripted,
    SlippingPainter,
    scene,
    write_run,
)
from visref import papers
from visref.culler import Promise
from visref.errors import InputError
from visref.papers.table import Row, Table, Trend
from visref.report import write_report
from visref.report.plots import Series, on_scale, ticks
from visref.report.words import percent, quantity
from visref.scene import Units

BROKEN = "module:Forgets"
LOOSE = "loose:budget=3"


def triangle_units():
    count = scene().triangle_count
    return Units(np.arange(count + 1), np.arange(count, dtype=np.int32), "triangle")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Run folders by what is to be said of them."""
    root = tmp_path_factory.mktemp("runs")
    without_nasty = (WALL, PILLAR, HIDDEN)
    return {
        "violation": write_run(
            root / "violation",
            [
                ("none", Scripted(EVERYTHING)),
                ("tight", Scripted(VISIBLE, (*VISIBLE, HIDDEN), queries=7)),
                (BROKEN, Scripted(VISIBLE, without_nasty, VISIBLE, without_nasty, queries=3)),
                (LOOSE, Scripted(VISIBLE, (WALL,), promise=Promise.APPROXIMATE)),
                ("triangles", Scripted(range(12), units=triangle_units())),
                ("falls", Scripted(EVERYTHING, fails_at=2)),
            ],
        ),
        "clean": write_run(root / "clean", [("only", Scripted(VISIBLE))], engine="exact:tile=64"),
        "loose": write_run(
            root / "loose", [("loose", Scripted((WALL,), promise=Promise.AGGRESSIVE))]
        ),
        "inconclusive": write_run(root / "open", [("falls", Scripted(VISIBLE, fails_at=0))]),
    }


@pytest.fixture(scope="module")
def pages(runs, tmp_path_factory):
    """The three files' texts for each run: (page, junit, markdown)."""
    found = {}
    for name, folder in runs.items():
        out = tmp_path_factory.mktemp("pages") / name
        page = write_report([folder], out)
        assert page == out / "report.html"
        found[name] = tuple(
            (out / file).read_text(encoding="utf-8")
            for file in ("report.html", "junit.xml", "summary.md")
        )
    return found


class Reader(HTMLParser):
    """Every element as (tag, attributes, text below it)."""

    VOID = frozenset({"meta", "img", "input", "br", "wbr", "line", "circle", "rect"})

    def __init__(self, text):
        super().__init__()
        self.elements, self._open = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        element = (tag, dict(attrs), [])
        self.elements.append(element)
        if tag not in self.VOID:
            self._open.append(element)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), []))

    def handle_endtag(self, tag):
        while self._open and self._open.pop()[0] != tag:
            pass

    def handle_data(self, data):
        for element in self._open:
            element[2].append(data)

    def find(self, tag=None, **attributes):
        return [
            (attrs, "".join(text))
            for name, attrs, text in self.elements
            if (tag is None or name == tag)
            and all(attrs.get(key.replace("_", "-")) == value for key, value in attributes.items())
        ]


def record(folder):
    return json.loads((folder / "verdict.json").read_text())


@pytest.mark.parametrize(
    ("name", "headline"),
    [
        ("violation", "Violation"),
        ("clean", "No violation found"),
        ("loose", "No violation found"),
        ("inconclusive", "Inconclusive"),
    ],
)
def test_headline_is_the_verdicts_status(runs, pages, name, headline):
    page, _, markdown = pages[name]
    (attrs, _), *_ = Reader(page).find("header")
    verdict = record(runs[name])
    assert attrs["data-status"] == verdict["status"]
    assert attrs["data-exit-status"] == str(verdict["exit_status"])
    ((_, title),) = Reader(page).find("h1")
    assert title.lstrip("✕✓?") == headline
    assert markdown.splitlines()[0].endswith(headline)


def test_status_follows_verdict_json_and_is_not_judged_again(runs, tmp_path):
    folder = shutil.copytree(runs["clean"], tmp_path / "run")
    verdict = record(folder)
    verdict |= {"status": "violation", "exit_status": 1}
    (folder / "verdict.json").write_text(json.dumps(verdict))
    page = write_report([folder], tmp_path / "page").read_text()
    ((_, title),) = Reader(page).find("h1")
    assert title == "✕Violation"


def test_a_run_without_violation_never_calls_one_found(pages):
    page, junit, markdown = pages["clean"]
    shown = re.sub(r"<style>.*?</style>|<script>.*?</script>", "", page, flags=re.S)
    for text in (shown, markdown):
        assert not re.search(r">\s*Violation|✕", text)
    assert "<failure" not in junit


def test_every_number_of_the_table_is_the_records(runs, pages):
    folder = runs["violation"]
    cells = {
        (attrs["data-culler-name"], attrs["data-measure"]): text
        for attrs, text in Reader(pages["violation"][0]).find("td")
        if "data-measure" in attrs
    }
    values = {
        (attrs.get("data-culler-name"), attrs.get("data-measure")): attrs
        for attrs, _ in Reader(pages["violation"][0]).find("td")
    }
    verdict = record(folder)
    frames = pq.read_table(folder / "frames.parquet").to_pylist()
    times = pq.read_table(folder / "timings.parquet").to_pylist()
    triangles = scene().triangle_count
    assert {culler for culler, _ in cells} == set(verdict["cullers"])
    for culler, counts in verdict["cullers"].items():
        rows = [row for row in frames if row["culler"] == culler]

        def shown(measure, culler=culler):
            return cells[culler, measure]

        assert shown("visible") == f"{counts['visible']:,}"
        unit = "" if counts["unit_kind"] == "object" else "triangles"
        assert shown("drawn") == f"{counts['drawn']:,}{unit}"
        owned = sum(row["owned"] for row in rows)
        assert shown("fnr_px") == percent(counts["missed_pixels"] / owned)
        share = percent(counts["superfluous"] / counts["drawn"])
        assert shown("superfluous") == f"{counts['superfluous']:,}{share}"
        confirmed = f"{counts['confirmed']:,} confirmed" if counts["confirmed"] else ""
        assert shown("missed") == f"{counts['missed']:,}{confirmed}"
        assert shown("missed_pixels") == f"{counts['missed_pixels']:,}"
        assert shown("fnr") == percent(counts["missed"] / counts["visible"])
        hidden = 6 * len(rows) - counts["visible"]
        by_object = counts["unit_kind"] == "object"
        assert shown("fpr") == (percent(counts["superfluous"] / hidden) if by_object else "–")
        samples = len(rows) * WIDTH * HEIGHT
        assert shown("per") == percent(counts["missed_pixels"] / samples)
        asked = [row["queries"] for row in rows if row["queries"] is not None]
        assert shown("queries") == (quantity(statistics.fmean(asked)) if asked else "–")
        drawn = statistics.fmean(row["triangles_drawn"] for row in rows)
        assert shown("triangle_share") == percent(drawn / triangles)
        ms = [row["ms"] for row in times if row["culler"] == culler and row["phase"] == "cull"]
        assert shown("ms_median") == quantity(statistics.median(ms))
        assert ("alarm" in values[culler, "missed"]["class"]) == (counts["confirmed"] > 0)
    assert cells["tight", "query_fragments"] == "3 M"
    assert cells["tight", "queries"] == "21"


def test_only_safe_cullers_are_called_best(pages):
    """BROKEN and LOOSE draw least, but they lose objects."""
    best = {
        (attrs["data-measure"], attrs["data-culler-name"])
        for attrs, _ in Reader(pages["violation"][0]).find("td")
        if "best" in attrs.get("class", "").split()
    }
    assert ("superfluous", "tight") in best
    assert ("triangle_share", "tight") in best
    assert {culler for _, culler in best} == {"tight"}


def test_plots_carry_the_frames_own_numbers(runs, pages):
    rows = pq.read_table(runs["violation"] / "frames.parquet").to_pylist()
    plots = {
        text.strip(): json.loads(figure["data-plot"])
        for figure, whole in Reader(pages["violation"][0]).find("figure")
        if "data-plot" in figure
        for text in [whole.strip().splitlines()[0]]
    }
    for title, column in (("Missed", "missed"), ("Samples lost", "missed_pixels")):
        (plot,) = [plot for name, plot in plots.items() if name.startswith(title)]
        for line in plot["lines"]:
            expected = [row[column] for row in rows if row["culler"] == line["label"]]
            assert line["values"] == expected
        assert {line["label"] for line in plot["lines"]} == {BROKEN, LOOSE}
    (drawn,) = [plot for name, plot in plots.items() if name.startswith("Drawn against")]
    assert drawn["frames"] == [0, 1, 2, 3, 4]
    assert drawn["lines"][0]["label"] == "visible"
    assert drawn["lines"][0]["values"] == [3] * 5
    falls = next(line for line in drawn["lines"] if line["label"] == "falls")
    assert falls["values"] == [6, 6, None, None, None]
    assert "triangles" not in {line["label"] for line in drawn["lines"]}
    assert any(name.startswith("Drawn triangles") for name in plots)


def test_each_loss_has_its_witness_and_a_command_from_the_pages_folder(runs, tmp_path):
    folder = runs["violation"]
    out = tmp_path / "some" / "where"
    reader = Reader(write_report([folder], out).read_text())
    rows = pq.read_table(folder / "objects.parquet").to_pylist()
    lost = {(row["object"], row["frame"]): row for row in rows if row["kind"] == "confirmed"}
    commands = [text for attrs, text in reader.find("p", **{"class": "command"})]
    witnesses = [text for attrs, text in reader.find("p", **{"class": "witness"})]
    # BROKEN loses one object, LOOSE two.
    assert len(commands) == len(witnesses) == 3
    for command, witness in zip(commands, witnesses, strict=True):
        match = re.match(r"visref explain (\S+) --frame (\d+) --object (\d+)", command)
        assert (out / match[1]).resolve() == folder.resolve()
        row = lost[int(match[3]), int(match[2])]
        assert f"frame {row['frame']}" in witness
        assert f"pixel ({row['x']}, {row['y']})" in witness
        assert f"triangle {row['triangle']}" in witness
        assert f"depth {row['depth']:.6g}" in witness
    titles = [text for _, text in reader.find("span", **{"class": "loss"})]
    pixels = sum(
        row["pixels"]
        for row in rows
        if row["culler"] == BROKEN and row["object"] == NASTY_ID and row["kind"] == "confirmed"
    )
    assert titles[0] == f"{pixels} samples lost over 3 frames"


def test_losses_come_by_samples_and_name_the_first_of_equal_frames(runs, pages):
    """LOOSE loses the pillar (100 samples a frame, always in view) and the nasty one (4)."""
    objects = [
        int(attrs["data-object"])
        for attrs, _ in Reader(pages["violation"][0]).find("li")
        if "data-object" in attrs
    ]
    assert objects == [NASTY_ID, PILLAR, NASTY_ID]
    rows = pq.read_table(runs["violation"] / "objects.parquet").to_pylist()
    equal = [row for row in rows if (row["culler"], row["object"]) == (LOOSE, PILLAR)]
    assert len({row["pixels"] for row in equal}) == 1
    first = min(row["frame"] for row in equal)
    witnesses = Reader(pages["violation"][0]).find("p", **{"class": "witness"})
    assert f"worst in frame {first} " in witnesses[1][1]


def test_long_lists_are_cut_with_a_count(tmp_path):
    folder = write_run(tmp_path / "run", [("c", Scripted(()))], pictures=())
    rows = pq.read_table(folder / "objects.parquet")
    many = rows.slice(0, 1).to_pylist()[0]
    copies = [many | {"object": i, "name": f"o{i}"} for i in range(1000)]
    pq.write_table(pa.Table.from_pylist(copies, schema=rows.schema), folder / "objects.parquet")
    page = write_report([folder], tmp_path / "page").read_text()
    shown = len(Reader(page).find("p", **{"class": "command"}))
    assert 0 < shown < 20
    assert f"… and {1000 - shown} more objects" in page
    assert f"… and {1000 - 5} more objects" in (tmp_path / "page" / "summary.md").read_text()


def test_names_cannot_break_out_of_the_page(pages):
    page, _, markdown = pages["violation"]
    reader = Reader(page)
    assert len(reader.find("script")) == 1
    assert "<script>alert" not in page
    assert any(text == NASTY for _, text in reader.find("b"))
    assert "<script>" not in markdown.replace("\\<script\\>", "")
    assert "it fell over <here>" not in page


def test_page_refers_to_nothing_outside_itself(pages):
    for page, _, _ in pages.values():
        assert not re.search(r"""(?:src|href|action|data|poster)\s*=\s*["']?\s*(?:\w+:)?//""", page)
        assert not re.search(r"@import|url\(|fetch\(|XMLHttpRequest|<link|<iframe", page)
        for attrs, _ in Reader(page).find("img"):
            assert attrs["src"].startswith("data:image/")


def test_pages_do_not_name_the_machines_folders(runs, pages):
    for name, folder in runs.items():
        for text in pages[name]:
            assert str(folder.parent) not in text


def test_same_folders_give_the_same_bytes(runs, tmp_path):
    texts = []
    for name in ("a", "b"):
        write_report([runs["violation"], runs["clean"]], tmp_path / name)
        texts.append([file.read_bytes() for file in sorted((tmp_path / name).iterdir())])
    assert texts[0] == texts[1]
    assert len(texts[0]) == 3


def test_several_runs_stand_under_the_worst_of_their_verdicts(runs, tmp_path):
    page = write_report([runs["clean"], runs["inconclusive"], runs["violation"]], tmp_path)
    reader = Reader(page.read_text())
    ((header, _),) = reader.find("header")
    assert header["data-status"] == "violation"
    sections = [attrs["data-status"] for attrs, _ in reader.find("section", **{"class": "run"})]
    assert sections == ["no_violation_found", "inconclusive", "violation"]
    clean = write_report([runs["clean"], runs["loose"]], tmp_path / "two")
    ((header, _),) = Reader(clean.read_text()).find("header")
    assert header["data-status"] == "no_violation_found"


def test_what_is_not_claimed_depends_on_the_engine(pages):
    assert "not a proof of safety" in pages["violation"][0]
    assert "not a proof of safety" in pages["violation"][2]
    assert "not a proof of safety" not in pages["clean"][0]
    assert "The truth is exact" in pages["clean"][0]


def test_a_culler_that_broke_down_is_not_praised_for_its_first_frames(pages):
    reader = Reader(pages["violation"][0])
    (falls,) = [text for _, text in reader.find("div", data_culler_name="falls")]
    assert "Inconclusive" in falls
    assert "Then it broke down" in falls
    assert "No violation found" not in falls
    assert "No frame was judged" in pages["inconclusive"][0]


def test_a_culler_that_promised_nothing_gets_no_tick(pages):
    reader = Reader(pages["violation"][0])
    (loose,) = [text for _, text in reader.find("div", data_culler_name=LOOSE)]
    assert "Measured, not convicted" in loose
    assert "No violation found" not in loose


def test_junit_counts_violations_as_failures_and_doubt_as_errors(runs, pages):
    suite = ET.fromstring(pages["violation"][1]).find("testsuite")
    verdict = record(runs["violation"])
    statuses = {name: culler["status"] for name, culler in verdict["cullers"].items()}
    assert suite.get("tests") == str(len(statuses))
    assert suite.get("failures") == "1"
    assert suite.get("errors") == "1"
    for case in suite.iter("testcase"):
        status = statuses[case.get("name")]
        assert case.get("classname") == "squares.glb"
        assert (case.find("failure") is not None) == (status == "violation")
        assert (case.find("error") is not None) == (status == "inconclusive")
    (failure,) = suite.iter("failure")
    assert NASTY.replace("\x07", "\ufffd") in failure.text
    assert "it fell over <here>" in "".join(suite.itertext())


def test_markdown_table_survives_any_name(runs, pages):
    lines = pages["violation"][2].splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert len(table) == 2 + len(record(runs["violation"])["cullers"])
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in table} == {12}
    assert len(lines) < 60


def test_frame_browser_holds_every_picture_of_the_manifest_once(runs, pages):
    manifest = json.loads((runs["violation"] / "manifest.json").read_text())
    files = {file for entry in manifest["pictures"] for file in entry["files"].values()}
    images = [attrs["src"] for attrs, _ in Reader(pages["violation"][0]).find("img")]
    assert len(images) == len(files)
    shown = {attrs["data-frame"] for attrs, _ in Reader(pages["violation"][0]).find("article")}
    assert shown == {str(entry["frame"]) for entry in manifest["pictures"]}


def test_pictures_show_the_samples_as_exact_arithmetic_left_them(tmp_path):
    """The engine gives a wall's sample to what is hidden behind it; the verdict takes it back,
    and the picture must not show it as lost."""
    folder = write_run(
        tmp_path / "run", [("c", Scripted(VISIBLE))], frames=1, truth=SlippingPainter
    )
    (row,) = pq.read_table(folder / "frames.parquet").to_pylist()
    assert (row["corrections"], row["missed_pixels"]) == (1, 0)
    (entry,) = json.loads((folder / "manifest.json").read_text())["pictures"]
    assert "errors" not in entry["files"]


def test_of_many_pictured_frames_the_worst_are_kept(tmp_path):
    drawn = [VISIBLE] * 40
    drawn[5], drawn[13] = (WALL,), (WALL, PILLAR)
    folder = write_run(tmp_path / "run", [("c", Scripted(*drawn))], frames=40, pictures=range(40))
    page = write_report([folder], tmp_path / "page").read_text()
    shown = [int(attrs["data-frame"]) for attrs, _ in Reader(page).find("article")]
    assert shown == sorted(shown)
    assert {5, 13} <= set(shown)
    assert len(shown) == 12
    assert "28 more pictured frames" in page
    ((browser, _),) = Reader(page).find("div", **{"class": "browser"})
    assert browser["data-start-frame"] == "5"


def spoil_json(folder):
    (folder / "verdict.json").write_text("{")


def spoil_table(folder):
    (folder / "objects.parquet").write_bytes(b"PAR1")


def foreign_manifest(folder):
    (folder / "manifest.json").write_text('{"format": "something else"}')


def newer_manifest(folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"version": 2}))


def list_manifest(folder):
    (folder / "manifest.json").write_text("[]")


def drop(name):
    def spoil(folder):
        (folder / name).unlink()

    return spoil


@pytest.mark.parametrize(
    ("spoil", "names"),
    [
        (shutil.rmtree, "no run folder"),
        (drop("manifest.json"), "manifest.json"),
        (drop("verdict.json"), "verdict.json"),
        (drop("frames.parquet"), "frames.parquet"),
        (drop("timings.parquet"), "timings.parquet"),
        (drop("pictures/frame-00000.jpg"), "frame-00000.jpg"),
        (spoil_json, "verdict.json"),
        (spoil_table, "objects.parquet"),
        (foreign_manifest, "manifest.json"),
        (newer_manifest, "version 1"),
        (list_manifest, "manifest.json"),
    ],
)
def test_what_is_no_run_folder_is_said_in_one_line_and_nothing_is_written(
    runs, tmp_path, spoil, names
):
    folder = shutil.copytree(runs["clean"], tmp_path / "run")
    spoil(folder)
    with pytest.raises(InputError) as caught:
        write_report([runs["clean"], folder], tmp_path / "page")
    line = str(caught.value)
    assert names in line
    assert str(folder) in line
    assert "\n" not in line
    assert not (tmp_path / "page").exists()


def test_no_folder_and_an_unwritable_place_are_errors(runs, tmp_path):
    with pytest.raises(InputError):
        write_report([], tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError):
        write_report([runs["clean"]], tmp_path / "file")


@given(st.fractions(0, 1))
def test_a_share_is_never_rounded_to_nothing_or_to_all(share):
    text = percent(float(share))
    assert (text == "0 %") == (float(share) == 0.0)
    assert (text in ("100 %", "100.0 %")) == (float(share) == 1.0)


@given(st.floats(1e-6, 1e12), st.booleans())
def test_axis_marks_start_at_zero_and_reach_the_top(top, whole):
    marks = ticks(top, whole=whole)
    assert marks[0] == 0.0
    assert marks[-1] >= top * (1 - 1e-9)
    assert 2 <= len(marks) <= 7
    assert all(low < high for low, high in itertools.pairwise(marks))
    assert not whole or all(mark == int(mark) for mark in marks)


def test_misses_are_told_by_kind_and_the_kinds_add_up(runs, pages):
    (page, _, _) = pages["violation"]
    table = page[page.index("<h2>Misses by kind") :]
    rows = re.findall(r"<tr><th scope=\"row\"><code>(.*?)</code></th>(.*?)</tr>", table)
    verdict = record(runs["violation"])["cullers"]
    assert {culler for culler, _ in rows} == {BROKEN, LOOSE}
    for culler, cells in rows:
        missed, *kinds, undecided = map(int, re.findall(r"<td>(\d+)</td>", cells))
        assert missed == sum(kinds) == verdict[culler]["missed"]
        assert kinds[0] == verdict[culler]["violations"]
        assert (kinds[0] > 0) == (culler == BROKEN)
        assert undecided == 0


def test_what_was_drawn_for_nothing_is_told_by_cause_as_recorded(runs, pages):
    shown = {
        (attrs["data-culler-name"], attrs["data-cause"]): text
        for attrs, text in Reader(pages["violation"][0]).find("td")
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
    assert "- tight: hidden, culler silent 100 %" in pages["violation"][2]


def test_a_run_folder_from_before_causes_and_rates_by_pixel_is_still_shown(runs, tmp_path):
    folder = shutil.copytree(runs["violation"], tmp_path / "run")
    for name, column in (("objects", "cause"), ("frames", "owned")):
        table = pq.read_table(folder / f"{name}.parquet")
        pq.write_table(table.drop_columns([column]), folder / f"{name}.parquet")
    page = write_report([folder], tmp_path / "page").read_text()
    assert "Drawn for nothing, and why" not in page
    cells = [text for attrs, text in Reader(page).find("td", data_measure="fnr_px")]
    assert set(cells) == {"–"}


def test_the_junit_case_says_how_to_replay_and_the_rates(runs, tmp_path):
    write_report([runs["violation"]], tmp_path / "a" / "b")
    suite = ET.parse(tmp_path / "a" / "b" / "junit.xml").getroot()
    (failure,) = suite.iter("failure")
    command = re.search(r"visref explain (\S+) --frame \d+ --object \d+", failure.text)
    assert (tmp_path / "a" / "b" / command[1]).resolve() == runs["violation"].resolve()
    (case,) = [case for case in suite.iter("testcase") if case.get("name") == "tight"]
    assert "FNR 0 %, FPR " in case.find("system-out").text


def bench_folder(folder):
    folder.mkdir()
    (folder / "bench.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    record = {
        "format": "visref-bench",
        "version": 1,
        "says": ["Stop at <b>", "Exact costs more."],
        "scene": {"source": "somewhere/city.glb"},
        "path": {"frames": [0, 5]},
        "machine": {"processor": "x", "cores": 2, "threads": 2},
    }
    (folder / "bench.json").write_text(json.dumps(record))
    return folder


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


def test_a_run_that_is_a_papers_walk_is_set_beside_it(runs, tmp_path, monkeypatch):
    """Only the rows and the trends that this run measures."""
    wanted = papers.Walk("squares", "folder/squares.glb", ("only",), size=(WIDTH, HEIGHT))

    def tables(records):
        run = records.run("squares")
        assert records.experiment("any") is None
        drawn = None if run is None else run.verdict["cullers"]["only"]["drawn"]
        rows = (Row("drawn | all", 30, drawn), Row("elsewhere", 7, None))
        return [
            Table("Drawn <units>", "Fig. 7", rows, (Trend("a", True), Trend("b", None))),
            Table("Empty", "Fig. 8", rows[1:]),
        ]

    for walk, shown in ((wanted, True), (replace(wanted, size=(9, 9)), False),
                        (replace(wanted, cullers=("only", "other")), False),
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
            assert "| drawn \\| all | 30 | 15 | 0.500 |" in markdown


def test_a_line_far_above_all_others_is_named_and_does_not_squash_them():
    few = Series("few", {0: 3.0, 1: 5.0}, 1)
    none = Series("none", {0: 40.0, 1: 40.0}, 0)
    assert on_scale([none, few]) == ([few], "Off the scale in every frame: none with 40.")
    near = Series("near", {0: 9.0, 1: 9.0}, 0)
    moving = Series("moving", {0: 40.0, 1: 41.0}, 0)
    for kept in ([near, few], [moving, few], [none]):
        assert on_scale(kept) == (kept, "")


def test_superfluous_units_are_listed_by_how_often(runs, pages):
    assert "hidden" in pages["violation"][0]
    assert {HIDDEN, ALSO_HIDDEN, OUTSIDE} == set(EVERYTHING) - set(VISIBLE)
    reader = Reader(pages["violation"][0])
    tables = [text for attrs, text in reader.find("table", **{"class": "plain"})]
    (tight,) = [text for text in tables if "4 of 5" in text]
    assert "hidden" in tight


@pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium on this machine")
def test_a_reader_can_click_through_the_page(runs, tmp_path):
    page_file = write_report([runs["violation"]], tmp_path)
    shown = "[...document.querySelectorAll('.frame')].filter(e => e.offsetParent)"
    with chromium.browser() as page:
        page.open(page_file)
        # It opens at the violation's worst pictured frame, one frame and one culler at a time.
        assert page.run(f"{shown}.length") == 1
        assert page.run("document.querySelector('[aria-pressed=true]').dataset.cullerName") == (
            BROKEN
        )
        first = page.run(f"{shown}[0].dataset.frame")
        assert page.run("document.querySelector('.own:not([hidden]) img').naturalWidth") == WIDTH
        before = page.run("document.querySelector('output').textContent")
        assert before.startswith(f"Frame {first} (")

        page.click('.step[data-step="1"]')
        assert page.run(f"{shown}[0].dataset.frame") != first
        page.click('.step[data-step="-1"]')
        assert page.run(f"{shown}[0].dataset.frame") == first

        page.run(
            "(() => { const s = document.querySelector('input[type=range]'); s.value = s.max;"
            "s.dispatchEvent(new Event('input')); })()"
        )
        assert page.run("document.querySelector('.step[data-step=\"1\"]').disabled") is True

        page.click('.tabs button[data-culler-name="tight"]')
        assert page.run(
            f"{shown}[0].querySelector('figure.own:not([hidden]) figcaption').textContent"
        ).startswith("tight:")

        # A loss's link leads to its frame and culler.
        page.click("[data-go-frame]")
        go = page.run("({...document.querySelector('[data-go-frame]').dataset})")
        assert page.run(f"{shown}[0].dataset.frame") == go["goFrame"]
        assert (
            page.run("document.querySelector('[aria-pressed=true]').dataset.cullerName")
            == (go["goCuller"])
        )

        page.click(".frame:not([hidden]) .zoom")
        assert page.run("document.querySelectorAll('figure.wide').length") == 1

        # The pointer reads out a plot.
        where = page.run(
            "(() => { const e = document.querySelector('.plot svg');"
            "e.scrollIntoView({block: 'center', behavior: 'instant'});"
            "const r = e.getBoundingClientRect(); return [r.x + r.width - 14, r.y + 60]; })()"
        )
        page.call("Input.dispatchMouseEvent", type="mouseMoved", x=where[0], y=where[1])
        assert page.run("document.querySelector('.readout:not([hidden])').textContent").startswith(
            "Frame 4"
        )
        assert page.problems == []
        assert {url for url in page.requests if not url.startswith("data:")} == {
            page_file.resolve().as_uri()
        }


@pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium on this machine")
def test_print_shows_every_frame_and_no_control(runs, tmp_path):
    page_file = write_report([runs["violation"]], tmp_path)
    seen = "[...document.querySelectorAll('{}')].filter(e => e.offsetParent).length"
    with chromium.browser() as page:
        page.open(page_file)
        frames = page.run("document.querySelectorAll('.frame').length")
        assert page.run(seen.format(".frame")) == 1 < frames
        page.call("Emulation.setEmulatedMedia", media="print")
        assert page.run(seen.format(".frame")) == frames
        assert page.run(seen.format(".controls, .copy")) == 0


@pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium on this machine")
def test_dark_and_light_pages_can_be_read(runs, tmp_path):
    """Every text stands out from its page at 4.5 to 1 (WCAG 2.2, 1.4.3), in either scheme."""
    page_file = write_report([runs["violation"], bench_folder(tmp_path / "bench")], tmp_path)
    colours = """[...document.querySelectorAll('main *')]
        .filter(e => e.offsetParent && !e.closest('button, .glyph, svg, figure')
            && [...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()))
        .map(e => getComputedStyle(e).color)"""
    with chromium.browser() as page:
        for scheme in ("light", "dark"):
            feature = {"name": "prefers-color-scheme", "value": scheme}
            page.call("Emulation.setEmulatedMedia", media="screen", features=[feature])
            page.open(page_file)
            paper = luminance(page.run("getComputedStyle(document.body).backgroundColor"))
            assert (paper > 0.5) == (scheme == "light")
            found = set(page.run(colours))
            assert len(found) > 2
            for colour in found:
                low, high = sorted((paper, luminance(colour)))
                assert (high + 0.05) / (low + 0.05) >= 4.5, (scheme, colour)


def luminance(colour):
    """Relative luminance (WCAG 2.2) of a colour as `rgb(r, g, b)`."""
    channels = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium on this machine")
def test_the_page_never_scrolls_sideways(runs, tmp_path):
    bench = bench_folder(tmp_path / "bench")
    page_file = write_report([runs["violation"], runs["clean"], bench], tmp_path)
    with chromium.browser() as page:
        for width in (360, 768, 1280):
            page.open(page_file, width=width)
            assert page.run("document.documentElement.scrollWidth") <= width
