"""What the portable stereo holds: speakers, cassette deck, batteries, and four circuit boards."""

from __future__ import annotations

import math

import numpy as np

from visref_datasets_gen.assembly import Assembly, Colour, Place, facing
from visref_datasets_gen.shapes import Soup, box, boxes, merge, moved
from visref_datasets_gen.solids import (
    annulus,
    chords,
    finned,
    gear,
    nut,
    revolved,
    rod,
    rounded_box,
    screw,
    spring,
    swept,
    torus,
    tube,
)

CHROME: Colour = (0.72, 0.73, 0.75)
STEEL: Colour = (0.35, 0.36, 0.38)
PLASTIC: Colour = (0.10, 0.10, 0.11)
BOARD: Colour = (0.08, 0.30, 0.14)
COPPER: Colour = (0.60, 0.32, 0.14)
PAPER: Colour = (0.22, 0.20, 0.18)
IVORY: Colour = (0.70, 0.62, 0.45)
BLUE: Colour = (0.12, 0.18, 0.45)

SPEAKER_X_MM = (-210.0, 210.0)
SITE_MM = 14.0  # between components on a board

# Boards: the middle of their upper side, half extents along and across, and its normal.
_BOARDS: dict[str, tuple[Place, tuple[float, float], str]] = {
    "main": ((0.0, -12.0, -16.0), (112.0, 52.0), "+z"),
    "tuner": ((0.0, 98.0, 16.0), (112.0, 50.0), "-y"),
    "amplifier": ((-214.0, -102.0, -38.0), (88.0, 34.0), "+y"),
    "supply": ((214.0, -102.0, -38.0), (88.0, 34.0), "+y"),
}


def furnish(made: Assembly, rng: np.random.Generator, shapes: int, fitted: bool) -> None:
    """Fill the case; components on the boards make up the number of shapes. `fitted`: a speaker's
    cone and basket are one piece."""
    _speakers(made, fitted)
    _deck(made)
    _power(made)
    _wires(made, rng)
    _boards(made, rng, shapes)


def _speakers(made: Assembly, fitted: bool) -> None:
    fine = made.fine
    front: list[Place] = [(x, 0.0, 0.0) for x in SPEAKER_X_MM]
    # Cone and surround, which close the panel's hole, and the basket.
    radius = np.linspace(82.0, 22.0, chords(34, fine, 3))
    sink = 68.0 - 26.0 * ((82.0 - radius) / 60.0) ** 0.7 + 2.2 * np.sin(radius / 2.6)
    top = [(84.0, 69.5), *zip(radius.tolist(), sink.tolist(), strict=True)]
    dust = [(20.0, 45.0), (14.0, 50.0), (7.0, 53.0), (1.0, 54.0)]
    if fitted:
        back = [(1.0, 12.0), (40.0, 12.0), (84.0, 58.0), (92.0, 62.0), (92.0, 66.0)]
        made.put("driver", revolved([*back, *top, *dust], chords(90, fine)), PAPER, front, "+z")
    else:
        back = [(1.0, 40.0), *((r, s - 3.0) for r, s in top[::-1])]
        made.put("cone", revolved([*back, *top, *dust], chords(90, fine)), PAPER, front, "+z")
        basket = [(20.0, 12.0), (40.0, 12.0), (84.0, 58.0), (92.0, 62.0), (92.0, 66.0),
                  (84.0, 66.0), (38.0, 18.0), (20.0, 18.0)]  # fmt: skip
        made.put("basket", annulus(basket, chords(90, fine)), STEEL, front, "+z")
    made.put("magnet", annulus([(12, -22), (44, -22), (46, -20), (46, 8), (44, 10), (12, 10)],
                               chords(80, fine)), PLASTIC, front, "+z")  # fmt: skip
    made.put("pole", rod(11.0, 40.0, fine, 56), STEEL, [(x, 0.0, -22.0) for x in SPEAKER_X_MM],
             "+z")  # fmt: skip
    coil = annulus([(13, 12), (15, 12), *((15.6 - 0.6 * (k % 2), 13 + k) for k in range(26)),
                    (13, 39)], chords(60, fine))  # fmt: skip
    made.put("voice-coil", coil, COPPER, front, "+z")
    bolts = [
        (x + 88.0 * math.cos(a), 88.0 * math.sin(a), 58.0)
        for x in SPEAKER_X_MM
        for a in (math.pi * np.arange(0.5, 8.0) / 4.0).tolist()
    ]
    made.put("speaker-screw", screw(2.0, 10.0, fine), STEEL, bolts, "-z")


