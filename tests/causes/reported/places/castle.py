"""A castle of square rooms, some of which are joined by doors and others by slits alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from tests.causes.reported.places.interiors import along
from tests.causes.reported.places.making import (
    Objects,
    Place,
    heading,
    prism,
    put,
    scene_of,
    views,
)
from visref.camera_path import CameraPath
from visref.conformance.building import Mesh, box, together
from visref.scene import Float64

SIDE, HIGH, ACROSS = 7.0, 4.0, 4
# The rooms that one walks through, from door to door.
WALK = ((0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (3, 2), (3, 3))


@dataclass(frozen=True, eq=False)
class Opening:
    """In the wall between two rooms, and its corners, (4, 3). The wall is at right angles to
    `axis`."""

    rooms: tuple[int, int]
    axis: int
    narrow: bool
    corners: Float64


def castle_room_of(point: Float64) -> int:
    i, k = np.clip(np.floor(point[[0, 2]] / SIDE), 0, ACROSS - 1).astype(int)
    return ACROSS * int(i) + int(k)


@cache
def openings() -> tuple[Opening, ...]:
    rng = np.random.default_rng(151)
    made = []
    for axis in (0, 2):
        for i in range(ACROSS):
            for k in range(ACROSS):
                if (i, k)[axis // 2] == ACROSS - 1:
                    continue
                other = (i + 1, k) if axis == 0 else (i, k + 1)
                steps = pairwise(WALK)
                narrow = ((i, k), other) not in steps and (i + 2 * k + axis) % 4 != 0
                wide, bottom, top = (0.3, 0.7, 2.6) if narrow else (1.5, 0.0, 2.4)
                start = SIDE * (k if axis == 0 else i) + rng.uniform(2.0, 4.0)
                corners = np.zeros((4, 3))
                corners[:, axis] = SIDE * ((i if axis == 0 else k) + 1)
                corners[:, 2 - axis] = start + wide * np.array([0, 0, 1, 1])
                corners[:, 1] = [bottom, top, top, bottom]
                rooms = (ACROSS * i + k, ACROSS * other[0] + other[1])
                made.append(Opening(rooms, axis, narrow, corners))
    return tuple(made)


def _wall(opening: Opening) -> Mesh:
    axis, room = opening.axis, opening.rooms[0]
    side = SIDE * (room % ACROSS if axis == 0 else room // ACROSS)
    low, high = opening.corners.min(axis=0), opening.corners.max(axis=0)
    pieces = (
        (side, low[2 - axis], 0.0, HIGH),
        (high[2 - axis], side + SIDE, 0.0, HIGH),
        (low[2 - axis], high[2 - axis], high[1], HIGH),
        (low[2 - axis], high[2 - axis], 0.0, low[1]),
    )
    boxes = []
    for first, last, bottom, top in pieces:
        if top > bottom:
            ends = np.array([[0, bottom, 0], [0, top, 0]])
            ends[:, axis] = low[axis] - 0.1, low[axis] + 0.1
            ends[:, 2 - axis] = first, last
            boxes.append(box(*ends))
    return together(*boxes)


@cache
def castle() -> Place:
    """Rooms, each with a floor of its own, that are furnished and hung with thin cloths. `cells`
    says which room a thing belongs to."""
    rng = np.random.default_rng(157)
    wide = SIDE * ACROSS
    objects: Objects = [
        ("vault", box((0, HIGH, 0), (wide, HIGH + 0.3, wide))),
        ("outer wall 0", box((0, 0, -0.3), (wide, HIGH, 0))),
        ("outer wall 1", box((0, 0, wide), (wide, HIGH, wide + 0.3))),
        ("outer wall 2", box((-0.3, 0, 0), (0, HIGH, wide))),
        ("outer wall 3", box((wide, 0, 0), (wide + 0.3, HIGH, wide))),
    ]
    objects += [(f"wall {n}", _wall(opening)) for n, opening in enumerate(openings())]
    cells = [-1] * len(objects)
    for room in range(ACROSS**2):
        x, z = SIDE * (room // ACROSS), SIDE * (room % ACROSS)
        far_x, far_z = x + SIDE, z + SIDE
        flat = np.array([[x, 0, z], [x, 0, far_z], [far_x, 0, far_z], [far_x, 0, z]])
        objects.append((f"floor {room}", (flat, np.array([[0, 1, 2], [0, 2, 3]]))))
        cells.append(-1)
        for n in range(3):
            up, a = rng.uniform(1.0, 2.2), rng.uniform(0.4, 1.0)
            low = ((x + a, up, far_z - 0.115), (far_x - 0.115, up, z + a), (x + 0.1, up, z + a))[n]
            size = ((0.9, 1.3, 0.015), (0.015, 1.3, 0.9), (0.015, 1.0, 0.8))[n]
            objects.append((f"cloth {room}-{n}", box(low, np.add(low, size))))
            cells.append(room)
        for n in range(4):
            at = (x + rng.uniform(0.7, 5.4), 0, z + rng.uniform(0.7, 5.4))
            size = rng.uniform((0.4, 0.4, 0.4), (1.0, 1.4, 1.0))
            mesh = box((0, 0, 0), size) if n % 2 else prism(7, 0.25, 0.9 + size[1])
            objects.append((f"thing {room}-{n}", put(mesh, at)))
            cells.append(room)
    way = [np.array([1.5, 1.6, 3.4])]
    for pair in pairwise(WALK):
        rooms = tuple(ACROSS * i + k for i, k in pair)
        door = next(one for one in openings() if one.rooms == rooms)
        ahead = np.zeros(3)
        ahead[door.axis] = 1.3
        middle = door.corners.mean(axis=0) * (1, 0, 1) + (0, 1.6, 0)
        way += [middle - ahead, middle + ahead]
    eyes = along(way, 38)
    turn = np.unwrap(np.arctan2(*np.gradient(eyes, axis=0)[:, [0, 2]].T * [[1], [-1]]))
    sway = 0.9 * np.sin(0.8 * np.arange(38))
    cameras = views(eyes, heading(turn + sway, -0.12), near=0.1, yfov=1.15)
    return Place(scene_of(objects), CameraPath(cameras), cells=cells)
