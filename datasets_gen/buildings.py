"""Buildings of four kinds: a house, a brick walk-up, an office block and a tower.

Each stands on y = 0 around the origin, its front towards +z, and comes as soups by material.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from visref_datasets_gen.shapes import (
    Soup,
    box,
    boxes,
    fans,
    lathe,
    merge,
    moved,
    quads,
    turned,
)

Float64 = NDArray[np.float64]
Rng = np.random.Generator

GROUND_FLOOR_M = 4.25


@dataclass
class Building:
    """Soups by material, and the flat roof where further objects may stand.

    `roof`: (x, z) half-extent of the free roof and its height, in metres; None for a gable.
    """

    parts: dict[str, list[Soup]] = field(default_factory=dict)
    roof: tuple[float, float, float] | None = None
    height: float = 0.0

    def add(self, material: str, *soups: Soup) -> None:
        self.parts.setdefault(material, []).extend(soups)

    def soups(self) -> dict[str, Soup]:
        return {material: merge(parts) for material, parts in self.parts.items()}


def house(rng: Rng, width: float, depth: float) -> Building:
    """Two or three floors under a gable roof, with a porch and a chimney."""
    made = Building()
    floors = int(rng.integers(2, 4))
    eaves = 0.5 + 3.0 * floors
    ridge = eaves + 0.38 * depth
    made.height = ridge
    sills = 1.4 + 3.0 * np.arange(floors, dtype=np.float64)
    columns = max(2, round(width / 3.6))
    _walls(made, width, depth, 0.0, sills, sills + 1.5, eaves, (columns, 2), half=0.6, recess=0.14)
    _sills(made, width, depth, sills, columns, half=0.6)
    half_w, half_d, over = width / 2, depth / 2, 0.5
    # Gable walls, then the two slopes as slabs that overhang them.
    gable = [[half_w, eaves, half_d], [half_w, eaves, -half_d], [half_w, ridge, 0.0]]
    made.add("wall", fans([gable]), turned(fans([gable]), 2))
    slope = (ridge - eaves) / half_d
    for turn in (0, 2):
        low_z, low_y = half_d + over, eaves - over * slope
        top = [
            [-half_w - over, low_y + 0.2, low_z],
            [half_w + over, low_y + 0.2, low_z],
            [half_w + over, ridge + 0.2, 0.0],
            [-half_w - over, ridge + 0.2, 0.0],
        ]
        under = [[x, y - 0.2, z] for x, y, z in top[::-1]]
        edge = [top[0], under[3], under[2], top[1]]
        sides = [[top[0], top[3], under[0], under[3]], [top[2], top[1], under[2], under[1]]]
        slab = quads([top, under, edge, *sides])
        made.add("roof", turned(slab, turn))
    x = float(rng.choice([-1.0, 1.0])) * (half_w - 1.4)
    made.add("brick", box([x - 0.4, eaves, -1.9], [x + 0.4, ridge + 1.0, -1.1], "xXYzZ"))
    made.add("trim", box([x - 0.5, ridge + 1.0, -2.0], [x + 0.5, ridge + 1.2, -1.0]))
    _door(made, x=-0.25 * width, z=half_d, width=1.1, canopy=0.9)
    return made


def walkup(rng: Rng, width: float, depth: float) -> Building:
    """Three to seven floors of recessed windows over shops, with a cornice; some with a fire
    escape on the front."""
    made = Building()
    floors = int(rng.integers(3, 7))
    storey = 3.25
    top = GROUND_FLOOR_M + storey * floors + 1.5
    made.height = top
    sills = GROUND_FLOOR_M + 0.9 + storey * np.arange(floors, dtype=np.float64)
    columns = max(3, round(width / 3.6))
    _walls(
        made,
        width,
        depth,
        GROUND_FLOOR_M,
        sills,
        sills + 1.8,
        top,
        (columns, 2),
        half=0.55,
        recess=0.2,
    )
    _sills(made, width, depth, sills, columns, half=0.55)
    _shop_front(made, rng, width, depth)
    _belt(made, width, depth, GROUND_FLOOR_M - 0.15, 0.3, 0.18)
    _belt(made, width, depth, top - 0.45, 0.45, 0.55, material="trim")
    _brackets(made, width, depth, top - 0.8)
    _flat_roof(made, width, depth, top)
    if rng.random() < 0.5:
        _fire_escape(made, depth, sills - 0.35, x=float(rng.choice([-0.22, 0.22])) * width)
    return made


def office(rng: Rng, width: float, depth: float) -> Building:
    """Five to eleven floors of ribbon windows with mullions, a ledge at every floor."""
    made = Building()
    floors = int(rng.integers(5, 12))
    storey = 3.5
    top = GROUND_FLOOR_M + storey * floors + 1.25
    made.height = top
    sills = GROUND_FLOOR_M + 1.0 + storey * np.arange(floors, dtype=np.float64)
    columns = (max(2, round(width / 5.0)), max(2, round(depth / 7.0)))
    _walls(
        made,
        width,
        depth,
        GROUND_FLOOR_M,
        sills,
        sills + 1.9,
        top,
        columns,
        half=(0.42 * width / columns[0], 0.4 * depth / columns[1]),
        recess=0.25,
    )
    centres = (np.arange(columns[0]) + 0.5) * width / columns[0] - width / 2
    bars = np.concatenate(
        [centres - 0.14 * width / columns[0], centres + 0.14 * width / columns[0]]
    )
    x, y = (grid.reshape(-1) for grid in np.meshgrid(bars, sills))
    z = np.full_like(x, depth / 2)
    low = np.stack([x - 0.06, y, z - 0.25], axis=1)
    high = np.stack([x + 0.06, y + 1.9, z - 0.1], axis=1)
    made.add("trim", boxes(low, high, "xXZ"))
    for y_m in sills - 0.6:
        _belt(made, width, depth, float(y_m), 0.25, 0.12)
    _shop_front(made, rng, width, depth)
    _belt(made, width, depth, top - 0.3, 0.3, 0.2)
    _flat_roof(made, width, depth, top)
    return made


def tower(rng: Rng, width: float, depth: float) -> Building:
    """A podium, a shaft of twelve to 27 floors with fins, a stepped crown."""
    made = Building()
    floors = int(rng.integers(12, 28))
    storey = 3.5
    podium = GROUND_FLOOR_M + 3.75
    _shop_front(made, rng, width, depth)
    sill = np.array([GROUND_FLOOR_M + 0.75])
    _walls(
        made,
        width,
        depth,
        GROUND_FLOOR_M,
        sill,
        sill + 2.0,
        podium,
        (max(3, round(width / 4.0)), 3),
        half=1.2,
        recess=0.25,
    )
    _belt(made, width, depth, podium - 0.35, 0.35, 0.2, material="trim")
    inset = 1.75
    made.add(
        "roof", box([-width / 2, podium - 0.2, -depth / 2], [width / 2, podium, depth / 2], "Y")
    )
    lower = floors if floors < 16 else int(0.65 * floors)
    base = podium
    for level, count in enumerate((lower, floors - lower)):
        if not count:
            continue
        w, d = (side - 2 * inset * (level + 1) for side in (width, depth))
        sills = base + 0.9 + storey * np.arange(count, dtype=np.float64)
        top = base + storey * count + 0.9
        columns = (max(2, round(w / 5.0)), max(2, round(d / 5.5)))
        half = (0.4 * w / columns[0], 0.4 * d / columns[1])
        _walls(made, w, d, base, sills, sills + 2.1, top, columns, half=half, recess=0.2)
        _fins(made, w, d, base, top + 0.6, columns)
        _belt(made, w, d, top - 0.3, 0.3, 0.3, material="trim")
        _flat_roof(made, w, d, top)
        base = top - 0.9
    x, z, roof = made.roof or (2.0, 2.0, base)
    made.add("trim", box([-0.5 * x, roof, -0.5 * z], [0.5 * x, roof + 3.5, 0.5 * z], "xXYzZ"))
    mast = [(0.35, roof + 3.5), (0.3, roof + 7.5), (0.12, roof + 7.5), (0.06, roof + 16.0)]
    made.add("metal", lathe(mast, 6, caps="1"))
    made.height = roof + 16.0
    made.roof = None
    return made


def _walls(
    made: Building,
    width: float,
    depth: float,
    bottom: float,
    sills: Float64,
    heads: Float64,
    top: float,
    columns: tuple[int, int],
    *,
    half: float | tuple[float, float],
    recess: float,
) -> None:
    """Four walls with windows in rows (sills to heads) and columns (front, side)."""
    halves = half if isinstance(half, tuple) else (half, half)
    for side in range(4):
        odd = side % 2
        span, distance = (depth, width / 2) if odd else (width, depth / 2)
        wall, glass = _facade(span, bottom, sills, heads, top, columns[odd], halves[odd], recess)
        for material, soup in (("wall", wall), ("glass", glass)):
            made.add(material, turned(moved(soup, (0, 0, distance)), side))


def _facade(
    span: float,
    bottom: float,
    sills: Float64,
    heads: Float64,
    top: float,
    columns: int,
    half: float,
    recess: float,
) -> tuple[Soup, Soup]:
    """A wall at z = 0 facing +z, centred on x = 0, and its recessed panes."""
    centres = (np.arange(columns) + 0.5) * span / columns - span / 2
    left, right = centres - half, centres + half
    strips = _upright(
        np.full(len(sills) + 1, -span / 2),
        np.full(len(sills) + 1, span / 2),
        np.concatenate([[bottom], heads]),
        np.concatenate([sills, [top]]),
    )
    x0, y0 = np.meshgrid(np.concatenate([[-span / 2], right]), sills)
    x1, y1 = np.meshgrid(np.concatenate([left, [span / 2]]), heads)
    piers = _upright(x0.ravel(), x1.ravel(), y0.ravel(), y1.ravel())
    x0, y0 = (grid.ravel() for grid in np.meshgrid(left, sills))
    x1, y1 = (grid.ravel() for grid in np.meshgrid(right, heads))
    hole = _upright(x0, x1, y0, y1)
    pane = hole - [0.0, 0.0, recess]
    reveals = [
        np.stack([hole[:, i], pane[:, i], pane[:, j], hole[:, j]], axis=1)
        for i, j in ((1, 0), (2, 1), (3, 2), (0, 3))
    ]
    return quads(np.concatenate([strips, piers, *reveals])), quads(pane)


def _upright(x0: Float64, x1: Float64, y0: Float64, y1: Float64) -> Float64:
    """(n, 4, 3) rectangles at z = 0 that face +z."""
    x = np.stack([x0, x1, x1, x0], axis=1)
    y = np.stack([y0, y0, y1, y1], axis=1)
    return np.stack([x, y, np.zeros_like(x)], axis=2)


def _sills(
    made: Building, width: float, depth: float, sills: Float64, columns: int, half: float
) -> None:
    centres = (np.arange(columns) + 0.5) * width / columns - width / 2
    x, y = (grid.ravel() for grid in np.meshgrid(centres, sills))
    z = np.full_like(x, depth / 2)
    low = np.stack([x - half - 0.1, y - 0.16, z - 0.05], axis=1)
    high = np.stack([x + half + 0.1, y, z + 0.14], axis=1)
    made.add("trim", boxes(low, high, "xXyYZ"))


def _shop_front(made: Building, rng: Rng, width: float, depth: float) -> None:
    """The ground floor: shop windows in front, plain walls elsewhere, a door, an awning."""
    columns = max(2, round(width / 5.0))
    low, high = np.array([0.6]), np.array([3.1])
    half = 0.5 * width / columns - 0.55
    wall, glass = _facade(width, 0.0, low, high, GROUND_FLOOR_M, columns, half, 0.3)
    made.add("base", moved(wall, (0, 0, depth / 2)))
    made.add("glass", moved(glass, (0, 0, depth / 2)))
    made.add(
        "base",
        box([-width / 2, 0.0, -depth / 2], [width / 2, GROUND_FLOOR_M, depth / 2], "xXz"),
    )
    door = int(rng.integers(columns))
    for column in range(columns):
        x = (column + 0.5) * width / columns - width / 2
        if column == door:
            _door(made, x=x, z=depth / 2, width=1.6, canopy=1.3)
        elif rng.random() < 0.7:
            made.add("awning", _awning(x, half + 0.2, depth / 2))


def _awning(x: float, half: float, z: float) -> Soup:
    high, low, out = 3.7, 3.0, 1.25
    top = [
        [x - half, low, z + out],
        [x + half, low, z + out],
        [x + half, high, z],
        [x - half, high, z],
    ]
    flap = [
        [x - half, low - 0.25, z + out],
        [x + half, low - 0.25, z + out],
        [x + half, low, z + out],
        [x - half, low, z + out],
    ]
    cheeks = [
        [[x - half, low, z], [x - half, low, z + out], [x - half, high, z]],
        [[x + half, low, z + out], [x + half, low, z], [x + half, high, z]],
    ]
    return merge([quads([top, flap]), fans(cheeks)])


def _door(made: Building, *, x: float, z: float, width: float, canopy: float) -> None:
    half = width / 2
    made.add(
        "trim", box([x - half - 0.15, 0.0, z - 0.35], [x + half + 0.15, 2.6, z + 0.08], "xXYZ")
    )
    made.add("door", box([x - half, 0.0, z], [x + half, 2.4, z + 0.12], "xXYZ"))
    made.add("trim", box([x - half - 0.4, 2.75, z - 0.1], [x + half + 0.4, 2.9, z + canopy]))
    made.add("base", box([x - half - 0.3, 0.0, z + 0.05], [x + half + 0.3, 0.16, z + 0.9], "xXYZ"))


def _belt(
    made: Building,
    width: float,
    depth: float,
    y: float,
    thick: float,
    out: float,
    *,
    material: str = "wall",
) -> None:
    """A ledge around the building."""
    corner = np.array([width / 2 + out, 0.0, depth / 2 + out])
    made.add(material, box(np.subtract((0, y, 0), corner), np.add((0, y + thick, 0), corner)))


def _brackets(made: Building, width: float, depth: float, y: float) -> None:
    """Blocks under the front's cornice."""
    count = round(width / 1.1)
    x = (np.arange(count, dtype=np.float64) + 0.5) * width / count - width / 2
    low = np.stack([x - 0.13, np.full(count, y), np.full(count, depth / 2 - 0.05)], axis=1)
    high = np.stack([x + 0.13, np.full(count, y + 0.35), np.full(count, depth / 2 + 0.4)], axis=1)
    made.add("trim", boxes(low, high, "xXyZ"))


