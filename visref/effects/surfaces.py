"""What a rasteriser may see at a sample: every surface within its snap, with its depths.

A rasteriser that moves each vertex by at most `snap_px` shows at a sample, of every triangle,
only depths that the triangle has within `snap_px` of it, give or take the depth buffer's steps
and the float32 transform's error. It may show no other triangle; and it must show a triangle
that covers the whole disc of that radius, or something nearer. The geometry is that of the
margins (`visref.exact.margins`), in float64 with its error counted.

Unlike there, the rasteriser is taken to be one that transforms positions relative to the eye, in
float32: it errs by a part of the distance, not of the coordinates. Effects are judged on such
rasterisers alone, and what is excused in a shadow's place is only as good as this bound.

Which way this errs: outward. A sample on an edge that two triangles share lies wholly in
neither, so what is behind them counts as possible too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.compiled import njit
from visref.culler import RasterTolerance
from visref.exact import ExactScene
from visref.exact.depth_buffer import DepthBuffer, depth_buffer, with_doubtful_range
from visref.exact.filters import View, view_of
from visref.exact.nearby import Nearby, near_samples
from visref.exact.polygons import (
    distance_to_polygon,
    distance_to_segment,
    key_range,
    screen_polygon,
)
from visref.exact.screen import X0, X1, Y0, Y1
from visref.scene import Float32, Float64, Int32, Int64

# A transform relative to the eye errs by this part of the distance: per component two
# subtractions, one rounding of each matrix entry and of each product, three of the sums, so seven
# of 2^-24 on the sum of |entry * component|, which is at most sqrt(3) times the distance.
TRANSFORM = 7.0 * math.sqrt(3.0) * 2.0**-24

# Window depth as stored, in units of 2^-24: the division by w (2, in half the range: 1), the
# viewport's product and sum (2), the last sum of its plane (1), the rounding to a step (1 with
# what reads it back). What the plane's slope makes of it is within the snap.
DEPTH_STEPS = 5.0


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Per sample, in CSR form, what may be seen there.

    Sample i may show `triangle[offsets[i]:offsets[i + 1]]` (int32 ids), each at a view depth in
    `near` ... `far` (float64); no opaque surface is further than `limit[i]` (inf where the
    background may show), and those that begin beyond it are left out.
    """

    offsets: Int64
    triangle: Int32
    near: Float64
    far: Float64
    limit: Float64

    def nearest(self) -> Float64:
        """(k,) float64, the least depth that may be seen at each sample, inf for none."""
        result = np.full(len(self.limit), np.inf)
        np.minimum.at(
            result, np.repeat(np.arange(len(self.limit)), np.diff(self.offsets)), self.near
        )
        return result


class _Reach(NamedTuple):
    """How far a rasteriser errs: `radius` in pixels, `steps` in the key; and its range of view
    depths."""

    radius: float
    steps: float
    first: float
    last: float


class _Gathered(NamedTuple):
    """What `_gather` writes: of sample i, from `starts[i]` on, `counts[i]` triangles' places in
    cluster order, least and greatest depths, and whether they are certain to be in the way."""

    starts: Int64
    counts: Int64
    place: Int32
    near: Float64
    far: Float64
    certain: NDArray[np.bool_]


def surfaces_at(
    exact: ExactScene, camera: Camera, samples: Int64, tolerance: RasterTolerance
) -> Surfaces:
    """What a rasteriser of this tolerance may see at some samples, (k,) flat indices."""
    depth = depth_buffer(camera, exact, tolerance)
    view = with_doubtful_range(view_of(camera), exact, depth)
    samples = np.asarray(samples, np.int64)
    usable = np.ones(len(exact.corners), np.bool_)
    nearby = near_samples(exact, camera, view, usable, samples, tolerance.snap_px)
    reach = _Reach(tolerance.snap_px, _steps(depth), camera.near, camera.far)
    counts = np.zeros(len(samples), np.int64)
    for keep in (False, True):  # count, then fill
        starts = np.concatenate([[0], np.cumsum(counts)])
        room = int(starts[-1]) if keep else 0
        place, certain = np.empty(room, np.int32), np.empty(room, np.bool_)
        near, far = np.empty(room), np.empty(room)
        gathered = _Gathered(starts, counts, place, near, far, certain)
        _gather(nearby, exact.corners, view, reach, keep, gathered)
    owner = np.repeat(np.arange(len(samples)), counts)
    limit = np.full(len(samples), np.inf)
    np.minimum.at(limit, owner[certain], far[certain])
    kept = near <= limit[owner]
    return Surfaces(
        offsets=np.concatenate([[0], np.cumsum(np.bincount(owner[kept], minlength=len(samples)))]),
        triangle=exact.order[place[kept]],
        near=near[kept],
        far=far[kept],
        limit=limit,
    )


