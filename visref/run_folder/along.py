"""The triangles along rays: of a few samples each for itself, of many together.

A culler that leaves out half of a scene has tens of thousands of witnesses in one frame. Their rays
share the screen, so each triangle is asked only at the samples in its rectangle there. That finds
what the test finds without it: see `_rectangle`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.compiled import njit
from visref.run_folder.balls import BALL_ERROR, BLOCK, balls_about
from visref.scene import Float64, Int64, Scene

UNIT_ROUNDOFF = 2.0**-53
# d . (w_i x w_j) in float64, with w = v - o and d, o each a sum of three terms. Roundings on
# the longest way to a term: w 1, product 1, difference 1, d 4, product 1, sums 2: 10 in all,
# and (1 + u)^10 - 1 < 16 u. There are six terms, each at most |d| |w_i| |w_j|.
_EDGE_ERROR = 16.0 * 6.0 * UNIT_ROUNDOFF
# F . w: three terms, w 1, product 1, sums 2.
_DEPTH_ERROR = 8.0 * 3.0 * UNIT_ROUNDOFF
# An orthographic origin e + a R + b U has 4 roundings of its own.
_ORIGIN_ERROR = 4.0 * UNIT_ROUNDOFF


# Of so few samples a frame, each ray asks the balls about the scene's triangles for itself: some
# 2 ns a ball, where it takes 100 ns to put 64 triangles on the screen.
_FEW = 64
# Samples are looked up by tiles of so many pixels' side.
_TILE = 8


class _Rays(NamedTuple):
    """(k, 3) float64 `origin` and `direction` of each ray, the sizes that bound roundings, (k,);
    the camera's axis, and its near plane."""

    origin: Float64
    direction: Float64
    origin_error: Float64
    direction_size: Float64
    forward: Float64
    near: float


@njit()
def _passes(ball: NDArray[Any], rays: _Rays, index: int) -> bool:
    """Whether a ray's line passes a ball by."""
    # How far the line passes the ball's centre: |d x w| / |d|.
    d0, d1, d2 = rays.direction[index]
    origin, origin_error = rays.origin[index], rays.origin_error[index]
    w0, w1, w2 = ball[0] - origin[0], ball[1] - origin[1], ball[2] - origin[2]
    cross = (d1 * w2 - d2 * w1) ** 2 + (d2 * w0 - d0 * w2) ** 2 + (d0 * w1 - d1 * w0) ** 2
    length = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    reach = ball[3] + 8.0 * origin_error
    reach += BALL_ERROR * (abs(w0) + abs(w1) + abs(w2) + ball[3])
    return bool(math.sqrt(cross) > reach * length)


@njit()
def _meets(corner: NDArray[Any], rays: _Rays, index: int, w: NDArray[Any]) -> bool:
    """Whether a ray may meet a triangle, (3, 3) float32, at or behind near. Outward: one that it
    meets is never said not to be. `w`: (3, 3) float64, scratch."""
    origin, direction, forward = rays.origin[index], rays.direction[index], rays.forward
    origin_error, direction_size = rays.origin_error[index], rays.direction_size[index]
    near = rays.near
    s0 = s1 = s2 = 0.0
    deepest = -np.inf
    for i in range(3):
        size = 0.0
        depth = 0.0
        for k in range(3):
            w[i, k] = np.float64(corner[i, k]) - origin[k]
            size = max(size, abs(w[i, k]))
            depth += forward[k] * w[i, k]
        size += origin_error
        deepest = max(deepest, depth + _DEPTH_ERROR * size + 3.0 * origin_error)
        if i == 0:
            s0 = size
        elif i == 1:
            s1 = size
        else:
            s2 = size
    # Outward: a camera's axes are orthonormal only to 1e-6, so F . w is not quite t.
    if deepest < near - 0.5 * abs(near):
        return False
    positive = False
    negative = False
    for i in range(3):
        j = (i + 1) % 3
        size_i = s0 if i == 0 else s1 if i == 1 else s2
        size_j = s0 if j == 0 else s1 if j == 1 else s2
        side = (
            direction[0] * (w[i, 1] * w[j, 2] - w[i, 2] * w[j, 1])
            + direction[1] * (w[i, 2] * w[j, 0] - w[i, 0] * w[j, 2])
            + direction[2] * (w[i, 0] * w[j, 1] - w[i, 1] * w[j, 0])
        )
        bound = direction_size * (
            _EDGE_ERROR * size_i * size_j + 12.0 * origin_error * (size_i + size_j)
        )
        positive = positive or side > bound
        negative = negative or side < -bound
    return not (positive and negative)


