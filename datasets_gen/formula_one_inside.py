"""What the racing car's bodywork covers: driver, tank, engine, gearbox, coolers, wiring."""

from __future__ import annotations

import math

import numpy as np

from visref_datasets_gen.assembly import Assembly, Colour, facing
from visref_datasets_gen.hulls import hull
from visref_datasets_gen.shapes import Soup, boxes, icosphere, merge, moved
from visref_datasets_gen.solids import (
    annulus,
    chords,
    curve,
    finned,
    gear,
    nut,
    revolved,
    rod,
    rounded_box,
    screw,
    thick,
    torus,
    tube,
)

METAL: Colour = (0.45, 0.46, 0.48)
DARK: Colour = (0.12, 0.12, 0.13)
RED: Colour = (0.62, 0.05, 0.04)
BLUE: Colour = (0.08, 0.14, 0.42)
WHITE: Colour = (0.80, 0.80, 0.78)
BRASS: Colour = (0.52, 0.38, 0.14)
RUST: Colour = (0.34, 0.20, 0.13)

CYLINDERS = 10
BANK_X_M = 0.12


def furnish(made: Assembly, rng: np.random.Generator) -> None:
    _driver(made)
    _engine(made)
    _gearbox(made)
    _cooling(made)
    _electrics(made, rng)


def _ball(radius: tuple[float, float, float], at: tuple[float, float, float], fine: float) -> Soup:
    """An ellipsoid."""
    vertices, faces = icosphere(min(5, max(1, round(math.log2(16 * fine)))))
    return vertices * np.array(radius) + np.array(at), faces


def _driver(made: Assembly) -> None:
    fine = made.fine
    made.add("helmet", _ball((0.12, 0.14, 0.14), (0.0, 0.74, -0.08), fine), WHITE)
    made.add("visor", _ball((0.085, 0.035, 0.06), (0.0, 0.76, 0.01), 0.5 * fine), DARK)
    made.add("torso", _ball((0.19, 0.24, 0.15), (0.0, 0.42, -0.12), fine), RED)
    arm = [(0.19, 0.55, -0.1), (0.25, 0.42, 0.1), (0.14, 0.52, 0.30)]
    made.add_pair("arm", tube(arm, 0.045, fine, bends=40, sides=30), RED)
    made.add_pair("glove", _ball((0.045, 0.05, 0.05), (0.14, 0.53, 0.33), 0.5 * fine), DARK)
    leg = [(0.1, 0.24, -0.1), (0.12, 0.36, 0.45), (0.1, 0.24, 0.95)]
    made.add_pair("leg", tube(leg, 0.06, fine, bends=50, sides=30), RED)
    made.add_pair("boot", rounded_box((0.06, 0.18, 0.93), (0.14, 0.32, 1.02), 0.02, 2 * fine), DARK)
    back = curve(
        [(0, 0.15, 0.15), (0, 0.13, -0.15), (0, 0.3, -0.27), (0, 0.62, -0.30)], chords(60, fine)
    )
    seat = np.stack(
        [np.add(back, (x, 1.2 * x * x, 0)) for x in np.linspace(-0.24, 0.24, chords(40, fine))]
    )
    made.add("seat", thick(seat, np.add(seat, (0, -0.012, -0.012))), DARK)
    made.add("headrest", rounded_box((-0.2, 0.62, -0.31), (0.2, 0.72, -0.24), 0.02, 2 * fine), BLUE)
    strap = rounded_box((0.06, 0.36, 0.0), (0.1, 0.6, 0.03), 0.006, fine)
    made.add_pair("harness", strap, BLUE)
    rim = facing(torus(0.12, 0.016, fine), "+z")
    plate = rounded_box((-0.09, 0.49, 0.33), (0.09, 0.58, 0.36), 0.01, 2 * fine)
    made.add("steering-wheel", merge([moved(rim, (0.0, 0.54, 0.35)), plate]), DARK)
    dials = [(-0.06 + 0.04 * k, 0.51 + 0.05 * row, 0.33) for row in (0, 1) for k in range(4)]
    made.put("dial", rod(0.009, 0.012, fine), RED, dials, "-z")
    column = facing(rod(0.014, 0.5, fine, 40), "+z")
    made.add("steering-column", moved(column, (0.0, 0.5, 0.36)), METAL)
    rack = merge([moved(facing(rod(0.025, 0.3, fine, 40), "+x"), (-0.15, 0.34, 1.16)),
                  moved(gear(0.03, 20, 0.04, 0.01, fine), (0.0, 0.34, 1.16))])  # fmt: skip
    made.add("steering-rack", rack, METAL)
    pedals = [(-0.09, 0.2, 1.08), (0.0, 0.2, 1.08), (0.09, 0.2, 1.08)]
    made.put(
        "pedal", rounded_box((-0.03, 0, -0.01), (0.03, 0.14, 0.01), 0.006, 2 * fine), METAL, pedals
    )
    cylinder = revolved([(0.012, 0), (0.02, 0.01), (0.02, 0.1), (0.01, 0.11), (0.01, 0.15)],
                        chords(40, fine))  # fmt: skip
    made.put("master-cylinder", cylinder, METAL, [(x, y + 0.05, z) for x, y, z in pedals], "+z")


