"""The published numbers agree with one another, and ours stand beside the right ones."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.run_values import run_folder
from visref.generators import find_generator
from visref.papers import staneker2003
from visref.papers.contents import Grade
from visref.papers.staneker2003 import (
    BOX_PIXELS,
    COUNTED_BOXES,
    COUNTED_MAP,
    COUNTED_SINGLE,
    EXPERIMENTS,
    FRAME_RATE,
    MAP,
    MODELS,
    PIXELS_LEFT,
    RUNS,
    SPEED_UP,
)
from visref.papers.staneker2003_options import (
    BACK_FACES,
    CORNERS_FIRST,
    INSTANCED,
    MULTIPLE,
    SCENE_SCALED,
    SMALL_LEFT_OUT,
)
from visref.registry import available, make_culler
from visref.scene import Scene
from visref.tables.plan import EXPERIMENTS as GROUP
from visref_experiments import occupancy_map as measured


def amounts(printed):
    return {model: tuple(one.amount for one in row) for model, row in printed.items()}


def test_published_numbers_follow_from_one_another():
    shares = {model: round(b / a, 2) for model, (a, b) in amounts(BOX_PIXELS).items()}
    assert shares == {model: share for model, (share,) in amounts(PIXELS_LEFT).items()}
    rates = amounts(FRAME_RATE)
    for model, (single, one, many) in rates.items():
        gains = (round(one / single - 1.0, 2), round(many / one - 1.0, 2))
        assert gains == amounts(SPEED_UP)[model]
    gains = sorted(many / single - 1.0 for single, _, many in rates.values())
    assert (round(100 * gains[0]), round(100 * gains[-1])) == (35, 78)


def test_average_polygons_are_as_printed_where_the_tables_own_numbers_make_others():
    averages = {model: row[2] for model, row in amounts(MODELS).items()}
    assert list(averages.values()) == [2_370, 1_215, 2_441, 2_134]
    made = [polygons // shapes for shapes, polygons, _ in amounts(MODELS).values()]
    assert made == [2_370, 1_215, 2_440, 2_136]


@pytest.mark.gl
def test_set_ups_are_scenes_and_cullers_of_ours():
    assert len({walk.key for walk in RUNS}) == len(RUNS) == 9
    for walk in RUNS:
        assert find_generator(walk.scene) is not None
        for spec in walk.cullers:
            make_culler(spec).close()
    assert len({one.key for one in EXPERIMENTS}) == len(EXPERIMENTS)
    assert {one.name for one in EXPERIMENTS} <= set(available(GROUP))


@pytest.mark.slow
@pytest.mark.gl
def test_experiments_measure_the_map_and_every_size():
    lookup = measured.lookup(None, None)
    assert lookup["map_bytes"] == 2_048
    assert len(lookup["tiles"]) == len(lookup["lookup_ms"])
    latency = measured.latency(None, None)
    for key in ("culled_ms", "unculled_ms"):
        assert len(latency[key]) == len(latency["sizes_px"])
        assert min(latency[key]) > 0.0
    assert set(latency["each_ms"]) == {"sync", "batch", "instanced"}


@pytest.mark.gl
def test_triangles_compared_with_a_query_cover_their_25_pixels_each(monkeypatch):
    scenes = []

    class Kept(measured.NoCulling):
        def prepare(self, scene: Scene):
            scenes.append(scene)
            return super().prepare(scene)

    monkeypatch.setattr(measured, "NoCulling", Kept)
    monkeypatch.setattr(measured, "TRIANGLES", 20)
    assert measured.query_in_triangles(None, None)["query_ms"] > 0.0
    one, many = scenes
    assert (one.triangle_count, many.triangle_count) == (1, 20)
    a, b, c = many.vertices[many.triangles].transpose(1, 0, 2)
    assert np.cross(b - a, c - a)[:, 2] / 2.0 == pytest.approx(measured.TRIANGLE_PX, rel=1e-4)


def run_of(shapes, triangles, cullers):
    """A run folder's content: for each culler two frames, with counters and milliseconds."""
    frames, timings = {}, []
    for spec, (counters, ms) in cullers.items():
        frames[spec] = [{"frame": k, "triangles_drawn": 10, **counters} for k in (0, 1)]
        for k in (0, 1):
            for phase, value in ms.items():
                timings.append({"culler": spec, "frame": k, "phase": phase, "ms": value})
    return run_folder(frames, timings, objects=shapes, triangles=triangles)


