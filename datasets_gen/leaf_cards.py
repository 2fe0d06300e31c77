"""A forest whose leaves are cards: rectangles with a picture of leaves, cut out by its alpha.

So vegetation is drawn in real time, and so a visibility method goes wrong in two ways: it takes
the card for a wall, or it takes it for nothing. Trees are a trunk and a crown, an object each,
and shrubs stand along the walk; the cards are from 1 to 50 metres away.

A sample near a leaf's edge is in doubt, since engines filter differently there. So that a
verdict is about the rest, the leaves are large against a card and a card is large against a
pixel, as far as it goes: most of what is seen is near.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.scene import Alpha
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import AlphaTexture, Material, Mesh, Node, Primitive
from visref_datasets_gen.shapes import Float64, lathe, quads, quarter_turn, snap
from visref_datasets_gen.stock import plain
from visref_datasets_gen.terrain import Height, Winding, ground

SIDE_M = 110.0
TREE_PITCH_M = 4.5
SHRUB_PITCH_M = 3.0
TILE_M = 11.0
TILE_TRIANGLES = 32
SHAPES_A_KIND = 4
TEXELS = 256
# No card comes nearer to the eye than this.
NEAREST_M = 1.0
WALK = Winding(step_m=0.5, reach=0.4, sway_m=4.0, bend_m=7.0, eye_m=1.7)
FAR_M = 200.0

_GREENS = ((0.13, 0.28, 0.07), (0.20, 0.32, 0.08), (0.09, 0.22, 0.08), (0.24, 0.30, 0.10))


@dataclass(frozen=True)
class Plant:
    """`trunk`: a solid one, None for a shrub; `leaves`: the mesh of the cards; `reach_m`: the
    farthest that they come from the plant's axis."""

    trunk: Mesh | None
    leaves: Mesh
    reach_m: float


def leaves(*, seed: int = 0, scale: float = 1.0, frames: int = 60) -> Dataset:
    """About 560 trees, 1,350 shrubs and 54,000 triangles at scale 1, in a square of 110 m; at
    another the square's area is `scale` times as large.

    The path (1280 by 960) winds through the middle. Raises InputError for a scale out of range,
    or a path without frames.
    """
    if not 0.0 < scale <= 20.0:
        raise InputError(f"the scale is {scale}", place="scale", fix="give more than 0, at most 20")
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    rng = np.random.Generator(np.random.PCG64(seed))
    height = partial(_height, rng.uniform(0.0, 2.0 * np.pi, 2))
    textures = [AlphaTexture(leaf_picture(rng)) for _ in range(SHAPES_A_KIND)]
    trees = [_tree(rng, k, textures[k]) for k in range(SHAPES_A_KIND)]
    shrubs = [_shrub(rng, k, textures[-1 - k]) for k in range(SHAPES_A_KIND)]
    tiles = max(2, round(SIDE_M * math.sqrt(scale) / TILE_M))
    side = tiles * TILE_M
    walk = _walk(side, frames, height)
    eyes = np.array([camera.eye for camera in walk])[:, [0, 2]]
    nodes = ground(tiles, TILE_M, TILE_TRIANGLES, height)
    for kind, stock, pitch in (("tree", trees, TREE_PITCH_M), ("shrub", shrubs, SHRUB_PITCH_M)):
        nodes += _planted(rng, kind, stock, pitch, side, height, eyes)
    return Dataset("leaves", tuple(nodes), walk)


def leaf_picture(rng: np.random.Generator) -> NDArray[np.uint8]:
    """(256, 256) uint8: the alpha of some large leaves about a twig, edges a texel wide.

    Sums, products, quotients and square roots only: the same on every machine.
    """
    y, x = np.mgrid[:TEXELS, :TEXELS] + 0.5
    depth = np.full((TEXELS, TEXELS), -np.inf)
    for k in range(5):
        for side in (-1.0, 1.0):
            base = np.array([128.0, 225.0 - 36.0 * k])
            way = np.array([side * rng.uniform(0.75, 1.0), -rng.uniform(0.1, 0.75)])
            way /= math.sqrt(float(way @ way))
            # As far as the margin: beyond it nothing may be cut off by the card's edge.
            long = min(rng.uniform(100.0, 120.0), (120.0 - 3.0) / abs(float(way[0])))
            long = min(long, (float(base[1]) - 8.0) / abs(float(way[1])))
            depth = np.maximum(depth, _leaf(x - base[0], y - base[1], way, long))
    return np.asarray(np.round(255.0 * np.clip(0.5 + depth, 0.0, 1.0)), np.uint8)


def _leaf(x: Float64, y: Float64, way: Float64, long: float) -> Float64:
    """How far inside the edge of a leaf that starts at the origin, in texels, near the edge."""
    half = 0.5 * long
    along = (x * way[0] + y * way[1]) / half - 1.0
    across = np.abs(y * way[0] - x * way[1])
    wide = 0.27 * long
    # |across| < wide (1 - along²), over the length of that function's gradient.
    steep = 2.0 * wide * along / half
    result: Float64 = (wide * (1.0 - along * along) - across) / np.sqrt(1.0 + steep * steep)
    return result


