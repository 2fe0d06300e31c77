"""The forms in which a file may give a camera, all read to one: a rigid `world_from_camera`.

    world_from_camera, camera_from_world    a rigid matrix, one way or the other
    clip_from_world                         what an engine hands its shaders: pose and lens in one
    eye, target, up                         as `look_at` takes them
    position, rotation                      a point and a unit quaternion x, y, z, w, as in glTF

Every matrix is four rows of four, or flat: {"row_major": [16 numbers]}, {"column_major": [...]}.

What was printed with few digits is not quite rigid. Up to `ORTHONORMAL_TOLERANCE` it is taken as
it stands; up to `RIGID_TOLERANCE` it is made rigid here, once, in float64 (the nearest rotation:
the orthogonal factor of the polar decomposition, Higham 1986), and a note says by how much it was
off; beyond that it is refused.

`visref.clip_matrices` takes clip matrices apart.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from visref.camera import ORTHONORMAL_TOLERANCE, Float64, look_at
from visref.clip_matrices import CLIP_DEPTHS, RIGID_TOLERANCE, decomposed
from visref.errors import InputError

# By form, the fields that make it: where a frame gives one of them, the forms above it are void.
FORMS: Mapping[str, tuple[str, ...]] = {
    "world_from_camera": ("world_from_camera",),
    "camera_from_world": ("camera_from_world",),
    "clip_from_world": ("clip_from_world",),
    "eye and target": ("eye", "target", "up"),
    "position and rotation": ("position", "rotation"),
}
CAMERA_FIELDS = (*(name for names in FORMS.values() for name in names), "clip_depth", "clip_y")
# What a clip matrix says beside the pose; near and far may be given over it.
LENS_FIELDS = ("yfov", "ymag", "shift_x_px", "shift_y_px")

CLIP_YS = ("up", "down")

# Among merged fields, those that a clip matrix makes void: no file's field has this name.
_VOID = "\0void"


@dataclass(frozen=True, eq=False)
class GivenCamera:
    """`world_from_camera`: (4, 4) float64. `lens`: what a clip matrix says besides, by the names of
    a camera's fields: yfov or ymag, near, far, shift_x_px, shift_y_px; empty for other forms.
    `off`: by how much what was given had to be moved to be rigid, 0 where it was taken as it is;
    `made`: what that was, for a note."""

    world_from_camera: Float64
    lens: Mapping[str, float] = field(default_factory=dict)
    off: float = 0.0
    made: str = ""


def over(under: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Fields over those that they override. A form of the pose overrides the others, and one kind
    of projection the other. A clip matrix makes the lens void too, as long as no other form
    overrides it. A projection of null says nothing."""
    own = {n: value for n, value in own.items() if value is not None or n not in ("yfov", "ymag")}
    merged = {**under, **own}
    forms = [form for form, names in FORMS.items() if any(name in own for name in names)]
    if forms:
        for form, names in FORMS.items():
            if form not in forms:
                for name in names:
                    merged.pop(name, None)
    if "clip_from_world" in own:
        void = {n: merged.pop(n) for n in LENS_FIELDS if n in merged and n not in own}
        merged[_VOID] = {**under.get(_VOID, {}), **void}
    elif forms:
        for name, value in merged.pop(_VOID, {}).items():
            merged.setdefault(name, value)
    if "ymag" in own or "yfov" in own:
        for name in ("yfov", "ymag"):
            if name not in own:
                merged.pop(name, None)
    return merged


def read_camera(values: Mapping[str, Any], width: int, height: int) -> GivenCamera:
    """The pose, and what lens comes with it, of a camera whose image has these pixels. Raises
    InputError with the place, for more than one form too."""
    forms = [form for form, names in FORMS.items() if any(name in values for name in names[:2])]
    if not forms:
        raise InputError(
            "world_from_camera is missing", fix="give a 4 by 4 matrix, or another form of a camera"
        )
    if len(forms) > 1:
        raise InputError(
            f"the camera is given twice, as {forms[0]} and as {forms[1]}", fix="leave one out"
        )
    match forms[0]:
        case "world_from_camera":
            return _rigid(matrix(values["world_from_camera"], forms[0]), forms[0])
        case "camera_from_world":
            return _inverted(matrix(values["camera_from_world"], forms[0]))
        case "clip_from_world":
            return _from_clip(values, width, height)
        case "eye and target":
            return _from_target(values)
        case _:
            return _from_quaternion(values)


