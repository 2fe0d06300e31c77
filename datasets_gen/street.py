"""What stands on a street or a roof: cars, trees, lamps, furniture, people.

Each is soups by material, on y = 0 around the origin; cars drive and people look towards +z.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from visref_datasets_gen.shapes import (
    Float64,
    Soup,
    box,
    boxes,
    fans,
    icosphere,
    lathe,
    loft,
    merge,
    moved,
    quads,
    ring,
)

Parts = dict[str, Soup]

# Body: z, half-width, sill height, belt height. Cabin: z of belt, z of roof, roof height.
_CARS: dict[str, tuple[list[tuple[float, float, float, float]], tuple[float, ...]]] = {
    "sedan": (
        [
            (-2.28, 0.74, 0.42, 0.78),
            (-2.15, 0.84, 0.30, 0.94),
            (-1.30, 0.89, 0.22, 0.97),
            (0.70, 0.90, 0.20, 0.92),
            (1.85, 0.86, 0.24, 0.78),
            (2.22, 0.79, 0.30, 0.66),
            (2.32, 0.66, 0.38, 0.56),
        ],
        (-1.80, -1.05, 0.35, 1.15, 1.42),
    ),
    "hatchback": (
        [
            (-1.95, 0.74, 0.40, 0.84),
            (-1.86, 0.82, 0.30, 0.98),
            (-1.10, 0.87, 0.22, 1.01),
            (0.75, 0.88, 0.20, 0.95),
            (1.60, 0.84, 0.24, 0.83),
            (1.92, 0.77, 0.30, 0.70),
            (2.02, 0.64, 0.38, 0.58),
        ],
        (-1.86, -1.45, 0.30, 1.10, 1.50),
    ),
    "van": (
        [
            (-2.50, 0.90, 0.40, 1.10),
            (-2.44, 0.95, 0.30, 1.20),
            (-1.40, 0.97, 0.24, 1.22),
            (1.20, 0.97, 0.22, 1.17),
            (2.10, 0.93, 0.26, 1.02),
            (2.42, 0.87, 0.32, 0.88),
            (2.50, 0.76, 0.40, 0.70),
        ],
        (-2.45, -2.35, 1.15, 1.75, 2.15),
    ),
}
CARS = tuple(_CARS)


def car(kind: str) -> Parts:
    """A car of about 1.8 by 4.5 m: body and cabin, windows, wheels, lamps."""
    stations, (tail, roof_back, roof_front, cowl, height) = _CARS[kind]
    rings = []
    for z, half, sill, belt in stations:
        mid = 0.55 * sill + 0.45 * belt
        right = [(0.84 * half, sill), (half, sill + 0.12), (1.02 * half, mid), (0.94 * half, belt)]
        section = right + [(-x, y) for x, y in right[::-1]]
        rings.append([(x, y, z) for x, y in section])
    wide, belt = stations[3][1], stations[3][3] - 0.06
    middle = ((tail + cowl) / 2 - 0.1, (roof_back + roof_front) / 2)
    # The cabin's right half, front to back: belt z and half-width, roof z, half-width, height.
    half_ring = np.array(
        [
            (cowl, 0.82 * wide, roof_front, 0.66 * wide, height - 0.05),
            (middle[0], 0.88 * wide, middle[1], 0.70 * wide, height),
            (tail, 0.79 * wide, roof_back, 0.64 * wide, height - 0.05),
        ]
    )
    mirrored = np.concatenate([half_ring, half_ring[::-1] * [1, -1, 1, -1, 1]])
    z_low, x_low, z_high, x_high, y_high = mirrored.T
    low = np.stack([x_low, np.full(6, belt), z_low], axis=1)
    high = np.stack([x_high, y_high, z_high], axis=1)
    crown = high * [0.92, 1.0, 0.96] + [0.0, 0.05, 0.0]
    wheels = [
        _wheel(side * (0.93 * wide - 0.1), z, radius=0.34)
        for side in (1.0, -1.0)
        for z in (0.62 * stations[0][0], 0.62 * stations[-1][0])
    ]
    front, back = stations[-2], stations[1]
    head_y, tail_y = front[3] - 0.12, back[3] - 0.2
    return {
        "paint": merge([loft(np.array(rings)), loft(np.array([low, high, crown]), caps="1")]),
        "glass": _panes(low, high),
        "rubber": merge(wheels),
        "light": boxes(
            [[side * 0.52 - 0.14, head_y - 0.1, front[0] - 0.1] for side in (1.0, -1.0)],
            [[side * 0.52 + 0.14, head_y + 0.06, front[0] + 0.06] for side in (1.0, -1.0)],
            "xXyYZ",
        ),
        "brake": boxes(
            [[side * 0.6 - 0.12, tail_y - 0.1, back[0] - 0.08] for side in (1.0, -1.0)],
            [[side * 0.6 + 0.12, tail_y + 0.08, back[0] + 0.1] for side in (1.0, -1.0)],
            "xXyYz",
        ),
    }


def _panes(low: Float64, high: Float64) -> Soup:
    """The cabin's six windows, a little smaller than its sides and a little outside them."""
    walls = np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1)
    centre = walls.mean(axis=1, keepdims=True)
    normal = np.cross(walls[:, 1] - walls[:, 0], walls[:, 3] - walls[:, 0])
    outward = normal / np.linalg.norm(normal, axis=1)[:, None]
    return quads(centre + 0.84 * (walls - centre) + 0.02 * outward[:, None])