def _fins(
    made: Building, width: float, depth: float, bottom: float, top: float, columns: tuple[int, int]
) -> None:
    """Uprights between the columns of windows, on all four sides."""
    for side in range(4):
        odd = side % 2
        span, distance = (depth, width / 2) if odd else (width, depth / 2)
        count = columns[odd] + 1
        x = np.linspace(-span / 2 + 0.25, span / 2 - 0.25, count)
        low = np.stack([x - 0.18, np.full(count, bottom), np.full(count, distance - 0.05)], axis=1)
        high = np.stack([x + 0.18, np.full(count, top), np.full(count, distance + 0.35)], axis=1)
        made.add("trim", turned(boxes(low, high, "xXYZ"), side))


def _flat_roof(made: Building, width: float, depth: float, top: float) -> None:
    """A parapet of 0.9 m around the roof."""
    thick, drop = 0.3, 0.9
    outer = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [width / 2, depth / 2]
    inner = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [width / 2 - thick, depth / 2 - thick]

    def at(corners: Float64, y: float) -> Float64:
        return np.stack([corners[:, 0], np.full(4, y), corners[:, 1]], axis=1)

    high_out, high_in, low_in = at(outer, top), at(inner, top), at(inner, top - drop)
    after = [1, 2, 3, 0]
    coping = np.stack([high_out, high_out[after], high_in[after], high_in], axis=1)
    inside = np.stack([high_in, high_in[after], low_in[after], low_in], axis=1)
    made.add("trim", quads(coping))
    made.add("wall", quads(inside))
    made.add("roof", quads(low_in[None]))
    made.roof = (width / 2 - 1.0, depth / 2 - 1.0, top - drop)


