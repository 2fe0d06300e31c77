"""Whether a one-sided scene is wound the wrong way round: a question about the input.

With one-sided triangles a model that is wound the wrong way shows its far walls and hides its near
ones, in the truth as in the engine. Two signs are looked at together, since neither is enough:

- *What cameras see.* With both sides taken as solid, most of what they meet first are back faces.
  Sheets (a terrain) have no other sign. But where a ground of the right winding fills the
  pictures, objects that are inside out stay below one half.
- *What objects enclose.* A closed object of negative volume is inside out if it is a solid, and
  right if it is a room that is looked at from within. So it counts only if the cameras see more
  of its backs than of its fronts: of a room, from within, they see fronts. Objects that no camera
  sees say nothing, for whether they are rooms cannot be told.

A room that is wound as a solid and looked at from within is accused by the first sign, rightly:
its walls do not show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.engines.base import TruthEngine
from visref.findings import Code, Finding
from visref.judging.limits import share, sparse
from visref.picking import evenly_picked
from visref.scene import Int32, Int64, Scene
from visref.wording import counted

# Triangles of closed objects that are examined: some two seconds' work.
TRIANGLES = 1 << 20


def inside_out(
    kind: type[TruthEngine],
    scene: Scene,
    frames: Sequence[Sequence[Camera]],
    *,
    threads: int | None = None,
) -> list[Finding]:
    """A finding where the scene looks inside out to the cameras of these frames, a list of views
    each, relative to the scene's origin; an engine of this kind casts it with both sides solid.
    Nothing is cast where no triangle is one-sided."""
    if not scene.has_one_sided:
        return []
    both_sided = replace(scene, one_sided=np.zeros(scene.triangle_count, np.bool_))
    solid = kind(both_sided, threads=threads)
    fronts, backs = np.zeros((2, scene.object_count), np.int64)
    hits = 0
    try:
        for camera in (camera for views in frames for camera in views):
            few = sparse(camera)
            owner = solid.frame(few).buffer.triangle.reshape(-1)
            sample = np.flatnonzero(owner >= 0)
            hits += len(sample)
            sample = sample[scene.one_sided[owner[sample]]]
            behind = from_behind(scene, few, sample, owner[sample])
            objects = scene.object_of_triangle[owner[sample]]
            fronts += np.bincount(objects[~behind], minlength=len(fronts))
            backs += np.bincount(objects[behind], minlength=len(backs))
    finally:
        solid.close()
    # Where no object shows more backs than fronts, neither sign can be given.
    if not (backs > fronts).any():
        return []
    seen = _within_budget(scene, np.flatnonzero(fronts + backs).astype(np.int32))
    sign = volume_signs(scene, seen)
    closed = int(np.count_nonzero(sign))
    turned = int(np.count_nonzero((sign < 0) & (backs > fronts)[seen]))
    total = int(backs.sum())
    if 2 * total <= hits and 2 * turned <= closed:
        return []
    text = f"{share(total, hits)} of what the cameras meet in {counted(len(frames), 'frame')} is "
    text += "back faces"
    if closed:
        verb = "is" if turned == 1 else "are"
        text += f", and {turned} of {counted(closed, 'closed object')} met {verb} inside out"
    text += ": turn the winding, or leave --cull-backfaces out"
    return [Finding(Code.INSIDE_OUT, text)]


def from_behind(scene: Scene, camera: Camera, sample: Int64, triangle: Int32) -> NDArray[np.bool_]:
    """(h,) bool: which of these hits (flat sample, triangle) are on the triangle's back."""
    corners = scene.vertices[scene.triangles[triangle]].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    direction = np.broadcast_to(camera.forward, normal.shape)
    if camera.is_perspective:
        y, x = np.divmod(sample, camera.width)
        direction = direction + camera.column_a[x, None] * camera.right_step
        direction = direction + camera.row_b[y, None] * camera.up_step
    behind: NDArray[np.bool_] = (normal * direction).sum(axis=1) > 0.0
    return behind


def volume_signs(scene: Scene, objects: Int32) -> NDArray[np.int8]:
    """(k,) int8 for each of the objects: 1 where it is closed and encloses a positive volume, -1
    a negative one, and 0 where it is open or its volume is none but for rounding.

    Closed: every edge is used as often in one direction as in the other, where a vertex is its
    position; edges between equal positions do not count.
    """
    units = scene.object_units()
    triangles = scene.triangles[units.gather(objects)]
    place = np.repeat(np.arange(len(objects)), units.sizes[objects])
    used, corner = np.unique(triangles, return_inverse=True)
    points = scene.vertices[used]
    position = _positions(points)[corner.reshape(-1)]
    # An object's own positions: neighbours may touch.
    count = int(position.max(initial=0)) + 1
    _, position = np.unique(np.repeat(place, 3) * count + position, return_inverse=True)
    start = position.reshape(-1, 3)
    end = np.roll(start, -1, axis=1)
    size = int(position.max(initial=0)) + 1
    edge = (np.minimum(start, end) * size + np.maximum(start, end)).reshape(-1)
    _, first, which = np.unique(edge, return_index=True, return_inverse=True)
    balance = np.bincount(which.reshape(-1), weights=np.sign(end - start).reshape(-1))
    is_open = np.zeros(len(objects), np.bool_)
    is_open[place[first[balance != 0.0] // 3]] = True

    # Six times the volume, from the object's first vertex: near it, differences are small.
    corners = scene.vertices[triangles].astype(np.float64)
    begins = np.searchsorted(place, np.arange(len(objects)))
    filled = units.sizes[objects] > 0
    base = np.zeros((len(objects), 3))
    base[filled] = corners[begins[filled], 0]
    a, b, c = np.moveaxis(corners - base[place][:, None], 1, 0)
    volume = np.bincount(place, (a * np.cross(b, c)).sum(axis=1), len(objects))
    # Roundings on the longest way to a term: three differences, two products, one difference, two
    # sums, and one for each triangle of the object; the six terms' sizes are summed.
    b, c = np.abs(b), np.abs(c)
    terms = np.abs(a) * (
        np.roll(b, -1, 1) * np.roll(c, -2, 1) + np.roll(b, -2, 1) * np.roll(c, -1, 1)
    )
    size_of = np.bincount(place, terms.sum(axis=1), len(objects))
    bound = size_of * (8.0 + units.sizes[objects]) * 2.0**-52
    sign = np.sign(volume).astype(np.int8)
    sign[is_open | (np.abs(volume) <= bound)] = 0
    return sign


def _positions(points: NDArray[np.float32]) -> Int64:
    """(v,) int64: a number for each point, the same where all three coordinates are."""
    number = np.zeros(len(points), np.int64)
    for axis in range(3):
        values, which = np.unique(points[:, axis], return_inverse=True)
        number = np.unique(number * len(values) + which, return_inverse=True)[1].astype(np.int64)
    return number


def _within_budget(scene: Scene, objects: Int32) -> Int32:
    """Of the objects as many, evenly picked, as have at most `TRIANGLES` triangles together."""
    sizes = np.diff(scene.object_offsets)[objects]
    count = len(objects)
    while count and sizes[evenly_picked(len(objects), count)].sum() > TRIANGLES:
        count //= 2
    picked: Int32 = objects[evenly_picked(len(objects), count)]
    return picked
