"""A house of two rooms for walks: floor, ceiling, walls with a door, and things in the rooms. All
numbers are eighths, so that it may stand far out without rounding."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.support.gltf_files import Gltf
from visref.scene import Scene

# The corners of a box and its twelve triangles, counter-clockwise from outside.
_CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
_FACES = np.array(
    [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5),
        (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6),
        (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]
)  # fmt: skip


def box(low, high):
    """(vertices, triangles) of a closed box."""
    low, high = np.array(low, np.float64), np.array(high, np.float64)
    return low + _CORNERS * (high - low), _FACES


BOXES = {
    "floor": ((0, -0.25, 0), (8, 0, 6)),
    "ceiling": ((0, 3, 0), (8, 3.25, 6)),
    "west": ((-0.25, 0, 0), (0, 3, 6)),
    "east": ((8, 0, 0), (8.25, 3, 6)),
    "north": ((0, 0, -0.25), (8, 3, 0)),
    "south": ((0, 0, 6), (8, 3, 6.25)),
    "wall by the door": ((4, 0, 0), (4.25, 3, 2.375)),
    "wall beyond the door": ((4, 0, 3.375), (4.25, 3, 6)),
    "table": ((1, 0, 1), (2.5, 0.75, 2)),
    "cupboard": ((0.125, 0, 4), (0.75, 2.25, 5.75)),
    "pillar": ((6, 0, 2.5), (6.5, 3, 3)),
    "shelf": ((7, 0, 0.25), (7.875, 1.5, 1.25)),
}


def house(at=(0.0, 0.0, 0.0)) -> Scene:
    """The house, its south-west corner at a point."""
    return Scene.from_objects(
        [(name, *box(np.add(low, at), np.add(high, at))) for name, (low, high) in BOXES.items()]
    )


def write_house(folder: Path) -> str:
    """The house as a file, with a camera in a corner of it."""
    gltf = Gltf()
    for name, (low, high) in BOXES.items():
        vertices, triangles = box(low, high)
        faces = triangles.reshape(-1).astype("u2")
        gltf.node(name=name, mesh=gltf.mesh(gltf.primitive(vertices.astype("f4"), faces)))
    lens = {"type": "perspective", "perspective": {"yfov": 0.9, "znear": 0.05}}
    # Half a turn about +Y: it looks along +Z.
    gltf.node(camera=gltf.entry("cameras", **lens), translation=[3, 1, 0.5], rotation=[0, 1, 0, 0])
    return str(gltf.write(folder / "house.glb"))
