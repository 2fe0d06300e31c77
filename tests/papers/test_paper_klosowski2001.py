"""The paper's published numbers, what is measured beside them, and from which results."""

import itertools

import numpy as np
import pytest

from tests.support.culling_scenes import box
from tests.support.run_values import run_folder
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.cli import main as cli
from visref.papers import klosowski2001 as paper
from visref.papers.contents import Basis, Grade, PrintedRange, printed_numbers
from visref.papers.klosowski2001 import EXT, TABLE_3, TOWER, spec
from visref.papers.printed import klosowski2001 as printed
from visref.registry import make_culler
from visref.scene import Scene
from visref_experiments import plp


def test_published_tables_fall_with_the_budget_and_give_the_derived_numbers():
    rows = [[one.amount for one in TABLE_3[budget]] for budget in sorted(TABLE_3)]
    for before, after in itertools.pairwise(rows):
        assert all(b < a for a, b in zip(before, after, strict=True))
    before, after = (one.amount for one in paper.DEPTH_COMPLEXITY)
    assert round(before / after, 2) == 3.35
    seconds = {key: printed.amount for key, printed in paper.SECONDS.items()}
    for way, times in paper.FASTER_THAN_VF_BF.items():
        assert round(seconds["Octane", "VF-BF"] / seconds["Octane", way]) == times.amount


@pytest.mark.slow
@pytest.mark.gl
def test_judged_runs_name_cullers_that_exist_with_the_papers_leaves():
    for judged in paper.RUNS:
        for name in judged.cullers:
            made = make_culler(name)
            assert made.leaf == paper.LEAF_TRIANGLES
            made.close()


def run_of(by_culler, source="soda_hall", triangles=1_087_452, ms=10.0):
    """A run folder's content of two frames of 100 by 50 samples, from counters by culler."""
    frames = {
        culler: [{"frame": k, **{n: v + k for n, v in counters.items()}} for k in (0, 1)]
        for culler, counters in by_culler.items()
    }
    timings = [
        {"culler": culler, "frame": k, "phase": "frame", "ms": ms}
        for culler in by_culler
        for k in (0, 1)
    ]
    return run_folder(frames, timings, source=source, triangles=triangles, units=1_198)


def counters(rounds, drawn, estimated):
    return {"iterations": rounds, "triangles_drawn": drawn, "triangles_estimated": estimated - 1}


def falling(extra_at_most=400):
    """Results of Table 3, rounds and extra triangles falling to next to nothing."""
    budgets = sorted(TABLE_3)
    rounds = [6, 5, 4, 3, 2, 0]
    extra = [20_000, 9_000, 5_000, 3_000, 1_000, extra_at_most]
    return run_of({
        spec(EXT, budget): counters(r, budget + x, budget)
        for budget, r, x in zip(budgets, rounds, extra, strict=True)
    })  # fmt: skip


class Results:
    def __init__(self, runs=None, experiments=None):
        self.runs, self.experiments = runs or {}, experiments or {}

    def run(self, key):
        return self.runs.get(key)

    def experiment(self, key):
        return self.experiments.get(key)


def rows_of(tables):
    return {(table.source, row.quantity): row for table in tables for row in table.rows}


def claims_of(tables):
    return {claim.statement: claim for table in tables for claim in table.claims}


def grade_of(tables, start):
    (claim,) = (c for statement, c in claims_of(tables).items() if statement.startswith(start))
    return claim.grade


def test_table_3_stands_beside_its_own_numbers_and_counts_what_the_estimate_left():
    tables = paper.tables(Results({"soda-hall": falling()}))
    rows = rows_of(tables)
    tests = rows["Table 3", "budget 1,000: tests"]
    assert (tests.theirs, tests.ours) == (4.688, 6.5)
    extra = rows["Table 3", "budget 25,000: extra triangles"]
    # The estimate's count is one less in both frames.
    assert (extra.theirs, extra.ours) == (5_641, 5_001)
    rate = rows["Table 3", "budget 100,000: frame rate"]
    assert (rate.theirs, rate.ours, rate.basis) == (8.6, 100.0, Basis.HARDWARE)
    assert rows["section 4", "leaves"].ours == 1_198
    assert rows["section 4", "frames of the path"].ours == 2