@njit()
def _along(
    corners: NDArray[Any], balls: NDArray[Any], rays: _Rays, index: int
) -> NDArray[np.int64]:
    """Triangles that a ray may meet at or behind near. Outward: none that it meets is left out.
    `balls`: centre and radius about each `BLOCK` of the corners."""
    found = np.empty(64, np.int64)
    count = 0
    w = np.empty((3, 3))
    passed = False
    for t in range(len(corners)):
        if t % BLOCK == 0:
            passed = _passes(balls[t // BLOCK], rays, index)
        if passed or not _meets(corners[t], rays, index, w):
            continue
        if count == len(found):
            found = _grown(found)
        found[count] = t
        count += 1
    return found[:count].copy()


@njit()
def _grown(values: NDArray[Any]) -> NDArray[np.int64]:
    grown = np.empty(2 * len(values), np.int64)
    grown[: len(values)] = values
    return grown


class _Screen(NamedTuple):
    """From the world to the numbers (a, b) of samples: `eye`, (3,), and `inverse`, (3, 3), of the
    axes [F, R, U]. `spread`: how far an orthographic ray's origin lies from the eye at most, and
    the greatest sizes of a ray. `slack`: what a corner's numbers are off by at most, in an
    orthographic view for each unit of its distance."""

    eye: Float64
    inverse: Float64
    perspective: bool
    spread: float
    origin_error: float
    direction_size: float
    slack: float


@njit()
def _rectangle(corner: NDArray[Any], screen: _Screen, box: NDArray[Any]) -> bool:
    """The least and greatest a, then b, of samples whose rays `_meets` a triangle, in `box`; False
    where that may be any.

    With w the corners from a perspective eye, D their determinant, and c0 (1, a, b) of each along
    [F, R, U], a ray d = F + a R + b U is the sum of l w, l = side / D, and so (1, a, b) the sum of
    n (1, a, b) of the corners, n = l c0, whose sum is 1. `_meets` leaves each side above -2 bound
    (or, of a triangle that faces the other way, below it): n is -2 bound c0 / |D| at least. Where
    that is -1/16 or more for each, the sample lies in the corners' rectangle widened by 3/16 of
    its sides. In an orthographic view the same holds of side / (the sum of sides).
    """
    c = np.empty((3, 3))
    size = np.empty(3)
    for i in range(3):
        size[i] = screen.spread + screen.origin_error
        largest = 0.0
        for k in range(3):
            c[i, k] = 0.0
        for k in range(3):
            w = np.float64(corner[i, k]) - screen.eye[k]
            largest = max(largest, abs(w))
            for j in range(3):
                c[i, j] += screen.inverse[j, k] * w
        size[i] += largest
    if screen.perspective:
        for i in range(3):
            # So much in front that its place on the screen has the error that `slack` counts.
            if c[i, 0] < 1e-6 * size[i]:
                return False
    det = 0.0
    worst = 0.0
    for i in range(3):
        j, m = (i + 1) % 3, (i + 2) % 3
        bound = screen.direction_size * (
            _EDGE_ERROR * size[i] * size[j] + 12.0 * screen.origin_error * (size[i] + size[j])
        )
        if screen.perspective:
            bound *= c[m, 0]
            det += c[m, 0] * (c[i, 1] * c[j, 2] - c[i, 2] * c[j, 1])
        else:
            det += c[i, 1] * c[j, 2] - c[i, 2] * c[j, 1]
        worst = max(worst, bound)
    # `det` is of the coefficients; times that of the axes it is D, or the sum of sides. It is off
    # by the roundings of three products of coefficients, each some 32 u of the largest.
    inverse = screen.inverse
    of_inverse = (
        inverse[0, 0] * (inverse[1, 1] * inverse[2, 2] - inverse[1, 2] * inverse[2, 1])
        - inverse[0, 1] * (inverse[1, 0] * inverse[2, 2] - inverse[1, 2] * inverse[2, 0])
        + inverse[0, 2] * (inverse[1, 0] * inverse[2, 1] - inverse[1, 1] * inverse[2, 0])
    )
    most = 0.0
    for i in range(3):
        j, m = (i + 1) % 3, (i + 2) % 3
        first = size[m] * _norm(inverse[0]) if screen.perspective else 1.0
        most = max(most, first * size[i] * size[j] * _norm(inverse[1]) * _norm(inverse[2]))
    doubt = 6.0 * 64.0 * UNIT_ROUNDOFF * most
    if not (abs(det) - doubt) >= 32.0 * worst * abs(of_inverse):
        return False
    slack = screen.slack
    if not screen.perspective:
        slack *= max(size[0], max(size[1], size[2]))
    for axis in range(2):
        low, high = np.inf, -np.inf
        for i in range(3):
            value = c[i, axis + 1] / c[i, 0] if screen.perspective else c[i, axis + 1]
            low, high = min(low, value), max(high, value)
        wider = 0.25 * (high - low) + slack
        box[2 * axis], box[2 * axis + 1] = low - wider, high + wider
    return True


@njit()
def _norm(row: NDArray[Any]) -> float:
    """The greatest that a row makes of a vector with components up to 1."""
    return float(abs(row[0]) + abs(row[1]) + abs(row[2]))


class _Tiles(NamedTuple):
    """Samples by tile: `order` (k,), with those of a tile from `starts` on; their numbers `a` and
    `b`, (k,) float64. The first pixel's number, a pixel's step in it (2), and (columns, rows)."""

    order: Int64
    starts: Int64
    a: Float64
    b: Float64
    first_a: float
    first_b: float
    columns: int
    rows: int


@njit()
def _tile(place: float, least: int, most: int) -> int:
    return int(min(max(place, np.float64(least)), np.float64(most)))


@njit()
def _pairs(
    corners: NDArray[Any], balls: NDArray[Any], rays: _Rays, screen: _Screen, tiles: _Tiles
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Every ray (index) and triangle that `_along` finds for it, by triangle."""
    ray, triangle = np.empty(1024, np.int64), np.empty(1024, np.int64)
    count = 0
    w = np.empty((3, 3))
    box = np.empty(4)
    for t in range(len(corners)):
        low_x, high_x, low_y, high_y = 0, tiles.columns - 1, 0, tiles.rows - 1
        narrow = _rectangle(corners[t], screen, box)
        if narrow:
            # Columns run with a, rows against b.
            side = 2.0 * _TILE
            low_x = _tile((box[0] - tiles.first_a) / side - 1.0, 0, tiles.columns)
            high_x = _tile((box[1] - tiles.first_a) / side + 1.0, -1, tiles.columns - 1)
            low_y = _tile((tiles.first_b - box[3]) / side - 1.0, 0, tiles.rows)
            high_y = _tile((tiles.first_b - box[2]) / side + 1.0, -1, tiles.rows - 1)
        for row in range(low_y, high_y + 1):
            for place in range(
                tiles.starts[row * tiles.columns + low_x],
                tiles.starts[row * tiles.columns + high_x + 1],
            ):
                index = tiles.order[place]
                if narrow and not (
                    box[0] <= tiles.a[index] <= box[1] and box[2] <= tiles.b[index] <= box[3]
                ):
                    continue
                if not _meets(corners[t], rays, index, w):
                    continue
                if _passes(balls[t // BLOCK], rays, index):
                    continue
                if count == len(ray):
                    ray, triangle = _grown(ray), _grown(triangle)
                ray[count], triangle[count] = index, t
                count += 1
    return ray[:count].copy(), triangle[:count].copy()


def triangles_along(scene: Scene, camera: Camera, samples: Sequence[int]) -> list[Int64]:
    """For each sample (flat index) the triangles that its ray may meet: (n,) int64 ascending ids.

    Outward: a triangle that the ray meets in the camera's range is never left out, one that
    it passes closely may be listed too.
    """
    corners = scene.vertices[scene.triangles]
    return triangles_near(corners, balls_about(corners), camera, np.array(samples, np.int64))


def triangles_near(
    corners: NDArray[Any], balls: Float64, camera: Camera, samples: Int64
) -> list[Int64]:
    """`triangles_along` of a scene's triangles, (t, 3, 3) float32, and the balls about them."""
    if not len(samples):
        return []
    rays = _rays(camera, samples)
    if len(samples) <= _FEW:
        return [_along(corners, balls, rays, index) for index in range(len(samples))]
    columns, rows = -(-camera.width // _TILE), -(-camera.height // _TILE)
    y, x = np.divmod(samples, camera.width)
    tile = y // _TILE * columns + x // _TILE
    order = np.argsort(tile, kind="stable")
    starts = np.searchsorted(tile[order], np.arange(columns * rows + 1))
    tiles = _Tiles(
        order, starts, camera.column_a[x], camera.row_b[y],
        float(camera.column_a[0]), float(camera.row_b[0]), columns, rows,
    )  # fmt: skip
    ray, triangle = _pairs(corners, balls, rays, _screen(camera, rays), tiles)
    order = np.argsort(ray, kind="stable")
    ends = np.searchsorted(ray[order], np.arange(1, len(samples)))
    return np.split(triangle[order], ends)


def _rays(camera: Camera, samples: Int64) -> _Rays:
    y, x = np.divmod(samples, camera.width)
    a, b = camera.column_a[x], camera.row_b[y]
    # As `Camera.ray` has them.
    aside = a[:, None] * camera.right_step + b[:, None] * camera.up_step
    still = np.zeros_like(aside)
    perspective = camera.is_perspective
    origin = camera.eye + (still if perspective else aside)
    direction = camera.forward + (aside if perspective else still)
    spread = np.abs(camera.right_step).max() * np.abs(a) + np.abs(camera.up_step).max() * np.abs(b)
    forward = camera.forward
    if camera.is_perspective:
        origin_error = np.zeros(len(samples))
        direction_size = np.abs(forward).max() + spread
    else:
        origin_error = _ORIGIN_ERROR * (np.abs(camera.eye).max() + spread)
        direction_size = np.full(len(samples), float(np.abs(forward).max()))
    return _Rays(origin, direction, origin_error, direction_size, forward, camera.near)


def _screen(camera: Camera, rays: _Rays) -> _Screen:
    axes = np.stack([camera.forward, camera.right_step, camera.up_step], axis=1)
    inverse: Float64 = np.linalg.inv(axes).astype(np.float64)
    spread = 0.0 if camera.is_perspective else float(np.abs(rays.origin - camera.eye).max())
    # A corner's coefficients are sums of three products, off by 8 u of |inverse| |w|, and the
    # inverse by some roundings of its own; of what is 1e-6 of its distance in front, a and b are
    # off by 1e6 times that.
    largest = np.abs(inverse).sum(axis=1).max()
    slack = 64.0 * UNIT_ROUNDOFF * largest * (1e6 if camera.is_perspective else 1.0)
    return _Screen(
        camera.eye,
        inverse,
        camera.is_perspective,
        spread,
        float(rays.origin_error.max()),
        float(rays.direction_size.max()),
        slack,
    )
