"""A furnished office floor, three copies side by side, walked through from room to room.

The counterpart of the third floor of Berkeley's Soda Hall, of which Klosowski and Silva
("Efficient Conservative Visibility Culling Using the Prioritized-Layered Projection Algorithm",
2001, section 4) put three copies side by side: over a million triangles of furnished rooms, in
octree leaves of fewer than 5,000, and a path of 500 frames from the right to the left. Theirs is
a survey of a building; this one is laid out here: a corridor through all copies, with screens
across it that are open at one side in turn, offices along both of its sides, and doors open.
Walls, floors and furniture are closed solids, whose back faces nobody sees; leaves, glass and lamp
shades are sheets with two sides.
"""

from __future__ import annotations

import itertools
import math
from functools import partial

import numpy as np

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref_datasets_gen import furniture
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import Mesh, Node
from visref_datasets_gen.shapes import Float64, Soup, box, merge

COPIES = 3
OFFICES_AT_SCALE_1 = 13  # on each side of a copy's corridor
OFFICE_M = (4.5, 6.0)
CORRIDOR_M = 3.0
HEIGHT_M = 3.0
SCREENS = 3  # across a copy's corridor
WALL_M = 0.125
DOOR_M = (1.0, 2.125)
EYE_HEIGHT_M = 1.625

# From a screen's middle, how far one walks beside it.
ASIDE_M = 0.25
# How far ahead along the path the eye looks, and over how much of it the gaze is averaged.
LOOK_AHEAD_M = 1.5

_solid = partial(furniture.mesh, solid=True)


def soda_hall(*, seed: int = 0, scale: float = 1.0, frames: int = 500) -> Dataset:
    """Just over a million triangles at scale 1; `scale` sets how many offices a copy has.

    The path (512 by 512) starts in the last office on the right and calls at two offices of
    every copy. Raises InputError for a scale or a number of frames that makes no floor.
    """
    if not 0.0 < scale <= 100.0:
        raise InputError(f"the floor's scale is {scale}", place="scale", fix="give up to 100")
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    offices = max(2, round(OFFICES_AT_SCALE_1 * scale))
    length = offices * OFFICE_M[0]
    stock = _stock(np.random.Generator(np.random.PCG64(seed)))
    copies = []
    for copy in range(COPIES):
        # Every copy is the same floor.
        rng = np.random.Generator(np.random.PCG64([seed, 1]))
        rooms = [
            _office(rng, stock, f"office{copy}{side}{k:02d}", k, side)
            for side in "ns"
            for k in range(offices)
        ]
        shell = Node(f"shell{copy}", _shell(offices))
        copies.append(
            furniture.placed(
                f"floor{copy}", None, (copy * length, 0.0, 0.0), children=(shell, *rooms)
            )
        )
    ends = tuple(
        Node(f"end{k}", _solid("end", {"wall": _across(x)}))
        for k, x in enumerate((0.0, COPIES * length))
    )
    return Dataset("soda_hall", (*copies, *ends), _path(offices, frames))


def _opening(number: int, length: float) -> tuple[float, float]:
    """Where one walks past a screen: (x, z), left and right in turn."""
    side = CORRIDOR_M / 2 - WALL_M / 2 - DOOR_M[0] / 2
    return (number + 0.5) * length / SCREENS, side if number % 2 else -side


def _screen(z: float) -> tuple[float, float]:
    """From where to where a screen stands whose opening is at z."""
    side = math.copysign(1.0, z)
    ends = -side * CORRIDOR_M / 2, z - side * DOOR_M[0] / 2
    return min(ends), max(ends)


def _across(x: float) -> Soup:
    """A wall across the corridor."""
    half = CORRIDOR_M / 2
    return box([x - WALL_M / 2, 0.0, -half], [x + WALL_M / 2, HEIGHT_M, half])


