"""Points aimed at triangles: how much of the image each projects to, and points drawn from there.

In the coordinates of `visref.camera` a point p has p - e = z F + A R + B U, and lies at
(a, b) = (A / z, B / z), orthographic (A, B).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.compiled import njit
from visref.scene import Float32, Float64, Int32, Int64, Scene

# A triangle has 3 corners and each of 6 planes cuts off one more at most.
_CORNERS = 9


class SeenMesh(NamedTuple):
    """Triangles in the coordinates of a camera. `triangles`: (t, 3) int32 vertex indices;
    `local`: (v, 3) float64, of `view_coordinates`; `limits`: (6,) float64, the least and greatest
    a, b and z in view, infinite for none."""

    triangles: Int32
    local: Float64
    perspective: bool
    limits: Float64

    @classmethod
    def of(cls, camera: Camera, vertices: Float32, triangles: Int32, limits: Float64) -> SeenMesh:
        """(v, 3) float32 world vertices and (t, 3) triangles, seen within `limits`."""
        return cls(triangles, view_coordinates(camera, vertices), camera.is_perspective, limits)


class Aim(NamedTuple):
    """Objects to aim at, and their triangles: those of object i, k of all, are
    `which[offsets[i]:offsets[i + 1]]`.

    `objects`: (k,) int32 ids; `offsets`: (k + 1,) int64; `which`: (n,) int32 triangle ids;
    `areas`: (n,) float64, what each projects to in pixels.
    """

    objects: Int32
    offsets: Int64
    which: Int32
    areas: Float64

    @classmethod
    def at(cls, scene: Scene, objects: Int32, mesh: SeenMesh) -> Aim:
        """Aim at some objects, (k,) int32 ids, all of whose triangles are in `mesh`."""
        units = scene.object_units()
        which = units.gather(objects)
        offsets = np.concatenate([[0], np.cumsum(units.sizes[objects])]).astype(np.int64)
        return cls(objects, offsets, which, projected_areas(which, mesh))

    @property
    def extent(self) -> Float64:
        """(k,) float64: the sum of each object's areas."""
        if not len(self.objects):
            return np.zeros(0)
        extent: Float64 = np.add.reduceat(self.areas, self.offsets[:-1])
        return extent

    def only(self, chosen: NDArray[np.bool_]) -> Aim:
        """The same for some of the objects, (k,) bool."""
        sizes = np.diff(self.offsets)
        kept = np.repeat(chosen, sizes)
        offsets = np.concatenate([[0], np.cumsum(sizes[chosen])]).astype(np.int64)
        return Aim(self.objects[chosen], offsets, self.which[kept], self.areas[kept])


def view_coordinates(camera: Camera, vertices: Float32) -> Float64:
    """(v, 3) float64: A, B and z of each of (v, 3) float32 world vertices."""
    basis = np.stack([camera.right_step, camera.up_step, camera.forward])
    result: Float64 = (vertices - camera.eye) @ np.linalg.inv(basis)
    return result


@njit(error_model="numpy")
def _clip(
    local: NDArray[Any],
    corners: NDArray[Any],
    perspective: bool,
    limits: NDArray[Any],
    polygon: NDArray[Any],
    other: NDArray[Any],
) -> int:
    """The part of a triangle in the view, projected: (a, b) of its corners into
    `polygon[:n, :2]`; returns n. (Sutherland and Hodgman 1974.)"""
    n = 3
    for k in range(3):
        for axis in range(3):
            polygon[k, axis] = local[corners[k], axis]
    # The near plane first: beyond it perspective is well-behaved.
    for plane in (4, 5, 0, 1, 2, 3):
        limit, sign, axis = limits[plane], 1.0 - 2.0 * (plane % 2), plane // 2
        if not np.isfinite(limit):
            continue
        scaled = perspective and axis < 2
        kept = 0
        before = n - 1
        for k in range(n):
            w0 = polygon[before, 2] if scaled else 1.0
            w1 = polygon[k, 2] if scaled else 1.0
            d0 = sign * (polygon[before, axis] - limit * w0)
            d1 = sign * (polygon[k, axis] - limit * w1)
            if (d0 >= 0.0) != (d1 >= 0.0):
                s = d0 / (d0 - d1)
                for i in range(3):
                    other[kept, i] = polygon[before, i] + s * (polygon[k, i] - polygon[before, i])
                kept += 1
            if d1 >= 0.0:
                for i in range(3):
                    other[kept, i] = polygon[k, i]
                kept += 1
            before = k
        n = kept
        for k in range(n):
            for i in range(3):
                polygon[k, i] = other[k, i]
        if n == 0:
            return 0
    if perspective:
        for k in range(n):
            polygon[k, 0] /= polygon[k, 2]
            polygon[k, 1] /= polygon[k, 2]
    return n


