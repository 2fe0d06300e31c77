"""Conformance scenes built around what lies before what: rectangles, depths, gaps and ties."""

from __future__ import annotations

import math

import numpy as np

from visref.conformance.building import (
    HEIGHT,
    WIDTH,
    Case,
    SceneMaker,
    box,
    camera,
    case,
    panel,
    pixel_panel,
    pixel_point,
    register_in,
    rolled,
    together,
)

OCCLUSION: list[SceneMaker] = []

_scene = register_in(OCCLUSION)


@_scene("what peeks out behind an occluder by one pixel is drawn", "rectangle rounded inward")
def peeking_by_a_pixel(rng: np.random.Generator) -> Case:
    view = camera()
    objects = []
    for column in range(4):
        for row in range(3):
            # The occluder covers columns x ... x + 8 and rows y ... y + 8, its edges anywhere
            # between those and the next; what peeks out owns the next one.
            x, y = 3.0 + 16.0 * column, 3.0 + 16.0 * row
            before, after = rng.uniform(0.02, 0.98, 2), rng.uniform(0.02, 0.98, 2)
            wide, high = (x - before[0], x + 8.0 + after[0]), (y - before[1], y + 8.0 + after[1])
            # It hangs on a flag near the eye, so that it comes first from front to back.
            flag = pixel_panel(view, (x + 4.0, x + 4.4), (y + 4.0, y + 4.4), 1.0)
            objects.append(("occluder", together(pixel_panel(view, wide, high, 5.0), flag)))
            objects.append(("hidden", pixel_panel(view, (x + 1, x + 7), (y + 1, y + 7), 9.0)))
            sides = np.array([x + 2.0, x + 6.5, y + 2.0, y + 6.5])
            side, out = (column + row) % 4, rng.uniform(0.02, 0.4)
            sides[side] = [x - 1.0 - out, x + 9.0 + out, y - 1.0 - out, y + 9.0 + out][side]
            left, right, top, bottom = sides.tolist()
            objects.append(("peeks", pixel_panel(view, (left, right), (top, bottom), 7.0)))
    return case(objects, [view, rolled(view, math.pi / 2), rolled(view, math.pi)])


@_scene("what shows in the first or last row or column is drawn", "last row left out")
def rows_and_columns_at_the_border(rng: np.random.Generator) -> Case:
    view = camera()
    w, h = float(WIDTH), float(HEIGHT)
    screen = pixel_panel(view, (0.4, w - 1.4), (0.4, h - 1.4), 5.0)
    objects = [
        ("screen", together(screen, pixel_panel(view, (30.0, 30.3), (20.0, 20.3), 1.0))),
        ("hidden", pixel_panel(view, (10.0, 50.0), (10.0, 40.0), 9.0)),
        ("left", pixel_panel(view, (-0.4, 12.0), (8.0, 20.0), 7.0)),
        ("right", pixel_panel(view, (w - 12.0, w - 0.6), (10.0, 30.0), 7.0)),
        ("top", pixel_panel(view, (9.0, 30.0), (-0.4, 12.0), 8.0)),
        ("bottom", pixel_panel(view, (25.0, 44.0), (h - 14.0, h - 0.6), 6.0)),
        ("last column", pixel_panel(view, (w - 1.3, w - 0.6), (2.0, 8.0), 6.0)),
        ("last row", pixel_panel(view, (4.0, 9.0), (h - 1.3, h - 0.6), 6.0)),
    ]
    return case(objects, [view, rolled(view, math.pi)])


@_scene("what shows through a gap of a pixel is drawn", "low-resolution depth")
def gap_narrower_than_a_texel(rng: np.random.Generator) -> Case:
    view = camera()
    objects, views = [], [view]
    for row in range(6):
        y = (8.0 * row - 0.45, 8.0 * row + 7.55)
        gap, wide = float(rng.integers(8, 56)), float(rng.uniform(0.3, 1.4))
        left = pixel_panel(view, (-1.0, gap - 0.3), y, 5.0)
        right = pixel_panel(view, (gap + wide, 65.0), y, 5.0)
        flag = pixel_panel(view, (5.0, 5.3), (y[0] + 3.0, y[0] + 3.3), 1.0)
        objects.append(("occluders", together(left, right, flag)))
        middle = (y[0] + 2.0, y[0] + 6.0)
        objects.append(("in the gap", pixel_panel(view, (gap - 5.0, gap + 6.0), middle, 8.0)))
        objects.append(("hidden", pixel_panel(view, (gap + 3.0, gap + 9.0), middle, 9.0)))
    return case(objects, [*views, rolled(view, math.pi / 2)])


