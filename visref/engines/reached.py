"""Which blocks of an image what is cast at can reach at all: no ray is cast in the others.

Triangles go by runs of neighbours in their order, each with a box. A box's corners, projected,
span a rectangle of the image, so what lies in no rectangle is background, whatever a ray would cost
to find that out. Rectangles are outward, by what a ray library may be off and a pixel more: nothing
that a ray would have met is left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines.ray_kernels import RECTANGLE_MARGIN_PX, SampleGrid, dot
from visref.scene import Float32, Int32

# Triangles in a run, at least, and runs of a scene, at most: a box costs some 100 ns a frame.
LEAST_RUN, MOST_RUNS = 64, 4096


def boxes_of_runs(vertices: Float32, triangles: Int32) -> NDArray[np.float32]:
    """(g, 2, 3) float32, the boxes of runs of (t, 3) triangles of (v, 3) vertices."""
    run = max(LEAST_RUN, -(-len(triangles) // MOST_RUNS))
    boxes = np.empty((-(-len(triangles) // run), 2, 3), np.float32)
    fill_boxes(vertices, triangles, run, boxes)
    return boxes


@njit(makes_arrays=False)
def fill_boxes(
    vertices: NDArray[Any], triangles: NDArray[Any], run: int, boxes: NDArray[Any]
) -> None:
    for g in range(len(boxes)):
        for i in range(3):
            boxes[g, 0, i], boxes[g, 1, i] = np.inf, -np.inf
        for t in range(g * run, min((g + 1) * run, len(triangles))):
            for k in range(3):
                v = triangles[t, k]
                for i in range(3):
                    boxes[g, 0, i] = min(boxes[g, 0, i], vertices[v, i])
                    boxes[g, 1, i] = max(boxes[g, 1, i], vertices[v, i])


@njit(inline="always")
def _span(x, z, count, first, step, perspective):  # type: ignore[no-untyped-def]
    """Between which pixels, (low, high), corners at x across and z deep lie: eight of either.
    `first` and `step`: the coordinate of pixel 0 and from pixel to pixel."""
    if not perspective:
        low, high = np.inf, -np.inf
        for k in range(8):
            at = (x[k] - first) / step
            low, high = min(low, at), max(high, at)
        return low, high
    ahead = True
    for k in range(8):
        ahead = ahead and z[k] > 0.0
    if ahead:
        low, high = np.inf, -np.inf
        for k in range(8):
            at = (x[k] / z[k] - first) / step
            low, high = min(low, at), max(high, at)
        return low, high
    # Some corner is at the eye's depth or behind: the last pixel before all of it, and the first
    # beyond, found by halves. Corners behind the eye make that no narrower.
    before, beyond = -1, count
    low_end = count
    while low_end - before > 1:
        middle = (before + low_end) // 2
        a, all_after = first + step * middle, True
        for k in range(8):
            all_after = all_after and (x[k] - a * z[k]) * step > 0.0
        if all_after:
            before = middle
        else:
            low_end = middle
    high_end = -1
    while beyond - high_end > 1:
        middle = (beyond + high_end) // 2
        a, all_before = first + step * middle, True
        for k in range(8):
            all_before = all_before and (x[k] - a * z[k]) * step < 0.0
        if all_before:
            beyond = middle
        else:
            high_end = middle
    return float(before), float(beyond)


@njit(makes_arrays=False)
def reach(
    boxes: NDArray[Any],
    grid: SampleGrid,
    eye: NDArray[Any],
    scale: float,
    slack: float,
    block: tuple[int, int],
    counts: NDArray[Any],
    corner: NDArray[Any],
) -> None:
    """Add the blocks that boxes, (g, 2, 3), may touch to `counts`, (r + 1, c + 1) int32, as
    differences along both axes, of which `flag` makes sums.

    `eye`: (3,) in the boxes' space, which is `scale` times as large as the world; `slack`: in the
    world, how far the library may be off; `block`: columns and rows of a block; `corner`: (3, 8)
    float64, to be written.
    """
    m, width, height = grid.axes, len(grid.column_a), len(grid.row_b)
    first_a, first_b = grid.column_a[0], grid.row_b[0]
    step_a = grid.column_a[1] - first_a if width > 1 else 1.0
    step_b = grid.row_b[1] - first_b if height > 1 else 1.0
    wide = slack * scale
    for g in range(len(boxes)):
        deepest = -np.inf
        for k in range(8):
            p = (
                np.float64(boxes[g, k & 1, 0]) + (wide if k & 1 else -wide) - eye[0],
                np.float64(boxes[g, (k >> 1) & 1, 1]) + (wide if k & 2 else -wide) - eye[1],
                np.float64(boxes[g, k >> 2, 2]) + (wide if k & 4 else -wide) - eye[2],
            )
            for i in range(3):
                corner[i, k] = dot(p, (m[4 + i, 0], m[4 + i, 1], m[4 + i, 2])) / scale
            deepest = max(deepest, corner[0, k])
        if grid.perspective and deepest <= 0.0:
            continue
        x0, x1 = _span(corner[1], corner[0], width, first_a, step_a, grid.perspective)
        y0, y1 = _span(corner[2], corner[0], height, first_b, step_b, grid.perspective)
        margin = RECTANGLE_MARGIN_PX
        # What is no number counts as all of the image.
        if x1 + margin < 0.0 or x0 - margin > width - 1:
            continue
        if y1 + margin < 0.0 or y0 - margin > height - 1:
            continue
        left = int(max(x0 - margin, 0.0)) if x0 == x0 else 0
        right = int(min(x1 + margin, width - 1.0)) if x1 == x1 else width - 1
        top = int(max(y0 - margin, 0.0)) if y0 == y0 else 0
        bottom = int(min(y1 + margin, height - 1.0)) if y1 == y1 else height - 1
        first_column, last_column = left // block[0], right // block[0] + 1
        first_row, last_row = top // block[1], bottom // block[1] + 1
        counts[first_row, first_column] += 1
        counts[first_row, last_column] -= 1
        counts[last_row, first_column] -= 1
        counts[last_row, last_column] += 1


@njit(makes_arrays=False)
def flag(counts: NDArray[Any], reached: NDArray[Any]) -> None:
    """Sum `counts` along both axes, in place, and set what is above zero in `reached`, (r, c)
    uint8."""
    for y in range(reached.shape[0]):
        along = 0
        for x in range(reached.shape[1]):
            along += counts[y, x]
            above = counts[y - 1, x] if y else 0
            counts[y, x] = along + above
            reached[y, x] = counts[y, x] > 0
