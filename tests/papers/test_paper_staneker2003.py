"""The published numbers agree with one another, and ours stand beside the right ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.run_values import run_folder
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
    MULTIPLE,
    PIXELS_LEFT,
    RUNS,
    SINGLE,
    SPEED_UP,
)
from visref.registry import SCENES, available, make_culler
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
    assert len({walk.key for walk in RUNS}) == len(RUNS) == 7
    for walk in RUNS:
        assert walk.scene in available(SCENES)
        for spec in walk.cullers:
            make_culler(spec).close()
    assert {one.name for one in EXPERIMENTS} <= set(available(GROUP))


@pytest.mark.slow
@pytest.mark.gl
def test_experiments_measure_the_map_and_every_size():
    lookup = measured.lookup(None, None)
    assert (lookup["map_bytes"], lookup["lists"]) == (2_048, 5)
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


def small(share):
    """At 876 by 584: a map leaves `share` of 1,000 pixels."""
    return run_of(5, 100, {
        COUNTED_SINGLE: ({"query_fragments_passed": 1000}, {"frame": 50.0}),
        COUNTED_MAP: ({"query_fragments_passed": 1000 * share}, {"frame": 40.0}),
        COUNTED_BOXES: ({"query_fragments_passed": 900}, {"frame": 45.0}),
    })  # fmt: skip


def large(with_map=40.0, many=20.0, stalls=5):
    """At 1000 by 900: milliseconds of a frame, 50 without a map."""
    asked = {"queries": 60, "tests_skipped": 40, "batches": 60}
    return run_of(5, 100, {
        SINGLE: ({"queries": 100, "tests_skipped": None, "batches": 100},
                 {"frame": 50.0, "query": 30.0}),
        MAP: (asked, {"frame": with_map, "query": 20.0, "arrange": 1.5}),
        MULTIPLE: ({**asked, "batches": stalls}, {"frame": many}),
    })  # fmt: skip


LATENCY = {"sizes_px": [8, 1000], "culled_ms": [0.04, 1.0], "unculled_ms": [0.05, 2.0]}
LOOKUP = {"tiles": [1, 128], "lookup_ms": [4e-6, 2e-4], "map_bytes": 2_048, "lists": 5}
TRIANGLES = {"query_ms": 0.04, "triangle_ms": 0.0002}


class Results:
    def __init__(self, runs=None, **experiments):
        self.runs = runs or {}
        self.experiments = experiments

    def run(self, key):
        return self.runs.get(key)

    def experiment(self, key):
        return self.experiments.get(key.replace("-", "_"))


SCENE_NAMES = ("angio", "boombox", "formula_one")
ALL = Results(
    {f"{name}-876": small(share) for name, share in zip(SCENE_NAMES, (0.1, 0.3, 0.5), strict=True)}
    | {f"{name}-1000": large(with_map=45.0) for name in ("boombox", "formula_one", "city_cars")}
    | {"angio-1000": large()},
    latency=LATENCY,
    lookup=LOOKUP,
    query_in_triangles=TRIANGLES,
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
    assert rows["Table 2", "BoomBox: with over without"].ours == 0.3
    assert rows["Table 2", "BoomBox: with OM"].theirs == 1_365_960
    assert rows["Table 1", "Angio: with over without"].ours == 1.25
    assert rows["Table 4", "City: multiple"].ours == 50.0
    assert rows["Table 4", "City: multiple"].theirs == 30.7
    assert rows["Table 5", "Angio: single with OM over single"].ours == 1.25
    assert rows["Table 5", "Angio: multiple over single with OM"].ours == 2.0
    assert rows["Table 5", "Angio: multiple over single"].ours == 2.5
    fig_1, section_3 = "section 2 and Fig. 1", "sections 2 and 3"
    assert rows[fig_1, "a query in triangles of 25 pixels"].ours == pytest.approx(200.0)
    assert rows[fig_1, "largest box: back faces drawn over culled"].ours == 2.0
    assert rows[section_3, "a map, bytes"].ratio == 1.0
    assert rows[section_3, "quickest query over dearest lookup"].ours == pytest.approx(200.0)
    assert rows[section_3, "City: shapes in view that need no query"].ours == 0.4
    assert rows["Fig. 11", "polygons drawn, single"].ours == 0.1


def test_every_claim_has_the_grade_of_records_made_like_the_papers():
    found = {statement: claim.grade for statement, claim in claims_of(ALL).items()}
    short = {
        # 50 % here.
        "FormulaOne: a map leaves 45 % of the pixels": Grade.IN_DIRECTION,
    }
    assert len(found) == 17
    assert {statement: grade for statement, grade in found.items() if grade is not Grade.HOLDS} == (
        short
    )


@pytest.mark.parametrize(
    ("change", "claim", "grade"),
    [
        ({"boombox-876": small(0.6)}, "the map saves most on Angio", Grade.FAILS),
        ({"boombox-876": small(0.6)}, "BoomBox: a map leaves", Grade.IN_DIRECTION),
        ({"boombox-876": small(1.1)}, "BoomBox: a map leaves", Grade.FAILS),
        ({"city_cars-1000": large(with_map=51.0)}, "City: single with OM over", Grade.FAILS),
        ({"city_cars-1000": large(with_map=49.0)}, "City: single with OM over", Grade.IN_DIRECTION),
        ({"city_cars-1000": large(with_map=30.0)}, "Angio gains most from the map", Grade.FAILS),
        ({"boombox-1000": large(many=41.0)}, "BoomBox: multiple over", Grade.FAILS),
        ({"boombox-1000": large(many=39.0)}, "BoomBox: multiple over", Grade.IN_DIRECTION),
        ({"angio-1000": large(stalls=60)}, "multiple queries wait less often", Grade.FAILS),
        (
            {"latency": LATENCY | {"culled_ms": [0.04, 1.5]}},
            "back-face culling",
            Grade.IN_DIRECTION,
        ),
        ({"latency": LATENCY | {"culled_ms": [0.04, 2.5]}}, "back-face culling", Grade.FAILS),
        ({"latency": LATENCY | {"unculled_ms": [2.0, 2.0]}}, "a query's latency", Grade.FAILS),
        ({"lookup": LOOKUP | {"lookup_ms": [4e-6, 4e-3]}}, "a lookup costs orders", Grade.FAILS),
    ],
)
def test_claims_that_the_records_contradict_are_called_so(change, claim, grade):
    experiments = {**ALL.experiments, **{k: v for k, v in change.items() if "-" not in k}}
    runs = ALL.runs | {key: value for key, value in change.items() if "-" in key}
    assert grade_of(Results(runs, **experiments), claim) is grade


def test_speed_up_is_of_all_frames_time():
    """One culler slow in one frame, another in another: neither is faster."""
    run = large()
    timings = [
        replace(row, ms=80.0 if row.frame else 10.0) if row.phase == "frame" else row
        for row in run.timings
    ]
    run = replace(run, timings=timings)
    results = Results({"angio-1000": run})
    assert rows_of(results)["Table 5", "Angio: multiple over single"].ours == 1.0


def test_what_was_not_measured_has_no_number_and_no_verdict():
    assert all(row.ours is None for row in rows_of(Results()).values())
    assert {claim.grade for claim in claims_of(Results()).values()} == {Grade.UNMEASURED}
