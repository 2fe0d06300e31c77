"""An object as a model of its own, in millimetres, and where it stands in a frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Float64, Int32, Int64, Scene

MM = 1000.0
# Two poses' vertices are rounded to float32 each, by 2^-24 of the greatest coordinate in each axis,
# and the rotation that fits them best is off by as much: 2^-24 (2 sqrt 3) twice, below 2^-21.
RIGID = 2.0**-21


@dataclass(frozen=True, eq=False)
class Model:
    """An object as it stood in some scene. `rows`: (v,) its vertices there; `triangles`: (t, 3)
    int32 places in those; `points`: (v, 3) float64, relative to `centre`, the middle of its box,
    which is relative to the scene's origin."""

    scene: Scene
    rows: Int64
    triangles: Int32
    points: Float64
    centre: Float64

    @classmethod
    def of(cls, scene: Scene, object_id: int) -> Model:
        first, last = scene.object_offsets[object_id : object_id + 2]
        rows, places = np.unique(scene.triangles[first:last], return_inverse=True)
        world = scene.vertices[rows].astype(np.float64)
        centre = (world.min(axis=0) + world.max(axis=0)) / 2
        triangles = places.reshape(-1, 3).astype(np.int32)
        return cls(scene, rows.astype(np.int64), triangles, world - centre, centre)

    def info(self) -> dict[str, float]:
        """Its box and diameter, as `models_info.json` has them."""
        points = self.points * MM
        low, size = points.min(axis=0), np.ptp(points, axis=0)
        box = {f"min_{axis}": float(low[i]) for i, axis in enumerate("xyz")}
        box |= {f"size_{axis}": float(size[i]) for i, axis in enumerate("xyz")}
        return {"diameter": diameter(points), **box}

    def write(self, file: Path) -> None:
        """Write it as a PLY file (ASCII)."""
        head = [
            "ply",
            "format ascii 1.0",
            f"element vertex {len(self.points)}",
            *(f"property double {axis}" for axis in ("x", "y", "z", "nx", "ny", "nz")),
            f"element face {len(self.triangles)}",
            "property list uchar int vertex_indices",
            "end_header",
        ]
        values = np.hstack([self.points * MM, normals(self.points, self.triangles)])
        rows = [" ".join(map(repr, row)) for row in values.tolist()]
        faces = [f"3 {a} {b} {c}" for a, b, c in self.triangles.tolist()]
        file.write_text("\n".join([*head, *rows, *faces]) + "\n", encoding="ascii")


def normals(points: Float64, triangles: Int32) -> Float64:
    """(v, 3) unit normals of vertices, (v, 3): the sums of those of their triangles, (t, 3) places,
    by the triangles' angles there, as BOP has them. +Z where there is none. Source: G. Thürmer,
    C. A. Wüthrich: Computing vertex normals from polygonal facets. JGT 3(1), 1998."""
    sums = np.zeros_like(points)
    corners = points[triangles]
    for at in range(3):
        one, other = (corners[:, (at + k) % 3] - corners[:, at] for k in (1, 2))
        across = np.cross(one, other)
        area = np.linalg.norm(across, axis=1)
        angle = np.arctan2(area, (one * other).sum(axis=1))
        facing = across / np.where(area > 0.0, area, 1.0)[:, None]
        np.add.at(sums, triangles[:, at], facing * angle[:, None])
    length = np.linalg.norm(sums, axis=1)
    sums[length == 0.0] = (0.0, 0.0, 1.0)
    result: Float64 = sums / np.where(length > 0.0, length, 1.0)[:, None]
    return result


def pose_between(model: Model, scene: Scene) -> tuple[Float64, Float64] | None:
    """The rotation, (3, 3), and the place of the model's origin, (3,), that take a model to where
    its object stands in another moment's scene, after Kabsch, "A solution for the best rotation to
    relate two sets of vectors" (1976); None where no rotation does."""
    world = scene.vertices[model.rows].astype(np.float64)
    if np.array_equal(world, model.scene.vertices[model.rows].astype(np.float64)):
        return np.eye(3), model.centre
    before, after = model.points.mean(axis=0), world.mean(axis=0)
    left, _, right = np.linalg.svd((world - after).T @ (model.points - before))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left * sign) @ right
    at = after - rotation @ before
    off = np.abs(model.points @ rotation.T + at - world).max()
    largest = max(np.abs(world).max(), np.abs(model.points + model.centre).max())
    return None if off > RIGID * largest else (rotation, at)


def diameter(points: Float64) -> float:
    """The greatest distance between two of (n, 3) points, n at least 1."""
    points = np.unique(points, axis=0)
    away = np.linalg.norm(points - (points.min(axis=0) + points.max(axis=0)) / 2, axis=1)
    order = np.argsort(-away, kind="stable")
    return float(_diameter(points[order], away[order]))


@njit(error_model="numpy")
def _diameter(points: NDArray[Any], away: NDArray[Any]) -> float:
    """Two points are no further apart than their distances from the middle together, which fall."""
    best = 0.0
    for i in range(len(points)):
        if 2.0 * away[i] < best:
            break
        for j in range(i + 1, len(points)):
            # A little outward, for the rounding of the three.
            if (away[i] + away[j]) * (1.0 + 2.0**-48) < best:
                break
            d = 0.0
            for k in range(3):
                d += (points[i, k] - points[j, k]) ** 2
            best = max(best, np.sqrt(d))
    return best
