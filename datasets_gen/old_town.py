"""A town of 34,034,176 triangles that shows few of them: the City of Hey 2001, by its text.

"Real-Time Occlusion Culling With A Lazy Occlusion Grid" (TR-186-2-01-02, section 7 and Fig. 7) says
of its city: 34,034,176 triangles; each a primitive object, in boxes of at most 1,500; a walkthrough
on whose frames 1,964,918 triangles a frame are in the view, 5.8 % of all, and 11,981 or 11,775 in
boxes that the grid lets through. So eight full boxes show, or sixteen half full. No more is said,
and this is what follows, written down before anything was measured:

- Who walks there stands in a street, and sees a few house fronts on either side and one across its
  end: no street runs on. Here blocks lie in herringbone, 24 by 10 metres each, so that every
  street meets a house after 42 metres at most and turns. Streets are 4 metres wide.
- Nothing shows above the house at the end. Eaves are 8.6 to 9.4 metres high and ridges 2.4 more:
  from the street, what stands behind a house is never higher in the view than its ridge.
- Eight boxes of 1,500 for some ten houses: a house has fewer than a thousand triangles. Here 796:
  two fronts of nine windows each, and a roof; 42,700 houses, three to a block, wall to wall.
- 5.8 % in the view is 2,470 houses, of 131 square metres each with its share of the streets: all
  within 800 metres, at a view 58 degrees wide. So far is the far plane.

All of these houses lie in a square of 800 metres beyond the walk, which begins at the town's edge
and goes inward: a town of an eighth of the triangles, of which the walk sees no other end, has as
many of them in the view, and as many that show.

Each house is a solid: closed, and facing outward.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import Mesh, Node
from visref_datasets_gen.shapes import Float64, Soup, box, merge, quads, quarter_turn
from visref_datasets_gen.stock import placed, plain
from visref_datasets_gen.terrain import patch

TRIANGLES_AT_SCALE_1 = 34_034_176

CELL_M = 14.0  # a block is two cells long and one wide, less the street
STREET_M = 4.0
HOUSES_A_BLOCK = 3
HOUSE_M = ((2.0 * CELL_M - STREET_M) / HOUSES_A_BLOCK, CELL_M - STREET_M)
SUNK_M = 0.2  # houses stand in the paving, and not on it
EAVES_M = (8.6, 9.4)
RIDGE_M = 2.4
RECESS_M = 0.2
# Of a front, from its middle: where windows begin and end; and from the ground.
COLUMNS_M = (0.6, 1.9, 3.1)
ROWS_M = (0.9, 2.3, 3.6, 5.0, 6.3, 7.7)
ROOF_ROWS = 13
VARIANTS = 6

EYE_M = 1.7
STEP_M = 2.2
AHEAD_M = 6.0
SMOOTHED_M = 1.5
FROM_EDGE_CELLS = 4
FAR_M = 800.0
# On a view of 58 degrees this is 28 degrees to either side.
YFOV = math.pi / 4


def old_town(*, seed: int = 0, scale: float = 1.0, frames: int = 60) -> Dataset:
    """34,034,176 triangles in 57,000 objects at scale 1, and `scale` times as many triangles,
    rounded, at another. The path (1280 by 960) goes inward from the edge. Raises InputError for a
    scale that leaves no room for a block, or a path without frames."""
    if not 0.0 < scale <= 4.0:
        raise InputError(
            f"the town's scale is {scale}", place="scale", fix="give more than 0, at most 4"
        )
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    rng = np.random.Generator(np.random.PCG64(seed))
    stock = [_house(k, rng.uniform(*EAVES_M)) for k in range(VARIANTS)]
    paving = plain("paving", {"pavement": box([-1.0, 0.0, -0.5], [1.0, 0.0, 0.5], "Y")})[0]
    a_block = HOUSES_A_BLOCK * _size(stock[0]) + _size(paving)
    total = round(TRIANGLES_AT_SCALE_1 * scale)
    count = total // a_block
    if not count:
        raise InputError(
            f"{total} triangles are not enough for a block",
            place="scale",
            fix="give a greater scale",
        )
    side = math.ceil(math.sqrt(2.0 * count)) + 2
    nodes: list[Node] = []
    for number, (x, z, upright) in enumerate(_blocks(side, count)):
        turns = 1 if upright else 0
        name = f"block-{number:05d}"
        nodes.append(_paving(name, paving, x, z, turns))
        for k in range(HOUSES_A_BLOCK):
            along = (k - (HOUSES_A_BLOCK - 1) / 2.0) * HOUSE_M[0]
            shift = quarter_turn(turns) @ [along, 0.0, 0.0]
            mesh = stock[int(rng.integers(VARIANTS))]
            at = (x + shift[0], -SUNK_M, z + shift[2])
            nodes.append(placed(f"{name}/house-{k}", (mesh,), at, turns))
    left = total - count * a_block
    if left:
        # Beyond the last row.
        low, high = (-20.0, -(side + 2) * CELL_M), (20.0, -(side + 1) * CELL_M)
        field = patch(low, high, left, lambda x, z: 0.02 * np.sin(7.0 * x) ** 2 + 0.0 * z)
        nodes.append(Node("field", plain("field", {"earth": field})[0]))
    return Dataset("old_town", tuple(nodes), _walk(rng, side, frames))


def _size(mesh: Mesh) -> int:
    return sum(len(part.triangles) for part in mesh.primitives)


# -- blocks ---------------------------------------------------------------------------------


def _blocks(side: int, count: int) -> list[tuple[float, float, bool]]:
    """The middles (x, z) in metres of `count` blocks of herringbone, the walk's edge (z = 0)
    first, and whether each lies along z. Cells count from -side / 2 along x, and from the edge
    towards -z."""
    found = []
    for row in range(side):
        for column in range(-(side // 2), side - side // 2):
            kind = (column - row) % 4
            # 0 is a block along x with the next column, 3 one along z with the next row.
            if kind == 0:
                found.append(((column + 1.0) * CELL_M, -(row + 0.5) * CELL_M, False))
            elif kind == 3:
                found.append(((column + 0.5) * CELL_M, -(row + 1.0) * CELL_M, True))
    return found[:count]


def _paving(name: str, mesh: Mesh, x: float, z: float, turns: int) -> Node:
    matrix = np.eye(4)
    matrix[:3, :3] = quarter_turn(turns) @ np.diag([CELL_M, 1.0, CELL_M])
    matrix[:3, 3] = (x, 0.0, z)
    return Node(f"{name}/paving", mesh, matrix)


# -- houses ---------------------------------------------------------------------------------


def _house(number: int, eaves: float) -> Mesh:
    """A house about its middle, its fronts towards +z and -z, closed below."""
    half = np.array([*COLUMNS_M, HOUSE_M[0] / 2.0])
    xs = np.concatenate([-half[::-1], half])
    # As float32 now, so that what is mirrored meets what is not.
    ys = np.array([0.0, *ROWS_M, eaves], np.float32).astype(np.float64)
    front = _front(xs, ys)
    back = (front[0] * [-1.0, 1.0, -1.0], front[1])
    return plain(
        f"house-{number}",
        {"wall": merge([front, back, *_ends(xs, ys), _floor(xs)]), "roof": _roof(xs, ys[-1])},
    )[0]


def _front(xs: Float64, ys: Float64) -> Soup:
    """Walls and windows in one sheet: a window's cell is set back, with four reveals."""
    corners = []
    for i in range(len(xs) - 1):
        for j in range(len(ys) - 1):
            flat = _cell(xs[i : i + 2], ys[j : j + 2], HOUSE_M[1] / 2.0)
            if i % 2 == 0 or j % 2 == 0 or j == len(ys) - 2:
                corners.append(flat)
                continue
            pane = flat - [0.0, 0.0, RECESS_M]
            corners.append(pane)
            for k in range(4):
                n = (k + 1) % 4
                corners.append(np.array([flat[k], flat[n], pane[n], pane[k]]))
    return quads(np.array(corners))


