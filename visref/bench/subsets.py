"""Nested subsets of a frame's own samples, as cameras.

Every n-th sample of a camera in x and in y, from (i, j) on, is the whole lattice of another camera
of (w / n, h / n) samples with its lens shifted. For n a power of two its step tan(yfov / 2) /
(h / n) is n s exactly, so R' = n R and U' = n U to the last bit, and with x = n X + i

    a' = 2 (X + shift') + 1 - w / n = a / n    for    shift' = (2 i + 2 shift + 1 - n) / (2 n)

likewise for y. So a' R' = a R bit for bit: the same rays, not those of a smaller picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from visref.camera import Camera

ALL = 16
# By how many sixteenths of the samples: n, and the sublattices' first samples. Each holds those
# before it and is evenly spread: a half is a chequerboard, a quarter every second sample.
SUBSETS: dict[int, tuple[int, tuple[tuple[int, int], ...]]] = {
    1: (4, ((0, 0),)),
    2: (4, ((0, 0), (2, 2))),
    4: (2, ((0, 0),)),
    8: (2, ((0, 0), (1, 1))),
    ALL: (1, ((0, 0),)),
}
MULTIPLE = 4


@dataclass(frozen=True, eq=False)
class Sublattice:
    """The samples (step X + x, step Y + y) of a camera, as a camera of their own."""

    camera: Camera
    x: int
    y: int
    step: int


def nested_subsets(camera: Camera) -> dict[int, list[Sublattice]] | None:
    """The sublattices of each subset, by sixteenths; None where they would not be the same samples:
    sides that 4 does not divide, or a lens shift of which a part rounds."""
    if camera.width % MULTIPLE or camera.height % MULTIPLE:
        return None
    subsets = {
        sixteenths: [Sublattice(_every(camera, step, x, y), x, y, step) for x, y in starts]
        for sixteenths, (step, starts) in SUBSETS.items()
    }
    if not all(_same(camera, part) for parts in subsets.values() for part in parts):
        return None
    return subsets


def _every(camera: Camera, step: int, x: int, y: int) -> Camera:
    if step == 1:
        return camera
    return replace(
        camera,
        width=camera.width // step,
        height=camera.height // step,
        shift_x_px=(2.0 * x + 2.0 * camera.shift_x_px + 1.0 - step) / (2.0 * step),
        shift_y_px=(2.0 * y + 2.0 * camera.shift_y_px + 1.0 - step) / (2.0 * step),
    )


def _same(camera: Camera, part: Sublattice) -> bool:
    """Whether the sublattice's rays are the camera's, bit for bit."""
    own, step = part.camera, part.step
    return (
        np.array_equal(own.column_a * step, camera.column_a[part.x :: step])
        and np.array_equal(own.row_b * step, camera.row_b[part.y :: step])
        and np.array_equal(own.right_step, camera.right_step * step)
        and np.array_equal(own.up_step, camera.up_step * step)
    )
