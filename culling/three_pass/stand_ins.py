"""Low-resolution stand-ins of a scene's objects, by quadric edge collapse.

The simplification is that of Garland and Heckbert 1997 in the library `fast-simplification`. It
compares squared distances with thresholds of its own, so each object is scaled to the unit box
first, else the reduction it reaches hangs on the unit of length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from visref.scene import Float64, Int64, Scene

# A sheet cannot be less than a rectangle.
LEAST_TRIANGLES = 2

# Each vertex of an object is rounded once to float32, here and there: by 2**-24 of its greatest
# coordinate at most, and the map found for all of them by as much again. Stand-ins promise nothing,
# so four times that is taken for a map still.
AFFINE_ERROR = 2.0**-20

# A flat object says nothing of the direction across: smaller singular values are rounding.
SINGULAR = 1e-6

# (v, 3) float64 vertices, (t, 3) vertex ids
Mesh = tuple[Float64, Int64]


@dataclass(frozen=True, eq=False)
class StandIn:
    """One object's: `points` (v, 3) float64 and `faces` (t, 3) of them, with each face's
    `one_sided`, (t,) bool, and `alpha`, (t,) uint8. It was made of an object whose vertices `used`,
    (k,) ids, were at `at`, (k, 3) float64."""

    points: Float64
    faces: Int64
    one_sided: NDArray[np.bool_]
    alpha: NDArray[np.uint8]
    used: Int64
    at: Float64


class StandIns:
    """Those of all objects of a scene, each with 1 in `reduction` of its object's triangles,
    rounded up; an object of at most `extra` triangles is its own. Materials stay what they are, so
    an object of several is simplified material by material.

    `simplifications`: how many objects were simplified so far, in all moments of the scene.
    """

    def __init__(self, scene: Scene, reduction: int, extra: int) -> None:
        self.reduction, self.extra = reduction, extra
        self.simplifications = 0
        self.of_object = [self._made(scene, i) for i in range(scene.object_count)]

    def update(self, scene: Scene, objects: Int64) -> None:
        """Follow the scene to another moment, in which these objects, (k,) ids, have changed.
        Where all of an object moved as one (`carried`), so does its stand-in; where it was
        deformed, the stand-in is made anew. What stands in for itself is looked at again."""
        for number in objects.tolist():
            if scene.absent is not None and scene.absent[number]:
                continue  # it is not asked about, and its triangles are not there to look at
            old, points = self.of_object[number], None
            if np.diff(scene.object_offsets[number : number + 2]) > self.extra:
                points = carried(old, scene.vertices[old.used].astype(np.float64))
            if points is None:
                self.of_object[number] = self._made(scene, number)
            else:
                self.of_object[number] = replace(old, points=points)

    def scene(self, of: Scene) -> Scene:
        """The stand-ins as a scene of the same objects."""
        parts = self.of_object
        starts = np.cumsum([0, *(len(part.points) for part in parts)])
        faces = [part.faces + start for part, start in zip(parts, starts[:-1], strict=True)]
        points = [part.points.astype(np.float32) for part in parts]
        return Scene(
            vertices=np.concatenate([*points, np.zeros((0, 3), np.float32)]),
            triangles=np.concatenate([*faces, np.zeros((0, 3), np.int64)]).astype(np.int32),
            object_offsets=np.cumsum([0, *map(len, faces)], dtype=np.int64),
            names=of.names,
            one_sided=np.concatenate([*(p.one_sided for p in parts), np.zeros(0, np.bool_)]),
            alpha=np.concatenate([*(p.alpha for p in parts), np.zeros(0, np.uint8)]),
            source=f"stand-ins of {of.source}",
        )

    def _made(self, scene: Scene, number: int) -> StandIn:
        of_object = np.arange(*scene.object_offsets[number : number + 2])
        if scene.absent is not None and scene.absent[number]:
            of_object = of_object[:0]
        large = len(of_object) > self.extra
        self.simplifications += large
        kind = 2 * scene.alpha[of_object].astype(np.int64) + scene.one_sided[of_object]
        points, faces, kinds, base = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], [kind[:0]], 0
        for one in np.unique(kind):
            chosen = scene.triangles[of_object[kind == one]]
            used, index = np.unique(chosen, return_inverse=True)
            mesh: Mesh = scene.vertices[used].astype(np.float64), index.reshape(-1, 3)
            if large:
                mesh = simplified(mesh, -(-len(chosen) // self.reduction))
            points.append(mesh[0])
            faces.append(mesh[1] + base)
            kinds.append(np.full(len(mesh[1]), one))
            base += len(mesh[0])
        of_face = np.concatenate(kinds)
        all_used = np.unique(scene.triangles[of_object]).astype(np.int64)
        return StandIn(
            np.concatenate(points),
            np.concatenate(faces),
            (of_face & 1).astype(np.bool_),
            (of_face >> 1).astype(np.uint8),
            all_used,
            scene.vertices[all_used].astype(np.float64),
        )


def stand_ins(scene: Scene, reduction: int, extra: int) -> Scene:
    """The stand-ins of a scene that stands still; see `StandIns`."""
    return StandIns(scene, reduction, extra).scene(scene)


def carried(part: StandIn, now: Float64) -> Float64 | None:
    """The stand-in's points, (v, 3) float64, where its object's vertices are at `now`, (k, 3)
    float64, by the affine map that takes all of them there; None where there is no such map, or
    nothing to tell it by."""
    if not len(now):
        return None
    middle = part.at.mean(axis=0)
    before, extent = part.at - middle, _extent(part.at)
    rows = np.insert(before / extent, 3, 1.0, axis=1)
    matrix, _, _, _ = np.linalg.lstsq(rows, now, rcond=SINGULAR)
    error = float(np.abs(rows @ matrix - now).max())
    size = max(float(np.abs(part.at).max()), float(np.abs(now).max()))
    if error > AFFINE_ERROR * size:
        return None
    result: Float64 = np.insert((part.points - middle) / extent, 3, 1.0, axis=1) @ matrix
    return result


def simplified(mesh: Mesh, count: int) -> Mesh:
    """A mesh with `count` triangles, at least `LEAST_TRIANGLES`; more where the surface is in
    so many pieces, and the mesh as it is where it has no more."""
    points, faces = mesh
    count = max(count, LEAST_TRIANGLES)
    if len(faces) <= count:
        return mesh
    # Vertices at one place are one, or every triangle of a soup would be a piece of its own.
    points, index = np.unique(points, axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    low, unit = points.min(axis=0), _extent(points)
    moved, left = (points - low) / unit, faces
    # A run keeps to the normals that it started with, and may get stuck; the next one goes on.
    while len(left) > count:
        further = fast_simplification.simplify(moved, left.astype(np.int32), target_count=count)
        if not 0 < len(further[1]) < len(left):
            break
        moved, left = further
    return low + unit * moved, left.astype(np.int64)


def _extent(points: Float64) -> float:
    """The longest side of the points' box, 1 where they are one point."""
    sides: NDArray[np.float64] = np.ptp(points, axis=0)
    return float(sides.max()) or 1.0
