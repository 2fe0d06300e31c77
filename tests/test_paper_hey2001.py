"""The published numbers agree with one another, and ours stand beside the right ones."""

import pytest

from visref.papers.hey2001 import PIXEL_QUERIES, TRIANGLES_DRAWN, figures, specs, walks
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
        assert culler.update == update
        assert culler.leaf == (None if scene == "forest" else 1500)
        culler.close()


def record(culler, triangles, queries, frame_ms, query_ms):
    """Two frames of a culler; the first is to be left out."""
    frames = [
        {"culler": culler, "frame": 1, "triangles_drawn": triangles, "queries": queries},
        {"culler": culler, "frame": 0, "triangles_drawn": 10**9, "queries": 10**9},
    ]
    timings = [
        {"culler": culler, "frame": frame, "phase": phase, "ms": ms * (1 if frame else 100)}
        for frame in (0, 1)
        for phase, ms in (("frame", frame_ms), ("query", query_ms))
    ]
    return frames, timings


def test_figures_come_from_the_records_without_the_first_frame():
    parts = [
        record("lazy", 1000, 100, 20.0, 5.0),
        record("busy", 1000, 450, 40.0, 30.0),
        record("none", 50_000, 0, 60.0, 0.0),
    ]
    frames = [row for part in parts for row in part[0]]
    made = walks(frames, [row for part in parts for row in part[1]])
    lines = figures("forest", 640, made["lazy"], made["busy"], made["none"])
    here = {quantity: value for quantity, value, _ in lines}
    paper = {quantity: value for quantity, _, value in lines}
    assert here["Fig 7: lazy over none"] == "2.00 %"
    assert here["Fig 8: busy over lazy"] == "4.50"
    assert here["Fig 9: frame rate, lazy over none"] == "3.0"
    assert here["Section 7: queries' share of the time, lazy"] == "25.00 %"
    assert paper["Fig 7: triangles a frame, lazy"] == "7,009"
    assert paper["Fig 8: the same, busy"] == "2,394"
