"""Office furniture with as many triangles as modellers give it, as soups by material.

Each piece stands on y = 0 around the origin, its front towards +z; lengths are metres. All of it is
closed solids, but for the materials of `SHEETS`.
"""

from __future__ import annotations

import numpy as np

from visref_datasets_gen.graph import Material, Mesh, Node, Primitive
from visref_datasets_gen.shapes import (
    Soup,
    box,
    boxes,
    icosphere,
    lathe,
    merge,
    moved,
    quads,
    quarter_turn,
    ring,
    snap,
    turned,
)

Parts = dict[str, Soup]

_COLOURS = {
    "wall": (0.78, 0.76, 0.70),
    "floor": (0.34, 0.30, 0.28),
    "ceiling": (0.88, 0.88, 0.86),
    "wood": (0.45, 0.29, 0.16),
    "cloth": (0.16, 0.22, 0.38),
    "metal": (0.40, 0.41, 0.43),
    "plastic": (0.12, 0.12, 0.13),
    "screen": (0.08, 0.20, 0.26),
    "paper": (0.72, 0.64, 0.50),
    "leaf": (0.12, 0.30, 0.10),
    "clay": (0.52, 0.28, 0.18),
    "light": (0.95, 0.93, 0.84),
    "shade": (0.95, 0.93, 0.84),
}

# Seen from both sides: leaves, glass, a lamp's shade.
SHEETS = frozenset({"leaf", "screen", "shade"})


def mesh(name: str, parts: Parts, *, solid: bool = False) -> Mesh:
    """The parts as one mesh, on the grid. Every surface is seen from both sides; with `solid`, only
    those of `SHEETS` are, and all others, which are closed, from outside alone."""
    return Mesh(
        name,
        tuple(
            Primitive(
                snap(vertices).astype(np.float32),
                faces.astype(np.uint32),
                Material(
                    material,
                    (*_COLOURS[material], 1.0),
                    double_sided=not solid or material in SHEETS,
                ),
            )
            for material, (vertices, faces) in parts.items()
        ),
    )


def placed(
    name: str,
    mesh: Mesh | None,
    at: tuple[float, float, float],
    turns: int = 0,
    children: tuple[Node, ...] = (),
) -> Node:
    """A node at a place (metres, snapped), turned by quarter turns about the vertical."""
    matrix = np.eye(4)
    matrix[:3, :3] = quarter_turn(turns)
    matrix[:3, 3] = snap(at)
    return Node(name, mesh, matrix, children)


def _scaled(soup: Soup, size: tuple[float, float, float]) -> Soup:
    return soup[0] * np.array(size), soup[1]


def _bar(radius: float, bottom: float, top: float, sides: int = 12) -> Soup:
    return lathe([(radius, bottom), (radius, top)], sides)


def office_chair() -> Parts:
    """A swivel chair."""
    legs = [
        box([-0.03, 0.07, 0.0], [0.03, 0.11, 0.3]),
        box([0.0, 0.07, -0.03], [0.3, 0.11, 0.03]),
    ]
    legs += [turned(leg, 2) for leg in legs]
    wheels = [
        moved(_scaled(icosphere(1), (0.04, 0.035, 0.04)), (x, 0.035, z))
        for x, z in ((0.0, 0.28), (0.28, 0.0), (0.0, -0.28), (-0.28, 0.0))
    ]
    back = moved(_scaled(icosphere(2), (0.23, 0.275, 0.05)), (0.0, 0.82, -0.24))
    return {
        "plastic": merge([*legs, *wheels]),
        "metal": merge([_bar(0.03, 0.1, 0.42, 24), box([-0.02, 0.4, -0.28], [0.02, 0.7, -0.24])]),
        "cloth": merge([moved(_scaled(icosphere(3), (0.25, 0.06, 0.24)), (0.0, 0.46, 0.0)), back]),
    }


def visitor_chair() -> Parts:
    """Four tubes, a seat and a back."""
    tubes = [
        moved(_bar(0.015, 0.0, 0.44 if z > 0 else 0.85, 10), (x, 0.0, z))
        for x in (-0.22, 0.22)
        for z in (-0.2, 0.2)
    ]
    seat = moved(_scaled(icosphere(2), (0.25, 0.04, 0.24)), (0.0, 0.45, 0.0))
    back = moved(_scaled(icosphere(2), (0.24, 0.14, 0.03)), (0.0, 0.74, -0.2))
    return {"metal": merge(tubes), "cloth": merge([seat, back])}


def desk() -> Parts:
    """A desk with two pedestals of three drawers."""
    wood = [box([-0.8, 0.71, -0.4], [0.8, 0.75, 0.4]), box([-0.75, 0.3, -0.38], [0.75, 0.7, -0.36])]
    knobs = []
    for x in (-0.55, 0.55):
        wood.append(box([x - 0.22, 0.02, -0.36], [x + 0.22, 0.71, 0.34]))
        for y in (0.06, 0.29, 0.5):
            wood.append(box([x - 0.2, y, 0.34], [x + 0.2, y + 0.19, 0.36]))
            knob = _scaled(icosphere(1), (0.02, 0.02, 0.02))
            knobs.append(moved(knob, (x, y + 0.1, 0.375)))
    return {"wood": merge(wood), "metal": merge(knobs)}


