"""The published numbers agree with one another, and ours stand beside the right ones."""

from __future__ import annotations

import pytest

from tests.support.run_values import run_folder
from visref.papers import hey2001
from visref.papers.hey2001 import PIXEL_QUERIES, STAND_IN_NOTE, TRIANGLES_DRAWN, specs
from visref.registry import make_culler


def test_published_ratios_are_those_that_follow_from_the_published_numbers():
    ratios = [round(busy / lazy, 2) for lazy, busy in PIXEL_QUERIES.values()]
    assert ratios == [4.81, 10.43, 2.36, 4.51]
    shares = [round(100 * drawn / none, 2) for drawn, none in TRIANGLES_DRAWN.values()]
    assert shares == [4.74, 5.08, 0.61, 0.60]


@pytest.mark.gl
@pytest.mark.parametrize("scene", ["forest", "city_large"])
def test_set_ups_are_cullers_of_ours(scene):
    for update, spec in specs(scene).items():
        culler = make_culler(spec)
        assert culler.updates == update
        assert culler.leaf == (None if scene == "forest" else 1500)
        culler.close()


def run_of(scene, triangles, by_update):
    """A run folder's content: for each update two frames' triangles and queries, and times."""
    frames, timings = {}, []
    for update, (drawn, queries, frame_ms, query_ms) in by_update.items():
        spec = specs(scene)[update]
        frames[spec] = [
            {
                "frame": k,
                "triangles_drawn": drawn + k,
                "queries": queries,
                "drawn": 10,
                "superfluous": 1,
            }
            for k in (0, 1)
        ]
        for k in (0, 1):
            for phase, ms in (("frame", frame_ms), ("query", query_ms)):
                timings.append({"culler": spec, "frame": k, "phase": phase, "ms": ms})
    return run_folder(frames, timings, triangles=triangles)


class Results:
    def __init__(self, **runs):
        self.runs = {key.replace("_", "-"): run for key, run in runs.items()}

    def run(self, key):
        return self.runs.get(key.replace("_", "-"))


FOREST = {
    "lazy": (1000, 100, 20.0, 5.0),
    "busy": (1000, 450, 70.0, 30.0),
    "none": (50_000, 0, 60.0, 0.0),
}


def rows_of(results):
    tables = hey2001.tables(results)
    return {(table.source, row.quantity): row for table in tables for row in table.rows}


def test_figures_come_from_the_records_and_stand_beside_their_own_numbers():
    rows = rows_of(Results(forest_640=run_of("forest", 1_694_426, FOREST)))
    name = "Forest, 640 × 480"
    assert rows["section 7", "Forest: triangles"].ratio == 1.0
    assert rows["Fig. 7", f"{name}: lazy"].ours == 1000.5
    assert rows["Fig. 7", f"{name}: lazy"].published == 7_009
    assert rows["Fig. 8", f"{name}: busy over lazy"].ours == 4.5
    assert rows["Fig. 8", f"{name}: busy"].published == 2_394
    times = "Fig. 9 and section 7"
    assert rows[times, f"{name}: frame rate, lazy over none"].ours == 3.0
    assert rows[times, f"{name}: queries' share of the time, lazy"].ours == 0.25
    assert rows["Fig. 8", "Forest, 1280 × 960: busy"].ours is None


def test_the_whole_city_goes_before_the_tenth_that_stands_in_for_it():
    tenth = run_of("city_large", 3_403_418, FOREST)
    rows = rows_of(Results(city_large_tenth_640=tenth))
    assert rows["section 7", "City: triangles"].ours == 3_403_418
    assert rows["section 7", "City: triangles"].note == STAND_IN_NOTE
    whole = run_of("city_large", 34_034_176, FOREST)
    rows = rows_of(Results(city_large_tenth_640=tenth, city_large_640=whole))
    assert rows["section 7", "City: triangles"].ours == 34_034_176
    assert not rows["section 7", "City: triangles"].note


def trends_of(results):
    return {t.claim: t.holds for table in hey2001.tables(results) for t in table.trends}


def test_trends_hold_fail_or_are_not_measured():
    more = FOREST | {"busy": (1000, 900, 70.0, 30.0)}
    low, high = run_of("forest", 10, FOREST), run_of("forest", 10, more)
    claim = "forest: lazy beats busy, and by more at the higher resolution"
    assert trends_of(Results(forest_640=low, forest_1280=high))[claim] is True
    assert trends_of(Results(forest_640=high, forest_1280=low))[claim] is False
    assert trends_of(Results(forest_640=low))[claim] is None
    saving = "forest: lazy draws no more than 5.1 % of what none draws"
    assert trends_of(Results(forest_640=low))[saving] is True
    much = run_of("forest", 10, FOREST | {"none": (15_000, 0, 60.0, 0.0)})
    (told,) = (t for table in hey2001.tables(Results(forest_640=much)) for t in table.trends
               if t.claim == saving)  # fmt: skip
    assert told.holds is False
    assert "it is 6.7 %, and of the boxes drawn 90 % own a sample" in told.why
    other = FOREST | {"busy": (1001, 450, 70.0, 30.0), "lazy": (1000, 100, 80.0, 5.0)}
    found = trends_of(Results(forest_640=run_of("forest", 10, other)))
    assert found["lazy draws as much as busy, in every frame"] is False
    assert found["the lazy grid is faster than no occlusion culling"] is False
