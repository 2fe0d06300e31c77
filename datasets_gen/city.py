"""A city of any size, walked through at street level.

Blocks of buildings in a grid of streets, with cars, people, trees, lamps, street furniture and
roof plant. Everything repeats from a small stock of meshes, so a city of tens of millions of
triangles is stored as instances.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref_datasets_gen import street
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import Mesh, Node
from visref_datasets_gen.shapes import box, boxes, lathe, merge, quarter_turn
from visref_datasets_gen.stock import Stock, placed, plain
from visref_datasets_gen.walk import walk

BLOCKS_AT_SCALE_1 = 36
BLOCK_M = (72.0, 56.0)
STREET_M = 14.0
PAVEMENT_M = 4.0
PAVEMENT_HEIGHT_M = 0.15
PITCH_M = (BLOCK_M[0] + STREET_M, BLOCK_M[1] + STREET_M)
LOT_WIDTHS_M = (10, 12, 14, 16, 20, 24)
VARIANTS = 3


def city(*, seed: int = 0, scale: float = 1.0, frames: int = 60) -> Dataset:
    """About 768,000 triangles in 4,000 objects at scale 1, and in proportion to `scale`, down
    to a single block. The path (1280 by 960) walks round one corner, jumps (a cut) and walks
    round another. Raises InputError for a scale or a number of frames that makes no city."""
    if not 0.0 < scale <= 1000.0:
        raise InputError(
            f"the city's scale is {scale}", place="scale", fix="give more than 0, at most 1000"
        )
    count = max(1, round(BLOCKS_AT_SCALE_1 * scale))
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    maker = CityMaker(seed, columns, rows)
    blocks = [maker.block(index) for index in range(count)]
    nodes = (maker.ground(), *maker.streets(), *blocks)
    return Dataset("city", nodes, walk(columns, rows, PITCH_M, STREET_M, frames))


class CityMaker:
    """Lays out one city."""

    def __init__(self, seed: int, columns: int, rows: int) -> None:
        self.seed = seed
        self.columns = columns
        self.rows = rows
        self.stock = Stock(seed)

    # -- ground and streets -------------------------------------------------------------

    def ground(self) -> Node:
        """The land around, a little below the streets."""
        low = [-400.0, -0.06, -400.0]
        high = [self.columns * PITCH_M[0] + 400.0, -0.06, self.rows * PITCH_M[1] + 400.0]
        return placed("ground", plain("ground", {"earth": box(low, high, "Y")}), (0.0, 0.0, 0.0))

    def streets(self) -> list[Node]:
        """A node each for crossings, and for streets along x and along z."""
        half = STREET_M / 2
        nodes = []
        for j in range(self.rows + 1):
            for i in range(self.columns + 1):
                x, z = i * PITCH_M[0] - half, j * PITCH_M[1] - half
                nodes.append(placed(f"crossing-{i}-{j}", self._crossing, (x, 0.0, z)))
                for k, (turns, side) in enumerate(((0, (-1.0, -1.0)), (2, (1.0, 1.0)))):
                    at = (x + side[0] * (half + 0.7), PAVEMENT_HEIGHT_M, z + side[1] * (half + 0.7))
                    if self._is_block(i - (side[0] < 0), j - (side[1] < 0)):
                        mesh = self.stock.prop("traffic_light")
                        nodes.append(placed(f"signal-{i}-{j}-{k}", mesh, at, turns))
                if i < self.columns:
                    at = (x + PITCH_M[0] / 2, 0.0, z)
                    nodes.append(placed(f"street-x-{i}-{j}", self._along_x, at))
                if j < self.rows:
                    at = (x, 0.0, z + PITCH_M[1] / 2)
                    nodes.append(placed(f"street-z-{i}-{j}", self._along_z, at, 1))
        return nodes

    def _is_block(self, i: int, j: int) -> bool:
        return 0 <= i < self.columns and 0 <= j < self.rows

    @cached_property
    def _crossing(self) -> tuple[Mesh, ...]:
        half = STREET_M / 2
        return plain("crossing", {"asphalt": box([-half, 0, -half], [half, 0, half], "Y")})

    @cached_property
    def _along_x(self) -> tuple[Mesh, ...]:
        return _street_mesh("street-x", BLOCK_M[0])

    @cached_property
    def _along_z(self) -> tuple[Mesh, ...]:
        return _street_mesh("street-z", BLOCK_M[1])

    # -- blocks -------------------------------------------------------------------------

    def block(self, index: int) -> Node:
        """One block with all that stands on and around it."""
        i, j = index % self.columns, index // self.columns
        rng = np.random.Generator(np.random.PCG64([self.seed, index]))
        site = _Site(f"block{index:03d}", rng, self.stock)
        downtown = self._downtown(i, j)
        use = rng.random()
        if index and use < 0.08:
            site.park()
        elif index and use < 0.08 + 0.14 * downtown:
            site.plaza()
        else:
            site.buildings(downtown)
        site.pavement()
        site.kerbside()
        site.traffic()
        centre = (i * PITCH_M[0] + BLOCK_M[0] / 2, 0.0, j * PITCH_M[1] + BLOCK_M[1] / 2)
        matrix = np.eye(4)
        matrix[:3, 3] = centre
        return Node(site.name, None, matrix, tuple(site.nodes))

    def _downtown(self, i: int, j: int) -> float:
        """1 at the city's centre, 0 at its rim."""
        x = (i + 0.5) / self.columns * 2.0 - 1.0
        z = (j + 0.5) / self.rows * 2.0 - 1.0
        return max(0.0, 1.0 - math.hypot(x, z))


