"""View depths of hits, rounded to nearest: double-word arithmetic, and exact where that is torn.

Joldes, Muller and Popescu, "Tight and rigorous error bounds for basic building blocks of
double-word arithmetic" (2017): a number is the unevaluated sum of two float64, and with
u = 2^-53 the relative errors are at most 3u^2 for a sum (AccurateDWPlusDW), 1.5u^2 for a product
with a float64 (DWTimesFP1), 7u^2 for a product (DWTimesDW1), 15u^2 for a quotient (DWDivDW2), a
little more for higher orders.

t = N / D as in `visref.exact.filters`. The differences w and g are exact double words. The
normal then has 7 + 3 = 10 u^2 on products of size h1 h2, a dot product with it at most
7 + 3 + 3 more, its value at (a, b) at most 1.5 + 3 + 3 more: 31 u^2 in all, on the sizes in
`filters`. `SLACK` = 40 u^2; the quotient's own 15 u^2 come on top, doubled like the rest when the
test for the rounding is made.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from visref.compiled import njit
from visref.exact.filters import U, View

SLACK = 40.0 * U * U
QUOTIENT = 16.0 * U * U
# Hits come tile by tile, and a tile shows a few hundred triangles: their terms are kept.
CACHE = 512
# The layout of a triangle's terms: where the double words begin that are the constant one of N
# and D, and the affine one's c, ca and cb; then the bounds of the errors of the two.
CONSTANT, AFFINE, AFFINE_A, AFFINE_B = 0, 2, 4, 6
CONSTANT_ERROR, AFFINE_ERROR = 8, 9
TERMS_SIZE = 10

Pair = tuple[float, float]


@njit(error_model="numpy", inline="always")
def _two_sum(a: float, b: float) -> Pair:
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@intrinsic
def _fused(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once: the processor's instruction, or libm's where it has none."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


@njit(error_model="numpy", inline="always")
def _two_product(a: float, b: float) -> Pair:
    """Exact short of overflow and underflow."""
    p = a * b
    return p, _fused(a, b, -p)


@njit(error_model="numpy")
def _add(x: Pair, y: Pair) -> Pair:
    s, sl = _two_sum(x[0], y[0])
    t, tl = _two_sum(x[1], y[1])
    c = sl + t
    v = s + c
    w = tl + (c - (v - s))
    z = v + w
    return z, w - (z - v)


@njit(error_model="numpy")
def _scale(x: Pair, y: float) -> Pair:
    c, cl = _two_product(x[0], y)
    d = x[1] * y
    t = c + d
    tl = (d - (t - c)) + cl
    z = t + tl
    return z, tl - (z - t)


@njit(error_model="numpy")
def _multiply(x: Pair, y: Pair) -> Pair:
    c, cl = _two_product(x[0], y[0])
    d = cl + (x[0] * y[1] + x[1] * y[0])
    z = c + d
    return z, d - (z - c)


@njit(error_model="numpy")
def _less(x: Pair, y: Pair) -> Pair:
    difference: Pair = _add(x, (-y[0], -y[1]))
    return difference


@njit(error_model="numpy")
def _across(x0: Pair, y0: Pair, x1: Pair, y1: Pair) -> Pair:
    component: Pair = _less(_multiply(x0, y1), _multiply(y0, x1))
    return component


@njit(error_model="numpy")
def _along(x: Pair, y: Pair, z: Pair, d: NDArray[Any]) -> Pair:
    product: Pair = _add(_add(_scale(x, d[0]), _scale(y, d[1])), _scale(z, d[2]))
    return product


@njit(error_model="numpy", inline="always")
def _store(x: Pair, out: NDArray[Any], at: int) -> None:
    out[at], out[at + 1] = x


@njit(error_model="numpy", inline="always")
def _pair(c: NDArray[Any], at: int) -> Pair:
    return c[at], c[at + 1]


@njit(error_model="numpy")
def _terms(vertices: NDArray[Any], corners: NDArray[Any], view: View, out: NDArray[Any]) -> None:
    """A triangle's depth into `out`, (TERMS_SIZE,) float64: see the layout above. `corners`: (3,)
    vertex indices."""
    e = view.e
    v = vertices[corners[0]]
    x, y, z = np.float64(v[0]), np.float64(v[1]), np.float64(v[2])
    wx, wy, wz = _two_sum(x, -e[0]), _two_sum(y, -e[1]), _two_sum(z, -e[2])
    v = vertices[corners[1]]
    gx, gy, gz = (
        _two_sum(np.float64(v[0]), -x),
        _two_sum(np.float64(v[1]), -y),
        _two_sum(np.float64(v[2]), -z),
    )
    v = vertices[corners[2]]
    hx, hy, hz = (
        _two_sum(np.float64(v[0]), -x),
        _two_sum(np.float64(v[1]), -y),
        _two_sum(np.float64(v[2]), -z),
    )
    nx, ny, nz = _across(gy, gz, hy, hz), _across(gz, gx, hz, hx), _across(gx, gy, hx, hy)
    height = _add(_add(_multiply(nx, wx), _multiply(ny, wy)), _multiply(nz, wz))
    slope = _along(nx, ny, nz, view.f)
    right, up = _along(nx, ny, nz, view.r), _along(nx, ny, nz, view.u)
    size = 2.0 * SLACK * max(abs(gx[0]), abs(gy[0]), abs(gz[0]))
    size *= max(abs(hx[0]), abs(hy[0]), abs(hz[0]))
    far = 3.0 * max(abs(wx[0]), abs(wy[0]), abs(wz[0]))
    if view.perspective:
        _store(height, out, CONSTANT)
        _store(slope, out, AFFINE)
        _store(right, out, AFFINE_A)
        _store(up, out, AFFINE_B)
        out[CONSTANT_ERROR] = size * far + view.tiny
        out[AFFINE_ERROR] = size * view.reach + view.tiny
    else:
        _store(slope, out, CONSTANT)
        _store(height, out, AFFINE)
        _store((-right[0], -right[1]), out, AFFINE_A)
        _store((-up[0], -up[1]), out, AFFINE_B)
        out[CONSTANT_ERROR] = size * view.f_norm + view.tiny
        out[AFFINE_ERROR] = size * (far + view.reach) + view.tiny


@njit(error_model="numpy")
def depths(
    samples: NDArray[Any],
    owner: NDArray[Any],
    vertices: NDArray[Any],
    triangles: NDArray[Any],
    view: View,
    column_a: NDArray[Any],
    row_b: NDArray[Any],
    depth: NDArray[Any],
) -> NDArray[np.int64]:
    """The view depth of some samples' owners into `depth`, rounded to nearest, inf for none.

    `samples`: (k,) int64 flat indices; `owner`: (height * width,) int32 triangle ids, -1 for
    none, and `depth`, float64, of all samples of the frame; `vertices`: (v, 3) float32,
    `triangles`: (t, 3) int32; `column_a`, `row_b`: as the camera's.
    Returns the samples at which the double words cannot tell the rounding, int64.
    """
    tags = np.full(CACHE, -1, np.int64)
    cache = np.empty((CACHE, TERMS_SIZE))
    torn = np.empty(16, np.int64)
    count = 0
    last_t, last_y = -1, -1
    row = (0.0, 0.0)
    c = cache[0]
    for s in samples:
        t = int(owner[s])
        if t < 0:
            depth[s] = np.inf
            continue
        y = s // view.width
        x = s - y * view.width
        if t != last_t or y != last_y:
            c = cache[t % CACHE]
            if tags[t % CACHE] != t:
                tags[t % CACHE] = t
                _terms(vertices, triangles[t], view, c)
            row = _add(_pair(c, AFFINE), _scale(_pair(c, AFFINE_B), row_b[y]))
            last_t, last_y = t, y
        value = _add(row, _scale(_pair(c, AFFINE_A), column_a[x]))
        constant = _pair(c, CONSTANT)
        if view.perspective:
            n, n_error, d, d_error = constant, c[CONSTANT_ERROR], value, c[AFFINE_ERROR]
        else:
            n, n_error, d, d_error = value, c[AFFINE_ERROR], constant, c[CONSTANT_ERROR]
        high = n[0] / d[0]
        r = _scale(d, high)
        low = ((n[0] - r[0]) + (n[1] - r[1])) / d[0]
        # An error of N, and one of D times t, over D. Doubled: for higher orders, and for the
        # roundings of the bound and of this test.
        error = 2.0 * ((n_error + abs(high) * d_error) / abs(d[0]) + abs(high) * QUOTIENT)
        above, below = high + (low + error), high + (low - error)
        depth[s] = above
        if above != below:
            if count == len(torn):
                grown = np.empty(2 * count, np.int64)
                for k in range(count):
                    grown[k] = torn[k]
                torn = grown
            torn[count] = s
            count += 1
    return torn[:count]