def _stock(rng: np.random.Generator) -> dict[str, Mesh]:
    pieces = {
        "desk": furniture.desk(),
        "computer": furniture.computer(),
        "chair": furniture.office_chair(),
        "visitor": furniture.visitor_chair(),
        "lamp": furniture.floor_lamp(),
        "cabinet": furniture.cabinet(),
        "bin": furniture.waste_bin(),
        "lights": furniture.ceiling_lights(*OFFICE_M, HEIGHT_M),
    }
    for k in range(3):
        pieces[f"shelf{k}"] = furniture.bookshelf(rng)
        pieces[f"plant{k}"] = furniture.plant(rng)
    return {name: _solid(name, parts) for name, parts in pieces.items()}


def _shell(offices: int) -> Mesh:
    """Floor, ceiling and walls of a copy, which starts at x = 0; the door of an office is in
    the middle of its corridor wall, and the corridor goes on into the next copy."""
    width, depth = OFFICE_M
    length, inner = offices * width, CORRIDOR_M / 2
    outer, half = inner + depth, WALL_M / 2
    walls = []
    for side in (-1.0, 1.0):
        z0, z1 = sorted((side * outer - half, side * outer + half))
        walls.append(box([0.0, 0.0, z0], [length, HEIGHT_M, z1]))
        z0, z1 = sorted((side * inner - half, side * inner + half))
        for k in range(offices):
            left, right = k * width, (k + 1) * width
            door = (left + right - DOOR_M[0]) / 2, (left + right + DOOR_M[0]) / 2
            walls.append(box([left, 0.0, z0], [door[0], HEIGHT_M, z1]))
            walls.append(box([door[1], 0.0, z0], [right, HEIGHT_M, z1]))
            walls.append(box([door[0], DOOR_M[1], z0], [door[1], HEIGHT_M, z1]))
        z0, z1 = sorted((side * inner, side * outer))
        walls += [
            box([k * width - half, 0.0, z0], [k * width + half, HEIGHT_M, z1])
            for k in range(offices + 1)
        ]
    for k in range(SCREENS):
        x, z = _opening(k, length)
        sides = _screen(z)
        walls.append(box([x - half, 0.0, sides[0]], [x + half, HEIGHT_M, sides[1]]))
    floor = box([0.0, -0.25, -outer], [length, 0.0, outer])
    ceiling = box([0.0, HEIGHT_M, -outer], [length, HEIGHT_M + 0.25, outer])
    return _solid("shell", {"wall": merge(walls), "floor": floor, "ceiling": ceiling})


def _office(
    rng: np.random.Generator, stock: dict[str, Mesh], name: str, number: int, side: str
) -> Node:
    """An office's furniture, laid out with the corridor towards +z, clear along its middle."""
    width, depth = OFFICE_M
    wing = float(rng.choice([-1.0, 1.0]))
    x = wing * (width / 2 - 0.5)
    turn = 3 if wing > 0 else 1  # from the wall towards the middle
    opposite = (turn + 2) % 4
    pieces = [
        ("desk", (x, 0.0, -1.4), turn),
        ("computer", (x, 0.0, -1.4), turn),
        ("chair", (x - 0.9 * wing, 0.0, -1.4), opposite),
        ("visitor", (x - 0.1 * wing, 0.0, 1.2), turn),
        ("visitor", (x - 0.1 * wing, 0.0, 2.0), turn),
        ("lights", (0.0, 0.0, 0.0), 0),
        ("bin", (x, 0.0, -0.3), 0),
    ]
    far = -wing * (width / 2 - 0.25)
    for k, z in enumerate((-2.0, -0.6)):
        if rng.random() < 0.85:
            pieces.append((f"shelf{rng.integers(3)}", (far, 0.0, z), opposite))
        elif k:
            pieces.append(("cabinet", (far, 0.0, z), opposite))
    for _ in range(int(rng.integers(1, 3))):
        pieces.append((f"plant{rng.integers(3)}", (wing * 1.6, 0.0, -2.5), 0))
        wing = -wing
    pieces.append(("lamp", (far, 0.0, 2.4), 0))
    if rng.random() < 0.6:
        pieces.append(("cabinet", (far, 0.0, 0.8), opposite))
    children = tuple(
        furniture.placed(f"{name}-{piece}{k}", stock[piece], at, turns)
        for k, (piece, at, turns) in enumerate(pieces)
    )
    z = (CORRIDOR_M + depth) / 2
    at = ((number + 0.5) * width, 0.0, -z if side == "n" else z)
    return furniture.placed(name, None, at, 0 if side == "n" else 2, children)


