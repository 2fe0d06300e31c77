"""Ground with heights, of exactly as many triangles as asked, and a walk above it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from visref_datasets_gen.graph import Node
from visref_datasets_gen.shapes import EMPTY, Float64, Soup, merge, quads
from visref_datasets_gen.stock import plain

Height = Callable[[Float64, Float64], Float64]  # y from x and z


@dataclass(frozen=True)
class Winding:
    """A walk along x through the middle of a square, swaying along z, above the ground.

    `reach`: how far it goes from the middle, as a share of the side; a long walk in a small
    country turns round, to and fro. `sway_m`: to either side, once in `2 pi * bend_m` of the way.
    """

    step_m: float
    reach: float
    sway_m: float
    bend_m: float
    eye_m: float

    def steps(
        self, side: float, frames: int, height: Height
    ) -> Iterator[tuple[float, Float64, Float64]]:
        """For each frame: metres gone, counted from the middle of the walk; the eye, (3,)
        float64; and the way it goes, (3,) float64, level and of length 1."""
        s = self.step_m * (np.arange(frames + 1) - frames / 2.0)
        reach = self.reach * side
        x = side / 2.0 + reach * np.sin(s / reach)
        z = side / 2.0 + self.sway_m * np.sin(s / self.bend_m)
        for k in range(frames):
            eye = np.array([x[k], float(height(x[k], z[k])) + self.eye_m, z[k]])
            ahead = np.array([x[k + 1] - x[k], 0.0, z[k + 1] - z[k]])
            yield float(s[k]), eye, ahead / np.linalg.norm(ahead)


def patch(
    low: tuple[float, float], high: tuple[float, float], triangles: int, height: Height
) -> Soup:
    """A piece of ground between two (x, z) corners, seen from above, of `triangles` triangles.

    Rows of quads of two triangles each; an odd one out makes three of the last quad, by a
    point on its outer side.
    """
    if triangles < 2:
        if not triangles:
            return EMPTY
        corner = np.array([[low[0], 0.0, low[1]], [low[0], 0.0, high[1]], [high[0], 0.0, low[1]]])
        corner[:, 1] = height(corner[:, 0], corner[:, 2])
        return corner, np.array([[0, 1, 2]])
    count = triangles // 2
    columns = math.isqrt(count)
    rows = -(-count // columns)
    place = np.arange(count)
    # A last row that is not full is cut into wider quads.
    last = count - (rows - 1) * columns
    row = place // columns
    in_row = np.where(row == rows - 1, last, columns)
    x = low[0] + (high[0] - low[0]) * np.stack(
        [(place - row * columns) / in_row, (place - row * columns + 1) / in_row], axis=1
    )
    z = low[1] + (high[1] - low[1]) * np.stack([row / rows, (row + 1) / rows], axis=1)
    corners = np.empty((count, 4, 3))
    for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (1, 0))):
        corners[:, k, 0], corners[:, k, 2] = x[:, i], z[:, j]
    corners[..., 1] = height(corners[..., 0], corners[..., 2])
    if triangles % 2 == 0:
        return quads(corners)
    a, b, c, d = corners[-1]
    points = np.array([a, b, (b + c) / 2.0, c, d])
    return merge([quads(corners[:-1]), (points, np.array([[2, 3, 4], [2, 4, 0], [2, 0, 1]]))])


def ground(tiles: int, side_m: float, triangles: int, height: Height) -> list[Node]:
    """A square of `tiles` by `tiles` patches of earth from the origin on, `side_m` wide and of so
    many triangles each."""
    nodes = []
    for j in range(tiles):
        for i in range(tiles):
            low, high = (i * side_m, j * side_m), ((i + 1) * side_m, (j + 1) * side_m)
            name = f"ground-{i}-{j}"
            soup = patch(low, high, triangles, height)
            nodes.append(Node(name, plain(name, {"earth": soup})[0]))
    return nodes