def _street_mesh(name: str, length: float) -> tuple[Mesh, ...]:
    """A street along x: asphalt, a dashed middle line, zebra crossings at both ends."""
    half, line = STREET_M / 2, 0.012
    dashes = np.arange(-length / 2 + 8.0, length / 2 - 8.0, 6.0)
    low = np.stack([dashes, np.full_like(dashes, line), np.full_like(dashes, -0.08)], axis=1)
    middle = boxes(low, np.add(low, (3.0, 0.0, 0.16)), "Y")
    stripes = np.arange(-half + 0.7, half - 0.7, 1.0)
    zebra = []
    for x in (-length / 2 + 1.2, length / 2 - 4.0):
        low = np.stack([np.full_like(stripes, x), np.full_like(stripes, line), stripes], axis=1)
        zebra.append(boxes(low, np.add(low, (2.8, 0.0, 0.5)), "Y"))
    stops = boxes(
        [[-length / 2 + 4.8, line, -half + 0.3], [length / 2 - 5.2, line, 0.2]],
        [[-length / 2 + 5.2, line, -0.2], [length / 2 - 4.8, line, half - 0.3]],
        "Y",
    )
    asphalt = box([-length / 2, 0.0, -half], [length / 2, 0.0, half], "Y")
    return plain(name, {"asphalt": asphalt, "marking": merge([middle, *zebra, stops])})


