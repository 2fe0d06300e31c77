"""The racing car's corners: wheels, brakes, wishbones, springs and dampers."""

from __future__ import annotations

import math

import numpy as np

from visref_datasets_gen.assembly import Assembly, Colour, Place, facing
from visref_datasets_gen.shapes import Soup, merge, moved
from visref_datasets_gen.solids import (
    annulus,
    chords,
    framed,
    nut,
    revolved,
    rod,
    rounded_box,
    spring,
    torus,
    tube,
)

RUBBER: Colour = (0.03, 0.03, 0.03)
MAGNESIUM: Colour = (0.30, 0.27, 0.22)
STEEL: Colour = (0.42, 0.43, 0.45)
CARBON: Colour = (0.06, 0.06, 0.07)
SPRING: Colour = (0.70, 0.55, 0.08)
DISC: Colour = (0.16, 0.15, 0.15)

# z of the axle, x of the tyre's middle, and the tyre's half width.
AXLES = {"front": (1.45, 0.72, 0.16), "rear": (-1.62, 0.70, 0.19)}
RADIUS_M = 0.33
RIM_M = 0.19


def fit(made: Assembly, *, lettering: bool) -> None:
    """Put all four on. `lettering`: the tyres bear letters, a shape of their own."""
    for name, (z, x, half) in AXLES.items():
        left: Place = (x, RADIUS_M, z)
        right: Place = (-x, RADIUS_M, z)
        for part, (soup, colour) in _wheel(half, made.fine).items():
            if part == "lettering" and not lettering:
                continue
            made.put(f"{name}-{part}", soup, colour, [left, right], ("+x", "-x"))
        _suspension(made, name, z, x - half)


def _wheel(half: float, fine: float) -> dict[str, tuple[Soup, Colour]]:
    """A wheel about y, its outside up, around the origin."""
    shoulder = np.linspace(0.0, math.pi / 2, chords(9, fine, 2)).tolist()
    side = [(RIM_M + 0.012, half - 0.02), (RIM_M + 0.05, half)]
    crown = [(RADIUS_M - 0.04 + 0.04 * math.sin(a), half - 0.04 + 0.04 * math.cos(a))
             for a in shoulder]  # fmt: skip
    # Four grooves in the tread, as the rules of the day had them.
    grooves = []
    for y in np.linspace(0.65, -0.65, 4) * (half - 0.03):
        grooves += [(RADIUS_M, y + 0.008), (RADIUS_M - 0.006, y + 0.006),
                    (RADIUS_M - 0.006, y - 0.006), (RADIUS_M, y - 0.008)]  # fmt: skip
    upper = [*side, *crown]
    profile = [*upper, *grooves, *((r, -y) for r, y in upper[::-1])]
    barrel = annulus([(RIM_M, -half + 0.01), (RIM_M + 0.012, -half + 0.01),
                      (RIM_M - 0.015, -half + 0.06), (RIM_M - 0.015, half - 0.06),
                      (RIM_M + 0.012, half - 0.01), (RIM_M, half - 0.01),
                      (RIM_M - 0.025, half - 0.06), (RIM_M - 0.025, -half + 0.06)],
                     chords(120, fine))  # fmt: skip
    spokes = []
    for turn in (2.0 * math.pi * np.arange(10) / 10).tolist():
        c, s = math.cos(turn), math.sin(turn)
        spokes.append(tube([(0.03 * c, half - 0.03, 0.03 * s), (0.1 * c, half - 0.015, 0.1 * s),
                            (0.17 * c, half - 0.05, 0.17 * s)], 0.014, fine, bends=16,
                           sides=14))  # fmt: skip
    hub = revolved(
        [(0.05, half - 0.06), (0.055, half - 0.03), (0.04, half - 0.01)], chords(64, fine)
    )
    slots = chords(180, fine, 12)
    angle = 2.0 * math.pi * np.arange(slots) / slots
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    disc = framed(0.14 * circle, 0.075 * circle, half - 0.13, half - 0.10)
    bell = annulus([(0.03, half - 0.12), (0.08, half - 0.12), (0.07, half - 0.07),
                    (0.03, half - 0.07)], chords(80, fine))  # fmt: skip
    body = rounded_box((0.09, half - 0.15, -0.05), (0.16, half - 0.08, 0.05), 0.012, 2 * fine)
    pots = [moved(rod(0.014, 0.02, fine), (0.12, half - 0.085, z)) for z in (-0.025, 0.025)]
    post = rounded_box((-0.05, half - 0.2, -0.16), (0.05, half - 0.14, 0.16), 0.02, 2 * fine)
    bearing = moved(rod(0.05, 0.1, fine, 60), (0.0, half - 0.2, 0.0))
    duct = merge(
        [rounded_box((-0.1, half - 0.24, 0.05), (0.1, half - 0.14, 0.14), 0.015, 2 * fine)]
    )
    letters = annulus([(0.24, half - 0.001), (0.29, half - 0.001), (0.29, half + 0.001),
                       (0.24, half + 0.001)], chords(150, fine, 10))  # fmt: skip
    return {
        "lettering": (letters, SPRING),
        "tyre": (annulus(profile, chords(150, fine, 10)), RUBBER),
        "rim": (merge([barrel, *spokes]), MAGNESIUM),
        "hub": (hub, STEEL),
        "wheel-nut": (moved(nut(0.03, 0.02, 3.0 * fine), (0, half - 0.012, 0)), SPRING),
        "disc": (disc, DISC),
        "bell": (bell, STEEL),
        "caliper": (merge([body, *pots]), SPRING),
        "upright": (merge([post, bearing]), STEEL),
        "duct": (duct, CARBON),
    }


