"""Geometric truth: who is visible anywhere in the continuous image, not only at its samples.

Objects that own no sample may still show between samples. They are looked for by rays aimed at
them alone: points drawn on their projection inside the view, in rounds that double, and every
still unseen object that a ray meets counts, whoever it was aimed at. What a ray finds is decided
exactly: an image of one pixel whose centre is that point (`point_camera`), so each found object
has a witness that anyone can replay. The search is aggressive: an object that it does not find is
*unseen*. Only what is outside the view or has no area is *hidden*, and that is proven.

Stop rule: rounds of `FIRST_ROUND`, twice, four times … as many rays at each object that is still
unseen: `ROUNDS` of them in any case, and more as long as the frame's rays stay no more than its
samples.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from visref.between.aiming import Aim, SeenMesh, draw_points
from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.engines.rays import RayEngine
from visref.exact import ExactScene
from visref.exact.outside import certainly_outside, degenerate, image_limits, pixel_at
from visref.files import for_arrow
from visref.recordings.truth_file import path_digest
from visref.scene import Alpha, Float64, Int32, Scene
from visref.visibility import BACKGROUND, ObjectVisibility

FIRST_ROUND = 16
ROUNDS = 6
# This share of an object's rays goes evenly to its triangles, so that one small triangle in
# front of a large hidden rest is met too.
EVEN_SHARE = 0.25
# Points of an object decided exactly in one round before the next: where float32 was wrong on an
# edge once, it seldom is at four random points.
TRIES = 4


class Status(IntEnum):
    """What geometric truth says of an object in a frame; the names are those of the file."""

    VISIBLE = 0  # owns a sample
    SUBPIXEL = 1  # owns none, and a witness between the samples shows it
    UNSEEN = 2  # was not found
    HIDDEN = 3  # proven invisible


@dataclass(frozen=True, eq=False)
class FrameGeometry:
    """One frame's objects, (n,) arrays: `status` uint8 (`Status`), and the witness, pixel
    coordinates `x`, `y` and view `depth`, float64, NaN without one. `rays`: how many were cast.
    """

    status: NDArray[np.uint8]
    x: Float64
    y: Float64
    depth: Float64
    rays: int

    def count(self, status: Status) -> int:
        return int(np.count_nonzero(self.status == status))


def point_camera(camera: Camera, x: float, y: float) -> Camera:
    """The camera whose one sample is the image point (x, y) of this one.

    The step is tan(yfov/2) or ymag itself, not a height-th of it, so that the ray's
    coordinates are a / height and b / height. Rounding moves the ray by a few 2^-53 of the
    image; what it shows is decided about this camera's sample, exactly.
    """
    a = 2.0 * (x + camera.shift_x_px) + 1.0 - camera.width
    b = camera.height - 2.0 * (y + camera.shift_y_px) - 1.0
    return replace(
        camera,
        width=1,
        height=1,
        shift_x_px=a / camera.height / 2.0,
        shift_y_px=-b / camera.height / 2.0,
    )


class GeometricSearch:
    """Looks for objects between the samples of a scene's frames.

    `prober` finds candidates, `exact` decides them. The answer depends on the frame's number
    and the objects' ids alone, not on the number of threads.
    """

    def __init__(self, scene: Scene, prober: RayEngine, exact: ExactScene) -> None:
        self.scene = scene
        self._prober = prober
        self._exact = exact

    def frame(self, number: int, camera: Camera, seen: ObjectVisibility) -> FrameGeometry:
        """Geometric truth of one frame, given who owns its samples."""
        scene = self.scene
        found = _Found.of(camera, seen)
        unseen = np.flatnonzero(~seen.visible).astype(np.int32)
        found.status[unseen] = Status.UNSEEN
        boxes = scene.object_bounds[unseen]
        empty = np.diff(scene.object_offsets)[unseen] == 0
        outside = empty.copy()
        outside[~empty] = certainly_outside(camera, _box_corners(boxes[~empty]))
        found.status[unseen[outside]] = Status.HIDDEN
        unseen = unseen[~outside]
        mesh = SeenMesh.of(camera, scene.vertices, scene.triangles, image_limits(camera))
        aim = Aim.at(scene, unseen, mesh)
        for group in np.flatnonzero(aim.extent == 0.0):
            which = aim.which[aim.offsets[group] : aim.offsets[group + 1]]
            if self._nothing_shows(camera, which):
                found.status[aim.objects[group]] = Status.HIDDEN
        aim = aim.only(aim.extent > 0.0)
        rays, start, count = 0, 0, FIRST_ROUND
        for turn in itertools.count():
            aim = aim.only(found.status[aim.objects] == Status.UNSEEN)
            next_rays = count * len(aim.objects)
            if not next_rays or (turn >= ROUNDS and rays + next_rays > camera.samples):
                break
            target, a, b = draw_points(aim, mesh, number, start, count, EVEN_SHARE)
            rays += len(a)
            self._look(camera, target, a, b, found)
            start, count = start + count, 2 * count
        return FrameGeometry(found.status, found.x, found.y, found.depth, rays)

    def close(self) -> None:
        """Free the prober; neither is used afterwards."""
        self._prober.close()

    def verify(self, camera: Camera, obj: int, x: float, y: float) -> float | None:
        """The view depth at which an object shows at an image point, exactly; None if it does
        not, or an alpha texture decides."""
        truth = self._exact.certify(point_camera(camera, x, y))
        if len(truth.undecided):
            return None
        owner = truth.buffer.triangle.reshape(-1)
        owners = np.concatenate([owner[owner != BACKGROUND], truth.ties.triangle])
        if obj in self.scene.object_of_triangle[owners]:
            return float(truth.buffer.depth[0, 0])
        blended = truth.blend.depth[truth.blend.object == obj]
        return float(blended[0]) if len(blended) else None

    def _look(self, camera: Camera, target: Int32, a: Float64, b: Float64, found: _Found) -> None:
        """Cast the rays, and decide what they find."""
        scene = self.scene
        hit = self._prober.probe(camera, a, b)
        met = np.where(hit >= 0, scene.object_of_triangle[hit], BACKGROUND)
        if scene.has_blend:
            blended = np.flatnonzero(scene.alpha[target] == Alpha.BLEND)
            mine = _plane_depth(scene, camera, target[blended], a[blended], b[blended])
            behind = np.full(len(blended), np.inf)
            solid = np.flatnonzero(hit[blended] >= 0)
            at = blended[solid]
            behind[solid] = _plane_depth(scene, camera, hit[at], a[at], b[at])
            front = blended[mine < behind]
            met[front] = scene.object_of_triangle[target[front]]
        candidates = np.flatnonzero(met >= 0)
        candidates = candidates[found.status[met[candidates]] == Status.UNSEEN]
        x, y = pixel_at(camera, a[candidates], b[candidates])
        tries = np.zeros(scene.object_count, np.int64)
        for obj, px, py in zip(met[candidates].tolist(), x.tolist(), y.tolist(), strict=True):
            if found.status[obj] != Status.UNSEEN or tries[obj] == TRIES:
                continue
            tries[obj] += 1
            depth = self.verify(camera, obj, px, py)
            if depth is not None:
                found.status[obj] = Status.SUBPIXEL
                found.x[obj], found.y[obj], found.depth[obj] = px, py, depth

    def _nothing_shows(self, camera: Camera, which: Int32) -> bool:
        """Whether every triangle is proven to show nowhere in the image."""
        corners = self.scene.vertices[self.scene.triangles[which]]
        outside = certainly_outside(camera, corners.astype(np.float64))
        return bool((outside | degenerate(corners)).all())


@dataclass(eq=False)
class _Found:
    """A frame's result in the making."""

    status: NDArray[np.uint8]
    x: Float64
    y: Float64
    depth: Float64

    @classmethod
    def of(cls, camera: Camera, seen: ObjectVisibility) -> _Found:
        """Objects that own a sample, each with one as its witness."""
        row, column = np.divmod(seen.sample, camera.width)
        x, y, depth = (
            np.where(seen.visible, values, np.nan) for values in (column, row, seen.depth)
        )
        return cls(np.full(len(x), Status.VISIBLE, np.uint8), x, y, depth)


