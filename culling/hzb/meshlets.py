"""A scene's triangles in meshlets: small units, each of one object.

A meshlet has at most 64 vertices and 124 triangles, which is what mesh shaders are mostly given.
Established libraries that make meshlets have no bindings for Python that do, so they are made here.
An object's triangles are taken along a Morton curve through their centres, and a meshlet ends where
it is full. That is deterministic, of one pass, and leaves no triangle out; meshlets grown along
shared edges would hold more triangles where vertices are what fills them.

Triangles that can have a backface cone (`cones`) share no meshlet with those that cannot.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Int64, Scene, Units
from visref_culling.hzb.cones import with_cone

MOST_VERTICES, MOST_TRIANGLES = 64, 124
MORTON_BITS = 16  # per axis; only how compact meshlets are hangs on it


def meshlets_of(scene: Scene) -> Units:
    """Every triangle of the scene in one meshlet, those of an object together.

    An absent object's triangles count with three vertices each, which are not known: they may
    appear later.
    """
    group = 2 * scene.object_of_triangle.astype(np.int64) + with_cone(scene)
    order = np.lexsort((_along_a_curve(scene), group)).astype(np.int32)
    starts = np.zeros(len(order), np.bool_)
    _cut(scene.triangles, order, group, np.full(len(scene.vertices), -1, np.int64), starts)
    return Units(np.append(np.flatnonzero(starts), len(order)), order, "meshlet")


def _along_a_curve(scene: Scene) -> Int64:
    """(t,) int64 keys of the triangles' centres on a Morton curve through their object's box."""
    boxes = scene.object_bounds
    boxes = np.where(np.isfinite(boxes), boxes, 0.0)[scene.object_of_triangle]
    low, size = boxes[:, 0], boxes[:, 1] - boxes[:, 0]
    centres = scene.vertices[scene.triangles].mean(axis=1, dtype=np.float64)
    places = (centres - low) / np.where(size > 0.0, size, 1.0)
    most = (1 << MORTON_BITS) - 1
    cells = np.clip(places * most, 0, most).astype(np.int64)
    keys = np.zeros(len(cells), np.int64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            keys |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return keys


@njit(makes_arrays=False)
def _cut(
    triangles: NDArray[Any],
    order: NDArray[Any],
    group: NDArray[Any],
    last_of: NDArray[Any],
    starts: NDArray[Any],
) -> None:
    """Mark in `starts` where meshlets begin in `order`. `last_of`: (v,) int64, the place where the
    last meshlet that has a vertex begins, -1 at first."""
    first = vertices = 0
    for k in range(len(order)):
        a, b, c = triangles[order[k]]
        known = a != b or b != c
        new = 3
        if known:
            # Two corners that are one vertex count once.
            new = int(last_of[a] < first) + int(b != a and last_of[b] < first)
            new += int(c != a and c != b and last_of[c] < first)
        full = k - first == MOST_TRIANGLES or vertices + new > MOST_VERTICES
        if k == 0 or full or group[order[k]] != group[order[k - 1]]:
            starts[k] = True
            first, vertices = k, 0
            new = 1 + int(b != a) + int(c != a and c != b) if known else 3
        vertices += new
        if known:
            last_of[a] = last_of[b] = last_of[c] = first
