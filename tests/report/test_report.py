"""The reports say what the record says, escape what is not theirs, and need nothing else."""

from __future__ import annotations

import itertools
import json
import re
import shutil
import statistics
import xml.etree.ElementTree as ET

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.page_reader import Reader
from tests.support.report_runs import (
    ALSO_HIDDEN,
    BROKEN,
    EVERYTHING,
    HEIGHT,
    HIDDEN,
    LOOSE,
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
    write_runs,
)
from visref.errors import InputError
from visref.report.junit import REST
from visref.report.plots import Series, on_scale, ticks
from visref.report.words import percent, quantity
from visref.report.writing import write_report

pytestmark = pytest.mark.slow

# Its control character as an escape.
NASTY_SHOWN = NASTY.replace("\x07", r"\x07")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return write_runs(tmp_path_factory.mktemp("runs"))


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


def record(folder):
    return json.loads((folder / "verdict.json").read_text())


@pytest.mark.parametrize(
    ("name", "headline"),
    [
        ("violation", "Violation"),
        ("clean", "No violation found"),
        ("loose", "No violation found"),
        ("measured", "Measured, not convicted"),
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
    assert title.lstrip("✕✓?~") == headline
    assert markdown.splitlines()[0].endswith(headline)


def test_status_follows_verdict_json_and_is_not_judged_again(runs, tmp_path):
    folder = shutil.copytree(runs["clean"], tmp_path / "run")
    verdict = record(folder)
    # Its frames, which a second judging would start from, still tell of no loss.
    verdict["cullers"]["only"] |= {"status": "violation", "violations": 1}
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
        its = [row for row in times if row["culler"] == culler]
        # What was compiled in the first call is in no median.
        (first,) = (row["frame"] for row in its if row["phase"] == "first_call")
        ms = [row["ms"] for row in its if row["phase"] == "cull" and row["frame"] != first]
        assert first == 0
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
    # So many objects in the scene, and missed in that frame.
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["scene"]["objects"] = len(copies)
    (folder / "manifest.json").write_text(json.dumps(manifest))
    table = pq.read_table(folder / "frames.parquet")
    frames = table.to_pylist()
    frames[many["frame"]] |= {"visible": len(copies), "missed": len(copies)}
    pq.write_table(pa.Table.from_pylist(frames, schema=table.schema), folder / "frames.parquet")
    page = write_report([folder], tmp_path / "page").read_text()
    shown = len(Reader(page).find("p", **{"class": "command"}))
    assert 0 < shown < 20
    assert f"… and {1000 - shown} more objects" in page
    assert f"… and {1000 - 5} more objects" in (tmp_path / "page" / "summary.md").read_text()


def test_names_cannot_break_out_of_the_page(pages):
    page, _, markdown = pages["violation"]
    reader = Reader(page)
    # One that runs; the others are data, in letters that end nothing.
    scripts = reader.find("script")
    assert [attrs.get("type") for attrs, _ in scripts].count(None) == 1
    assert all(re.fullmatch(r"[A-Za-z0-9+/=]*", text) for attrs, text in scripts if attrs)
    assert "<script>alert" not in page
    assert any(text == NASTY_SHOWN for _, text in reader.find("b"))
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


@pytest.mark.slow
def test_same_folders_give_the_same_bytes(runs, tmp_path):
    texts = []
    for name in ("a", "b"):
        write_report([runs["violation"], runs["clean"]], tmp_path / name)
        texts.append([file.read_bytes() for file in sorted((tmp_path / name).iterdir())])
    assert texts[0] == texts[1]
    assert len(texts[0]) == 3


@pytest.mark.slow
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
    page, junit, markdown = pages["measured"]
    for text in (page, markdown):
        assert "✓" not in text
        assert "It promises nothing" in text
    suite = ET.fromstring(junit).find("testsuite")
    assert (suite.get("skipped"), suite.get("failures"), suite.get("errors")) == ("1", "0", "0")
    (skipped,) = suite.iter("skipped")
    assert "3 were missed" not in skipped.get("message")
    assert "15 were missed" in skipped.get("message")


def test_junit_counts_violations_as_failures_and_doubt_as_errors(runs, pages):
    suite = ET.fromstring(pages["violation"][1]).find("testsuite")
    verdict = record(runs["violation"])
    statuses = {name: culler["status"] for name, culler in verdict["cullers"].items()}
    cases = {case.get("name"): case for case in suite.iter("testcase")}
    assert suite.get("tests") == str(len(list(suite.iter("testcase"))))
    for name, status in statuses.items():
        case = cases[name]
        assert case.get("classname") == "squares.glb"
        assert (case.find("failure") is not None) == (status == "violation")
        assert (case.find("error") is not None) == (status == "inconclusive")
        assert (case.find("skipped") is not None) == (status == "measured")
    # The culler that is convicted, and the object that convicts it.
    assert (suite.get("failures"), suite.get("errors")) == ("2", "1")
    lost = cases[f"{NASTY_SHOWN}, object {NASTY_ID}"]
    assert lost.get("classname") == f"squares.glb: {BROKEN}"
    assert NASTY_SHOWN in lost.find("failure").text
    assert "it fell over <here>" in "".join(suite.itertext())


def test_the_junit_cases_of_a_cullers_objects_add_up_to_the_scene(runs, pages):
    suite = ET.fromstring(pages["violation"][1]).find("testsuite")
    of = {}
    for case in suite.iter("testcase"):
        of.setdefault(case.get("classname"), []).append(case)
    # What breaks down, or promises nothing, has no object that passes.
    judged = (BROKEN, "tight", "none", "triangles")
    assert set(of) == {"squares.glb", *(f"squares.glb: {one}" for one in judged)}
    for culler, convicted in ((BROKEN, 1), ("tight", 0)):
        *guilty, rest = of[f"squares.glb: {culler}"]
        assert [case.find("failure") is not None for case in guilty] == [True] * convicted
        assert rest.get("name") == REST
        assert len(rest) == 1
        said = f"{6 - convicted} of the scene's 6 objects"
        assert said in rest.find("system-out").text


def test_markdown_table_survives_any_name(runs, pages):
    lines = pages["violation"][2].splitlines()
    cullers = record(runs["violation"])["cullers"]
    table = [line for line in lines if line.startswith("|")]
    verdicts, costs = table[: 2 + len(cullers)], table[2 + len(cullers) :]
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in verdicts} == {14}
    # A culler that breaks down has no costs.
    assert len(costs) == 2 + len(cullers) - 1
    assert len({len(re.findall(r"(?<!\\)\|", line)) for line in costs}) == 1
    assert len(lines) < 70


def test_frame_browser_holds_every_picture_of_the_manifest_once(runs, pages):
    manifest = json.loads((runs["violation"] / "manifest.json").read_text())
    files = {
        file
        for entry in manifest["pictures"]
        for what, file in entry["files"].items()
        # It is looked up, and not shown.
        if what != "owners"
    }
    images = [attrs for attrs, _ in Reader(pages["violation"][0]).find("img")]
    # Those around a witness are not of a frame, and wait until they come into view.
    assert sum("loading" not in attrs for attrs in images) == len(files)
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


@pytest.mark.slow
def test_of_many_pictured_frames_the_worst_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("visref.report.pictured.MAX_PICTURE_BYTES", 60_000)
    drawn = [VISIBLE] * 40
    drawn[5], drawn[13] = (WALL,), (WALL, PILLAR)
    folder = write_run(tmp_path / "run", [("c", Scripted(*drawn))], frames=40, pictures=range(40))
    page = write_report([folder], tmp_path / "page").read_text()
    shown = [int(attrs["data-frame"]) for attrs, _ in Reader(page).find("article")]
    assert shown == sorted(shown)
    assert {5, 13} <= set(shown)
    assert 2 < len(shown) < 40
    assert f"{40 - len(shown)} more pictured frames" in page
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
    (folder / "manifest.json").write_text(json.dumps(manifest | {"version": 3}))


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
        (newer_manifest, "version 1 to 2"),
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


@pytest.mark.slow
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
