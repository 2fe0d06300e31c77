"""Triangle soup by the handful: quads, boxes, prisms, lathes and lofts, in NumPy.

A `Soup` is (vertices (v, 3) float64, triangles (t, 3) int64), counter-clockwise from outside.
Lengths are metres, y is up.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Soup = tuple[Float64, NDArray[np.int64]]

# Every coordinate is a multiple of 1/1024 m. Together with turns by multiples of 90 degrees
# (and places on the same grid) it makes all products and sums of a transform exact up to 16 km,
# so that a scene does not depend on the order in which a loader multiplies and adds.
GRID_PER_M = 1024.0

EMPTY: Soup = (np.zeros((0, 3)), np.zeros((0, 3), np.int64))


def snap(values: Any) -> Float64:
    """The values, of any shape such as (n, 3), rounded to the grid: float64 of that shape."""
    return np.asarray(np.round(np.asarray(values, np.float64) * GRID_PER_M) / GRID_PER_M)


def merge(soups: Iterable[Soup]) -> Soup:
    """One soup of many."""
    parts = [soup for soup in soups if len(soup[1])]
    if not parts:
        return EMPTY
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    triangles = [faces + start for (_, faces), start in zip(parts, starts, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(triangles)


def quads(corners: Any) -> Soup:
    """(n, 4, 3) corners, counter-clockwise, as two triangles each."""
    corners = np.asarray(corners, np.float64).reshape(-1, 4, 3)
    first = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([np.add(first, (0, 1, 2)), np.add(first, (0, 2, 3))], axis=1)
    return corners.reshape(-1, 3), faces.reshape(-1, 3)


def fans(rings: Any) -> Soup:
    """(n, k, 3) planar convex rings, counter-clockwise, as k - 2 triangles each."""
    rings = np.asarray(rings, np.float64)
    count, size = rings.shape[:2]
    step = np.arange(1, size - 1)
    fan = np.stack([np.zeros_like(step), step, step + 1], axis=1)
    faces = fan[None] + size * np.arange(count)[:, None, None]
    return rings.reshape(-1, 3), faces.reshape(-1, 3)


# Corner numbers of a unit cube's faces: bit 0 is x, bit 1 is y, bit 2 is z.
_BOX_FACES = {
    "x": (0, 4, 6, 2),
    "X": (1, 3, 7, 5),
    "y": (0, 1, 5, 4),
    "Y": (2, 6, 7, 3),
    "z": (0, 2, 3, 1),
    "Z": (4, 5, 7, 6),
}


def boxes(low: Any, high: Any, faces: str = "xXyYzZ") -> Soup:
    """Axis-aligned boxes from (n, 3) corners; `faces` names the sides kept, upper case for
    the side of greater coordinate."""
    low = np.asarray(low, np.float64).reshape(-1, 3)
    high = np.asarray(high, np.float64).reshape(-1, 3)
    bits = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)], np.bool_)
    corners = np.where(bits[None], high[:, None], low[:, None])
    picked = corners[:, [_BOX_FACES[face] for face in faces]]
    return quads(picked.reshape(-1, 4, 3))


def box(low: Any, high: Any, faces: str = "xXyYzZ") -> Soup:
    """One axis-aligned box."""
    return boxes([low], [high], faces)


def loft(rings: Any, *, closed: bool = True, caps: str = "01") -> Soup:
    """Quads between successive (s, k, 3) rings; the rings run counter-clockwise seen from the
    last one. `caps`: "0" closes the first ring, "1" the last."""
    rings = np.asarray(rings, np.float64)
    stations, size = rings.shape[:2]
    here = np.arange(size if closed else size - 1)
    after = (here + 1) % size
    side = np.stack([here, after, after + size, here + size], axis=1)
    side = side[None] + size * np.arange(stations - 1)[:, None, None]
    faces = side.reshape(-1, 4)
    triangles = faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    parts: list[Soup] = [(rings.reshape(-1, 3), triangles)]
    if "0" in caps:
        parts.append(fans(rings[None, 0, ::-1]))
    if "1" in caps:
        parts.append(fans(rings[None, -1]))
    return merge(parts)


def ring(radius: float, sides: int, *, phase: float = 0.0) -> Float64:
    """(sides, 2) points of a circle, counter-clockwise."""
    angle = 2.0 * np.pi * (np.arange(sides) + phase) / sides
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def lathe(profile: Any, sides: int, *, caps: str = "01") -> Soup:
    """A solid of revolution about y from (s, 2) pairs of radius and height, bottom first."""
    circle = ring(1.0, sides, phase=0.5)
    rings = [
        np.stack([radius * circle[:, 0], np.full(sides, height), -radius * circle[:, 1]], axis=1)
        for radius, height in np.asarray(profile, np.float64)
    ]
    return loft(rings, caps=caps)


def moved(soup: Soup, offset: Any) -> Soup:
    """The soup shifted."""
    vertices, faces = soup
    return vertices + np.asarray(offset, np.float64), faces


def turned(soup: Soup, quarter_turns: int) -> Soup:
    """The soup turned about y by multiples of 90 degrees, exactly."""
    vertices, faces = soup
    return vertices @ quarter_turn(quarter_turns).T, faces


def quarter_turn(count: int) -> Float64:
    """(3, 3) exact rotation about +y by `count` times 90 degrees."""
    cosine = (1.0, 0.0, -1.0, 0.0)[count % 4]
    sine = (0.0, 1.0, 0.0, -1.0)[count % 4]
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def icosphere(subdivisions: int) -> Soup:
    """A unit sphere of 20 * 4**subdivisions triangles."""
    golden = (1.0 + 5.0**0.5) / 2.0
    points = []
    for a in (-1.0, 1.0):
        for b in (-golden, golden):
            points += [(0.0, a, b), (a, b, 0.0), (b, 0.0, a)]
    vertices = np.array(points) / np.hypot(1.0, golden)
    # The 20 faces are the triples of mutually nearest corners.
    near = np.linalg.norm(vertices[:, None] - vertices[None], axis=2) < 1.1
    faces = np.array(
        [
            (i, j, k)
            for i in range(12)
            for j in range(i + 1, 12)
            for k in range(j + 1, 12)
            if near[i, j] and near[j, k] and near[i, k]
        ]
    )
    normal = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    inward = (normal * vertices[faces[:, 0]]).sum(axis=1) < 0.0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    for _ in range(subdivisions):
        vertices, faces = split_edges(vertices, faces)
        vertices = vertices / np.linalg.norm(vertices, axis=1)[:, None]
    return vertices, faces


def split_edges(vertices: Float64, faces: NDArray[np.int64]) -> Soup:
    """Each triangle as four, by the midpoints of its edges. `vertices`: (v, 3) float64; `faces`:
    (t, 3) int64 below v."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, index = np.unique(edges, axis=0, return_inverse=True)
    middle = index.reshape(-1, 3) + len(vertices)
    points = np.concatenate([vertices, vertices[unique].mean(axis=1)])
    a, b, c = faces.T
    ab, bc, ca = middle.T
    children = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return points, np.concatenate([np.stack(child, axis=1) for child in children])
