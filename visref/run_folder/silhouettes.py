"""A small z-buffered rasteriser, for pictures and explanations only: no verdict rests on it.

It draws the silhouettes of units that lie hidden behind others, so that a picture can show
what was drawn for nothing, and the depth that a culler had drawn at some moment, so that a report
can say why.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.compiled import njit
from visref.near_plane import cut_off, in_camera_space
from visref.scene import Float32, Float64, Int32, Int64, Scene, Units


class _Projection(NamedTuple):
    """From the world to an image's pixels: the camera's pose, (4, 4) float64, and its near plane;
    (2,) float64 each, half pixels for one unit of camera space (at depth 1 if perspective), and
    where the camera's axis meets the image."""

    world_from_camera: Float64
    perspective: bool
    near: float
    per_unit: Float64
    centre: Float64


class Window(NamedTuple):
    """A part of a camera's image: its left and top edge in samples, of which the first spans 0 to
    1, and how many pixels it has for each."""

    left: float
    top: float
    scale: float


class UnitImage:
    """An image of `shape` (height, width) that spans the camera's view, or a `window` of it; units
    are drawn into it.

    `owner`: int32, the nearest unit's id at each pixel, -1 where there is none. `nearness`:
    float32, 1 / view depth there, or minus the depth if orthographic; -inf where there is none.
    Triangles are clipped at the near plane, and cover the pixel centres inside them.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        units: Units,
        shape: tuple[int, int],
        window: Window | None = None,
    ) -> None:
        self._scene, self._units = scene, units
        self.owner: Int32 = np.full(shape, -1, np.int32)
        self.nearness: Float32 = np.full(shape, -np.inf, np.float32)
        # Only what is farther off than this is drawn.
        self.behind: Float32 = np.full(shape, np.inf, np.float32)
        # So many pixels for so many samples, to the right and down, from a corner.
        left, top = (0.0, 0.0) if window is None else (window.left, window.top)
        pixels, samples = np.array([shape[1], shape[0]]), np.array([camera.width, camera.height])
        if window is not None:
            pixels, samples = np.full(2, window.scale), np.ones(2)
        per_unit = pixels / samples / (2.0 * camera.half_pixel)
        middle = np.array(
            [
                camera.width / 2 - camera.shift_x_px - left,
                camera.height / 2 - camera.shift_y_px - top,
            ]
        )
        centre = middle * pixels / samples
        self._projection = _Projection(
            camera.world_from_camera, camera.is_perspective, camera.near, per_unit, centre
        )

    def draw(
        self, unit_ids: Int32, *, only: NDArray[np.bool_] | None = None, marks_small: bool = False
    ) -> None:
        """Draw units, (k,) int32 ids. `only`: (t,) bool, the triangles to draw. `marks_small`:
        a triangle that falls between the pixel centres still marks the pixel that it lies in."""
        triangles = self._units.gather(unit_ids)
        unit_of = np.repeat(np.asarray(unit_ids, np.int32), self._units.sizes[unit_ids])
        if only is not None:
            kept = only[triangles]
            triangles, unit_of = triangles[kept], unit_of[kept]
        _rasterise(
            self._scene.vertices,
            self._scene.triangles,
            triangles,
            unit_of,
            self._projection,
            marks_small,
            self.owner,
            self.nearness,
            self.behind,
            np.empty((4, 3)),
        )


def silhouettes(
    scene: Scene, camera: Camera, units: Units, unit_ids: Int32, shape: tuple[int, int]
) -> Int32:
    """The nearest of the given units at each pixel of an image of `shape` (height, width)
    that spans the camera's view: int32 unit ids, -1 where there is none. A small unit between
    the pixel centres does not vanish."""
    image = UnitImage(scene, camera, units, shape)
    image.draw(unit_ids, marks_small=True)
    return image.owner


def from_behind(scene: Scene, camera: Camera, triangles: Int64) -> NDArray[np.bool_]:
    """(k,) bool: which of the triangles, (k,) ids, are one-sided and seen edge-on or from
    behind."""
    behind = scene.one_sided[triangles].copy()
    triangles = triangles[behind]
    corners = scene.vertices[scene.triangles[triangles]].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = camera.eye - corners[:, 0] if camera.is_perspective else -camera.forward[None]
    behind[behind] = (normal * towards).sum(axis=1) <= 0.0
    return behind


def borders(ids: NDArray[Any]) -> NDArray[np.bool_]:
    """(h, w) bool: where the pixel to the right or below belongs to something else."""
    result = np.zeros(ids.shape, np.bool_)
    result[:, :-1] |= ids[:, :-1] != ids[:, 1:]
    result[:-1] |= ids[:-1] != ids[1:]
    return result


@njit(inline="always")
def _fill(a, b, c, unit, marks_small, owner, nearness, behind):  # type: ignore[no-untyped-def]
    """A triangle of the image: x, y and nearness of each corner."""
    height, width = owner.shape
    x0, y0, w0 = a
    x1, y1, w1 = b
    x2, y2, w2 = c
    low_x, high_x = min(x0, x1, x2), max(x0, x1, x2)
    low_y, high_y = min(y0, y1, y2), max(y0, y1, y2)
    if high_x < 0.0 or high_y < 0.0 or low_x >= width or low_y >= height:
        return
    if marks_small and high_x - low_x < 1.0 and high_y - low_y < 1.0:
        px = int(min(max((x0 + x1 + x2) / 3.0, 0.0), width - 1.0))
        py = int(min(max((y0 + y1 + y2) / 3.0, 0.0), height - 1.0))
        near_here = np.float32((w0 + w1 + w2) / 3.0)
        if near_here > nearness[py, px] and near_here < behind[py, px]:
            nearness[py, px] = near_here
            owner[py, px] = unit
        return
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0.0:
        return
    # Pixels whose centres are within its bounds.
    first_x, last_x = math.ceil(max(low_x - 0.5, 0.0)), math.floor(min(high_x - 0.5, width - 1.0))
    first_y, last_y = math.ceil(max(low_y - 0.5, 0.0)), math.floor(min(high_y - 0.5, height - 1.0))
    if first_x > last_x or first_y > last_y:
        return
    for py in range(first_y, last_y + 1):
        cy = py + 0.5
        for px in range(first_x, last_x + 1):
            cx = px + 0.5
            side1 = (cx - x0) * (y2 - y0) - (x2 - x0) * (cy - y0)
            side2 = (x1 - x0) * (cy - y0) - (cx - x0) * (y1 - y0)
            # Signs first: most of the pixels about a small triangle are outside.
            if (side1 < 0.0) != (area < 0.0) and side1 != 0.0:
                continue
            if (side2 < 0.0) != (area < 0.0) and side2 != 0.0:
                continue
            b1, b2 = side1 / area, side2 / area
            if b1 + b2 > 1.0:
                continue
            near_here = np.float32(w0 + b1 * (w1 - w0) + b2 * (w2 - w0))
            if near_here > nearness[py, px] and near_here < behind[py, px]:
                nearness[py, px] = near_here
                owner[py, px] = unit


@njit(inline="always")
def _seen_at(perspective, per_unit, centre, p):  # type: ignore[no-untyped-def]
    """A point of camera space in pixels (continuous, y down), and what falls linearly over the
    image: 1 / depth, or minus depth if orthographic."""
    scale = 1.0 / p[2] if perspective else 1.0
    nearness = scale if perspective else -p[2]
    return centre[0] + p[0] * per_unit[0] * scale, centre[1] - p[1] * per_unit[1] * scale, nearness


@njit(error_model="numpy", makes_arrays=False)
def _rasterise(
    vertices: NDArray[Any],
    corners: NDArray[Any],
    triangles: NDArray[Any],
    unit_of: NDArray[Any],
    projection: _Projection,
    marks_small: bool,
    owner: NDArray[Any],
    nearness: NDArray[Any],
    behind: NDArray[Any],
    polygon: NDArray[Any],
) -> None:
    """`polygon`: (4, 3) float64, to be written."""
    m, perspective, near, per_unit, centre = projection
    for k in range(triangles.size):
        t, unit = triangles[k], unit_of[k]
        p, q, r, ahead = in_camera_space(m, near, vertices, corners[t])
        if ahead == 0:
            continue
        if ahead == 3:
            a = _seen_at(perspective, per_unit, centre, p)
            b = _seen_at(perspective, per_unit, centre, q)
            c = _seen_at(perspective, per_unit, centre, r)
            _fill(a, b, c, unit, marks_small, owner, nearness, behind)
            continue
        count = cut_off(near, p, q, r, polygon)
        for i in range(1, count - 1):
            a = _seen_at(perspective, per_unit, centre, polygon[0])
            b = _seen_at(perspective, per_unit, centre, polygon[i])
            c = _seen_at(perspective, per_unit, centre, polygon[i + 1])
            _fill(a, b, c, unit, marks_small, owner, nearness, behind)