@_scene("what shows beside a stack of half-covering sheets is drawn", "last batch of queries lost")
def stacks_of_sheets(rng: np.random.Generator) -> Case:
    view = camera()
    objects = []
    for column in range(4):
        for row in range(3):
            left, top = 16.0 * column + 1.2, 16.0 * row + 1.2
            right, bottom = left + 13.0, top + 13.0
            # Triangles that all leave the lower right half open, though their rectangles do not.
            for sheet in range(7):
                depth = 4.0 + 0.5 * sheet + rng.uniform(0.0, 0.4)
                inset = 0.2 * sheet
                corners = [(left + inset, top + inset), (left + inset, bottom - inset)]
                corners.append((right - inset, top + inset))
                points = np.array([pixel_point(view, x, y, depth) for x, y in corners])
                objects.append(("sheet", (points, np.array([[0, 1, 2]]))))
            x, y = rng.uniform((left + 8.0, top + 8.0), (left + 9.0, top + 9.0))
            seen = pixel_panel(view, (x, x + 2.0), (y, y + 2.0), 9.0)
            objects.append(("beside", seen))
    return case(objects, [view, rolled(view, math.pi)])


@_scene("a large object at the screen's edge is drawn", "distance compared with depth")
def large_object_at_the_edge(rng: np.random.Generator) -> Case:
    # The walls hang on flags near the eye, so that they come first from front to back; their
    # nearest corners are less far away than the objects before them.
    flag = panel((-0.2, 0.2), (-0.2, 0.2), -1.0)
    objects = [
        ("wall", together(panel((-30.0, -1.0), (-6.5, 6.5), -10.0), flag)),
        ("wall", together(panel((1.0, 30.0), (-6.5, 6.5), -10.0), flag)),
        ("post", box((-9.2, -1.0, -7.5), (-8.8, 1.0, -7.0))),
        ("left", box((-16.0, -5.0, -9.5), (-11.0, 5.0, -8.5))),
        ("right", panel((10.5, 15.0), (-5.0, 5.0), -9.0)),
        ("corner", panel((-15.0, -12.0), (4.5, 5.5), -9.9)),
        ("behind", box((3.0, -5.0, -15.0), (9.0, 5.0, -12.0))),
    ]
    views = [camera(yfov=1.8), camera(yfov=1.8, width=48, height=64)]
    return case(objects, [*views, rolled(views[0], 0.4)])


@_scene("posters just before a wall are drawn", "coarse or badly rounded depth")
def posters_on_a_wall(rng: np.random.Generator) -> Case:
    objects = []
    walls = [(15.5, (0.0, 20.0)), (60.0, (22.0, 41.0)), (150.0, (43.0, 63.0))]
    view = camera()
    for depth, (left, right) in walls:
        wall = pixel_panel(view, (left, right), (0.0, 47.0), depth)
        flag = pixel_panel(view, (left, left + 0.3), (0.0, 0.3), 2.0)
        objects.append(("wall", together(wall, flag)))
        for row in range(8):
            y = (6.0 * row + 0.6, 6.0 * row + 4.6)
            x = left + 2.0 + 0.4 * row
            before = depth * (1.0 - 10.0 ** rng.uniform(-3.5, -2.0))
            objects.append(("poster", pixel_panel(view, (x, x + 12.0), y, before)))
        hidden = pixel_panel(view, (left + 3.0, right - 3.0), (5.0, 40.0), 1.02 * depth)
        objects.append(("hidden", hidden))
    return case(objects, [view])


@_scene("plates turned and mirrored show beyond their occluder", "two corners transformed")
def rotated_and_mirrored_plates(rng: np.random.Generator) -> Case:
    flag = panel((-0.05, 0.05), (-0.05, 0.05), -1.0)
    objects = [("pole", together(panel((-0.5, 0.5), (-8.0, 8.0), -6.0), flag))]
    for index, angle in enumerate((math.pi / 4, -math.pi / 4, math.pi / 4 + 0.1)):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        points, faces = panel((-1.5, 1.5), (-1.5, 1.5), -8.0 - index)
        points[:, :2] = points[:, :2] @ turn.T + (0.0, 3.5 * index - 3.5)
        if index == 1:
            points[:, 0], faces = -points[:, 0], faces[:, ::-1]
        objects.append(("plate", (points, faces)))
    objects.append(("hidden", panel((-0.4, 0.4), (-1.0, 1.0), -9.0)))
    return case(objects, [camera(), rolled(camera(), math.pi / 4)])


