"""Wrong tests of what is in the view: which objects of small scenes each would drop."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest

from tests.causes.small import (
    Stage,
    at,
    cases_of,
    check,
    claims,
    named,
    names,
    plain,
    sheet,
    straight,
    wide,
)
from visref.camera import look_at
from visref.camera_path import CameraPath, Frame
from visref.conformance.building import Case, box, case, panel, pixel_panel, rolled, together
from visref.conformance.moving import moved
from visref.rig import Rig
from visref.scene import Scene


def cube(x, y, z, half=0.6):
    return box((x - half, y - half, z - half), (x + half, y + half, z + half))


def strewn(view, **places) -> Stage:
    """Small cubes 10 units away, by name and place across the view."""
    return Stage(case([(name, cube(x, y, -10.0)) for name, (x, y) in places.items()], [view]))


# The lens.


def shifted():
    """The image is 64 by 48 units. Moved 20 to the right and 12 up it shows x from -12 to 52 and y
    from -12 to 36; without the shift from -32 to 32 and -24 to 24, with half of it from -22 to 42
    and -18 to 30, with the opposite from -52 to 12 and -36 to 12."""
    view = plain(64, 48, shift_x_px=20.0, shift_y_px=-12.0)
    return strewn(
        view, low=(5, 5), right=(45, 5), nearer=(38, 5), nearest=(20, 5), up=(5, 33), higher=(5, 20)
    )


def unshifted():
    return strewn(plain(), middle=(0, 0))


def on_its_side():
    """Turned by a right angle the image of 64 by 24 shows x from -12 to 12, y from -32 to 32;
    upright the reverse."""
    return strewn(rolled(plain(64, 24), pi / 2), middle=(3, 3), high=(0, 25))


def landscape():
    """64 by 32: x from -32 to 32, y from -16 to 16. Cubes at the right, at the top, and two
    between, at x of 20 and y of 10."""
    return strewn(
        plain(64, 32), middle=(0, 0), left=(-5, 1), right=(28, 0), half=(20, 0), up=(0, 11)
    )


def portrait():
    return strewn(plain(32, 64), middle=(0, 0), high=(0, 25), right=(14, 0))


def pyramids():
    """A pyramid of 45 degrees is tan(22.5 degrees) = 0.414 of its depth to either side, times the
    aspect of 2: 8.3 at a depth of 10 and 49.7 at 60; one of 90 degrees, 20 and 120."""
    at_depth = {"ahead": (0, -10), "aside": (15, -10), "wider": (25, -10), "far": (25, -60)}
    objects = [(name, cube(x, y, z)) for y, (name, (x, z)) in enumerate(at_depth.items())]
    return Stage(case(objects, [plain(64, 32)]))


def zoomed_out():
    """The first frame shows x from -16 to 16 and y from -8 to 8, the second twice as much."""
    views = [plain(64, 32, ymag=8.0), plain(64, 32)]
    objects = {"middle": (0, 0), "inner": (14, 0), "right": (20, 0), "up": (0, 12)}
    return Stage(case([(n, cube(x, y, -10.0)) for n, (x, y) in objects.items()], views), frame=1)


def first_square():
    """The first image is 32 by 32, of half the width."""
    views = [plain(32, 32), plain(64, 32)]
    objects = {"middle": (0, 0), "right": (20, 0), "up": (0, 12)}
    return Stage(case([(n, cube(x, y, -10.0)) for n, (x, y) in objects.items()], views), frame=1)


def before_a_lens():
    """A radian across is 0.46 of the depth to either side; as if it were a degree, 0.0087."""
    return strewn(wide(yfov=1.0), ahead=(0, 0), aside=(2, 0), up=(0, 2))


LENSES = [
    *claims(
        shifted,
        "no-lens-shift: both -> right nearer up",
        "no-lens-shift: x -> right nearer",
        "no-lens-shift: y -> up",
        "no-lens-shift: half -> right up",
        "lens-shift-reversed: both -> right nearer nearest up higher",
        "lens-shift-reversed: x -> right nearer nearest",
        "lens-shift-reversed: y -> up higher",
        "roll-ignored: -> says nothing",
    ),
    *claims(
        unshifted,
        "no-lens-shift: both; x; y; half -> says nothing",
        "lens-shift-reversed: both; x; y -> says nothing",
    ),
    *claims(on_its_side, "roll-ignored: -> high"),
    *claims(
        landscape,
        # 16 to either side; 32; 8; 16 and 8 up; 16 and 8 up.
        "other-lens: as wide as high -> right half",
        "other-lens: as high as wide ->",
        "other-lens: aspect inverted -> right half",
        "other-lens: horizontal for vertical -> right half up",
        "other-lens: half -> right half up",
    ),
    # 16 by 32, which become 32 by 32, 16 by 16, 64 by 32, 32 by 64 and 8 by 16.
    *claims(
        portrait,
        "other-lens: as wide as high; aspect inverted; horizontal for vertical ->",
        "other-lens: as high as wide -> high",
        "other-lens: half -> high right",
    ),
    *claims(
        pyramids,
        "other-lens: pyramid of 45 degrees -> aside wider",
        "other-lens: pyramid of 90 degrees -> wider",
        "other-lens: first frame's; first frame's viewport -> says nothing",
    ),
    *claims(
        zoomed_out,
        "other-lens: first frame's -> right up",
        "other-lens: first frame's viewport -> says nothing",
    ),
    *claims(first_square, "other-lens: first frame's viewport -> right"),
    *claims(
        before_a_lens,
        "other-lens: degrees for radians -> aside up",
        "other-lens: as wide as high; pyramid of 45 degrees; pyramid of 90 degrees -> says nothing",
    ),
]


# Corners, centres, origins.


def large_and_long():
    """Of 'big' all corners lie beyond the sides; 'long' lies within them, from before the near
    plane at 1 to behind the far one at 20; of 'edge' a third is within the right side, at x of
    16."""
    view = plain(near=1.0, far=20.0)
    slope = np.array([[-4, 1, -0.5], [-2, 1, -0.5], [-2, 3, -30.0], [-4, 3, -30.0]])
    return Stage(
        case(
            [
                ("big", box((-90.0, -90.0, -19.0), (90.0, 90.0, -18.0))),
                ("long", (slope, np.array([[0, 1, 2], [0, 2, 3]]))),
                ("edge", box((14.0, -3.0, -12.0), (20.0, -1.0, -11.0))),
                ("within", box((2.0, 5.0, -12.0), (3.0, 7.0, -11.0))),
            ],
            [view],
        )
    )


def far_from_its_origin():
    """'lamp' is modelled 30 beside its origin, which stands beside the view; that of the others is
    the world's, 10 before the eye."""
    view = replace(plain(), world_from_camera=look_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0)))
    objects = [("lamp", cube(-30.0, 2.0, 0.0)), ("table", cube(4.0, 2.0, 0.0))]
    built = case(objects, [view])
    meshes = [points.astype(np.float32) for _, (points, _) in objects]
    rig = Rig(meshes, np.arange(2), np.tile(np.eye(4), (2, 1, 1)), np.array([0, 8, 16]))
    scene = replace(built.scene, rig=rig)
    frame = Frame((view,), world_from_object={"lamp": moved(x=31.0)})
    return Stage(Case(scene, CameraPath([frame])))


