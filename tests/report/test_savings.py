"""What cullers cost and save beside the baselines of their run, and a run's own tables."""

from __future__ import annotations

import csv
import io
import re

import pytest

from tests.support.run_values import run_folder
from visref.cli import main as cli
from visref.cli.run import counting_fragments
from visref.errors import InputError
from visref.registry import CULLERS, available, find_culler, make_culler
from visref.report import run_tables
from visref.report.run_tables import amount_text, grids, runs_csv, runs_latex, runs_markdown
from visref.report.savings import Amount, savings


def row(frame, **counters):
    return {"frame": frame, "units_drawn": 10, "triangles_drawn": 1000, **counters}


NONE = {"depth_tests": 4000, "query_fragments": 0, "query_fragments_passed": 0, "queries": 0}
FRUSTUM = NONE | {"depth_tests": 2000, "units_drawn": 5, "triangles_drawn": 400}
MAP = {
    "depth_tests": 1000,
    "query_fragments": 500,
    "query_fragments_passed": 200,
    "queries": 2,
    "tests_skipped": 1,
    "units_drawn": 2,
    "triangles_drawn": 100,
}


def run_of(**cullers):
    """Two frames of each culler, counters the same in both."""
    names = {name.replace("_", "-"): counters for name, counters in cullers.items()}
    return run_folder({name: [row(k, **made) for k in (0, 1)] for name, made in names.items()})


RUN = run_of(none=NONE, frustum=FRUSTUM, occupancy_map=MAP)


def test_costs_and_savings_are_shares_of_what_each_baseline_does():
    found = savings(RUN)
    assert found.baselines == {"none": "none", "frustum": "frustum"}
    assert found.frames == 2
    of = found.rows["occupancy-map"]
    expected = {
        "box_fragments": (500, 500 / 4000, 500 / 2000),
        "box_fragments_passed": (200, 200 / 4000, 200 / 2000),
        "depth_tests": (1000, 1000 / 4000, 1000 / 2000),
        "lookups": (None, None, None),
        "queries": (2, 2 / 10, 2 / 5),
        "queries_skipped": (1, 1 / 10, 1 / 5),
        "triangles_saved": (900, 900 / 1000, 300 / 400),
        "draws_saved": (8, 8 / 10, 3 / 5),
    }
    assert {
        key: (amount.value, amount.shares["none"], amount.shares["frustum"])
        for key, amount in of.items()
    } == expected
    assert "lookups" not in [quantity.key for quantity in found.quantities]
    assert found.rows["none"]["triangles_saved"].value == 0
    assert found.rows["frustum"]["triangles_saved"].shares == {"none": 0.6, "frustum": 0.0}


def test_baselines_with_options_are_baselines_and_one_that_was_not_run_has_no_share():
    alone = run_folder({
        "frustum:fragments=true": [row(0, **FRUSTUM)], "occupancy-map": [row(0, **MAP)]
    })  # fmt: skip
    found = savings(alone)
    assert found.baselines == {"frustum": "frustum:fragments=true"}
    saved = found.rows["occupancy-map"]["triangles_saved"]
    assert (saved.value, saved.shares) == (300, {"frustum": 0.75})
    nothing = savings(run_folder({"occupancy-map": [row(0, **MAP)]}))
    assert nothing.rows["occupancy-map"]["triangles_saved"].value is None
    assert nothing.rows["occupancy-map"]["depth_tests"].value == 1000


def test_means_are_over_all_frames_and_a_culler_that_broke_down_has_none():
    run = run_folder({
        "none": [row(0, depth_tests=100), row(1, depth_tests=300)],
        "n-buffer": [row(0, depth_tests=60), row(1, depth_tests=40)],
        "falls": [row(1, depth_tests=60)],
    })  # fmt: skip
    found = savings(run)
    assert found.frames == 2
    assert found.rows["n-buffer"]["depth_tests"].shares == {"none": 0.25}
    assert "falls" not in found.rows


def test_a_counter_that_misses_a_frame_is_not_measured():
    run = run_folder({"none": [row(0, depth_tests=100), row(1)]})
    assert savings(run).rows["none"]["depth_tests"].value is None


def test_nothing_counted_saves_nothing():
    assert savings(run_folder({"mine": [{"frame": 0}]})) is None


def test_a_cost_where_a_saving_should_be_has_its_sign():
    worse = savings(run_of(none=NONE, cplp=MAP | {"triangles_drawn": 1500}))
    assert amount_text(worse.rows["cplp"]["triangles_saved"]) == "−500 (−50.0 %)"
    assert amount_text(Amount(None, {"none": None})) == "–"
    assert amount_text(Amount(0.0, {"none": 0.0, "frustum": 0.0})) == "0"
    assert amount_text(Amount(0.0, {"none": 0.0, "frustum": -3.0})) == "0 (0 %, −300 %)"


