"""The forest of Hey, Tobler, Purgathofer 2001: 1,694,426 triangles, each tree an object.

"Real-Time Occlusion Culling With A Lazy Occlusion Grid" (TR-186-2-01-02, section 7) walks
through a forest of so many triangles, of which it says no more. This one has broad-leaved
trees, spruces and shrubs on hilly ground, close enough that few are seen at once, and a walk
that winds between them. The ground comes in tiles; a meadow beside it takes the triangles that
make no further tree.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import Mesh, Node
from visref_datasets_gen.shapes import Float64, Soup, icosphere, lathe, merge, quarter_turn, snap
from visref_datasets_gen.stock import plain
from visref_datasets_gen.terrain import Height, Winding, ground, patch

TRIANGLES_AT_SCALE_1 = 1_694_426

TREE_PITCH_M = 2.9
TILE_M = 25.0
TILE_TRIANGLES = 128
SHAPES_A_KIND = 4
KINDS_SHARE = {"broadleaf": 0.4, "spruce": 0.45, "shrub": 0.15}
CLEARANCE_M = 2.4  # from the walk to a trunk
WALK = Winding(step_m=0.6, reach=0.45, sway_m=4.0, bend_m=7.0, eye_m=1.7)
FAR_M = 400.0


def forest(*, seed: int = 0, scale: float = 1.0, frames: int = 60) -> Dataset:
    """1,694,426 triangles at scale 1, and `scale` times as many, rounded, at another.

    The path (1280 by 960) winds through the middle. Raises InputError for a scale too small
    for a tree, or a path without frames.
    """
    if not 0.0 < scale <= 20.0:
        raise InputError(
            f"the forest's scale is {scale}", place="scale", fix="give more than 0, at most 20"
        )
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    total = round(TRIANGLES_AT_SCALE_1 * scale)
    rng = np.random.Generator(np.random.PCG64(seed))
    height = partial(_height, rng.uniform(0.0, 2.0 * np.pi, 6))
    stock = {
        kind: [_mesh(kind, number, make(rng)) for number in range(SHAPES_A_KIND)]
        for kind, make in _KINDS.items()
    }
    average = sum(KINDS_SHARE[kind] * _size(stock[kind][0]) for kind in stock)
    a_tile = TILE_TRIANGLES + (TILE_M / TREE_PITCH_M) ** 2 * average
    tiles = max(1, round(math.sqrt(total / a_tile)))
    left = total - tiles**2 * TILE_TRIANGLES
    if left < max(_size(mesh) for meshes in stock.values() for mesh in meshes):
        raise InputError(
            f"{total} triangles are not enough for a tree",
            place="scale",
            fix="give a greater scale",
        )
    side = tiles * TILE_M
    nodes = ground(tiles, TILE_M, TILE_TRIANGLES, height)
    walk = _walk(side, frames, height)
    trees, left = _trees(rng, stock, side, height, walk, left)
    if left:
        meadow = patch((side, 0.0), (side + TILE_M, side), left, height)
        nodes.append(Node("meadow", plain("meadow", {"lawn": meadow})[0]))
    return Dataset("forest", (*nodes, *trees), walk)


def _size(mesh: Mesh) -> int:
    return sum(len(part.triangles) for part in mesh.primitives)


def _mesh(kind: str, number: int, parts: dict[str, Soup]) -> Mesh:
    return plain(f"{kind}-{number}", parts)[0]


def _height(phases: Float64, x: Float64, z: Float64) -> Float64:
    """Hills of about 60 and 25 metres from crest to crest."""
    wide = np.sin(x / 9.7 + phases[0]) * np.sin(z / 11.3 + phases[1])
    tilted = np.sin((x + 0.7 * z) / 10.9 + phases[2])
    small = np.sin(x / 4.1 + phases[3]) * np.sin((z - 0.3 * x) / 3.7 + phases[4])
    result: Float64 = 2.6 * wide + 1.8 * tilted + 0.35 * small
    return result


def _trees(
    rng: np.random.Generator,
    stock: dict[str, list[Mesh]],
    side: float,
    height: Height,
    walk: CameraPath,
    left: int,
) -> tuple[list[Node], int]:
    """Trees on a jittered grid, nearest to the middle first, until the triangles that are left
    make no other; returns those too."""
    count = math.ceil(side / TREE_PITCH_M) + 2
    spots = np.stack(np.meshgrid(*[np.arange(count)] * 2, indexing="ij"), -1).reshape(-1, 2)
    places = (spots + rng.uniform(0.1, 0.9, spots.shape)) * (side / (count - 2))
    places = places[np.argsort(np.abs(places - side / 2.0).max(axis=1), kind="stable")]
    kinds = rng.choice(list(stock), len(places), p=list(KINDS_SHARE.values()))
    picks = rng.integers(0, (SHAPES_A_KIND, 4), (len(places), 2))
    eyes = np.array([camera.eye for camera in walk])[:, [0, 2]]
    least = min(_size(mesh) for meshes in stock.values() for mesh in meshes)
    nodes: list[Node] = []
    for place, kind, (pick, turns) in zip(places, kinds, picks.tolist(), strict=True):
        if np.abs(eyes - place).max(axis=1).min() < CLEARANCE_M:
            continue
        mesh = stock[str(kind)][pick]
        if _size(mesh) > left:
            if left < least:
                break
            continue
        matrix = np.eye(4)
        matrix[:3, :3] = quarter_turn(turns)
        matrix[:3, 3] = snap([place[0], float(height(place[0], place[1])) - 0.1, place[1]])
        nodes.append(Node(f"{kind}-{len(nodes):05d}", mesh, matrix))
        left -= _size(mesh)
    return nodes, left


def _walk(side: float, frames: int, height: Height) -> CameraPath:
    """Swaying through the middle, and looking where the walk goes."""
    cameras = []
    for s, eye, ahead in WALK.steps(side, frames, height):
        ahead[1] = 0.04 * math.sin(0.31 * s)
        pose = look_at(eye, eye + ahead)
        cameras.append(Camera(pose, 1280, 960, near=0.1, far=FAR_M, yfov=math.pi / 4))
    return CameraPath(tuple(cameras))


def _broadleaf(rng: np.random.Generator) -> dict[str, Soup]:
    """A crown of one large clump and four small ones, down to a man's height."""
    tall = rng.uniform(4.5, 6.5)
    trunk = lathe([(0.28, 0.0), (0.16, 1.2), (0.1, tall)], 6, caps="")
    clumps = [_clump(rng, 2, (0.0, 0.62 * tall, 0.0), (1.75, 0.5 * tall, 1.75))]
    for k in range(2):
        angle = rng.uniform(0.0, np.pi) + np.pi * k
        at = (0.9 * math.cos(angle), (0.35 + 0.3 * k) * tall, 0.9 * math.sin(angle))
        clumps.append(_clump(rng, 0, at, (0.9, 0.8, 0.9)))
    return {"bark": trunk, "leaf": merge(clumps)}


