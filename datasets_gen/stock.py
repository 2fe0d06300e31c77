"""The city's stock of meshes: each made once, in several tints, and placed many times."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from visref_datasets_gen import street
from visref_datasets_gen.buildings import KINDS
from visref_datasets_gen.graph import Material, Mesh, Node, Primitive
from visref_datasets_gen.shapes import Soup, quarter_turn, snap

Colour = tuple[float, float, float]
_COLOURS: dict[str, Colour] = {
    "base": (0.30, 0.28, 0.27),
    "glass": (0.10, 0.16, 0.22),
    "trim": (0.72, 0.69, 0.63),
    "roof": (0.20, 0.18, 0.18),
    "brick": (0.36, 0.17, 0.12),
    "door": (0.13, 0.20, 0.17),
    "metal": (0.16, 0.17, 0.18),
    "rubber": (0.03, 0.03, 0.03),
    "light": (0.95, 0.91, 0.75),
    "brake": (0.62, 0.06, 0.05),
    "bark": (0.25, 0.17, 0.10),
    "skin": (0.55, 0.36, 0.26),
    "trousers": (0.10, 0.12, 0.20),
    "asphalt": (0.09, 0.09, 0.10),
    "marking": (0.80, 0.80, 0.76),
    "pavement": (0.42, 0.41, 0.39),
    "lawn": (0.16, 0.28, 0.09),
    "earth": (0.24, 0.23, 0.20),
}
_TINTS: dict[str, tuple[Colour, ...]] = {
    "wall": (
        (0.44, 0.20, 0.14),
        (0.55, 0.42, 0.29),
        (0.62, 0.58, 0.52),
        (0.35, 0.36, 0.39),
        (0.48, 0.30, 0.20),
    ),
    "awning": ((0.45, 0.08, 0.08), (0.08, 0.25, 0.16), (0.10, 0.18, 0.40)),
    "paint": (
        (0.60, 0.05, 0.05),
        (0.05, 0.12, 0.34),
        (0.72, 0.72, 0.72),
        (0.05, 0.05, 0.06),
        (0.80, 0.62, 0.08),
        (0.12, 0.30, 0.22),
    ),
    "leaf": ((0.13, 0.28, 0.07), (0.20, 0.32, 0.08), (0.09, 0.22, 0.08)),
    "cloth": ((0.50, 0.12, 0.10), (0.12, 0.22, 0.42), (0.62, 0.56, 0.42), (0.10, 0.10, 0.11)),
}

Part = tuple[NDArray[np.float32], NDArray[np.uint32]]

# Parts of buildings, cars and streets that are objects of their own.
_SEPARATE = {"glass": "glazing", "marking": "markings"}


def placed(
    name: str, meshes: tuple[Mesh, ...], at: tuple[float, float, float], turns: int = 0
) -> Node:
    """A node of the first mesh, with a child node for each further one."""
    matrix = np.eye(4)
    matrix[:3, :3] = quarter_turn(turns)
    matrix[:3, 3] = snap(at)
    children = tuple(Node(f"{name}/{mesh.name.split('/')[-1]}", mesh) for mesh in meshes[1:])
    return Node(name, meshes[0], matrix, children)


@dataclass
class Stock:
    """Meshes by name and tint, made when first asked for; tints share their geometry."""

    seed: int
    _shapes: dict[str, dict[str, Part]] = field(default_factory=dict)
    _roofs: dict[str, tuple[float, float, float] | None] = field(default_factory=dict)
    _meshes: dict[tuple[str, int], tuple[Mesh, ...]] = field(default_factory=dict)

    def _rng(self, name: str) -> np.random.Generator:
        # Seeded by name, so that a mesh is the same in a city of any size.
        return np.random.Generator(np.random.PCG64([self.seed, *name.encode()]))

    def building(
        self, kind: str, width: int, variant: int, tint: int
    ) -> tuple[tuple[Mesh, ...], float, tuple[float, float, float] | None]:
        """The meshes, the depth in metres, and the flat roof."""
        name = f"{kind}-{width}-{variant}"
        rng = self._rng(name)
        depth = float(rng.integers(14, 18)) if width < 30 else 26.0
        if name not in self._shapes:
            made = KINDS[kind](rng, width - 0.25, depth)
            self._roofs[name] = made.roof
            self._shapes[name] = _parts(made.soups())
        return self._tinted(name, tint, separate=True), depth, self._roofs[name]

    def prop(self, name: str, tint: int = 0) -> tuple[Mesh, ...]:
        """Meshes of `street`, by name there; `NAME-K` is the K-th of a kind."""
        kind = name.split("-")[0]
        if name not in self._shapes:
            if kind in street.CARS:
                made = street.car(kind)
            elif kind in street.VARIED:
                made = street.VARIED[kind](self._rng(name))
            else:
                made = street.PROPS[kind]()
            self._shapes[name] = _parts(made)
        return self._tinted(name, tint, separate=kind in street.CARS)

    def _tinted(self, name: str, tint: int, *, separate: bool) -> tuple[Mesh, ...]:
        shape = self._shapes[name]
        tints = max((len(_TINTS[material]) for material in shape if material in _TINTS), default=1)
        key = (name, tint % tints)
        if key not in self._meshes:
            self._meshes[key] = _meshes(f"{name}.{key[1]}", shape, key[1], separate=separate)
        return self._meshes[key]


def _parts(soups: dict[str, Soup]) -> dict[str, Part]:
    """The soups on the grid, in the file's types."""
    return {
        material: (snap(vertices).astype(np.float32), faces.astype(np.uint32))
        for material, (vertices, faces) in soups.items()
    }


def _meshes(
    name: str, shape: dict[str, Part], tint: int = 0, *, separate: bool = True
) -> tuple[Mesh, ...]:
    """A mesh of all parts but the separate ones, then a mesh for each of those."""
    made = {
        material: Primitive(vertices, faces, _material(material, tint))
        for material, (vertices, faces) in shape.items()
    }
    apart = [material for material in made if separate and material in _SEPARATE]
    body = tuple(primitive for material, primitive in made.items() if material not in apart)
    return (
        Mesh(name, body),
        *(Mesh(f"{name}/{_SEPARATE[material]}", (made[material],)) for material in apart),
    )


def _material(name: str, tint: int = 0) -> Material:
    if name in _TINTS:
        number = tint % len(_TINTS[name])
        colour, label = _TINTS[name][number], f"{name}-{number}"
    else:
        colour, label = _COLOURS[name], name
    # An awning is a sheet seen from both sides; everything else is a solid.
    return Material(label, (*colour, 1.0), double_sided=name == "awning")


def plain(name: str, parts: dict[str, Soup]) -> tuple[Mesh, ...]:
    return _meshes(name, _parts(parts))