def depth_doubt(
    exact: ExactScene, camera: Camera, points: Float32, tolerance: RasterTolerance
) -> tuple[Float64, Float64]:
    """Between which view depths a rasteriser may place points that are not moved on the screen:
    (n, 3) float32 -> two (n,) float64."""
    steps = _steps(depth_buffer(camera, exact, tolerance))
    relative = points.astype(np.float64) - camera.eye
    depth = relative @ view_of(camera).z_dual
    moved = TRANSFORM * np.linalg.norm(relative, axis=1)
    with np.errstate(divide="ignore"):
        key = 1.0 / depth if camera.is_perspective else -depth
        if not camera.is_perspective:
            return -(key + steps) - moved, steps - key + moved
        far = np.where(key > steps, 1.0 / (key - steps), np.inf)
        return 1.0 / (key + steps) - moved, far + moved


def _steps(depth: DepthBuffer) -> float:
    """The depth buffer's error in the key."""
    return (DEPTH_STEPS * 2.0**-24 + depth.step) * depth.scale


@njit(error_model="numpy")
def _gather(
    nearby: Nearby,
    corners: NDArray[Any],
    view: View,
    reach: _Reach,
    keep: bool,
    gathered: _Gathered,
) -> None:
    """Count the triangles that a rasteriser may show at each sample; with `keep` note them."""
    xs, ys, tiles, binned = nearby
    found, boxes, _, bin_offsets, bin_entries, _ = binned
    radius, steps, first, last = reach
    starts, counts, place, near, far, certain = gathered
    polygon, tags = np.empty((4, 3)), np.empty(4, np.int8)
    for index in range(len(xs)):
        x, y = np.float64(xs[index]), np.float64(ys[index])
        at = starts[index]
        for entry in range(bin_offsets[tiles[index]], bin_offsets[tiles[index] + 1]):
            k = bin_entries[entry]
            if x < boxes[k, X0] or x > boxes[k, X1] or y < boxes[k, Y0] or y > boxes[k, Y1]:
                continue
            corner = corners[found[k]]
            count, slop = screen_polygon(corner, view, polygon, tags)
            if count == 0 or distance_to_polygon(x, y, polygon, count) > radius + slop:
                continue
            low, high = key_range(x, y, radius + slop, polygon, count)
            moved = 0.0
            for i in range(3):
                distance = 0.0
                for axis in range(3):
                    distance += (np.float64(corner[3 * i + axis]) - view.e[axis]) ** 2
                moved = max(moved, TRANSFORM * math.sqrt(distance))
            if view.perspective:
                least = 1.0 / (high + steps) - moved
                greatest = 1.0 / (low - steps) + moved if low > steps else np.inf
            else:
                least, greatest = -(high + steps) - moved, steps - low + moved
            if greatest < first or least > last:
                continue
            if keep:
                rim = np.inf
                for i in range(count):
                    j = i + 1 if i + 1 < count else 0
                    rim = min(
                        rim,
                        distance_to_segment(
                            x, y, polygon[i, 0], polygon[i, 1], polygon[j, 0], polygon[j, 1]
                        ),
                    )
                inside = distance_to_polygon(x, y, polygon, count) == 0.0
                place[at], near[at], far[at] = found[k], least, greatest
                # Wholly in range too, or the range itself may cut it away.
                certain[at] = inside and rim > radius + slop and least > first and greatest < last
            at += 1
        counts[index] = at - starts[index]