ROUNDS_FALL, EXTRA_FALL = "the rounds of tests fall", "the extra triangles fall"
ROUNDS_TO, EXTRA_TO, ROUNDS_AT = (
    "from a budget of 1,000 to one of 100,000 the rounds",
    "from a budget of 1,000 to one of 100,000 the extra",
    "at 100,000 a frame takes",
)


def test_table_3s_claims_have_their_grades():
    held = paper.tables(Results({"soda-hall": falling()}))
    for start in (ROUNDS_FALL, EXTRA_FALL, ROUNDS_TO, EXTRA_TO):
        assert grade_of(held, start) is Grade.HOLDS
    # 0 rounds in one frame and 1 in the other; 1.372 are published.
    assert grade_of(held, ROUNDS_AT) is Grade.HOLDS
    some = paper.tables(Results({"soda-hall": falling(extra_at_most=2_000)}))
    assert grade_of(some, EXTRA_TO) is Grade.IN_DIRECTION
    assert grade_of(some, EXTRA_FALL) is Grade.FAILS
    (claim,) = (c for s, c in claims_of(some).items() if s.startswith(EXTRA_TO))
    assert round(claim.published.amount, 3) == 0.074


def test_without_records_nothing_is_claimed():
    tables = paper.tables(Results())
    claims = [claim for table in tables for claim in (*table.claims, *table.own)]
    assert claims
    assert {claim.grade for claim in claims} == {Grade.UNMEASURED}


def test_every_published_number_has_a_row_or_a_claim_even_where_nothing_is_measured():
    tables = paper.tables(Results())
    assert all(row.ours is None for table in tables for row in table.rows)
    published = [row.published for table in tables for row in table.rows]
    published += [claim.published for table in tables for claim in table.claims]
    published += [setup.published for table in tables for setup in table.setup]
    shown = set(printed_numbers(published))
    wanted = [value for name, value in vars(printed).items() if name.isupper()]
    # The share drawn is where the order turns over.
    assert set(printed_numbers(wanted)) - shown == {printed.PLP_DRAWS}
    assert isinstance(printed.QUERY_US, PrintedRange)


def test_a_run_of_anybodys_fills_table_3_for_its_budgets_and_way():
    run = run_of(
        {
            "cplp:budget=1000": counters(5, 21_000, 1_000),
            "cplp:budget=2000,query=item-buffer": counters(4, 9_000, 2_000),
            "cplp:budget=1000,leaf=30": counters(9, 9, 9),
            "plp:budget=1000": counters(0, 1_000, 1_000),
            "none": {"triangles_drawn": 1_087_452},
        }
    )
    first, second = paper.tables_of_run(run)
    assert (first.title.split(", ")[1], second.title.split(", ")[1]) == ("cPLP-EXT", "cPLP-IB")
    assert {row.quantity: (row.theirs, row.ours) for row in first.rows[:2]} == {
        "budget 1,000: tests": (4.688, 5.5),
        "budget 1,000: extra triangles": (16_844, 20_001),
    }
    assert [row.published for row in second.rows] == [None] * 3
    assert paper.tables_of_run(run_of({"cplp:budget=1000": {}}, source="city")) == []
    small = run_of({"cplp:budget=1000": counters(1, 2, 1)}, "soda_hall:scale=0.1", 80_000)
    (table,) = paper.tables_of_run(small)
    assert table.rows[0].note == "a scene of 80,000 triangles only"


