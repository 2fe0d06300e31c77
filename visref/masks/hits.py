"""A mask at a sample: where its ray meets a triangle, how far its pixel reaches there.

The sample's ray is e + t d, d = F + a R + b U, or, orthographic, e + a R + b U + t F (see
`visref.camera`); e, F, R, U, a, b and the triangle's vertices v0, v1, v2 are taken as exact.
With e1 = v1 - v0, e2 = v2 - v0 and n = e1 x e2 the hit lies at q = (hit - v0) = B1 e1 + B2 e2,

    B1 = (q x e2)_k / n_k        B2 = (e1 x q)_k / n_k

where k is the largest component of n. An attribute with the values f0, f1, f2 at the vertices
is f0 + B1 (f1 - f0) + B2 (f2 - f0) there: perspective-correct interpolation.

The doubled footprint is the image of the square a ± 2, b ± 2 (a pixel is 2 wide). Where the
ray moves by the vector D = 2 (±R ± U), the hit moves by

    t' (D - d (n . D) / n . d)        t' = n . (v0 - e) / n . (d + D), the depth there

(orthographic: d is F, and 1 stands in place of t'). That is exact; the derivative has t, the
depth at the hit, in place of t'. A projection takes a square before the eye to the convex hull
of its corners' images. Of two opposite corners one has t' >= t; so the largest |change| over
the corners bounds the change over the square and the derivative's |f_x| + |f_y| alike. If the
ray through a corner is parallel to the plane or meets it behind the eye, the footprint is
infinite.

Rounding is bounded as in the plane test of the ray engines: u = 2^-53; every bound is a
multiple of a sum of absolute products, and the multiples are rounded up generously enough for
second-order terms.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.masks.lookup import mask_state
from visref.masks.store import MaskArrays, Masks

UNIT = 2.0**-53
# A component of n: edges one rounding each, a product, a difference: 2 + 1 + 1 = 4 u.
NORMAL = 5.0 * UNIT
# n . x for a vector x that is itself off by at most 4 u of its size: 4 + 4 + 1 + 2 = 11 u.
PRODUCT = 16.0 * UNIT
# A few more operations on top: t d - p, the products of a barycentric, an attribute's sum.
FEW = 8.0 * UNIT


@njit(inline="always")
def _dot(x, y):  # type: ignore[no-untyped-def]
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@njit(inline="always")
def _size(x, y):  # type: ignore[no-untyped-def]
    return abs(x[0] * y[0]) + abs(x[1] * y[1]) + abs(x[2] * y[2])


@njit(inline="always")
def _minus(x, y):  # type: ignore[no-untyped-def]
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


@njit(inline="always")
def _vector(rows, i):  # type: ignore[no-untyped-def]
    return rows[i, 0], rows[i, 1], rows[i, 2]


@njit(error_model="numpy", makes_arrays=False)
def _barycentrics(qi: Any, qj: Any, wi: Any, wj: Any, edges: Any) -> Any:
    """B1, B2 of a vector in the plane, given its components i and j and bounds of their error,
    and bounds of the errors of B1 and B2."""
    e1i, e1j, e2i, e2j, nk, relative = edges
    b1 = (qi * e2j - qj * e2i) / nk
    b2 = (e1i * qj - e1j * qi) / nk
    room = abs(nk) * (1.0 - relative)
    w1 = (wi * abs(e2j) + wj * abs(e2i) + FEW * (abs(qi * e2j) + abs(qj * e2i))) / room
    w2 = (wi * abs(e1j) + wj * abs(e1i) + FEW * (abs(qi * e1j) + abs(qj * e1i))) / room
    spread = 2.0 * relative + FEW
    return b1, b2, w1 + spread * abs(b1), w2 + spread * abs(b2)


@njit(error_model="numpy", makes_arrays=False)
def _attribute(f0: Any, f1: Any, f2: Any, hit: Any, right: Any, up: Any, far: Any) -> Any:
    """An attribute at the hit, half its extent over the doubled footprint, and a bound of the
    first's rounding error. Outward: the extent is too large by its rounding."""
    if f0 == f1 == f2:
        return f0, 0.0, 0.0
    d1, d2 = f1 - f0, f2 - f0
    b1, b2, w1, w2 = hit
    value = f0 + b1 * d1 + b2 * d2
    reach = abs(f0) + (abs(f0) + abs(f1)) * abs(b1) + (abs(f0) + abs(f2)) * abs(b2)
    error = w1 * abs(d1) + w2 * abs(d2) + FEW * reach
    along_right = right[0] * d1 + right[1] * d2
    along_up = up[0] * d1 + up[1] * d2
    wide = (right[2] + up[2] + FEW * (abs(right[0]) + abs(up[0]))) * abs(d1)
    wide += (right[3] + up[3] + FEW * (abs(right[1]) + abs(up[1]))) * abs(d2)
    half = max(
        2.0 * (abs(along_right + along_up) + wide) * far[0],
        2.0 * (abs(along_right - along_up) + wide) * far[1],
    )
    if not max(far[0], far[1]) < np.inf:
        half = np.inf
    return value, half * (1.0 + FEW), error


