"""The scene graph in memory: materials, primitives, meshes and nodes, as glTF has them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.scene import Alpha


@dataclass(frozen=True, eq=False)
class AlphaTexture:
    """`alpha`: (height, width) uint8, row 0 at v = 0, not the same throughout; filtered,
    and clamped at its edges."""

    alpha: NDArray[np.uint8]


@dataclass(frozen=True)
class Material:
    """`colour`: linear RGBA in 0…1. `texture`: what multiplies its alpha, in a material whose
    alpha is MASK, with glTF's default cutoff. Equal materials are stored once."""

    name: str
    colour: tuple[float, float, float, float]
    double_sided: bool = True
    alpha: Alpha = Alpha.OPAQUE
    texture: AlphaTexture | None = None


@dataclass(frozen=True, eq=False)
class Primitive:
    """`vertices`: (v, 3) float32 in the mesh's space; `triangles`: (t, 3) vertex ids; `uv`:
    (v, 2) float32, texture coordinates where the material has a texture.

    Primitives that share these very arrays (the same geometry in another material) share
    them in the file too.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[Any]
    material: Material
    uv: NDArray[np.float32] | None = None


@dataclass(frozen=True, eq=False)
class Mesh:
    """Primitives that make one object for each node that shows them."""

    name: str
    primitives: tuple[Primitive, ...]


@dataclass(frozen=True, eq=False)
class Node:
    """A place in the scene graph; with a mesh it is an object.

    `parent_from_node`: (4, 4) float64, affine.
    """

    name: str
    mesh: Mesh | None = None
    parent_from_node: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    children: tuple[Node, ...] = ()