def _engine(made: Assembly) -> None:
    """A V10 behind the tank: five cylinders per bank, its trumpets in the airbox."""
    fine = made.fine
    tank = rounded_box((-0.27, 0.1, -0.62), (0.27, 0.6, -0.37), 0.06, 4 * fine)
    made.add("fuel-tank", tank, DARK)
    block = merge([rounded_box((-0.16, 0.12, -1.25), (0.16, 0.3, -0.66), 0.02, 3 * fine),
                   *(rounded_box((-0.17, 0.13, z), (0.17, 0.28, z + 0.015), 0.004, fine)
                     for z in np.arange(-1.2, -0.68, 0.06))])  # fmt: skip
    made.add("crankcase", block, METAL)
    made.add("sump", finned((-0.14, 0.085, -1.22), (0.14, 0.125, -0.7), 40, 0.01, 0.5), METAL)
    head = rounded_box((0.05, 0.3, -1.24), (0.19, 0.38, -0.67), 0.02, 3 * fine)
    made.add_pair("head", head, METAL)
    cover = rounded_box((0.06, 0.375, -1.23), (0.18, 0.42, -0.68), 0.018, 3 * fine)
    made.add_pair("cam-cover", cover, RED)
    z = [-0.72 - 0.115 * k for k in range(CYLINDERS // 2)]
    banks = [(side * BANK_X_M, at) for side in (1.0, -1.0) for at in z]
    flare = np.linspace(0.0, math.pi / 2, chords(12, fine, 3)).tolist()
    trumpet = annulus(
        [(0.024, 0.0), (0.027, 0.0), (0.027, 0.09),
         *((0.027 + 0.02 * math.sin(a), 0.13 - 0.04 * math.cos(a)) for a in flare),
         *((0.024 + 0.02 * math.sin(a), 0.133 - 0.04 * math.cos(a)) for a in flare[::-1]),
         (0.024, 0.09)],
        chords(56, fine),
    )  # fmt: skip
    made.put("trumpet", trumpet, METAL, [(0.5 * x, 0.42, at) for x, at in banks])
    injector = revolved([(0.004, 0), (0.008, 0.01), (0.008, 0.05), (0.005, 0.06)], chords(28, fine))
    made.put("injector", injector, BRASS, [(0.2 * x, 0.43, at - 0.03) for x, at in banks])
    coil = revolved([(0.008, 0), (0.014, 0.02), (0.014, 0.05), (0.02, 0.055), (0.02, 0.08)],
                    chords(40, fine))  # fmt: skip
    made.put("ignition-coil", coil, DARK, [(x, 0.405, at) for x, at in banks])
    lands = [(0.045 - 0.003 * (k % 2), 0.01 + 0.006 * k) for k in range(6)]
    piston = annulus([(0.01, 0), (0.045, 0), *lands, (0.045, 0.055), (0.01, 0.055)],
                     chords(56, fine))  # fmt: skip
    made.put("piston", piston, METAL, [(0.9 * x, 0.24, at) for x, at in banks])
    bolt_z = np.linspace(-1.22, -0.69, 4).tolist()
    bolts = [(side * x, 0.422, at) for side in (1.0, -1.0) for x in (0.07, 0.17) for at in bolt_z]
    made.put("cover-bolt", screw(0.004, 0.012, fine), METAL, bolts)
    for k, at in enumerate(z):
        bend = [(0.18, 0.34, at), (0.25 + 0.01 * k, 0.30, at - 0.05), (0.24, 0.24, at - 0.2),
                (0.21, 0.27, -1.36)]  # fmt: skip
        made.add_pair(f"exhaust-{k}", tube(bend, 0.019, fine, bends=54, sides=26), RUST)
    collector = facing(revolved([(0.05, 0), (0.05, 0.06), (0.035, 0.12)], chords(48, fine)), "-z")
    made.add_pair("collector", moved(collector, (0.21, 0.27, -1.28)), RUST)
    airbox = rounded_box((-0.13, 0.56, -1.1), (0.13, 0.66, -0.66), 0.04, 3 * fine)
    made.add("airbox", airbox, DARK)
    snorkel = tube(
        [(0, 0.82, -0.36), (0, 0.78, -0.6), (0, 0.66, -0.75)], 0.08, fine, bends=60, sides=50
    )
    made.add("snorkel", snorkel, DARK)
    pump = revolved([(0.02, 0), (0.03, 0.005), (0.03, 0.09), (0.015, 0.1)], chords(48, fine))
    pumps = [(x, 0.16, at) for at in (-1.2, -0.95) for x in (0.19, -0.19)]
    made.put("oil-pump", pump, METAL, pumps, "+z")


def _gearbox(made: Assembly) -> None:
    fine = made.fine
    case = [(-1.27, 0.17, 0.13, 0.53, 3.3), (-1.45, 0.14, 0.13, 0.53, 3.3),
            (-1.75, 0.11, 0.13, 0.49, 3.3), (-1.95, 0.08, 0.13, 0.47, 3.3)]  # fmt: skip
    made.add("gearbox", hull(case, 0.8 * fine), METAL)
    made.put("clutch", facing(gear(0.07, 48, 0.03, 0.02, fine), "+z"), METAL, [(0.0, 0.22, -1.26)])
    cogs = [(0.03 * (-1) ** k, 0.22, -1.40 - 0.05 * k) for k in range(7)]
    made.put("cog", gear(0.045, 30, 0.018, 0.012, fine), METAL, cogs, "+z")
    made.put("differential", moved(rod(0.07, 0.18, fine, 80), (0, -0.09, 0)), METAL,
             [(0.0, 0.25, -1.62)], "+x")  # fmt: skip
    bellows = [(0.04 - 0.008 * (k % 2), 0.01 * k) for k in range(1, 7)]
    boot = annulus([(0.01, 0), (0.04, 0), *bellows, (0.02, 0.07), (0.01, 0.07)], chords(48, fine))
    shaft = merge([facing(rod(0.014, 0.42, fine, 40), "+x"), facing(boot, "+x"),
                   moved(facing(boot, "-x"), (0.42, 0, 0))])  # fmt: skip
    made.add_pair("driveshaft", moved(shaft, (0.09, 0.27, -1.62)), METAL)
    ring = [(0.15 * math.cos(a), 0.23 + 0.095 * math.sin(a), -1.265)
            for a in np.arange(8) * math.pi / 4]  # fmt: skip
    made.put("bell-nut", nut(0.008, 0.008, fine), METAL, ring, "-z")


def _cooling(made: Assembly) -> None:
    """A radiator in each sidepod: tubes, and fins between them."""
    fine = made.fine
    rows = np.arange(0.0, 0.40, 0.02)
    count = chords(90, fine, 8)
    x = np.linspace(-0.17, 0.17, count)
    low = np.array([(a, y + 0.004, -0.02) for y in rows for a in x])
    fins = boxes(low, low + np.array([0.6 * 0.34 / count, 0.013, 0.04]))
    low = np.array([(-0.18, y, -0.025) for y in rows])
    core = merge([fins, boxes(low, low + np.array([0.36, 0.004, 0.05])),
                  rounded_box((-0.2, -0.01, -0.03), (-0.18, 0.41, 0.03), 0.006, fine),
                  rounded_box((0.18, -0.01, -0.03), (0.2, 0.41, 0.03), 0.006, fine)])  # fmt: skip
    made.put("radiator", core, METAL, [(0.50, 0.12, 0.05), (-0.50, 0.12, 0.05)])
    made.put("oil-cooler", finned((-0.12, 0, -0.1), (0.12, 0.16, 0.1), 80, 0.01, 0.3), METAL,
             [(0.47, 0.12, -0.45), (-0.47, 0.12, -0.45)])  # fmt: skip
    hose = [(0.46, 0.2, 0.0), (0.42, 0.3, -0.3), (0.3, 0.24, -0.6), (0.17, 0.2, -0.75)]
    made.add_pair("water-hose", tube(hose, 0.02, fine, bends=60, sides=30), BLUE)
    back = [(0.52, 0.45, 0.0), (0.45, 0.42, -0.4), (0.32, 0.4, -0.7), (0.16, 0.36, -0.8)]
    made.add_pair("return-hose", tube(back, 0.018, fine, bends=60, sides=30), DARK)
    header = revolved([(0.03, 0), (0.05, 0.02), (0.05, 0.16), (0.03, 0.18)], chords(56, fine))
    made.put("header-tank", header, METAL, [(0.3, 0.3, -0.5), (-0.3, 0.3, -0.5)])


def _electrics(made: Assembly, rng: np.random.Generator) -> None:
    fine = made.fine
    case = merge([rounded_box((-0.06, 0, -0.05), (0.06, 0.06, 0.05), 0.006, 2 * fine),
                  finned((-0.05, 0.055, -0.04), (0.05, 0.07, 0.04), 16, 0.004)])  # fmt: skip
    units = [(0.45, 0.1, -0.2), (-0.45, 0.1, -0.2), (0.45, 0.2, -0.7), (-0.45, 0.2, -0.7),
             (0.0, 0.13, 0.7), (0.0, 0.13, 0.5)]  # fmt: skip
    made.put("control-unit", case, DARK, units)
    made.add("battery", rounded_box((-0.1, 0.11, 0.2), (0.1, 0.14, 0.4), 0.006, 2 * fine), BLUE)
    bottle = facing(
        revolved([(0.02, 0), (0.05, 0.03), (0.05, 0.3), (0.015, 0.34)], chords(56, fine)), "+z"
    )
    made.add("extinguisher", moved(bottle, (0.17, 0.16, 0.3)), RED)
    for k in range(4):
        y, side = 0.14 + 0.06 * k, 1.0 if k % 2 else -1.0
        swing = rng.uniform(-0.02, 0.02, 2).tolist()
        loom = [(side * 0.2, y, 0.6), (side * (0.24 + swing[0]), y, 0.1), (side * 0.36, y, -0.38),
                (side * (0.26 + swing[1]), y, -0.9), (side * 0.15, 0.2, -1.3)]  # fmt: skip
        made.add(
            f"loom-{k:02d}",
            tube(loom, 0.005, fine, bends=110, sides=14),
            (RED, BLUE, BRASS, DARK)[k % 4],
        )
