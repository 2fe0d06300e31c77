"""Causes with a number in them, and those that hang on all answers together."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tests.causes.small import Stage, at, plain, sheet, wide
from visref.camera_path import Frame
from visref.causes.evidence import Answer, Answers
from visref.causes.fitted import FITS, ODDS, odds, threshold, widths
from visref.causes.lists import LISTS
from visref.causes.sights import At, Moments, Sights
from visref.conformance.building import box, case, panel, pixel_panel
from visref.conformance.moving import posed
from visref.culler import Promise
from visref.engines.exact import ExactEngine
from visref.judging.outcome import CullerRecord
from visref.recordings.spool import Spool
from visref.scene import Group
from visref.timeline import Timeline

# The values that thresholds are put on.


def lengthwise():
    """A beam from depth 4 to 12, a floor from behind the eye to 12, and a sheet at 20."""
    objects = [
        ("beam", box((0.5, 0.5, -12.0), (1.0, 1.0, -4.0))),
        ("floor", box((-2.0, -2.0, -12.0), (2.0, -1.5, 3.0))),
        ("sheet", panel((-2.0, 2.0), (3.0, 6.0), -20.0)),
    ]
    return Stage(case(objects, [wide()]))


def besides():
    """Boxes whose nearest points lie 4, (3, 4) and (3, 4, 12) from the eye, and one about it."""
    objects = [
        ("ahead", box((-1.0, -1.0, -6.0), (1.0, 1.0, -4.0))),
        ("aside", box((3.0, -1.0, -9.0), (5.0, 1.0, -4.0))),
        ("corner", box((3.0, 4.0, -14.0), (5.0, 6.0, -12.0))),
        ("about", box((-1.0, -1.0, -2.0), (1.0, 1.0, 2.0))),
    ]
    return Stage(case(objects, [wide()]))


def covered():
    """'shown' is 6 by 4 pixels, nothing before it; 'gap' shows in 2 by 5 of its 7 by 5; 'cross'
    in 3 by 1 and 1 by 3 about one sample: 5, and in no square of 2. No diagonal meets a sample."""
    view = plain()
    wall = sheet(
        view,
        (10, 31),
        (0, 23),
        10.0,
        but=[((15, 16), (3, 7)), ((22, 24), (5, 5)), ((23, 23), (4, 6))],
    )
    return Stage(
        case(
            [
                ("wall", wall),
                ("shown", pixel_panel(view, (1.8, 7.2), (2.8, 6.2), 20.0)),
                ("gap", pixel_panel(view, (12.7, 19.4), (2.8, 7.2), 20.0)),
                ("cross", pixel_panel(view, (20.8, 25.3), (2.8, 7.2), 20.0)),
            ],
            [view],
        )
    )


def values(build, cause, variant):
    (fit,) = [one for one in FITS if (one.cause, one.variant) == (cause, variant)]
    asked = at(build)
    return dict(zip(asked.scene.names, fit.value(asked).tolist(), strict=True))


def test_near_is_put_on_the_farthest_depth_of_a_box_and_far_on_its_nearest():
    near = values(lengthwise, "near-larger", "fitted")
    far = values(lengthwise, "far-nearer", "fitted")
    assert near == {"beam": 12.0, "floor": 12.0, "sheet": 20.0}
    assert far == {"beam": 4.0, "floor": -3.0, "sheet": 20.0}


def test_far_by_distance_is_put_on_the_nearest_point_of_a_box():
    beside = values(besides, "far-nearer", "fitted by distance")
    # The eye is at the origin, and inside the last.
    assert beside == {"ahead": 4.0, "aside": 5.0, "corner": 13.0, "about": 0.0}


def test_samples_are_those_that_show_or_that_the_rectangle_has_free():
    owned = values(covered, "too-few-samples", "owned")
    passing = values(covered, "too-few-samples", "passing")
    assert (owned["shown"], owned["gap"], owned["cross"]) == (24.0, 10.0, 5.0)
    # Rounded outward by a pixel each way 8 by 6, of which nothing is hidden; else what shows.
    assert (passing["shown"], passing["gap"], passing["cross"]) == (48.0, 10.0, 5.0)


def test_size_is_the_greater_side_of_the_rectangle():
    sizes = values(covered, "too-few-samples", "size")
    assert sizes["shown"] == pytest.approx(5.4, abs=1e-5)
    assert sizes["gap"] == pytest.approx(6.7, abs=1e-5)
    assert values(lengthwise, "too-few-samples", "size")["floor"] == np.inf


def test_sizes_of_what_lies_in_the_image_and_of_what_stands_in_space():
    # "shown" from 1.8 to 7.2 and 2.8 to 6.2: outward samples 1 to 8 and 2 to 7.
    assert values(covered, "too-few-samples", "size in the image")["shown"] == 7.0
    assert values(covered, "too-few-samples", "area")["shown"] == pytest.approx(5.4 * 3.4, 1e-5)
    assert values(covered, "too-few-samples", "height")["shown"] == pytest.approx(3.4, abs=1e-5)
    radius = values(besides, "too-few-samples", "radius")
    assert radius["ahead"] == pytest.approx(np.sqrt(3.0))
    by_distance = values(besides, "too-few-samples", "radius by distance")
    assert by_distance["ahead"] == pytest.approx(np.sqrt(3.0) / 5.0)
    by_depth = values(besides, "too-few-samples", "radius by depth")
    assert by_depth["aside"] == pytest.approx(np.sqrt(1 + 1 + 2.5**2) / 6.5)
    assert by_depth["about"] == np.inf


def test_distances_to_the_middle():
    assert values(besides, "far-nearer", "by the middle's depth")["aside"] == 6.5
    assert values(besides, "far-nearer", "by the middle's distance")["ahead"] == 5.0
    ground = values(besides, "far-nearer", "along the ground")
    # (4, 5, 13) without its height.
    assert ground["corner"] == pytest.approx(np.hypot(4.0, 13.0))
    assert values(besides, "near-larger", "by the middle's depth")["corner"] == 13.0


def test_how_large_the_view_has_to_be_that_a_box_is_in_it():
    """The view reaches as far aside as ahead. What crosses the axis is in any."""
    both, across, up = (
        values(besides, "other-lens", how) for how in ("across and up", "across", "up")
    )
    assert both["ahead"] == 0.0
    # From (3, ., 4) to (5, ., 9) the farthest inward is 3 at depth 9; it crosses the axis upwards.
    assert across["aside"] == pytest.approx(3.0 / 9.0)
    assert up["aside"] == 0.0
    assert both["corner"] == pytest.approx(4.0 / 14.0)
    assert across["corner"] == pytest.approx(3.0 / 14.0)
    assert both["about"] == 0.0


def test_margin_is_how_far_behind_its_front_something_shows():
    """At depth 20, with nothing behind but the background."""
    margins = values(covered, "own-depth", "by a margin")
    assert margins["shown"] == np.inf
    assert margins["wall"] == np.inf


def coming():
    view = plain()
    objects = [(n, sheet(view, (x, x + 4), (3, 9), 9.0)) for n, x in (("new", 2), ("old", 10))]
    gone = [("new",), (), ()]
    return Stage(posed(objects, [Frame((view,), absent=one) for one in gone]), 2)


def test_for_how_long_it_has_been_there():
    assert values(coming, "appeared-unknown", "at first") == {"new": 1.0, "old": np.inf}


def test_gap_is_the_side_of_the_greatest_square_up_to_8():
    gaps = values(covered, "gap-too-narrow", "")
    assert (gaps["shown"], gaps["gap"], gaps["cross"]) == (4.0, 2.0, 1.0)
    assert gaps["wall"] == 8.0


@pytest.mark.parametrize("seed", range(4))
def test_gap_is_that_of_every_square_tried(seed):
    rng = np.random.default_rng(seed)
    owner = rng.choice([-1, 0, 1], (14, 17), p=[0.1, 0.7, 0.2]).astype(np.int32)

    class Seen:
        @staticmethod
        def layers(**told):
            return Seen

    Seen.owner = owner
    wanted = np.zeros(2)
    for unit in (0, 1):
        for side in range(1, 9):
            for y in range(14 - side + 1):
                for x in range(17 - side + 1):
                    if (owner[y : y + side, x : x + side] == unit).all():
                        wanted[unit] = side
    assert widths(Seen, 2).tolist() == wanted.tolist()


# Thresholds and chance.


@pytest.mark.parametrize(
    ("right", "wrong", "lost", "shown"), [(2, 0, 3, 6), (2, 1, 3, 7), (1, 2, 4, 8)]
)
def test_odds_are_those_of_all_choices(right, wrong, lost, shown):
    every = list(combinations(range(shown), right + wrong))
    hits = sum(sum(i < lost for i in one) >= right for one in every)
    assert odds(right, wrong, lost, shown) == pytest.approx(len(every) / hits)


def test_threshold_lies_between_what_is_lost_and_what_is_not():
    at_value = np.arange(40.0)
    lost = at_value < 12
    assert threshold(at_value, lost, ~lost, below=True) == 11.5
    assert threshold(-at_value, lost, ~lost, below=False) == -11.5


def test_threshold_bears_with_some_on_the_wrong_side_of_it():
    at_value = np.arange(60.0)
    lost = at_value < 20
    lost[[7, 40]] = [False, True]
    assert threshold(at_value, lost, ~lost, below=True) == 19.5


def test_no_threshold_where_few_would_fit_by_chance():
    """One of 40 is at an end in one of 40 orders."""
    at_value = np.arange(40.0)
    lost = at_value < 1
    assert odds(1, 0, 1, 40) < ODDS
    assert threshold(at_value, lost, ~lost, below=True) is None


@pytest.mark.parametrize("seed", range(20))
def test_no_threshold_on_what_is_lost_at_random(seed):
    rng = np.random.default_rng(seed)
    lost = rng.random(200) < 0.2
    assert threshold(rng.random(200), lost, ~lost, below=True) is None


# All answers together.


def record(**told):
    return CullerRecord("one", Promise.CONSERVATIVE, "object", 0, **told)


def listed(drawn, count, *, missed=(), built=None):
    """At, and the answers of a culler that drew so, a list of ids by frame."""
    made = built or case(
        [(f"o{i}", panel((i - 9.0, i - 8.5), (0.0, 5.0), -5.0)) for i in range(count)],
        [plain()] * len(drawn),
    )
    every = []
    for frame, ids in enumerate(drawn):
        lost = np.array(missed[frame] if missed else (), np.int32)
        every.append(Answer.of(frame, "", np.array(list(ids), np.int32), lost, Spool()))
    units = made.scene.object_units()
    answers = Answers(units, every)
    asked = at_of(made, answers)
    return asked, answers


def at_of(made, answers):
    timeline = Timeline(made.scene, made.path)
    moments = Moments(timeline, made.path, made.path.numbers, lambda: ExactEngine(timeline.still))
    ids = np.arange(answers.units.count, dtype=np.int32)
    return At(Sights(moments, answers), 0, "", ids, np.zeros(len(ids), np.bool_))


def dropped(asked, answers, cause, **told):
    kept = LISTS(answers, record(**told))[cause][""](asked)
    return None if kept is None else np.flatnonzero(~kept).tolist()


def test_what_no_answer_holds_is_never_drawn_if_it_is_missed_often():
    missed = [[2, 3]] * 4 + [[3]] * 2
    asked, answers = listed([[0, 1]] * 5 + [[0, 1, 2]], 4, missed=missed)
    # 2 was drawn once, 3 never.
    assert dropped(asked, answers, "never-drawn") == [3]


def test_what_was_missed_three_times_is_not_called_never_drawn():
    asked, answers = listed([[0, 1]] * 3, 3, missed=[[2]] * 3)
    assert dropped(asked, answers, "never-drawn") == []


def test_list_is_full_where_every_answer_with_a_miss_has_the_same_round_length():
    asked, answers = listed([range(64), range(64)], 70, missed=[[65], [66]])
    assert dropped(asked, answers, "list-full") == [*range(64, 70)]


def test_list_is_full_at_any_length_where_several_answers_that_differ_have_it():
    drawn = [[*range(5), 5 + k] for k in range(4)]
    asked, answers = listed(drawn, 12, missed=[[11]] * 4)
    assert dropped(asked, answers, "list-full") == [*range(6, 12)]
    for others in (drawn[:3], [drawn[0]] * 4, [*drawn[:3], drawn[3][:-1]]):
        asked, answers = listed(others, 12, missed=[[11]] * len(others))
        assert dropped(asked, answers, "list-full") is None


@pytest.mark.parametrize(
    ("lengths", "why"),
    [((63, 63), "63 is no round number"), ((64, 66), "a longer one"), ((40, 40), "too short")],
)
def test_list_is_not_full_otherwise(lengths, why):
    asked, answers = listed([range(n) for n in lengths], 70, missed=[[68], [69]])
    assert dropped(asked, answers, "list-full") is None, why


def test_nothing_is_drawn_where_much_shows_and_the_answer_is_empty():
    asked, answers = listed([[], [0]], 9, missed=[[0], []])
    assert dropped(asked, answers, "nothing-drawn") == [*range(9)]


def test_nothing_is_drawn_where_every_answer_is_empty():
    asked, answers = listed([[]] * 4, 3, missed=[[1]] * 4)
    assert dropped(asked, answers, "nothing-drawn") == [0, 1, 2]


def test_an_answer_of_something_or_of_little_to_see_is_not_nothing():
    asked, answers = listed([[0], []], 9, missed=[[1], []])
    assert dropped(asked, answers, "nothing-drawn") is None
    asked, answers = listed([[]], 7, missed=[[1]])
    assert dropped(asked, answers, "nothing-drawn") is None


def test_level_that_is_drawn_and_not_there_is_said_of_its_group():
    """Of the groups (0, 1) and (2, 3) one level each is there. Named was level 1, which is not."""
    groups = (Group("a", "a", (0, 1), ((0,), (1,))), Group("b", "b", (2, 3), ((2,), (3,))))
    made = of_groups(groups)
    asked, answers = listed([[2, 4]], 5, missed=[[0]], built=made)
    assert dropped(asked, answers, "absent-lod", ignored={1: 0}) == [0, 1]
    assert dropped(asked, answers, "absent-lod") is None
    # What is drawn is not left out, and what was named later says nothing of now.
    asked, answers = listed([[0, 2, 4]], 5, missed=[[]], built=made)
    assert dropped(asked, answers, "absent-lod", ignored={1: 0}) == [1]
    asked, answers = listed([[2, 4]], 5, missed=[[0]], built=made)
    assert dropped(asked, answers, "absent-lod", ignored={1: 3}) == []


def test_levels_that_are_all_named_at_once_are_no_wrong_choice():
    groups = (Group("a", "a", (0, 1, 2), ((0,), (1,), (2,))),)
    asked, answers = listed([[3, 4]], 5, missed=[[0]], built=of_groups(groups))
    assert dropped(asked, answers, "absent-lod", ignored={1: 0, 2: 0}) == []
    assert dropped(asked, answers, "absent-lod", ignored={1: 0}) == [0, 1, 2]


def of_groups(groups):
    made = case(
        [(f"o{i}", panel((i - 9.0, i - 8.5), (0.0, 5.0), -5.0)) for i in range(5)], [plain()]
    )
    return replace(made, scene=replace(made.scene, groups=groups))
