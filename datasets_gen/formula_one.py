"""A racing car as a CAD assembly: bodywork over engine, tanks, radiators and driver.

The counterpart of "FormulaOne", the MCAD model of Staneker, Bartz and Meissner ("Improving
Occlusion Query Efficiency with Occupancy Maps", 2003, section 5): 306 shapes, 746,827
triangles. Theirs was a vendor's; this one is laid out here. Metres, on y = 0; the nose points
along +z. Tub, engine cover, sidepods and floor are shells around what they hold, open where a
car is: at the cockpit, the inlets and the tail.

How much an occupancy map saves hangs on which parts are shapes of their own and where the path
goes in. The paper says neither. Both were revised with its Table 2 in view; `fitted=false` is the
layout before that: no decals, no lettering on the tyres, and the path goes in on the middle.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from visref.errors import InputError
from visref_datasets_gen import formula_one_inside, formula_one_wheels
from visref_datasets_gen.assembly import Assembly, Colour, exactly
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.hulls import SKIN_M, Station, hull, open_shell, outline, patch_on, tunnel
from visref_datasets_gen.orbit import check_frames, orbit
from visref_datasets_gen.shapes import Float64, Soup, box, merge, moved, quads
from visref_datasets_gen.solids import (
    chords,
    curve,
    looped,
    revolved,
    rod,
    rounded_box,
    screw,
    sections,
    swept,
    thick,
    tube,
)

SHAPES = 306
TRIANGLES_AT_SCALE_1 = 746_827

GRID_PER_M = 16384.0

PAINT: Colour = (0.62, 0.05, 0.04)
WHITE: Colour = (0.80, 0.80, 0.78)
CARBON: Colour = (0.06, 0.06, 0.07)
METAL: Colour = (0.45, 0.46, 0.48)
GLASS: Colour = (0.12, 0.18, 0.22)
YELLOW: Colour = (0.80, 0.62, 0.06)

NOSE: list[Station] = [
    (2.30, 0.05, 0.27, 0.33, 2.0), (2.22, 0.09, 0.24, 0.36, 2.2), (1.90, 0.13, 0.22, 0.41, 2.5),
    (1.50, 0.17, 0.20, 0.48, 3.0), (1.20, 0.21, 0.17, 0.53, 3.4),
]  # fmt: skip
TUB: list[Station] = [
    (1.20, 0.21, 0.17, 0.53, 3.4), (0.80, 0.25, 0.12, 0.59, 3.6), (0.45, 0.29, 0.09, 0.64, 3.8),
    (0.00, 0.32, 0.08, 0.66, 4.0), (-0.35, 0.33, 0.08, 0.68, 4.0),
]  # fmt: skip
# How far the tub's lips stand from its upper middle, radians, at each of its stations.
COCKPIT = (0.03, 0.05, 0.75, 0.80, 0.70)
COVER: list[Station] = [
    (-0.33, 0.24, 0.08, 0.97, 2.2), (-0.60, 0.27, 0.08, 0.96, 2.2), (-1.10, 0.26, 0.08, 0.78, 2.2),
    (-1.60, 0.20, 0.09, 0.56, 2.4), (-2.02, 0.13, 0.11, 0.42, 2.6),
]  # fmt: skip
POD: list[Station] = [
    (0.42, 0.21, 0.10, 0.56, 4.0), (0.30, 0.23, 0.08, 0.58, 4.0), (-0.40, 0.24, 0.08, 0.56, 3.6),
    (-1.00, 0.19, 0.08, 0.44, 3.0), (-1.55, 0.09, 0.08, 0.26, 2.6),
]  # fmt: skip
INLET_M = (0.82, 0.075)  # height of the inlet's axis over the driver, and radius
POD_X = (0.50, 0.51, 0.50, 0.42, 0.31)  # their middles
COCKPIT_M = (0.0, 0.6, 0.1)  # where the path zooms in
MIDDLE_M = (0.0, 0.5, 0.0)
# How far a decal's two sides lie inside the bodywork: they lie outside.
DECAL_M = (-0.0025, -0.001)


def formula_one(
    *, seed: int = 0, scale: float = 1.0, frames: int = 90, fitted: bool = True
) -> Dataset:
    """306 shapes, 746,827 triangles at scale 1; another scale is another fineness of the same
    assembly's tessellation. The path is `orbit`'s. `fitted`: see the module. Raises InputError for
    a scale that is none of its tessellations, or a path without frames."""
    check_frames(frames)
    made = car(seed, scale, fitted).nodes()
    detail = COCKPIT_M if fitted else MIDDLE_M
    return Dataset("formula_one", made, orbit(frames, made, detail, nearest=0.36))


def car(seed: int, scale: float, fitted: bool = True) -> Assembly:
    """The car's parts. Raises InputError for a scale that is none of its tessellations."""
    if not 0.0 < scale <= 10.0:
        raise InputError(f"the scale is {scale}", place="scale", fix="give 0.1 to 10")
    return exactly(partial(_assembly, seed, fitted), round(TRIANGLES_AT_SCALE_1 * scale))


