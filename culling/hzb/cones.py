"""Backface cones: from where all triangles of a unit show their backs, which cover nothing.

A unit's cone holds the directions of all its normals. It has a centre c, an axis a, the cosine and
the sine of its half angle, and a reach h <= 0: no triangle's plane passes farther before c than -h.
For an eye in the distance and direction v from c, and each normal n and point p of its triangle,

    n . (p - eye) = n . v + n . (p - c) >= (a . v) cos - |a x v| sin + h,

and where that is positive all triangles are seen from behind. An orthographic camera sees all along
one direction v, and h does not matter. For flat units this is exact up to the rounding.

Normals are those of the world's triangles as they stand in a frame, so that whatever has moved,
turned, mirrored or stretched them is in the cone. Only one-sided opaque triangles have backs that
cover nothing for certain and are looked at here; a unit that holds another one, or one too thin for
its normal to be known, has no cone.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Alpha, Float64, Scene, Units

# Of a unit: centre (3), reach, axis (3), cosine, sine. A reach above zero says that there is none.
WORDS = 9
CENTRE, REACH, AXIS, COSINE, SINE = 0, 3, 4, 7, 8
NONE = 1.0

# A normal is the product of two edges over its length. Each edge is rounded once, each product of
# them has 3 roundings, a difference one: 4 of 2**-53 of two products a component, so under 14 times
# 2**-53 of |edge| |edge| in all. Making it one long doubles that at most; lengths, dot and cross
# products with the axis add under 20 of the result. Twice that.
ROUNDINGS = 100 * 2.0**-53
# Of the sine of the angle between two edges. Below it a normal may be off by a thousandth of a
# thousandth, and such triangles are rare.
THINNEST = 2.0**-24
# The mean of normals that have a cone of less than a right angle is mostly far longer.
LEAST_MEAN = 2.0**-10


def with_cone(scene: Scene) -> NDArray[np.bool_]:
    """(t,) bool: the triangles that can be in a unit with a cone."""
    result: NDArray[np.bool_] = scene.one_sided & (scene.alpha == Alpha.OPAQUE)
    return result


def cones_of(scene: Scene, units: Units) -> Float64:
    """(u, 9) float64: each unit's cone, rounded outward, as `WORDS` has it."""
    result = np.empty((units.count, WORDS))
    _cones(
        scene.vertices, scene.triangles, with_cone(scene), units.offsets, units.triangles, result
    )
    return result


@njit(makes_arrays=False)
def _normal(
    vertices: NDArray[Any], triangles: NDArray[Any], t: int
) -> tuple[float, float, float, float]:
    """A triangle's normal, of length 1, and the sine of the angle at its first corner; zeros for
    one without area."""
    a, b, c = triangles[t]
    px, py, pz = float(vertices[a, 0]), float(vertices[a, 1]), float(vertices[a, 2])
    ux, uy, uz = vertices[b, 0] - px, vertices[b, 1] - py, vertices[b, 2] - pz
    vx, vy, vz = vertices[c, 0] - px, vertices[c, 1] - py, vertices[c, 2] - pz
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(x * x + y * y + z * z)
    edges = math.sqrt((ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz))
    if not length > 0.0 or not edges > 0.0:
        return 0.0, 0.0, 0.0, 0.0
    return x / length, y / length, z / length, length / edges


@njit(makes_arrays=False)
def _cones(
    vertices: NDArray[Any],
    triangles: NDArray[Any],
    allowed: NDArray[Any],
    offsets: NDArray[Any],
    members: NDArray[Any],
    result: NDArray[Any],
) -> None:
    for unit in range(len(offsets) - 1):
        cone = result[unit]
        cone[:] = 0.0
        cone[REACH] = NONE
        first, end = offsets[unit], offsets[unit + 1]
        corners = 3 * (end - first)
        thinnest = 1.0
        for k in range(first, end):
            t = members[k]
            x, y, z, sine = _normal(vertices, triangles, t)
            thinnest = min(thinnest, sine if allowed[t] else 0.0)
            cone[AXIS] += x
            cone[AXIS + 1] += y
            cone[AXIS + 2] += z
            for axis in range(3):
                for corner in range(3):
                    cone[CENTRE + axis] += vertices[triangles[t, corner], axis] / corners
        length = math.sqrt(cone[AXIS] ** 2 + cone[AXIS + 1] ** 2 + cone[AXIS + 2] ** 2)
        if thinnest < THINNEST or length < LEAST_MEAN * (end - first) or end == first:
            continue
        for axis in range(3):
            cone[AXIS + axis] /= length
        ax, ay, az = cone[AXIS], cone[AXIS + 1], cone[AXIS + 2]
        error = ROUNDINGS / thinnest
        least, widest, reach = 1.0, 0.0, 0.0
        for k in range(first, end):
            t = members[k]
            x, y, z, _ = _normal(vertices, triangles, t)
            least = min(least, ax * x + ay * y + az * z)
            cx, cy, cz = ay * z - az * y, az * x - ax * z, ax * y - ay * x
            widest = max(widest, math.sqrt(cx * cx + cy * cy + cz * cz))
            corner = triangles[t, 0]
            px = vertices[corner, 0] - cone[CENTRE]
            py = vertices[corner, 1] - cone[CENTRE + 1]
            pz = vertices[corner, 2] - cone[CENTRE + 2]
            away = math.sqrt(px * px + py * py + pz * pz)
            reach = min(reach, x * px + y * py + z * pz - error * away)
        # Outward: the less the cosine and the reach, and the greater the sine, the more is drawn.
        if least > error:
            cone[COSINE], cone[SINE], cone[REACH] = least - error, widest + error, reach