class _Site:
    """One block under construction, around its own centre."""

    def __init__(self, name: str, rng: np.random.Generator, stock: Stock) -> None:
        self.name = name
        self.rng = rng
        self.stock = stock
        self.nodes: list[Node] = []
        self._counts: dict[str, int] = {}

    def put(
        self, kind: str, meshes: tuple[Mesh, ...], at: tuple[float, float, float], turns: int = 0
    ) -> None:
        number = self._counts[kind] = self._counts.get(kind, -1) + 1
        self.nodes.append(placed(f"{self.name}/{kind}-{number}", meshes, at, turns))

    def _tint(self) -> int:
        # A common multiple of the tints' numbers, so that each is as likely as another.
        return int(self.rng.integers(60))

    def buildings(self, downtown: float) -> None:
        """Two rows of buildings back to back, a yard between them."""
        length = int(BLOCK_M[0] - 2 * PAVEMENT_M)
        front = BLOCK_M[1] / 2 - PAVEMENT_M
        for turns in (0, 2):
            x = -length / 2
            for width in lots(self.rng, length):
                kind = kind_of(self.rng, width, downtown)
                variant = int(self.rng.integers(VARIANTS))
                mesh, depth, roof = self.stock.building(kind, width, variant, self._tint())
                spot = quarter_turn(turns) @ [x + width / 2, 0.0, front - depth / 2]
                self.put(kind, mesh, (spot[0], PAVEMENT_HEIGHT_M, spot[2]), turns)
                if roof is not None:
                    self._roof_plant(spot, roof, turns)
                x += width
        for _ in range(4):
            at = (self.rng.uniform(-28, 28), PAVEMENT_HEIGHT_M + 0.02, self.rng.uniform(-4, 4))
            self._tree(at)
        yard = box([-31.0, 0.17, -5.5], [31.0, 0.17, 5.5], "Y")
        self.put("yard", plain("yard", {"lawn": yard}), (0.0, 0.0, 0.0))

    def _roof_plant(
        self, spot: NDArray[np.float64], roof: tuple[float, float, float], turns: int
    ) -> None:
        half_x, half_z, height = roof
        # A grid of places wide enough for the largest unit, some of them taken.
        columns, rows = int(2 * half_x // 4.0), int(2 * half_z // 4.5)
        for place in range(columns * rows):
            if self.rng.random() > 0.5:
                continue
            x = ((place % columns) + 0.5) * 2 * half_x / columns - half_x
            z = ((place // columns) + 0.5) * 2 * half_z / rows - half_z
            kinds = ("air_conditioner", "water_tank", "stair_head", "skylight")
            kind = str(self.rng.choice(kinds, p=(0.5, 0.15, 0.1, 0.25)))
            shift = quarter_turn(turns) @ [x, 0.0, z]
            at = (spot[0] + shift[0], PAVEMENT_HEIGHT_M + height, spot[2] + shift[2])
            self.put(kind, self.stock.prop(kind), at, turns)

    def plaza(self) -> None:
        """One large tower among trees."""
        mesh, _, _ = self.stock.building(
            "tower", 36, int(self.rng.integers(VARIANTS)), self._tint()
        )
        self.put("tower", mesh, (0.0, PAVEMENT_HEIGHT_M, 0.0), 2 * int(self.rng.integers(2)))
        for x in (-29.0, -23.5, 23.5, 29.0):
            for z in np.linspace(-20.0, 20.0, 6):
                self._tree((x, PAVEMENT_HEIGHT_M, float(z)))
        for x in (-26.0, 26.0):
            for z in (-12.0, 0.0, 12.0):
                bench = self.stock.prop("bench")
                self.put("bench", bench, (x, PAVEMENT_HEIGHT_M, z), 1 if x > 0 else 3)

    def park(self) -> None:
        """A lawn with a basin, paths and trees."""
        lawns = boxes(
            [[x, 0.17, z] for x in (-31.0, 3.0) for z in (-23.0, 3.0)],
            [[x + 28.0, 0.17, z + 20.0] for x in (-31.0, 3.0) for z in (-23.0, 3.0)],
            "Y",
        )
        self.put("lawn", plain("lawn", {"lawn": lawns}), (0.0, 0.0, 0.0))
        basin = lathe([(2.6, 0.0), (2.6, 0.5), (2.2, 0.5), (2.2, 0.3), (0.3, 0.3), (0.2, 1.6)], 16)
        water = lathe([(0.2, 1.6), (0.9, 1.5), (0.2, 1.7)], 12, caps="")
        fountain = plain("fountain", {"trim": basin, "metal": water})
        self.put("fountain", fountain, (0.0, PAVEMENT_HEIGHT_M, 0.0))
        for x in np.linspace(-28.0, 28.0, 9):
            for z in (-20.0, -13.0, -6.0, 6.0, 13.0, 20.0):
                if self.rng.random() < 0.7 and abs(x) > 3.5:
                    jitter = self.rng.uniform(-1.2, 1.2, 2)
                    self._tree((float(x + jitter[0]), 0.17, float(z + jitter[1])))
        for turns in range(4):
            spot = quarter_turn(turns) @ [0.0, PAVEMENT_HEIGHT_M, -5.0]
            self.put("bench", self.stock.prop("bench"), (spot[0], spot[1], spot[2]), turns)

    def _tree(self, at: tuple[float, float, float]) -> None:
        kind = "tree" if self.rng.random() < 0.8 else "conifer"
        mesh = self.stock.prop(f"{kind}-{int(self.rng.integers(4))}", self._tint())
        self.put(kind, mesh, at, int(self.rng.integers(4)))

    def pavement(self) -> None:
        x, z = BLOCK_M[0] / 2, BLOCK_M[1] / 2
        slab = box([-x, 0.0, -z], [x, PAVEMENT_HEIGHT_M, z], "xXYzZ")
        self.put("pavement", plain("pavement", {"pavement": slab}), (0.0, 0.0, 0.0))

    def kerbside(self) -> None:
        """Lamps, trees, furniture and people along the four sides."""
        for side in range(4):
            span, reach = BLOCK_M[side % 2], BLOCK_M[1 - side % 2] / 2
            for k, t in enumerate(np.arange(-span / 2 + 6.0, span / 2 - 5.0, 7.5).tolist()):
                if k % 4 == 1:
                    self._at_side(side, "lamp", t, reach - 0.6, side)
                elif self.rng.random() < 0.55:
                    x, _, z = quarter_turn(side) @ [t, 0.0, reach - 1.0]
                    self._tree((float(x), PAVEMENT_HEIGHT_M, float(z)))
                elif self.rng.random() < 0.75:
                    kind = str(self.rng.choice(("hydrant", "bin", "bench", "shelter")))
                    self._at_side(side, kind, t, reach - 0.9, side)
            for _ in range(2):
                t = self.rng.uniform(-span / 2 + 2.0, span / 2 - 2.0)
                out = reach - self.rng.uniform(1.9, 2.6)
                kind = f"person-{int(self.rng.integers(6))}"
                turns = side + int(self.rng.choice((1, 3)))
                self._at_side(side, kind, t, out, turns, self._tint())

    def _at_side(
        self, side: int, kind: str, along: float, out: float, turns: int, tint: int = 0
    ) -> None:
        x, _, z = quarter_turn(side) @ [along, 0.0, out]
        at = (float(x), PAVEMENT_HEIGHT_M, float(z))
        self.put(kind.split("-")[0], self.stock.prop(kind, tint), at, turns)

    def traffic(self) -> None:
        """Cars parked at the four kerbs, and a few on the lane beside them."""
        for side in range(4):
            span, reach = BLOCK_M[side % 2], BLOCK_M[1 - side % 2] / 2
            for t in np.arange(-span / 2 + 10.0, span / 2 - 9.0, 6.25).tolist():
                for out, share in ((1.15, 0.36), (4.3, 0.08)):
                    if self.rng.random() >= share:
                        continue
                    kind = str(self.rng.choice(street.CARS, p=(0.45, 0.4, 0.15)))
                    jitter = self.rng.uniform(-0.12, 0.12, 2)
                    along, across = t + 4 * jitter[0], reach + out + jitter[1]
                    x, _, z = quarter_turn(side) @ [along, 0.0, across]
                    # Traffic keeps right: the kerb is on the car's right hand.
                    mesh = self.stock.prop(kind, self._tint())
                    self.put("car", mesh, (float(x), 0.0, float(z)), side + 3)


def kind_of(rng: np.random.Generator, width: int, downtown: float) -> str:
    """The kind of building for a lot, `downtown` 1 in the middle of a city and 0 at its rim."""
    weights = {"walkup": 0.45}
    if width <= 14:
        weights["house"] = 0.5 * (1.0 - downtown) ** 2
    if width >= 14:
        weights["office"] = 0.25 + 0.5 * downtown
    if width >= 20:
        weights["tower"] = 0.1 + 1.2 * downtown
    share = np.array(list(weights.values()))
    return str(rng.choice(list(weights), p=share / share.sum()))


def lots(rng: np.random.Generator, length: int) -> list[int]:
    """Lot widths that add up to `length`."""
    while True:
        widths: list[int] = []
        while sum(widths) < length:
            widths.append(int(rng.choice(LOT_WIDTHS_M)))
        if sum(widths) == length:
            return widths