def _box_corners(boxes: Float64) -> Float64:
    """(k, 8, 3) float64: the corners of (k, 2, 3) boxes."""
    pick = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    return boxes[:, pick, np.arange(3)]


def _plane_depth(scene: Scene, camera: Camera, which: Int32, a: Float64, b: Float64) -> Float64:
    """View depth of each triangle's plane at an image point; what it decides is re-decided."""
    corners = scene.vertices[scene.triangles[which]].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    side = a[:, None] * camera.right_step + b[:, None] * camera.up_step
    away = corners[:, 0] - camera.eye
    along = camera.forward + side if camera.is_perspective else camera.forward
    away = away if camera.is_perspective else away - side
    with np.errstate(divide="ignore", invalid="ignore"):
        depth: Float64 = (normal * away).sum(axis=1) / (normal * along).sum(axis=1)
    return depth


def geometric_line(frames: Sequence[FrameGeometry]) -> str:
    """What was found, for a reader. Sums over frames."""
    total = {status: sum(frame.count(status) for frame in frames) for status in Status}
    rays = sum(frame.rays for frame in frames)
    return (
        f"{total[Status.SUBPIXEL]} objects visible between the samples alone, "
        f"{total[Status.UNSEEN]} not seen by {rays} rays, {total[Status.HIDDEN]} proven hidden"
    )


_SCHEMA = pa.schema(
    [
        ("frame", pa.int32()),
        ("object", pa.int32()),
        ("name", pa.string()),
        ("status", pa.string()),
        ("x", pa.float64()),
        ("y", pa.float64()),
        ("depth", pa.float64()),
    ]
)
_KEY = b"visref"


def write_geometric(
    file: Path,
    scene: Scene,
    path: CameraPath,
    frames: Iterable[tuple[int, FrameGeometry]],
    *,
    engine: str,
) -> None:
    """A row per frame and object as Parquet; witnesses are null where there is none.

    Of a row that is not hidden or unseen, `point_camera(camera, x, y)` is the camera whose one
    sample shows the object.
    """
    names = pa.array(scene.names, pa.string())
    statuses = pa.array([status.name.lower() for status in Status], pa.string())
    ids = np.arange(scene.object_count, dtype=np.int32)
    parts, numbers, rays = [_SCHEMA.empty_table()], [], 0
    for number, geometry in frames:
        columns: list[Any] = [np.full(len(ids), number, np.int32), ids, names]
        columns.append(statuses.take(pa.array(geometry.status)))
        columns += [
            pa.array(values, from_pandas=True)
            for values in (geometry.x, geometry.y, geometry.depth)
        ]
        parts.append(pa.table(columns, schema=_SCHEMA))
        numbers.append(number)
        rays += geometry.rays
    facts = {
        "format": "visref-geometric",
        "version": 1,
        "engine": engine,
        "scene": scene.digest,
        "path": path_digest(path),
        "frames": numbers,
        "rays": rays,
    }
    table = pa.concat_tables(parts)
    table = table.replace_schema_metadata({_KEY: json.dumps(facts, sort_keys=True)})
    with for_arrow(file, "wb") as out:
        pq.write_table(table, out, compression="zstd")