def computer() -> Parts:
    """A tube monitor, a keyboard of 84 keys and a mouse, to stand on a desk."""
    x, z = np.meshgrid(np.arange(14) * 0.028 - 0.19, np.arange(6) * 0.024)
    low = np.stack([x.ravel(), np.full(84, 0.765), z.ravel() + 0.1], axis=1)
    keys = boxes(low, low + np.array([0.022, 0.012, 0.019]))
    body = [
        box([-0.21, 0.85, -0.1], [0.21, 1.2, 0.02]),
        box([-0.15, 0.9, -0.32], [0.15, 1.15, -0.1]),
        box([-0.22, 0.75, 0.08], [0.22, 0.765, 0.26]),
        moved(lathe([(0.14, 0.0), (0.12, 0.02), (0.06, 0.04), (0.05, 0.1)], 24), (0, 0.75, -0.06)),
        moved(_scaled(icosphere(2), (0.03, 0.02, 0.05)), (0.32, 0.76, 0.18)),
    ]
    glass = quads([[[-0.19, 0.88, 0.025], [0.19, 0.88, 0.025], [0.19, 1.17, 0.025],
                    [-0.19, 1.17, 0.025]]])  # fmt: skip
    return {"plastic": merge([keys, *body]), "screen": glass}


def bookshelf(rng: np.random.Generator) -> Parts:
    """Five boards of books."""
    boards = [box([-0.6, 0.4 * k, -0.16], [0.6, 0.4 * k + 0.025, 0.16]) for k in range(6)]
    boards += [box([x - 0.0125, 0.0, -0.16], [x + 0.0125, 2.05, 0.16]) for x in (-0.6, 0.6)]
    boards.append(box([-0.6, 0.0, -0.17], [0.6, 2.05, -0.16]))
    lows, highs = [], []
    for shelf in range(5):
        x = -0.57
        while x < 0.5:
            width = rng.uniform(0.02, 0.05)
            if rng.random() < 0.9:
                y = 0.4 * shelf + 0.025
                lows.append((x, y, -0.14))
                highs.append(
                    (x + width - 0.003, y + rng.uniform(0.2, 0.33), rng.uniform(0.02, 0.1))
                )
            x += width
    return {"wood": merge(boards), "paper": boxes(lows, highs)}


def plant(rng: np.random.Generator, leaves: int = 85) -> Parts:
    """A pot, and arching leaves of eight quads each."""
    pot = lathe([(0.0, 0.0), (0.15, 0.0), (0.2, 0.36), (0.22, 0.4), (0.18, 0.4), (0.17, 0.34)], 32)
    t = np.linspace(0.0, 1.0, 9)
    blades = []
    for _ in range(leaves):
        turn, reach, height = (
            rng.uniform(0, 2 * np.pi),
            rng.uniform(0.2, 0.5),
            rng.uniform(0.5, 1.3),
        )
        aim, side = (
            np.array([np.cos(turn), 0, np.sin(turn)]),
            np.array([-np.sin(turn), 0, np.cos(turn)]),
        )
        spine = aim * (reach * t**1.5)[:, None]
        spine[:, 1] = 0.36 + height * np.sin(2.0 * t)
        half = side * (0.03 * np.sin(np.pi * (0.08 + 0.9 * t)))[:, None]
        a, b = spine - half, spine + half
        blades.append(quads(np.stack([a[:-1], b[:-1], b[1:], a[1:]], axis=1)))
    return {"clay": pot, "leaf": merge(blades)}


def floor_lamp() -> Parts:
    """A foot, a pole and a shade."""
    foot = lathe([(0.16, 0.0), (0.16, 0.02), (0.03, 0.04), (0.012, 0.06), (0.012, 1.5)], 32)
    shade = lathe([(0.24, 1.4), (0.22, 1.5), (0.18, 1.6), (0.12, 1.7)], 32, caps="")
    return {
        "metal": foot,
        "shade": shade,
        "light": moved(_scaled(icosphere(2), (0.05,) * 3), (0, 1.52, 0)),
    }


def cabinet() -> Parts:
    """A steel cabinet of four drawers."""
    body = [box([-0.25, 0.0, -0.3], [0.25, 1.3, 0.3])]
    for k in range(4):
        y = 0.04 + 0.31 * k
        body.append(box([-0.23, y, 0.3], [0.23, y + 0.29, 0.315]))
        body.append(moved(_scaled(icosphere(1), (0.06, 0.012, 0.015)), (0.0, y + 0.22, 0.325)))
    return {"metal": merge(body)}


def waste_bin() -> Parts:
    """A waste-paper basket of staves."""
    points = ring(0.14, 28)
    staves = [
        box([x - 0.008, 0.0, z - 0.008], [x + 0.008, 0.34, z + 0.008]) for x, z in points.tolist()
    ]
    return {"metal": merge([*staves, lathe([(0.15, 0.0), (0.15, 0.02)], 28)])}


def ceiling_lights(width: float, depth: float, height: float) -> Parts:
    """Four louvred fixtures under a ceiling."""
    frames, slats = [], []
    for x in (-width / 4, width / 4):
        for z in (-depth / 4, depth / 4):
            y = height
            frames.append(box([x - 0.6, y - 0.08, z - 0.3], [x + 0.6, y - 0.02, z - 0.28]))
            frames.append(box([x - 0.6, y - 0.08, z + 0.28], [x + 0.6, y - 0.02, z + 0.3]))
            for k in range(16):
                at = x - 0.58 + 0.075 * k
                slats.append(box([at, y - 0.08, z - 0.28], [at + 0.01, y - 0.02, z + 0.28]))
    return {"metal": merge(frames), "light": merge(slats)}
