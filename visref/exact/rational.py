"""Exact decisions in scaled Python integers, many at a time.

Every number that defines a sample or a triangle is a float, so all of them are integers in a
suitable power of two. NumPy's object arrays run the loops over Python integers, which cannot
overflow or round: what this module says is so. (`fractions.Fraction` reduces after every
operation and is some thirty times slower.)

The functions are those of `visref.exact.filters`, in integers: a triangle's three edges, N and
D, each affine in (a, b), with their signs made such that inside means edges >= 0 and D > 0.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.exact.filters import Samples
from visref.scene import Float64, Int64

# An object array of Python integers.
Integers = NDArray[Any]
Vectors = tuple[Integers, Integers, Integers]


def lowest_bit(values: NDArray[Any]) -> int:
    """The greatest p such that every value is a multiple of 2^p; 0 if all are zero.

    `values`: float32 or float64 of any shape, such as (n, 3, 3) corners; finite."""
    values = np.asarray(values, np.float64).reshape(-1)
    values = values[values != 0.0]
    if not len(values):
        return 0
    mantissa, exponent = np.frexp(values)
    whole = np.ldexp(mantissa, 53).astype(np.int64)
    trailing = np.frexp((whole & -whole).astype(np.float64))[1] - 1
    return int((exponent - 53 + trailing).min())


def in_units(values: NDArray[Any], unit: int) -> Integers:
    """The values, floats of any shape such as (n, 3, 3), as multiples of 2^unit, which they must
    be: an object array of the same shape."""
    values = np.asarray(values, np.float64)
    mantissa, exponent = np.frexp(values)
    whole = np.ldexp(mantissa, 53).astype(np.int64)
    shift = np.where(whole == 0, 0, exponent.astype(np.int64) - 53 - unit)
    # A right shift drops zeros alone; it may exceed int64's 63, which are all zeros then.
    small = whole >> np.minimum(np.maximum(-shift, 0), 63)
    result: Integers = small.astype(object) << np.maximum(shift, 0).astype(object)
    return result


def _cross(p: Vectors, q: Vectors) -> Vectors:
    return (
        p[1] * q[2] - p[2] * q[1],
        p[2] * q[0] - p[0] * q[2],
        p[0] * q[1] - p[1] * q[0],
    )


def _dot(p: Vectors, q: Vectors) -> Integers:
    result: Integers = p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
    return result


def _minus(p: Vectors, q: Vectors) -> Vectors:
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


def _signs(values: Integers) -> NDArray[np.int8]:
    return (values > 0).astype(np.int8) - (values < 0).astype(np.int8)


class ExactFrame:
    """One camera's samples against some triangles, exactly.

    `corners`: (n, 3, 3) float32, the triangles; `one_sided`: (n,) bool. Triangles are named by
    their place in these. `samples` are flat indices y * width + x.
    """

    def __init__(
        self, camera: Samples, corners: NDArray[np.float32], one_sided: NDArray[np.bool_]
    ) -> None:
        self.camera = camera
        self.one_sided = one_sided
        a, b = camera.column_a, camera.row_b
        # a and b are multiples of 2^coordinate, at most 1.
        coordinate = min(lowest_bit(a), lowest_bit(b), 0)
        self._a, self._b = in_units(a, coordinate), in_units(b, coordinate)
        steps = np.stack([camera.right_step, camera.up_step])
        world = min(lowest_bit(corners), lowest_bit(camera.eye))
        if camera.is_perspective:
            direction = min(lowest_bit(camera.forward), lowest_bit(steps))
            step = direction
            # F has to be in the unit of a step times a coordinate.
            forward_shift = -coordinate
            self._depth_unit = world - direction - coordinate
        else:
            direction = lowest_bit(camera.forward)
            # A step times a coordinate must be a whole number of world units.
            world = min(world, lowest_bit(steps) + coordinate)
            step = world - coordinate
            forward_shift = 0
            self._depth_unit = world - direction
        self._set_up(corners, world, direction, step, forward_shift)

    def _set_up(
        self, corners: NDArray[np.float32], world: int, direction: int, step: int, shift: int
    ) -> None:
        camera = self.camera

        def vector(values: Float64, unit: int) -> Vectors:
            x, y, z = in_units(values, unit)
            return x, y, z

        f = vector(camera.forward, direction)
        r, u = vector(camera.right_step, step), vector(camera.up_step, step)
        e = in_units(camera.eye, world)
        relative = in_units(corners, world) - e
        w = [(relative[:, i, 0], relative[:, i, 1], relative[:, i, 2]) for i in range(3)]
        normal = _cross(_minus(w[1], w[0]), _minus(w[2], w[0]))
        zero = np.zeros(len(corners), object)
        edges = []
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            if camera.is_perspective:
                # d . (w_j x w_k).
                across = _cross(w[j], w[k])
                edges.append((_dot(f, across) << shift, _dot(r, across), _dot(u, across)))
            else:
                # F . ((w_j - o) x (w_k - o)) with o = aR + bU.
                across = _cross(_minus(w[j], w[k]), f)
                edges.append((_dot(f, _cross(w[j], w[k])), _dot(r, across), _dot(u, across)))
        along = _dot(f, normal)
        if camera.is_perspective:
            numerator = (_dot(w[0], normal), zero, zero)
            denominator = (along << shift, _dot(r, normal), _dot(u, normal))
            sign = _signs(numerator[0])
        else:
            numerator = (_dot(w[0], normal), -_dot(r, normal), -_dot(u, normal))
            denominator = (along, zero, zero)
            sign = _signs(along)
        self._sign = sign
        as_objects = sign.astype(object)

        def oriented(terms: tuple[Integers, ...]) -> tuple[Integers, ...]:
            return tuple(term * as_objects for term in terms)

        self._edges = [oriented(edge) for edge in edges]
        self._numerator, self._denominator = oriented(numerator), oriented(denominator)

    def _at(self, terms: tuple[Integers, ...], which: Int64, samples: Int64) -> Integers:
        width = self.camera.width
        c, ca, cb = terms
        result: Integers = (
            c[which] + self._a[samples % width] * ca[which] + self._b[samples // width] * cb[which]
        )
        return result

    def covers(self, which: Int64, samples: Int64) -> NDArray[np.bool_]:
        """Whether each triangle covers its sample within the range: (k,) bool."""
        result: NDArray[np.bool_] = self._sign[which] != 0
        # Seen from behind: along the direction of the normal, where N (D) was positive.
        result &= ~(self.one_sided[which] & (self._sign[which] > 0))
        for edge in self._edges:
            result &= _signs(self._at(edge, which, samples)) >= 0
        n = self._at(self._numerator, which, samples)
        d = self._at(self._denominator, which, samples)
        result &= _signs(d) > 0
        result &= self._compare_depth(n, d, self.camera.near) >= 0
        if np.isfinite(self.camera.far):
            result &= self._compare_depth(n, d, self.camera.far) <= 0
        if self.camera.clip_plane is not None:
            for k in np.flatnonzero(result):
                result[k] = self._is_before_clip(int(n[k]), int(d[k]), int(samples[k]))
        return result

    def _is_before_clip(self, n: int, d: int, sample: int) -> bool:
        """Whether the point at depth n / d, in units of depth, of a sample's ray lies before the
        clip plane, or in it."""
        camera = self.camera
        assert camera.clip_plane is not None
        *normal, offset = (Fraction(value) for value in camera.clip_plane)
        width = len(camera.column_a)
        a = Fraction(float(camera.column_a[sample % width]))
        b = Fraction(float(camera.row_b[sample // width]))

        def along(vector: Float64) -> Fraction:
            pairs = zip(normal, vector, strict=True)
            return sum((one * Fraction(float(other)) for one, other in pairs), Fraction(0))

        aside = a * along(camera.right_step) + b * along(camera.up_step)
        at_eye, per_depth = along(camera.eye) + offset, along(camera.forward)
        if camera.is_perspective:
            per_depth += aside
        else:
            at_eye += aside
        return at_eye + Fraction(n, d) * Fraction(2) ** self._depth_unit * per_depth >= 0

    def _compare_depth(self, n: Integers, d: Integers, limit: float) -> NDArray[np.int8]:
        """The sign of n / d - limit, where d > 0."""
        unit = lowest_bit(np.array([limit]))
        whole = int(in_units(np.array(limit), unit))
        # n 2^depth_unit against whole 2^unit d.
        up = max(self._depth_unit - unit, 0)
        down = max(unit - self._depth_unit, 0)
        return _signs((n << up) - d * (whole << down))

    def compare(self, first: Int64, second: Int64, samples: Int64) -> NDArray[np.int8]:
        """-1 where the first triangle's plane is nearer along the sample's ray, 1 where the
        second's, 0 where both are at exactly the same depth. Both must be hit: D > 0.

        `first`, `second`: (k,) triangles; `samples`: (k,). Returns (k,) int8."""
        left = self._at(self._numerator, first, samples) * self._at(
            self._denominator, second, samples
        )
        right = self._at(self._numerator, second, samples) * self._at(
            self._denominator, first, samples
        )
        return _signs(left - right)

    def quotients(self, which: Int64, samples: Int64) -> list[tuple[int, int]]:
        """View depth of each triangle's plane as numerator and denominator, not reduced.

        `which`: (k,) triangles; `samples`: (k,)."""
        n = self._at(self._numerator, which, samples)
        d = self._at(self._denominator, which, samples)
        up, down = max(self._depth_unit, 0), max(-self._depth_unit, 0)
        return [(x << up, y << down) for x, y in zip(n, d, strict=True)]

    def depth(self, which: Int64, samples: Int64) -> Float64:
        """View depth of each triangle's plane, rounded to nearest (ties to even): (k,) float64.

        `which`: (k,) triangles; `samples`: (k,)."""
        # The quotient of two Python integers is correctly rounded.
        return np.array([n / d for n, d in self.quotients(which, samples)], np.float64)


def plane_names(
    corners: NDArray[np.float32], unit: int
) -> list[tuple[int, int, int, int, int] | None]:
    """A name for each triangle's plane: two triangles lie in the same plane if and only if
    their names are equal. None for a degenerate triangle.

    `corners`: (n, 3, 3) float32, multiples of 2^unit; names of different units do not compare.
    """
    whole = in_units(corners, unit)
    v = [(whole[:, i, 0], whole[:, i, 1], whole[:, i, 2]) for i in range(3)]
    normal = _cross(_minus(v[1], v[0]), _minus(v[2], v[0]))
    offset = _dot(v[0], normal)
    names: list[tuple[int, int, int, int, int] | None] = []
    for x, y, z, w in zip(*normal, offset, strict=True):
        # The plane is normal . p = w: reduce the normal by `scale`, and w / scale as a fraction.
        scale = math.gcd(x, y, z)
        if scale == 0:
            names.append(None)
            continue
        if (x, y, z) < (0, 0, 0):
            scale = -scale
        common = math.gcd(w, scale) * (1 if scale > 0 else -1)
        names.append((x // scale, y // scale, z // scale, w // common, scale // common))
    return names
