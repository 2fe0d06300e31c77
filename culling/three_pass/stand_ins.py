"""Low-resolution stand-ins of a scene's objects, by quadric edge collapse.

The simplification is that of Garland and Heckbert 1997 in the library `fast-simplification`. It
compares squared distances with thresholds of its own, so each object is scaled to the unit box
first, else the reduction it reaches hangs on the unit of length.
"""

from __future__ import annotations

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from visref.scene import Float64, Int64, Scene

# A sheet cannot be less than a rectangle.
LEAST_TRIANGLES = 2

# (v, 3) float64 vertices, (t, 3) vertex ids
Mesh = tuple[Float64, Int64]


def stand_ins(scene: Scene, reduction: int, extra: int) -> Scene:
    """A scene of the same objects, each with 1 in `reduction` of its triangles, rounded up; an
    object of at most `extra` triangles as it is. Materials stay what they are, so an object of
    several is simplified material by material."""
    vertices, triangles, one_sided, alpha = [], [], [], []
    offsets, base = [0], 0
    for first, last in zip(scene.object_offsets[:-1], scene.object_offsets[1:], strict=True):
        of_object = np.arange(first, last)
        count = 0
        kind = 2 * scene.alpha[of_object].astype(np.int64) + scene.one_sided[of_object]
        for number in np.unique(kind):
            chosen = scene.triangles[of_object[kind == number]]
            used, index = np.unique(chosen, return_inverse=True)
            points, faces = scene.vertices[used].astype(np.float64), index.reshape(-1, 3)
            if len(of_object) > extra:
                points, faces = simplified((points, faces), -(-len(faces) // reduction))
            vertices.append(points.astype(np.float32))
            triangles.append(faces + base)
            one_sided.append(np.full(len(faces), bool(number & 1)))
            alpha.append(np.full(len(faces), number >> 1, np.uint8))
            base += len(points)
            count += len(faces)
        offsets.append(offsets[-1] + count)
    return Scene(
        vertices=np.concatenate([*vertices, np.zeros((0, 3), np.float32)]),
        triangles=np.concatenate([*triangles, np.zeros((0, 3), np.int64)]).astype(np.int32),
        object_offsets=np.array(offsets, np.int64),
        names=scene.names,
        one_sided=np.concatenate([*one_sided, np.zeros(0, np.bool_)]),
        alpha=np.concatenate([*alpha, np.zeros(0, np.uint8)]),
        source=f"stand-ins of {scene.source}",
    )


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
