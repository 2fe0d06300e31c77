"""A masked depth buffer: for each tile of 8 x 4 pixels two depths and a mask.

All pixels of a tile have an occluder no farther than its first depth; those in the mask have one no
farther than the second, which is nearer. A triangle joins the pixels that it covers to the mask,
and its greatest depth there to the second layer; once the mask is full, that layer becomes the
first. Depths are view depths, rounded up to float32; a layer that says nothing is infinitely far.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Float32
from visref_culling.queries.software_depth import Mesh, Rays, covers, rounded_up, set_up, work

TILE_X, TILE_Y = 8, 4


class MaskedBuffer(NamedTuple):
    """(rows, columns) of tiles each: `mask` and `full` uint32, bit 8 y + x a pixel of the tile,
    `full` those within the image; `reference`, `working` float32, the layers' depths."""

    mask: NDArray[np.uint32]
    full: NDArray[np.uint32]
    reference: Float32
    working: Float32

    @classmethod
    def of(cls, width: int, height: int) -> MaskedBuffer:
        """An empty one for an image of that size."""
        shape = -(-height // TILE_Y), -(-width // TILE_X)
        y, x = np.mgrid[: shape[0] * TILE_Y, : shape[1] * TILE_X]
        inside = ((y < height) & (x < width)).reshape(shape[0], TILE_Y, shape[1], TILE_X)
        bits = np.uint32(1) << np.arange(TILE_X * TILE_Y, dtype=np.uint32)
        by_tile = inside.transpose(0, 2, 1, 3).reshape(*shape, -1)
        full = (by_tile * bits).sum(axis=2).astype(np.uint32)
        nothing = np.full(shape, np.inf, np.float32)
        return cls(np.zeros(shape, np.uint32), full, nothing, nothing.copy())

    def clear(self) -> None:
        self.mask.fill(0)
        self.reference.fill(np.inf)
        self.working.fill(np.inf)

    def bounds(self, width: int, height: int) -> Float32:
        """(height, width) float32: how far each pixel's nearest occluder is at most."""
        bits = np.uint32(1) << np.arange(TILE_X * TILE_Y, dtype=np.uint32)
        masked = (self.mask[:, :, None] & bits) != 0
        depth = np.where(masked, self.working[:, :, None], self.reference[:, :, None])
        rows, columns = self.mask.shape
        image = depth.reshape(rows, columns, TILE_Y, TILE_X).transpose(0, 2, 1, 3)
        return image.reshape(rows * TILE_Y, columns * TILE_X)[:height, :width].astype(np.float32)


@njit()
def decide(
    mesh: Mesh,
    rays: Rays,
    offsets: NDArray[Any],
    triangles: NDArray[Any],
    ids: NDArray[Any],
    rectangles: NDArray[Any],
    nearest: NDArray[Any],
    sure: NDArray[Any],
    least_px: int,
    buffer: MaskedBuffer,
    shown: NDArray[Any],
) -> int:
    """Units in order, each shown unless the buffer hides its rectangle, and then rasterised.

    `offsets`, `triangles`: the units'; `ids`: (k,) units, `rectangles`: (k, 4) pixels x0, y0, x1,
    y1, inclusive, `nearest`: (k,) view depths, `sure`: (k,) bool, shown without asking; `shown`:
    (k,) bool, the result. A unit whose rectangle has fewer than `least_px` pixels hides nothing.
    Returns how many tiles were looked at.
    """
    room = work()
    shape = len(rays.row_b), len(rays.column_a)
    looked_at = 0
    for k in range(len(ids)):
        x0, y0, x1, y1 = rectangles[k]
        visible = sure[k]
        if not visible:
            visible, tiles = _shows(buffer, x0, y0, x1, y1, nearest[k])
            looked_at += tiles
        shown[k] = visible
        if visible and (sure[k] or (x1 - x0 + 1) * (y1 - y0 + 1) >= least_px):
            for place in range(offsets[ids[k]], offsets[ids[k] + 1]):
                _add(mesh, rays, triangles[place], shape, room, buffer)
    return looked_at


@njit()
def _shows(buffer: MaskedBuffer, x0: int, y0: int, x1: int, y1: int, nearest: float) -> Any:
    """Whether a box of that rectangle and least depth may be seen, and how many tiles say so."""
    tiles = 0
    for row in range(y0 // TILE_Y, y1 // TILE_Y + 1):
        for column in range(x0 // TILE_X, x1 // TILE_X + 1):
            tiles += 1
            mask = buffer.mask[row, column]
            if nearest > buffer.reference[row, column]:
                continue
            if mask == 0:
                return True, tiles
            asked = _pixels(row, column, x0, y0, x1, y1)
            if asked & ~mask != 0 or nearest <= buffer.working[row, column]:
                return True, tiles
    return False, tiles


@njit()
def _pixels(row: int, column: int, x0: int, y0: int, x1: int, y1: int) -> Any:
    """A tile's pixels within a rectangle, as bits."""
    bits = np.uint32(0)
    for y in range(max(y0 - row * TILE_Y, 0), min(y1 - row * TILE_Y, TILE_Y - 1) + 1):
        for x in range(max(x0 - column * TILE_X, 0), min(x1 - column * TILE_X, TILE_X - 1) + 1):
            bits |= np.uint32(1) << np.uint32(TILE_X * y + x)
    return bits


@njit()
def _add(
    mesh: Mesh, rays: Rays, triangle: int, shape: tuple[int, int], room: Any, buffer: MaskedBuffer
) -> None:
    """Rasterise one triangle."""
    hides, (x0, x1, y0, y1), volume, doubt_volume = set_up(mesh, rays, triangle, shape, room)
    if not hides:
        return
    for row in range(y0 // TILE_Y, (y1 - 1) // TILE_Y + 1):
        for column in range(x0 // TILE_X, (x1 - 1) // TILE_X + 1):
            covered, farthest = np.uint32(0), 0.0
            for y in range(max(y0, row * TILE_Y), min(y1, (row + 1) * TILE_Y)):
                for x in range(max(x0, column * TILE_X), min(x1, (column + 1) * TILE_X)):
                    inside, depth = covers(
                        rays, room, volume, doubt_volume, rays.column_a[x], rays.row_b[y]
                    )
                    if inside:
                        bit = TILE_X * (y - row * TILE_Y) + x - column * TILE_X
                        covered |= np.uint32(1) << np.uint32(bit)
                        farthest = max(farthest, depth)
            if covered != 0:
                _join(buffer, row, column, covered, rounded_up(farthest), rays)


@njit()
def _join(
    buffer: MaskedBuffer, row: int, column: int, covered: Any, depth: Any, rays: Rays
) -> None:
    """Join pixels that an occluder covers, no farther than `depth`, to a tile."""
    mask, reference = buffer.mask[row, column], buffer.reference[row, column]
    working = buffer.working[row, column]
    if depth >= reference:
        return
    # Where the second layer is nearer to the first than to the new triangle, the paper's heuristic
    # takes it for another surface, and lets it go.
    if mask != 0:
        second = _along(working, rays)
        if second - _along(depth, rays) > _along(reference, rays) - second:
            mask = np.uint32(0)
    working = depth if mask == 0 else max(working, depth)
    mask |= covered
    if mask == buffer.full[row, column]:
        reference, working, mask = working, np.float32(np.inf), np.uint32(0)
    buffer.mask[row, column], buffer.reference[row, column] = mask, reference
    buffer.working[row, column] = working


@njit(inline="always")
def _along(depth, rays):  # type: ignore[no-untyped-def]
    """A depth on the scale by which layers are told apart: that of a depth buffer, as in the paper,
    on which infinity is no farther off than the last thing seen."""
    return -1.0 / depth if rays.perspective else min(depth, rays.far)