def test_depth_complexity_counts_the_queries_apart():
    tests = {"frustum": 200_000, "1,000": 50_000, "10,000": 60_000, "25,000": 90_000}
    asked = {"frustum": 0, "1,000": 10_000, "10,000": 5_000, "25,000": 5_000}
    tower = run_of(
        {
            culler: {"depth_tests": tests[name], "query_fragments": asked[name]}
            for name, culler in TOWER.items()
        },
        source="skyscraper",
    )
    (table,) = paper.tables_of_run(tower)
    rows = {row.quantity: row for row in table.rows}
    assert rows["VF-BF"].ours == pytest.approx(40.0, abs=1e-3)
    assert rows["budget 1,000: cPLP, drawing"].ours == pytest.approx(8.0, abs=1e-3)
    assert rows["budget 1,000: cPLP, its queries beside"].ours == pytest.approx(2.0, abs=1e-3)
    factor = rows["budget 1,000: VF-BF over cPLP's drawing"]
    assert (round(factor.theirs, 2), round(factor.ours, 2)) == (3.35, 5.0)
    assert round(rows["budget 1,000: VF-BF over drawing and queries"].ours, 2) == 4.0
    # At a budget of 25,000: 200,000 over 90,000 tests, not 3.35.
    assert [claim.grade for claim in table.claims] == [Grade.IN_DIRECTION]
    assert table.claims[0].ours.value == pytest.approx(200_000 / 90_000, abs=1e-4)


@pytest.mark.parametrize(
    ("tests", "grade"),
    [(30_000, Grade.HOLDS), (150_000, Grade.IN_DIRECTION), (300_000, Grade.FAILS)],
)
def test_saving_of_z_tests_is_graded_with_the_queries_own(tests, grade):
    counted = {
        TOWER["frustum"]: {"depth_tests": 200_000, "query_fragments": 0},
        TOWER["25,000"]: {"depth_tests": tests, "query_fragments": tests - 10_000},
    }
    (table,) = paper.tables_of_run(run_of(counted, "skyscraper"))
    assert [claim.grade for claim in table.claims] == [grade]


def test_plps_quality_joins_the_judged_misses_and_the_experiment():
    run = run_of({f"plp:budget={b}": {"missed_pixels": 99} for b in paper.CITY_BUDGETS}, "city")
    found = {"budgets": list(paper.CITY_BUDGETS), "found": [[0.2, 0.4], [0.6], [0.9, 0.94], [1.0]]}
    tables = paper.tables(Results({"city": run}, {"city-quality": found}))
    rows = rows_of(tables)
    share = rows["section 1", "budget 50,000: visible triangles found"]
    assert (share.theirs, share.ours) == (0.90, pytest.approx(0.92))
    worst = rows["section 1", "budget 50,000: wrong pixels, at worst"]
    assert (worst.theirs, worst.ours) == (0.04, 0.02)
    assert rows["section 1", "budget 10,000: wrong pixels, at worst"].published is None
    assert [claim.grade for claim in tables[-1].claims] == [Grade.HOLDS, Grade.HOLDS]


@pytest.mark.parametrize(
    ("shares", "grade"),
    [
        ([0.90, 0.90], Grade.HOLDS),
        ([0.89, 0.89], Grade.IN_DIRECTION),
        ([0.80, 0.99], Grade.OPEN),
        ([0.10, 0.10], Grade.FAILS),
    ],
)
def test_share_of_the_visible_that_plp_finds_is_graded(shares, grade):
    found = {"budgets": [paper.TENTH], "found": [shares]}
    claim = paper.tables(Results({}, {"city-quality": found}))[-1].claims[0]
    assert claim.grade is grade


@pytest.mark.parametrize(
    ("lost", "grade"), [(199, Grade.OPEN), (200, Grade.FAILS), (99, Grade.HOLDS)]
)
def test_worst_frame_of_plp_is_judged_by_what_the_path_may_hold(lost, grade):
    """Two frames of 5,000 pixels: the second loses one more than the first, and 4 % are 200."""
    run = run_of({f"plp:budget={b}": {"missed_pixels": lost} for b in paper.CITY_BUDGETS}, "city")
    assert paper.tables(Results({"city": run}))[-1].claims[1].grade is grade


