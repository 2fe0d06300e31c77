"""A small compiled map, written record by record: three rooms in a row along x.

Planes at x = 100 and x = 0 part them: clusters 0 (x <= 0), 1 and 2 (x > 100). Face 0 is in cluster
0, face 1 in 1 and 2, face 2 in 2, all across the way; face 3 is a quarter of a tube in 1; face 4
a flare, face 5 of a shader that is not drawn, and face 6 a door's.
"""

from __future__ import annotations

import struct

import numpy as np

LUMPS = 17
ROOMS = 3
ENTITIES = """{ "classname" "worldspawn" }
{ "classname" "info_player_deathmatch" "origin" "-25 0 -35" }
{ "classname" "light" "origin" "50 0 0" }
{ "classname" "item_health" "origin" "far away" }
{ "classname" "weapon_gauntlet" "origin" "50 5 -35" }
"""


def square(x: float, half: float) -> list[tuple[float, float, float]]:
    """Clockwise as it is seen from lesser x, where y goes to the left and z up."""
    return [(x, half, -half), (x, half, half), (x, -half, half), (x, -half, -half)]


def tube() -> list[tuple[float, float, float]]:
    """Control points of a quarter: across from (1, 0) by (1, 1) to (0, 1), straight along z."""
    rim = [(1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    return [(50 + x, 20 + y, float(z)) for z in (0, 1, 2) for x, y in rim]


def face(
    shader: int, kind: int, first: int, count: int, corners: int, size: tuple = (0, 0)
) -> bytes:
    numbers = (shader, -1, kind, first, count, 0, corners)
    return struct.pack("<7i", *numbers) + bytes(68) + struct.pack("<2i", *size)


def node(plane: int, front: int, back: int, most: int) -> bytes:
    return struct.pack("<9i", plane, front, back, -100, -100, -100, most, 100, 100)


def leaf(cluster: int, least: int, most: int, first: int, count: int) -> bytes:
    box = (least, -100, -100, most, 100, 100)
    return struct.pack("<12i", cluster, 0, *box, first, count, 0, int(cluster == 1))


def written(
    seen: np.ndarray | None = None,
    clusters: tuple[int, int, int] = (0, 1, 2),
    lumps: dict[int, bytes] | None = None,
) -> bytes:
    """The file. `seen`: (3, 3), the PVS, by default all; `lumps`: by number, instead of its own."""
    seen = np.ones((ROOMS, ROOMS), bool) if seen is None else seen
    points = [*square(-50, 10), *square(50, 10), *square(150, 60), *tube(), (50.0, 0.0, 0.0)]
    vertices = b"".join(struct.pack("<3f", *point) + bytes(32) for point in points)
    own = {
        0: ENTITIES.encode() + b"\0",
        1: b"".join(
            struct.pack("<64sII", name, surface, 1)
            for name, surface in ((b"textures/wall", 0), (b"textures/nodraw", 0x80))
        ),
        2: struct.pack("<8f", 1, 0, 0, 100, 1, 0, 0, 0),
        3: node(0, -3, 1, 300) + node(1, -2, -1, 100),
        4: leaf(clusters[0], -100, 0, 0, 1)
        + leaf(clusters[1], 0, 100, 1, 4)
        + leaf(clusters[2], 100, 300, 5, 2),
        5: struct.pack("<7i", 0, 1, 3, 4, 5, 2, 1),
        6: struct.pack("<i", 0),
        7: struct.pack("<6f4i", *[0.0] * 6, 0, 6, 0, 0)
        + struct.pack("<6f4i", *[0.0] * 6, 6, 1, 0, 0),
        8: struct.pack("<3i", 0, 0, 0),
        10: vertices,
        11: struct.pack("<6i", 0, 1, 2, 0, 2, 3),
        13: face(0, 1, 0, 4, 6)
        + face(0, 1, 4, 4, 6)
        + face(0, 3, 8, 4, 6)
        + face(0, 2, 12, 9, 0, (3, 3))
        + face(0, 4, 21, 1, 0)
        + face(1, 1, 0, 4, 6)
        + face(0, 1, 0, 4, 6),
        16: struct.pack("<2i", ROOMS, 1)
        + np.packbits(seen.astype(np.uint8), axis=1, bitorder="little").tobytes(),
    }
    own |= lumps or {}
    directory, body = [], b""
    for number in range(LUMPS):
        data = own.get(number, b"")
        directory.append(struct.pack("<2i", 8 + 8 * LUMPS + len(body), len(data)))
        body += data
    return b"IBSP" + struct.pack("<i", 46) + b"".join(directory) + body