def _fire_escape(made: Building, depth: float, floors: Float64, *, x: float) -> None:
    """Iron landings and ladders in front of the windows."""
    z, half, out = depth / 2, 1.7, 1.1
    for level, y in enumerate(floors.tolist()):
        made.add("metal", box([x - half, y - 0.06, z + 0.02], [x + half, y, z + out]))
        rails = [
            ([x - half, y + 0.95, z + out - 0.05], [x + half, y + 1.0, z + out]),
            ([x - half, y + 0.95, z], [x - half + 0.05, y + 1.0, z + out]),
            ([x + half - 0.05, y + 0.95, z], [x + half, y + 1.0, z + out]),
            ([x - half, y, z + out - 0.05], [x - half + 0.05, y + 0.95, z + out]),
            ([x + half - 0.05, y, z + out - 0.05], [x + half, y + 0.95, z + out]),
        ]
        made.add("metal", boxes([low for low, _ in rails], [high for _, high in rails]))
        if level:
            slant = 1.1 if level % 2 else -1.1
            below = float(floors[level - 1])
            for side in (0.35, 0.8):
                foot, head = [x - slant, below, z + side], [x + slant, y, z + side]
                made.add("metal", _plank(foot, head))


def _plank(foot: list[float], head: list[float]) -> Soup:
    """A ladder's string from foot to head."""
    lift = np.array([0.0, 0.14, 0.0])
    across = np.array([0.0, 0.0, 0.05])
    low, high = np.array(foot), np.array(head)
    front = [low + across, high + across, high + across + lift, low + across + lift]
    back = [low + lift, high + lift, high, low]
    top = [low + across + lift, high + across + lift, high + lift, low + lift]
    under = [low, high, high + across, low + across]
    sides = np.array([front, back, top, under])
    return quads(sides if high[0] > low[0] else sides[:, ::-1])


Kind = Callable[[Rng, float, float], Building]
KINDS: dict[str, Kind] = {"house": house, "walkup": walkup, "office": office, "tower": tower}