def _suspension(made: Assembly, name: str, z: float, outer: float) -> None:
    """Both sides: wishbones of two legs, pushrod, track rod, spring over damper, and joints."""
    fine = made.fine
    inner = 0.17 if name == "front" else 0.13
    up, low = 0.45, 0.18
    hub = (outer, up, z)
    foot = (outer, low, z)
    bars = {
        "wishbone-upper": [[(inner, 0.45, z + 0.25), hub], [(inner, 0.45, z - 0.22), hub]],
        "wishbone-lower": [[(inner, 0.21, z + 0.28), foot], [(inner, 0.21, z - 0.25), foot]],
        "pushrod": [[(inner + 0.02, 0.5, z - 0.05), (outer - 0.02, 0.22, z)]],
        "track-rod": [[(inner, 0.33, z + 0.1), (outer, 0.33, z + 0.09)]],
    }
    for label, legs in bars.items():
        soup = merge([tube([a, np.add(a, b) / 2.0, b], 0.011, fine, bends=24, sides=22)
                      for a, b in legs])  # fmt: skip
        made.add_pair(f"{name}-{label}", soup, CARBON)
    at = (0.07, 0.50 if name == "front" else 0.36, z + 0.04)
    coil = facing(spring(0.022, 0.004, 0.17, 8, fine), "+z")
    made.add_pair(f"{name}-spring", moved(coil, at), SPRING)
    damper = revolved([(0.008, 0), (0.014, 0.01), (0.014, 0.11), (0.005, 0.12), (0.005, 0.19),
                       (0.012, 0.2)], chords(50, fine))  # fmt: skip
    made.add_pair(f"{name}-damper", moved(facing(damper, "+z"), at), STEEL)
    rocker = rounded_box(
        (0.05, at[1] - 0.03, z - 0.05), (0.16, at[1] + 0.01, z + 0.02), 0.008, 2 * fine
    )
    made.add_pair(f"{name}-rocker", rocker, STEEL)
    joint = torus(0.012, 0.007, fine)
    ends = [(side * x, y, z + dz) for side in (1.0, -1.0)
            for x, y, dz in ((outer, up, 0.0), (outer, low, 0.0), (outer, 0.33, 0.09))]  # fmt: skip
    made.put(f"{name}-joint", joint, STEEL, ends)