def _wheel(x: float, z: float, *, radius: float) -> Soup:
    """An eight-sided drum on an axle along x."""
    circle = radius * ring(1.0, 8, phase=0.5)
    rings = [
        np.stack([np.full(8, at), radius + circle[:, 0], z + circle[:, 1]], axis=1)
        for at in (x - 0.11, x + 0.11)
    ]
    return loft(np.array(rings))


def tree(rng: np.random.Generator) -> Parts:
    """A trunk under an uneven crown of three clumps."""
    height = rng.uniform(2.2, 2.9)
    trunk = lathe([(0.2, 0.0), (0.09, height + 0.6)], 6, caps="")
    heading = rng.uniform(0.0, 2.0 * np.pi)
    clumps = []
    for number, (subdivisions, radius) in enumerate(((1, 1.5), (0, 1.15), (0, 1.1))):
        vertices, faces = icosphere(subdivisions)
        wobble = 1.0 + rng.uniform(-0.13, 0.13, (len(vertices), 1))
        angle = heading + np.pi * number
        shift = 0.75 * (number > 0) * np.array([np.cos(angle), 0.0, np.sin(angle)])
        centre = np.add(shift, (0.0, height + 0.9 + 0.55 * number, 0.0))
        clumps.append((vertices * wobble * radius * [1.0, 0.85, 1.0] + centre, faces))
    return {"bark": trunk, "leaf": merge(clumps)}


def conifer(rng: np.random.Generator) -> Parts:
    """Four stacked cones on a trunk."""
    cones = []
    for level in range(4):
        base, radius = 1.1 + 1.15 * level, 1.5 - 0.32 * level
        jitter = rng.uniform(0.9, 1.1)
        cones.append(lathe([(radius * jitter, base), (0.05, base + 1.75)], 9, caps="0"))
    return {"bark": lathe([(0.17, 0.0), (0.12, 1.3)], 6, caps=""), "leaf": merge(cones)}


def lamp() -> Parts:
    """A street lamp whose arm reaches over the road (+z)."""
    pole = lathe([(0.14, 0.0), (0.13, 0.6), (0.05, 5.6)], 6, caps="1")
    arm = boxes([[-0.04, 5.5, -0.04], [-0.1, 5.48, 1.15]], [[0.04, 5.58, 1.2], [0.1, 5.66, 1.85]])
    return {"metal": merge([pole, arm]), "light": box([-0.07, 5.44, 1.2], [0.07, 5.48, 1.8])}


