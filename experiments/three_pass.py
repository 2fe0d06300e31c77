"""How well a simplification foretells its own occlusion errors: the slides' last open question.

They ask for "measures that predict potential occlusion errors". Three are tried here. All come
from the offsets between a tile and its stand-in, at each of the tile's vertices the way to the
nearest point of the stand-in, found once, when simplifying. For a tile and a frame:

- "deviation": the offsets' root mean square, in pixels at the tile's nearest depth;
- "displacement": the root mean square, over the offsets in view, of their part across the line of
  sight, in pixels at their own depth. An offset along the line of sight moves no outline;
- "outline": the displacement times four times the square root of the samples that the second pass
  counted, in pixels. A square's outline is so long, and what is wrong lies in a band along it.

The error measured beside them: the pixels that the tile owns in one of the two images, of the scene
and of the stand-ins, and not in the other; and those of tiles whose stand-in owns none, which the
method misses. Both images are GL's own, so that no rasteriser's rounding comes between them.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.compiled import njit
from visref.scene import Float64, Int64, Scene
from visref.visibility import BACKGROUND
from visref_culling.boxes.conservative import inflated, nearest_depth
from visref_culling.boxes.hierarchy import BoxTree
from visref_culling.gl.device import device
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.gl.view import View
from visref_culling.three_pass.stand_ins import stand_ins

REDUCTIONS = (10, 30, 100, 300, 1000)
# Objects of no more triangles stand in for themselves: `seismic`'s faults have 252.
EXTRA = 500
MEASURES = ("deviation", "displacement", "outline")


def prediction(scene: Scene, path: CameraPath) -> dict[str, Any]:
    """For each reduction the correlations of each measure with the wrong pixels of a tile, and
    over all reductions with those of a frame and with the missed pixels of a frame."""
    truths = _owners(scene, path)
    by_reduction = []
    for reduction in REDUCTIONS:
        started = time.perf_counter()
        low = stand_ins(scene, reduction, EXTRA)
        simplified = time.perf_counter()
        tiles = np.flatnonzero(np.diff(scene.object_offsets) > EXTRA)
        offsets = {int(tile): _offsets(scene, low, int(tile)) for tile in tiles}
        found = time.perf_counter()
        images = zip(path, truths, _owners(low, path), strict=True)
        frames = [_Frame(scene, *frame, offsets) for frame in images]
        by_reduction.append(_summary(reduction, frames))
        by_reduction[-1] |= {
            "simplify_ms": 1e3 * (simplified - started),
            "offsets_ms": 1e3 * (found - simplified),
            "triangles": low.triangle_count,
        }
    wrong = _joined(by_reduction, "frame_wrong")
    missed = _joined(by_reduction, "frame_missed")
    pooled = {}
    for name in MEASURES:
        foretold = _joined(by_reduction, f"frame_{name}")
        pooled[name] = {
            "wrong_spearman": spearman(foretold, wrong),
            "wrong_pearson": pearson(foretold, wrong),
            "missed_spearman": spearman(foretold, missed),
        }
    return {"frames": len(path), "reductions": by_reduction, "pooled": pooled}


class _Frame:
    """One frame at one reduction: per tile in view, the measures and the errors."""

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        truth: Int64,
        stand_in: Int64,
        offsets: dict[int, tuple[Float64, Float64]],
    ) -> None:
        view = View.of(camera, scene, device().subpixel_bits)
        shown = BoxTree(scene.object_bounds).in_frustum(view)
        self.tiles = np.array([tile for tile in shown.tolist() if tile in offsets], np.int64)
        count = scene.object_count
        truths, answers, both = (
            np.bincount(ids[ids >= 0], minlength=count)[self.tiles]
            for ids in (truth, stand_in, np.where(truth == stand_in, truth, BACKGROUND))
        )
        self.wrong = (truths + answers - 2 * both).astype(np.float64)
        self.missed = np.where(answers == 0, truths, 0).astype(np.float64)
        self.seen = (truths > 0) | (answers > 0)
        nearest = nearest_depth(view, inflated(view, scene.object_bounds[self.tiles]))
        deviation = np.zeros(len(self.tiles))
        displacement = np.zeros(len(self.tiles))
        for at, tile in enumerate(self.tiles.tolist()):
            points, moved = offsets[tile]
            depth = max(float(nearest[at]), camera.near) if camera.is_perspective else 1.0
            mean = float(np.einsum("ij,ij->i", moved, moved).mean())
            deviation[at] = math.sqrt(mean) / (_pixel(camera) * depth)
            displacement[at] = root_mean_square_across(camera, points, moved)
        self.measures = {
            "deviation": deviation,
            "displacement": displacement,
            "outline": displacement * 4.0 * np.sqrt(answers),
        }


def root_mean_square_across(camera: Camera, points: Float64, offsets: Float64) -> float:
    """Of offsets (k, 3) at points (k, 3): the root mean square of their parts across the line of
    sight, in pixels, over those in view; 0 where none is."""
    at, depth = camera.pixel_of(points)
    inside = (depth >= camera.near) & (depth <= camera.far)
    for axis, side in enumerate((camera.width, camera.height)):
        inside &= (at[:, axis] >= -0.5) & (at[:, axis] <= side - 0.5)
    if not inside.any():
        return 0.0
    offsets, depth = offsets[inside], depth[inside]
    if camera.is_perspective:
        sight = points[inside] - camera.eye
        along = np.einsum("ij,ij->i", offsets, sight) / np.linalg.norm(sight, axis=1)
    else:
        along, depth = offsets @ camera.forward, np.ones(len(depth))
    squared = np.einsum("ij,ij->i", offsets, offsets) - along**2
    return float(np.sqrt((np.maximum(squared, 0.0) / (_pixel(camera) * depth) ** 2).mean()))


def _pixel(camera: Camera) -> float:
    """A pixel's width in world units, at unit depth in a perspective view."""
    return 2.0 * camera.half_pixel


