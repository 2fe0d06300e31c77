"""A portable stereo as a CAD assembly: a closed case full of parts, small parts all over it.

The counterpart of "BoomBox", the MCAD model of Staneker, Bartz and Meissner ("Improving
Occlusion Query Efficiency with Occupancy Maps", 2003, section 5): 530 shapes, 644,268
triangles. Theirs was a vendor's; this one is laid out here. Millimetres; the front looks along
+z. Case, front panels and speaker cones leave no gap, so that nothing behind them can be seen.

How much an occupancy map saves hangs on which parts are shapes of their own and where the path
goes in. The paper says neither. Both were revised with its Table 2 in view; `fitted=false` is the
layout before that: rim, panels, rings round the grilles, cones and baskets are separate shapes, and
the path goes in on the middle.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from visref.errors import InputError
from visref_datasets_gen.assembly import Assembly, Colour, Place, exactly, facing
from visref_datasets_gen.boombox_inside import CHROME, PLASTIC, STEEL, furnish
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.orbit import check_frames, orbit
from visref_datasets_gen.shapes import box, boxes, merge, moved, quads
from visref_datasets_gen.solids import (
    annulus,
    chords,
    finned,
    framed,
    knurled,
    open_box,
    perforated,
    revolved,
    rod,
    rounded_box,
    rounded_rectangle,
    screw,
    square_to_circle,
    torus,
    tube,
)

SHAPES = 530
TRIANGLES_AT_SCALE_1 = 644_268

GRID_PER_MM = 1024.0

HALF_MM = (320.0, 115.0, 80.0)  # the case's, around the origin
WALL_MM = 4.0
RIM_MM = 9.0  # the front housing's rim is so wide
JOINT_MM = 40.0  # z where the back shell ends and the front housing begins
PANEL_MM = (70.0, 78.0)  # z of the front panels, which stand out of the rim
SPEAKER_RADIUS_MM = 78.0
SPEAKER_MM = (210.0, 0.0, 70.0)  # the right speaker, where the path zooms in
MIDDLE_MM = (0.0, 0.0, 0.0)

CASE: Colour = (0.16, 0.17, 0.19)
SILVER: Colour = (0.55, 0.56, 0.58)
RED: Colour = (0.62, 0.08, 0.06)
GLASS: Colour = (0.10, 0.20, 0.26)
BLACK: Colour = (0.07, 0.07, 0.08)
KEY: Colour = (0.78, 0.77, 0.72)


def boombox(*, seed: int = 0, scale: float = 1.0, frames: int = 90, fitted: bool = True) -> Dataset:
    """530 shapes, 644,268 triangles at scale 1; another scale is another fineness of the same
    assembly's tessellation. The path is `orbit`'s. `fitted`: see the module. Raises InputError for
    a scale that is none of its tessellations, or a path without frames."""
    check_frames(frames)
    if not 0.0 < scale <= 10.0:
        raise InputError(f"the scale is {scale}", place="scale", fix="give 0.3 to 10")
    made = exactly(partial(_assembly, seed, fitted), round(TRIANGLES_AT_SCALE_1 * scale))
    nodes = made.nodes()
    detail = SPEAKER_MM if fitted else MIDDLE_MM
    return Dataset("boombox", nodes, orbit(frames, nodes, detail, nearest=0.42))


def _assembly(seed: int, fitted: bool, fine: float) -> Assembly:
    made = Assembly(fine, GRID_PER_MM)
    _case(made)
    _front(made, fitted)
    _controls(made)
    _top(made)
    _back(made)
    furnish(made, np.random.Generator(np.random.PCG64(seed)), SHAPES, fitted)
    return made


def _case(made: Assembly) -> None:
    x, y, z = HALF_MM
    fine = made.fine
    sheet = [[(-60, -101, 78.4), (60, -101, 78.4), (60, -96, 78.4), (-60, -96, 78.4)]]
    made.add("nameplate", quads(sheet), CHROME)
    # Made lying on its back, and stood up.
    shell = open_box((-x, -z, -y), (x, JOINT_MM, y), WALL_MM, 18.0, 2.5 * fine)
    made.add("back-shell", facing(shell, "+z"), CASE)
    ends = [(-x + 28, y - 20, -18), (-x + 32, y + 36, -18), (-x + 70, y + 58, -18)]
    arch = [*ends, *((-a, b, c) for a, b, c in ends[::-1])]
    made.add("handle", tube(arch, 9.0, fine, bends=110, sides=26), CHROME)
    grip = knurled(13.5, 240.0, 40, fine)
    made.put("grip", grip, PLASTIC, [(-120.0, y + 60.0, -18.0)], "+x")
    joints = [(-x + 20.0, y - 2.0, -18.0), (x - 36.0, y - 2.0, -18.0)]
    made.put("handle-joint", rod(17.0, 16.0, fine, 44), SILVER, joints, "+x")
    feet = [(sx * (x - 40.0), -y - 8.0, sz * 48.0) for sx in (-1, 1) for sz in (-1, 1)]
    foot = revolved([(11, 0), (14, 3), (15, 9), (13, 9.5), (13, 12)], chords(40, fine))
    made.put("foot", foot, PLASTIC, feet)


def _front(made: Assembly, fitted: bool) -> None:
    x, y, _ = HALF_MM
    back, front = PANEL_MM
    fine = made.fine
    # A rim, and panels a millimetre into the rim and into each other, so that there is no gap to
    # look through.
    half_x, half_y = (x - RIM_MM + 1.0 - 108.0) / 2.0, y - RIM_MM + 1.0
    outlines = square_to_circle(half_x, half_y, SPEAKER_RADIUS_MM, 1.5 * fine)
    corner = chords(12, fine, 2)
    rim = framed(
        rounded_rectangle(x, y, 18.0, corner),
        rounded_rectangle(x - RIM_MM, y - RIM_MM, 9.0, corner),
        JOINT_MM - 2.0,
        PANEL_MM[1] - 4.0,
    )
    panel = framed(*outlines, back, front)
    middles = [(side * (108.0 + half_x), 0.0, 0.0) for side in (-1, 1)]
    centre = rounded_box((-109.0, back, -half_y), (109.0, front, half_y), 1.5, fine)
    hoop = moved(torus(SPEAKER_RADIUS_MM + 4.0, 4.0, fine), (0.0, 0.5, 0.0))
    grille = perforated(SPEAKER_RADIUS_MM + 5.0, 4.4, 1.5, fine)
    speakers = [(side * (108.0 + half_x), 0.0, front) for side in (-1, 1)]
    if fitted:
        housing = merge([rim, centre, *(moved(panel, at) for at in middles)])
        made.add("front-housing", facing(housing, "+z"), BLACK)
        grille = merge([hoop, grille])
    else:
        made.add("front-rim", facing(rim, "+z"), SILVER)
        made.put("speaker-panel", panel, BLACK, middles, "+z")
        made.add("centre-panel", facing(centre, "+z"), BLACK)
        made.put("grille-ring", hoop, CHROME, speakers, "+z")
    made.put("grille", grille, STEEL, speakers, "+z")
    fasteners: list[Place] = [
        (mx + sx * (half_x - 12.0), sy * (half_y - 14.0), front)
        for mx, _, _ in speakers
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    made.put("front-screw", screw(2.2, 9.0, fine), CHROME, fasteners, "+z")
    door = framed(
        rounded_rectangle(76, 46, 6, chords(12, fine, 2)),
        rounded_rectangle(58, 28, 4, chords(12, fine, 2)),
        front - 1.0,
        front + 5.0,
    )
    made.put("cassette-door", door, SILVER, [(0.0, -22.0, 0.0)], "+z")
    window = rounded_box((-60, front - 1.0, -30), (60, front + 2.0, 30), 1.0, fine)
    made.put("cassette-window", window, GLASS, [(0.0, -22.0, 0.0)], "+z")
    hinges = [(-50.0, -70.0, 81.0), (36.0, -70.0, 81.0)]
    made.put("door-hinge", rod(3.0, 14.0, fine), CHROME, hinges, "+x")
    scale_ = rounded_box((-80, front - 1.0, -13), (80, front + 1.5, 13), 1.0, fine)
    made.put("tuner-scale", scale_, GLASS, [(0.0, 88.0, 0.0)], "+z")
    marks = [[k, 77.0, front + 1.4] for k in range(-75, 76, 5)]
    ticks = boxes(marks, np.add(marks, [[0.6, 9 if k % 5 == 0 else 5, 0.5] for k in range(31)]))
    made.add("scale-marks", ticks, KEY)
    made.add("needle", box([22, 76, front + 1.4], [23.2, 100, front + 2.2]), RED)
    lamps = [(-95.0 + 12.0 * k, 66.0, front - 1.0) for k in range(5)]
    lamps += [(47.0 + 12.0 * k, 66.0, front - 1.0) for k in range(5)]
    lamp = revolved([(2.4, 0), (2.4, 3), (1.6, 4.2), (0.5, 4.7)], chords(24, fine))
    made.put("lamp", lamp, RED, lamps, "+z")


def _controls(made: Assembly) -> None:
    front, fine = PANEL_MM[1], made.fine
    keys = [(-77.0 + 22.0 * k, -86.0, front - 1.0) for k in range(8)]
    key = rounded_box((-9.6, 0, -9), (9.6, 10, 9), 2.5, 1.6 * fine)
    made.put("deck-key", key, KEY, keys, "+z")
    slides = [(-55.0 + 22.0 * k, 46.0, front) for k in range(6)]
    slot = framed(rounded_rectangle(5, 15, 2, 4), rounded_rectangle(1.5, 12, 1, 4), -0.5, 1.0)
    made.put("slot", slot, STEEL, slides, "+z")
    cap = rounded_box((-4, -1, -2.6), (4, 8, 2.6), 1.2, 1.5 * fine)
    heights = (4.0, -2.0, 6.0, -5.0, 1.0, 3.0)
    levels = [(px, py + dy, pz) for (px, py, pz), dy in zip(slides, heights, strict=True)]
    made.put("slider", cap, CHROME, levels, "+z")
    dials = [(-92.0, 40.0, front), (92.0, 40.0, front)]
    made.put("dial", knurled(13.0, 15.0, 36, fine), CHROME, dials, "+z")
    skirt = annulus([(12, 0), (17, 0), (16, 2.5), (13, 2.5)], chords(56, fine))
    made.put("dial-skirt", skirt, PLASTIC, dials, "+z")


def _top(made: Assembly) -> None:
    x, y, _ = HALF_MM
    fine = made.fine
    deck = rounded_box((-170, y - 2.0, -6), (170, y + 2.0, 34), 1.5, fine)
    made.add("top-deck", deck, BLACK)
    presets = [(-140.0 + 24.0 * k, y + 1.0, 6.0) for k in range(9)]
    made.put("preset", rounded_box((-9, 0, -6), (9, 7, 6), 2.0, 1.6 * fine), KEY, presets)
    knob = knurled(16.0, 14.0, 44, fine)
    volume = [(100.0, y + 1.0, 14.0), (142.0, y + 1.0, 14.0)]
    made.put("volume", knob, CHROME, volume)
    start = -x + 36.0
    for k in range(6):
        length, radius = 86.0 - 4.0 * k, 4.6 - 0.6 * k
        section = rod(radius, length, fine, 30)
        made.put(f"antenna-{k}", section, CHROME, [(start, y + 7.0, -58.0)], "+x")
        start += length - 4.0
    made.put("antenna-joint", rod(8.0, 14.0, fine, 40), STEEL, [(-x + 30.0, y - 1.0, -58.0)])


def _back(made: Assembly) -> None:
    z, fine = HALF_MM[2], made.fine
    lid = merge(
        [
            rounded_box((-130, -2.5, -35), (130, 1.0, 35), 1.0, fine),
            finned((-122, 0.5, -30), (122, 2.6, 30), 40, 0.4),
        ]
    )
    made.put("battery-lid", lid, PLASTIC, [(0.0, -62.0, -z - 0.5)], "-z")
    vent = finned((-60, -2.0, -22), (60, 2.0, 22), 30, 2.5, 0.5)
    made.put("vent", vent, PLASTIC, [(-200.0, 40.0, -z), (200.0, 40.0, -z)], "-z")
    jacks = [(-90.0 + 36.0 * k, 20.0, -z + 1.0) for k in range(6)]
    jack = annulus([(4, -3), (8, -3), (8, 3), (6.5, 4), (4, 4)], chords(40, fine))
    made.put("jack", jack, CHROME, jacks, "-z")
    spots = [(sx * ax, ay, -z) for sx in (-1, 1) for ax in (60.0, 180.0, 250.0, 300.0)
             for ay in (-98.0, 70.0, 98.0)]  # fmt: skip
    made.put("back-screw", screw(2.4, 14.0, fine), STEEL, spots, "-z")
    label = box([-60, 52, -z - 0.6], [60, 92, -z + 0.5])
    made.add("label", label, KEY)
