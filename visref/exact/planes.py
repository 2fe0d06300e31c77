"""Which triangles lie in the same plane: looked at once, and kept while they stand still."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.exact.rational import lowest_bit, plane_names
from visref.scene import Float32, Int32, Int64, Scene

UNKNOWN_PLANE = -1

Name = tuple[int, int, int, int, int] | None


class Planes:
    """The planes of a scene's triangles. `of_triangle`: (t,) int64, equal for two triangles if and
    only if they are in the same plane; `UNKNOWN_PLANE` for those not yet asked for."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._unit = lowest_bit(scene.vertices)
        self.of_triangle: Int64 = np.full(scene.triangle_count, UNKNOWN_PLANE, np.int64)
        self._moves = np.zeros(scene.triangle_count, np.bool_)
        if scene.moving is not None:
            self._moves = scene.moving[scene.object_of_triangle]
        # Planes in which something still lies, and those of this pose in which nothing does.
        self._still: dict[Name, int] = {}
        self._passing: dict[Name, int] = {}
        self._next = 0

    def pose(self, scene: Scene, movable: Int32, corners: Float32) -> None:
        """Forget the planes of what may move, triangle ids; `corners`, of any shape, are its new
        ones."""
        self._scene = scene
        self.of_triangle[movable] = UNKNOWN_PLANE
        self._passing.clear()
        unit = int(lowest_bit_of_single(corners.reshape(-1).view(np.uint32), self._unit))
        if unit < self._unit:
            # Names of different units do not compare.
            self._unit = unit
            self._still.clear()
            self.of_triangle[:] = UNKNOWN_PLANE

    def find(self, triangles: Int32) -> None:
        """Look up some triangles' planes."""
        unknown = np.zeros(len(self.of_triangle), np.bool_)
        unknown[triangles] = True
        fresh = np.flatnonzero(unknown & (self.of_triangle == UNKNOWN_PLANE))
        if not len(fresh):
            return
        names = plane_names(self._scene.vertices[self._scene.triangles[fresh]], self._unit)
        self.of_triangle[fresh] = [
            self._number(name, moves)
            for name, moves in zip(names, self._moves[fresh].tolist(), strict=True)
        ]

    def _number(self, name: Name, moves: bool) -> int:
        number = self._still.get(name, self._passing.get(name))
        if number is None:
            number, self._next = self._next, self._next + 1
        # A plane that outlasts the pose keeps its number.
        (self._passing if moves else self._still).setdefault(name, number)
        return number


@njit()
def lowest_bit_of_single(words: NDArray[Any], most: int) -> int:
    """`lowest_bit` of (n,) float32 values, given by their bits, or `most` if that is less."""
    for word in words:
        exponent = (word >> 23) & 0xFF
        whole = word & 0x7FFFFF
        # A value is whole * 2^(exponent - 150); subnormal ones have the least exponent too.
        whole, exponent = (whole, 1) if exponent == 0 else (whole | 0x800000, exponent)
        bit = exponent - 150
        # Only what has a lower bit than any before is looked at.
        while bit < most and whole != 0 and whole & 1 == 0:
            whole >>= 1
            bit += 1
        if whole != 0 and bit < most:
            most = bit
    return most
