"""Trees in the wind: a trunk and a crown of leaf cards, bent by two morph targets."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from visref.scene import Alpha
from visref_datasets_gen.animated import AnimatedNode, MorphPrimitive, Track, at_place
from visref_datasets_gen.graph import AlphaTexture, Material, Mesh
from visref_datasets_gen.leaf_cards import leaf_picture
from visref_datasets_gen.shapes import Float64, Soup, lathe, quads, snap

# How far a weight of 1 takes the top, metres.
BEND_M = 1.0
HEIGHT_M = 5.0
CARDS = 18
_BARK, _LEAF = (0.25, 0.17, 0.10, 1.0), (0.16, 0.30, 0.08, 1.0)


def tree_mesh(rng: np.random.Generator) -> Mesh:
    """A tree whose first morph target bends it along x, the second along z."""
    texture = AlphaTexture(leaf_picture(rng))
    trunk = lathe([(0.2, 0.0), (0.14, 1.2), (0.11, 2.4), (0.05, HEIGHT_M)], 7, caps="1")
    cards = quads(_cards(rng))
    uv = np.tile(np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32), (CARDS, 1))
    leaf = Material("leaf-card", _LEAF, alpha=Alpha.MASK, texture=texture)
    return Mesh(
        "tree",
        (
            _bending(trunk, Material("bark", _BARK)),
            _bending(cards, leaf, uv),
        ),
    )


def _bending(
    soup: Soup, material: Material, uv: NDArray[np.float32] | None = None
) -> MorphPrimitive:
    vertices, faces = soup
    points = snap(vertices).astype(np.float32)
    bent = BEND_M * (np.maximum(points[:, 1], 0.0) / HEIGHT_M) ** 2
    targets = []
    for axis in (0, 2):
        target = np.zeros_like(points)
        target[:, axis] = snap(bent)
        targets.append(target)
    return MorphPrimitive(points, faces.astype(np.uint32), material, uv, targets=tuple(targets))


def _cards(rng: np.random.Generator) -> Float64:
    """(n, 4, 3) upright squares that face all ways, about the upper trunk."""
    corners = np.empty((CARDS, 4, 3))
    for k in range(CARDS):
        yaw = math.pi * (k + rng.uniform(0.0, 0.6)) / CARDS
        across = np.array([math.cos(yaw), 0.0, math.sin(yaw)])
        half = rng.uniform(0.9, 1.3)
        middle = np.array([rng.uniform(-0.7, 0.7), rng.uniform(3.2, 4.6), rng.uniform(-0.7, 0.7)])
        for corner, (i, j) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
            corners[k, corner] = middle + half * (i * across + [0.0, j, 0.0])
    return corners


def tree(
    rng: np.random.Generator, name: str, mesh: Mesh, at: tuple[float, ...], clip_s: float
) -> AnimatedNode:
    """A tree at a place, its weights swaying, each tree to a rhythm of its own."""
    times = np.arange(0.0, clip_s + 0.25, 0.5)
    turns = 2.0 * np.pi * (times[:, None] / rng.uniform(2.0, 4.0, 2) + rng.uniform(0.0, 1.0, 2))
    weights = 0.5 * np.sin(turns) + rng.uniform(-0.2, 0.2, 2)
    return AnimatedNode(name, mesh, at_place(snap(at)), tracks=(Track("weights", times, weights),))