@njit(error_model="numpy", makes_arrays=False)
def footprint(
    axes: NDArray[Any], a: float, b: float, perspective: bool, v0: Any, v1: Any, v2: Any
) -> Any:
    """What all attributes of a triangle have in common at a sample, for `_attribute`.

    `axes`: (4, 3) float64, rows e, F, R, U; `v0`, `v1`, `v2`: three floats
    each, in the coordinates of e.
    Returns (hit, right, up, far): barycentrics B1, B2 of the hit and bounds of their errors;
    how much a step of R, and of U, changes them at depth 1, likewise; and at which depth, the
    greater one, lie the corners +R +U and -R -U, and +R -U and -R +U, of the doubled footprint.
    NaN where the triangle is degenerate or edge-on, or float64 cannot tell that it is not.
    """
    eye, forward, right, up = (
        _vector(axes, 0),
        _vector(axes, 1),
        _vector(axes, 2),
        _vector(axes, 3),
    )
    p = _minus(v0, eye)
    e1, e2 = _minus(v1, v0), _minus(v2, v0)
    n = (
        e1[1] * e2[2] - e1[2] * e2[1],
        e1[2] * e2[0] - e1[0] * e2[2],
        e1[0] * e2[1] - e1[1] * e2[0],
    )
    n_size = (
        abs(e1[1] * e2[2]) + abs(e1[2] * e2[1]),
        abs(e1[2] * e2[0]) + abs(e1[0] * e2[2]),
        abs(e1[0] * e2[1]) + abs(e1[1] * e2[0]),
    )
    side = (
        a * right[0] + b * up[0],
        a * right[1] + b * up[1],
        a * right[2] + b * up[2],
    )
    side_size = (
        abs(a * right[0]) + abs(b * up[0]),
        abs(a * right[1]) + abs(b * up[1]),
        abs(a * right[2]) + abs(b * up[2]),
    )
    # d, p - (where the ray starts), and the sizes that their rounding is relative to.
    if perspective:
        d = (forward[0] + side[0], forward[1] + side[1], forward[2] + side[2])
        d_size = (
            abs(forward[0]) + side_size[0],
            abs(forward[1]) + side_size[1],
            abs(forward[2]) + side_size[2],
        )
        p_size = (abs(p[0]), abs(p[1]), abs(p[2]))
    else:
        d = forward
        d_size = (abs(d[0]), abs(d[1]), abs(d[2]))
        p_size = (
            abs(p[0]) + side_size[0],
            abs(p[1]) + side_size[1],
            abs(p[2]) + side_size[2],
        )
        p = _minus(p, side)
    above, below = _dot(n, p), _dot(n, d)
    above_error = PRODUCT * _size(n_size, p_size)
    below_error = PRODUCT * _size(n_size, d_size)
    room = abs(below) - below_error
    # The pair of components that spans the plane best.
    k = 0
    if abs(n[1]) > abs(n[k]):
        k = 1
    if abs(n[2]) > abs(n[k]):
        k = 2
    i, j = (k + 1) % 3, (k + 2) % 3
    if not (room > 0.0 and abs(n[k]) > 2.0 * NORMAL * n_size[k]):
        nan = np.nan
        return (nan, nan, nan, nan), (nan, nan, nan, nan), (nan, nan, nan, nan), (nan, nan)
    edges = (e1[i], e1[j], e2[i], e2[j], n[k], NORMAL * n_size[k] / abs(n[k]))

    t = above / below
    t_error = (above_error + abs(t) * below_error) / room + FEW * abs(t)
    hit = _barycentrics(
        t * d[i] - p[i],
        t * d[j] - p[j],
        t_error * (abs(d[i]) + FEW * d_size[i]) + FEW * (abs(t) * d_size[i] + p_size[i]),
        t_error * (abs(d[j]) + FEW * d_size[j]) + FEW * (abs(t) * d_size[j] + p_size[j]),
        edges,
    )
    # D - d (n . D) / n . d, for D = R and D = U; the quotient g is off by at most `off`.
    right_dot, up_dot = _dot(n, right), _dot(n, up)
    right_error, up_error = PRODUCT * _size(n_size, right), PRODUCT * _size(n_size, up)
    g = right_dot / below
    off = (right_error + abs(g) * below_error) / room + FEW * abs(g)
    per_right = _barycentrics(
        right[i] - d[i] * g,
        right[j] - d[j] * g,
        off * d_size[i] + FEW * (abs(right[i]) + d_size[i] * abs(g)),
        off * d_size[j] + FEW * (abs(right[j]) + d_size[j] * abs(g)),
        edges,
    )
    g = up_dot / below
    off = (up_error + abs(g) * below_error) / room + FEW * abs(g)
    per_up = _barycentrics(
        up[i] - d[i] * g,
        up[j] - d[j] * g,
        off * d_size[i] + FEW * (abs(up[i]) + d_size[i] * abs(g)),
        off * d_size[j] + FEW * (abs(up[j]) + d_size[j] * abs(g)),
        edges,
    )
    if not perspective:
        return hit, per_right, per_up, (1.0, 1.0)
    # The depth at a corner is above / (below ± ...): t times below / that, at the farther one.
    wide = room - 2.0 * (right_error + up_error)
    same, other = (
        wide - 2.0 * abs(right_dot + up_dot) * (1.0 + FEW),
        wide - 2.0 * abs(right_dot - up_dot) * (1.0 + FEW),
    )
    top = (abs(above) + above_error) * (1.0 + FEW)
    return (
        hit,
        per_right,
        per_up,
        (top / same if same > 0.0 else np.inf, top / other if other > 0.0 else np.inf),
    )


