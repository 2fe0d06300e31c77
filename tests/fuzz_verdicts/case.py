"""A small case in plain numbers: objects, materials, cameras, units and what is drawn of them.

Everything is a small whole number over a power of two, so that it is the same in a file, in
float32 and in fractions, far out too.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction as Q
from functools import cached_property
from typing import Any

REPEAT, MIRROR, CLAMP = 10497, 33648, 33071
Matrix = list[list[float]]


@dataclass(frozen=True)
class Mask:
    """`texels`: rows of bytes, one of 255 where there is no texture (not `textured`)."""

    texels: tuple[tuple[int, ...], ...]
    nearest: bool
    wrap: tuple[int, int]
    factor: float
    cutoff: float
    textured: bool = True

    @property
    def never(self) -> bool:
        """Whether it is a hole all over by its constants alone, or one alpha all over: a reader
        may leave such triangles out."""
        values = {t for row in self.texels for t in row}
        greatest = Q(values.pop(), 255) if len(values) == 1 else Q(1)
        return greatest * Q(self.factor) < Q(self.cutoff)


@dataclass(frozen=True)
class Triangle:
    """World corners, exact. `lookup`: (u, v, vertex alpha) by corner, of masked ones."""

    corners: tuple[tuple[Q, ...], ...]
    object: int
    one_sided: bool
    kind: str
    mask: Mask | None = None
    lookup: tuple[tuple[Q, ...], ...] = ()


@dataclass
class Part:
    """A primitive: positions and faces in object space, and its material."""

    positions: list[tuple[float, ...]]
    faces: list[tuple[int, ...]]
    kind: str = "opaque"
    double_sided: bool = True
    transmission: bool = False
    mask: Mask | None = None
    uv: list[tuple[float, float]] = field(default_factory=list)
    stretch: tuple[float, float, float, float] = (1.0, 1.0, 0.0, 0.0)
    vertex_alpha: list[float] = field(default_factory=list)


@dataclass
class Case:
    """`units` None: the objects. `drawn`: by frame, unit ids."""

    seed: int
    root: Matrix
    objects: list[tuple[str, Matrix, list[Part]]]
    frames: list[dict[str, Any]]
    cull_backfaces: bool
    promise: str
    units: list[list[int]] | None = None
    drawn: list[list[int]] = field(default_factory=list)

    @cached_property
    def triangles(self) -> list[Triangle]:
        """As they are in the world; those that are a hole all over are not there."""
        result = []
        for number, (_, matrix, parts) in enumerate(self.objects):
            world = multiply(self.root, matrix)
            flip = determinant(world) < 0
            for part in parts:
                if part.mask is not None and part.mask.never:
                    continue
                points = [place(world, p) for p in part.positions]
                su, sv, ou, ov = (Q(x) for x in part.stretch)
                alpha = part.vertex_alpha or [1.0] * len(points)
                uv = part.uv or [(0.0, 0.0)] * len(points)
                looked = [
                    (Q(u) * su + ou, Q(v) * sv + ov, Q(w))
                    for (u, v), w in zip(uv, alpha, strict=True)
                ]
                for face in part.faces:
                    turned = face[::-1] if flip else face
                    result.append(
                        Triangle(
                            tuple(points[i] for i in turned),
                            number,
                            self.cull_backfaces and not part.double_sided,
                            part.kind,
                            part.mask,
                            tuple(looked[i] for i in turned),
                        )
                    )
        return result

    @property
    def kinds(self) -> set[str]:
        """What is uncommon about it, in words."""
        triangles, cameras = self.triangles, self.frames
        worlds = [multiply(self.root, matrix) for _, matrix, _ in self.objects]
        found = {
            "6,400 km out": max(abs(row[3]) for row in self.root[:3]) == 6.4e6,
            "150,000 km out": max(abs(row[3]) for row in self.root[:3]) == 1.5e8,
            "100 km out, as large": max(abs(row[3]) for row in self.root[:3]) == 1e5,
            "units of triangles": self.units is not None,
            "masks": any(t.kind == "mask" for t in triangles),
            "glass": any(t.kind == "blend" for t in triangles),
            "one-sided": any(t.one_sided for t in triangles),
            "mirrored": any(determinant(world) < 0 for world in worlds),
            "orthographic": any("ymag" in camera for camera in cameras),
            "lens shift": any(camera.get("shift_x_px") for camera in cameras),
            "far at a depth": any(camera["far"] for camera in cameras),
            f"promise {self.promise}": True,
        }
        return {kind for kind, here in found.items() if here}

    @cached_property
    def unit_lists(self) -> list[list[int]]:
        if self.units is not None:
            return self.units
        result: list[list[int]] = [[] for _ in self.objects]
        for index, triangle in enumerate(self.triangles):
            result[triangle.object].append(index)
        return result


def multiply(p: Matrix, q: Matrix) -> Matrix:
    """Exact: small numbers over powers of two."""
    return [[sum(p[i][k] * q[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def place(matrix: Matrix, point: tuple[float, ...]) -> tuple[Q, ...]:
    return tuple(
        sum((Q(m) * Q(x) for m, x in zip(row, (*point, 1.0), strict=True)), Q(0))
        for row in matrix[:3]
    )


def determinant(m: Matrix) -> float:
    a, b, c = (row[:3] for row in m[:3])
    return sum(a[i] * (b[i - 2] * c[i - 1] - b[i - 1] * c[i - 2]) for i in range(3))