def no_origins():
    return strewn(plain(), middle=(0, 0))


def beside_the_eye():
    """'hedge' runs from behind the eye into the view, 'kerb' from between the eye and the near
    plane."""
    return Stage(
        case(
            [
                ("hedge", straight((0.5, 0.7), (-0.2, 0.2), (-3.0, 9.0))),
                ("kerb", straight((-0.7, -0.5), (-0.2, 0.2), (0.05, 9.0))),
                ("post", straight((-0.1, 0.1), (0.5, 1.0), (4.0, 4.2))),
            ],
            [wide()],
        )
    )


def passing_wall():
    """The eye is turned 45 degrees to the right of -Z, and the wall, 1 to 1.2 to its right, runs
    along -Z from 20 behind to 20 before it: to the right it is (x + z) / sqrt 2, its depth (x -
    z) / sqrt 2. So its ends are 19 / 21 = -0.9 of the depth to the left, and 21 / -19 = -1.1
    behind the eye; as if before it, +1.1. The view reaches 0.5 to either side, and shows the
    wall where (x + z) / (x - z) is within it. Rectangles about the left ends, or these and those
    that are mirrored, miss the image; those about -0.9 and +1.1, or +infinity at the near plane,
    hold it."""
    view = wide(yfov=2.0 * np.arctan(0.5))
    view = replace(view, world_from_camera=look_at((0.0, 0.0, 0.0), (1.0, 0.0, -1.0)))
    return Stage(
        case(
            [
                ("wall", box((1.0, -1.0, -20.0), (1.2, 1.0, 20.0))),
                ("cart", box((0.4, -0.1, -0.6), (0.5, 0.1, -0.5))),
            ],
            [view],
        )
    )


