"""Whether a float32 ray library sees a scene: rays whose answer is known, cast before any frame.

A library computes with products of three lengths. Where a scene mixes magnitudes (a screw of
10^-12 in a world of 10^12), no one scale keeps all of them within float32's exponents, and the
library then misses what it was given, without a word. So it is asked first: for triangles of each
size, along rays through their interior, so clear of the edges that rounding cannot matter.

A view may be such that rays which start afar round by more than what they look at. So the same
triangles, where a view shows them large enough, are asked for by the view's own rays too.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.compiled import njit
from visref.scene import Float32, Float64, Int32, Int64

# Triangles asked for in each octave of size, evenly by id.
PER_OCTAVE = 8
# More where a view is asked, which shows few of them.
PER_OCTAVE_IN_VIEW = 128
# More than there are exponents of float32, -148 to 128, twice the greater one.
OCTAVES = 320
# Where the rays start before the triangle, as shares of its size: a ray that starts closer has
# smaller products.
DISTANCES = (1.0, 2.0**-6)
# How far a hit must be from each edge: this share of the corners' distances, and of the
# greatest coordinate by ROUNDING.
INTERIOR = 1.0 / 8.0
# How much deeper than a known hit's centre an answer must lie to be wrong, as a share of the
# distance from the eye: 2^-53 times the dozen operations that make that depth is far below.
DEPTH_ROUNDING = 2.0**-40
# Some 16 roundings (2^-24) of differences that are at most 2 sqrt(3) of a coordinate come to
# 2^-18.2, as in `visref.engines.rays.DEPTH_SLACK`.
ROUNDING = 2.0**-18


class KnownSamples(NamedTuple):
    """`primitive`: (k,) int32, what each ray meets at parameter `depth`, (k,) float64, unless
    something else lies before it; `slack`: (k,) float64, by how much rounding may move a
    parameter. `rays`: (k, 6) float32, origins and directions."""

    primitive: Int32
    rays: Float32
    depth: Float64
    slack: Float64


def known_samples(vertices: Float32, triangles: Int32) -> KnownSamples:
    """Rays with known answers through some `triangles`, (t, 3) int32, of `vertices`, (v, 3)
    float32: of every size that occurs, as far as float32 resolves them where they lie."""
    chosen = of_each_size(vertices, triangles, PER_OCTAVE)
    picked = np.repeat(chosen, len(DISTANCES)).astype(np.int32)
    corners = vertices[triangles[picked]].astype(np.float64)
    share = np.tile(DISTANCES, len(chosen))[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        centre = corners.mean(axis=1)
        size = np.ptp(corners, axis=1).max(axis=1)[:, None]
        origins = (centre + share * size * normal).astype(np.float32)
        way = centre - origins
        # Any length will do; about one, as a camera's rays have.
        directions = (way / np.abs(way).max(axis=1)[:, None]).astype(np.float32)
        rays = np.concatenate([origins, directions], axis=1)
        depth, weights, heights = _met(corners, rays)
        greatest = np.maximum(np.abs(corners).max(axis=(1, 2)), np.abs(origins).max(axis=1))
        clear = (weights >= INTERIOR) & (weights * heights > ROUNDING * greatest[:, None])
        known = clear.all(axis=1) & (depth > ROUNDING * greatest)
    return KnownSamples(
        picked[known], rays[known], depth[known], ROUNDING * greatest[known].astype(np.float64)
    )


def misses(known: KnownSamples, answer: Int32, vertices: Float32, triangles: Int32) -> Int32:
    """Which of the known samples an `answer`, (k,) int32 nearest primitives (-1 for none), gets
    wrong by more than rounding: (m,) int32 indices. Something else is as good an answer where
    it lies before the known hit, or so edge-on that its place is not known."""
    met = np.flatnonzero(answer >= 0)
    seen = answer == known.primitive
    other = met[~seen[met]]
    with np.errstate(divide="ignore", invalid="ignore"):
        corners = vertices[triangles[answer[other]]].astype(np.float64)
        depth, _, heights = _met(corners, known.rays[other])
        behind = depth > known.depth[other] + known.slack[other]
    # A plane that turns under rounding of its corners has no place on the ray.
    vague = ~(heights.min(axis=1) > ROUNDING * np.abs(corners).max(axis=(1, 2)))
    seen[other] = ~behind | vague
    return np.flatnonzero(~seen).astype(np.int32)


def points_in_view(corners: Float64, camera: Camera) -> tuple[Int64, Float64, Float64, Float64]:
    """Where a view shows triangles, (k, 3, 3) float64 corners in its coordinates, so that their
    centres are a pixel or more from each edge: (m,) int64 indices, and of each the image point a,
    b of its centre and the view depth there. They lie between near and far."""
    basis = np.stack([camera.forward, camera.right_step, camera.up_step])
    place = (corners - camera.eye) @ np.linalg.inv(basis)
    depth = place[..., 0]
    inside = ((depth >= camera.near) & (depth <= camera.far)).all(axis=1)
    centre = place.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        if camera.is_perspective:
            place, centre = place / place[..., :1], centre / centre[:, :1]
        image, point = place[..., 1:], centre[:, 1:]
        for k in range(3):
            edge = image[:, k - 1] - image[:, k - 2]
            way = point - image[:, k - 2]
            # A pixel is 2 wide.
            apart = np.abs(edge[:, 0] * way[:, 1] - edge[:, 1] * way[:, 0])
            inside &= apart >= 2.0 * np.hypot(*edge.T)
    inside &= (point[:, 0] >= camera.column_a.min()) & (point[:, 0] <= camera.column_a.max())
    inside &= (point[:, 1] >= camera.row_b.min()) & (point[:, 1] <= camera.row_b.max())
    found = np.flatnonzero(inside)
    return found, point[found, 0], point[found, 1], depth.mean(axis=1)[found]


@njit()
def of_each_size(
    vertices: NDArray[Any], triangles: NDArray[Any], per_octave: int
) -> NDArray[np.int32]:
    """Up to `per_octave` of the triangles of each octave of size (the longest side of their
    boxes), evenly by id: (k,) int32, ascending. Those without size are left out."""
    octave = np.empty(len(triangles), np.int16)
    count = np.zeros(OCTAVES, np.int64)
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        size = np.float32(0.0)
        for axis in range(3):
            x, y, z = vertices[i, axis], vertices[j, axis], vertices[k, axis]
            size = max(size, max(x, y, z) - min(x, y, z))
        # 0 is for no size at all; float32's exponents lie from -148 to 128.
        octave[t] = math.frexp(size)[1] + OCTAVES // 2 if size > 0.0 else 0
        count[octave[t]] += 1
    chosen = np.empty(OCTAVES * per_octave, np.int32)
    total = 0
    met, taken = np.zeros(OCTAVES, np.int64), np.zeros(OCTAVES, np.int64)
    for t in range(len(triangles)):
        o = octave[t]
        if o == 0:
            continue
        # The n-th of those to take is the first whose place is at least n / per_octave of all.
        if met[o] * per_octave >= taken[o] * count[o]:
            chosen[total] = t
            total += 1
            taken[o] += 1
        met[o] += 1
    return chosen[:total].copy()


def _met(corners: Float64, rays: Float32) -> tuple[Float64, Float64, Float64]:
    """Where rays, (k, 6), meet the planes of triangles, (k, 3, 3): the parameter (k,), the
    barycentric weights (k, 3), and each corner's height over the edge across, (k, 3), as the ray
    sees it, in float64. No number where the ray lies in the plane."""
    start = corners - rays[:, None, :3].astype(np.float64)
    way = rays[:, 3:].astype(np.float64)
    first, second = start[:, 1] - start[:, 0], start[:, 2] - start[:, 0]
    normal = np.cross(first, second)
    across = np.einsum("ij,ij->i", normal, way)
    depth = np.einsum("ij,ij->i", normal, start[:, 0]) / across
    volumes = np.stack(
        [np.einsum("ij,ij->i", np.cross(start[:, i - 2], start[:, i - 1]), way) for i in range(3)],
        axis=1,
    )
    edges = np.stack([start[:, i - 1] - start[:, i - 2] for i in range(3)], axis=1)
    length = np.linalg.norm(edges, axis=2) * np.linalg.norm(way, axis=1)[:, None]
    return depth, volumes / across[:, None], np.abs(across)[:, None] / length
