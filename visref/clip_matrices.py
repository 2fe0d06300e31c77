"""A camera out of the matrix that an engine hands its shaders.

A clip matrix is M = s P V, with V = camera_from_world, any s > 0, and P of the form

        | p 0 c 0 |                                     | p 0 0 c |
        | 0 q d 0 |      perspective,                   | 0 q 0 d |      orthographic.
        | 0 0 A B |                                     | 0 0 A B |
        | 0 0-1 0 |                                     | 0 0 0 1 |

V's rows are right, up and back. The last row of a perspective M is therefore -back times s; what
the first two rows have along back gives the lens shifts c and d, and what is left of them p, q,
right and up. (In a left-handed view space, as Direct3D's, the signs of P and V differ and M is the
same.) Near and far are the depths that M takes to two known values, those of `CLIP_DEPTHS`. An
orthographic M does not know its eye: it is put in the middle of the image, `near` before the near
plane, or on that plane where near is not given.

All in float64. M is as exact as its numbers: float32 ones give the eye to some 1e-7 of its distance
from the origin, and far to a hundredth where far is 100,000 times near.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from visref.camera import ORTHONORMAL_TOLERANCE, Float64
from visref.errors import InputError

# With five digits after the point an entry is off by up to 5e-6 and two unit columns' product by up
# to 2 sqrt(3) times that, 1.7e-5; with four, ten times as much at worst, and mostly less than this.
# What is further off is scale or shear.
RIGID_TOLERANCE = 1e-4

# Normalised depth at near and at far, by what `clip_depth` says: OpenGL; Direct3D, Vulkan, Metal
# and WebGPU; the same reversed.
CLIP_DEPTHS = {"-1..1": (-1.0, 1.0), "0..1": (0.0, 1.0), "1..0": (1.0, 0.0)}


@np.errstate(over="ignore", invalid="ignore")
def decomposed(
    clip_from_world: Float64,
    width: int,
    height: int,
    near: float | None = None,
    far: float | None = None,
    depth: str | None = None,
) -> tuple[Float64, dict[str, float], float]:
    """`world_from_camera` (4, 4) float64; the lens by the names of a camera's fields (yfov or ymag,
    near, far, shift_x_px, shift_y_px); and by how much the rows were off from square pixels and a
    right angle. `clip_from_world`: (4, 4) float64, +y up in clip space. `near` and `far`, where
    they are given, stand as they are; what is not given is read by `depth`, one of `CLIP_DEPTHS`
    (None: near is given, and far is infinite unless it is).

    Raises InputError where the matrix is no such camera's.
    """
    if not np.isfinite(clip_from_world).all():
        raise InputError("the matrix is not finite", fix="give finite numbers")
    perspective = bool(clip_from_world[3, :3].any())
    scale = float(np.linalg.norm(clip_from_world[3, :3] if perspective else clip_from_world[3, 3]))
    if scale == 0.0 or not scale < math.inf:
        raise _singular()
    # A matrix of float32 numbers was rounded to them.
    with np.errstate(over="ignore"):
        single = np.array_equal(clip_from_world, clip_from_world.astype(np.float32))
    read = _perspective if perspective else _orthographic
    given = _Given(width, height, near, far, depth, 2.0**-24 if single else 2.0**-53)
    rows = clip_from_world / scale
    if not np.isfinite(rows).all():
        raise _singular()
    pose, lens, off = read(rows, given)
    if not lens["near"] < lens["far"] or (perspective and not lens["near"] > 0.0):
        raise InputError(
            f"near comes out as {lens['near']:.6g} and far as {lens['far']:.6g}",
            fix="say how the engine maps depth with clip_depth, or give near and far themselves",
        )
    return pose, lens, off


class _Given(NamedTuple):
    """What is known beside the matrix; `unit`: half an ulp of 1 of the numbers that it holds."""

    width: int
    height: int
    near: float | None
    far: float | None
    depth: str | None
    unit: float

    def ends(self) -> tuple[float, float]:
        """The depth's values at near and far."""
        if self.depth is None:
            raise InputError(
                "its near plane is not known",
                fix=f"give clip_depth, one of {', '.join(CLIP_DEPTHS)}",
            )
        return CLIP_DEPTHS[self.depth]