def traffic_light() -> Parts:
    """A mast with a signal over the near lane (+z)."""
    pole = lathe([(0.11, 0.0), (0.08, 5.2)], 6, caps="1")
    arm = box([-0.05, 5.0, 0.0], [0.05, 5.1, 3.4])
    heads = boxes([[-0.17, 4.3, 3.2], [-0.17, 2.4, 0.1]], [[0.17, 5.3, 3.5], [0.17, 3.4, 0.4]])
    lights = [
        (y, z) for z in (3.35, 0.25) for y in ((4.5, 4.8, 5.1) if z > 1.0 else (2.6, 2.9, 3.2))
    ]
    eyes = boxes(
        [[-0.2, y - 0.1, z - 0.1] for y, z in lights],
        [[0.2, y + 0.1, z + 0.1] for y, z in lights],
        "xX",
    )
    return {"metal": merge([pole, arm]), "rubber": heads, "light": eyes}


def bench() -> Parts:
    """Slats on two frames, facing +z."""
    slats = boxes(
        [[-0.9, 0.42, z] for z in (0.0, 0.16, 0.32)] + [[-0.9, y, -0.1] for y in (0.6, 0.78)],
        [[0.9, 0.46, z + 0.12] for z in (0.0, 0.16, 0.32)]
        + [[0.9, y + 0.13, -0.06] for y in (0.6, 0.78)],
    )
    legs = boxes(
        [[x, 0.0, z] for x in (-0.7, 0.62) for z in (-0.08, 0.3)],
        [[x + 0.08, h, z + 0.06] for x in (-0.7, 0.62) for z, h in ((-0.08, 0.9), (0.3, 0.42))],
        "xXYzZ",
    )
    return {"bark": slats, "metal": legs}


def hydrant() -> Parts:
    """A fire hydrant."""
    profile = [(0.16, 0.0), (0.16, 0.06), (0.11, 0.08), (0.11, 0.55), (0.15, 0.57), (0.1, 0.7)]
    cap = box([-0.2, 0.36, -0.06], [0.2, 0.48, 0.06])
    return {"brake": merge([lathe([*profile, (0.03, 0.78)], 8, caps="1"), cap])}


def litter_bin() -> Parts:
    """A litter bin."""
    return {"metal": lathe([(0.24, 0.0), (0.3, 0.85), (0.32, 0.85), (0.2, 1.05)], 8, caps="1")}


def shelter() -> Parts:
    """A bus shelter that opens to +z."""
    frame = boxes(
        [
            [-1.9, 0.0, -0.7],
            [1.82, 0.0, -0.7],
            [-1.9, 0.0, 0.5],
            [1.82, 0.0, 0.5],
            [-2.0, 2.4, -0.8],
        ],
        [
            [-1.82, 2.4, -0.62],
            [1.9, 2.4, -0.62],
            [-1.82, 2.4, 0.58],
            [1.9, 2.4, 0.58],
            [2.0, 2.52, 0.8],
        ],
    )
    panes = boxes(
        [[-1.8, 0.25, -0.68], [-1.88, 0.25, -0.6], [1.84, 0.25, -0.6]],
        [[1.8, 2.25, -0.65], [-1.85, 2.25, 0.48], [1.87, 2.25, 0.48]],
    )
    seat = box([-1.4, 0.45, -0.55], [1.4, 0.5, -0.2])
    return {"metal": merge([frame, seat]), "glass": panes}


