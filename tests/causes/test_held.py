"""Answers that are held, late by whatever rule, of another view, or in a list that changed: which
objects of small scenes each mistake would drop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.causes.small import Stage, cases_of, check, claims, named, plain, sheet
from tests.causes.test_answer_hypotheses import (
    along,
    both_repeat_right,
    left_view,
    posts,
    right_repeats_left,
    right_view,
    three_after_a_cut,
    with_cuts,
)
from visref.camera_path import Frame
from visref.causes.held import STEPS, as_all, as_before, from_all, moved_up
from visref.conformance.building import case
from visref.conformance.moving import moved, posed

# Held.


LAST = 37
LATE = {
    "one-frame-late": 1,
    "two-frames-late": 2,
    **{f"n-frames-late: {n} frames": n for n in (3, 4, 5, 6, 8)},
    "first-answer-kept": LAST,
    **{f"n-frames-late: every {n}": LAST % n for n in STEPS[1:]},
    **{f"n-frames-late: every {n}, as late again": LAST % n + n for n in STEPS[1:]},
    "one-frame-late: every 2": 1,
}
HOW = ("what shows", "boxes", "in the view")


def all_but(*kept):
    return " ".join(f"post{i}" for i in range(LAST + 1) if i not in kept)


def passing_by():
    """Frame k looks at x = 8 k, where posts k - 1 and k show."""
    return Stage(case(posts(LAST + 1), [along(k) for k in range(LAST + 1)]), LAST)


def repeating(then):
    """What showed `then` is drawn again in the last frame."""

    def repeated():
        seen = [f"post{then - 1}", f"post{then}"][then == 0 :]
        return replace(passing_by(), drawn={(then, ""): seen, (LAST, ""): seen})

    repeated.__name__ = f"repeated_{then}"
    return repeated


def uncovered():
    """'behind' was behind a wall in all frames but the last."""
    view = plain()
    objects = [
        ("wall", sheet(view, (2, 12), (2, 12), 10.0)),
        ("behind", sheet(view, (4, 9), (4, 9), 20.0)),
        ("beside", sheet(view, (20, 25), (4, 9), 20.0)),
    ]
    gone = [()] * LAST + [("wall",)]
    return Stage(posed(objects, [Frame((view,), absent=one) for one in gone]), LAST)


def lines_of(name, how, drops):
    cause, _, variant = name.partition(": ")
    return (
        f"{cause}: {'; '.join(f'{variant}, {one}' if variant else one for one in how)} -> {drops}"
    )


LATELY = [
    *claims(
        passing_by,
        *(lines_of(n, HOW, all_but(LAST - k - 1, LAST - k)) for n, k in LATE.items()),
        seen=False,
    ),
    *claims(uncovered, *(lines_of(n, ["asked then"], "wall behind") for n in LATE), seen=False),
    *(
        claim
        for name, k in LATE.items()
        for claim in claims(
            repeating(LAST - k),
            lines_of(name, ["repeated"], all_but(LAST - k - 1, LAST - k)),
            seen=False,
        )
    ),
]


def held(since, posts_drawn):
    """The same posts are drawn since a frame, and others before."""

    def built():
        drawn = {(k, ""): posts_drawn if k >= since else [f"post{k}"] for k in range(LAST + 1)}
        return replace(passing_by(), drawn=drawn)

    built.__name__ = f"held_since_{since}"
    return built


def uncovered_and_held():
    """Nothing but 'beside' is drawn since frame 30, and all of it before."""
    drawn = {(k, ""): ["beside"] if k >= 30 else ["wall", "beside"] for k in range(LAST + 1)}
    return replace(uncovered(), drawn=drawn)


UNCHANGED = [
    *claims(
        held(30, ["post29", "post30"]),
        *(
            f"n-frames-late: {before}unchanged since, {how} -> {all_but(k - 1, k)}"
            for before, k in (("", 30), ("1 before, ", 29), ("2 before, ", 28))
            for how in HOW
        ),
        f"n-frames-late: unchanged since, repeated -> {all_but(29, 30)}",
        seen=False,
    ),
    *claims(
        uncovered_and_held,
        *(
            f"n-frames-late: {before}unchanged since, asked then -> wall behind"
            for before in ("", "1 before, ", "2 before, ")
        ),
        seen=False,
    ),
    # That of the first of all has a cause of its own.
    *claims(held(0, ["post0"]), "n-frames-late: unchanged since, what shows -> says nothing"),
    *claims(held(LAST, ["post1"]), "n-frames-late: unchanged since, what shows -> says nothing"),
]

# Cuts, as in `test_answer_hypotheses`: there the last of eleven frames shows posts 9 and 10.


def all_of_eleven_but(*kept):
    return " ".join(f"post{i}" for i in range(11) if i not in kept)


CUTS = [
    *claims(
        with_cuts,
        f"across-a-cut: in the view -> {all_of_eleven_but(8, 9)}",
        f"across-a-cut: asked then -> {all_of_eleven_but(9, 10)}",
        seen=False,
    ),
    *claims(
        three_after_a_cut,
        f"across-a-cut: since, in the view -> {all_of_eleven_but(6, 7)}",
        f"across-a-cut: from before, in the view -> {all_of_eleven_but(5, 6)}",
        f"across-a-cut: since, asked then; from before, asked then -> {all_of_eleven_but(9, 10)}",
        seen=False,
    ),
]

# Views: the left one shows posts 1 and 2, the right one 2 and 3.

VIEWS = [
    *claims(
        right_view,
        "other-view: in all of them; seen in all of them -> post0 post1 post3 post4",
        "other-view: any other; in the view; before, in the view -> post0 post3 post4",
        "other-view: the first, view; the first, what shows; the first, boxes -> post0 post3 post4",
        "other-view: the first, in the view -> post0 post3 post4",
        "first-view-only: in the view -> post0 post3 post4",
        # What is in this view and was in none of the other's is drawn.
        "other-view: asked then; before, asked then; the first, asked then -> post0 post1 post4",
        "first-view-only: asked then -> post0 post1 post4",
        seen=False,
    ),
    *claims(
        left_view,
        "other-view: next, what shows; next, boxes; next, in the view -> post0 post1 post4",
        "other-view: next, asked then -> post0 post3 post4",
        seen=False,
    ),
    *claims(right_repeats_left, "other-view: the first, repeated -> post0 post3 post4", seen=False),
    *claims(both_repeat_right, "other-view: next, repeated -> post0 post1 post4", seen=False),
]

# Things that come, go and stand elsewhere.


def one_gone():
    """Of five in a row the second, 'b', has gone since the frame before; 'd' is behind the wall."""
    view = plain()
    objects = [
        (name, sheet(view, (4 * i, 4 * i + 2), (3, 6), 20.0)) for i, name in enumerate("abcde")
    ]
    objects.append(("wall", sheet(view, (10, 16), (1, 8), 10.0)))
    return Stage(posed(objects, [Frame((view,), absent=one) for one in ((), ("b",))]), 1)


AGES = {"first": 6, "four": 4, "three": 3, "two": 2, "one": 1}


def elsewhere_once():
    """Each thing was out of the view so many frames before."""
    view = plain()
    objects = [(n, sheet(view, (2 + 6 * i, 5 + 6 * i), (4, 8), 9.0)) for i, n in enumerate(AGES)]
    where = [{n: moved(x=100.0 * (k == 6 - age)) for n, age in AGES.items()} for k in range(7)]
    return Stage(posed(objects, [Frame((view,), world_from_object=one) for one in where]), 6)


def shut_once():
    """Each thing was behind a door so many frames before; a cut was three frames before."""
    view = plain()
    objects = []
    for i, name in enumerate(AGES):
        objects.append((f"{name}_door", sheet(view, (6 * i, 5 + 6 * i), (2, 10), 60.0)))
        objects.append((name, sheet(view, (2 + 6 * i, 3 + 6 * i), (4, 8), 20.0)))
    frames = []
    for k in range(7):
        where = {f"{n}_door": moved(z=50.0 * (k == 6 - age)) for n, age in AGES.items()}
        frames.append(Frame((replace(view, cut=k == 3),), world_from_object=where))
    return Stage(posed(objects, frames), 6)


def some_came():
    """'late' was absent at first, 'gone' in between, 'still' never: 'gone' was drawn at first."""
    view = plain()
    objects = [
        (n, sheet(view, (x, x + 4), (3, 9), 9.0))
        for n, x in (("late", 2), ("gone", 10), ("still", 18))
    ]
    gone = [("late",), ("gone",), ()]
    drawn = {(0, ""): ["gone", "still"], (1, ""): ["still"], (2, ""): ["still"]}
    return Stage(posed(objects, [Frame((view,), absent=one) for one in gone]), 2, drawn=drawn)


STANDING = [
    # Before: a b c d e wall; now: a c d e wall. Of b nothing shows.
    *claims(
        one_gone,
        # c gets b's answer, d c's, e d's, and the wall e's.
        "ids-shifted: list of before, what shows; list of before, boxes -> b c e",
        "ids-shifted: list of before, in the view -> b c",
        # b gets c's, c d's, d e's, e the wall's, the wall none.
        "ids-shifted: order of what is there, what shows -> c wall",
        "ids-shifted: order of what is there, boxes -> c wall",
        "ids-shifted: order of what is there, in the view -> wall",
        # c gets the second's, b's, which is gone; e the fourth's, d's.
        "ids-shifted: numbers of all, what shows; numbers of all, boxes -> b c e",
        "ids-shifted: numbers of all, in the view -> b c",
        # The wall has taken b's place, and has its answer.
        "ids-shifted: last moved up, what shows; last moved up, boxes -> b d wall",
        "ids-shifted: last moved up, in the view -> b wall",
        seen=False,
    ),
    *claims(
        elsewhere_once,
        *(
            f"old-pose: {age} frames before, view; {age} frames before, boxes -> {name}"
            for name, age in AGES.items()
            if age in (2, 3, 4)
        ),
    ),
    *claims(
        shut_once,
        *(
            f"old-occluders: {age} frames before, then; {age} frames before, then and now -> {name}"
            for name, age in AGES.items()
            if age in (2, 3, 4)
        ),
        "old-depth: two frames before -> two",
        "old-depth: three frames before -> three",
        "old-depth: first -> first",
        "old-depth: before the cut -> four",
    ),
    *claims(
        some_came,
        "appeared-unknown: absent at first, until drawn; absent before, until drawn -> late",
    ),
]
CLAIMS = [*LATELY, *UNCHANGED, *CUTS, *VIEWS, *STANDING]


@pytest.mark.parametrize("case", cases_of(CLAIMS), ids=named)
def test_held(case):
    check(*case)


def test_lists_by_hand():
    now, before = np.array([0, 2, 3, 4]), np.arange(5)
    assert as_before(now, before, 5).tolist() == [0, 1, 1, 2, 3]
    assert as_all(now, before, 5).tolist() == [0, 2, 3, 4, -1]
    assert from_all(now, before, 5).tolist() == [0, -1, 1, 2, 3]
    assert moved_up(now, before, 5).tolist() == [0, 1, 2, 3, 1]
