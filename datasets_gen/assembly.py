"""Assemblies of parts, as a CAD system exports them: an object a part, equal parts instanced,
tessellated to an exact number of triangles.

The number comes about as it would there. The chord tolerance is the same for all parts, the
coarsest that gives no more triangles than asked; what is still missing, a few in a hundred,
halves long edges of the parts that stand alone. Nothing but the tessellation changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from visref.errors import InputError
from visref_datasets_gen.graph import Material, Mesh, Node, Primitive
from visref_datasets_gen.refine import split_to, welded
from visref_datasets_gen.shapes import Float64, Soup

Colour = tuple[float, float, float]
Place = tuple[float, float, float]

# Rotations that take +y to the axis named, exactly.
_TURNS: dict[str, list[list[int]]] = {
    "+y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-y": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "+x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
    "-x": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "+z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "-z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
}

# Rounds enough to come within a few in a hundred of the number, each a tessellation; what is
# aimed at lies below it, as the number may not be passed.
_ROUNDS = 8
_AIM = 0.993
_CLOSE_ENOUGH = 0.985
_MOST_ADDED = 1.1
_FINENESS = (0.02, 8.0)


def facing(soup: Soup, axis: str) -> Soup:
    """The soup turned so that its +y is along an axis."""
    return soup[0] @ np.array(_TURNS[axis], np.float64).T, soup[1]


@dataclass
class Part:
    """One shape of an assembly and the places that show it."""

    soup: Soup
    colour: Colour
    places: list[tuple[str, Float64]] = field(default_factory=list)


@dataclass
class Assembly:
    """Parts under construction, at one fineness of tessellation.

    `grid_per_unit`: coordinates are multiples of its inverse, a power of two, so that placing
    a part rounds nothing.
    """

    fine: float
    grid_per_unit: float
    parts: list[Part] = field(default_factory=list)

    @property
    def shapes(self) -> int:
        return sum(len(part.places) for part in self.parts)

    @property
    def triangles(self) -> int:
        return sum(len(part.soup[1]) * len(part.places) for part in self.parts)

    def add(self, name: str, soup: Soup, colour: Colour) -> None:
        """A part that stands alone, where it was made."""
        self.put(name, soup, colour, [(0.0, 0.0, 0.0)])

    def add_pair(self, name: str, soup: Soup, colour: Colour) -> None:
        """A part and its mirror image in x, each a mesh of its own."""
        self.add(f"{name}-left", soup, colour)
        vertices, faces = soup
        self.add(f"{name}-right", (vertices * [-1.0, 1.0, 1.0], faces[:, ::-1]), colour)

    def put(
        self,
        name: str,
        soup: Soup,
        colour: Colour,
        places: Sequence[Place],
        axis: str | Sequence[str] = "+y",
    ) -> None:
        """A part at each of some places, its +y along an axis, the same or one for each."""
        part = Part(self._on_grid(soup), colour)
        axes = [axis] * len(places) if isinstance(axis, str) else axis
        for number, (place, towards) in enumerate(zip(places, axes, strict=True)):
            matrix = np.eye(4)
            matrix[:3, :3] = _TURNS[towards]
            matrix[:3, 3] = np.round(np.array(place) * self.grid_per_unit) / self.grid_per_unit
            part.places.append((f"{name}-{number:02d}" if len(places) > 1 else name, matrix))
        self.parts.append(part)

    def _on_grid(self, soup: Soup) -> Soup:
        """On the grid, and without the triangles that it leaves no area."""
        vertices, faces = welded((np.round(soup[0] * self.grid_per_unit), soup[1]))
        a, b, c = vertices[faces].transpose(1, 0, 2)
        flat = (np.cross(b - a, c - a) == 0.0).all(axis=1)
        return vertices / self.grid_per_unit, faces[~flat]

    def nodes(self) -> tuple[Node, ...]:
        made = []
        for part in self.parts:
            vertices, faces = part.soup
            material = Material("-".join(f"{c:.2f}" for c in part.colour), (*part.colour, 1.0),
                                double_sided=False)  # fmt: skip
            primitive = Primitive(vertices.astype(np.float32), faces.astype(np.uint32), material)
            mesh = Mesh(part.places[0][0], (primitive,))
            made += [Node(name, mesh, matrix) for name, matrix in part.places]
        return tuple(made)


def exactly(make: Callable[[float], Assembly], triangles: int) -> Assembly:
    """The assembly that `make` builds at a fineness, with exactly so many triangles.

    Raises InputError if even the coarsest has more, or the finest too few to reach it.
    """
    coarsest, finest = _FINENESS
    best = make(coarsest)
    low, high = (coarsest, best.triangles), (finest, 0)
    fine = 1.0
    for _ in range(_ROUNDS):
        if best.triangles >= _CLOSE_ENOUGH * triangles:
            break
        made = make(fine)
        if made.triangles <= triangles:
            best, low = made, (fine, made.triangles)
        else:
            high = (fine, made.triangles)
        # As a power of the fineness: measured where there is a bracket, else the square, as
        # where surfaces curve both ways.
        power = 2.0
        if high[1]:
            power = math.log(high[1] / low[1]) / math.log(high[0] / low[0])
        fine = low[0] * (_AIM * triangles / low[1]) ** (1.0 / power)
    if not best.triangles <= triangles <= _MOST_ADDED * best.triangles:
        raise InputError(
            f"{triangles} triangles are no tessellation of this assembly",
            place="scale",
            fix="give a scale nearer to 1",
        )
    _spread(best, triangles - best.triangles)
    return best


def _spread(assembly: Assembly, missing: int) -> None:
    """Halve edges of the parts that stand alone, each in proportion to its size.

    Closed surfaces gain triangles in pairs: an odd one goes to the first of these parts, which
    is an open sheet, and what rounding leaves to the largest.
    """
    sheet, *solids = (part for part in assembly.parts if len(part.places) == 1)
    size = sum(len(part.soup[1]) for part in solids)
    largest = max(solids, key=lambda part: len(part.soup[1]))
    gains = {id(part): 2 * (missing * len(part.soup[1]) // size // 2) for part in solids}
    gains[id(sheet)] = missing % 2
    gains[id(largest)] += missing - sum(gains.values())
    for part in (sheet, *solids):
        part.soup = split_to(part.soup, len(part.soup[1]) + gains[id(part)])