def beside_a_screen():
    """The screen hides everything from depth 5 on. The hedge's part before it shows, to the
    right of 1 / 5 of the depth; but the least depth of its corners before the eye is 15."""
    view = wide()
    return Stage(
        case(
            [
                ("screen", panel((-9.0, 9.0), (-9.0, 9.0), -5.0)),
                ("hedge", straight((1.0, 1.5), (-1.0, 1.0), (-6.0, 15.0))),
                ("lamp", straight((-0.6, -0.4), (0.0, 0.2), (3.0, 3.2))),
            ],
            [view],
        )
    )


def inside_a_room():
    return Stage(
        case(
            [("room", box((-5.0, -4.0, -6.0), (4.0, 3.0, 7.0))), ("chair", cube(0.0, -1.0, -4.0))],
            [wide()],
        )
    )


def behind_a_curtain():
    """The curtain, at depth 2, fills the view; the room's walls come into it from depth 3 on, but
    its lamp hangs before the curtain."""
    room = together(
        box((-5.0, -4.0, -6.0), (4.0, 3.0, 7.0)), box((0.4, 0.4, -1.5), (0.6, 0.6, -1.3))
    )
    return Stage(
        case(
            [
                ("room", room),
                ("curtain", panel((-2.5, 2.5), (-2.5, 2.5), -2.0)),
            ],
            [wide()],
        )
    )


PROJECTED = "mirrored; clamped; folded; dropped; dropped-at-near"
HIDDEN_TOO = "; ".join(f"{how}, hidden" for how in PROJECTED.split("; "))

CORNERS = [
    *claims(
        large_and_long,
        "corners-only: all planes -> big long",
        "corners-only: sides -> big",
        "centre-only: -> edge",
        f"corners-behind-eye: any before near; any behind the eye; {PROJECTED} -> says nothing",
    ),
    *claims(far_from_its_origin, "pivot: -> lamp"),
    *claims(no_origins, "pivot: -> says nothing"),
    *claims(
        beside_the_eye,
        "corners-behind-eye: any before near -> hedge kerb",
        "corners-behind-eye: any behind the eye -> hedge",
        # Corners before the eye are in the image, whatever becomes of the others.
        f"corners-behind-eye: {PROJECTED} ->",
    ),
    *claims(
        passing_wall,
        "corners-behind-eye: mirrored; dropped; dropped-at-near -> wall",
        "corners-behind-eye: clamped; folded ->",
    ),
    *claims(
        beside_a_screen,
        f"corners-behind-eye: {PROJECTED} ->",
        f"corners-behind-eye: {HIDDEN_TOO} -> hedge",
    ),
    *claims(inside_a_room, "eye-inside-box: -> room", "eye-inside-box: asked ->"),
    *claims(behind_a_curtain, "eye-inside-box: ; asked -> room"),
]


# Near and far.


def in_a_row(view, **depths) -> Stage:
    """Upright panels beside one another, at depths by name."""
    side = view.width / (len(depths) + 1)
    objects = [
        (
            name,
            pixel_panel(view, (side * (i + 0.3) + 0.3, side * (i + 1) + 0.3), (9.7, 20.3), depth),
        )
        for i, (name, depth) in enumerate(depths.items())
    ]
    return Stage(case(objects, [view]))


