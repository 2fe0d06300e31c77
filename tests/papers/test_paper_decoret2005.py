"""Décoret's tables come from the results, and the first frame of a stretch is left out."""

from __future__ import annotations

import pytest

from tests.support.run_values import run_folder
from visref.papers import decoret2005 as paper
from visref.papers.contents import Grade
from visref.registry import make_culler


def run_of(counts, **ms):
    """A run folder's content: three frames in a row and a lonely one, the first of each cold."""
    frames, timings = {}, []
    for name, spec in paper.CULLERS.items():
        timings += [
            {"culler": spec, "frame": frame, "phase": "frame", "ms": ms.get(name, 10.0)}
            for frame in (4, 5, 6, 9)
        ]
        counter = "query_fragments" if "query" in spec else "lookups"
        frames[spec] = [
            {"frame": frame, counter: 10**9 if frame in (4, 9) else counts[name]}
            for frame in (4, 5, 6, 9)
        ]
    return run_folder(frames, timings)


class Results:
    def __init__(self, run=None, motion=None, **experiments):
        self.folders, self.experiments = {"table-2": run, "motion": motion}, experiments

    def run(self, key):
        return self.folders[key]

    def experiment(self, key):
        return self.experiments.get(key)


SIZES = [[256, 256], [512, 512], [640, 480], [1024, 1024]]
LEVELS = {"sizes": SIZES, "levels": [1, 2, 3, 4], "gpu_ms": [5.0] * 4, "cpu_ms": [6.0] * 4}
COUNTS = dict(zip(paper.CULLERS, (900_000, 300_000, 500, 1_000, 1_000, 250), strict=True))


def table(results, source):
    return next(t for t in paper.tables(results) if t.source == source)


def test_published_ratios_are_those_the_text_names():
    tests = {name: printed.amount for name, printed in paper.DEPTH_TESTS.items()}
    assert tests["occlusion queries"] / tests["N-buffer"] == 400
    assert round(tests["occlusion queries, hierarchy"] / tests["N-buffer, hierarchy"]) == 3143


def test_depth_tests_leave_out_frames_that_remember_nothing():
    made = table(Results(run_of(COUNTS)), "Table 2")
    rows = {row.quantity: row for row in made.rows}
    assert rows["depth tests a frame, occlusion queries"].ours == 300_000
    assert rows["depth tests a frame, N-buffer, hierarchy"].ours == 500
    assert rows["depth tests a frame, N-buffer, hierarchy"].theirs == 350
    quotient = rows["depth tests, occlusion queries over N-buffer"]
    assert (quotient.theirs, quotient.ours) == (400, 300)
    assert [claim.grade for claim in made.claims] == [
        Grade.IN_DIRECTION,  # 300, not 400
        Grade.IN_DIRECTION,  # 1,800, not 3,143
        Grade.IN_DIRECTION,  # 3, not 5.5
        Grade.HOLDS,  # 2, more than 1.43
    ]
    assert made.claims[0].interval == (300, 300)


@pytest.mark.parametrize(
    ("place", "counts", "grade"),
    [
        (0, {"occlusion queries": 400_000}, Grade.HOLDS),
        (0, {"occlusion queries": 399_000}, Grade.IN_DIRECTION),
        (0, {"occlusion queries": 1_000}, Grade.FAILS),
        (1, {"N-buffer, hierarchy": 286}, Grade.HOLDS),
        (1, {"N-buffer, hierarchy": 10**6}, Grade.FAILS),
        (2, {"occlusion queries, hierarchy": 1_650_000}, Grade.HOLDS),
        (2, {"occlusion queries, hierarchy": 299_999}, Grade.FAILS),
        (3, {"N-buffer, hierarchy": 800}, Grade.IN_DIRECTION),
        (3, {"N-buffer, hierarchy": 1_001}, Grade.FAILS),
    ],
)
def test_each_claim_has_its_grades(place, counts, grade):
    made = table(Results(run_of(COUNTS | counts)), "Table 2")
    assert made.claims[place].grade is grade


@pytest.mark.parametrize(("ms", "grade"), [(10.1, Grade.HOLDS), (9.9, Grade.FAILS)])
def test_queries_are_faster_where_n_buffers_take_longer(ms, grade):
    made = table(Results(run_of(COUNTS, **{"N-buffer": ms})), "section 4.2")
    assert {row.quantity: row.ours for row in made.rows}["a frame, N-buffer"] == ms
    assert [claim.grade for claim in made.claims] == [grade]


def moving(**changed):
    row = {"visible": 40, "confirmed": 0, "drawn": 50, "superfluous": 10}
    frames = {spec: [{"frame": frame, **row} for frame in (4, 5)] for spec in paper.MOVING.values()}
    frames["n-buffer"][0] |= changed
    return run_folder(frames)


def test_a_scene_in_motion_is_measured_by_misses_and_waste():
    made = table(Results(motion=moving()), "not in the paper")
    rows = {row.quantity: row for row in made.rows}
    assert rows["N-buffer: visible objects missed"].ours == 0.0
    assert rows["N-buffer on the GPU: drawn for nothing"].ours == 10 / 50
    assert [claim.grade for claim in made.own] == [Grade.HOLDS]
    made = table(Results(motion=moving(confirmed=1)), "not in the paper")
    assert [claim.grade for claim in made.own] == [Grade.FAILS]


def test_levels_stand_beside_their_own_resolution():
    rows = {r.quantity: r for r in table(Results(levels=LEVELS), "Table 1").rows}
    assert (rows["640 × 480: levels"].theirs, rows["640 × 480: levels"].ours) == (10, 3)
    assert rows["256 × 256: all levels, GPU"].ratio is None
    assert rows["1024 × 1024: a level, GPU"].ours == 5.0 / 4
    assert rows["1024 × 1024: a level, GPU"].theirs == 3.1


def test_cost_of_the_levels_stands_beside_the_tests_they_save():
    rows = {r.quantity: r for r in table(Results(levels=LEVELS), "Table 2").rows}
    assert rows["pixels of the levels built, a frame"].ours == 512 * 512 * 2
    assert rows["depth tests a frame, N-buffer"].ours is None
    assert table(Results(), "section 4.2").claims[0].grade is Grade.UNMEASURED


@pytest.mark.gl
def test_set_ups_are_cullers_of_ours():
    for spec in paper.CULLERS.values():
        make_culler(spec).close()