def _deck(made: Assembly) -> None:
    """The cassette deck behind its door."""
    fine = made.fine
    plate = rounded_box((-74, 30, -40), (74, 34, 40), 1.5, fine)
    made.put("deck-plate", plate, STEEL, [(0.0, -22.0, 0.0)], "+z")
    reels: list[Place] = [(-22.0, -18.0, 34.0), (22.0, -18.0, 34.0)]
    made.put("reel", gear(9.0, 6, 18.0, 3.0, 2.0 * fine), IVORY, reels, "+z")
    wheels: list[Place] = [(x, y, 24.0) for x, y, _ in reels]
    made.put("reel-gear", gear(16.0, 44, 4.0, 5.0, fine), IVORY, wheels, "+z")
    train: list[Place] = [(-40.0, -34.0, 22.0), (0.0, -40.0, 22.0), (40.0, -34.0, 22.0)]
    made.put("gear", gear(12.0, 32, 4.0, 3.0, fine), IVORY, train, "+z")
    made.put("pinion", gear(5.0, 14, 7.0, 1.5, fine), CHROME, train, "+z")
    wheels = [(-30.0, -46.0, 8.0), (30.0, -46.0, 8.0)]
    made.put("flywheel", annulus([(2.5, 0), (22, 0), (24, 2), (24, 9), (22, 11), (2.5, 11)],
                                 chords(70, fine)), STEEL, wheels, "+z")  # fmt: skip
    spindles = [(x, y, 4.0) for x, y, _ in wheels]
    made.put("capstan", rod(2.2, 56.0, fine, 28), CHROME, spindles, "+z")
    made.put("pinch-roller", rod(7.0, 12.0, fine, 44), PLASTIC,
             [(-38.0, -55.0, 38.0), (38.0, -55.0, 38.0)], "+z")  # fmt: skip
    motor = revolved([(15, 0), (17, 2), (17, 24), (15, 26), (6, 26), (6, 29), (2, 29), (2, 36)],
                     chords(60, fine))  # fmt: skip
    made.put("motor", motor, CHROME, [(60.0, 20.0, -6.0)], "+z")
    made.put("belt", torus(34.0, 1.2, fine), PLASTIC, [(0.0, -46.0, 12.0), (0.0, -46.0, 16.0)],
             "+z")  # fmt: skip
    head = merge([rounded_box((-12, 34, -8), (12, 48, 4), 2.0, fine),
                  rounded_box((-5, 40, 3), (5, 50, 7), 1.0, fine)])  # fmt: skip
    made.put("head", head, CHROME, [(0.0, -58.0, 0.0)], "+z")
    levers = [(-70.0 + 20.0 * k, -78.0, 44.0) for k in range(8)]
    lever = tube([(0, 0, 0), (0, 6, -8), (4, 14, -10), (4, 26, -4)], 1.6, fine, bends=40)
    made.put("lever", lever, STEEL, levers)
    coil = spring(3.0, 0.45, 14.0, 9, fine)
    made.put("lever-spring", coil, STEEL, [(x + 8.0, y, z) for x, y, z in levers], "-z")
    posts = [(sx * 66.0, -22.0 + sy * 34.0, 30.0) for sx in (-1, 1) for sy in (-1, 1)]
    made.put("deck-screw", screw(1.8, 8.0, fine), STEEL, [(x, y, 34.0) for x, y, _ in posts], "+z")
    made.put("deck-nut", nut(3.4, 2.6, fine), STEEL, [(x, y, 27.0) for x, y, _ in posts], "+z")


