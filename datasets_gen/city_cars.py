"""An artificial city with racing cars in its streets: 1,900 shapes, 4,059,195 triangles.

The counterpart of "City", the largest model of Staneker, Bartz and Meissner ("Improving
Occlusion Query Efficiency with Occupancy Maps", 2003, section 5.2), "an artificial city with
some Formula One cars in the streets". How many cars it had is not said. This one has four of
`formula_one`, which leaves 676 shapes of 1,586 triangles on average for the rest:
a building is one shape, a street too, and trees make up the number of shapes.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref_datasets_gen.city import (
    BLOCK_M,
    PAVEMENT_HEIGHT_M,
    PAVEMENT_M,
    PITCH_M,
    STREET_M,
    VARIANTS,
    kind_of,
    lots,
)
from visref_datasets_gen.city_large import triangles_of
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.formula_one import SHAPES as SHAPES_A_CAR
from visref_datasets_gen.formula_one import car
from visref_datasets_gen.graph import Mesh, Node
from visref_datasets_gen.orbit import check_frames
from visref_datasets_gen.shapes import Float64, box, boxes, quarter_turn
from visref_datasets_gen.stock import Stock, placed, plain
from visref_datasets_gen.terrain import Height, patch
from visref_datasets_gen.walk import corners, walk

SHAPES = 1_900
TRIANGLES_AT_SCALE_1 = 4_059_195
CARS = 4
SIZE_PX = (1000, 900)

# A block of buildings has about so many; some plots are left over, for trees.
TRIANGLES_A_BLOCK = 16_500
# No tree has more.
TRIANGLES_A_TREE = 132
# From the walk's corners, along the way that it goes: beside the street before each, and
# behind it.
CAR_SPOTS_M = ((4.25, -15.0, 0), (-19.0, 4.25, 1))


def city_cars(*, seed: int = 0, scale: float = 1.0, frames: int = 60) -> Dataset:
    """1,900 shapes and 4,059,195 triangles at scale 1. At another the cars are tessellated
    more coarsely or finely, and the city around them is smaller or larger in proportion.

    The path (1000 by 900) walks round a corner, jumps (a cut) and walks round another, past
    the cars. Raises InputError for a scale that leaves no car or no block, or a path without
    frames.
    """
    check_frames(frames)
    parts = car(seed, scale).nodes()
    shapes = round((SHAPES - CARS * SHAPES_A_CAR) * scale)
    left = round(TRIANGLES_AT_SCALE_1 * scale) - CARS * sum(map(triangles_of, parts))
    plots = max(2, math.ceil(left / TRIANGLES_A_BLOCK))
    columns = math.ceil(math.sqrt(plots))
    rows = math.ceil(plots / columns)
    maker = _Maker(seed, columns, rows, shapes, left)
    maker.ground()
    maker.build()
    maker.plant()
    if not maker.built:
        raise InputError(f"the scale is {scale}", place="scale", fix="give a greater scale")
    path = walk(columns, rows, PITCH_M, STREET_M, frames)
    nodes = (*maker.nodes, *_cars(columns, rows, parts))
    width, height = SIZE_PX
    cameras = tuple(replace(camera, width=width, height=height) for camera in path)
    return Dataset("city_cars", nodes, CameraPath(cameras))


class _Maker:
    """The city, within a number of shapes and of triangles."""

    def __init__(self, seed: int, columns: int, rows: int, shapes: int, triangles: int) -> None:
        self.rng = np.random.Generator(np.random.PCG64([seed, *b"city_cars"]))
        self.stock = Stock(seed)
        self.columns, self.rows = columns, rows
        self.shapes, self.triangles = shapes, triangles
        self.nodes: list[Node] = []
        self.built = 0
        self.blocks: list[Float64] = []
        self.park = np.zeros(3)
        self._wholes: dict[str, Mesh] = {}

    def put(self, name: str, mesh: Mesh, at: tuple[float, float, float], turns: int = 0) -> None:
        node = placed(name, (mesh,), at, turns)
        self.nodes.append(node)
        self.shapes -= 1
        self.triangles -= triangles_of(node)

    def ground(self) -> None:
        """The land, and a street along every side of every plot."""
        wide, deep = self.columns * PITCH_M[0], self.rows * PITCH_M[1]
        land = box([-400.0, -0.06, -400.0], [wide + 400.0, -0.06, deep + 400.0], "Y")
        self.put("ground", plain("ground", {"earth": land})[0], (0.0, 0.0, 0.0))
        for axis, count, length in ((0, self.rows, wide), (1, self.columns, deep)):
            half = STREET_M / 2
            dashes = np.arange(8.0, length - 8.0, 6.0)
            low = np.stack([dashes, np.full_like(dashes, 0.012), np.full_like(dashes, -0.08)], 1)
            parts = {
                "asphalt": box([-STREET_M, 0.0, -half], [length, 0.0, half], "Y"),
                "marking": boxes(low, low + np.array([3.0, 0.0, 0.16]), "Y"),
            }
            street = self._whole(plain(f"street-{'xz'[axis]}", parts))
            for k in range(count + 1):
                # Where two cross, one lies a little lower.
                at = k * PITCH_M[1 - axis] - half
                place = (0.0, 0.0, at) if axis == 0 else (at, -0.004, 0.0)
                self.put(f"{street.name}-{k}", street, place, -axis)

    def build(self) -> None:
        """Blocks from the middle outward, until what is left is only enough for trees."""
        x, z = (np.arange(n) - (n - 1) / 2.0 for n in (self.columns, self.rows))
        away = np.hypot(*np.meshgrid(x * PITCH_M[0], z * PITCH_M[1]))
        slab = box([-36.0, 0.0, -28.0], [36.0, PAVEMENT_HEIGHT_M, 28.0], "xXYzZ")
        pavement = plain("pavement", {"pavement": slab})[0]
        order = np.argsort(away.ravel(), kind="stable").tolist()
        for number, plot in enumerate(order):
            i, j = plot % self.columns, plot // self.columns
            centre = np.array([i * PITCH_M[0], 0.0, j * PITCH_M[1]])
            centre += [BLOCK_M[0] / 2, 0.0, BLOCK_M[1] / 2]
            if number == len(order) - 1:
                self.park = centre
                return
            self.put(f"pavement-{i}-{j}", pavement, tuple(centre.tolist()))
            self.blocks.append(centre)
            self._block(f"{i}-{j}", centre, 1.0 - 0.6 * number / len(order))

    def _block(self, name: str, centre: Float64, downtown: float) -> None:
        """Two rows of buildings, back to back."""
        length = int(BLOCK_M[0] - 2 * PAVEMENT_M)
        front = BLOCK_M[1] / 2 - PAVEMENT_M
        for turns in (0, 2):
            x = -length / 2
            for number, width in enumerate(lots(self.rng, length)):
                kind = kind_of(self.rng, width, downtown)
                variant, tint = self.rng.integers(0, (VARIANTS, 60)).tolist()
                meshes, depth, _ = self.stock.building(kind, width, variant, tint)
                mesh = self._whole(meshes)
                size = sum(len(part.triangles) for part in mesh.primitives)
                spare = self.triangles - TRIANGLES_A_TREE * self.shapes
                if size > spare or self.shapes <= self.rows * self.columns - len(self.blocks):
                    return
                at = centre + quarter_turn(turns) @ [x + width / 2, 0.0, front - depth / 2]
                at[1] = PAVEMENT_HEIGHT_M
                self.put(f"{kind}-{name}-{turns // 2}{number}", mesh, tuple(at.tolist()), turns)
                self.built += 1
                x += width

    def _whole(self, meshes: tuple[Mesh, ...]) -> Mesh:
        """A mesh and what is an object of its own elsewhere, as one, made once."""
        name = meshes[0].name
        if name not in self._wholes:
            parts = tuple(part for mesh in meshes for part in mesh.primitives)
            self._wholes[name] = Mesh(name, parts)
        return self._wholes[name]

    def plant(self) -> None:
        """Trees along the kerbs for all shapes but one: a park with what triangles are left."""
        trees = [self.stock.prop(f"tree-{k}", k)[0] for k in range(4)]
        sides = [
            (s * (BLOCK_M[0] / 2 - 1.0), t) for s in (-1, 1) for t in np.arange(-24.0, 25.0, 6.0)
        ]
        sides += [
            (t, s * (BLOCK_M[1] / 2 - 1.0)) for s in (-1, 1) for t in np.arange(-30.0, 31.0, 6.0)
        ]
        spots = np.array([np.add(spot, (x, PAVEMENT_HEIGHT_M, z)) for spot in self.blocks
                          for x, z in sides])  # fmt: skip
        wanted = self.shapes - 1
        for k, spot in enumerate(spots[self.rng.permutation(len(spots))[:wanted]]):
            self.put(f"tree-{k:03d}", trees[k % 4], tuple(spot.tolist()), k % 3)
        x, _, z = self.park.tolist()
        low = (x - BLOCK_M[0] / 2, z - BLOCK_M[1] / 2)
        lawn = patch(low, (x + BLOCK_M[0] / 2, z + BLOCK_M[1] / 2), self.triangles, _hill(x, z))
        self.put("park", plain("park", {"lawn": lawn})[0], (0.0, 0.0, 0.0))


def _hill(x: float, z: float) -> Height:
    """A mound in the middle of a plot, flat at its rim."""

    def height(at_x: Float64, at_z: Float64) -> Float64:
        u, v = (at_x - x) / BLOCK_M[0], (at_z - z) / BLOCK_M[1]
        result: Float64 = 0.02 + 9.0 * np.cos(math.pi * u) ** 2 * np.cos(math.pi * v) ** 2
        return result

    return height


def _cars(columns: int, rows: int, parts: tuple[Node, ...]) -> list[Node]:
    """Two at each corner of the walk, out of its way."""
    nodes: list[Node] = []
    for corner, way in corners(columns, rows, PITCH_M, STREET_M):
        for x, z, turns in CAR_SPOTS_M:
            name = f"car{len(nodes)}"
            children = tuple(replace(part, name=f"{name}/{part.name}") for part in parts)
            matrix = np.eye(4)
            matrix[:3, :3] = quarter_turn(turns if way > 0 else turns + 2)
            matrix[:3, 3] = corner[0] + way * x, 0.0, corner[1] + way * z
            nodes.append(Node(name, None, matrix, children))
    return nodes
