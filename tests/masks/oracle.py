"""Mask lookups and hits in exact arithmetic, in plain Python; slow, and nothing of visref."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction as Q

import numpy as np
from numpy.typing import NDArray

HOLE, SOLID, BETWEEN = 0, 1, 2


@dataclass(frozen=True)
class Texture:
    """`texels[y][x]`, wrap modes by glTF's names, and whether lookups do not interpolate."""

    texels: NDArray[np.uint16]
    wrap_s: str = "REPEAT"
    wrap_t: str = "REPEAT"
    nearest: bool = False


def wrapped(i: int, size: int, mode: str) -> int:
    if mode == "REPEAT":
        return i % size
    if mode == "CLAMP_TO_EDGE":
        return min(max(i, 0), size - 1)
    i %= 2 * size
    return i if i < size else 2 * size - 1 - i


def axis(low: Q, high: Q, size: int, mode: str) -> set[int]:
    """Texels, closed, that touch [low, high], texel coordinates."""
    first, last = math.ceil(low) - 1, math.floor(high)
    # A longer run than two periods holds nothing new, whatever the mode but clamping.
    if mode == "CLAMP_TO_EDGE":
        first, last = max(first, -1), min(last, size)
        if first > last:
            first = last = size - 1 if low > 0 else 0
    else:
        last = min(last, first + 2 * size)
    return {wrapped(i, size, mode) for i in range(first, last + 1)}


def touched(texture: Texture, box: list[float], wider: Q = Q(0)) -> tuple[set[int], set[int]]:
    """Columns and rows under a box of u, v, du, dv, eu, ev; `wider` in texels."""
    u, v, du, dv, eu, ev = map(Q, box)
    height, width = texture.texels.shape
    reach = Q(0) if texture.nearest else Q(1, 2)
    if texture.nearest and du * width < 1 and dv * height < 1:
        du = dv = Q(0)
    sides = []
    for centre, half, size, mode in (
        (u, du + eu, width, texture.wrap_s),
        (v, dv + ev, height, texture.wrap_t),
    ):
        low = (centre - half) * size - reach - wider
        high = (centre + half) * size + reach + wider
        sides.append(axis(low, high, size, mode))
    return sides[0], sides[1]


def extremes(texture: Texture, columns: set[int], rows: set[int]) -> tuple[int, int]:
    values = [int(texture.texels[y, x]) for y in rows for x in columns]
    return min(values), max(values)


def state(least: Q, greatest: Q, cutoff: Q) -> int:
    if least >= cutoff:
        return SOLID
    return HOLE if greatest < cutoff else BETWEEN


def filtered(texture: Texture, u: float, v: float) -> float:
    """An engine's lookup in the full image: bilinear, or the nearest texel."""
    height, width = texture.texels.shape

    def texel(x: int, y: int) -> float:
        return float(
            texture.texels[wrapped(y, height, texture.wrap_t), wrapped(x, width, texture.wrap_s)]
        )

    x, y = u * width, v * height
    if texture.nearest:
        return texel(math.floor(x), math.floor(y))
    x, y = x - 0.5, y - 0.5
    i, j = math.floor(x), math.floor(y)
    f, g = x - i, y - j
    upper = texel(i, j) * (1 - f) + texel(i + 1, j) * f
    lower = texel(i, j + 1) * (1 - f) + texel(i + 1, j + 1) * f
    return upper * (1 - g) + lower * g


Vector = list[Q]


def dot(x: Vector, y: Vector) -> Q:
    return sum((i * j for i, j in zip(x, y, strict=True)), Q(0))


def cross(x: Vector, y: Vector) -> Vector:
    return [
        x[1] * y[2] - x[2] * y[1],
        x[2] * y[0] - x[0] * y[2],
        x[0] * y[1] - x[1] * y[0],
    ]


def minus(x: Vector, y: Vector) -> Vector:
    return [i - j for i, j in zip(x, y, strict=True)]


def barycentrics(
    axes: NDArray[np.float64], a: Q, b: Q, perspective: bool, corners: NDArray[np.float64]
) -> tuple[Q, Q, Q] | None:
    """Weights of the three corners where a ray meets their plane; None if it does not, before
    the eye. By solving for t and two edges with Cramer's rule."""
    eye, forward, right, up = ([Q(float(x)) for x in row] for row in axes)
    v0, v1, v2 = ([Q(float(x)) for x in row] for row in corners)
    side = [a * r + b * u for r, u in zip(right, up, strict=True)]
    start, way = eye, [f + s for f, s in zip(forward, side, strict=True)]
    if not perspective:
        start, way = [e + s for e, s in zip(eye, side, strict=True)], forward
    e1, e2, p = minus(v1, v0), minus(v2, v0), minus(start, v0)
    # p + t way = w1 e1 + w2 e2
    determinant = dot(way, cross(e1, e2))
    if determinant == 0:
        return None
    t = -dot(p, cross(e1, e2)) / determinant
    if t <= 0:
        return None
    w1 = dot(way, cross(p, e2)) / determinant
    w2 = dot(way, cross(e1, p)) / determinant
    return 1 - w1 - w2, w1, w2
