"""The float64 filters of exact visibility: what they compute, and why they may be believed.

A sample's ray is e + t (F + aR + bU) (perspective) or e + aR + bU + t F (orthographic), all
of e, F, R, U, a, b exact float64 numbers, the vertices v0, v1, v2 exact float32 numbers. With
w = v - e, n = (v1 - v0) x (v2 - v0) and d = F + aR + bU:

    perspective   E_i = d . (w_j x (v_k - v_j))                 N = w0 . n    D = d . n
    orthographic  E_i = ((v_j - v_k) x F) . (aR + bU - w_k)     N = (w0 - aR - bU) . n   D = F . n

for (i, j, k) = (0, 1, 2), (1, 2, 0), (2, 0, 1). The ray meets the triangle's plane at
t = N / D and the closed triangle where D != 0 and no E_i has the sign opposite to D's.
Everything is affine in (a, b). Perspective hits have t > 0, so N and D share their sign:
all that is left is s E_i >= 0 with s = sign(N), and 1/t = D / N is affine. Orthographic:
s = sign(D), and t = N / D is affine. The *key* q, larger is nearer, is 1/t or -t.

Rounding. u = 2^-53 bounds the relative error of one operation, wherever a sum or difference
(never inexact when subnormal) or a product, quotient that does not underflow; an underflowing
product errs by at most 2^-1075 besides. (A fused multiply-add would only round less.) Writing
g for the difference of two vertices, m for the max-norm of w and h for that of g, as computed:

* w, g: one rounding per component. Cross products w x g: 2 (operands) + 1 (product) + 1
  (difference) = 4 roundings on two products of size <= m h. A dot product of that with an exact
  vector: 1 + 2 more = 7. Evaluated at (a, b) as (c + b cb) + a ca: at most 3 more = 10. So
      |error E| <= ((1+u)^10 - 1) 2 m h (|F|_1 + |a| |R|_1 + |b| |U|_1) = 20.0..1 u m h reach
  Orthographic: g x F costs 3, the dot product with w_k 1 + 1 + 2, the evaluation 3: 10 again,
  on 2 h |F|_inf (3 m + |a| |R|_1 + |b| |U|_1). `EDGE` = 24 u; the fifth to spare pays for the
  roundings of the bound itself (fewer than 30 u of it).
* N perspective, w0 . n: 4 for n, 1 for w0, 1 + 2 for the dot product = 8, on 3 m0 2 h1 h2:
  48.0..1 u m0 h1 h2. `PERSPECTIVE_SIGN` = 56 u. D orthographic, F . n: 7 on 2 h1 h2 |F|_1:
  14.0..1 u. `ORTHOGRAPHIC_SIGN` = 18 u.
* q = D / N: the terms of D cost 7, the reciprocal r = 1/N and the product with it 2, the
  evaluation 3: 12, orthographic 8 + 2 + 3 = 13, on X = 2 h1 h2 reach |r|, so 13.0..1 u X; the
  denominator's own error B (accepted only where |N| > 4 B) turns into at most
  X B / (|N| - B) <= 1.34 X B |r|. The filter uses 1.25 X (16 u + 2 B |r|): what is left over
  pays for the rounding of q -+ error (|q| <= X).
* Underflow: a handful of 2^-1075, each amplified by no more than 1 + reach + |a| + |b|, and for
  q by |r|: `tiny` = 2^-1000 (1 + reach + |a| + |b|) is far above their sum.

Overflow and NaN make every comparison below false, which means *undecided*: the exact path
then decides. All filters are written so that doubt falls that way.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.errors import InputError
from visref.scene import Float64

U = 2.0**-53
EDGE = 24.0 * U
PERSPECTIVE_SIGN = 56.0 * U
ORTHOGRAPHIC_SIGN = 18.0 * U
KEY = 16.0 * U
TINY = 2.0**-1000
# The dual vectors are rounded once from exact rationals; X . w then has 1 (X) + 1 (w) + 1
# (product) + 2 (sums) = 5 roundings on |X|_1 |w|_inf.
PROJECT = 6.0 * U
# The bound on a clipped edge's point: the roundings above, and 8 u (|x_i| + |x_j|) for the
# interpolation, each |x| <= |X|_1 |w|_inf.
PROJECT_CLIPPED = 24.0 * U
# (a, b) to pixels costs four roundings of numbers below 2^26 (image sides are at most 2^20;
# greater shifts turn the screen boxes off): 2^-25 px, and the columns' own a as much again.
PIXEL_SLACK = 2.0**-20
GREATEST_SHIFT_PX = 2.0**24
# Sums and products of three of vertex - eye must not overflow; float32 vertices cannot.
GREATEST_EYE = 2.0**300
# Nor may the dual vectors overflow, or lose their relative accuracy below the normal range.
GREATEST_STEP = 2.0**300

Three = tuple[float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]

# What `set_up` says of a triangle.
NOTHING, CERTAIN, DOUBTFUL = 0, 1, 2

# The layout of what `set_up` computes: where the (c, ca, cb) of three edges and of the key begin,
# where the edges' three bounds do, and the rest. A doubtful triangle's "key" is D itself
# (perspective).
EDGE_0, EDGE_1, EDGE_2, KEY_PLANE = 0, 3, 6, 9
BOUND_0, BOUND_1, BOUND_2, KEY_BOUND, SIGN, SIGN_BOUND = range(12, 18)
SET_UP_SIZE = 18


class Samples(Protocol):
    """What defines a grid of samples: a Camera is one. See `visref.camera` for the letters.

    `eye`, `forward`, `right_step` and `up_step` are (3,) float64, `column_a` (width,) and `row_b`
    (height,) float64.
    """

    @property
    def is_perspective(self) -> bool: ...
    @property
    def eye(self) -> Float64: ...
    @property
    def forward(self) -> Float64: ...
    @property
    def right_step(self) -> Float64: ...
    @property
    def up_step(self) -> Float64: ...
    @property
    def column_a(self) -> Float64: ...
    @property
    def row_b(self) -> Float64: ...
    @property
    def near(self) -> float: ...
    @property
    def far(self) -> float: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def shift_x_px(self) -> float: ...
    @property
    def shift_y_px(self) -> float: ...
    @property
    def clip_plane(self) -> tuple[float, float, float, float] | None: ...


class View(NamedTuple):
    """One camera in the form that the compiled filters read. Vectors are (3,) float64."""

    perspective: bool
    lens: Float64  # e, f, r, u, reach, f_norm, tiny in one row of 15, for `set_up`
    e: Float64
    f: Float64
    r: Float64
    u: Float64
    x_dual: Float64  # a = x_dual . w / t, b = y_dual . w / t, t = z_dual . w
    y_dual: Float64
    z_dual: Float64
    x_norm: float  # |x_dual|_1, and so on
    y_norm: float
    z_norm: float
    reach: float  # |F|_1 + max|a| |R|_1 + max|b| |U|_1, orthographic without |F|_1
    f_norm: float  # |F|_1
    tiny: float
    near: float
    far: float
    # A key above `too_near` or below `too_far` is certainly out of range, one at most
    # `near_enough` and at least `far_enough` certainly inside.
    too_near: float
    near_enough: float
    far_enough: float
    too_far: float
    # A hit of key q counts where clip[0] q + (clip[1] + a clip[2] + b clip[3]) >= 0, which is known
    # to within clip[4] |q| + clip[5]; `clips`: whether there is such a plane.
    clips: bool
    clip: Float64
    boxes: bool  # whether screen boxes may be used
    width: int
    height: int
    shift_x_px: float
    shift_y_px: float
    a_least: float
    a_greatest: float
    b_least: float
    b_greatest: float


def view_of(camera: Samples) -> View:
    """Everything about a camera that the filters need, with its own roundings accounted for."""
    e, f, r, u = camera.eye, camera.forward, camera.right_step, camera.up_step
    if np.abs(e).max() > GREATEST_EYE:
        raise InputError(
            f"the camera stands at {e.tolist()}",
            place="world_from_camera",
            fix="bring it within 2^300 units of the origin",
        )
    step = min(float(np.abs(r).max()), float(np.abs(u).max()))
    if not 1.0 / GREATEST_STEP < step < GREATEST_STEP:
        raise InputError(
            f"half a pixel is {step:.3g} of a unit",
            place="yfov" if camera.is_perspective else "ymag",
            fix="give a view between 2^-300 and 2^300",
        )
    a, b = camera.column_a, camera.row_b
    a_size, b_size = float(np.abs(a).max()), float(np.abs(b).max())
    norm = [float(np.abs(v).sum()) for v in (f, r, u)]
    offset = a_size * norm[1] + b_size * norm[2]
    reach = offset + norm[0] if camera.is_perspective else offset
    duals = _dual_basis(r, u, f)
    shifts = max(abs(camera.shift_x_px), abs(camera.shift_y_px))
    too_near, near_enough, far_enough, too_far = _key_range(camera)
    tiny = TINY * (1.0 + reach + norm[0] + a_size + b_size)
    return View(
        perspective=camera.is_perspective,
        lens=np.concatenate([e, f, r, u, [reach, norm[0], tiny]]),
        e=e,
        f=f,
        r=r,
        u=u,
        x_dual=duals[0],
        y_dual=duals[1],
        z_dual=duals[2],
        x_norm=float(np.abs(duals[0]).sum()),
        y_norm=float(np.abs(duals[1]).sum()),
        z_norm=float(np.abs(duals[2]).sum()),
        reach=reach,
        f_norm=norm[0],
        tiny=tiny,
        near=float(camera.near),
        far=float(camera.far),
        too_near=too_near,
        near_enough=near_enough,
        far_enough=far_enough,
        too_far=too_far,
        clips=camera.clip_plane is not None,
        clip=_clip(camera, a_size, b_size),
        boxes=bool(shifts <= GREATEST_SHIFT_PX),
        width=camera.width,
        height=camera.height,
        shift_x_px=float(camera.shift_x_px),
        shift_y_px=float(camera.shift_y_px),
        a_least=float(a.min()),
        a_greatest=float(a.max()),
        b_least=float(b.min()),
        b_greatest=float(b.max()),
    )


def _dual_basis(r: Float64, u: Float64, f: Float64) -> Float64:
    """(3, 3) float64: the rows that give (a, b, t) of a vector w, each entry rounded once from
    the exact inverse of the matrix with columns R, U, F."""
    columns = [[Fraction(float(x)) for x in v] for v in (r, u, f)]

    def cross(p: list[Fraction], q: list[Fraction]) -> list[Fraction]:
        return [p[i - 2] * q[i - 1] - p[i - 1] * q[i - 2] for i in range(3)]

    rows = [cross(columns[i - 2], columns[i - 1]) for i in range(3)]
    determinant = sum((x * y for x, y in zip(columns[0], rows[0], strict=True)), Fraction(0))
    if determinant == 0:
        raise InputError("F, R and U lie in one plane", place="samples", fix="record them anew")
    return np.array([[float(x / determinant) for x in row] for row in rows])


def _clip(camera: Samples, a_size: float, b_size: float) -> Float64:
    """(6,) float64, the clip plane as `View.clip` has it; zeros without one.

    A point e + t d of a ray counts where C0 + t C1 >= 0, C0 = n . e + d and C1 = n . d (an
    orthographic origin is e + aR + bU). Times the key 1/t that is C0 q + C1, and with the key -t
    it is C0 - q C1. Each of the four numbers takes at most 7 roundings, and the sum at a sample 7
    more: 16 u of the sums of absolute products hold both, with the second-order terms.
    """
    if camera.clip_plane is None:
        return np.zeros(6)
    plane = np.array(camera.clip_plane)
    # By a power of two, exactly: what is small beside it may underflow, which `TINY` holds.
    plane = plane * 2.0 ** -float(np.frexp(np.abs(plane[:3]).max())[1])
    n, d = plane[:3], float(plane[3])
    vectors = (camera.eye, camera.forward, camera.right_step, camera.up_step)
    e, f, r, u = (float((n * v).sum()) for v in vectors)
    e_size, f_size, r_size, u_size = (float(np.abs(n * v).sum()) for v in vectors)
    aside = a_size * r_size + b_size * u_size
    if camera.is_perspective:
        of_key, terms = e + d, (f, r, u)
        sizes = e_size + abs(d), f_size + aside
    else:
        of_key, terms = -f, (e + d, r, u)
        sizes = f_size, e_size + abs(d) + aside
    bounds = [16.0 * U * size + TINY for size in sizes]
    return np.array([of_key, *terms, *bounds])


@njit(error_model="numpy", inline="always")
def clip_state(c: NDArray[Any], lower: float, upper: float, a: float, b: float) -> int:
    """Whether hits of keys from `lower` to `upper` at a sample lie before the clip plane, which is
    `View.clip`: -1 where all are certainly cut away, 1 where none is, 0 where that is open."""
    fixed = (c[1] + b * c[3]) + a * c[2]
    one, other = c[0] * lower + fixed, c[0] * upper + fixed
    error = c[4] * max(abs(lower), abs(upper)) + c[5]
    if max(one, other) < -error:
        return -1
    return 1 if min(one, other) >= error else 0


def _key_range(camera: Samples) -> tuple[float, float, float, float]:
    near, far = float(camera.near), float(camera.far)
    if not camera.is_perspective:
        return -near, -near, -far, -far
    # 1/near and 1/far are rounded once; four units either way are more than enough, and beyond
    # 2^+-1000, where reciprocals leave the normal range, the outermost values stand.
    if near < TINY:
        too_near, near_enough = math.inf, 1.0 / TINY
    else:
        too_near, near_enough = (1.0 / near) * (1.0 + 4.0 * U), (1.0 / near) * (1.0 - 4.0 * U)
    if far > 1.0 / TINY:
        # Also the infinite range: t > 0 alone is asked.
        return too_near, near_enough, TINY, 0.0
    return too_near, near_enough, (1.0 / far) * (1.0 + 4.0 * U), (1.0 / far) * (1.0 - 4.0 * U)


@njit(error_model="numpy", inline="always")
def _largest(x: float, y: float, z: float) -> float:
    return max(abs(x), max(abs(y), abs(z)))


@njit(error_model="numpy", inline="always")
def functions(
    p: Nine, perspective: bool, e: Three, f: Three, r: Three, u: Three, rest: Three
) -> Any:
    """A triangle's affine functions and their bounds, in the layout above, and whether its
    orientation is certain: 18 numbers and a bool.

    `p`: its corners, float32 numbers; `rest`: reach, f_norm, tiny. One straight line of arithmetic,
    for one triangle or for a vector of them.
    """
    px, py, pz, qx, qy, qz, sx, sy, sz = p
    view_reach, f_norm, tiny = rest
    # Edges a->b, b->c, c->a.
    abx, aby, abz = qx - px, qy - py, qz - pz
    bcx, bcy, bcz = sx - qx, sy - qy, sz - qz
    cax, cay, caz = px - sx, py - sy, pz - sz
    h_ab, h_bc, h_ca = (
        _largest(abx, aby, abz),
        _largest(bcx, bcy, bcz),
        _largest(cax, cay, caz),
    )
    ax, ay, az = px - e[0], py - e[1], pz - e[2]
    bx, by, bz = qx - e[0], qy - e[1], qz - e[2]
    cx, cy, cz = sx - e[0], sy - e[1], sz - e[2]
    m_a, m_b, m_c = _largest(ax, ay, az), _largest(bx, by, bz), _largest(cx, cy, cz)
    # (b - a) x (c - a), with c - a = -(a - c), exactly.
    nx = abz * cay - aby * caz
    ny = abx * caz - abz * cax
    nz = aby * cax - abx * cay
    h2 = h_ab * h_ca
    if perspective:
        denominator = ax * nx + ay * ny + az * nz
        bound = PERSPECTIVE_SIGN * m_a * h2 + tiny
    else:
        denominator = f[0] * nx + f[1] * ny + f[2] * nz
        bound = ORTHOGRAPHIC_SIGN * h2 * f_norm + tiny
    certain = abs(denominator) > 4.0 * bound
    sign = -1.0 if certain & (denominator < 0.0) else 1.0
    if perspective:
        x, y, z = by * bcz - bz * bcy, bz * bcx - bx * bcz, bx * bcy - by * bcx
        c0 = sign * (f[0] * x + f[1] * y + f[2] * z)
        ca0 = sign * (r[0] * x + r[1] * y + r[2] * z)
        cb0 = sign * (u[0] * x + u[1] * y + u[2] * z)
        x, y, z = cy * caz - cz * cay, cz * cax - cx * caz, cx * cay - cy * cax
        c1 = sign * (f[0] * x + f[1] * y + f[2] * z)
        ca1 = sign * (r[0] * x + r[1] * y + r[2] * z)
        cb1 = sign * (u[0] * x + u[1] * y + u[2] * z)
        x, y, z = ay * abz - az * aby, az * abx - ax * abz, ax * aby - ay * abx
        c2 = sign * (f[0] * x + f[1] * y + f[2] * z)
        ca2 = sign * (r[0] * x + r[1] * y + r[2] * z)
        cb2 = sign * (u[0] * x + u[1] * y + u[2] * z)
        reach = EDGE * view_reach
        bound0 = reach * m_b * h_bc + tiny
        bound1 = reach * m_c * h_ca + tiny
        bound2 = reach * m_a * h_ab + tiny
        q, qa, qb = (
            f[0] * nx + f[1] * ny + f[2] * nz,
            r[0] * nx + r[1] * ny + r[2] * nz,
            u[0] * nx + u[1] * ny + u[2] * nz,
        )
        size = h2 * view_reach
    else:
        # (v_j - v_k) x F = F x (v_k - v_j).
        x, y, z = f[1] * bcz - f[2] * bcy, f[2] * bcx - f[0] * bcz, f[0] * bcy - f[1] * bcx
        c0 = -sign * (x * cx + y * cy + z * cz)
        ca0 = sign * (r[0] * x + r[1] * y + r[2] * z)
        cb0 = sign * (u[0] * x + u[1] * y + u[2] * z)
        x, y, z = f[1] * caz - f[2] * cay, f[2] * cax - f[0] * caz, f[0] * cay - f[1] * cax
        c1 = -sign * (x * ax + y * ay + z * az)
        ca1 = sign * (r[0] * x + r[1] * y + r[2] * z)
        cb1 = sign * (u[0] * x + u[1] * y + u[2] * z)
        x, y, z = f[1] * abz - f[2] * aby, f[2] * abx - f[0] * abz, f[0] * aby - f[1] * abx
        c2 = -sign * (x * bx + y * by + z * bz)
        ca2 = sign * (r[0] * x + r[1] * y + r[2] * z)
        cb2 = sign * (u[0] * x + u[1] * y + u[2] * z)
        scale = EDGE * f_norm
        bound0 = scale * h_bc * (3.0 * m_c + view_reach) + tiny
        bound1 = scale * h_ca * (3.0 * m_a + view_reach) + tiny
        bound2 = scale * h_ab * (3.0 * m_b + view_reach) + tiny
        q, qa, qb = (
            -(ax * nx + ay * ny + az * nz),
            r[0] * nx + r[1] * ny + r[2] * nz,
            u[0] * nx + u[1] * ny + u[2] * nz,
        )
        size = h2 * (3.0 * m_a + view_reach)
    inverse = 1.0 / denominator
    length = abs(inverse)
    error = 2.5 * size * length * (KEY + 2.0 * bound * length) + tiny * length + tiny
    error = error if certain else EDGE * size + tiny
    inverse = inverse if certain else 1.0
    q, qa, qb = q * inverse, qa * inverse, qb * inverse
    edges = c0, ca0, cb0, c1, ca1, cb1, c2, ca2, cb2
    return edges, (q, qa, qb), (bound0, bound1, bound2, error, denominator, bound), certain


@njit(error_model="numpy", inline="always")
def axes_of(lens: NDArray[Any]) -> Any:
    """A View's `lens` in numbers: e, f, r, u, and (reach, f_norm, tiny)."""
    return (
        (lens[0], lens[1], lens[2]),
        (lens[3], lens[4], lens[5]),
        (lens[6], lens[7], lens[8]),
        (lens[9], lens[10], lens[11]),
        (lens[12], lens[13], lens[14]),
    )


