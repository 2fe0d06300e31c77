"""The compiled loops that place a mesh's instances in a scene, of which NumPy would make a dozen
passes over scratch memory many times as large."""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from visref.compiled import njit

# Of float32.
LARGEST = 3.4028234663852886e38


@njit(error_model="numpy")
def place_vertices(
    points: NDArray[Any],
    worlds: NDArray[Any],
    users: NDArray[Any],
    starts: NDArray[Any],
    origin: NDArray[Any],
    vertices: NDArray[Any],
    moved: NDArray[Any],
    moved_bits: NDArray[Any],
) -> None:
    """A mesh's points, (p, 3) float64, under `worlds[user]`, (4, 4) float64, of each of its users,
    less the origin, from row `starts[user]` of `vertices` on, (v, 3) float32; in `moved`, (v,)
    float32, how far rounding moved each, rounded up. `moved_bits` is the same memory as int32.

    As `visref.formats.placed.transformed`, sum for sum in the same order."""
    for user in users:
        world, row = worlds[user], starts[user]
        for point in range(len(points)):
            x, y, z = points[point, 0], points[point, 1], points[point, 2]
            squares = 0.0
            for axis in range(3):
                along = world[axis, 0] * x + world[axis, 1] * y + world[axis, 2] * z
                exact = (along + world[axis, 3]) - origin[axis]
                vertices[row, axis] = exact
                off = exact - vertices[row, axis]
                squares += off * off
            distance = math.sqrt(squares)
            moved[row] = 0.0
            if distance > 0.0:
                moved[row] = distance
                # Outward: the next float32 above, whose bits are the next whole number.
                if moved[row] <= LARGEST:
                    moved_bits[row] += 1
            row += 1


@njit()
def place_triangles(
    faces: NDArray[Any],
    flags: tuple[NDArray[Any], NDArray[Any]],
    users: NDArray[Any],
    mirrored: NDArray[Any],
    vertex_starts: NDArray[Any],
    starts: NDArray[Any],
    triangles: NDArray[Any],
    placed_flags: tuple[NDArray[Any], NDArray[Any]],
) -> None:
    """A mesh's triangles, (f, 3) int64, over the vertices of each of its users, from row
    `starts[user]` of `triangles` on, (t, 3) int32, the other way round where it is mirrored; and
    their two flags, (f,) uint8 each."""
    for user in users:
        base, row = vertex_starts[user], starts[user]
        first, last = (2, 0) if mirrored[user] else (0, 2)
        for face in range(len(faces)):
            triangles[row, first] = faces[face, 0] + base
            triangles[row, 1] = faces[face, 1] + base
            triangles[row, last] = faces[face, 2] + base
            placed_flags[0][row] = flags[0][face]
            placed_flags[1][row] = flags[1][face]
            row += 1