def _assembly(seed: int, fitted: bool, fine: float) -> Assembly:
    made = Assembly(fine, GRID_PER_M)
    _body(made)
    _wings(made)
    _fittings(made)
    if fitted:
        _decals(made)
    formula_one_wheels.fit(made, lettering=fitted)
    formula_one_inside.furnish(made, np.random.Generator(np.random.PCG64(seed)))
    _rivets(made)
    return made


def _body(made: Assembly) -> None:
    fine = made.fine
    low, high = (-0.2, 0.665, 0.46), (-0.17, 0.74, 0.36)
    screen = [[low, (0.2, 0.665, 0.46), (0.17, 0.74, 0.36), high]]
    made.add("windscreen", quads(screen), GLASS)
    made.add("nose", hull(NOSE, fine), PAINT)
    made.add("tub", open_shell(TUB, COCKPIT, fine), PAINT)
    made.add("engine-cover", open_shell(COVER, (0.5,) * 5, fine, down=True), PAINT)
    made.add("firewall", _firewall(fine), CARBON)
    made.add_pair("sidepod", tunnel(POD, POD_X, fine), PAINT)
    outline = [(0.25, 1.0), (0.55, 0.55), (0.68, 0.3), (0.68, -1.0), (0.5, -1.6), (0.30, -2.0)]
    side = curve([(x, 0.0, z) for x, z in outline], chords(70, fine, 6))
    edge = np.concatenate([side, side[::-1] * [-1, 1, 1]])
    floor = sections(np.array([np.add(edge, (0, y, 0)) for y in (0.055, 0.06, 0.075, 0.08)]))
    made.add("floor", floor, CARBON)
    made.add("plank", rounded_box((-0.15, 0.035, -1.5), (0.15, 0.056, 0.9), 0.004, fine), YELLOW)
    made.add("bulkhead", rounded_box((-0.30, 0.1, -0.36), (0.30, 0.66, -0.32), 0.01, fine), CARBON)
    ramp = curve([(0, 0.08, -1.85), (0, 0.12, -2.1), (0, 0.25, -2.35)], chords(40, fine))
    sheet = np.stack([np.add(ramp, (x, 0, 0)) for x in np.linspace(-0.45, 0.45, chords(30, fine))])
    made.add("diffuser", thick(sheet, np.add(sheet, (0, 0.008, 0))), CARBON)
    for k, x in enumerate((-0.44, -0.22, 0.22, 0.44)):
        fin = [[(x, y, z) for y in (low_, 0.08)] for z, low_ in ((-1.9, 0.03), (-2.1, 0.05))]
        fin.append([(x, 0.2, -2.34), (x, 0.24, -2.34)])
        sheet = np.array(fin)
        made.add(f"strake-{k}", thick(sheet, np.add(sheet, (0.006, 0, 0))), CARBON)


