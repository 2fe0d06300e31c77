"""What a rasteriser may see at a sample: every surface within its snap, with its depths.

A rasteriser that moves each vertex by at most `snap_px` shows at a sample, of every triangle,
only depths that the triangle has within `snap_px` of it, give or take a depth step and the
float32 transform's error. It may show no other triangle; and it must show a triangle that
covers the whole disc of that radius, or something nearer. The geometry is that of the margins
(`visref.exact.margins`), in float64 with its error counted.

Which way this errs: outward. A sample on an edge that two triangles share lies wholly in
neither, so what is behind them counts as possible too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import RasterTolerance
from visref.exact import ExactScene, screen
from visref.exact.filters import View, view_of
from visref.exact.margins import depth_rows, key_error, with_doubtful_range
from visref.exact.polygons import (
    distance_to_polygon,
    distance_to_segment,
    key_range,
    screen_polygon,
)
from visref.scene import Float64, Int32, Int64


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


def surfaces_at(
    exact: ExactScene, camera: Camera, samples: Int64, tolerance: RasterTolerance
) -> Surfaces:
    """What a rasteriser of this tolerance may see at some samples, (k,) flat indices."""
    rows = depth_rows(camera, exact, tolerance)
    view = with_doubtful_range(view_of(camera), exact, rows)
    samples = np.asarray(samples, np.int64)
    wanted = np.zeros((camera.height, camera.width), np.bool_)
    wanted.reshape(-1)[samples] = True
    # Half a pixel more than the radius holds every box's rounding.
    found, boxes, _ = exact.project(
        view, np.ones(len(exact.corners), np.bool_), wanted, tolerance.snap_px + 0.5
    )
    columns, tiles_down = -(-camera.width // screen.TILE), -(-camera.height // screen.TILE)
    y, x = samples // camera.width, samples % camera.width
    tile = y // screen.TILE * columns + x // screen.TILE
    tiles = np.zeros(tiles_down * columns, np.bool_)
    tiles[tile] = True
    offsets, entries = screen.bin_boxes(boxes, tiles, columns)
    counts = np.zeros(len(samples), np.int64)
    for keep in (False, True):  # count, then fill
        starts = np.concatenate([[0], np.cumsum(counts)])
        room = int(starts[-1]) if keep else 0
        place, certain = np.empty(room, np.int32), np.empty(room, np.bool_)
        near_key, far_key = np.empty(room), np.empty(room)
        _gather(
            x, y, tile, view, exact.corners, found, boxes, offsets, entries,
            tolerance.snap_px, rows, keep, starts, counts, place, near_key, far_key, certain,
        )  # fmt: skip
    near, far = _depths(view, near_key, far_key)
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
    exact: ExactScene, camera: Camera, points: NDArray[np.float32], tolerance: RasterTolerance
) -> tuple[Float64, Float64]:
    """Between which view depths a rasteriser may place points that are not moved on the screen:
    (n, 3) float32 -> two (n,) float64."""
    rows, view = depth_rows(camera, exact, tolerance), view_of(camera)
    step = rows[2, 0] * rows[2, 1]
    depth = (points.astype(np.float64) - camera.eye) @ view.z_dual
    doubt = np.array([key_error(np.tile(point, 3), view, rows) + step for point in points])
    with np.errstate(divide="ignore"):
        key = 1.0 / depth if camera.is_perspective else -depth
    return _depths(view, key + doubt, key - doubt)


def _depths(view: View, near_key: Float64, far_key: Float64) -> tuple[Float64, Float64]:
    if not view.perspective:
        return -near_key, -far_key
    with np.errstate(divide="ignore"):
        return 1.0 / near_key, np.where(far_key > 0.0, 1.0 / far_key, np.inf)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _gather(
    xs: NDArray[Any],
    ys: NDArray[Any],
    tiles: NDArray[Any],
    view: View,
    corners: NDArray[Any],
    found: NDArray[Any],
    boxes: NDArray[Any],
    bin_offsets: NDArray[Any],
    bin_entries: NDArray[Any],
    radius: float,
    rows: NDArray[Any],
    keep: bool,
    starts: NDArray[Any],
    counts: NDArray[Any],
    place: NDArray[Any],
    near_key: NDArray[Any],
    far_key: NDArray[Any],
    certain: NDArray[Any],
) -> None:
    polygon, tags = np.empty((4, 3)), np.empty(4, np.int8)
    step = rows[2, 0] * rows[2, 1]
    for index in range(len(xs)):
        x, y = np.float64(xs[index]), np.float64(ys[index])
        at = starts[index]
        for entry in range(bin_offsets[tiles[index]], bin_offsets[tiles[index] + 1]):
            k = bin_entries[entry]
            if x < boxes[k, 0] or x > boxes[k, 1] or y < boxes[k, 2] or y > boxes[k, 3]:
                continue
            count, slop = screen_polygon(corners[found[k]], view, polygon, tags)
            if count == 0 or distance_to_polygon(x, y, polygon, count) > radius + slop:
                continue
            doubt = step + key_error(corners[found[k]], view, rows)
            low, high = key_range(x, y, radius + slop, polygon, count)
            if low - doubt > rows[2, 2] or high + doubt < rows[2, 3]:
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
                place[at] = found[k]
                near_key[at], far_key[at] = high + doubt, low - doubt
                # Wholly in range too, or the range itself may cut it away.
                certain[at] = (
                    inside
                    and rim > radius + slop
                    and high + doubt < rows[2, 2]
                    and low - doubt > rows[2, 3]
                )
            at += 1
        counts[index] = at - starts[index]