def _perspective(rows: Float64, given: _Given) -> tuple[Float64, dict[str, float], float]:
    back = -rows[3]
    shifts = rows[:2, :3] @ back[:3]
    lines, scales = _unit_rows(rows[:2] - shifts[:, None] * back)
    axes = np.stack([lines[0, :3], lines[1, :3], back[:3]])
    pose, off = _pose(axes, scales, given)
    pose[:3, 3] = np.linalg.solve(axes, -np.append(lines[:, 3], back[3]))
    # No shift, rounded: six entries, three products of p + |c| at most in all, and their sum.
    shifts[np.abs(shifts) <= 8.0 * given.unit * (scales + np.abs(shifts))] = 0.0
    near, far = given.near, given.far
    if near is None or (far is None and given.depth is not None):
        at_near, at_far = given.ends()
        slope = float(rows[2, :3] @ back[:3])
        _check_depth_row(rows[2, :3] - slope * back[:3], max(1.0, abs(slope)))
        # Depth t becomes offset / t - slope.
        offset = float(rows[2, 3] - slope * back[3])
        near = _quotient(offset, at_near + slope) if near is None else near
        if far is None:
            # Where nothing but rounding is left (two products' and their sum's), far is infinite.
            gap = at_far + slope
            far = math.inf if abs(gap) <= 8.0 * given.unit * abs(slope) else offset / gap
    lens = {
        "yfov": 2.0 * math.atan(1.0 / scales[1]),
        "near": near,
        "far": math.inf if far is None else far,
        "shift_x_px": float(shifts[0]) * given.width / 2,
        "shift_y_px": -float(shifts[1]) * given.height / 2,
    }
    return pose, lens, off


def _orthographic(rows: Float64, given: _Given) -> tuple[Float64, dict[str, float], float]:
    if rows[3, 3] < 0.0:
        raise InputError("the matrix's last number is negative", fix="give 0 0 0 1 as last row")
    lines, scales = _unit_rows(rows[:2])
    back = np.cross(lines[0, :3], lines[1, :3])
    back /= float(np.linalg.norm(back)) or 1.0
    axes = np.stack([lines[0, :3], lines[1, :3], back])
    pose, off = _pose(axes, scales, given)
    at_near, at_far = given.ends()
    # Depth t becomes t * rate more than at the eye.
    rate = -float(rows[2, :3] @ back)
    if rate == 0.0:
        raise _singular()
    _check_depth_row(rows[2, :3] + rate * back, abs(rate))
    if rate * (at_far - at_near) < 0.0:
        raise InputError(
            "the matrix is mirrored, or its depth runs the other way",
            fix="give a right-handed world, and how the engine maps depth with clip_depth",
        )
    near = 0.0 if given.near is None else given.near
    at_eye = at_near - rate * near
    along_back = (float(rows[2, 3]) - at_eye) / rate
    pose[:3, 3] = np.linalg.solve(axes, np.append(-lines[:, 3], along_back))
    far = near + (at_far - at_near) / rate if given.far is None else given.far
    return pose, {"ymag": 1.0 / float(scales[1]), "near": near, "far": far}, off


def _unit_rows(rows: Float64) -> tuple[Float64, Float64]:
    """Rows (2, 4), each over the length of its first three numbers, and those lengths."""
    scales: Float64 = np.linalg.norm(rows[:, :3], axis=1)
    if not scales.all() or not np.isfinite(scales).all():
        raise _singular()
    return rows / scales[:, None], scales


def _pose(axes: Float64, scales: Float64, given: _Given) -> tuple[Float64, float]:
    """A pose (4, 4) with the rotation nearest to right, up and back, which are rows of `axes`, its
    eye to come; and by how much they, and the pixels, were off."""
    skew = abs(float(axes[0] @ axes[1]))
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        aspect = float(scales[1] * given.height / (scales[0] * given.width))
    # What is nearly no volume at all has no handedness.
    if np.linalg.det(axes) < -ORTHONORMAL_TOLERANCE:
        raise InputError(
            "the matrix is mirrored",
            fix='give a right-handed world, and "clip_y": "down" where clip space is so',
        )
    if not skew <= RIGID_TOLERANCE:
        raise InputError(
            f"right and up are not at a right angle (cosine {skew:.3g})",
            fix="give projection times view, without scale and shear",
        )
    if not abs(aspect - 1.0) <= RIGID_TOLERANCE:
        raise InputError(
            f"a pixel is {aspect:.6g} times as wide as high in {given.width} x {given.height}",
            fix="give the width and height that the matrix is for",
        )
    left, _, right = np.linalg.svd(axes)
    pose = np.eye(4)
    pose[:3, :3] = (left @ right).T
    return pose, max(skew, abs(aspect - 1.0))


def _check_depth_row(rest: Float64, size: float) -> None:
    """Raise InputError where a depth row has more than rounding across the view."""
    off = float(np.linalg.norm(rest)) / size
    if not off <= RIGID_TOLERANCE:
        raise InputError(
            f"the near plane is tilted (by {off:.3g})",
            fix="give near and far, and the oblique plane as clip_plane",
        )


def _quotient(over: float, under: float) -> float:
    return over / under if under else math.inf


def _singular() -> InputError:
    return InputError("the matrix is singular", fix="give projection times view")
