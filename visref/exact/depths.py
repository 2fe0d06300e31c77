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
# `_quotient`, in u^2 of the result: the product of D with the first quotient 1.5; that quotient
# is within 2.5 u of N / D, so the remainder is at most 6 u of N (the difference of the high words
# is exact, by Sterbenz): two roundings of what is below it 8, and the reciprocal's, the product's
# and D's low word on it 18. 28 in all.
QUOTIENT = 32.0 * U * U
# So many samples are looked at together, a vector of them at a time; at most as many triangles.
TOGETHER = 128
# From one row of the workspace to the next: not a power of two, so that the rows do not meet in
# the same lines of the cache.
STRIDE = TOGETHER + 8
# The rows of the workspace. First the triangles': nine of corners, and their terms, which are the
# double words of the constant one of N and D, of the affine one's c, ca and cb, and the bounds of
# the errors of the two. Then the samples': a and b, the same terms, the depth and whether it is
# torn.
CORNERS, TERMS, TERM_ROWS = 0, 9, 10
COLUMN_A, ROW_B, OURS, DEPTH, TORN = 19, 20, 21, 31, 32
ROWS = 33
# The order of the terms.
CONSTANT, AFFINE, AFFINE_A, AFFINE_B, CONSTANT_ERROR, AFFINE_ERROR = 0, 2, 4, 6, 8, 9
# A triangle that was met among the same samples is found by its id's last bits.
SLOTS = 256

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
def _along(x: Pair, y: Pair, z: Pair, d: tuple[float, float, float]) -> Pair:
    product: Pair = _add(_add(_scale(x, d[0]), _scale(y, d[1])), _scale(z, d[2]))
    return product


@njit(error_model="numpy", inline="always")
def _store(x: Pair, out: NDArray[Any], at: int) -> None:
    out[at], out[at + STRIDE] = x


@njit(error_model="numpy", inline="always")
def _pair(c: NDArray[Any], at: int) -> Pair:
    return c[at], c[at + STRIDE]


@njit(error_model="numpy")
def _terms(
    work: NDArray[Any],
    count: int,
    perspective: bool,
    lens: NDArray[Any],
) -> None:
    """The `TERMS` of the first triangles in the workspace, by their `CORNERS`; `lens`: the View's.

    One straight line of arithmetic, on one array: it is made into vector instructions.
    """
    ex, ey, ez = lens[0], lens[1], lens[2]
    f = lens[3], lens[4], lens[5]
    r = lens[6], lens[7], lens[8]
    u = lens[9], lens[10], lens[11]
    reach, f_norm, tiny = lens[12], lens[13], lens[14]
    for i in range(count):
        x, y, z = work[i], work[STRIDE + i], work[2 * STRIDE + i]
        wx, wy, wz = _two_sum(x, -ex), _two_sum(y, -ey), _two_sum(z, -ez)
        gx = _two_sum(work[3 * STRIDE + i], -x)
        gy = _two_sum(work[4 * STRIDE + i], -y)
        gz = _two_sum(work[5 * STRIDE + i], -z)
        hx = _two_sum(work[6 * STRIDE + i], -x)
        hy = _two_sum(work[7 * STRIDE + i], -y)
        hz = _two_sum(work[8 * STRIDE + i], -z)
        nx, ny, nz = _across(gy, gz, hy, hz), _across(gz, gx, hz, hx), _across(gx, gy, hx, hy)
        height = _add(_add(_multiply(nx, wx), _multiply(ny, wy)), _multiply(nz, wz))
        slope = _along(nx, ny, nz, f)
        right, up = _along(nx, ny, nz, r), _along(nx, ny, nz, u)
        size = 2.0 * SLACK * max(abs(gx[0]), abs(gy[0]), abs(gz[0]))
        size *= max(abs(hx[0]), abs(hy[0]), abs(hz[0]))
        far = 3.0 * max(abs(wx[0]), abs(wy[0]), abs(wz[0]))
        at = TERMS * STRIDE + i
        if perspective:
            _store(height, work, at + CONSTANT * STRIDE)
            _store(slope, work, at + AFFINE * STRIDE)
            _store(right, work, at + AFFINE_A * STRIDE)
            _store(up, work, at + AFFINE_B * STRIDE)
            work[at + CONSTANT_ERROR * STRIDE] = size * far + tiny
            work[at + AFFINE_ERROR * STRIDE] = size * reach + tiny
        else:
            _store(slope, work, at + CONSTANT * STRIDE)
            _store(height, work, at + AFFINE * STRIDE)
            _store((-right[0], -right[1]), work, at + AFFINE_A * STRIDE)
            _store((-up[0], -up[1]), work, at + AFFINE_B * STRIDE)
            work[at + CONSTANT_ERROR * STRIDE] = size * f_norm + tiny
            work[at + AFFINE_ERROR * STRIDE] = size * (far + reach) + tiny