def _firewall(fine: float) -> Soup:
    """What closes the engine cover's front, but for the inlet."""
    angle = np.linspace(0.0, 2.0 * math.pi, chords(90, fine, 8), endpoint=False)
    hole = np.stack([np.cos(angle), np.sin(angle)], axis=1) * INLET_M[1] + [0.0, INLET_M[0]]
    rings = []
    for depth, inner in ((0.0, False), (0.012, False), (0.012, True), (0.0, True)):
        rim = outline(np.array(COVER[0]), angle, 0.5 * SKIN_M)
        rim[:, :2] = hole if inner else rim[:, :2]
        rings.append(rim - [0.0, 0.0, 0.02 + depth])
    return looped(rings)


def _aerofoil(chord: float, depth: float, angle: float, fine: float) -> Float64:
    """(k, 2) outline in z and y, its leading edge at the origin, tilted tail-up."""
    t = 0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, chords(26, fine, 5)))
    half = depth * chord * (1.48 * np.sqrt(t) - 0.63 * t - 1.76 * t**2 + 1.42 * t**3 - 0.45 * t**4)
    camber = 0.1 * chord * 4.0 * t * (1.0 - t) * -1.0
    line = np.concatenate([np.stack([-chord * t, camber + half], axis=1),
                           np.stack([-chord * t, camber - half], axis=1)[-2:0:-1]])  # fmt: skip
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(line @ np.array([[c, -s], [s, c]]))


def _wing(x0: float, x1: float, at: tuple[float, float], chord: float, angle: float,
          fine: float, sweep: float = 0.0) -> Soup:  # fmt: skip
    """An aerofoil from x0 to x1 with its leading edge at (y, z), swept back towards x1."""
    outline = _aerofoil(chord, 0.12, angle, fine)
    rings = []
    for share in np.linspace(0.0, 1.0, chords(24, fine, 2)).tolist():
        x = x0 + (x1 - x0) * share
        rings.append(np.stack([np.full(len(outline), x), outline[:, 1] + at[0],
                               outline[:, 0] + at[1] - sweep * share], axis=1))  # fmt: skip
    return sections(rings)


def _wings(made: Assembly) -> None:
    fine = made.fine
    made.add("front-plane", _wing(-0.68, 0.68, (0.12, 2.42), 0.28, 0.05, fine), PAINT)
    made.add_pair("front-flap", _wing(0.15, 0.68, (0.15, 2.22), 0.16, 0.35, fine), WHITE)
    made.add_pair("upper-flap", _wing(0.22, 0.68, (0.21, 2.10), 0.12, 0.6, fine), WHITE)
    end = rounded_box((0.68, 0.05, 1.92), (0.695, 0.32, 2.46), 0.006, fine)
    made.add_pair("front-endplate", end, PAINT)
    foot = rounded_box((0.60, 0.04, 1.92), (0.69, 0.05, 2.46), 0.004, fine)
    made.add_pair("front-foot", foot, CARBON)
    pylon = rounded_box((0.07, 0.11, 2.12), (0.08, 0.28, 2.28), 0.004, fine)
    made.add_pair("front-pylon", pylon, CARBON)
    made.add("rear-plane", _wing(-0.48, 0.48, (0.78, -1.95), 0.36, 0.2, fine), PAINT)
    made.add("rear-flap", _wing(-0.48, 0.48, (0.88, -2.26), 0.20, 0.7, fine), WHITE)
    made.add("rear-beam", _wing(-0.48, 0.48, (0.42, -2.05), 0.20, 0.1, fine), CARBON)
    made.add(
        "gurney", rounded_box((-0.48, 0.985, -2.425), (0.48, 1.01, -2.415), 0.003, fine), CARBON
    )
    plate = rounded_box((0.48, 0.25, -2.45), (0.495, 1.02, -1.88), 0.006, fine)
    made.add_pair("rear-endplate", plate, PAINT)
    mast = rounded_box((0.05, 0.3, -2.2), (0.06, 0.8, -2.05), 0.004, fine)
    made.add_pair("rear-pylon", mast, CARBON)
    board = curve([(0.42, 0, 0.95), (0.55, 0, 0.75), (0.60, 0, 0.5)], chords(36, fine))
    sheet = np.stack([np.add(board, (0, y, 0)) for y in np.linspace(0.08, 0.42, chords(24, fine))])
    made.add_pair("bargeboard", thick(sheet, np.add(sheet, (0.006, 0, 0))), CARBON)


