"""Houses that can be looked into: a furnished room behind a door, and a lift in its tower."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np

from visref_datasets_gen import furniture
from visref_datasets_gen.animated import AnimatedNode, Track, at_place
from visref_datasets_gen.furniture import placed
from visref_datasets_gen.graph import Mesh, Node
from visref_datasets_gen.shapes import Float64, box, boxes, merge

WIDTH_M, DEPTH_M, CEILING_M, WALL_M = 11.0, 8.0, 2.8, 0.25
DOOR_M = (1.0, 2.1)
# Left of the door, so that the room is seen from the street with the door closed too.
WINDOW_M = (1.5, 3.0, 0.9, 2.1)
OPEN_RAD = 1.75
OPENING_S = 0.8

STOREY_M, STOREYS = 3.25, 3
SHAFT_M = 2.5
SLIDING_S = 0.5


def turned_by(angles_rad: Iterable[float]) -> Float64:
    """(k, 4) float64, unit quaternions x, y, z, w of turns about y."""
    return np.array([[0.0, math.sin(a / 2.0), 0.0, math.cos(a / 2.0)] for a in angles_rad])


class HouseMaker:
    """Makes houses of one shell, furnished from one stock."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        parts = {
            "desk": furniture.desk(),
            "chair": furniture.office_chair(),
            "visitor": furniture.visitor_chair(),
            "shelf": furniture.bookshelf(rng),
            "plant": furniture.plant(rng, 40),
            "lamp": furniture.floor_lamp(),
            "cabinet": furniture.cabinet(),
            "computer": furniture.computer(),
        }
        self.stock = {name: furniture.mesh(name, made) for name, made in parts.items()}
        self.door = furniture.mesh("door", {"wood": box([0, 0, -0.06], [DOOR_M[0], DOOR_M[1], 0])})

    def house(self, name: str, opens_s: tuple[float, float]) -> tuple[Node, ...]:
        """A house whose front, with the door, lies at z = 0 and looks along +z. The door opens
        inward at the first time and closes at the second."""
        height = float(self.rng.integers(12, 24)) / 2.0
        start, end = opens_s
        swing = Track(
            "rotation",
            np.array([start, start + OPENING_S, end, end + OPENING_S]),
            turned_by([0.0, OPEN_RAD, OPEN_RAD, 0.0]),
        )
        hinge = at_place((-DOOR_M[0] / 2, 0.0, -0.1))
        leaf = AnimatedNode(f"{name}/door", self.door, hinge, tracks=(swing,))
        return (
            Node(f"{name}/walls", _shell(height)),
            leaf,
            *self._furnished(name),
        )

    def _furnished(self, name: str) -> list[Node]:
        """Along the walls, the middle left free for who walks in."""
        spots = [(-4.0, -1.6, 1), (-4.0, -4.0, 1), (-4.0, -6.4, 1), (3.9, -2.2, 3), (3.9, -4.6, 3),
                 (2.2, -7.2, 0), (-2.2, -7.2, 0)]  # fmt: skip
        kinds = ["desk", *self.rng.permutation(["chair", "visitor", "shelf", "plant", "lamp",
                                                 "cabinet"])]  # fmt: skip
        nodes = []
        for kind, (x, z, turns) in zip(kinds, spots, strict=True):
            top = kind == "desk"
            children = (Node(f"{name}/computer", self.stock["computer"]),) if top else ()
            nodes.append(
                placed(f"{name}/{kind}", self.stock[str(kind)], (x, 0.02, z), turns, children)
            )
        return nodes


