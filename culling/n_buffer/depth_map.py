"""Ask a depth map about rectangles: is all of it nearer than a depth? Looked up in an N-buffer.

Décoret 2005, section 3.1. The depth buffer is read back once a frame and its levels are built on
the CPU; then every question costs as many comparisons as squares cover the rectangle, however
large it is. The paper reads single pixels of the levels back, which it calls inefficient.

Each condition on which safety hangs is a method of its own: the map holds the depth of geometry
that was drawn with this camera; a level holds the exact farthest depth of its square; the squares
cover the whole rectangle, which is clipped to the image; a depth is compared as it is stored,
moved towards the eye by what both may err.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from visref.culler import QueryStats
from visref.scene import Float32, Float64, Int32
from visref_culling.boxes.rectangles import screen_rectangles
from visref_culling.gl.device import Target
from visref_culling.gl.view import View
from visref_culling.n_buffer.cover import FOUR, Cover, four_squares, one_square
from visref_culling.n_buffer.levels import build_levels, look_up


class DepthMapQueries:
    """Questions to one frame's depth map. `squares`: 1 or 4 over each rectangle."""

    def __init__(self, squares: int) -> None:
        self.cover: Callable[[Int32], Cover] = four_squares if squares == FOUR else one_square

    def begin(self, view: View, target: Target, stats: QueryStats) -> None:
        """Take the target's depth as it is now."""
        self.view = view
        depth = self.read_back(target)
        self.levels = self.build(depth)
        stats.bytes_read_back = (stats.bytes_read_back or 0) + depth.nbytes
        stats.batches = (stats.batches or 0) + 1

    def ask(self, boxes: Float64, nearest: Float64, stats: QueryStats) -> NDArray[np.bool_]:
        """(k,) bool, whether inflated boxes relative to the eye would show: (k, 2, 3) float64,
        wholly beyond the near plane, with their least view depths (k,) float64."""
        rectangles = self.rectangles(boxes)
        inside = (rectangles[:, 0] <= rectangles[:, 2]) & (rectangles[:, 1] <= rectangles[:, 3])
        cover = self.cover(rectangles[inside])
        visible = np.zeros(len(boxes), np.bool_)
        # Equal is visible.
        visible[inside] = self.depths(nearest[inside]) <= self.farthest(cover)
        stats.queries = (stats.queries or 0) + len(boxes)
        stats.queries_passed = (stats.queries_passed or 0) + int(np.count_nonzero(visible))
        stats.lookups = (stats.lookups or 0) + cover.x.size
        return visible

    # The steps.

    def read_back(self, target: Target) -> Float32:
        """(height, width) float32 window depth, top row first. A 24-bit depth comes as the
        float32 nearest to it: off by 2**-25, a twentieth of what `View.window_depth` keeps."""
        return target.read_depth()

    def build(self, depth: Float32) -> Float32:
        """(levels + 1, height, width) float32 farthest window depths, from window depth
        (height, width)."""
        return build_levels(depth)

    def rectangles(self, boxes: Float64) -> Int32:
        """(k, 4) int32 pixels x0, y0, x1, y1, inclusive, that inflated boxes (k, 2, 3) float64
        relative to the eye may touch, clipped to the image; an empty one touches none."""
        return screen_rectangles(self.view, boxes)

    def farthest(self, cover: Cover) -> Float32:
        """(k,) float32: the farthest window depth under each cover."""
        return look_up(self.levels, cover)

    def depths(self, nearest: Float64) -> Float64:
        """(k,) float64 window depths to compare, of least view depths (k,) float64."""
        return self.view.window_depth(nearest)