def matrix(value: Any, place: str) -> Float64:
    """(4, 4) float64 from four rows of four, or flat: {"row_major": [16 numbers]} or
    {"column_major": [16 numbers]}. Raises InputError with the place."""
    if isinstance(value, dict):
        orders = [name for name in ("row_major", "column_major") if name in value]
        if len(orders) != 1 or len(value) != 1:
            raise InputError(
                "not a flat matrix", place=place, fix="give row_major or column_major, and no more"
            )
        flat = _numbers(value[orders[0]], 16, f"{place}.{orders[0]}").reshape(4, 4)
        return flat if orders[0] == "row_major" else flat.T.copy()
    rows_ok = isinstance(value, list) and len(value) == 4
    if not rows_ok or not all(isinstance(row, list) and len(row) == 4 for row in value):
        raise InputError("not a 4 by 4 matrix", place=place, fix="give four rows of four")
    return np.array([_numbers(row, 4, f"{place}[{i}]") for i, row in enumerate(value)])


def number(value: Any, place: str) -> float:
    """A float64 from a JSON number. Raises InputError with the place."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{reprlib.repr(value)} is not a number", place=place, fix="give a number")
    try:
        return float(value)
    except OverflowError as error:
        raise InputError(
            "the number is too large", place=place, fix="give a float64 number"
        ) from error


def far_of(values: Mapping[str, Any]) -> float:
    """`far` of a view, float64; infinite where it is null or not there, and not otherwise: a
    number that came out infinite is an engine's fault. Raises InputError."""
    if values.get("far") is None:
        return math.inf
    far = number(values["far"], "far")
    if not math.isfinite(far):
        raise InputError(f"far is {far}", place="far", fix="write null for infinitely far")
    return far


def _numbers(value: Any, count: int, place: str) -> Float64:
    if not isinstance(value, list) or len(value) != count:
        raise InputError(f"not {count} numbers", place=place, fix=f"give a list of {count}")
    return np.array([number(entry, f"{place}[{i}]") for i, entry in enumerate(value)])


def _vector(values: Mapping[str, Any], name: str, count: int = 3) -> Float64:
    if name not in values:
        raise InputError(f"{name} is missing", fix=f"give {count} numbers")
    vector = _numbers(values[name], count, name)
    if not np.isfinite(vector).all():
        raise InputError(f"{name} is not finite", place=name, fix="give finite numbers")
    return vector


def _word(values: Mapping[str, Any], name: str, known: tuple[str, ...]) -> str | None:
    if name not in values:
        return None
    value = values[name]
    if not isinstance(value, str) or value not in known:
        listed = ", ".join(f'"{word}"' for word in known)
        raise InputError(
            f"{reprlib.repr(value)} is no {name}", place=name, fix=f"write one of {listed}"
        )
    return value