def _cell(x: Float64, y: Float64, z: float) -> Float64:
    """Counter-clockwise from +z."""
    return np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]])


def _slope(eaves: float) -> tuple[Float64, Float64]:
    """Heights and z of the rows of a roof, eaves to ridge."""
    share = np.arange(ROOF_ROWS + 1) / ROOF_ROWS
    return eaves + RIDGE_M * share, HOUSE_M[1] / 2.0 * (1.0 - share)


def _roof(xs: Float64, eaves: float) -> Soup:
    heights, z = _slope(eaves)
    corners = []
    for way in (1.0, -1.0):
        for i in range(len(xs) - 1):
            for j in range(ROOF_ROWS):
                a, b = way * xs[i], way * xs[i + 1]
                corners.append(
                    [
                        [a, heights[j], way * z[j]],
                        [b, heights[j], way * z[j]],
                        [b, heights[j + 1], way * z[j + 1]],
                        [a, heights[j + 1], way * z[j + 1]],
                    ]
                )
    return quads(np.array(corners))


def _ends(xs: Float64, ys: Float64) -> list[Soup]:
    """The walls between houses, in strips as high as the fronts' rows and the roof's."""
    heights, z = _slope(ys[-1])
    rows = [*((y, HOUSE_M[1] / 2.0) for y in ys[:-1]), *zip(heights, z, strict=True)]
    result = []
    for x, way in ((xs[-1], 1.0), (xs[0], -1.0)):
        strips = [
            [[x, low, way * out], [x, low, -way * out], [x, high, -way * in_], [x, high, way * in_]]
            for (low, out), (high, in_) in itertools.pairwise(rows[:-1])
        ]
        (low, out), (top, _) = rows[-2:]
        peak = np.array([[x, low, way * out], [x, low, -way * out], [x, top, 0.0]])
        result += [quads(np.array(strips)), (peak, np.array([[0, 1, 2]]))]
    return result


