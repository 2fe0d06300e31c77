"""How much of each cell has been drawn over, roughly: section 6's occlusion probability."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Scene, Units
from visref_culling.gl.view import View
from visref_culling.lazy_grid.grid import Grid


def add_coverage(
    grid: Grid, view: View, scene: Scene, units: Units, occludes: NDArray[np.bool_], unit: int
) -> None:
    """Add the image areas of a unit's triangles to the cells that their rectangles meet, each
    in proportion, without looking where they overlap. A triangle that reaches behind the eye
    counts as covering nothing: a guess in any case, and one that only draws more. `occludes`:
    (t,) bool, one per triangle of the scene; others add nothing."""
    first, end = units.offsets[unit : unit + 2]
    camera = view.camera
    pixels_from_ndc = np.array([[0.5, 0.0, 0.0, 0.5], [0.0, -0.5, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]])
    pixels_from_ndc[:2] *= np.array([[camera.width], [camera.height]])
    _add(
        scene.vertices,
        scene.triangles,
        units.triangles[first:end],
        occludes,
        camera.eye,
        pixels_from_ndc @ view.clip_from_relative,
        grid.cell,
        camera.width,
        camera.height,
        grid.covered,
    )


@njit()
def _add(
    vertices: NDArray[Any],
    triangles: NDArray[Any],
    chosen: NDArray[Any],
    occludes: NDArray[Any],
    eye: NDArray[Any],
    pixels_from_relative: NDArray[Any],
    cell: int,
    width: int,
    height: int,
    covered: NDArray[Any],
) -> None:
    x, y = np.empty(3), np.empty(3)
    for triangle in chosen:
        if not occludes[triangle]:
            continue
        behind = False
        for i in range(3):
            v = triangles[triangle, i]
            row = np.empty(3)
            for k in range(3):
                row[k] = pixels_from_relative[k, 3]
                for axis in range(3):
                    row[k] += pixels_from_relative[k, axis] * (vertices[v, axis] - eye[axis])
            behind = behind or row[2] <= 0.0
            x[i], y[i] = row[0] / max(row[2], 1e-300), row[1] / max(row[2], 1e-300)
        if behind:
            continue
        area = 0.5 * abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]))
        low_x, high_x = min(x[0], x[1], x[2]), max(x[0], x[1], x[2])
        low_y, high_y = min(y[0], y[1], y[2]), max(y[0], y[1], y[2])
        if area == 0.0 or high_x <= 0.0 or high_y <= 0.0 or low_x >= width or low_y >= height:
            continue
        density = area / ((high_x - low_x) * (high_y - low_y))
        x0, x1 = int(max(low_x, 0.0)) // cell, int(min(high_x, width - 1.0)) // cell
        y0, y1 = int(max(low_y, 0.0)) // cell, int(min(high_y, height - 1.0)) // cell
        for row_at in range(y0, y1 + 1):
            top, bottom = row_at * cell, min((row_at + 1) * cell, height)
            tall = min(high_y, bottom) - max(low_y, top)
            for column in range(x0, x1 + 1):
                left, right = column * cell, min((column + 1) * cell, width)
                wide = min(high_x, right) - max(low_x, left)
                if wide > 0.0 and tall > 0.0:
                    share = wide * tall / ((right - left) * (bottom - top))
                    covered[row_at, column] += density * share