def _rigid(given: Float64, what: str) -> GivenCamera:
    """The matrix as it is, but made orthonormal where it is nearly so; what is not even that, the
    camera refuses."""
    linear = given[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        off = float(np.abs(linear.T @ linear - np.eye(3)).max())
    if not ORTHONORMAL_TOLERANCE < off <= RIGID_TOLERANCE:
        return GivenCamera(given)
    result = given.copy()
    result[:3, :3] = _nearest_rotation(linear)
    return GivenCamera(result, off=off, made=f"{what} was made orthonormal")


def _nearest_rotation(linear: Float64) -> Float64:
    """The orthogonal factor of the polar decomposition of a (3, 3) matrix, float64."""
    left, _, right = np.linalg.svd(linear)
    result: Float64 = left @ right
    return result


def _inverted(given: Float64) -> GivenCamera:
    """`world_from_camera` of a `camera_from_world`: the rotation is transposed, as `Camera` does
    it, and the eye is the point that the matrix, as it was given, takes to zero."""
    place = "camera_from_world"
    if not np.isfinite(given).all():
        raise InputError("the matrix is not finite", place=place, fix="give finite numbers")
    if not np.array_equal(given[3], (0.0, 0.0, 0.0, 1.0)):
        raise InputError(
            "the matrix's last row is not 0 0 0 1",
            place=place,
            fix="write row-major rows, translation in the last column, or say column_major",
        )
    result = np.eye(4)
    result[:3, :3] = given[:3, :3].T
    one = _rigid(result, place)
    result = one.world_from_camera.copy()
    if abs(np.linalg.det(given[:3, :3])) > ORTHONORMAL_TOLERANCE:  # else the camera refuses it
        result[:3, 3] = np.linalg.solve(given[:3, :3], -given[:3, 3])
    return GivenCamera(result, off=one.off, made=one.made)


def _from_target(values: Mapping[str, Any]) -> GivenCamera:
    eye, target = _vector(values, "eye"), _vector(values, "target")
    up = _vector(values, "up") if "up" in values else np.array((0.0, 1.0, 0.0))
    if np.array_equal(eye, target):
        raise InputError("the camera looks at its own eye", place="target", fix="move one of them")
    with np.errstate(over="ignore", invalid="ignore"):
        back = (eye - target) / np.linalg.norm(eye - target)
        # Below this sine, that of `look_at`, the roll about the view is rounding and no answer.
        sine = float(np.linalg.norm(np.cross(up / (np.linalg.norm(up) or 1.0), back)))
    if not sine >= 1e-9:
        raise InputError(
            "the camera looks along its up direction" if up.any() else "up is zero",
            place="up",
            fix="give an up that points to the side of the view",
        )
    return GivenCamera(look_at(eye, target, (float(up[0]), float(up[1]), float(up[2]))))


def _from_quaternion(values: Mapping[str, Any]) -> GivenCamera:
    position, rotation = _vector(values, "position"), _vector(values, "rotation", 4)
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(rotation))
    # The matrix of a quaternion grows with its length's square.
    off = abs(length * length - 1.0)
    if not off <= RIGID_TOLERANCE:
        raise InputError(
            f"the quaternion's length is {length:.6g}",
            place="rotation",
            fix="give a unit quaternion x, y, z, w",
        )
    result = np.eye(4)
    result[:3, :3] = rotation_matrix(rotation)
    result[:3, 3] = position
    if off <= ORTHONORMAL_TOLERANCE:
        return GivenCamera(result)
    return GivenCamera(result, off=off, made="rotation was made a unit quaternion")


def rotation_matrix(quaternion: Float64) -> Float64:
    """(3, 3) float64, the rotation of a quaternion x, y, z, w of any length but zero."""
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _from_clip(values: Mapping[str, Any], width: int, height: int) -> GivenCamera:
    place = "clip_from_world"
    given = matrix(values[place], place)
    depth = _word(values, "clip_depth", tuple(CLIP_DEPTHS))
    if _word(values, "clip_y", CLIP_YS) == "down":
        given[1] = -given[1]
    for name in LENS_FIELDS:
        if values.get(name) is not None:
            raise InputError(
                f"{name} is given, and clip_from_world says it too", place=name, fix="leave one out"
            )
    near = number(values["near"], "near") if "near" in values else None
    far = far_of(values) if "far" in values else None
    try:
        pose, lens, off = decomposed(given, width, height, near, far, depth)
    except InputError as error:
        fix = error.fix
        with suppress(InputError):
            decomposed(given.T, width, height, near, far, depth)
            fix = "transposed it is a camera: say row_major for column_major, or the reverse"
        raise InputError(error.problem, place=place, fix=fix) from error
    made = f"{place} was made a rotation and square pixels" if off > ORTHONORMAL_TOLERANCE else ""
    return GivenCamera(pose, lens, off if made else 0.0, made)