def test_units_of_another_kind_are_not_held_against_objects():
    run = run_of(none=NONE, cplp=MAP)
    run.manifest.cullers["cplp"] = run.manifest.cullers["none"].__class__(
        "conservative", "cell", 1, "cplp"
    )
    found = savings(run)
    assert found.rows["cplp"]["draws_saved"].value is None
    assert found.rows["cplp"]["triangles_saved"].value == 900


# A run's own tables.


def test_every_form_has_the_same_numbers():
    errors, costs = grids(RUN)
    assert errors.rows[2][0] == costs.rows[2][0] == "occupancy-map"
    for text in (runs_markdown([RUN]), runs_latex([RUN]).replace("\\", "")):
        for cell in costs.rows[2]:
            assert cell in text
        for grid in (errors, costs):
            assert all(heading in text for heading in grid.headings)


def test_csv_has_numbers_in_full_and_no_line_for_what_was_not_measured():
    lines = list(csv.DictReader(io.StringIO(runs_csv([RUN]))))
    of_map = {one["quantity"]: one for one in lines if one["culler"] == "occupancy-map"}
    assert of_map["box_fragments"]["value"] == "500"
    assert (of_map["box_fragments"]["of_none"], of_map["box_fragments"]["of_frustum"]) == (
        "0.125", "0.25",
    )  # fmt: skip
    assert of_map["drawn"]["value"] == "0"
    assert "lookups" not in of_map
    assert of_map["depth_tests"]["promise"] == "approximate"


def test_latex_escapes_and_its_rows_have_as_many_cells_as_the_heading():
    text = runs_latex([run_folder({"none:a_b=1&2": [row(0, **NONE)]}, source="50%_city")])
    assert r"none:a\_b=1\&2" in text
    assert r"50\%\_city" in text
    for environment in re.findall(r"\\midrule\n(.*?)\\bottomrule", text, re.DOTALL):
        for line in environment.splitlines():
            assert line.endswith(r"\\")
    for heading, body in re.findall(r"\\toprule\n(.*?) \\\\\n\\midrule\n(.*?) \\\\", text):
        assert len(re.findall(r"(?<!\\)&", heading)) == len(re.findall(r"(?<!\\)&", body))


def test_the_same_runs_give_the_same_bytes():
    for form in (runs_markdown, runs_latex, runs_csv):
        assert form([RUN, RUN]) == form([RUN, RUN])
    with pytest.raises(InputError, match="no run folder"):
        run_tables.write_run_tables([], None)


# The switch.


def test_the_switch_counts_in_every_culler_that_can_and_leaves_what_is_said():
    assert counting_fragments("n-buffer") == "n-buffer:fragments=true"
    assert counting_fragments("n-buffer:where=gpu") == "n-buffer:where=gpu,fragments=true"
    for said in ("frustum:fragments=false", "somebody:Culler", "somebody:Culler:x=1"):
        assert counting_fragments(said) == said
    with pytest.raises(InputError):
        counting_fragments("no-such-culler")


@pytest.mark.gl
@pytest.mark.parametrize("name", sorted(available(CULLERS)))
def test_every_culler_on_board_that_draws_by_gl_has_the_switch(name):
    found, _ = find_culler(name)
    assert "fragments" in found.options
    make_culler(counting_fragments(name)).close()


@pytest.mark.slow
@pytest.mark.gl
def test_a_run_with_the_switch_shows_pixel_savings_of_every_method(tmp_path, capsys):
    names = ["none", "frustum", "occupancy-map", "n-buffer", "lazy-grid", "three-pass", "cplp"]
    run = ["run", "city:scale=0.02,frames=2", "--fragments", "--pictures", "0"]
    run += [part for name in names for part in ("--culler", name)]
    assert cli.main([*run, "--out", str(tmp_path / "run")]) == 0
    report = ["report", str(tmp_path / "run"), "--out", str(tmp_path / "page")]
    assert cli.main([*report, "--tables", str(tmp_path / "tables")]) == 0
    page = (tmp_path / "page" / "report.html").read_text()
    for name in names:
        assert f'data-culler-name="{name}:fragments=true" data-saving="depth_tests"' in page
    lines = list(csv.DictReader((tmp_path / "tables" / "tables.csv").read_text().splitlines()))
    counted = {one["culler"] for one in lines if one["quantity"] == "depth_tests"}
    assert counted == {f"{name}:fragments=true" for name in names}
    assert (tmp_path / "tables" / "tables.tex").read_text().count(r"\begin{table}") >= 2
    assert "Costs and savings" in (tmp_path / "page" / "summary.md").read_text()


def test_a_report_that_is_to_go_nowhere_is_refused(capsys):
    assert cli.main(["report", "run"]) == 2
    assert "--out, --tables or --board" in capsys.readouterr().err
