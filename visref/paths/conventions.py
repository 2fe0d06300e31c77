"""Poses of other programs' cameras, in visref's: right-handed, +Y up, looking along -Z.

A convention says what the three axes of its world are, what a camera's own axes are, and what a
unit is; `docs/paths.md` has them in words. A rotation R and a position p there, which take
the camera's own axes to the world's, are here

    W R A,   u W p

where W takes their world to ours (a reflection where theirs is left-handed), the columns of A are
right, up and back in their camera's axes, and u is the metres of a unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visref.errors import InputError
from visref.scene import Float64
from visref.wording import did_you_mean

_Rows = tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]
_SAME: _Rows = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


@dataclass(frozen=True)
class Convention:
    """`world`: W, by rows; `axes`: right, up and back in the camera's own axes, the columns of A;
    `metres`: u."""

    world: _Rows
    axes: _Rows
    metres: float = 1.0

    def pose(self, rotation: Float64, position: Float64) -> Float64:
        """`world_from_camera` (4, 4) float64, of a rotation (3, 3) and a position (3,) that take
        the camera's own axes to the world's."""
        world = np.array(self.world, np.float64)
        result = np.eye(4)
        result[:3, :3] = world @ rotation @ np.array(self.axes, np.float64).T
        # Divided where a unit is a part of a metre, so that 250 cm are 2.5 m and no rounding.
        metres = self.metres
        result[:3, 3] = world @ (position / round(1 / metres) if metres < 1.0 else position)
        return result


CONVENTIONS = {
    # Camera: x right, y down, z forward. The world's axes are whatever they are.
    "opencv": Convention(_SAME, ((1, 0, 0), (0, -1, 0), (0, 0, -1))),
    # Camera: x right, y up, z back: visref's and glTF's own.
    "opengl": Convention(_SAME, _SAME),
    # Left-handed, y up, z forward; z changes its sign.
    "d3d": Convention(((1, 0, 0), (0, 1, 0), (0, 0, -1)), ((1, 0, 0), (0, 1, 0), (0, 0, -1))),
    # Left-handed, y up, z forward; x changes its sign, as glTF's importers there have it.
    "unity": Convention(((-1, 0, 0), (0, 1, 0), (0, 0, 1)), ((1, 0, 0), (0, 1, 0), (0, 0, -1))),
    # Left-handed, x forward, y right, z up, in centimetres; y and z change places.
    "unreal": Convention(
        ((1, 0, 0), (0, 0, 1), (0, 1, 0)), ((0, 1, 0), (0, 0, 1), (-1, 0, 0)), metres=0.01
    ),
    # World: z up; camera as OpenGL's.
    "blender": Convention(((1, 0, 0), (0, 0, 1), (0, -1, 0)), _SAME),
}


def find_convention(name: str) -> Convention:
    """The convention of that name. Raises InputError for another."""
    if name not in CONVENTIONS:
        raise InputError(f"--convention {name} is not known", fix=did_you_mean(name, CONVENTIONS))
    return CONVENTIONS[name]