@njit(error_model="numpy")
def _quotients(work: NDArray[Any], count: int, perspective: bool) -> None:
    """`DEPTH` and `TORN` of the first samples in the workspace, by their own terms."""
    for i in range(count):
        at = OURS * STRIDE + i
        a, b = work[COLUMN_A * STRIDE + i], work[ROW_B * STRIDE + i]
        row = _add(
            _pair(work, at + AFFINE * STRIDE), _scale(_pair(work, at + AFFINE_B * STRIDE), b)
        )
        value = _add(row, _scale(_pair(work, at + AFFINE_A * STRIDE), a))
        constant = _pair(work, at + CONSTANT * STRIDE)
        constant_error = work[at + CONSTANT_ERROR * STRIDE]
        value_error = work[at + AFFINE_ERROR * STRIDE]
        n, n_error = (constant, constant_error) if perspective else (value, value_error)
        d, d_error = (value, value_error) if perspective else (constant, constant_error)
        inverse = 1.0 / d[0]
        high = n[0] * inverse
        r = _scale(d, high)
        low = ((n[0] - r[0]) + (n[1] - r[1])) * inverse
        # An error of N, and one of D times t, over D. Doubled: for higher orders, and for the
        # roundings of the bound and of this test.
        error = 2.0 * ((n_error + abs(high) * d_error) * abs(inverse) + abs(high) * QUOTIENT)
        above, below = high + (low + error), high + (low - error)
        work[DEPTH * STRIDE + i] = above
        # Not a number where anything overflowed: torn as well.
        work[TORN * STRIDE + i] = 0.0 if above == below else 1.0


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

    `samples`: (k,) int64 flat indices, neighbours best beside each other; `owner`:
    (height * width,) int32 triangle ids, -1 for none, and `depth`, float64, of all samples of the
    frame; `vertices`: (v, 3) float32, `triangles`: (t, 3) int32; `column_a`, `row_b`: as the
    camera's.
    Returns the samples at which the double words cannot tell the rounding, int64.
    """
    width, perspective, lens = view.width, view.perspective, view.lens
    work = np.zeros(ROWS * STRIDE)
    # The triangles met among these samples, where each is found, and each sample's.
    met = np.empty(TOGETHER, np.int32)
    slots = np.zeros(SLOTS, np.int32)
    ours = np.empty(TOGETHER, np.int32)
    places = np.empty(TOGETHER, np.int64)
    torn = np.empty(len(samples), np.int64)
    count = 0
    begin, row_start, b = 0, -width, 0.0
    while begin < len(samples):
        taken, found, last, j = 0, 0, -1, 0
        while begin < len(samples) and taken < TOGETHER:
            s = samples[begin]
            begin += 1
            t = owner[s]
            if t < 0:
                depth[s] = np.inf
                continue
            x = s - row_start
            if x < 0 or x >= width:
                row_start = s // width * width
                x = s - row_start
                b = row_b[s // width]
            work[COLUMN_A * STRIDE + taken] = column_a[x]
            work[ROW_B * STRIDE + taken] = b
            places[taken] = s
            if t != last:
                last = t
                slot = t & (SLOTS - 1)
                j = slots[slot]
                if j < found and met[j] == t:
                    ours[taken] = j
                    taken += 1
                    continue
                j = found
                met[j], slots[slot] = t, j
                found += 1
                for corner in range(3):
                    v = triangles[t, corner]
                    for k in range(3):
                        work[(CORNERS + 3 * corner + k) * STRIDE + j] = vertices[v, k]
            ours[taken] = j
            taken += 1
        _terms(work, found, perspective, lens)
        for i in range(taken):
            j = ours[i]
            for k in range(TERM_ROWS):
                work[(OURS + k) * STRIDE + i] = work[(TERMS + k) * STRIDE + j]
        _quotients(work, taken, perspective)
        for i in range(taken):
            s = places[i]
            depth[s] = work[DEPTH * STRIDE + i]
            if work[TORN * STRIDE + i] != 0.0:
                torn[count] = s
                count += 1
    return torn[:count]
