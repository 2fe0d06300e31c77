"""Conformance scenes for cullers that remember: what was hidden comes into view.

What such a culler hides things behind may be what it saw in the frame before. So the camera first
looks aside, at a wall and at what stands behind it, and then at what the wall does not quite hide:
both are remembered, and what shows is not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from visref.camera import Camera
from visref.conformance.building import (
    Case,
    Mesh,
    SceneMaker,
    box,
    camera,
    case,
    panel,
    pixel_panel,
    pixel_point,
    register_in,
    together,
)
from visref.scene import Alpha

REVEALED: list[SceneMaker] = []

_scene = register_in(REVEALED)

WIDTH, HEIGHT = 96, 72
_WALL_DEPTH = 5.0
# To the right of the image lies as much again, with a hole through which the backing shows.
_ASIDE_PX = 128
_ASIDE_HOLE = (WIDTH + 80, 30)

# Panels behind the wall, x0, y0, x1, y1 in pixels, inclusive, and the one pixel at which each
# shows. Their sides are powers of two and one more, so that what is counted one short, or from the
# wrong corner, loses the pixel; some reach beyond the image.
_PANELS: dict[str, tuple[tuple[int, int, int, int], tuple[int, int]]] = {
    "a pixel": ((60, 40, 60, 40), (60, 40)),
    "a second pixel": ((66, 36, 66, 36), (66, 36)),
    "a third pixel": ((54, 44, 54, 44), (54, 44)),
    "a fourth pixel": ((73, 42, 73, 42), (73, 42)),
    "first pixel": ((0, 0, 5, 5), (0, 0)),
    "last pixel": ((91, 66, 95, 71), (95, 71)),
    "row, last corner": ((13, 2, 82, 10), (82, 10)),
    "row, middle": ((66, 14, 82, 19), (74, 16)),
    "column, last corner": ((2, 25, 6, 64), (6, 64)),
    "square, last corner": ((12, 20, 20, 28), (20, 28)),
    "square, first corner": ((30, 20, 38, 28), (30, 20)),
    "square, upper right": ((30, 32, 38, 40), (38, 32)),
    "square, lower left": ((12, 32, 20, 40), (12, 40)),
    "flat, middle": ((45, 16, 61, 27), (53, 22)),
    "over the left edge": ((-6, 10, 4, 20), (1, 15)),
    "over the right edge": ((88, 30, 103, 45), (92, 40)),
    "over the lower edge": ((30, 60, 50, 80), (40, 70)),
    "over the upper edge": ((86, -9, 92, 3), (90, 2)),
}


def _coming_back(view: Camera) -> list[Camera]:
    """Aside, back, and the same again."""
    aside = replace(view, shift_x_px=float(_ASIDE_PX))
    return [aside, view, aside, view]


def _pierced_wall(view: Camera, holes: set[tuple[int, int]]) -> Mesh:
    """A wall over the image and what lies aside, but for single pixels; its edges run between
    samples."""
    holes = holes | {_ASIDE_HOLE}
    parts = []
    y = 0
    while y < HEIGHT:
        columns = sorted(x for x, row in holes if row == y)
        height = 1
        while not columns and y + height < HEIGHT and not any(r == y + height for _, r in holes):
            height += 1
        low, high = y - 0.5 - 9.0 * (y == 0), y + height - 0.5 + 9.0 * (y + height == HEIGHT)
        sides = [
            -9.0,
            *(side for x in columns for side in (x - 0.5, x + 0.5)),
            WIDTH + 2.0 * _ASIDE_PX,
        ]
        for left, right in zip(sides[::2], sides[1::2], strict=True):
            parts.append(pixel_panel(view, (left, right), (low, high), _WALL_DEPTH))
        y += height
    return together(*parts)


def _backing(view: Camera) -> tuple[Mesh, Callable[[float, float], float]]:
    """A slanted plate behind the wall, over all that can be seen, and its depth at a pixel."""
    depth_of_left, depth_of_right = 12.0, 40.0
    left, right = -20.0, WIDTH + 2.0 * _ASIDE_PX
    corners = [(left, HEIGHT + 20.0, depth_of_left), (right, HEIGHT + 20.0, depth_of_right)]
    corners += [(right, -20.0, depth_of_right), (left, -20.0, depth_of_left)]
    points = np.array([pixel_point(view, *corner) for corner in corners])

    def depth(x: float, y: float) -> float:
        # Of a plane, the reciprocal of depth is linear over the image.
        share = (x - left) / (right - left)
        return 1.0 / ((1.0 - share) / depth_of_left + share / depth_of_right)

    return (points, np.array([[0, 1, 2], [0, 2, 3]])), depth


@_scene(
    "what shows through a hole of one pixel is drawn when it comes into view",
    "a rectangle, a square or a depth rounded the wrong way, where memory chooses the occluders",
)
def revealed_by_a_pierced_wall(rng: np.random.Generator) -> Case:
    view = camera(width=WIDTH, height=HEIGHT)
    backing, depth = _backing(view)
    holes = {hole for _, hole in _PANELS.values()}
    objects = [("wall", _pierced_wall(view, holes)), ("backing", backing)]
    for number, (name, ((x0, y0, x1, y1), hole)) in enumerate(_PANELS.items()):
        # Just before the backing: by less than a coarse depth buffer tells apart, and by far more
        # than 24 bits do (1e-5 of these depths).
        at = depth(*hole) - 0.004 * 1.2**number
        objects.append((name, pixel_panel(view, (x0 - 0.3, x1 + 0.3), (y0 - 0.3, y1 + 0.3), at)))
    for number in range(12):
        x, y = rng.uniform(20.0, 70.0), rng.uniform(46.0, 56.0)
        objects.append((f"hidden{number}", pixel_panel(view, (x, x + 6), (y, y + 2), 20.0)))
    return case(objects, _coming_back(view))


@_scene(
    "a panel that leans away shows by its near end and is drawn when it comes into view",
    "a depth that is not the box's least",
)
def revealed_leaning_panels(rng: np.random.Generator) -> Case:
    view = camera(width=WIDTH, height=HEIGHT)
    backing, depth = _backing(view)
    holes: set[tuple[int, int]] = set()
    objects = [("backing", backing)]
    for number, (x, y) in enumerate((x, y) for x in range(3, 84, 18) for y in (4, 34, 64)):
        # The left end is near and shows by its first column; the right end lies behind all.
        near, far = depth(x, y) - 0.5, 30.0
        ends = [(x - 0.3, y + 3.3, near), (x + 12.3, y + 3.3, far)]
        ends += [(x + 12.3, y - 0.3, far), (x - 0.3, y - 0.3, near)]
        points = np.array([pixel_point(view, *end) for end in ends])
        objects.append((f"panel{number}", (points, np.array([[0, 1, 2], [0, 2, 3]]))))
        holes.add((x, y + 1))
    objects.append(("wall", _pierced_wall(view, holes)))
    objects.append(("hidden", pixel_panel(view, (40.0, 50.0), (20.0, 26.0), 25.0)))
    return case(objects, _coming_back(view))


@_scene(
    "what reaches behind the eye is drawn when it comes into view",
    "corners behind the eye projected as if they lay before it",
)
def revealed_across_the_near_plane(rng: np.random.Generator) -> Case:
    inside, elsewhere = camera((0.0, 0.0, 0.0)), camera((0.0, 0.0, 0.0), (30.0, 0.0, -9.0))
    ahead = box((-40.0, -30.0, -32.0), (40.0, 30.0, -30.0))
    aside = box((38.0, -30.0, -40.0), (40.0, 30.0, 40.0))
    objects = [
        ("wall", together(ahead, aside)),
        ("floor", box((-9.0, -3.0, -45.0), (6.0, -2.0, 15.0))),
        ("ceiling", box((-9.0, 4.0, -45.0), (6.0, 5.0, 3.0))),
        ("beam", box((-3.0, 0.5, -45.0), (-2.0, 1.5, 25.0))),
        ("pillar", box((1.0, -9.0, -45.0), (1.5, 9.0, 0.5))),
        ("hidden", box((-3.0, -3.0, -36.0), (3.0, 3.0, -34.0))),
    ]
    return case(objects, [elsewhere, inside, elsewhere, inside])


@_scene(
    "what lies behind glass is drawn when it comes into view, and the glass too",
    "glass remembered as an occluder",
)
def revealed_behind_glass(rng: np.random.Generator) -> Case:
    view = camera()
    right = camera((6.0, 0.0, 0.0))
    objects = [
        ("glass", panel((-30.0, 30.0), (-9.0, 9.0), -4.0)),
        ("curtain", panel((1.0, 5.0), (-3.0, 3.0), -3.0)),
        ("poster", panel((-1.5, -0.5), (-1.0, 1.0), -8.0)),
        ("wall", panel((3.0, 30.0), (-9.0, 9.0), -6.0)),
        ("hidden", panel((9.0, 12.0), (-2.0, 2.0), -9.0)),
    ]
    return case(objects, [right, view, right, view], alpha={"glass": Alpha.BLEND})