def _summary(reduction: int, frames: list[_Frame]) -> dict[str, Any]:
    wrong = np.concatenate([frame.wrong[frame.seen] for frame in frames])
    result: dict[str, Any] = {
        "reduction": reduction,
        "tiles": len(wrong),
        "wrong": float(wrong.sum()),
        "missed": float(sum(frame.missed.sum() for frame in frames)),
        "frame_wrong": [float(frame.wrong.sum()) for frame in frames],
        "frame_missed": [float(frame.missed.sum()) for frame in frames],
    }
    for name in MEASURES:
        values = [frame.measures[name] for frame in frames]
        of_tile = np.concatenate([v[f.seen] for v, f in zip(values, frames, strict=True)])
        result[name] = {
            "spearman": spearman(of_tile, wrong),
            "pearson": pearson(of_tile, wrong),
            "mean": float(of_tile.mean()) if len(of_tile) else 0.0,
        }
        result[f"frame_{name}"] = [
            float(v[f.seen].sum()) for v, f in zip(values, frames, strict=True)
        ]
    return result


def _joined(summaries: list[dict[str, Any]], key: str) -> Float64:
    return np.concatenate([np.array(one[key], np.float64) for one in summaries])


def _owners(scene: Scene, path: CameraPath) -> list[Int64]:
    """Of each frame the object that owns each pixel, (h * w,) int64, `BACKGROUND` for none."""
    raster = GLRaster(scene)
    owners = []
    for camera in path:
        ids = raster.item_buffer(camera).reshape(-1)
        owner = np.where(ids >= 0, scene.object_of_triangle[ids], BACKGROUND)
        owners.append(owner.astype(np.int64))
    raster.close()
    return owners


def _offsets(scene: Scene, low: Scene, tile: int) -> tuple[Float64, Float64]:
    """A tile's vertices, (k, 3), and from each the way to the stand-in's surface, (k, 3)."""
    own, other = (
        one.triangles[one.object_offsets[tile] : one.object_offsets[tile + 1]]
        for one in (scene, low)
    )
    points = scene.vertices[np.unique(own)].astype(np.float64)
    return points, nearest_points(points, low.vertices[other].astype(np.float64)) - points