def _power(made: Assembly) -> None:
    fine = made.fine
    cells = [(-118.0 + 60.0 * (k % 4), -86.0 + 36.0 * (k // 4), -55.0) for k in range(8)]
    cell = revolved(
        [(15.6, 0), (16.4, 0.8), (16.4, 52), (15.6, 53), (6, 53), (6, 55.5), (5, 56.5)],
        chords(56, fine),
    )
    made.put("cell", cell, COPPER, cells, "+x")
    contacts = [(x - 3.0, y, z) for x, y, z in cells]
    made.put("cell-spring", spring(6.0, 0.6, 5.0, 5, fine), CHROME, contacts, "+x")
    plate = rounded_box((-12, -1, -12), (12, 0, 12), 0.4, fine)
    made.put("cell-contact", plate, CHROME, contacts, "+x")
    core = merge([finned((-26, 0, -20), (26, 34, 20), 36, 3.0, 0.8),
                  box([-26, 32, -20], [26, 36, 20])])  # fmt: skip
    at = (214.0, -98.0, -38.0)
    made.put("transformer-core", core, STEEL, [at])
    winding = annulus([(8, 6), (16, 6), *((19 - 0.8 * (k % 2), 7 + k) for k in range(22)), (8, 30)],
                      chords(60, fine))  # fmt: skip
    made.put("winding", moved(winding, (0, 0, 26)), COPPER, [at])
    made.put("heat-sink", finned((-60, 0, -12), (60, 40, 12), 24, 5.0, 0.3), STEEL,
             [(-214.0, -100.0, -60.0)])  # fmt: skip


def _wires(made: Assembly, rng: np.random.Generator) -> None:
    """From the boards to speakers, deck and each other, along the case's back."""
    ends = rng.uniform((-110, -60, -10), (110, 60, 0), (26, 3))
    for k, end in enumerate(ends):
        side = 1.0 if end[0] > 0 else -1.0
        other = [(side * (150.0 + 3.0 * k), 60.0 - 5.0 * k, 4.0 + k % 5),
                 (side * 200.0, -90.0, -20.0 - k)][k % 2]  # fmt: skip
        slack = [(end[0], end[1], -30.0 - 1.2 * k), (side * 130.0, other[1] * 0.6, -34.0 - 1.2 * k)]
        colour = ((0.55, 0.08, 0.06), (0.08, 0.08, 0.08), BLUE, (0.65, 0.55, 0.10))[k % 4]
        path = [tuple(end), *slack, other]
        made.add(f"wire-{k:02d}", tube(path, 1.1, made.fine, bends=44, sides=11), colour)


def _boards(made: Assembly, rng: np.random.Generator, shapes: int) -> None:
    fine = made.fine
    sites: list[tuple[Place, str]] = []
    posts: list[tuple[Place, str]] = []
    for name, (middle, (along, across), axis) in _BOARDS.items():
        slab = rounded_box((-along, -1.6, -across), (along, 0.0, across), 0.5, fine)
        made.put(f"{name}-board", slab, BOARD, [middle], axis)
        columns, rows = int(2 * along // SITE_MM), int(2 * across // SITE_MM)
        for k in range(columns * rows):
            u = (k % columns + 0.5 - columns / 2) * SITE_MM
            v = (k // columns + 0.5 - rows / 2) * SITE_MM
            sites.append((_on(middle, axis, u, v), axis))
        posts += [(_on(middle, axis, sx * (along - 3.0), sy * (across - 3.0)), axis)
                  for sx in (-1, 1) for sy in (-1, 1)]  # fmt: skip
    places, axes = zip(*posts, strict=True)
    made.put("board-screw", screw(1.5, 7.0, fine), STEEL, places, axes)
    # Some sites stay free.
    order = rng.permutation(len(sites)).tolist()
    for kind, (soup, colour, count) in _components(fine).items():
        taken = [sites[order.pop()] for _ in range(count or shapes - made.shapes)]
        places, axes = zip(*taken, strict=True)
        made.put(kind, soup, colour, places, axes)


def _on(middle: Place, axis: str, u: float, v: float) -> Place:
    """A point of a board, `u` along and `v` across from its middle."""
    offset = facing((np.array([[u, 0.0, v]]), np.zeros((0, 3), np.int64)), axis)[0][0]
    return tuple((offset + middle).tolist())


def _components(fine: float) -> dict[str, tuple[Soup, Colour, int]]:
    """Kinds of component: (shape on y = 0, colour, how many); 0 is what the rest is."""
    leg = np.array([[x, 0, z] for x in np.arange(-5.4, 5.0, 1.8) for z in (-4.2, 3.8)])
    legs = boxes(leg, np.add(leg, (0.6, 2.5, 0.4)))
    chip = merge([rounded_box((-6, 1.5, -3.6), (6, 4.5, 3.6), 0.4, 1.2 * fine), legs])
    can = [(4.6, 0), (5.2, 0.6), (5.2, 1.6), (4.8, 2.0), (5.2, 2.4), (5.2, 12), (4.6, 12.8),
           (2, 12.6)]  # fmt: skip
    electrolytic = revolved(can, chords(44, fine))
    profile = [(0.4, -6), (0.4, -3.2), (1.2, -3.2), (1.5, -2.8), (1.5, -1.8), (1.2, -1.4),
               (1.2, 1.4), (1.5, 1.8), (1.5, 2.8), (1.2, 3.2), (0.4, 3.2), (0.4, 6)]  # fmt: skip
    body = moved(facing(revolved(profile, chords(26, fine)), "+x"), (0.0, 2.5, 0.0))
    pin = swept(
        [(0, 0, 0), (0, 1.4, 0), (0, 2.6, 0)], 0.35 * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    )
    pins = [moved(pin, (x, 0.0, 0.0)) for x in (-5.7, 5.7)]
    transistor = merge([rounded_box((-5, 4, -2), (5, 18, 2), 0.8, fine), *(
        box([x - 0.4, 0, -0.3], [x + 0.4, 4.5, 0.3]) for x in (-2.5, 0.0, 2.5))])  # fmt: skip
    choke = merge([moved(torus(4.0, 1.8, fine), (0, 2.0, 0)),
                   *(moved(facing(torus(2.1, 0.3, 0.5 * fine), "+x"), (0.0, 2.0, z))
                     for z in (-4.0, 4.0))])  # fmt: skip
    trimmer = merge([rounded_box((-4.5, 0, -4.5), (4.5, 5, 4.5), 0.6, fine),
                     moved(rod(3.0, 2.0, fine, 30), (0, 4.8, 0))])  # fmt: skip
    blade = np.array([[x, 5, -0.4] for x in (-4.5, -1.5, 1.5, 3.7)])
    socket = merge(
        [rounded_box((-6, 0, -3), (6, 6, 3), 0.5, fine), boxes(blade, np.add(blade, (0.8, 4, 0.8)))]
    )
    return {
        "chip": (chip, PLASTIC, 38),
        "capacitor": (electrolytic, BLUE, 52),
        "transistor": (transistor, PLASTIC, 14),
        "choke": (choke, COPPER, 10),
        "trimmer": (trimmer, IVORY, 8),
        "socket": (socket, IVORY, 12),
        "resistor": (merge([body, *pins]), IVORY, 0),
    }
