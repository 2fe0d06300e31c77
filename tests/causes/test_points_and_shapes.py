"""Rays to points of boxes, shapes that hide too much, boxes at home, and depths that are small or
rounded: which objects of small scenes each mistake would drop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.causes.small import Stage, block, cases_of, check, claims, named, plain, sheet, wide
from tests.causes.test_depth_hypotheses import narrow_slit, stage
from tests.causes.test_view_hypotheses import moved_out
from visref.camera import look_at
from visref.camera_path import CameraPath, Frame
from visref.conformance.building import Case, box, case, pixel_panel
from visref.conformance.moving import moved, posed
from visref.rig import Rig

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
    "few-samples: rays to the corners and the middle, in the image -> ",
    "few-samples: rays to the faces, in the image ->",
    # Without a transform the origin counts as the middle.
    "few-samples: ray to the origin -> broad",
    "few-samples: ray to the origin, in the image -> broad edge",
    "few-samples: rays to points within; rays to points within, in the image -> broad",
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
    "bounds-too-small: moved alone; moved alone, hidden -> turned halved",
    "bounds-too-small: not scaled; not scaled, hidden -> halved",
    "bounds-too-small: not turned; not turned, hidden -> turned",
    "bounds-too-small: not moved; not moved, hidden -> carried",
)


@pytest.mark.parametrize("case", cases_of(FROM_HOME), ids=named)
def test_from_home(case):
    check(*case)


# Depths that are drawn small or rounded.


def steps_of_view_depth():
    """Of 255 steps from 0 to 255, walls 0.4 and 0.6 behind a whole one, each with a sheet 0.2
    behind it: rounded down both come before their sheets, to the nearest the first alone."""
    view = wide(near=1e-9, far=255.0)
    objects = [("front", pixel_panel(view, (20.7, 27.3), (30.7, 40.3), 90.0))]
    for name, columns, share in (("down", (2.7, 21.3), 0.6), ("both", (26.7, 45.3), 0.4)):
        inner = columns[0] + 4, columns[1] - 4
        objects += [
            (f"{name}_wall", pixel_panel(view, columns, (2.7, 45.3), 100.0 + share)),
            (name, pixel_panel(view, inner, (6.7, 20.3), 100.2)),
        ]
    return Stage(case(objects, [view]))


def halves_of_depth():
    """Half floats between 2048 and 4096 are even. 'wall' at 2049.5 becomes 2050, 'near_wall' at
    2048.9 becomes 2048: before 'hidden' at 2048.5, though that lies before it."""
    view = wide(near=1.0, far=4000.0)
    return Stage(
        case(
            [
                ("wall", pixel_panel(view, (2.7, 21.3), (2.7, 45.3), 2049.5)),
                ("shown", pixel_panel(view, (6.7, 17.3), (6.7, 20.3), 2048.5)),
                ("near_wall", pixel_panel(view, (26.7, 45.3), (2.7, 45.3), 2048.9)),
                ("hidden", pixel_panel(view, (30.7, 41.3), (6.7, 20.3), 2048.5)),
            ],
            [view],
        )
    )


COARSE = [
    *claims(
        steps_of_view_depth,
        "quantised-depth: 8 bits of view depth, down -> down both",
        "quantised-depth: 8 bits of view depth, nearest -> both",
        "quantised-depth: 8 bits of view depth, down, box too ->",
        "quantised-depth: 8 bits of view depth, nearest, box too ->",
    ),
    *claims(
        halves_of_depth, "quantised-depth: half -> hidden", "quantised-depth: half, box too ->"
    ),
    *(
        claim
        for n in (2, 4, 8, 16)
        for claim in claims(stage(narrow_slit, n), f"coarse-depth-1/{n}: drawn small -> upper")
    ),
]

# Boxes that are rounded, or asked by corners and middle.


def rounded_far_out():
    """The view reaches from 100.3 to 132.3. Of 'first' the right end, 100.4, becomes 100 in all
    ways but one; of 'last' the left one, 132.28, becomes 132.5 with halves to the nearest."""
    pose = look_at((116.3, 0.0, 0.0), (116.3, 0.0, -1.0))
    view = replace(plain(), world_from_camera=pose)
    objects = [
        ("first", box((98.0, -1.0, -6.0), (100.4, 1.0, -5.0))),
        ("last", box((132.28, -1.0, -6.0), (134.6, 1.0, -5.0))),
        ("middle", box((114.0, -1.0, -6.0), (118.0, 1.0, -5.0))),
    ]
    return Stage(case(objects, [view]))


def middles_in_the_world():
    """Floats between 2^26 and 2^27 are multiples of 8. The view reaches from 1e8 + 1 to 1e8 + 5.
    Of 'moved' the middle, at 1e8 + 4.8, becomes 1e8 + 8; that of 'held', at 1e8 + 2, becomes 1e8,
    2 to the left, and it is 4 wide."""
    view = replace(plain(32, 32, ymag=2.0), world_from_camera=look_at((3, 0, 0), (3, 0, -1)))
    objects = [
        ("moved", box((4.5, -0.4, -6.0), (5.1, 0.4, -5.0))),
        ("held", box((0.0, -0.4, -6.0), (4.0, 0.4, -5.0))),
    ]
    return Stage(moved_out(case(objects, [view]), (1e8, 0.0, 0.0)))


def large_ones():
    """Of none of them a corner is in the view. The middle of 'about' is, that of 'tall' is not."""
    return Stage(
        case(
            [
                ("about", box((-40.0, -40.0, -9.0), (40.0, 40.0, -8.0))),
                ("tall", box((-60.0, -40.0, -7.0), (-10.0, 40.0, -6.0))),
            ],
            [plain()],
        )
    )


BOXES = [
    *claims(
        rounded_far_out,
        *(
            f"rounded-coordinates: multiples of {grid}, nearest -> {lost}"
            for grid, lost in (("0.5", "last"), ("1", "first"), ("2", "first"))
        ),
        *(
            f"rounded-coordinates: multiples of {grid}, {how} -> first"
            for grid in ("0.5", "1", "2")
            for how in ("down", "towards 0")
        ),
        # So little of them holds no sample.
        seen=False,
    ),
    *claims(middles_in_the_world, "rounded-coordinates: float32 in the world, the middle -> moved"),
    *claims(large_ones, "corners-only: or the centre -> tall"),
]


@pytest.mark.parametrize("case", cases_of([*COARSE, *BOXES]), ids=named)
def test_depths_and_boxes(case):
    check(*case)


CLAIMS = [*POINTS, *SHAPES, *FROM_HOME, *COARSE, *BOXES]
