"""Towers on hilly ground, birds above them: the terrain of Décoret's N-buffers, 2005.

"N-Buffers for efficient depth map query" (Computer Graphics Forum 24(3), section 4.4) clamps
shadow volumes in "a terrain with towers and birds flying above", of which it says no more. The
birds are what it is for: they fly above the picture, and their shadows lie in it. The path
(640 by 480, the size in the paper) goes above the ground and looks down.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import Mesh, Node
from visref_datasets_gen.shapes import Float64, Soup, boxes, lathe, merge, quarter_turn, ring, snap
from visref_datasets_gen.stock import plain
from visref_datasets_gen.terrain import Height, Winding, ground

SIDE_AT_SCALE_1_M = 400.0
TILE_M = 25.0
TILE_TRIANGLES = 200
TOWER_PITCH_M = 40.0
BIRDS_A_TILE = 2.0
BIRD_HEIGHT_M = (25.0, 60.0)  # above the highest ground
SHAPES_A_KIND = 3
CLEARANCE_M = 9.0  # from the walk to a tower's axis
# On a dyke, say: high enough to see the ground between the hills.
WALK = Winding(step_m=1.5, reach=0.4, sway_m=6.0, bend_m=17.0, eye_m=9.0)
PITCH_DOWN = 0.25
NEAR_M, FAR_M = 0.5, 1000.0


def terrain_towers(*, seed: int = 0, scale: float = 1.0, frames: int = 60) -> Dataset:
    """About 115,000 triangles in 900 objects at scale 1, on an area in proportion to `scale`:
    a square of ground tiles, towers on a jittered grid, birds. Raises InputError for a scale
    or a number of frames that makes none."""
    if not 0.0 < scale <= 100.0:
        raise InputError(
            f"the terrain's scale is {scale}", place="scale", fix="give more than 0, at most 100"
        )
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    rng = np.random.Generator(np.random.PCG64(seed))
    height = partial(_height, rng.uniform(0.0, 2.0 * np.pi, 4))
    tiles = max(3, round(SIDE_AT_SCALE_1_M * math.sqrt(scale) / TILE_M))
    side = tiles * TILE_M
    walk = _walk(side, frames, height)
    return Dataset(
        "terrain_towers",
        (
            *ground(tiles, TILE_M, TILE_TRIANGLES, height),
            *_towers(rng, side, height, walk),
            *_birds(rng, tiles, height),
        ),
        walk,
    )


def _height(phases: Float64, x: Float64, z: Float64) -> Float64:
    """Hills of some 120 and 40 metres from crest to crest."""
    wide = np.sin(x / 19.1 + phases[0]) * np.sin(z / 22.7 + phases[1])
    small = np.sin((x + 0.4 * z) / 6.3 + phases[2]) * np.sin((z - 0.3 * x) / 7.1 + phases[3])
    result: Float64 = 2.5 * wide + 0.3 * small
    return result


def _towers(rng: np.random.Generator, side: float, height: Height, walk: CameraPath) -> list[Node]:
    stock = [_mesh(f"tower-{k}", _tower(rng)) for k in range(SHAPES_A_KIND)]
    count = max(1, round(side / TOWER_PITCH_M))
    spots = np.stack(np.meshgrid(*[np.arange(count)] * 2, indexing="ij"), -1).reshape(-1, 2)
    places = (spots + rng.uniform(0.15, 0.85, spots.shape)) * (side / count)
    picks = rng.integers(0, SHAPES_A_KIND, len(places))
    turns = rng.integers(0, 4, len(places))
    eyes = np.array([camera.eye for camera in walk])[:, [0, 2]]
    nodes: list[Node] = []
    for place, pick, turn in zip(places, picks.tolist(), turns.tolist(), strict=True):
        if np.linalg.norm(eyes - place, axis=1).min() < CLEARANCE_M:
            continue
        # Sunk into the hill, so that no side of it hangs in the air.
        base = float(height(place[0], place[1])) - 2.0
        nodes.append(
            _node(f"tower-{len(nodes):03d}", stock[pick], (place[0], base, place[1]), turn)
        )
    return nodes


def _birds(rng: np.random.Generator, tiles: int, height: Height) -> list[Node]:
    stock = [_mesh(f"bird-{k}", _bird(rng)) for k in range(SHAPES_A_KIND)]
    count = max(4, round(BIRDS_A_TILE * tiles * tiles))
    places = rng.uniform(0.0, tiles * TILE_M, (count, 2))
    above = rng.uniform(*BIRD_HEIGHT_M, count)
    picks, turns = rng.integers(0, SHAPES_A_KIND, count), rng.integers(0, 4, count)
    return [
        _node(
            f"bird-{k:04d}",
            stock[int(picks[k])],
            (places[k, 0], float(height(*places[k])) + above[k], places[k, 1]),
            int(turns[k]),
        )
        for k in range(count)
    ]


def _walk(side: float, frames: int, height: Height) -> CameraPath:
    """Swaying through the middle, and looking ahead and down."""
    cameras = []
    for s, eye, ahead in WALK.steps(side, frames, height):
        ahead[1] = -PITCH_DOWN + 0.03 * math.sin(0.21 * s)
        pose = look_at(eye, eye + ahead)
        cameras.append(Camera(pose, 640, 480, near=NEAR_M, far=FAR_M, yfov=math.pi / 4))
    return CameraPath(tuple(cameras))


def _mesh(name: str, parts: dict[str, Soup]) -> Mesh:
    return plain(name, parts)[0]


def _node(name: str, mesh: Mesh, at: tuple[float, float, float], turns: int) -> Node:
    matrix = np.eye(4)
    matrix[:3, :3] = quarter_turn(turns)
    matrix[:3, 3] = snap(at)
    return Node(name, mesh, matrix)


def _tower(rng: np.random.Generator) -> dict[str, Soup]:
    """A round tower with a parapet of merlons and a conical roof, all of them solids."""
    radius, tall = rng.uniform(2.5, 4.0), rng.uniform(14.0, 24.0)
    shaft = lathe(
        [(1.15 * radius, 0.0), (radius, 5.0), (radius, tall - 1.0), (1.2 * radius, tall)], 24
    )
    spots = ring(1.08 * radius, 12)
    middle = np.stack([spots[:, 0], np.full(12, tall + 0.6), spots[:, 1]], axis=1)
    half = np.array([0.35, 0.6, 0.35])
    roof = lathe([(0.85 * radius, tall), (0.85 * radius, tall + 1.5), (0.02, tall + 5.0)], 24)
    return {"wall": merge([shaft, boxes(middle - half, middle + half)]), "roof": roof}


def _bird(rng: np.random.Generator) -> dict[str, Soup]:
    """A body and two wings, each a sheet of no thickness, raised or lowered."""
    span, lift = rng.uniform(0.8, 1.4), rng.uniform(-0.3, 0.5)
    body = lathe([(0.02, -0.6), (0.16, -0.1), (0.14, 0.3), (0.02, 0.55)], 6, caps="")
    along_z = (body[0] @ np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]), body[1])
    wings = []
    for way in (-1.0, 1.0):
        points = [
            (0, 0, -0.3),
            (0, 0, 0.3),
            (way * span / 2, lift, 0.25),
            (way * span, lift / 2, 0),
        ]
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        wings.append((np.array(points), faces if way > 0.0 else faces[:, ::-1]))
    return {"cloth": merge([along_z, *wings])}
