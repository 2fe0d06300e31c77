"""A prim's place and visibility, as operations with keys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from visref.errors import InputError
from visref.formats.keyed_ops import Keys, Op
from visref.scene import Float64

_KINDS = {
    UsdGeom.XformOp.TypeTranslate: "translate",
    UsdGeom.XformOp.TypeScale: "scale",
    UsdGeom.XformOp.TypeOrient: "orient",
    UsdGeom.XformOp.TypeTransform: "matrix",
    **{
        getattr(UsdGeom.XformOp, f"TypeRotate{axes}"): f"rotate{axes}"
        for axes in ("X", "Y", "Z", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
    },
}
# Along one axis alone: which, of what, and what the others are.
_ALONE = {
    getattr(UsdGeom.XformOp, f"Type{name}{axis}", None): (name.lower(), "XYZ".index(axis))
    for name in ("Translate", "Scale")
    for axis in "XYZ"
}


def rest_value(attribute: Any) -> Any:
    """An attribute's value where no time is given: its default, else its first sample; None where
    it has neither."""
    return attribute.Get(rest_time(attribute))


def rest_time(attribute: Any) -> Any:
    """The time code of `rest_value`."""
    default = Usd.TimeCode.Default()
    written = attribute.GetResolveInfo(default).GetSource() == Usd.ResolveInfoSourceDefault
    return default if written else Usd.TimeCode.EarliestTime()


class Clock:
    """Seconds of a stage's time codes; and what is animated and cannot be played."""

    def __init__(self, stage: Any) -> None:
        self.rate = float(stage.GetTimeCodesPerSecond())
        if not 0.0 < self.rate < np.inf:
            raise InputError(
                f"it has {self.rate} time codes a second",
                place="timeCodesPerSecond",
                fix="give a positive number",
            )
        self.held = stage.GetInterpolationType() == Usd.InterpolationTypeHeld
        self.unplayed: list[str] = []

    def keys(self, attribute: Any, convert: Callable[[Any], NDArray[Any]]) -> Keys | None:
        """An attribute's samples in time, each converted; None where it has none that differs from
        its value at rest, or they cannot be played."""
        if attribute.HasSpline():
            self.unplayed.append(str(attribute.GetPath()))
            return None
        codes = attribute.GetTimeSamples()
        if not codes or (len(codes) == 1 and rest_time(attribute) != Usd.TimeCode.Default()):
            return None
        values = [attribute.Get(code) for code in codes]
        found = [None if value is None else convert(value) for value in values]
        shapes = {None if value is None else value.shape for value in found}
        times = np.array(codes, np.float64) / self.rate
        steady = np.isfinite(times).all() and (np.diff(times) > 0.0).all()
        if None in shapes or len(shapes) > 1 or not steady:
            self.unplayed.append(str(attribute.GetPath()))
            return None
        return Keys(times, np.stack([value for value in found if value is not None]))

    def moving(self, attribute: Any) -> bool:
        """Whether an attribute that is taken as it is at rest is animated, which is noted."""
        if attribute and (attribute.HasSpline() or len(attribute.GetTimeSamples()) > 1):
            self.unplayed.append(str(attribute.GetPath()))
            return True
        return False


def operations(prim: Any, clock: Clock) -> tuple[tuple[Op, ...], bool]:
    """A prim's operations in their order, and whether they start from the root of the stage."""
    xformable = UsdGeom.Xformable(prim)
    if not xformable:
        return (), False
    ops = []
    for op in xformable.GetOrderedXformOps():
        attribute = op.GetAttr()
        kind, convert = _kind(op, attribute)
        value = rest_value(attribute)
        if value is None:
            continue
        rest = convert(value)
        keys = clock.keys(attribute, convert)
        ops.append(Op(kind, rest, keys, bool(op.IsInverseOp())))
    return tuple(ops), bool(xformable.GetResetXformStack())


def _kind(op: Any, attribute: Any) -> tuple[str, Callable[[Any], NDArray[Any]]]:
    """The name of an operation, and what makes numbers of its values."""
    kind = op.GetOpType()
    if kind in _ALONE:
        name, axis = _ALONE[kind]

        def alone(value: Any) -> Float64:
            result = np.full(3, 1.0 if name == "scale" else 0.0)
            result[axis] = float(value)
            return result

        return name, alone
    if kind not in _KINDS:
        raise InputError(
            "the operation is not known", place=str(attribute.GetPath()), fix="export a matrix"
        )
    name = _KINDS[kind]
    if name == "matrix":

        def matrix(value: Any) -> Float64:
            # USD's vectors are rows.
            rows = np.array(value, np.float64).T
            if not np.array_equal(rows[3], (0.0, 0.0, 0.0, 1.0)):
                raise InputError(
                    "the matrix is not affine",
                    place=str(attribute.GetPath()),
                    fix="give an affine matrix",
                )
            return rows.reshape(16)

        return name, matrix
    if name == "orient":
        return name, lambda value: np.array([*value.GetImaginary(), value.GetReal()], np.float64)
    return name, lambda value: np.array(value, np.float64).reshape(-1)


def visibility(prim: Any, clock: Clock) -> tuple[bool, Keys | None]:
    """Whether a prim itself shows what is in it at rest, and in time."""
    imageable = UsdGeom.Imageable(prim)
    if not imageable:
        return True, None
    attribute = imageable.GetVisibilityAttr()

    def shown(value: Any) -> Float64:
        return np.array(value != UsdGeom.Tokens.invisible, np.float64)

    value = rest_value(attribute)
    return value is None or bool(shown(value)), clock.keys(attribute, shown)


def quaternions(values: Any) -> Float64:
    """(n, 4) float64 x y z w, normalised, of USD's quaternions; those of no length turn nothing."""
    result = np.array([[*q.GetImaginary(), q.GetReal()] for q in values], np.float64)
    result = result.reshape(-1, 4)
    lengths = np.sqrt((result * result).sum(axis=1))
    result[lengths == 0.0] = (0.0, 0.0, 0.0, 1.0)
    return result
