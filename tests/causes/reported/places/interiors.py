"""The rooms of a mansion with doorways between them, and a library."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

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

ROOM, HIGH, DOOR, LINTEL = 8.0, 3.4, 1.3, 2.3
ACROSS = 4


@dataclass(frozen=True, eq=False)
class Doorway:
    """Between which two rooms, and its corners, (4, 3). It is in a wall at right angles to x or to
    z, from `start` on along the other."""

    rooms: tuple[int, int]
    axis: int
    start: float
    corners: Float64


def room_of(point: Float64) -> int:
    """Of the mansion, the room that a point is in."""
    i, k = np.clip(np.floor(point[[0, 2]] / ROOM), 0, ACROSS - 1).astype(int)
    return ACROSS * int(i) + int(k)


@cache
def doorways() -> tuple[Doorway, ...]:
    """Of the mansion. Most walls have two."""
    rng = np.random.default_rng(23)
    made = []
    for axis in (0, 2):
        for i in range(ACROSS):
            for k in range(ACROSS):
                room = ACROSS * i + k
                if (i, k)[axis // 2] == ACROSS - 1:
                    continue
                other = room + (ACROSS if axis == 0 else 1)
                starts = (1.2, 5.4) if (i + k) % 4 != 3 else (rng.uniform(1.5, 5.0),)
                for start in starts:
                    first = ROOM * (k if axis == 0 else i) + start
                    at = ROOM * ((i if axis == 0 else k) + 1)
                    corners = np.zeros((4, 3))
                    corners[:, axis] = at
                    corners[:, 2 - axis] = first + DOOR * np.array([0, 0, 1, 1])
                    corners[:, 1] = LINTEL * np.array([0, 1, 1, 0])
                    made.append(Doorway((room, other), axis, first, corners))
    return tuple(made)


def _walls() -> list[Mesh]:
    """Those between the rooms, with their doorways left open."""
    meshes = []
    for axis in (0, 2):
        for i in range(ACROSS):
            for k in range(ACROSS):
                if (i, k)[axis // 2] == ACROSS - 1:
                    continue
                room = ACROSS * i + k
                at = ROOM * ((i, k)[axis // 2] + 1)
                side = ROOM * (k if axis == 0 else i)
                open_at = sorted(
                    d.start for d in doorways() if d.axis == axis and d.rooms[0] == room
                )
                ends = [side, *(e for s in open_at for e in (s, s + DOOR)), side + ROOM]
                parts = [(a, b, 0.0) for a, b in zip(ends[::2], ends[1::2], strict=True)]
                parts += [(s, s + DOOR, LINTEL) for s in open_at]
                boxes = []
                for first, last, up in parts:
                    low, high = np.array([0, up, 0.0]), np.array([0, HIGH, 0.0])
                    low[axis], high[axis] = at - 0.1, at + 0.1
                    low[2 - axis], high[2 - axis] = first, last
                    boxes.append(box(low, high))
                meshes.append(together(*boxes))
    return meshes


@cache
def mansion(**lens) -> Place:
    """Sixteen furnished rooms, with carpets through the doorways, guests, and lamps at the walls.
    `cells` says which room a thing belongs to."""
    rng = np.random.default_rng(29)
    wide = ROOM * ACROSS
    objects: Objects = [
        ("floor", box((0, -0.3, 0), (wide, 0, wide))),
        ("ceiling", box((0, HIGH, 0), (wide, HIGH + 0.3, wide))),
        ("north wall", box((0, 0, -0.3), (wide, HIGH, 0))),
        ("south wall", box((0, 0, wide), (wide, HIGH, wide + 0.3))),
        ("west wall", box((-0.3, 0, 0), (0, HIGH, wide))),
        ("east wall", box((wide, 0, 0), (wide + 0.3, HIGH, wide))),
    ]
    objects += [(f"wall {n}", mesh) for n, mesh in enumerate(_walls())]
    cells = [-1] * len(objects)

    def add(name: str, mesh: Mesh, room: int) -> None:
        objects.append((name, mesh))
        cells.append(room)

    for n, door in enumerate(doorways()):
        low, high = door.corners.min(axis=0), door.corners.max(axis=0)
        low[door.axis] -= rng.uniform(1.5, 3.5)
        high[door.axis] += rng.uniform(1.5, 3.5)
        low[2 - door.axis] += 0.1
        high[2 - door.axis] -= 0.1
        high[1] = 0.03
        add(f"carpet {n}", box(low, high), door.rooms[0])
    for room in range(ACROSS**2):
        corner = ROOM * np.array([room // ACROSS, 0, room % ACROSS])
        for n in range(4):
            size = rng.uniform((0.4, 0.4, 0.4), (1.2, 1.3, 1.2))
            low = np.add(corner, (rng.uniform(0.4, 6.2), 0, rng.uniform(0.4, 6.2)))
            add(f"furniture {room}-{n}", box(low, low + size), room)
        for n in range(7):
            at = np.add(corner, (rng.uniform(0.6, 7.4), 0, rng.uniform(0.6, 7.4)))
            tall = rng.uniform(1.5, 1.9) if n < 4 else rng.uniform(0.3, 1.1)
            add(f"guest {room}-{n}", put(prism(6, 0.14 * tall, tall), at), room)
        for n in range(2):
            # The first of each room is let into the wall.
            low = np.add(corner, ((7.64, 1.9, 0.3), (0.12, 1.9, 7.3))[n])
            add(f"lamp {room}-{n}", box(low, np.add(low, (0.42, 0.4, 0.4))), room)
    way = [np.array([3.0, 1.65, 4.0])]
    for pair in ((0, 4), (4, 5), (5, 9), (9, 10), (10, 14)):
        door = next(d for d in doorways() if d.rooms == pair)
        ahead = np.zeros(3)
        ahead[door.axis] = 1.2
        middle = door.corners.mean(axis=0) * (1, 0, 1) + (0, 1.65, 0)
        way += [middle - ahead, middle + ahead]
    eyes = along(way, 40)
    turn = np.unwrap(np.arctan2(*np.gradient(eyes, axis=0)[:, [0, 2]].T * [[1], [-1]]))
    sway = 0.7 * np.sin(0.9 * np.arange(40))
    path = CameraPath(views(eyes, heading(turn + sway, -0.1), **{"yfov": 1.15, **lens}))
    return Place(scene_of(objects), path, cells=cells)


def along(way, frames: int) -> Float64:
    """Points at even steps on a way of straight pieces."""
    points = np.array(way)
    done = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    steps = np.linspace(0, done[-1], frames)
    return np.stack([np.interp(steps, done, points[:, i]) for i in range(3)], axis=1)


@cache
def library(**lens) -> Place:
    """Rows of bookcases that are open towards +X, and pillars, stools and globes between them."""
    rng = np.random.default_rng(37)
    objects: Objects = [
        ("floor", box((-3, -0.3, -3), (20, 0, 14))),
        ("ceiling", box((-3, 3.6, -3), (20, 3.9, 14))),
        ("back wall", box((-3.3, 0, -3), (-3, 3.6, 14))),
        ("far wall", box((-3, 0, -3.3), (20, 3.6, -3))),
    ]
    for row in range(5):
        for n in range(4):
            x, z = 3.4 * row, 2.4 * n
            boards = [box((x, y, z), (x + 0.4, y + 0.04, z + 2)) for y in (0.1, 0.8, 1.5, 2.2)]
            back = box((x, 0, z), (x + 0.05, 2.24, z + 2))
            objects.append((f"case {row}-{n}", together(back, *boards)))
            for shelf in range(3):
                ends = np.sort([0, *rng.uniform(0.4, 1.6, 2), 2])
                for k in range(3):
                    low = (x + 0.06, 0.7 * shelf + 0.14, z + ends[k])
                    top = 0.7 * shelf + 0.79 - rng.uniform(0.0, 0.12)
                    high = (x + 0.39, top, z + ends[k + 1])
                    objects.append((f"books {row}-{n}-{shelf}-{k}", box(low, high)))
        for n in range(3):
            at = np.array([3.4 * row + 1.2, 0, 2.4 * n + 2.2])
            objects.append((f"pillar {row}-{n}", put(prism(8, 0.32, 3.6), at)))
            for k in range(4):
                a = rng.uniform(-0.7, 0.7)
                aside = rng.uniform(0.4, 0.8) * np.array([np.cos(a), 0, np.sin(a)])
                size = rng.uniform(0.06, 0.12)
                if k % 2:
                    objects.append((f"stool {row}-{n}-{k}", put(prism(5, size, 0.45), at + aside)))
                else:
                    low = at + aside + (0, rng.uniform(0.6, 1.6), 0)
                    objects.append((f"globe {row}-{n}-{k}", box(low, low + 2 * size)))
    way = [(17.2, 1.6, 11), (17.2, 1.6, 1), (13.2, 1.6, -1.4), (13.2, 1.6, 8), (9.8, 1.6, 11)]
    eyes = along([*way, (9.8, 1.6, 3)], 34)
    turn = -1.25 + 0.5 * np.sin(0.7 * np.arange(34))
    path = CameraPath(views(eyes, heading(turn, -0.12), **{"near": 0.15, **lens}))
    return Place(scene_of(objects), path)
