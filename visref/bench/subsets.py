"""Nested subsets of a frame's own samples, as cameras.

Every fourth sample of a camera in x and in y is the whole grid of another: (w / 4, h / 4)
samples, the lens shifted. Its s' = tan(yfov / 2) / (h / 4) is 4 s exactly (a power of two more),
so R' = 4 R and U' = 4 U to the last bit, and with x = 4 X + i

    a' = 2 (X + shift') + 1 - w / 4 = a / 4    for    shift' = (2 i + 2 shift - 3) / 8

likewise for y. So a' R' = a R bit for bit: the same rays, not those of a smaller picture. The 16
such grids are taken in the order of a Bayer matrix, which spreads each subset evenly.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from visref.camera import Camera

SIDE = 4
GRIDS = SIDE * SIDE
# How many of the 16 grids; each subset holds those before it.
SIXTEENTHS = (1, 2, 4, 8, 16)
# (x, y) of each grid's first sample, so that every power of two of them is evenly spread.
OFFSETS = (
    *((0, 0), (2, 2), (2, 0), (0, 2), (1, 1), (3, 3), (3, 1), (1, 3)),
    *((1, 0), (3, 2), (3, 0), (1, 2), (0, 1), (2, 3), (2, 1), (0, 3)),
)


def nested_grids(camera: Camera) -> tuple[Camera, ...] | None:
    """The camera's 16 interleaved grids in nested order; None where they would not be the same
    samples: sides that 4 does not divide, or a lens shift whose quarter rounds."""
    if camera.width % SIDE or camera.height % SIDE:
        return None
    grids = []
    for x, y in OFFSETS:
        grid = replace(
            camera,
            width=camera.width // SIDE,
            height=camera.height // SIDE,
            shift_x_px=(2.0 * x + 2.0 * camera.shift_x_px - 3.0) / 8.0,
            shift_y_px=(2.0 * y + 2.0 * camera.shift_y_px - 3.0) / 8.0,
        )
        same = (
            np.array_equal(grid.column_a * SIDE, camera.column_a[x::SIDE])
            and np.array_equal(grid.row_b * SIDE, camera.row_b[y::SIDE])
            and np.array_equal(grid.right_step, camera.right_step * SIDE)
            and np.array_equal(grid.up_step, camera.up_step * SIDE)
        )
        if not same:
            return None
        grids.append(grid)
    return tuple(grids)