@njit(error_model="numpy", makes_arrays=False)
def lookup_box(
    m: MaskArrays,
    row: int,
    axes: NDArray[Any],
    a: float,
    b: float,
    perspective: bool,
    v0: Any,
    v1: Any,
    v2: Any,
) -> Any:
    """`mask_state`'s u, v, du, dv, eu, ev and range of vertex alpha for a sample's ray and the
    triangle of masked row `row`, which the ray is known to meet. Arguments as `footprint`'s:
    `axes` is (4, 3) float64, rows e, F, R, U."""
    hit, right, up, far = footprint(axes, a, b, perspective, v0, v1, v2)
    uv, alpha = m.triangles[row].uv, m.triangles[row].vertex_alpha
    u, du, eu = _attribute(uv[0, 0], uv[1, 0], uv[2, 0], hit, right, up, far)
    v, dv, ev = _attribute(uv[0, 1], uv[1, 1], uv[2, 1], hit, right, up, far)
    x, dx, ex = _attribute(alpha[0], alpha[1], alpha[2], hit, right, up, far)
    # The footprint may reach beyond the triangle; what is drawn of it does not.
    least, greatest = min(alpha[0], alpha[1], alpha[2]), max(alpha[0], alpha[1], alpha[2])
    low = max(x - (dx + ex), least) if np.isfinite(x) else least
    high = min(x + (dx + ex), greatest) if np.isfinite(x) else greatest
    return u, v, du, dv, eu, ev, low, high


@njit(error_model="numpy", makes_arrays=False)
def state_at(
    m: MaskArrays,
    row: int,
    axes: NDArray[Any],
    a: float,
    b: float,
    perspective: bool,
    v0: Any,
    v1: Any,
    v2: Any,
) -> Any:
    """SOLID, HOLE or BETWEEN at a sample, arguments as `lookup_box`'s. A triangle that float64
    cannot tell from an edge-on one is BETWEEN unless its texture does not matter. `axes`: (4, 3)
    float64, rows e, F, R, U."""
    u, v, du, dv, eu, ev, low, high = lookup_box(m, row, axes, a, b, perspective, v0, v1, v2)
    return mask_state(m, row, u, v, du, dv, eu, ev, low, high)


@njit(makes_arrays=False)
def _states_at(
    m: MaskArrays,
    row: Any,
    axes: Any,
    samples: Any,
    perspective: bool,
    corners: Any,
    result: NDArray[Any],
) -> None:
    for i in range(len(row)):
        result[i] = state_at(
            m,
            row[i],
            axes,
            samples[i, 0],
            samples[i, 1],
            perspective,
            _vector(corners[i], 0),
            _vector(corners[i], 1),
            _vector(corners[i], 2),
        )


def states_at(
    masks: Masks,
    row: NDArray[Any],
    axes: NDArray[Any],
    samples: NDArray[Any],
    perspective: bool,
    corners: NDArray[Any],
) -> NDArray[np.uint8]:
    """(n,) uint8, `state_at` of n hits: rows (n,) of the triangles, samples (n, 2) of a and b,
    corners (n, 3, 3) in the coordinates of e; `axes` (4, 3) float64 holds e, F, R and U."""
    result = np.empty(len(row), np.uint8)
    _states_at(
        masks.arrays,
        np.ascontiguousarray(row, np.int64),
        np.ascontiguousarray(axes, np.float64),
        np.ascontiguousarray(samples, np.float64).reshape(-1, 2),
        perspective,
        np.ascontiguousarray(corners, np.float64).reshape(-1, 3, 3),
        result,
    )
    return result
