"""More scenes of `visref.conformance`: layers of height-field tiles, one under the other.

Terrain, the horizons of a seismic survey, storeys: sheets that are open, seen from both sides,
and hide almost all of each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from visref.conformance.building import (
    Case,
    Mesh,
    SceneMaker,
    camera,
    case,
    panel,
    pixel_panel,
    register_in,
    together,
)
from visref.scene import Alpha

LAYERS: list[SceneMaker] = []

_scene = register_in(LAYERS)


def _tile(
    rng: np.random.Generator, x: tuple[float, float], z: tuple[float, float], y: float
) -> Mesh:
    """A rough sheet of 5 by 5 quads about height y, one of them missing."""
    side = 6
    grid = np.empty((side, side, 3))
    grid[..., 0] = np.linspace(*x, side)[:, None]
    grid[..., 2] = np.linspace(*z, side)[None]
    grid[..., 1] = y + rng.uniform(-0.25, 0.25, (side, side))
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1)
    corner = np.delete(corner, rng.integers(len(corner)))
    a, b, c, d = corner, corner + 1, corner + side + 1, corner + side
    return grid.reshape(-1, 3), np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


@_scene("what shows through the gaps of torn layers is drawn", "stand-ins without the gaps")
def torn_layers(rng: np.random.Generator) -> Case:
    objects = []
    for layer in range(4):
        y = -2.0 - 2.0 * layer
        for i in range(4):
            for j in range(4):
                x, z = (-8.0 + 4.0 * i, -4.0 + 4.0 * i), (-4.0 - 4.0 * j, -4.0 * j)
                objects.append((f"tile {layer} {i} {j}", _tile(rng, x, z, y)))
    objects.append(("fault", (np.array([[2.0, -10, 0], [3, -1, 0], [3.5, -1, -9], [2.5, -10, -9]]),
                              np.array([[0, 1, 2], [0, 2, 3]]))))  # fmt: skip
    for number in range(3):
        slice_ = panel((-3.0, 1.0), (-7.0, -0.5), -5.0 - number)
        objects.append((f"volume slice {number}", slice_))
    views = [
        camera((0.0, 2.0, 3.0), (0.0, -3.0, -8.0)),
        camera((-1.0, -3.0, 0.5), (0.5, -3.2, -8.0)),  # between the first two layers
        camera((-1.0, -3.0, -5.0), (2.0, -3.1, -12.0), cut=True),
        camera((0.0, -11.0, -8.0), (0.0, -5.0, -9.0)),  # from below
    ]
    materials = {f"volume slice {number}": Alpha.BLEND for number in range(3)}
    return case(objects, views, alpha=materials)


@_scene("what one pixel shows is drawn, whatever the image's sides", "small image, other aspect")
def hole_of_a_pixel(rng: np.random.Generator) -> Case:
    """Each view has a place of its own: a wall that leaves one pixel open, and a dot behind it."""
    objects, views = [], []
    sizes = [(9, 5), (13, 9), (5, 13), (7, 11), (17, 6)]
    for number in range(25):
        width, height = sizes[number % len(sizes)]
        view = camera((1000.0 * number, 0.0, 0.0), width=width, height=height)
        x, y = float(rng.integers(width)), float(rng.integers(height))
        wide, high = (-1.0, width + 0.0), (-1.0, height + 0.0)
        wall = [
            pixel_panel(view, (wide[0], x - 0.3), high, 5.0),
            pixel_panel(view, (x + 0.3, wide[1]), high, 5.0),
            pixel_panel(view, (x - 0.3, x + 0.3), (high[0], y - 0.3), 5.0),
            pixel_panel(view, (x - 0.3, x + 0.3), (y + 0.3, high[1]), 5.0),
        ]
        objects.append(("wall", together(*wall)))
        dot = pixel_panel(view, (x - 0.1, x + 0.1), (y - 0.1, y + 0.1), 8.0)
        objects.append(("dot", dot))
        aside = x + 3.0 if x < width / 2 else x - 3.0
        objects.append(("hidden", pixel_panel(view, (aside - 0.2, aside), (y, y + 0.2), 9.0)))
        views.append(replace(view, cut=True))
    return case(objects, views)