def passed(pixels, **more):
    return {"query_fragments_passed": pixels, **more}, {}


def counted(share, parts=0.05):
    """At 876 by 584: of 1,000 pixels a map leaves `share` with whole boxes marked."""
    return {
        COUNTED_SINGLE: passed(1000),
        COUNTED_MAP: passed(1000 * parts, queries=60, queries_passed=40, query_fragments=500),
        COUNTED_BOXES: passed(1000 * share),
    }


def fitted(share=0.9, corner_pixels=400):
    return run_of(5, 100, counted(share) | {
        CORNERS_FIRST: passed(50, queries=90, query_fragments=corner_pixels),
        SCENE_SCALED: passed(25),
        BACK_FACES: passed(1900),
        SMALL_LEFT_OUT: ({"triangles_drawn": 8, "visible": 20, "missed": 1}, {}),
    })  # fmt: skip


def unfitted(share):
    return run_of(5, 100, counted(share))


def judged():
    times = {MAP: 50.0, MULTIPLE: 30.0, INSTANCED: 12.0}
    return run_of(5, 100, {spec: ({}, {"frame": ms}) for spec, ms in times.items()})


def method(ms, **more):
    """Two frames of one method, as the experiments tell of them."""
    numbers = {"frame_ms": ms, "processor_ms": 1.5 * ms, "query_ms": ms / 2, "draw_ms": ms / 4,
               "arrange_ms": 0.5, "queries": 60, "tests_skipped": 40, "batches": 60,
               "triangles_drawn": 10, **more}  # fmt: skip
    return {name: [number, number] for name, number in numbers.items()}


def turns(with_map=45.0, many=20.0, stalls=5, thread=16.0):
    """Milliseconds of a frame, 50 without a map."""
    return {
        "rounds": 4,
        "triangles_in_view": [40, 40],
        "methods": {
            "single": method(50.0, queries=100, tests_skipped=0, batches=100),
            "map": method(with_map),
            "multiple": method(many, batches=stalls),
            "thread": method(thread, batches=stalls),
        },
    }


LATENCY = {"sizes_px": [8, 1000], "culled_ms": [0.04, 1.0], "unculled_ms": [0.05, 2.0],
           "lookup_ms": [2e-4, 4e-4], "bits_ms": [1e-5, 2e-4],
           "each_ms": {"sync": 0.04, "batch": 0.02, "instanced": 0.01}}  # fmt: skip
LOOKUP = {"tiles": [1, 128], "lookup_ms": [4e-6, 2e-4], "map_bytes": 2_048}
TRIANGLES = {"query_ms": 0.04, "triangle_ms": 0.0002}
DETAIL = {"reductions": [1, 4], "pixels_a_triangle": [8], "triangles": 80.0,
          "triangles_left": [20.0], "samples_changed": [0.01]}  # fmt: skip


class Results:
    def __init__(self, runs=None, **experiments):
        self.runs = runs or {}
        self.experiments = experiments

    def run(self, key):
        return self.runs.get(key)

    def experiment(self, key):
        return self.experiments.get(key.replace("-", "_"))


ALL = Results(
    {
        "angio-876": fitted(share=0.1),
        "boombox-876": fitted(),
        "formula_one-876": fitted(),
        "boombox-876-unfitted": unfitted(0.3),
        "formula_one-876-unfitted": unfitted(0.5),
    }
    | {f"{name}-1000": judged() for name in ("angio", "boombox", "formula_one", "city_cars")},
    **{f"{name}_turns": turns() for name in ("boombox", "formula_one", "city_cars")},
    **{f"{name}_pair": turns() for name in ("boombox", "formula_one")},
    angio_turns=turns(with_map=40.0),
    angio_pair=turns(with_map=40.0),
    latency=LATENCY,
    lookup=LOOKUP,
    query_in_triangles=TRIANGLES,
    detail=DETAIL,
)


def rows_of(results):
    tables = staneker2003.tables(results)
    return {(table.source, row.quantity): row for table in tables for row in table.rows}


def claims_of(results):
    return {c.statement: c for table in staneker2003.tables(results) for c in table.claims}


def grade_of(results, start):
    (claim,) = (c for statement, c in claims_of(results).items() if statement.startswith(start))
    return claim.grade