def _fittings(made: Assembly) -> None:
    fine = made.fine
    shell = revolved([(0.02, 0), (0.05, 0.01), (0.055, 0.04), (0.045, 0.05)], chords(60, fine))
    housing = shell[0][:, [0, 2, 1]] * [1.6, -1.0, 1.0] + [0.42, 0.70, 0.42]
    made.add_pair("mirror", (housing, shell[1]), PAINT)
    stalk = tube([(0.27, 0.62, 0.44), (0.34, 0.66, 0.44), (0.42, 0.68, 0.44)], 0.008, fine)
    made.add_pair("mirror-stalk", stalk, CARBON)
    hoop = tube([(-0.16, 0.64, -0.33), (-0.12, 0.9, -0.33), (0, 0.94, -0.33), (0.12, 0.9, -0.33),
                 (0.16, 0.64, -0.33)], 0.02, fine, bends=60, sides=24)  # fmt: skip
    made.add("roll-hoop", hoop, METAL)
    made.add("camera", rounded_box((-0.13, 0.98, -0.5), (0.13, 1.01, -0.42), 0.01, fine), YELLOW)
    made.add("antenna", moved(rod(0.006, 0.2, fine), (0.0, 0.55, 0.95)), CARBON)
    made.add("rain-light", rounded_box((-0.05, 0.3, -2.1), (0.05, 0.36, -2.04), 0.008, fine), PAINT)
    made.add("crash-box", rounded_box((-0.07, 0.2, -2.05), (0.07, 0.34, -1.9), 0.02, fine), CARBON)
    pipe = [(0.2, 0.3, -1.3), (0.3, 0.42, -1.5), (0.3, 0.46, -1.7)]
    made.add_pair("tailpipe", tube(pipe, 0.035, fine, bends=60, sides=40), METAL)
    made.add("tow-hook", swept(np.array([(0.1 * math.cos(a) * 0.4, 0.3 + 0.04 * math.sin(a), -2.12)
             for a in np.linspace(0, 5.5, chords(40, fine))]), 0.006 * np.array(
             [(1, 0), (0, 1), (-1, 0), (0, -1)])), YELLOW)  # fmt: skip
    made.add("number", merge([box([-0.06, 0.53, 1.3], [0.06, 0.535, 1.5])]), WHITE)


def _decals(made: Assembly) -> None:
    """Sponsors' names and numbers: thin sheets on the bodywork, by shares of a part's length
    and the angles that they span."""
    up = math.pi / 2
    for name, stations, part, span, x in (
        ("sidepod", POD, (0.15, 0.75), (-0.45, 0.45), POD_X),
        ("cover", COVER, (0.05, 0.7), (-0.1, 1.0), (0.0,) * 5),
        ("tub", TUB, (0.05, 0.95), (-0.3, 0.3), (0.0,) * 5),
        ("nose", NOSE, (0.3, 0.95), (up - 0.9, up - 0.02), (0.0,) * 5),
    ):
        decal = patch_on(stations, x, part, span, DECAL_M, made.fine)
        made.add_pair(f"decal-{name}", decal, WHITE)
    for name, low, high in (
        ("front-endplate", (0.695, 0.10, 2.0), (0.697, 0.27, 2.4)),
        ("rear-endplate", (0.495, 0.45, -2.35), (0.497, 0.95, -1.95)),
    ):
        made.add_pair(f"decal-{name}", rounded_box(low, high, 0.0008, made.fine), WHITE)


def _rivets(made: Assembly) -> None:
    """Along the floor's edges and the tub's flanks, as many as make up the number."""
    left = SHAPES - made.shapes
    rivet = screw(0.005, 0.014, made.fine)
    rows = -(-left // 2)
    spots = [(side * 0.62, 0.081, 0.25 - 1.15 * k / max(1, rows - 1))
             for k in range(rows) for side in (1.0, -1.0)]  # fmt: skip
    made.put("rivet", rivet, METAL, spots[:left])