def front(cells, **ms):
    return {"leaf": 30, "cells": cells, "visible": 1, "fragments": 9, "ms": ms}


def test_the_cost_of_a_query_is_judged_where_most_cells_are_asked():
    ways = dict.fromkeys(paper.ASKED, 10.0)
    few = front(10, **{**ways, "sync": 10.0})
    many = front(1_000, **{**ways, "sync": 250.0, "batch": 25.0})
    results = Results({}, {"soda-hall-queries": {"fronts": [few, many]}})
    (table,) = (t for t in paper.tables(results) if t.title == "Cost of a query")
    rows = {row.quantity: row for row in table.rows}
    at = "soda_hall, leaf 30, 1,000 cells"
    assert rows[f"{at}: -HP, one by one over -EXT"].ours == 25.0
    assert rows[f"{at}: -EXT"].ours == 10.0  # microseconds
    assert [claim.grade for claim in (*table.claims, *table.own)] == [Grade.HOLDS, Grade.HOLDS]
    even = front(1_000, **ways)
    (table,) = (
        t
        for t in paper.tables(Results({}, {"soda-hall-queries": {"fronts": [even]}}))
        if t.title == "Cost of a query"
    )
    assert [claim.grade for claim in (*table.claims, *table.own)] == [Grade.FAILS, Grade.FAILS]


# The experiments themselves, on next to nothing.


def small_path():
    pose = look_at((0.0, 0.0, 3.0), (0.0, 0.0, -5.0))
    return CameraPath((Camera(pose, 64, 48, near=0.1, far=50.0, yfov=1.0),) * 2)


def boxes(count):
    rng = np.random.default_rng(count)
    return Scene.from_objects(
        [(f"b{k}", *box(tuple(rng.uniform((-3, -2, -9), (3, 2, -1))), 0.3)) for k in range(count)]
    )


@pytest.mark.gl
def test_quality_is_the_share_of_visible_triangles_that_the_budget_draws(monkeypatch):
    monkeypatch.setattr(plp, "QUALITY_BUDGETS", (0, 10**6))
    assert plp.quality(boxes(20), small_path()) == {
        "budgets": [0, 10**6],
        "found": [[0.0, 0.0], [1.0, 1.0]],
    }


@pytest.mark.gl
def test_queries_ask_the_largest_front_in_every_way(monkeypatch):
    monkeypatch.setattr(plp, "LEAVES", (20,))
    monkeypatch.setattr(plp, "BUDGET", 30)
    monkeypatch.setattr(plp, "ROUNDS", 1)
    (found,) = plp.queries(boxes(60), small_path())["fronts"]
    assert found["leaf"] == 20
    assert found["cells"] >= found["visible"] > 0
    assert found["fragments"] > 0
    assert set(found["ms"]) == set(paper.ASKED)
    assert all(ms > 0.0 for ms in found["ms"].values())


@pytest.mark.gl
def test_primitives_time_every_side_and_channel(monkeypatch):
    monkeypatch.setattr(plp, "ROUNDS", 1)
    images = plp.primitives(None, None)["images"]
    assert [image["side_px"] for image in images] == [64, 512]
    for image in images:
        assert len(image["transfer_ms"]) == len(image["scan_ms"]) == len(image["channels"]) == 2
        assert image["histogram_ms"] > 0.0


@pytest.mark.slow
@pytest.mark.gl
def test_a_run_prints_table_3_beside_the_papers(tmp_path, capsys):
    spec = "soda_hall:scale=0.1,frames=2"
    run = ["run", spec, "--culler", "cplp:budget=1000", "--out", str(tmp_path / "run")]
    assert cli.main(run) == 0
    told = capsys.readouterr().out
    assert "(klosowski2001, Table 3)" in told
    assert "budget 1,000: tests" in told
    assert "16,844" in told