@_scene("of objects at one depth, one is drawn at every sample", "strict test against own depth")
def coplanar_ties(rng: np.random.Generator) -> Case:
    objects = [
        ("twin", box((-3.0, -1.0, -8.0), (-1.0, 1.0, -6.0))),
        ("twin", box((-3.0, -1.0, -8.0), (-1.0, 1.0, -6.0))),
        ("tile", panel((0.0, 2.0), (-1.0, 1.0), -6.0)),
        ("tile", panel((1.0, 3.0), (-0.5, 1.5), -6.0)),
        ("tile", panel((0.5, 1.5), (-0.5, 0.5), -6.0)),
        ("touching", box((-1.0, -1.0, -8.0), (0.0, 1.0, -6.0))),
        ("hidden", box((-2.5, -0.5, -12.0), (2.0, 0.5, -9.0))),
    ]
    return case(objects, [camera(), camera((0.5, 0.2, 1.0))])


@_scene("objects that pierce each other are drawn", "whole objects ordered by depth")
def interpenetrating_objects(rng: np.random.Generator) -> Case:
    # With a flag near the eye, so that it comes first from front to back.
    core = together(
        box((-1.5, -1.5, -9.5), (1.5, 1.5, -6.5)), panel((0.0, 0.02), (0.0, 0.02), -1.0)
    )
    objects = [("core", core)]
    objects.append(("swallowed", box((-1.0, -1.0, -9.0), (1.0, 1.0, -7.0))))
    for axis in range(3):
        for sign in (-1.0, 1.0):
            low, high = np.full(3, -0.4), np.full(3, 0.4)
            reach = rng.uniform(1.6, 2.5)
            low[axis], high[axis] = min(0.0, sign * reach), max(0.0, sign * reach)
            centre = np.array([0.0, 0.0, -8.0])
            objects.append(("spike", box(centre + low, centre + high)))
    views = [camera((0.13, 0.07, 0.0)), camera((5.0, 4.0, -2.0), (0.0, 0.0, -8.0))]
    return case(objects, views)


@_scene("a grazing view over one huge triangle misses nothing", "enormous, behind the eye")
def huge_grazing_triangle(rng: np.random.Generator) -> Case:
    corners = np.array([[-1.0e5, 0.0, 1.0e5], [1.0e5, 0.0, 1.0e5], [0.0, 0.0, -2.0e5]])
    objects = [("plain", (corners, np.array([[0, 1, 2]])))]
    for _ in range(10):
        x, z = rng.uniform(-12.0, 12.0), rng.uniform(-40.0, -8.0)
        objects.append(("stone", box((x - 0.5, 0.0, z - 0.5), (x + 0.5, 0.6, z + 0.5))))
        objects.append(("buried", box((x, -2.0, z), (x + 0.5, -0.5, z + 0.5))))
    views = [camera((0.0, height, 0.0)) for height in (0.05, 1.0, 3.0)]
    return case(objects, views)


@_scene(
    "a wall that comes nearer towards the image's edge is drawn",
    "the depth of the point that is nearest by distance",
)
def slanting_wall_before_a_screen(rng: np.random.Generator) -> Case:
    """The wall's nearest point by distance is straight ahead of its plane, at depth 7.1; in the
    image it reaches from depth 5.7 on, and a screen at 6.4 hides all but that end."""
    objects, views = [], []
    for side in (1.0, -1.0):
        # Each view has a place of its own.
        place = 500.0 * side
        view = camera((place, 0.0, 0.0), (place + side, 0.0, -1.0), yfov=1.8)
        left, right = sorted((place - 2.0 * side, place + 9.0 * side))
        wall = box((left, -1.0, -10.5), (right, 1.0, -10.0))
        # It hangs on a flag near the eye, so that it comes first from front to back.
        screen = pixel_panel(view, (-1.0, 64.0), (-1.0, 48.0), 6.4)
        flag = pixel_panel(view, (31.0, 31.2), (2.0, 2.2), 1.0)
        x = 30.0 + rng.uniform(-8.0, 8.0)
        hidden = pixel_panel(view, (x, x + 4.0), (20.0, 24.0), 30.0)
        objects += [("wall", wall), ("screen", together(screen, flag)), ("hidden", hidden)]
        views.append(view)
    return case(objects, views)