def close_by():
    return in_a_row(wide(near=0.02), a=0.03, b=0.08, c=0.15, d=0.5, e=3.0)


def not_close():
    return in_a_row(wide(near=2.0), a=3.0, b=30.0)


def far_away():
    return in_a_row(wide(far=5e4), a=50.0, b=500.0, c=5e3, d=2e4, e=4e4)


def no_far_plane():
    return in_a_row(wide(far=np.inf), a=50.0, b=500.0, c=2e4)


def on_planes():
    """Two panels stand exactly on the near and the far plane; that on x = -16 shows no sample."""
    view = plain(near=1.0, far=64.0)
    return Stage(
        case(
            [
                ("near", panel((-9.0, -5.0), (-3.0, 3.0), -1.0)),
                ("far", panel((-2.0, 3.0), (-3.0, 3.0), -64.0)),
                ("between", panel((5.0, 9.0), (-3.0, 3.0), -63.5)),
            ],
            [view],
        )
    )


def round_the_corner():
    """The far plane lies at 10. The nearest point of 'aside' is (6, 0, 9), sqrt(117) = 10.8
    away, that of 'across' (0, 2, 9), 9.2."""
    return Stage(
        case(
            [
                ("aside", straight((6.0, 7.0), (-0.5, 0.5), (9.0, 9.5))),
                ("across", straight((-6.0, 6.0), (2.0, 3.0), (9.0, 9.5))),
                ("ahead", straight((-0.5, 0.5), (-0.5, 0.5), (9.0, 9.5))),
            ],
            [wide(far=10.0)],
        )
    )


NEAR_AND_FAR = [
    # Near is 0.02: ten times 0.2, twice 0.04.
    *claims(
        close_by,
        "near-larger: twice -> a",
        "near-larger: 0.1 -> a b",
        "near-larger: ten times -> a b c",
        "near-larger: 1 -> a b c d",
    ),
    *claims(not_close, "near-larger: 0.1; 1 -> says nothing", "near-larger: twice -> a"),
    *claims(
        far_away,
        "far-nearer: half -> e",
        "far-nearer: 100 -> b c d e",
        "far-nearer: 1000 -> c d e",
        "far-nearer: 10000 -> d e",
    ),
    *claims(
        no_far_plane,
        "far-nearer: half -> says nothing",
        "far-nearer: 100 -> b c",
        "euclidean-depth: against far -> says nothing",
    ),
    *claims(round_the_corner, "euclidean-depth: against far -> aside"),
    *claims(on_planes, "on-the-plane: -> near far"),
]


# Where things are rounded, and about which origin.


def moved_out(built: Case, origin) -> Case:
    """The same, seen from far out: the path says where in the world, the scene is about an
    origin."""
    scene: Scene = replace(built.scene, origin=np.array(origin))
    frames = []
    for view in built.path.cameras:
        pose = view.world_from_camera.copy()
        pose[:3, 3] += origin
        frames.append(replace(view, world_from_camera=pose))
    return Case(scene, CameraPath(frames))


def near_2050(origin=0.0) -> Stage:
    """Half floats between 2048 and 4096 are even. An eye at 2050.9 becomes 2050, and its view of
    1.5 to either side, from 2049.4 to 2052.4, ends at 2051.5: beyond it lies 'right', at 2052.1
    and so 2052. 'left' becomes 2050."""
    view = replace(
        plain(32, 32, ymag=1.5),
        world_from_camera=look_at((2050.9 - origin, 0, 0), (2050.9 - origin, 0, -1)),
    )
    objects = [
        ("right", box((2052.1 - origin, -0.4, -6.0), (2052.3 - origin, 0.4, -5.0))),
        ("left", box((2050.1 - origin, -0.4, -6.0), (2050.3 - origin, 0.4, -5.0))),
    ]
    built = case(objects, [view])
    return Stage(moved_out(built, (origin, 0.0, 0.0)) if origin else built)