def _shell(height: float) -> Mesh:
    x, z, d, w = WIDTH_M / 2, DEPTH_M, DOOR_M[0] / 2, WALL_M
    left, right, low, high = WINDOW_M
    walls = [
        # Round the room: two sides and the back.
        ([-x, 0, -z], [-x + w, CEILING_M, 0]),
        ([x - w, 0, -z], [x, CEILING_M, 0]),
        ([-x + w, 0, -z], [x - w, CEILING_M, -z + w]),
        # The front: beside the door, above it, and round the window.
        ([-x + w, 0, -w], [-d, CEILING_M, 0]),
        ([-d, DOOR_M[1], -w], [d, CEILING_M, 0]),
        ([d, 0, -w], [left, CEILING_M, 0]),
        ([left, 0, -w], [right, low, 0]),
        ([left, high, -w], [right, CEILING_M, 0]),
        ([right, 0, -w], [x - w, CEILING_M, 0]),
        # The storeys above are closed.
        ([-x, CEILING_M, -z], [x, height, 0]),
    ]
    low_corners, high_corners = zip(*walls, strict=True)
    return furniture.mesh(
        f"house-{height:g}",
        {
            "wall": boxes(low_corners, high_corners),
            "floor": box([-x + w, 0.0, -z + w], [x - w, 0.02, -w], "Y"),
            "clay": box([-x - 0.2, height, -z - 0.2], [x + 0.2, height + 0.3, 0.2]),
        },
    )


def lift(name: str, stops: tuple[tuple[float, int], ...], riders: tuple[Node, ...]) -> Node:
    """A tower with a lift, its front at z = 0. `stops`: at a time in seconds the cabin stands at a
    storey, from 0; between two it goes there. `riders` stand in it."""
    half, top = SHAFT_M / 2, STOREYS * STOREY_M
    walls = [([-half, 0, -SHAFT_M], [-half + 0.2, top, 0]), ([half - 0.2, 0, -SHAFT_M],
             [half, top, 0]), ([-half, 0, -SHAFT_M], [half, top, -SHAFT_M + 0.2])]  # fmt: skip
    for storey in range(STOREYS):
        floor = storey * STOREY_M
        walls += [
            ([-half, floor + 2.2, -0.2], [half, floor + STOREY_M, 0]),
            ([-half, floor, -0.2], [-0.7, floor + 2.2, 0]),
            ([0.7, floor, -0.2], [half, floor + 2.2, 0]),
        ]
    low, high = zip(*walls, strict=True)
    roof = box([-half - 0.1, top, -SHAFT_M - 0.1], [half + 0.1, top + 0.2, 0.1])
    tower = furniture.mesh("lift-tower", {"wall": boxes(low, high), "clay": roof})
    cabin = merge(
        [
            box([-0.9, 0.0, -2.2], [0.9, 0.06, -0.3]),
            box([-0.9, 2.3, -2.2], [0.9, 2.36, -0.3]),
            box([-0.9, 0.06, -2.2], [-0.84, 2.3, -0.3]),
            box([0.84, 0.06, -2.2], [0.9, 2.3, -0.3]),
            box([-0.84, 0.06, -2.2], [0.84, 2.3, -2.14]),
        ]
    )
    times = np.array([time for time, _ in stops])
    heights = np.array([[0.0, storey * STOREY_M, 0.0] for _, storey in stops])
    leaves = tuple(
        AnimatedNode(
            f"{name}/leaf-{'left' if side < 0 else 'right'}",
            furniture.mesh("lift-leaf", {"metal": box([0, 0.06, -0.04], [0.84, 2.3, 0.0])}),
            at_place((min(side, 0) * 0.84, 0.0, -0.26)),
            tracks=(_sliding(side, stops),),
        )
        for side in (-1, 1)
    )
    ride = AnimatedNode(
        f"{name}/cabin",
        furniture.mesh("lift-cabin", {"metal": cabin}),
        tracks=(Track("translation", times, heights),),
        children=(*leaves, *riders),
    )
    return Node(name, tower, children=(ride,))


def _sliding(side: int, stops: tuple[tuple[float, int], ...]) -> Track:
    """A leaf that is open in the middle of each stay at a storey."""
    times, places = [0.0], [0.0]
    for (start, storey), (end, after) in itertools.pairwise(stops):
        if storey == after and end - start > 4 * SLIDING_S:
            times += [start + SLIDING_S * k for k in (1, 2)]
            times += [end - SLIDING_S * k for k in (2, 1)]
            places += [0.0, 0.76, 0.76, 0.0]
    x = min(side, 0) * 0.84
    return Track(
        "translation",
        np.array(times),
        np.array([[x + side * place, 0.0, -0.26] for place in places]),
    )
