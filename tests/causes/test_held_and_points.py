"""Answers that are held, rays to points of boxes, and shapes that hide too much: which objects of
small scenes each mistake would drop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.causes.small import Stage, block, cases_of, check, claims, named, plain, sheet
from tests.causes.test_answer_hypotheses import LAST, all_but, passing_by, right_view
from visref.camera_path import CameraPath, Frame
from visref.causes.held import as_all, as_before, from_all, moved_up
from visref.conformance.building import Case, box, case
from visref.conformance.moving import moved, posed
from visref.rig import Rig

# Held.


def held_from_seven():
    """The same is drawn from frame 7 on, and something else before."""
    drawn = {(k, ""): ["post1" if k < 7 else "post6", "post7"] for k in range(LAST + 1)}
    return Stage(passing_by().case, LAST, drawn=drawn)


def held_from_the_first():
    return Stage(passing_by().case, LAST, drawn={(k, ""): ["post0"] for k in range(LAST + 1)})


def drawn_anew():
    drawn = {(k, ""): [f"post{k}"] for k in range(LAST + 1)}
    return Stage(passing_by().case, LAST, drawn=drawn)


def one_gone():
    """Of five in a row the second, 'b', has gone since the frame before; 'd' is behind the wall."""
    view = plain()
    objects = [
        (name, sheet(view, (4 * i, 4 * i + 2), (3, 6), 20.0)) for i, name in enumerate("abcde")
    ]
    objects.append(("wall", sheet(view, (10, 16), (1, 8), 10.0)))
    return Stage(posed(objects, [Frame((view,), absent=one) for one in ((), ("b",))]), 1)


HELD = [
    *claims(
        held_from_seven,
        f"n-frames-late: unchanged since, what shows; unchanged since, boxes -> {all_but(6, 7)}",
        f"n-frames-late: unchanged since, in the view -> {all_but(6, 7)}",
        seen=False,
    ),
    # That of the first of all has a cause of its own.
    *claims(held_from_the_first, "n-frames-late: unchanged since, what shows -> says nothing"),
    *claims(drawn_anew, "n-frames-late: unchanged since, what shows -> says nothing"),
    *claims(
        passing_by,
        f"n-frames-late: every 4, what shows; every 4, boxes -> {all_but(7, 8)}",
        f"n-frames-late: every 3, what shows; every 3, in the view -> {all_but(8, 9)}",
        "n-frames-late: every 5, what shows; every 10, boxes -> says nothing",
        "one-frame-late: every 2, what shows -> says nothing",
        f"two-frames-late: in the view -> {all_but(7, 8)}",
        seen=False,
    ),
    # The left view shows posts 1 and 2, the right one 2 and 3.
    *claims(
        right_view,
        "other-view: in all of them; seen in all of them -> post0 post1 post3 post4",
        "other-view: any other -> post0 post3 post4",
        seen=False,
    ),
    # Before: a b c d e wall; now: a c d e wall. Of b nothing shows.
    *claims(
        one_gone,
        # c gets b's answer, d c's, e d's, and the wall e's.
        "ids-shifted: list of before, what shows -> b c e",
        # b gets c's, c d's, d e's, e the wall's, the wall none.
        "ids-shifted: order of what is there, what shows -> c wall",
        # c gets the second's, b's, which is gone; e the fourth's, d's.
        "ids-shifted: numbers of all, what shows -> b c e",
        # The wall has taken b's place, and has its answer.
        "ids-shifted: last moved up, what shows -> b d wall",
        seen=False,
    ),
]


@pytest.mark.parametrize("case", cases_of(HELD), ids=named)
def test_held(case):
    check(*case)


def test_lists_by_hand():
    now, before = np.array([0, 2, 3, 4]), np.arange(5)
    assert as_before(now, before, 5).tolist() == [0, 1, 1, 2, 3]
    assert as_all(now, before, 5).tolist() == [0, 2, 3, 4, -1]
    assert from_all(now, before, 5).tolist() == [0, -1, 1, 2, 3]
    assert moved_up(now, before, 5).tolist() == [0, 1, 2, 3, 1]


# Points.


def points():
    """'broad' has its middle behind a wall and its corners free, 'slit' the reverse, and the middle
    of 'edge' lies beyond the image."""
    view = plain()
    return Stage(
        posed(
            [
                ("wall", sheet(view, (8, 15), (2, 15), 10.0)),
                ("left", sheet(view, (19, 22), (2, 17), 10.0)),
                ("right", sheet(view, (26, 29), (2, 17), 10.0)),
                ("broad", block(view, (6.2, 17.8), (5.8, 12.2), (20.0, 22.0))),
                ("slit", block(view, (19.8, 28.2), (3.8, 16.2), (20.0, 22.0))),
                ("edge", block(view, (-5.8, 3.2), (19.8, 22.2), (20.0, 22.0))),
            ],
            [Frame((view,))],
        )
    )


POINTS = claims(
    points,
    "few-samples: ray to the middle -> broad",
    "few-samples: rays to the corners -> slit",
    "few-samples: rays to the corners and the middle; rays to the faces ->",
    "few-samples: ray to the middle, in the image -> broad edge",
    "few-samples: rays to the corners, in the image -> slit",
)


@pytest.mark.parametrize("case", cases_of(POINTS), ids=named)
def test_points(case):
    check(*case)


# Shapes.


def frames_and_bars():
    """'through' shows through a frame, 'below' beneath a bar, and 'beside' beneath nothing."""
    view = plain()
    return Stage(
        posed(
            [
                ("frame", sheet(view, (1, 11), (1, 11), 10.0, but=[((4, 8), (4, 8))])),
                ("through", block(view, (4.8, 7.2), (4.8, 7.2), (20.0, 22.0))),
                ("bar", sheet(view, (14, 22), (2, 4), 10.0)),
                ("below", block(view, (16.2, 19.8), (9.8, 14.2), (20.0, 22.0))),
                ("beside", block(view, (25.8, 28.2), (9.8, 14.2), (20.0, 22.0))),
            ],
            [Frame((view,))],
        )
    )


SHAPES = claims(
    frames_and_bars,
    "occluders-too-large: horizon -> through below",
    "occluders-too-large: rectangles, farthest; rectangles, nearest; boxes -> through",
    "occluders-too-large: dilated ->",
)


@pytest.mark.parametrize("case", cases_of(SHAPES), ids=named)
def test_shapes(case):
    check(*case)


# Boxes at home.


def from_home():
    """What is shown, once it is turned, halved or carried; at home each lies above the view."""
    view = plain(32, 8)
    turn, half = np.eye(4), np.diag([0.5, 0.5, 1.0, 1.0])
    turn[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    where = {"turned": turn, "halved": half, "carried": moved(y=-10.0)}
    objects = [
        ("turned", box((-1.0, 9.8, -6.0), (1.0, 11.2, -5.0))),
        ("halved", box((2.2, 5.8, -6.0), (6.2, 7.6, -5.0))),
        ("carried", box((5.2, 9.8, -6.0), (7.8, 11.2, -5.0))),
        ("still", box((9.2, -1.2, -6.0), (11.8, 1.2, -5.0))),
    ]
    built = case(objects, [view])
    meshes = [points.astype(np.float32) for _, (points, _) in objects]
    rig = Rig(meshes, np.arange(4), np.tile(np.eye(4), (4, 1, 1)), 8 * np.arange(5))
    frames = [Frame((view,), world_from_object=where)]
    return Stage(Case(replace(built.scene, rig=rig), CameraPath(frames)))


FROM_HOME = claims(
    from_home,
    "bounds-too-small: at home; at home, hidden -> turned halved carried",
    "bounds-too-small: moved alone -> turned halved",
    "bounds-too-small: not scaled; not scaled, hidden -> halved",
    "bounds-too-small: not turned -> turned",
    "bounds-too-small: not moved -> carried",
)


@pytest.mark.parametrize("case", cases_of(FROM_HOME), ids=named)
def test_from_home(case):
    check(*case)