def test_rows_come_from_the_records_and_stand_beside_their_own_numbers():
    rows = rows_of(ALL)
    assert rows["Table 3", "Angio: shapes"].ours == 5
    whole, parts = "with OM, marked by whole boxes", "with OM, marked by parts"
    fitted_to = ", the layout fitted to this table"
    for words, ours in (
        (f"BoomBox: {whole}, over without", 0.3),
        (f"BoomBox: {parts}, over without", 0.05),
        (f"BoomBox{fitted_to}: {whole}, over without", 0.9),
        (f"BoomBox{fitted_to}: {parts}", 50),
        (f"Angio: {whole}, over without", 0.1),
    ):
        assert rows["Table 2", words].ours == ours
    assert ("Table 2", f"Angio{fitted_to}: {whole}") not in rows
    assert rows["Table 2", f"BoomBox: {whole}"].theirs == 1_365_960
    assert rows["Table 1", "Angio: with over without"].ours == 1.25
    assert rows["Table 1", "BoomBox: with OM"].ours == pytest.approx(1e3 / 45.0)
    assert rows["Table 4", "City: multiple"].ours == 50.0
    assert rows["Table 4", "City: multiple"].theirs == 30.7
    assert rows["Table 5", "Angio: single with OM over single"].ours == 1.25
    assert rows["Table 5", "Angio: multiple over single with OM"].ours == 2.0
    assert rows["Table 5", "Angio: multiple over single, by processor time"].ours == 2.5
    fig_1, section_3 = "section 2 and Fig. 1", "sections 2 and 3"
    assert rows[fig_1, "a query in triangles of 25 pixels"].ours == pytest.approx(200.0)
    assert rows[fig_1, "largest box: back faces drawn over culled"].ours == 2.0
    assert rows[fig_1, "a query of 8 × 8 pixels, in a batch"].ours == 0.02
    assert rows[section_3, "a map, bytes"].ratio == 1.0
    same_box = "a query over a lookup of the same box"
    assert rows[section_3, f"{same_box}: the least of the sizes"].ours == pytest.approx(200.0)
    assert rows[section_3, f"{same_box}: the greatest"].ours == pytest.approx(2500.0)
    bits = "a query over its bits alone: the greatest"
    assert rows[section_3, bits].ours == pytest.approx(5000.0)
    assert rows[section_3, "City: shapes in view that need no query"].ours == 0.4
    assert rows["Fig. 11", "visible, of those inside the view frustum"].ours == 0.25


def test_options_and_what_section_6_proposes_come_from_their_own_records():
    rows = rows_of(ALL)
    options = {words: row.ours for (source, words), row in rows.items() if "others" in source}
    of_angio = [ours for words, ours in options.items() if words.startswith("Angio")]
    # Of 60 boxes asked 30 need no second question: of 40 visible ones.
    assert of_angio == [0.75, 1.5, 0.8, 0.5, 1.9, 0.8, 0.05, 2.5]
    section = {words: row.ours for (source, words), row in rows.items() if source == "section 6.1"}
    assert section["City: frame rate, in a second thread over in one"] == 1.25
    assert section["City: arranging, of a frame's time, in one thread"] == 0.5 / 20.0
    assert section["FormulaOne: polygons of the shapes drawn"] == 80.0
    a_polygon = "FormulaOne: a polygon for each 8 pixels of a shape's rectangle"
    assert section[f"{a_polygon}: polygons left"] == 0.25
    assert section[f"{a_polygon}: samples that change owner"] == 0.01


def test_figures_show_visible_and_occluded_polygons_and_the_rates_of_all_three():
    figures = {
        (table.source, table.title): table.figure
        for table in staneker2003.tables(ALL)
        if table.source.startswith("Fig. ")
    }
    assert len(figures) == 8
    polygons = figures["Fig. 8", "Angio: polygons along the path"]
    assert {curve.label: curve.y for curve in polygons.curves} == {
        "visible": (0.01, 0.01),
        "occluded": (0.03, 0.03),
    }
    rates = figures["Fig. 8", "Angio: frame rates along the path"]
    assert {curve.label: curve.y for curve in rates.curves} == {
        "single": (20.0, 20.0),
        "single with OM": (25.0, 25.0),
        "multiple": (50.0, 50.0),
    }


