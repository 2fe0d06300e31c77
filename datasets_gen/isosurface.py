"""A triangle mesh of a scalar field's zero set, by marching tetrahedra.

Each grid cell is cut into six tetrahedra about its main diagonal (Kuhn's subdivision), the
same way in every cell, so that neighbours share their faces and the surface has no cracks. It
ends openly where it leaves the grid.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# How near to a grid vertex, as a share of the edge, the surface may cut an edge. Nearer cuts
# are moved there: without this, triangles shrink to nothing where the field is nearly zero.
NEAREST_CUT = 0.06


def isosurface(field: NDArray[np.float32]) -> tuple[Float64, Int64]:
    """(v, 3) float64 vertices in grid coordinates and (t, 3) triangles, facing the negative
    side, of the surface between the positive and the other vertices of a 3-D grid."""
    inside = field > 0.0
    cells = np.flatnonzero(_mixed(inside).reshape(-1))
    x, y, z = np.unravel_index(cells, [side - 1 for side in field.shape])
    stride = np.array([field.shape[1] * field.shape[2], field.shape[2], 1])
    first = x * stride[0] + y * stride[1] + z
    edges = []
    outward = []
    for axes in permutations(range(3)):
        corners = first[:, None] + np.concatenate([[0], np.cumsum(stride[list(axes)])])
        cut_edges, cut_outward = _cut(corners, inside.reshape(-1), stride)
        edges.append(cut_edges)
        outward.append(cut_outward)
    ends = np.sort(np.concatenate(edges), axis=2)
    keys = ends[:, :, 0] * field.size + ends[:, :, 1]
    unique, index = np.unique(keys, return_inverse=True)
    vertices = _vertices(field, unique)
    triangles = index.reshape(-1, 3)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    backward = (np.cross(b - a, c - a) * np.concatenate(outward)).sum(axis=1) < 0.0
    triangles[backward] = triangles[backward][:, ::-1]
    return vertices, triangles


def _mixed(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True for every cell with corners on both sides."""
    every, some = inside, inside
    for axis in range(3):
        low = tuple(slice(None, -1) if k == axis else slice(None) for k in range(3))
        high = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
        every, some = every[low] & every[high], some[low] | some[high]
    return some & ~every


def _cut(corners: Int64, inside: NDArray[np.bool_], stride: Int64) -> tuple[Int64, Float64]:
    """The triangles that cut (m, 4) tetrahedra: (t, 3, 2) grid vertices of the edges that
    their corners lie on, and (t, 3) a direction from the inside out."""
    sign = inside[corners]
    # Inside corners first, so that the number of them is the whole case distinction.
    corners = np.take_along_axis(corners, np.argsort(~sign, axis=1, kind="stable"), axis=1)
    count = sign.sum(axis=1)
    edges = []
    outward = []
    for inner, triangles in (
        (1, [((0, 1), (0, 2), (0, 3))]),
        (3, [((0, 3), (1, 3), (2, 3))]),
        (2, [((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2))]),
    ):
        tetrahedra = corners[count == inner]
        places = np.stack(
            [
                tetrahedra // stride[0],
                tetrahedra // stride[1] % (stride[0] // stride[1]),
                tetrahedra % stride[1],
            ],
            axis=2,
        )
        way = places[:, inner:].mean(axis=1) - places[:, :inner].mean(axis=1)
        for triangle in triangles:
            edges.append(tetrahedra[:, triangle])
            outward.append(way)
    return np.concatenate(edges), np.concatenate(outward)


def _vertices(field: NDArray[np.float32], keys: Int64) -> Float64:
    """Where the field, taken as linear, is zero on each edge."""
    values = field.reshape(-1).astype(np.float64)
    low, high = keys // field.size, keys % field.size
    share = values[low] / (values[low] - values[high])
    share = np.clip(share, NEAREST_CUT, 1.0 - NEAREST_CUT)[:, None]
    start = np.stack(np.unravel_index(low, field.shape), axis=1)
    end = np.stack(np.unravel_index(high, field.shape), axis=1)
    return np.asarray(start + share * (end - start), np.float64)