def _path(offices: int, frames: int) -> CameraPath:
    """From right to left: out of an office, along the corridor, round the next."""
    width, depth = OFFICE_M
    stops = []
    for copy in reversed(range(COPIES)):
        stops += [copy * offices + offices - 1, copy * offices + (offices - 1) // 2]
    corners: list[tuple[float, float]] = []
    for place, stop in enumerate(stops):
        x, side = (stop + 0.5) * width, -1.0 if place % 2 == 0 else 1.0
        door, middle = side * CORRIDOR_M / 2, side * (CORRIDOR_M + depth) / 2
        ring = [(0.0, door + 0.8 * side), (0.7, middle), (0.0, middle + 1.2 * side), (-0.7, middle)]
        corners += [(x, 0.0)] if place else []
        corners += [(x + dx, z) for dx, z in (ring if place else ring[2:])]
        corners += [(x, door + 0.8 * side), (x, 0.0)]
    corners.append((0.5 * width, 0.0))
    openings = _openings(offices * width)
    way = np.array(_past_screens(corners, openings))
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    cameras = []
    for k in range(frames):
        s = walked[-1] * (k + 0.5) / frames
        at = _along(way, walked, s)
        # The mean of several points ahead never coincides with the eye for long.
        ahead = np.mean(
            [_along(way, walked, s + f * LOOK_AHEAD_M) for f in (0.5, 1.0, 1.5)], axis=0
        )
        if s + 0.5 * LOOK_AHEAD_M > walked[-1]:
            ahead = at + np.array([-1.0, 0.0])
        x = _aside(at, _along(way, walked, s + 0.1), openings)
        eye = np.array([x, EYE_HEIGHT_M, at[1]])
        target = np.array([ahead[0], EYE_HEIGHT_M - 0.1, ahead[1]])
        cameras.append(
            Camera(look_at(eye, target), 512, 512, near=0.1, far=500.0, yfov=math.radians(60.0))
        )
    return CameraPath(tuple(cameras))


def _openings(length: float) -> list[tuple[float, float]]:
    """Where one walks past the screens of all copies, (x, z), from right to left."""
    openings = []
    for copy in range(COPIES):
        for k in range(SCREENS):
            x, z = _opening(k, length)
            openings.append((x + copy * length, z))
    return sorted(openings, reverse=True)


def _aside(at: Float64, later: Float64, openings: list[tuple[float, float]]) -> float:
    """The x at which one walks: where a screen stands before an office's door, at its right on
    the way in and at its left on the way out. `later`: where the way goes on to."""
    x, z = at.tolist()
    for screen, opening in openings:
        low, high = _screen(opening)
        if abs(x - screen) < ASIDE_M and low - ASIDE_M < z < high + ASIDE_M:
            right = abs(later[1]) > abs(z) if x == screen else x > screen
            return screen + (ASIDE_M if right else -ASIDE_M)
    return float(x)


def _past_screens(
    corners: list[tuple[float, float]], openings: list[tuple[float, float]]
) -> list[tuple[float, float]]:
    """The way with a corner at each opening that its stretches of corridor pass."""
    way = corners[:1]
    for before, after in itertools.pairwise(corners):
        if before[1] == after[1] == 0.0:
            for x, z in openings:
                if after[0] < x < before[0]:
                    way += [(x + 0.5, z), (x - 0.5, z)]
        way.append(after)
    return way


def _along(way: Float64, walked: Float64, s: float) -> Float64:
    return np.array([np.interp(s, walked, way[:, axis]) for axis in (0, 1)])
