"""Two depths per sample, and what they say of rectangles: for hypotheses only, no verdict rests on
them.

A culler asks about a box before its object is drawn, so the depth that it asks is that of all
others. One pass over the triangles keeps, per sample, the nearest depth, whose it is, and the
nearest depth of anybody else: with these every unit has the depth buffer without itself.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.compiled import njit
from visref.near_plane import cut_off, in_camera_space
from visref.scene import Float64, Int32, Int64

Bool = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Layers:
    """(height, width) float64 view depths, inf for none: `nearest`, that of `owner` (int32, -1 for
    none), and `second`, the nearest of all others."""

    nearest: Float64
    owner: Int32
    second: Float64

    @classmethod
    def empty(cls, height: int, width: int) -> Layers:
        shape = (height, width)
        return cls(np.full(shape, np.inf), np.full(shape, -1, np.int32), np.full(shape, np.inf))

    @property
    def bytes(self) -> int:
        return self.nearest.nbytes + self.owner.nbytes + self.second.nbytes

    def picked(self, rows: Any, columns: Any) -> Layers:
        """The layers at some rows and columns."""
        return Layers(
            *(
                np.ascontiguousarray(one[rows][:, columns])
                for one in (self.nearest, self.owner, self.second)
            )
        )

    def mapped(self, change: Any) -> Layers:
        """The layers with both depths changed alike, an image at a time."""
        return replace(self, nearest=change(self.nearest), second=change(self.second))


class LayersKept:
    """Layers, made once each as far as so many bytes go: those that were not asked for longest go
    first."""

    def __init__(self, most: int) -> None:
        self._most, self._held = most, 0
        self._kept: OrderedDict[Hashable, Layers] = OrderedDict()

    @property
    def held(self) -> int:
        """Bytes."""
        return self._held

    def get(self, key: Hashable, make: Callable[[], Layers]) -> Layers:
        found = self._kept.get(key)
        if found is None:
            found = make()
            self._kept[key] = found
            self._held += found.bytes
            while self._held > self._most and len(self._kept) > 1:
                _, gone = self._kept.popitem(last=False)
                self._held -= gone.bytes
        self._kept.move_to_end(key)
        return found


class Tested(NamedTuple):
    """What rectangles hold of the depth of others: (k,) float64 `farthest` and `nearest` depth
    (-inf and inf for an empty one), and (k,) int64, at how many samples it is at or behind the
    depth asked for (`passing`), and strictly behind it (`beyond`)."""

    farthest: Float64
    nearest: Float64
    passing: Int64
    beyond: Int64


def draw(
    layers: Layers,
    vertices: NDArray[Any],
    corners: Int32,
    camera: Camera,
    triangles: Int64,
    unit_of: Int32,
) -> None:
    """Draw `triangles`, (k,) ids of (t, 3) `corners` of (v, 3) `vertices`, into the layers;
    `unit_of`, (t,) int32, says whose each is."""
    plane = np.zeros(4) if camera.clip_plane is None else np.array(camera.clip_plane)
    lens = np.array(
        [
            camera.half_pixel,
            camera.column_a[0],
            camera.row_b[0],
            camera.near,
            camera.far,
        ]
    )
    _draw(
        vertices,
        corners,
        triangles,
        unit_of,
        np.asarray(camera.world_from_camera),
        camera.is_perspective,
        lens,
        plane,
        layers.nearest,
        layers.owner,
        layers.second,
        np.empty((4, 3)),
    )


def turned(
    vertices: NDArray[Any], corners: Int32, towards: Float64, is_point: bool
) -> NDArray[np.bool_]:
    """(t,) bool, which of (t, 3) `corners` of (v, 3) `vertices` turn their front, from which they
    are counter-clockwise, to the point `towards`, (3,) float64, or else in that direction."""
    found = np.empty(len(corners), np.bool_)
    _turned(vertices, corners, np.asarray(towards, np.float64), is_point, found)
    return found


def ask(
    layers: Layers,
    rectangles: Int32,
    depths: Float64,
    units: Int32,
    *,
    own: bool = False,
    whole: bool = False,
) -> Tested:
    """Ask about (k, 4) int32 rectangles (x0, y0, x1, y1, inclusive, within the image; empty where
    x1 < x0) at (k,) view depths, of units, (k,) int32. `own`: the unit's own depth counts too.
    `whole`: look at every sample; otherwise at no more once one is strictly behind."""
    count = len(rectangles)
    found = Tested(
        np.empty(count), np.empty(count), np.empty(count, np.int64), np.empty(count, np.int64)
    )
    _ask(
        layers.nearest,
        layers.owner,
        layers.second,
        rectangles,
        depths,
        units,
        own,
        whole,
        found.farthest,
        found.nearest,
        found.passing,
        found.beyond,
    )
    return found


@njit()
def _put(nearest: Any, owner: Any, second: Any, y: int, x: int, depth: float, unit: int) -> None:
    if owner[y, x] == unit:
        nearest[y, x] = min(nearest[y, x], depth)
    elif depth < nearest[y, x]:
        second[y, x] = nearest[y, x]
        nearest[y, x] = depth
        owner[y, x] = unit
    else:
        second[y, x] = min(second[y, x], depth)


@njit()
def _ask(
    nearest: NDArray[Any],
    owner: NDArray[Any],
    second: NDArray[Any],
    rectangles: NDArray[Any],
    depths: NDArray[Any],
    units: NDArray[Any],
    own: bool,
    whole: bool,
    farthest_found: NDArray[Any],
    nearest_found: NDArray[Any],
    passing: NDArray[Any],
    beyond: NDArray[Any],
) -> None:
    for k in range(len(rectangles)):
        far, near, at, behind = -np.inf, np.inf, 0, 0
        depth = depths[k]
        # A box that is compared with its own or a touching surface's depth is off by roundings.
        least = depth - 1e-9 * abs(depth)
        for y in range(rectangles[k, 1], rectangles[k, 3] + 1):
            if behind and not whole:
                break
            for x in range(rectangles[k, 0], rectangles[k, 2] + 1):
                z = nearest[y, x]
                if not own and owner[y, x] == units[k]:
                    z = second[y, x]
                far, near = max(far, z), min(near, z)
                if z >= least:
                    at += 1
                if z > depth + 1e-9 * abs(depth):
                    behind += 1
        farthest_found[k], nearest_found[k], passing[k], beyond[k] = far, near, at, behind


@njit()
def _turned(
    vertices: NDArray[Any],
    corners: NDArray[Any],
    towards: NDArray[Any],
    is_point: bool,
    found: NDArray[Any],
) -> None:
    e = np.empty((2, 3))
    for t in range(len(corners)):
        a = corners[t, 0]
        for i in range(2):
            for k in range(3):
                e[i, k] = np.float64(vertices[corners[t, i + 1], k]) - np.float64(vertices[a, k])
        side = 0.0
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            way = towards[k] - vertices[a, k] if is_point else towards[k]
            side += (e[0, i] * e[1, j] - e[0, j] * e[1, i]) * way
        found[t] = side > 0.0


@njit(inline="always")
def _on_image(perspective, lens, p):  # type: ignore[no-untyped-def]
    """A point of camera space in pixels (whole numbers are samples), and what falls linearly over
    the image."""
    step, first_a, first_b = lens[0], lens[1], lens[2]
    scale = 1.0 / (step * p[2]) if perspective else 1.0 / step
    x, y = (p[0] * scale - first_a) / 2.0, (first_b - p[1] * scale) / 2.0
    return x, y, 1.0 / p[2] if perspective else p[2]


@njit(inline="always")
def _ahead_of(plane, pose, perspective, lens, x, y, depth):  # type: ignore[no-untyped-def]
    """How far before a clip plane the point of a sample at a depth lies."""
    a, b = (2.0 * x + lens[1]) * lens[0], (lens[2] - 2.0 * y) * lens[0]
    spread = depth if perspective else 1.0
    ahead = plane[3]
    for j in range(3):
        p = pose[j, 3] - depth * pose[j, 2]
        p += spread * (a * pose[j, 0] + b * pose[j, 1])
        ahead += plane[j] * p
    return ahead


@njit(inline="always")
def _fill(c0, c1, c2, unit, pose, perspective, lens, plane, cut, nearest, owner, second):  # type: ignore[no-untyped-def]
    x0, y0, w0 = c0
    x1, y1, w1 = c1
    x2, y2, w2 = c2
    height, width = nearest.shape
    low_x, high_x = min(x0, x1, x2), max(x0, x1, x2)
    low_y, high_y = min(y0, y1, y2), max(y0, y1, y2)
    if high_x < 0.0 or high_y < 0.0 or low_x > width - 1 or low_y > height - 1:
        return
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0.0:
        return
    first_x, last_x = math.ceil(max(low_x, 0.0)), math.floor(min(high_x, width - 1.0))
    first_y, last_y = math.ceil(max(low_y, 0.0)), math.floor(min(high_y, height - 1.0))
    for y in range(first_y, last_y + 1):
        for x in range(first_x, last_x + 1):
            b1 = ((x - x0) * (y2 - y0) - (x2 - x0) * (y - y0)) / area
            b2 = ((x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)) / area
            if b1 < 0.0 or b2 < 0.0 or b1 + b2 > 1.0:
                continue
            depth = w0 + b1 * (w1 - w0) + b2 * (w2 - w0)
            if perspective:
                depth = 1.0 / depth
            if depth > lens[4]:
                continue
            if cut and _ahead_of(plane, pose, perspective, lens, x, y, depth) < 0.0:
                continue
            _put(nearest, owner, second, y, x, depth, unit)


@njit(error_model="numpy", makes_arrays=False)
def _draw(
    vertices: NDArray[Any],
    corners: NDArray[Any],
    triangles: NDArray[Any],
    unit_of: NDArray[Any],
    pose: NDArray[Any],
    perspective: bool,
    lens: NDArray[Any],
    plane: NDArray[Any],
    nearest: NDArray[Any],
    owner: NDArray[Any],
    second: NDArray[Any],
    polygon: NDArray[Any],
) -> None:
    """`polygon`: (4, 3) float64, to be written."""
    near = lens[3]
    cut = plane[0] != 0.0 or plane[1] != 0.0 or plane[2] != 0.0
    for k in range(triangles.size):
        t = triangles[k]
        unit = unit_of[t]
        p, q, r, ahead = in_camera_space(pose, near, vertices, corners[t])
        if ahead == 0:
            continue
        if ahead == 3:
            a, b = _on_image(perspective, lens, p), _on_image(perspective, lens, q)
            c = _on_image(perspective, lens, r)
            _fill(a, b, c, unit, pose, perspective, lens, plane, cut, nearest, owner, second)
            continue
        count = cut_off(near, p, q, r, polygon)
        a = _on_image(perspective, lens, polygon[0])
        for i in range(1, count - 1):
            b = _on_image(perspective, lens, polygon[i])
            c = _on_image(perspective, lens, polygon[i + 1])
            _fill(a, b, c, unit, pose, perspective, lens, plane, cut, nearest, owner, second)