def _tree(rng: np.random.Generator, number: int, texture: AlphaTexture) -> Plant:
    tall = rng.uniform(4.5, 6.0)
    trunk = lathe([(0.24, 0.0), (0.16, 1.2), (0.08, tall)], 7, caps="1")
    name = f"tree-{number}"
    middle = np.array([0.0, 0.55 * tall, 0.0])
    leaves = _cards(rng, 14, middle, np.array([1.0, 0.33 * tall, 1.0]), (2.2, 3.0))
    return _plant(name, plain(name, {"bark": trunk})[0], leaves, number, texture)


def _shrub(rng: np.random.Generator, number: int, texture: AlphaTexture) -> Plant:
    middle = np.array([0.0, 0.65, 0.0])
    leaves = _cards(rng, 6, middle, np.array([0.3, 0.15, 0.3]), (1.1, 1.5))
    return _plant(f"shrub-{number}", None, leaves, number + 1, texture)


def _plant(
    name: str, trunk: Mesh | None, corners: Float64, colour: int, texture: AlphaTexture
) -> Plant:
    vertices, faces = quads(snap(corners))
    green = _GREENS[colour % len(_GREENS)]
    material = Material(f"leaf-{name}", (*green, 1.0), alpha=Alpha.MASK, texture=texture)
    # The corners run from the lower left, counter-clockwise; v runs down the picture.
    uv = np.tile(np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32), (len(corners), 1))
    primitive = Primitive(vertices.astype(np.float32), faces.astype(np.uint32), material, uv)
    reach = float(np.hypot(vertices[:, 0], vertices[:, 2]).max())
    return Plant(trunk, Mesh(f"{name}/leaves", (primitive,)), reach)


def _cards(
    rng: np.random.Generator,
    count: int,
    middle: Float64,
    radius: Float64,
    size_m: tuple[float, float],
) -> Float64:
    """(count, 4, 3) corners of squares that face all ways and lean a little, in an ellipsoid."""
    corners = np.empty((count, 4, 3))
    for k in range(count):
        yaw = 2.0 * np.pi * (k + rng.uniform(0.0, 1.0)) / count
        lean = rng.uniform(-0.4, 0.4)
        across = np.array([math.cos(yaw), 0.0, math.sin(yaw)])
        upward = np.array(
            [-math.sin(yaw) * math.sin(lean), math.cos(lean), math.cos(yaw) * math.sin(lean)]
        )
        place = rng.uniform(-1.0, 1.0, 3)
        place *= radius / max(1.0, math.sqrt(float(place @ place)))
        half = rng.uniform(*size_m) / 2.0
        for corner, (i, j) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
            corners[k, corner] = middle + place + half * (i * across + j * upward)
    # Nothing grows below the ground.
    corners[:, :, 1] += np.maximum(0.05 - corners[:, :, 1].min(axis=1), 0.0)[:, None]
    return corners


def _height(phases: Float64, x: Float64, z: Float64) -> Float64:
    """Low hills, about 70 metres from crest to crest."""
    result: Float64 = 0.8 * np.sin(x / 11.0 + phases[0]) * np.sin(z / 12.0 + phases[1])
    return result


def _planted(
    rng: np.random.Generator,
    kind: str,
    stock: list[Plant],
    pitch: float,
    side: float,
    height: Height,
    eyes: Float64,
) -> list[Node]:
    """Plants on a jittered grid, none with a card nearer to an eye than `NEAREST_M`."""
    count = max(1, round(side / pitch))
    spots = np.stack(np.meshgrid(*[np.arange(count)] * 2, indexing="ij"), -1).reshape(-1, 2)
    places = (spots + rng.uniform(0.1, 0.9, spots.shape)) * (side / count)
    picks = rng.integers(0, (len(stock), 4), (len(places), 2))
    nodes: list[Node] = []
    for place, (pick, turns) in zip(places, picks.tolist(), strict=True):
        plant = stock[pick]
        if np.hypot(*(eyes - place).T).min() < plant.reach_m + NEAREST_M:
            continue
        matrix = np.eye(4)
        matrix[:3, :3] = quarter_turn(turns)
        matrix[:3, 3] = snap([place[0], float(height(place[0], place[1])) - 0.05, place[1]])
        name = f"{kind}-{len(nodes):04d}"
        if plant.trunk is None:
            nodes.append(Node(name, plant.leaves, matrix))
        else:
            nodes.append(Node(name, plant.trunk, matrix, (Node(f"{name}/crown", plant.leaves),)))
    return nodes


def _walk(side: float, frames: int, height: Height) -> CameraPath:
    """Swaying through the middle, and looking where the walk goes."""
    cameras = []
    for s, eye, ahead in WALK.steps(side, frames, height):
        ahead[1] = 0.04 * math.sin(0.31 * s)
        pose = look_at(eye, eye + ahead)
        cameras.append(Camera(pose, 1280, 960, near=0.1, far=FAR_M, yfov=math.pi / 3))
    return CameraPath(tuple(cameras))
