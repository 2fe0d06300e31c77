"""The paper's published numbers, what is measured beside them, and from which results."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.support.culling_scenes import box
from tests.support.run_values import run_folder
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.cli import main as cli
from visref.inputs import open_scene
from visref.papers import klosowski2001 as paper
from visref.papers import klosowski2001_views as views
from visref.papers import klosowski2001_ways as ways_of_asking
from visref.papers.contents import Basis, Grade, PrintedRange, printed_numbers
from visref.papers.klosowski2001_views import FRUSTUM, JUDGED, ONE_VIEW, PATH, TOWER
from visref.papers.klosowski2001_ways import EXT, HG, HP, HP_ALONE, IB, VF_BF, WAY_BUDGETS, spec
from visref.papers.printed import klosowski2001 as printed
from visref.papers.printed.klosowski2001 import TABLE_3
from visref.registry import make_culler
from visref.scene import Scene
from visref_culling.plp.octree import build
from visref_experiments import plp


def test_published_tables_go_one_way_with_the_budget_and_give_the_derived_numbers():
    rows = [TABLE_3[budget] for budget in sorted(TABLE_3)]
    for before, after in itertools.pairwise(rows):
        for column in ("tests", "extra", "hz"):
            assert getattr(after, column).amount < getattr(before, column).amount
        for column in ("plp_s", "average_s"):
            assert getattr(after, column).amount > getattr(before, column).amount
    for row in rows:
        # Three digits each.
        assert row.hz.amount == pytest.approx(1.0 / row.average_s.amount, rel=0.01)
    for whole, reading, building in printed.PREPROCESSING_S.values():
        assert whole.amount == reading.amount + building.amount
    before, after = (one.amount for one in printed.DEPTH_COMPLEXITY)
    assert round(before / after, 2) == 3.35
    seconds = {key: one.amount for key, one in printed.SECONDS.items()}
    for way, times in printed.FASTER_THAN_VF_BF.items():
        assert round(seconds["Octane", "VF-BF"] / seconds["Octane", way]) == times.amount


@pytest.mark.slow
@pytest.mark.gl
def test_judged_runs_name_cullers_that_exist_with_the_papers_leaves():
    for judged in paper.RUNS:
        for name in judged.cullers:
            made = make_culler(name)
            assert made.leaf == paper.LEAF_TRIANGLES
            made.close()


def test_back_faces_are_culled_in_the_papers_models():
    for work in (*paper.RUNS, *paper.EXPERIMENTS):
        if work.scene is not None:
            assert work.cull_backfaces == work.scene.startswith(("soda_hall", "skyscraper"))


EVERY_WAY = {culler: {} for culler in ways_of_asking.CULLERS}


def run_of(by_culler, source="soda_hall", triangles=1_087_452, ms=10.0, ms_of=None, count=2):
    """A run folder's content of so many frames of 100 by 50 samples, from counters by culler, and
    milliseconds a frame."""
    frames = {
        culler: [{"frame": k, **{n: v + k for n, v in counters.items()}} for k in range(count)]
        for culler, counters in by_culler.items()
    }
    timings = [
        {"culler": culler, "frame": k, "phase": "frame", "ms": (ms_of or {}).get(culler, ms)}
        for culler in by_culler
        for k in range(count)
    ]
    return run_folder(frames, timings, source=source, triangles=triangles, units=1_198)


def counters(rounds, drawn, estimated):
    return {"iterations": rounds, "triangles_drawn": drawn, "triangles_estimated": estimated - 1}


def falling(extra_at_most=400):
    """Results of Table 3, rounds and extra triangles falling to next to nothing."""
    budgets = sorted(TABLE_3)
    rounds = [6, 5, 4, 3, 2, 0]
    extra = [20_000, 9_000, 5_000, 3_000, 1_000, extra_at_most]
    found = {
        spec(EXT, budget): counters(r, budget + x, budget)
        for budget, r, x in zip(budgets, rounds, extra, strict=True)
    }
    return run_of(EVERY_WAY | found)


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
    assert {row.published for row in second.rows} == {None}
    assert {row.quantity for row in second.rows if row.ours is None} == {
        "budget 2,000: PLP time",
        "budget 2,000: PLP's part of it",
    }
    assert paper.tables_of_run(run_of({"cplp:budget=1000": {}}, source="city")) == []
    small = run_of({"cplp:budget=1000": counters(1, 2, 1)}, "soda_hall:scale=0.1", 80_000)
    (table,) = paper.tables_of_run(small)
    assert table.rows[0].note == "a scene of 80,000 triangles only"


def test_times_are_means_and_plp_has_its_part_of_them():
    budgets = sorted(TABLE_3)
    timed = {"budgets": budgets, "plp_ms": [[4.0, 8.0]] * 6, "cplp_ms": [[10.0, 14.0]] * 6}
    run = falling()
    rows = rows_of(paper.tables(Results({"soda-hall": run}, {"times": timed})))
    alone = rows["Table 3", "budget 25,000: PLP time"]
    assert (alone.theirs, alone.ours, alone.basis) == (0.043, 0.006, Basis.HARDWARE)
    assert rows["Table 3", "budget 25,000: average time"].ours == 0.010
    part = rows["Table 3", "budget 25,000: PLP's part of it"]
    assert (round(part.theirs, 2), part.ours) == (0.81, 0.5)
    octane = rows["Table 3", "PLP's part of it, cPLP-IB on the Octane"]
    assert (round(octane.theirs, 2), octane.ours) == (0.79, 0.5)


def test_preprocessing_is_reading_and_all_that_comes_after():
    steps = {"octree_ms": 1_000.0, "neighbours_ms": 500.0, "area_ms": 2_000.0, "count_ms": 100.0}
    found = {"leaf": 5_000, "cells": 9, "load_ms": 400.0} | steps
    rows = rows_of(paper.tables(Results({}, {"preparation": found})))
    for what, expected in {
        "in all": (128, 2.0),
        "reading the model": (64, 0.4),
        "octree, assignment, solidity": (64, 1.6),
    }.items():
        row = rows["section 4", f"{what}, Onyx"]
        assert (row.theirs, row.ours, row.unit) == (*expected, "s")
    assert rows["section 4", "octree, assignment, solidity from areas"].ours == 3.5


def times_of(**ms):
    """Tables and their rows, by the milliseconds of each way at all its budgets."""
    ms_of = {spec(way, b): t for way, t in ms.items() for b in WAY_BUDGETS.get(way, ())}
    ms_of |= {HP_ALONE: 30.0, VF_BF: ms["vf_bf"]}
    run = run_of({c: counters(1, 2, 1) for c in ways_of_asking.CULLERS}, ms_of=ms_of)
    tables = paper.tables(Results({"soda-hall": run}))
    return tables, rows_of(tables)


def test_ways_of_asking_are_compared_at_one_budget_and_at_their_best():
    ms = {EXT: 10.0, HP: 12.8, IB: 10.0, HG: 15.0, "vf_bf": 80.0}
    tables, rows = times_of(**ms)
    table = "Figs. 6 and 8, section 4"
    over = rows[table, "cPLP-HG over cPLP-IB on the Octane"]
    assert (round(over.theirs, 2), over.ours) == (2.02, 1.5)
    assert (rows[table, "cPLP-EXT at its best budget"].theirs,
            rows[table, "cPLP-EXT at its best budget"].ours) == (23, 100.0)  # fmt: skip
    assert rows[table, "cPLP-HP at its best budget"].theirs == 18
    best = rows[table, "cPLP-HP over cPLP-EXT, each at its best budget"]
    assert (best.theirs, best.ours) == (1.28, pytest.approx(1.28))
    assert grade_of(tables, "cPLP-EXT is 28 % faster") is Grade.HOLDS
    assert grade_of(tables, "cPLP-IB is considerably faster") is Grade.IN_DIRECTION
    assert grade_of(tables, "cPLP-HG is 6 times") is Grade.IN_DIRECTION
    assert grade_of(tables, "cPLP-HP is considerably faster") is Grade.IN_DIRECTION
    tables, _ = times_of(**{**ms, EXT: 13.0, HG: 9.0})
    assert grade_of(tables, "cPLP-EXT is 28 % faster") is Grade.FAILS
    assert grade_of(tables, "cPLP-IB is considerably faster") is Grade.FAILS
    tables, _ = times_of(**{**ms, HG: 16.0})
    assert grade_of(tables, "cPLP-IB is considerably faster") is Grade.HOLDS


def tower(tests, asked, frames=2, **settings):
    counted = {
        culler: {"depth_tests": tests[name], "query_fragments": asked[name]}
        for name, culler in TOWER.items()
        if name in tests
    }
    run = run_of(counted, source="skyscraper", count=frames)
    return replace(run, manifest=replace(run.manifest, settings=settings))


def test_depth_complexity_counts_the_queries_own_tests_in_one_view_and_along_the_path():
    tests = {FRUSTUM: 200_000, JUDGED: 50_000}
    asked = {FRUSTUM: 0, JUDGED: 10_000}
    view = tower(tests, asked, frames=1, cull_backfaces=True)
    path = tower({FRUSTUM: 200_000, JUDGED: 100_000}, {FRUSTUM: 0, JUDGED: 10_000})
    (table,) = (
        t
        for t in paper.tables(Results({"skyscraper-view": view, "skyscraper": path}))
        if t.title == "Z-tests a pixel"
    )
    rows = {row.quantity: row for row in table.rows}
    at = f"{ONE_VIEW}, {JUDGED}"
    assert rows[f"{ONE_VIEW}: VF-BF"].ours == pytest.approx(40.0, abs=1e-3)
    assert rows[f"{ONE_VIEW}: VF-BF"].note == ""
    assert "--cull-backfaces" in rows[f"{PATH}: VF-BF"].note
    assert rows[f"{at}: cPLP, drawing and queries"].ours == pytest.approx(10.0, abs=1e-3)
    assert rows[f"{at}: cPLP, drawing alone"].ours == pytest.approx(8.0, abs=1e-3)
    factor = rows[f"{at}: VF-BF over drawing alone"]
    assert (round(factor.theirs, 2), round(factor.ours, 2)) == (3.35, 5.0)
    assert round(rows[f"{at}: VF-BF over drawing and queries"].ours, 2) == 4.0
    # The claim is the view's; the path's is ours.
    (claim,), (own,) = table.claims, table.own
    assert claim.ours.value == pytest.approx(4.0, abs=1e-3)
    assert own.ours.value == pytest.approx(2.0, abs=1e-3)
    # One view is judged as it is, without other frames' interval.
    assert (claim.interval, own.interval is None) == (None, False)
    assert (claim.grade, own.grade) == (Grade.HOLDS, Grade.IN_DIRECTION)


@pytest.mark.parametrize(
    ("tests", "grade"),
    [(30_000, Grade.HOLDS), (150_000, Grade.IN_DIRECTION), (300_000, Grade.FAILS)],
)
def test_saving_of_z_tests_is_graded_with_the_queries_own(tests, grade):
    run = tower({FRUSTUM: 200_000, JUDGED: tests}, {FRUSTUM: 0, JUDGED: tests - 10_000})
    (table,) = paper.tables_of_run(run)
    assert [claim.grade for claim in (*table.claims, *table.own)] == [grade]


def test_plps_quality_joins_the_judged_misses_and_the_experiment():
    run = run_of({f"plp:budget={b}": {"missed_pixels": 99} for b in paper.CITY_BUDGETS}, "city")
    found = {"budgets": list(paper.CITY_BUDGETS), "found": [[0.2, 0.4], [0.6], [0.9, 0.94], [1.0]]}
    table = views.quality(run, found)
    rows = {row.quantity: row for row in table.rows}
    share = rows["budget 50,000: visible triangles found"]
    assert (share.theirs, share.ours) == (0.90, pytest.approx(0.92))
    worst = rows["budget 50,000: wrong pixels, at worst"]
    assert (worst.theirs, worst.ours) == (0.04, 0.02)
    assert rows["budget 10,000: wrong pixels, at worst"].published is None
    # The paper's PLP takes solidity from primitive counts: this one is ours.
    assert table.claims == ()
    assert [claim.grade for claim in table.own] == [Grade.HOLDS, Grade.HOLDS]


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
    found = {"budgets": [views.TENTH], "found": [shares]}
    assert views.quality(None, found).own[0].grade is grade


@pytest.mark.parametrize(
    ("lost", "grade"), [(199, Grade.OPEN), (200, Grade.FAILS), (99, Grade.HOLDS)]
)
def test_worst_frame_of_plp_is_judged_by_what_the_path_may_hold(lost, grade):
    """Two frames of 5,000 pixels: the second loses one more than the first, and 4 % are 200."""
    run = run_of({f"plp:budget={b}": {"missed_pixels": lost} for b in paper.CITY_BUDGETS}, "city")
    assert views.quality(run, None).own[1].grade is grade


def swept(**shares):
    return {
        "budget": 50_000,
        "sweep": {
            solidity: [
                {"leaf": leaf, "cells": 9, "found": [share] * 4, "wrong": [1.0 - share] * 4}
                for leaf, share in zip((5_000, 2_500, 1_250), of, strict=True)
            ]
            for solidity, of in shares.items()
        },
    }


def test_the_sweep_claims_the_papers_plp_at_its_leaves_and_ours_at_small_ones():
    table = views.sweep(swept(area=(0.85, 0.91, 0.93), count=(0.97, 0.7, 0.8)))
    assert [claim.grade for claim in table.claims] == [Grade.HOLDS, Grade.HOLDS]
    assert [claim.grade for claim in table.own] == [Grade.HOLDS]
    rows = {row.quantity: row for row in table.rows}
    found = "leaves under {}: visible triangles found"
    assert rows[f"solidity from primitive counts, {found.format('5,000')}"].theirs == 0.9
    small = rows[f"solidity from areas, {found.format('1,250')}"]
    assert (small.theirs, small.ours) == (None, pytest.approx(0.93))
    assert [curve.published for curve in table.figure.curves] == [False, False, True]
    table = views.sweep(swept(area=(0.95, 0.91, 0.89), count=(0.85, 0.99, 0.99)))
    assert [claim.grade for claim in table.claims] == [Grade.IN_DIRECTION, Grade.FAILS]
    assert [claim.grade for claim in table.own] == [Grade.IN_DIRECTION]


def front(cells, **ms):
    return {"leaf": 30, "cells": cells, "visible": 1, "fragments": 9, "ms": ms}


def test_the_cost_of_a_query_is_judged_where_most_cells_are_asked():
    ways = dict.fromkeys(ways_of_asking.ASKED, 10.0)
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
def test_the_sweep_tries_each_leaf_and_solidity_on_a_tenth_of_the_triangles(monkeypatch):
    monkeypatch.setattr(plp, "SWEEP_LEAVES", (1_000, 20))
    found = plp.leaves(boxes(50), small_path())
    assert found["budget"] == 60
    assert set(found["sweep"]) == {"area", "count"}
    for rows in found["sweep"].values():
        assert [row["leaf"] for row in rows] == [1_000, 20]
        # One cell holds all; small ones hold more than the budget together.
        assert rows[0]["cells"] == 1 < rows[1]["cells"]
        assert rows[0]["found"] == [1.0, 1.0]
        assert rows[0]["wrong"] == [0.0, 0.0]
        assert 0.0 < rows[1]["found"][0] < 1.0
        assert 0.0 < rows[1]["wrong"][0] < 1.0


@pytest.mark.gl
def test_the_whole_takes_at_least_a_frame_of_each_budget(monkeypatch):
    monkeypatch.setattr(plp, "TIME_BUDGETS", (10, 1_000))
    found = plp.times(boxes(50), small_path())
    assert found["budgets"] == [10, 1_000]
    for key in ("plp_ms", "cplp_ms"):
        assert np.shape(found[key]) == (2, 2)
        assert np.min(found[key]) > 0.0


@pytest.mark.gl
def test_preparation_is_timed_step_by_step_from_the_scenes_file():
    scene, _, _ = open_scene("soda_hall:scale=0.1,frames=1")
    found = plp.preparation(scene, small_path())
    assert (found["leaf"], found["cells"]) == (5_000, build(scene, 5_000).leaf_count)
    steps = [f"{step}_ms" for step in ("load", "octree", "neighbours", "area", "count")]
    assert all(found[step] > 0.0 for step in steps)


@pytest.mark.gl
def test_queries_ask_the_largest_front_in_every_way(monkeypatch):
    monkeypatch.setattr(plp, "LEAVES", (20,))
    monkeypatch.setattr(plp, "BUDGET", 30)
    monkeypatch.setattr(plp, "ROUNDS", 1)
    (found,) = plp.queries(boxes(60), small_path())["fronts"]
    assert found["leaf"] == 20
    assert found["cells"] >= found["visible"] > 0
    assert found["fragments"] > 0
    assert set(found["ms"]) == set(ways_of_asking.ASKED)
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
