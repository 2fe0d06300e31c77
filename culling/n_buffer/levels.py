"""The levels of an N-buffer, built on the CPU, and looked up there.

X. Décoret: N-Buffers for efficient depth map query. Computer Graphics Forum 24(3), 2005, section 2.

Level 0 is a depth map of any size. A pixel of level i holds the farthest (or nearest) depth of
the 2^i by 2^i pixels that start at it and go right and down; pixels outside the image do not
count. Unlike a pyramid's, every level has the map's resolution, so any rectangle is covered by
one square of a level, or more tightly by four (`n_buffer.cover`).

Departures from the paper: rows count from the top, as everywhere here, and squares go down from
their pixel; a square that hangs from a rectangle's top then starts inside the image. Outside, a
border stands in for nothing (the paper's 0 is right for a maximum alone).
"""

from __future__ import annotations

import numpy as np

from visref.scene import Float32
from visref_culling.n_buffer.cover import Cover


def level_count(width: int, height: int) -> int:
    """How many levels above level 0: at the last, one pixel's square covers the whole image."""
    return (max(width, height) - 1).bit_length()


def build_levels(depth: Float32, *, farthest: bool = True) -> Float32:
    """(levels + 1, height, width) float32 from a depth map (height, width) float32.

    A level takes four pixels of the one below, which is separable: two along x, two along y.
    Nothing is rounded. `farthest` False keeps the nearest instead.
    """
    join = np.maximum if farthest else np.minimum
    height, width = depth.shape
    levels = np.empty((level_count(width, height) + 1, height, width), np.float32)
    levels[0] = depth
    for level in range(1, len(levels)):
        half, made = 1 << (level - 1), levels[level]
        made[:] = levels[level - 1]
        # Where the second square starts outside there is nothing to join.
        if half < width:
            join(made[:, :-half], levels[level - 1][:, half:], out=made[:, :-half])
        if half < height:
            # NumPy reads overlapping operands as they were before.
            join(made[:-half], made[half:], out=made[:-half])
    return levels


def look_up(levels: Float32, cover: Cover, *, farthest: bool = True) -> Float32:
    """(k,) float32: the farthest (nearest) depth in the squares that cover k rectangles."""
    looked_up: Float32 = levels[cover.level[:, None], cover.y, cover.x]
    found: Float32 = looked_up.max(axis=1) if farthest else looked_up.min(axis=1)
    return found