@njit(error_model="numpy")
def set_up(
    p: NDArray[Any], one_sided: bool, perspective: bool, lens: NDArray[Any], out: NDArray[Any]
) -> int:
    """Compute a triangle's affine functions and their bounds into `out` (see the layout above).

    `p`: (9,) float32, its corners; `perspective`, `lens`: of the View. Returns NOTHING where it
    certainly covers no sample, CERTAIN with edges oriented so that inside is >= 0, or DOUBTFUL
    where the orientation is not certain.
    """
    e, f, r, u, rest = axes_of(lens)
    corners = (
        np.float64(p[0]), np.float64(p[1]), np.float64(p[2]),
        np.float64(p[3]), np.float64(p[4]), np.float64(p[5]),
        np.float64(p[6]), np.float64(p[7]), np.float64(p[8]),
    )  # fmt: skip
    edges, key, bounds, certain = functions(corners, perspective, e, f, r, u, rest)
    for k in range(9):
        out[k] = edges[k]
    for k in range(3):
        out[KEY_PLANE + k] = key[k]
    for k in range(6):
        out[BOUND_0 + k] = bounds[k]
    if not certain:
        return DOUBTFUL
    return NOTHING if one_sided and bounds[SIGN - BOUND_0] > 0.0 else CERTAIN