def halves_in_the_world():
    return near_2050(2048.0)


def floats_in_the_world():
    """Floats between 2^26 and 2^27 are multiples of 8. An eye at 1e8 + 3 becomes 1e8, and its
    view of 2 to either side ends at 1e8 + 2; 'right' at 1e8 + 4.5 becomes 1e8 + 8, 'left' at 1e8
    + 2.5 becomes 1e8."""
    view = replace(plain(32, 32, ymag=2.0), world_from_camera=look_at((3, 0, 0), (3, 0, -1)))
    objects = [
        ("right", box((4.5, -0.4, -6.0), (4.8, 0.4, -5.0))),
        ("left", box((2.5, -0.4, -6.0), (2.8, 0.4, -5.0))),
    ]
    return Stage(moved_out(case(objects, [view]), (1e8, 0.0, 0.0)))


def ten_from_the_origin():
    """A camera in the world, 10 farther right than what it sees, shows x from -6 to 26."""
    built = strewn(plain(), left=(-9, 0), middle=(0, 0), right=(9, 0)).case
    return Stage(moved_out(built, (10.0, 0.0, 0.0)))


ROUNDED = [
    *claims(
        near_2050,
        "rounded-coordinates: float16; float16, hidden -> right",
        "rounded-coordinates: float32 in the world; float16 in the world -> says nothing",
        "origin-forgotten: -> says nothing",
    ),
    *claims(halves_in_the_world, "rounded-coordinates: float16 in the world -> right"),
    *claims(
        floats_in_the_world,
        "rounded-coordinates: float32 in the world; float32 in the world, hidden -> right",
    ),
    *claims(ten_from_the_origin, "origin-forgotten: -> left"),
]


# Boxes and spheres that are too small, flat or tiny.


def turned_cubes():
    """Seen along (-1, 0, -1) / sqrt 2, to the right is (x - z) / sqrt 2. A cube of 8 reaches 8 /
    sqrt 2 = 5.7 to either side of its centre, its least and its greatest corner 0. The view ends
    at 16: a centre at 18 is out, and so are both corners, but the cube reaches to 12.3. A sphere
    of 4, to the faces, about a centre at 21 ends at 17, and the cube at 15.3."""
    s = sqrt(0.5)
    right, ahead = np.array([s, 0.0, -s]), np.array([-s, 0.0, -s])
    view = replace(plain(), world_from_camera=look_at((0, 0, 0), tuple(ahead)))
    places = {"left": (-3.0, 40.0), "two": (18.0, 40.0), "ball": (21.0, 60.0)}
    objects = []
    for row, (name, (across, depth)) in enumerate(places.items()):
        centre = across * right + depth * ahead + (0.0, 9.0 * row - 8.0, 0.0)
        objects.append((name, box(centre - 4.0, centre + 4.0)))
    return Stage(case(objects, [view]))


def beams():
    """The view ends at x = 16.

    'beam', 8 by 2 by 2 about x = 19, reaches in to 15, half of it to 17. Spheres about it of half
    its least side, 1, and of half the mean of its sides, 2, end at 18 and 17; of half the greatest,
    4, at 15.
    'board', 18 by 2 and flat, is about x = 22 and reaches in to 13: its triangles' centroids are at
    19 and 25, half of it is from 17.5 on; the spheres, of 0, 3.3 and 9, reach to 22, 18.7 and 13.
    'peek', from -10 to 10 and 20 away, shows left of the screen, which begins at -8: its centroids
    are at -3.3 and 3.3, half of it is from -5 to 5, behind the screen."""
    return Stage(
        case(
            [
                ("beam", box((15.0, 7.0, -9.0), (23.0, 9.0, -7.0))),
                ("board", panel((13.0, 31.0), (-9.0, -7.0), -8.0)),
                ("screen", panel((-8.0, 11.0), (-4.0, 4.0), -10.0)),
                ("peek", panel((-10.0, 10.0), (-2.0, 2.0), -20.0)),
            ],
            [plain()],
        )
    )


