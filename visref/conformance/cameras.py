"""Conformance scenes built around where the camera stands and what it takes in: frustum, lens,
near and far, viewport, cuts, coordinates."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from visref.camera_path import CameraPath
from visref.conformance.building import (
    Case,
    Point,
    SceneMaker,
    box,
    camera,
    case,
    city,
    panel,
    pixel_panel,
    register_in,
    rolled,
    together,
    walk,
)

CAMERAS: list[SceneMaker] = []

_scene = register_in(CAMERAS)


@_scene("a walk through a city misses no house", "any")
def walk_through_a_city(rng: np.random.Generator) -> Case:
    return case(city(rng), walk(rng, 6))


@_scene("no box of a crowd is missed, however few of its pixels show", "results out of step")
def crowd(rng: np.random.Generator) -> Case:
    objects = []
    for _ in range(120):
        centre = rng.uniform((-9.0, -7.0, -24.0), (9.0, 7.0, -6.0))
        half = rng.uniform(0.2, 1.3, 3)
        objects.append(("box", box(centre - half, centre + half)))
    return case(objects, [camera((x, 0.5 * x, 0.0)) for x in (-1.0, 0.0, 1.0)])


@_scene("a view with a rolled, pitched camera misses nothing", "y flipped, up assumed")
def rolled_and_pitched_camera(rng: np.random.Generator) -> Case:
    eyes = [((0.3, 14.0, 22.0), 0.6), ((20.0, 25.0, 3.0), -2.5), ((0.0, 40.0, 0.1), 1.2)]
    return case(city(rng), [rolled(camera(eye, (0.0, 2.0, 0.0)), angle) for eye, angle in eyes])


@_scene("a moved lens and a changing field of view miss nothing", "off-centre frustum")
def lens_shift_and_zoom(rng: np.random.Generator) -> Case:
    views = walk(rng, 4)
    shifts = [(7.25, 0.0), (-20.0, 11.5), (0.5, -0.5), (0.0, 30.0)]
    fovs = [0.7, 1.0, 2.2, 0.8]
    views = [
        replace(view, shift_x_px=sx, shift_y_px=sy, yfov=fov)
        for view, (sx, sy), fov in zip(views, shifts, fovs, strict=True)
    ]
    return case(city(rng), views)


@_scene("what only the shift of the lens brings into view is drawn", "a symmetric frustum tested")
def beside_the_unshifted_view(rng: np.random.Generator) -> Case:
    shifts = ((40.0, 0.0), (-40.0, 0.0), (0.0, 30.0), (0.0, -30.0))
    views = [camera(shift_x_px=x, shift_y_px=y) for x, y in shifts]
    elsewhere = (0.0, 0.0, 500.0)
    views += [camera(elsewhere, ymag=9.0, shift_x_px=x, shift_y_px=y) for x, y in shifts]
    objects = [("straight on", panel((-1.0, 1.0), (-1.0, 1.0), -9.0))]
    for number, view in enumerate(views):
        # Close to the side to which the lens is shifted: half the shift does not reach there.
        x = view.width / 2 - 0.5 + view.shift_x_px + 22.0 * np.sign(view.shift_x_px)
        y = view.height / 2 - 0.5 + view.shift_y_px + 18.0 * np.sign(view.shift_y_px)
        depth = 9.0 + number
        objects.append(("aside", pixel_panel(view, (x - 3.0, x + 3.0), (y - 3.0, y + 3.0), depth)))
        behind = pixel_panel(view, (x - 2.0, x + 2.0), (y - 2.0, y + 2.0), depth + 0.5)
        objects.append(("hidden", behind))
    return case(objects, views)


@_scene("an orthographic view behind touching occluders misses nothing", "perspective assumed")
def orthographic_camera(rng: np.random.Generator) -> Case:
    objects = city(rng)
    # A wall of touching boxes, one brick missing.
    for column in range(12):
        for row in range(3):
            if (column, row) != (5, 1):
                low = np.array([3.0 * column - 18.0, 3.0 * row, 27.0])
                objects.append(("brick", box(low, low + 3.0)))
    views = [
        camera((0.0, 5.0, 60.0), (0.0, 5.0, 0.0), ymag=12.0),
        camera((30.0, 40.0, 30.0), (0.0, 0.0, 0.0), ymag=14.0),
        camera((0.0, 60.0, 0.0), (0.0, 0.0, 0.0), ymag=25.0),
    ]
    return case(objects, views)


@_scene("an object around the eye is drawn", "back-face culled query with the eye inside")
def eye_inside_an_object(rng: np.random.Generator) -> Case:
    objects = [
        ("hall", box((-10.0, -4.0, -10.0), (10.0, 4.0, 10.0))),
        ("outside", box((-3.0, -2.0, -20.0), (3.0, 2.0, -12.0))),
        ("cage", box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))),
        # Its box, but none of its triangles, is around the eye of most views.
        (
            "gate",
            together(
                box((-2.5, -2.0, 3.0), (-2.0, 2.0, 3.5)), box((2.0, -2.0, 5.5), (2.5, 2.0, 6.0))
            ),
        ),
    ]
    for _ in range(8):
        centre = rng.uniform((-8.0, -3.0, -9.0), (8.0, 3.0, -3.0))
        objects.append(("crate", box(centre - 0.6, centre + 0.6)))
    views = [
        camera(),  # inside the cage, which hides all else
        camera((0.0, 0.0, 5.0)),  # inside the hall alone
        camera((0.0, 0.0, 10.0)),  # on the hall's wall
        camera((2.0, 1.0, 4.0), (-2.0, 0.0, 9.0)),
    ]
    return case(objects, views)


@_scene("an object that crosses the near plane is drawn", "corners behind the eye projected")
def object_crossing_the_near_plane(rng: np.random.Generator) -> Case:
    objects = [
        ("left wall", box((-2.2, -1.0, -30.0), (-2.0, 1.0, 10.0))),
        ("right wall", box((2.0, -1.0, -30.0), (2.2, 1.0, 10.0))),
        ("floor", box((-2.0, -1.2, -30.0), (2.0, -1.0, 10.0))),
        # Hides where the walls' far ends and the mirror images of their near ends project.
        ("door", panel((-1.6, 1.6), (-0.9, 0.9), -4.0)),
        ("behind the door", box((-1.0, -0.5, -8.0), (1.0, 0.5, -6.0))),
        ("pole", box((-0.12, -0.3, -0.14), (-0.06, 0.3, -0.05))),
        ("plate", panel((0.02, 0.09), (-0.05, 0.03), -0.1)),  # exactly on the near plane
        ("too near", panel((-0.2, 0.2), (-0.2, 0.2), -0.05)),
    ]
    views = [camera(), camera((1.2, 0.1, 2.0)), camera((-0.5, 0.2, 1.0), (-1.9, 0.0, 0.0))]
    views += [camera((float(rng.uniform(-1.5, 1.5)), 0.0, 5.0), near=1.0) for _ in range(2)]
    return case(objects, views)


@_scene("a camera that cuts to another place misses nothing there", "last frame's depth or set")
def jump_cuts(rng: np.random.Generator) -> Case:
    eyes: list[Point] = [(0.3, 1.6, 20.0), (12.0, 30.0, 12.0), (0.3, 1.6, -21.0), (-8.0, 1.0, 0.5)]
    views = [camera(eye, (0.0, 1.0, 0.0), cut=True) for eye in eyes]
    return case(city(rng), [*views, views[0]])


@_scene("a fast turn misses nothing, though no cut is announced", "last frame's depth or set")
def fast_turn(rng: np.random.Generator) -> Case:
    objects = city(rng)
    # A blind right before the first view: what it hides must not stay hidden.
    objects.append(("blind", panel((-0.2, 0.8), (1.3, 1.9), 19.0)))
    eye = (0.3, 1.6, 20.0)
    angles = [0.0, 0.5, math.pi / 2, math.pi, 1.7 * math.pi, 0.0]
    views = [
        camera(eye, (eye[0] - math.sin(turn), eye[1], eye[2] - math.cos(turn))) for turn in angles
    ]
    # And a step round the blind.
    views.append(camera((0.3, 1.6, 18.5)))
    return case(objects, views)


@_scene("a scene a million units from the origin misses nothing", "float32 world coordinates")
def far_from_the_origin(rng: np.random.Generator) -> Case:
    shift = np.array([1.0e6, 2.5e5, -7.0e5])
    objects = [(name, (points + shift, faces)) for name, (points, faces) in city(rng)]
    views = []
    for view in walk(rng, 3):
        pose = view.world_from_camera.copy()
        pose[:3, 3] += shift
        views.append(replace(view, world_from_camera=pose))
    return case(objects, views)


@_scene("viewports of one pixel, one row and odd sides miss nothing", "sides rounded to tiles")
def odd_viewports(rng: np.random.Generator) -> Case:
    # The middle of the view is on a house.
    view = camera((0.3, 1.6, 20.0), (3.9, 1.2, 12.0))
    sizes = [(1, 1), (1, 64), (64, 1), (61, 47), (3, 5), (33, 17), (127, 2), (65, 33), (2, 2)]
    views = [replace(view, width=width, height=height) for width, height in sizes]
    return case(city(rng), views)


@_scene("nothing is missed from a millimetre to a thousand kilometres", "depth resolution")
def huge_depth_range(rng: np.random.Generator) -> Case:
    view = camera(near=1.0e-3, far=1.0e6)
    objects = []
    for index in range(9):
        depth = 3.0e-3 * 10.0**index if index < 8 else 9.0e5
        x = 7.0 * index
        objects.append(("near", pixel_panel(view, (x, x + 4.0), (4.0, 40.0), depth)))
        aside = 2.0 * (index % 2)
        behind = pixel_panel(view, (x + 1.0, x + 3.0 + aside), (10.0, 39.0), 1.1 * depth)
        objects.append(("behind", behind))
    return case(objects, [view, replace(view, far=math.inf)])


@_scene("what lies exactly on the far plane is drawn, what lies beyond is not asked", "open range")
def exactly_at_the_far_plane(rng: np.random.Generator) -> Case:
    view = camera(near=1.0, far=64.0)
    objects = [
        ("before", pixel_panel(view, (4.0, 20.0), (4.0, 40.0), 32.0)),
        ("on far", panel((-4.0, 20.0), (-20.0, 20.0), -64.0)),
        ("across far", box((-30.0, -10.0, -70.0), (-20.0, 10.0, -60.0))),
        ("beyond far, in the open", box((-18.0, -10.0, -90.0), (-8.0, 10.0, -80.0))),
        ("beyond far", box((-3.0, -3.0, -90.0), (3.0, 3.0, -80.0))),
    ]
    return case(objects, [view])


@_scene("of several hundred objects each is drawn", "numbers of one byte, lists with an end")
def several_hundred_objects(rng: np.random.Generator) -> Case:
    view = camera()
    shown = []
    for x in range(1, 63, 3):
        for y in range(1, 47, 3):
            low = np.array([x, y]) - rng.uniform(0.1, 0.4, 2)
            high = np.array([x, y]) + rng.uniform(0.1, 0.4, 2)
            dot = pixel_panel(view, (low[0], high[0]), (low[1], high[1]), 9.0)
            shown.append(("dot", dot))
    objects = [("wall", pixel_panel(view, (-1.0, 64.0), (-1.0, 48.0), 10.0))]
    for x, y in rng.uniform((2.0, 2.0), (58.0, 42.0), (20, 2)):
        objects.append(("hidden", pixel_panel(view, (x, x + 3.0), (y, y + 3.0), 12.0)))
    return case([*objects, *shown], [view])


@_scene(
    "in a scene with an origin of its own, cameras and boxes are taken relative to it",
    "world coordinates in float32, or an origin forgotten",
)
def about_an_origin_of_its_own(rng: np.random.Generator) -> Case:
    """Earth-centred: float32 rounds such coordinates to half a unit. The origin is the one that a
    reader finds for such a scene: a multiple of 16, which is the power of two above its size."""
    origin = np.array([4_208_416.0, 1_120_736.0, -4_645_520.0])
    objects = [("screen", panel((-0.3, 0.3), (-0.2, 0.2), -1.0))]
    near = []
    for number in range(6):
        eye = (0.25 * number + 0.125, 0.0, 0.0625 * number)
        x = eye[0] + 0.02
        objects.append(("post", box((x, -0.05, eye[2] - 0.2), (x + 0.01, 0.05, eye[2] - 0.15))))
        near.append(camera(eye, near=0.125, far=30.0))
    objects.append(("hidden", panel((-0.1, 0.1), (-0.1, 0.1), -1.1)))
    for number in range(4):
        centre = rng.uniform((-3.0, -2.0, -12.0), (3.0, 2.0, -6.0))
        if number == 0:
            centre[2] = -12.0
        objects.append(("box", box(centre - 0.5, centre + 0.5)))
    # Whole 2^-24ths, so that their sums with the origin are exact in float64.
    objects = [(name, (np.rint(points * 2.0**24) / 2.0**24, f)) for name, (points, f) in objects]
    built = case(objects, near)
    views = []
    for view in near:
        pose = view.world_from_camera.copy()
        pose[:3, 3] += origin
        views.append(replace(view, world_from_camera=pose))
    path = CameraPath(views, built.path.source)
    return Case(replace(built.scene, origin=origin), path)


@_scene(
    "what lies exactly on the near plane is drawn, what lies before it hides nothing",
    "open range, or occluders that are not clipped",
)
def exactly_at_the_near_plane(rng: np.random.Generator) -> Case:
    # Its diagonal meets no pixel centre.
    aside = rng.uniform(0.3, 0.7)
    view = camera(near=0.5)
    objects = [
        ("before near", pixel_panel(view, (-9.0 - aside, 90.0), (-5.0, 60.0 + aside), 0.25)),
        ("on near", panel((0.05, 0.15), (-0.15, 0.1), -0.5)),
        ("post", box((-1.5, -1.0, -5.0), (-0.5, 1.0, -4.0))),
        ("behind the post", box((-1.2, -0.5, -6.0), (-0.8, 0.5, -5.5))),
    ]
    return case(objects, [view, camera(near=0.5, ymag=3.0)])


@_scene("what is close by at the side of an orthographic view is drawn", "perspective assumed")
def close_by_in_an_orthographic_view(rng: np.random.Generator) -> Case:
    objects = [("board", panel((-3.0, 3.0), (-3.0, 3.0), -6.0))]
    for x, y in ((-11.0, 0.0), (11.0, 1.0), (0.0, 8.0), (2.0, -8.0)):
        centre = np.array([x, y, -rng.uniform(1.0, 2.0)])
        objects.append(("close by", box(centre - 0.7, centre + 0.7)))
    objects.append(("hidden", box((-2.0, -2.0, -9.0), (2.0, 2.0, -8.0))))
    return case(objects, [camera(ymag=9.0)])


@_scene("what a clip plane cuts off hides nothing", "occluders before the plane, as in a mirror")
def cut_by_a_plane(rng: np.random.Generator) -> Case:
    # The plane z = -6 and others near it; of what hides all, only what they cut off does.
    objects = [
        ("blind", panel((-9.0, 9.0), (-9.0, 9.0), -4.0)),
        ("screen", panel((-1.5, 1.5), (-1.5, 1.5), -9.0)),
        # Their near ends, which hide what is beside the screen, are cut off.
        ("left beam", box((-3.5, -2.0, -8.0), (-1.2, 2.0, -5.0))),
        ("right beam", box((1.2, -2.0, -8.0), (3.5, 2.0, -5.0))),
        ("cut off", box((-0.5, -0.5, -5.5), (0.5, 0.5, -5.0))),
        ("hidden", box((-0.6, -0.6, -11.0), (0.6, 0.6, -10.0))),
    ]
    for _ in range(30):
        centre = rng.uniform((-6.0, -4.0, -15.0), (6.0, 4.0, -7.0))
        half = rng.uniform(0.1, 0.5, 3)
        objects.append(("crate", box(centre - half, centre + half)))
    planes = [(0.0, 0.0, -1.0, -6.0), (0.3, -0.2, -1.0, -6.2), (-4.0, 1.0, -9.0, -54.0)]
    views = [camera((0.2 * k, 0.1, 0.0), clip_plane=plane) for k, plane in enumerate(planes)]
    views += [
        camera((2.0, 0.5, 0.0), (0.0, 0.0, -9.0), ymag=5.0, clip_plane=planes[1]),
        # Only what is near counts; and the eye beyond the blind, on its plane and beside it.
        camera((0.0, 0.0, -4.5), clip_plane=(0.0, 0.0, 1.0, 9.5)),
        camera((0.0, 0.0, 0.0), clip_plane=(1.0, 0.0, 0.0, 0.0)),
        camera((0.5, 1.0, -3.0), clip_plane=(0.0, 0.0, -1.0, -4.0)),
    ]
    return case(objects, views)