@njit()
def nearest_points(points: NDArray[Any], triangles: NDArray[Any]) -> NDArray[Any]:
    """The point of (t, 3, 3) triangles nearest to each of (k, 3) points, (k, 3) float64.

    Of a triangle that is the foot on its plane where that lies inside, else the nearest of the
    feet on its sides. A triangle whose ball lies beyond the best point so far is passed over.
    """
    result = np.empty_like(points)
    foot, ball = np.empty(3), np.empty((len(triangles), 4))
    for t in range(len(triangles)):
        ball[t] = 0.0
        for i in range(3):
            ball[t, i] = (triangles[t, 0, i] + triangles[t, 1, i] + triangles[t, 2, i]) / 3.0
        for corner in range(3):
            away = 0.0
            for i in range(3):
                away += (triangles[t, corner, i] - ball[t, i]) ** 2
            ball[t, 3] = max(ball[t, 3], math.sqrt(away))
    best = 0
    for k in range(len(points)):
        least = np.inf
        # The last point's triangle comes first: neighbours often share it, and it rules out most.
        first = best
        for place in range(-1, len(triangles)):
            t = first if place < 0 else place
            away = 0.0
            for i in range(3):
                away += (points[k, i] - ball[t, i]) ** 2
            if math.sqrt(away) - ball[t, 3] > math.sqrt(least):
                continue
            # Three sides, then the plane.
            for side in range(4):
                if side < 3:
                    _on_side(points[k], triangles[t, side], triangles[t, (side + 1) % 3], foot)
                elif not _on_plane(points[k], triangles[t], foot):
                    continue
                away = 0.0
                for i in range(3):
                    away += (foot[i] - points[k, i]) ** 2
                if away < least:
                    least, best = away, t
                    result[k] = foot
    return result


@njit()
def _on_side(point: NDArray[Any], start: NDArray[Any], end: NDArray[Any], foot: Any) -> None:
    length = reached = 0.0
    for i in range(3):
        length += (end[i] - start[i]) ** 2
        reached += (end[i] - start[i]) * (point[i] - start[i])
    t = min(max(reached / length, 0.0), 1.0) if length > 0.0 else 0.0
    for i in range(3):
        foot[i] = start[i] + t * (end[i] - start[i])


@njit()
def _on_plane(point: NDArray[Any], triangle: NDArray[Any], foot: Any) -> bool:
    """Put the foot on the triangle's plane; whether it lies in the triangle."""
    uu = uv = vv = wu = wv = 0.0
    for i in range(3):
        u, v = triangle[1, i] - triangle[0, i], triangle[2, i] - triangle[0, i]
        w = point[i] - triangle[0, i]
        uu, uv, vv = uu + u * u, uv + u * v, vv + v * v
        wu, wv = wu + w * u, wv + w * v
    area = uu * vv - uv * uv
    if area <= 0.0:
        return False
    b, c = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    for i in range(3):
        u, v = triangle[1, i] - triangle[0, i], triangle[2, i] - triangle[0, i]
        foot[i] = triangle[0, i] + b * u + c * v
    return b >= 0.0 and c >= 0.0 and b + c <= 1.0


def pearson(x: Float64, y: Float64) -> float | None:
    """The correlation coefficient of two (n,) float64, None where one of them does not vary."""
    if len(x) < 2 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return None
    return float(np.corrcoef(x, y)[0, 1])


def spearman(x: Float64, y: Float64) -> float | None:
    """The same of the ranks of two (n,) float64; equals share the mean of theirs."""
    return pearson(_ranks(x), _ranks(y))


def _ranks(values: Float64) -> NDArray[np.float64]:
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return np.asarray((last - 0.5 * (count - 1))[place.reshape(-1)], np.float64)
