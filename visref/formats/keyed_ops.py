"""A place in a hierarchy as a list of operations (move, turn, scale, any matrix), each with keys.

As in USD (UsdGeomXformOp): the operations of a node apply from the last to the first, and each is
interpolated by itself: numbers and matrices linearly, quaternions along the shortest arc. Before
the first key and after the last, those hold. Angles are degrees. All of it is float64, in one
order of operations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.formats.placed import compose
from visref.scene import Float64

# The length of a value.
WIDTHS = {
    "translate": 3,
    "scale": 3,
    "orient": 4,
    "matrix": 16,
    **{f"rotate{axes}": len(axes) for axes in ("X", "Y", "Z")},
    **{f"rotate{axes}": 3 for axes in ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")},
}


@dataclass(frozen=True, eq=False)
class Keys:
    """`times`: (k,) float64 seconds, increasing; `values`: (k, …) floats."""

    times: Float64
    values: NDArray[Any]

    def at(self, time_s: float) -> tuple[int, int, float]:
        """The keys on both sides of a time, and how far it is from the one to the other, 0…1."""
        after = int(np.searchsorted(self.times, time_s, side="right"))
        if after == 0 or after == len(self.times):
            only = max(after - 1, 0)
            return only, only, 0.0
        low, high = float(self.times[after - 1]), float(self.times[after])
        return after - 1, after, (time_s - low) / (high - low)

    def linear(self, time_s: float) -> Float64:
        """The value at a time: a share of the one key's and of the other's."""
        before, after, share = self.at(time_s)
        result: Float64 = self.values[before].astype(np.float64)
        if share > 0.0:
            result = result * (1.0 - share) + self.values[after].astype(np.float64) * share
        return result

    def held(self, time_s: float) -> Float64:
        """The value of the last key."""
        value: Float64 = self.values[self.at(time_s)[0]]
        return value


@dataclass(frozen=True, eq=False)
class Op:
    """One operation: its `kind` is in `WIDTHS`. `rest`: its value where no time is given; `keys`:
    its values in time, None where it stands. Quaternions are x y z w; matrices are 16 numbers by
    rows, parent_from_node. `inverse`: the opposite of what it says."""

    kind: str
    rest: Float64
    keys: Keys | None = None
    inverse: bool = False

    def matrix(self, time_s: float | None) -> Float64:
        """(4, 4) float64, at a time in seconds, or at rest."""
        value = self.rest
        if self.keys is not None and time_s is not None:
            value = self._turned(time_s) if self.kind == "orient" else self.keys.linear(time_s)
        result = _matrix(self.kind, value)
        return inverted(result) if self.inverse else result

    def _turned(self, time_s: float) -> Float64:
        """A quaternion between two, along the shortest arc."""
        assert self.keys is not None
        before, after, share = self.keys.at(time_s)
        a, b = (self.keys.values[i].tolist() for i in (before, after))
        if before == after:
            return np.array(a)
        cosine = math.fsum(x * y for x, y in zip(a, b, strict=True))
        sign = -1.0 if cosine < 0.0 else 1.0
        angle = math.acos(min(abs(cosine), 1.0))
        # Nearer than this the arc is its chord: their difference is below angle³, 1e-18.
        if angle < 1e-6:
            weights = (1.0 - share, share)
        else:
            sine = math.sin(angle)
            weights = (math.sin((1.0 - share) * angle) / sine, math.sin(share * angle) / sine)
        return np.array([weights[0] * x + sign * weights[1] * y for x, y in zip(a, b, strict=True)])


def product(ops: Sequence[Op], time_s: float | None) -> Float64:
    """(4, 4) float64, parent_from_node of a node's operations."""
    result = np.eye(4)
    for op in ops:
        result = compose(result, op.matrix(time_s))
    return result


def inverted(matrix: Float64) -> Float64:
    """The inverse of an affine matrix, (4, 4); not finite where it has none."""
    a, b, c = matrix[:3, 0], matrix[:3, 1], matrix[:3, 2]
    rows = [_cross(b, c), _cross(c, a), _cross(a, b)]
    determinant = _dot(a, rows[0])
    result = np.zeros((4, 4))
    with np.errstate(divide="ignore", invalid="ignore"):
        for i, row in enumerate(rows):
            result[i, :3] = row / determinant
    for i in range(3):
        result[i, 3] = -_dot(result[i, :3], matrix[:3, 3])
    result[3, 3] = 1.0
    return result


def _matrix(kind: str, value: Float64) -> Float64:
    if kind == "matrix":
        return value.reshape(4, 4)
    result = np.eye(4)
    if kind == "translate":
        result[:3, 3] = value
    elif kind == "scale":
        result[[0, 1, 2], [0, 1, 2]] = value
    elif kind == "orient":
        result[:3, :3] = _of_quaternion(*value.tolist())
    else:
        # Of "rotateXYZ" the turn about X comes first, so it stands last.
        axes = kind.removeprefix("rotate")
        for axis in axes:
            degrees = float(value["XYZ".index(axis)] if len(axes) == 3 else value[0])
            result = compose(_turn("XYZ".index(axis), degrees), result)
    return result


def _turn(axis: int, degrees: float) -> Float64:
    sine, cosine = (
        (math.sin(math.radians(degrees)), math.cos(math.radians(degrees)))
        if math.isfinite(degrees)
        else (math.nan, math.nan)
    )
    i, j = (axis + 1) % 3, (axis + 2) % 3
    result = np.eye(4)
    result[i, i] = result[j, j] = cosine
    result[i, j], result[j, i] = -sine, sine
    return result


def _of_quaternion(x: float, y: float, z: float, w: float) -> Float64:
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if length == 0.0:
        return np.eye(3)  # As USD takes it.
    x, y, z, w = x / length, y / length, z / length, w / length
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _dot(a: Float64, b: Float64) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _cross(a: Float64, b: Float64) -> Float64:
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