def _floor(xs: Float64) -> Soup:
    z = HOUSE_M[1] / 2.0
    corners = [
        [[a, 0.0, -z], [b, 0.0, -z], [b, 0.0, z], [a, 0.0, z]] for a, b in itertools.pairwise(xs)
    ]
    return quads(np.array(corners))


# -- the walk -------------------------------------------------------------------------------


def _walk(rng: np.random.Generator, side: int, frames: int) -> CameraPath:
    """Along the streets inward, looking where they go."""
    x, row = 0, min(FROM_EDGE_CELLS, side - 1)
    # Where the way inward is open.
    x += (row - x) % 4
    corners = [(x, row)]
    length = STEP_M * frames + AHEAD_M + 2.0 * CELL_M
    while CELL_M * (len(corners) - 1) < length:
        # A block lies across the way inward at kind 1; there the street turns.
        if (x - row) % 4 == 1:
            x += 1 if rng.random() < 0.5 else -1
        else:
            row += 1
        corners.append((x, row))
    way = np.array(corners, np.float64) * [CELL_M, -CELL_M]
    cameras = []
    for k in range(frames):
        s = SMOOTHED_M + STEP_M * k
        here, there = _at(way, s), _at(way, s + AHEAD_M)
        pose = look_at((here[0], EYE_M, here[1]), (there[0], EYE_M, there[1]))
        cameras.append(Camera(pose, 1280, 960, near=0.1, far=FAR_M, yfov=YFOV))
    return CameraPath(tuple(cameras))


def _at(way: Float64, s: float) -> Float64:
    """(2,) x and z after `s` metres of a way of corners a cell apart, corners cut."""
    places = (s + np.linspace(-SMOOTHED_M, SMOOTHED_M, 9)) / CELL_M
    count = np.arange(len(way))
    return np.array([np.interp(places, count, way[:, axis]).mean() for axis in (0, 1)])