def moving_beams():
    """The same, of which 'beam' moved by nothing that one sees, and 'peek' too."""
    objects = [
        ("beam", box((15.0, 7.0, -9.0), (23.0, 9.0, -7.0))),
        ("board", panel((13.0, 31.0), (-9.0, -7.0), -8.0)),
        ("screen", panel((-8.0, 11.0), (-4.0, 4.0), -10.0)),
        ("peek", panel((-10.0, 10.0), (-2.0, 2.0), -20.0)),
    ]
    still = {name: moved() for name in ("beam", "peek")}
    aside = {name: moved(x=1.0) for name in ("beam", "peek")}
    frames = [Frame((plain(),), world_from_object=where) for where in (still, aside)]
    return Stage(Case(case(objects, [plain()]).scene, CameraPath(frames)))


def audited():
    return replace(strewn(plain(), held=(0, 0), not_held=(4, 0)), too_small=("not_held",))


def small_ones():
    """Each about a sample: a dot of 0.8 by 0.8 pixels, a bar of 0.3 by 2.4, a pole of 0.5 by 9."""
    view = plain()
    return Stage(
        case(
            [
                ("dot", pixel_panel(view, (4.6, 5.4), (4.6, 5.4), 9.0)),
                ("bar", pixel_panel(view, (9.85, 10.15), (4.8, 7.2), 9.0)),
                ("pole", pixel_panel(view, (14.75, 15.25), (4.5, 13.5), 9.0)),
                ("cube", cube(3.0, -6.0, -9.0, 1.5)),
            ],
            [view],
        )
    )


def flat_ones():
    view = plain()
    objects = [("sheet", sheet(view, (3, 9), (3, 9), 8.0)), ("cube", cube(3.0, -6.0, -9.0))]
    # Seen along its own plane: it shows nowhere.
    objects.append(
        ("along", (np.array([[6, 0, -9], [6, 4, -9], [6, 4, -12.0]]), np.array([[0, 1, 2]])))
    )
    return Stage(case(objects, [view]))


BOUNDS = [
    *claims(
        turned_cubes,
        "bounds-too-small: two corners -> two ball",
        "bounds-too-small: sphere to the faces -> ball",
        "bounds-too-small: found -> says nothing",
    ),
    *claims(
        beams,
        "bounds-too-small: sphere of least side; sphere of mean side -> beam board",
        "bounds-too-small: sphere to the faces ->",
        "bounds-too-small: centroids -> board",
        "bounds-too-small: 0.5 of the sides; 0.25 of the sides -> beam board",
        # Nothing moves.
        "bounds-too-small: 0.5 of the sides, of what moves; 0.25 of the sides, of what moves ->",
        "bounds-too-small: centroids, hidden -> board peek",
        "bounds-too-small: 0.5 of the sides, hidden; 0.25 of the sides, hidden -> beam board peek",
    ),
    *claims(
        moving_beams,
        "bounds-too-small: 0.5 of the sides, of what moves -> beam",
        "bounds-too-small: 0.25 of the sides, of what moves -> beam",
        "bounds-too-small: 0.5 of the sides, of what moves, hidden -> beam peek",
        "bounds-too-small: 0.25 of the sides, of what moves, hidden -> beam peek",
    ),
    *claims(audited, "bounds-too-small: found -> not_held"),
    *claims(
        small_ones,
        "too-few-samples: less than a pixel -> dot bar",
        "too-few-samples: narrow -> dot",
    ),
    *claims(flat_ones, "flat-box: -> sheet along", "flat-box: edge-on -> along", seen=False),
]

CLAIMS = [*LENSES, *CORNERS, *NEAR_AND_FAR, *ROUNDED, *BOUNDS]


@pytest.mark.parametrize("claimed", cases_of(CLAIMS), ids=named)
def test_wrong_test_of_the_view_drops_what_it_would(claimed):
    check(*claimed)


@pytest.mark.parametrize(
    "build", sorted({c.build for c in CLAIMS}, key=str), ids=lambda b: b.__name__
)
def test_every_object_of_these_scenes_shows(build):
    asked = at(build)
    assert names(asked, ~asked.now.seen) <= {"along"}
