"""A tower of 54 equal modules of almost 20,000 triangles each, seen from inside.

The counterpart of Greene's skyscraper, with which Klosowski and Silva ("Efficient Conservative
Visibility Culling Using the Prioritized-Layered Projection Algorithm", 2001, section 4) measure
depth complexity. Theirs is a steel frame; this one is laid out here: floors of 3 x 3
modules, six above each other, each of nine rooms whose doors stand in line. Slabs, walls, girders
and furniture are closed solids, whose back faces nobody sees; leaves and glass are sheets with two
sides.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref_datasets_gen import furniture
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import Mesh
from visref_datasets_gen.shapes import box, boxes, lathe, merge, moved, quarter_turn

FLOORS_AT_SCALE_1 = 6
SIDE = 3
MODULE_M = 12.0
STOREY_M = 3.5
WELL_M = 1.5  # half-width of the hole in the slab
ROOM_M = 4.0
# Two screens at a right angle round a seat: from (x, z) to (x, z), and how high.
SCREENS, SCREEN_M = (((-1.2, -0.65), (1.2, -0.58)), ((-1.2, -0.58), (-1.13, 1.0))), 1.75
# How near to a screen the eye may come, which has its near plane 0.1 ahead.
CLEAR_M = 0.15
SEATS = ((-4.0, -4.0), (0.0, -4.0), (4.0, -4.0), (-4.0, 4.0), (4.0, 4.0))

# Label, mesh, place, and quarter turns.
Piece = tuple[str, Mesh, tuple[float, float, float], int]

_solid = partial(furniture.mesh, solid=True)


def skyscraper(*, seed: int = 0, scale: float = 1.0, frames: int = 60) -> Dataset:
    """54 modules at scale 1; `scale` sets the number of floors. The path (512 by 512) walks
    through the doors along one side of a middle floor, looking across the tower. Raises
    InputError for a scale or a number of frames that makes no tower."""
    if not 0.0 < scale <= 100.0:
        raise InputError(f"the tower's scale is {scale}", place="scale", fix="give up to 100")
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    floors = max(1, round(FLOORS_AT_SCALE_1 * scale))
    pieces = _module(np.random.Generator(np.random.PCG64(seed)))
    modules = []
    for floor in range(floors):
        for i in range(SIDE):
            for j in range(SIDE):
                name = f"module-{floor}-{i}-{j}"
                at = (i * MODULE_M, floor * STOREY_M, j * MODULE_M)
                parts = tuple(
                    furniture.placed(f"{name}/{label}", mesh, place, turns)
                    for label, mesh, place, turns in pieces
                )
                modules.append(furniture.placed(name, None, at, 0, parts))
    return Dataset("skyscraper", tuple(modules), _path(floors, frames, _across(pieces)))


def _module(rng: np.random.Generator) -> list[Piece]:
    """The objects of a module."""
    stock = {
        "desk": _solid("desk", furniture.desk()),
        "computer": _solid("computer", furniture.computer()),
        "chair": _solid("chair", furniture.visitor_chair()),
    }
    pieces = [("frame", _frame(), (0.0, 0.0, 0.0), 0), ("rail", _rail(), (0.0, 0.0, 0.0), 0)]
    pieces += [("walls", _walls(), (0.0, 0.0, 0.0), turns) for turns in (0, 1)]
    for k, (x, z) in enumerate(SEATS):
        turns = int(rng.integers(4))
        pieces.append((f"partition{k}", _partition(), (x, 0.0, z), turns))
        for label, mesh in stock.items():
            step = quarter_turn(turns) @ [0.0, 0.0, 0.8 if label == "chair" else 0.0]
            turned = turns + 2 if label == "chair" else turns
            pieces.append((f"{label}{k}", mesh, (x + step[0], 0.0, z + step[2]), turned))
    plant = _solid("plant", furniture.plant(rng, 70))
    pieces.append(("plant", plant, (2.2, 0.0, 2.2), 0))
    return pieces


def _frame() -> Mesh:
    """Slab with a well, girders of angled lattice, and columns at the module's corners."""
    half = MODULE_M / 2
    slab = [
        box([-half, -0.25, -half], [half, 0.0, -WELL_M]),
        box([-half, -0.25, WELL_M], [half, 0.0, half]),
        box([-half, -0.25, -WELL_M], [-WELL_M, 0.0, WELL_M]),
        box([WELL_M, -0.25, -WELL_M], [half, 0.0, WELL_M]),
    ]
    columns = [
        moved(lathe([(0.25, 0.0), (0.25, STOREY_M - 0.25)], 24), (x, 0.0, z))
        for x in (-half + 0.5, half - 0.5)
        for z in (-half + 0.5, half - 0.5)
    ]
    lattice = []
    for z in (-4.5, -3.0, 3.0, 4.5):
        for k in range(24):
            x = -half + 0.5 * k
            lattice.append(
                box([x, STOREY_M - 0.65, z - 0.03], [x + 0.06, STOREY_M - 0.3, z + 0.03])
            )
        lattice += [
            box([-half, y, z - 0.05], [half, y + 0.05, z + 0.05])
            for y in (STOREY_M - 0.7, STOREY_M - 0.35)
        ]
    return _solid("frame", {"floor": merge(slab), "wall": merge(columns), "metal": merge(lattice)})