def test_every_claim_has_the_grade_of_records_made_like_the_papers():
    found = {statement: claim.grade for statement, claim in claims_of(ALL).items()}
    short = {
        # 50 % here.
        "FormulaOne: a map leaves 45 % of the pixels": Grade.IN_DIRECTION,
    }
    assert len(found) == 20
    assert {statement: grade for statement, grade in found.items() if grade is not Grade.HOLDS} == (
        short
    )


@pytest.mark.parametrize(
    ("change", "claim", "grade"),
    [
        ({"boombox-876-unfitted": unfitted(0.6)}, "the map saves most on Angio", Grade.FAILS),
        ({"boombox-876-unfitted": unfitted(0.6)}, "BoomBox: a map leaves", Grade.IN_DIRECTION),
        ({"boombox-876-unfitted": unfitted(1.1)}, "BoomBox: a map leaves", Grade.FAILS),
        # The fitted layout bears on no claim.
        ({"boombox-876": fitted(share=1.1)}, "BoomBox: a map leaves", Grade.HOLDS),
        ({"boombox_pair": turns(with_map=51.0)}, "BoomBox at 876", Grade.FAILS),
        ({"boombox_pair": turns(with_map=49.0)}, "BoomBox at 876", Grade.IN_DIRECTION),
        ({"city_cars_turns": turns(with_map=51.0)}, "City: single with OM over", Grade.FAILS),
        (
            {"city_cars_turns": turns(with_map=49.0)},
            "City: single with OM over",
            Grade.IN_DIRECTION,
        ),
        ({"city_cars_turns": turns(with_map=30.0)}, "Angio gains most from the map", Grade.FAILS),
        ({"boombox_turns": turns(many=46.0)}, "BoomBox: multiple over", Grade.FAILS),
        ({"boombox_turns": turns(many=44.0)}, "BoomBox: multiple over", Grade.IN_DIRECTION),
        ({"angio_turns": turns(stalls=60)}, "multiple queries wait less often", Grade.FAILS),
        (
            {"latency": LATENCY | {"culled_ms": [0.04, 1.5]}},
            "back-face culling",
            Grade.IN_DIRECTION,
        ),
        ({"latency": LATENCY | {"culled_ms": [0.04, 2.5]}}, "back-face culling", Grade.FAILS),
        ({"latency": LATENCY | {"unculled_ms": [2.0, 2.0]}}, "a query's latency", Grade.FAILS),
        ({"latency": LATENCY | {"lookup_ms": [2e-4, 2e-2]}}, "a lookup costs orders", Grade.FAILS),
    ],
)
def test_claims_that_the_records_contradict_are_called_so(change, claim, grade):
    experiments = {**ALL.experiments, **{k: v for k, v in change.items() if "-" not in k}}
    runs = ALL.runs | {key: value for key, value in change.items() if "-" in key}
    assert grade_of(Results(runs, **experiments), claim) is grade


@pytest.mark.parametrize(
    ("change", "start", "grade"),
    [
        ({}, "corners first lessen", Grade.HOLDS),
        ({"boombox-876": fitted(corner_pixels=501)}, "corners first lessen", Grade.FAILS),
        ({}, "a second thread", Grade.HOLDS),
        ({"boombox_turns": turns(thread=20.5)}, "a second thread", Grade.FAILS),
    ],
)
def test_claims_of_our_own_are_judged_by_their_records(change, start, grade):
    experiments = {**ALL.experiments, **{k: v for k, v in change.items() if "-" not in k}}
    runs = ALL.runs | {key: value for key, value in change.items() if "-" in key}
    found = staneker2003.tables(Results(runs, **experiments))
    (own,) = (c for table in found for c in table.own if c.statement.startswith(start))
    assert own.grade is grade


def test_speed_up_is_of_all_frames_time():
    """One method slow in one frame, another in another: neither is faster."""
    found = turns()
    found["methods"]["single"]["frame_ms"] = [80.0, 10.0]
    found["methods"]["multiple"]["frame_ms"] = [10.0, 80.0]
    rows = rows_of(Results(angio_turns=found))
    assert rows["Table 5", "Angio: multiple over single"].ours == 1.0


def test_what_was_not_measured_has_no_number_and_no_verdict():
    assert all(row.ours is None for row in rows_of(Results()).values())
    assert {claim.grade for claim in claims_of(Results()).values()} == {Grade.UNMEASURED}