def person(rng: np.random.Generator) -> Parts:
    """A walking figure: two legs, a torso with arms, a head."""
    step = float(rng.uniform(0.1, 0.3))
    legs = []
    for side, z in ((0.1, step), (-0.1, -step)):
        rings = []
        for r, y, s in ((0.07, 0.0, 1.0), (0.08, 0.45, 0.45), (0.1, 0.86, 0.0)):
            circle = ring(r, 6)
            rings.append(
                np.stack([side + circle[:, 0], np.full(6, y), s * z - circle[:, 1]], axis=1)
            )
        legs.append(loft(np.array(rings)))
    torso = lathe([(0.17, 0.82), (0.15, 1.05), (0.2, 1.35), (0.1, 1.48)], 8, caps="1")
    flat = (torso[0] * [1.15, 1.0, 0.72], torso[1])
    arms = []
    for side in (1.0, -1.0):
        shoulder = np.array([side * 0.25, 1.38, 0.0])
        hand = np.array([side * 0.28, 0.8, -side * step])
        circle = ring(0.055, 5)
        disc = np.stack([circle[:, 0], np.zeros(5), -circle[:, 1]], axis=1)
        arms.append(loft(np.array([hand + 0.8 * disc, shoulder + disc])))
    vertices, faces = icosphere(0)
    head = (vertices * [0.105, 0.13, 0.115] + [0.0, 1.63, 0.01], faces)
    return {"cloth": merge([flat, *arms]), "trousers": merge(legs), "skin": head}


def air_conditioner() -> Parts:
    """A roof unit with two fans."""
    body = box([-1.3, 0.0, -0.7], [1.3, 1.25, 0.7], "xXYzZ")
    fan = lathe([(0.5, 0.0), (0.5, 0.2)], 8, caps="1")
    return {
        "metal": body,
        "rubber": merge([moved(fan, (x, 1.25, 0.0)) for x in (-0.62, 0.62)]),
    }


def water_tank() -> Parts:
    """A wooden tank with a pointed roof on four legs."""
    legs = boxes(
        [[x - 0.08, 0.0, z - 0.08] for x in (-0.9, 0.9) for z in (-0.9, 0.9)],
        [[x + 0.08, 2.0, z + 0.08] for x in (-0.9, 0.9) for z in (-0.9, 0.9)],
        "xXzZ",
    )
    return {
        "bark": lathe([(1.4, 2.0), (1.45, 2.05), (1.4, 4.3)], 12),
        "roof": lathe([(1.6, 4.25), (0.05, 5.3)], 12, caps="0"),
        "metal": merge([legs, box([-1.3, 1.9, -1.3], [1.3, 2.0, 1.3])]),
    }


def stair_head() -> Parts:
    """The hut over a stair to the roof, its door towards +z."""
    return {
        "brick": box([-1.4, 0.0, -1.8], [1.4, 2.6, 1.8], "xXYzZ"),
        "roof": box([-1.6, 2.6, -2.0], [1.6, 2.75, 2.0]),
        "door": box([-0.5, 0.0, 1.8], [0.5, 2.1, 1.86], "xXYZ"),
    }


def skylight() -> Parts:
    """A glazed ridge on a kerb."""
    kerb = box([-1.0, 0.0, -1.6], [1.0, 0.35, 1.6], "xXzZ")
    slopes = quads(
        [
            [[1.0, 0.35, 1.6], [1.0, 0.35, -1.6], [0.0, 0.95, -1.6], [0.0, 0.95, 1.6]],
            [[-1.0, 0.35, -1.6], [-1.0, 0.35, 1.6], [0.0, 0.95, 1.6], [0.0, 0.95, -1.6]],
        ]
    )
    ends = fans(
        [
            [[-1.0, 0.35, 1.6], [1.0, 0.35, 1.6], [0.0, 0.95, 1.6]],
            [[1.0, 0.35, -1.6], [-1.0, 0.35, -1.6], [0.0, 0.95, -1.6]],
        ]
    )
    return {"trim": kerb, "glass": merge([slopes, ends])}


VARIED: dict[str, Callable[[np.random.Generator], Parts]] = {
    "tree": tree,
    "conifer": conifer,
    "person": person,
}
PROPS: dict[str, Callable[[], Parts]] = {
    "lamp": lamp,
    "traffic_light": traffic_light,
    "bench": bench,
    "hydrant": hydrant,
    "bin": litter_bin,
    "shelter": shelter,
    "air_conditioner": air_conditioner,
    "water_tank": water_tank,
    "stair_head": stair_head,
    "skylight": skylight,
}