def _spruce(rng: np.random.Generator) -> dict[str, Soup]:
    """Tiers of branches from the ground up."""
    tall, wide = rng.uniform(7.0, 10.0), rng.uniform(1.5, 1.9)
    tiers = []
    for k in range(12):
        base = 0.25 + (tall - 1.5) * k / 12.0
        radius = (wide * (1.0 - k / 13.0)) * rng.uniform(0.9, 1.1)
        top = base + 0.24 * tall * (1.0 - 0.4 * k / 12.0)
        tiers.append(lathe([(radius, base), (0.05, top)], 12, caps="0"))
    return {"bark": lathe([(0.2, 0.0), (0.1, tall * 0.5)], 6, caps=""), "leaf": merge(tiers)}


def _shrub(rng: np.random.Generator) -> dict[str, Soup]:
    clumps = [
        _clump(
            rng,
            1,
            (0.5 * math.cos(angle), 0.8, 0.5 * math.sin(angle)),
            (0.9, rng.uniform(0.9, 1.5), 0.9),
        )
        for angle in (0.0, 2.1, 4.2)
    ]
    return {"leaf": merge(clumps)}


def _clump(
    rng: np.random.Generator,
    subdivisions: int,
    centre: tuple[float, float, float],
    radius: tuple[float, float, float],
) -> Soup:
    vertices, faces = icosphere(subdivisions)
    wobble = 1.0 + rng.uniform(-0.12, 0.12, (len(vertices), 1))
    return vertices * wobble * np.array(radius) + np.array(centre), faces


_KINDS: dict[str, Callable[[np.random.Generator], dict[str, Soup]]] = {
    "broadleaf": _broadleaf,
    "spruce": _spruce,
    "shrub": _shrub,
}