@njit(inline="always")
def _fan(p, k):  # type: ignore[no-untyped-def]
    """Area of the k-th triangle of a convex polygon's fan."""
    return 0.5 * abs(
        (p[k, 0] - p[0, 0]) * (p[k + 1, 1] - p[0, 1])
        - (p[k + 1, 0] - p[0, 0]) * (p[k, 1] - p[0, 1])
    )


@njit(error_model="numpy")
def projected_areas(which: Int32, mesh: SeenMesh) -> Float64:
    """(k,) float64: the area that the part in view of each triangle of `which`, (k,) int32 ids,
    projects to, in pixels."""
    triangles, local, perspective, limits = mesh
    polygon, other = np.empty((_CORNERS + 1, 3)), np.empty((_CORNERS + 1, 3))
    areas = np.empty(len(which))
    for i in range(len(which)):
        n = _clip(local, triangles[which[i]], perspective, limits, polygon, other)
        total = 0.0
        for k in range(1, n - 1):
            total += _fan(polygon, k)
        # (a, b) count half pixels.
        areas[i] = total / 4.0
    return areas


@njit()
def _mix(x: np.uint64) -> np.uint64:
    """SplitMix64's output function (Steele, Lea and Flood 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@njit()
def uniform(seed: int, stream: int, index: int) -> float:
    """A number in [0, 1): the index-th of the stream that belongs to two whole numbers."""
    golden = np.uint64(0x9E3779B97F4A7C15)
    key = _mix(np.uint64(seed) + golden)
    key = _mix(key + np.uint64(stream) * golden + np.uint64(1))
    value = _mix(key + (np.uint64(index) + np.uint64(1)) * golden)
    return np.float64(value >> np.uint64(11)) * 2.0**-53


@njit(error_model="numpy")
def draw_points(
    aim: Aim, mesh: SeenMesh, seed: int, start: int, count: int, even_share: float
) -> tuple[Int32, Float64, Float64]:
    """`count` image points for each of k objects, object by object: (k * count,) int32 triangle
    ids and float64 a and b, in half pixels.

    Object i's numbers are those of the stream `objects[i]` of `seed`, from the `start`-th point
    on. A point is uniform on the projection of a triangle drawn by area, or (a share
    `even_share` of them) drawn evenly among those with any area. Every object has some.
    """
    streams, offsets, which, areas = aim
    triangles, local, perspective, limits = mesh
    total = len(streams) * count
    target = np.empty(total, np.int32)
    a, b = np.empty(total), np.empty(total)
    polygon, other = np.empty((_CORNERS + 1, 3)), np.empty((_CORNERS + 1, 3))
    for g in range(len(streams)):
        first, last = offsets[g], offsets[g + 1]
        sums = np.cumsum(areas[first:last])
        some = np.flatnonzero(areas[first:last] > 0.0)
        for i in range(count):
            # Five numbers per point.
            at = 5 * (start + i)
            pick = uniform(seed, streams[g], at)
            if uniform(seed, streams[g], at + 1) < even_share:
                place = some[min(int(pick * len(some)), len(some) - 1)]
            else:
                place = np.searchsorted(sums, pick * sums[-1], side="right")
                place = min(place, some[-1])
            t = which[first + place]
            n = _clip(local, triangles[t], perspective, limits, polygon, other)
            left = uniform(seed, streams[g], at + 2) * 4.0 * areas[first + place]
            k = 1
            while k < n - 2 and left >= _fan(polygon, k):
                left -= _fan(polygon, k)
                k += 1
            s, w = uniform(seed, streams[g], at + 3), uniform(seed, streams[g], at + 4)
            if s + w > 1.0:
                s, w = 1.0 - s, 1.0 - w
            out = g * count + i
            target[out] = t
            p0, p1, p2 = polygon[0], polygon[k], polygon[k + 1]
            a[out] = p0[0] + s * (p1[0] - p0[0]) + w * (p2[0] - p0[0])
            b[out] = p0[1] + s * (p1[1] - p0[1]) + w * (p2[1] - p0[1])
    return target, a, b