def _rail() -> Mesh:
    """A balustrade round the well."""
    side = np.arange(-WELL_M, WELL_M, 0.125)
    posts = [(s, e) for s in side for e in (-WELL_M, WELL_M)]
    posts += [(e, s) for s in side for e in (-WELL_M, WELL_M)]
    low = np.array([(x - 0.01, 0.0, z - 0.01) for x, z in posts])
    bars = [boxes(low, low + np.array([0.02, 1.0, 0.02]))]
    for e in (-WELL_M, WELL_M):
        bars.append(box([-WELL_M, 1.0, e - 0.03], [WELL_M, 1.06, e + 0.03]))
        bars.append(box([e - 0.03, 1.0, -WELL_M], [e + 0.03, 1.06, WELL_M]))
    return _solid("rail", {"metal": merge(bars)})


def _walls() -> Mesh:
    """Three walls across x to the next slab, a door in the middle of each room's side."""
    half, top = MODULE_M / 2, STOREY_M - 0.25
    parts = []
    for x in (-half, -ROOM_M / 2, ROOM_M / 2):
        for k in range(3):
            low = -half + k * ROOM_M
            middle = low + ROOM_M / 2
            for z0, z1, y in ((low, middle - 0.6, 0.0), (middle + 0.6, low + ROOM_M, 0.0),
                              (middle - 0.6, middle + 0.6, 2.2)):  # fmt: skip
                parts.append(box([x - 0.06, y, z0], [x + 0.06, top, z1]))
    return _solid("walls", {"wall": merge(parts)})


def _partition() -> Mesh:
    """Two screens at a right angle round a desk."""
    screens = [box([x0, 0.0, z0], [x1, SCREEN_M, z1]) for (x0, z0), (x1, z1) in SCREENS]
    return _solid("partition", {"cloth": merge(screens)})


def _across(pieces: list[Piece]) -> list[tuple[float, float]]:
    """From where to where along a module the way through its doors is at a screen, or all but."""
    found = []
    for label, _, place, turns in pieces:
        if label.startswith("partition"):
            for (x0, z0), (x1, z1) in SCREENS:
                ends = np.array([[x0, 0.0, z0], [x1, 0.0, z1]]) @ quarter_turn(turns).T + place
                (low, _, first), (high, _, last) = ends.min(axis=0), ends.max(axis=0)
                if first - CLEAR_M < -ROOM_M < last + CLEAR_M:
                    found.append((float(low) - CLEAR_M, float(high) + CLEAR_M))
    return found


def _path(floors: int, frames: int, screens: list[tuple[float, float]]) -> CameraPath:
    """Through the doors along the first row of rooms of a middle floor, looking across the
    whole tower, left and right. Who would stand in a screen stands before it or behind."""
    y = (floors // 2) * STOREY_M + 1.625
    length = SIDE * MODULE_M - ROOM_M
    cameras = []
    for k in range(frames):
        done = (k + 0.5) / frames
        x = (done - 0.5) * length + (SIDE - 1) * MODULE_M / 2
        module = MODULE_M * round(x / MODULE_M)
        for low, high in screens:
            if low < x - module < high:
                x = module + (low if x - module - low < high - x + module else high)
        eye = np.array([x, y, -ROOM_M])
        turn = 0.8 * math.sin(6.0 * math.pi * done)
        target = eye + np.array([math.sin(turn), -0.05, math.cos(turn)])
        cameras.append(
            Camera(look_at(eye, target), 512, 512, near=0.1, far=200.0, yfov=math.radians(60.0))
        )
    return CameraPath(tuple(cameras))
