"""The plain facts about a miss, worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from visref.camera import Camera
from visref.conformance.building import camera, pixel_panel
from visref.culler import Promise
from visref.judging.bounds import BoundsTooSmall
from visref.judging.causes import CausesFound, Named
from visref.judging.judge import Miss, MissKind
from visref.judging.outcome import CullerRecord
from visref.run_folder.cuts import Cut
from visref.run_folder.miss_facts import (
    box_too_small,
    causes_json,
    facts_text,
    greatest_square,
    miss_facts,
)
from visref.scene import Scene

FENCE, LOST, WALL = range(3)
# Orthographic, a pixel a unit, 14 by 8 about the origin: x is 7 less and a half more than a column.
VIEW = camera(width=14, height=8, ymag=4.0, near=0.5)


def scene() -> Scene:
    """The fence is at depth 5 and reaches to column 6; what is lost, at 8, is columns 8 to 11
    and rows 2 to 5, so from (1, -2) to (5, 2); the wall, at 20, is everywhere."""
    return Scene.from_objects(
        [
            ("fence", *pixel_panel(VIEW, (-1.0, 6.5), (-1.0, 9.0), 5.0)),
            ("lost", *pixel_panel(VIEW, (7.5, 11.5), (1.5, 5.5), 8.0)),
            ("wall", *pixel_panel(VIEW, (-1.0, 15.0), (-1.0, 9.0), 20.0)),
        ]
    )


def miss(x=9, y=3, **changes) -> Miss:
    values = {"samples": 9, "owned": 16, "triangle": 2 * LOST, "depth": 8.0, "age": 2}
    return Miss(LOST, MissKind.CONFIRMED, sample=y * 14 + x, **{**values, **changes})


def cut(rows: list[str], *, x=6, y=1, step=1, glass=False) -> Cut:
    """What is around: `f` fence, `w` wall, `.` nothing, `L` lost, `l` the same object, kept."""
    letters = np.array([list(row) for row in rows])
    kinds = {"f": 2 * FENCE, "w": 2 * WALL, ".": -1, "L": 2 * LOST, "l": 2 * LOST}
    owner = np.vectorize(kinds.get)(letters).astype(np.int32)
    lost = letters == "L"
    panes = np.full(owner.shape, -1, np.int32)
    if glass:
        panes[lost], owner[lost] = 2 * LOST, 2 * WALL
    return Cut(x, y, step, owner, panes, np.full_like(panes, -1), lost, lost)


AROUND = ["fwwwww", "ffLLLw", "ffLLLw", "ffLLLw", "wwllww", "wwwwww"]


def record(*too_small: int, kind: str = "object", **told) -> CullerRecord:
    found = [BoundsTooSmall(unit) for unit in too_small]
    return CullerRecord("one", Promise.CONSERVATIVE, kind, 3, too_small=found, **told)


def facts(around=None, of=None, record_=None, view: Camera = VIEW):
    return miss_facts(scene(), view, record_ or record(), of or miss(), around)


@pytest.mark.parametrize(
    ("x", "y", "away"), [(9, 3, 3), (9, 4, 3), (12, 4, 1), (13, 0, 0), (1, 4, 1), (5, 6, 1)]
)
def test_distance_to_the_image_s_nearest_edge_is_in_pixels(x, y, away):
    """Of 14 by 8 pixels, those of column 13 and of row 7 are the last."""
    assert facts(of=miss(x, y))["edge_px"] == away


def test_eye_s_distance_to_the_box_is_straight_beside_near():
    """The nearest point is (1, 0, -8)."""
    told = facts()
    assert told["eye_to_box"] == pytest.approx(np.sqrt(65.0), rel=1e-7)
    assert told["near"] == 0.5


def test_eye_within_the_box_is_at_no_distance():
    pose = VIEW.world_from_camera.copy()
    pose[:3, 3] = (3.0, 1.0, -8.0)
    assert facts(view=replace(VIEW, world_from_camera=pose))["eye_to_box"] == 0.0


@pytest.mark.parametrize("age", [0, 5, None])
def test_age_is_the_miss_s(age):
    assert facts(of=miss(age=age))["age"] == age


def test_box_too_small_is_told_of_the_object_whose_box_it_was():
    assert facts(record_=record(LOST))["box_too_small"] is True
    assert facts(record_=record(WALL))["box_too_small"] is False
    # Cluster 1 is not object 1.
    assert not box_too_small(record(LOST, kind="cluster"), LOST)


def test_what_is_around_is_not_known_without_it():
    told = facts()
    assert [told[name] for name in ("depth_min", "depth_max", "gap_px", "in_front")] == [None] * 4


def test_around_what_was_lost_its_depth_its_width_and_what_is_before_it():
    told = facts(cut(AROUND))
    assert (told["depth_min"], told["depth_max"]) == (8.0, 8.0)
    # Three by three are lost, and the two below are drawn.
    assert told["gap_px"] == 3
    assert told["in_front"] == {"object": FENCE, "name": "fence"}


def test_width_is_in_pixels_where_the_samples_around_lie_apart():
    assert facts(cut(AROUND[:4], x=2, y=0, step=2))["gap_px"] == 6


def test_what_is_behind_is_not_before_it():
    assert facts(cut([row.replace("f", "w") for row in AROUND]))["in_front"] is None


def test_what_lies_across_the_cut_does_not_border_it():
    """The fence is in the first column, what is lost in the last."""
    assert facts(cut(["fwwL", "fwwL", "fwwL"], x=6))["in_front"] is None


def test_glass_that_was_lost_is_told_by_its_own_depth():
    told = facts(cut(AROUND, glass=True))
    assert (told["depth_min"], told["depth_max"]) == (8.0, 8.0)
    assert told["in_front"] == {"object": FENCE, "name": "fence"}


def test_nothing_around_is_told_where_no_sample_of_it_was_lost():
    assert facts(cut([row.replace("L", "l") for row in AROUND]))["gap_px"] is None


@pytest.mark.parametrize("seed", range(4))
def test_greatest_square_is_that_of_all_tried(seed):
    flags = np.random.default_rng(seed).random((9, 12)) < 0.8
    squares = [
        side
        for side in range(1, 10)
        for y in range(9 - side + 1)
        for x in range(12 - side + 1)
        if flags[y : y + side, x : x + side].all()
    ]
    assert greatest_square(flags) == max(squares)
    assert greatest_square(np.zeros((3, 4), np.bool_)) == 0


# In words.


def test_facts_are_told_in_words():
    text = facts_text(facts(cut(AROUND), record_=record(LOST)))
    assert text == (
        "3 px from the image's edge; its box is 8.062 from the eye (near 0.5); the box that was "
        "tested does not hold it; 2 frames after it came into view; lost at depth 8; through a gap "
        "3 px wide; bordered by fence, in front of it"
    )


def test_what_is_not_known_is_not_told():
    text = facts_text(facts(of=miss(13, 0, age=None)))
    assert text == "at the image's edge; its box is 8.062 from the eye (near 0.5)"
    assert facts_text({}) == ""


def test_what_has_just_come_into_view_is_new():
    assert "; new in view" in facts_text(facts(of=miss(age=0)))


def test_name_with_control_characters_is_made_legible():
    told = {**facts(cut(AROUND)), "in_front": {"object": 0, "name": "a\x07b\n"}}
    assert "\x07" not in facts_text(told)
    assert "\n" not in facts_text(told)


# Causes.


def test_causes_of_a_miss_are_written_the_likeliest_first():
    named = {(4, "", LOST): (Named("centre-depth", 0.98765), Named("farthest-depth", 0.5))}
    told = record(causes=CausesFound(named, frozenset(named)))
    found = causes_json(told, 4, "", LOST)
    assert [one["cause"] for one in found] == ["centre-depth", "farthest-depth"]
    assert found[0] == {
        "cause": "centre-depth",
        "text": "the box's centre depth is compared in place of its nearest",
        "score": 0.988,
    }
    # An answer for all views is for each of them.
    assert causes_json(told, 4, "left", LOST) == found
    assert causes_json(told, 5, "", LOST) == []
