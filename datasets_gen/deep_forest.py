"""A forest of 1,694,426 triangles in which few trees show: that of Hey 2001, by its text.

"Real-Time Occlusion Culling With A Lazy Occlusion Grid" (TR-186-2-01-02, section 7 and Fig. 7) says
of its forest: 1,694,426 triangles; each tree a primitive object with a box of its own; a
walkthrough on whose frames 147,969 triangles a frame are in the view, 8.7 % of all, and 7,009 or
7,510 of these are drawn, 4.7 or 5.1 %. No more is said, and this is what follows, written down
before anything was measured:

- The walk is among the trees, and every tree drawn is one whose box is not seen to be hidden: so
  few trees show that with those whose boxes do they are a twentieth of what is in the view. They
  stand so close that their crowns meet, and have leaves from the ground up: there is no seeing
  under them, nor above, since they are four to six times as high as the eye.
- How many trees there are is not said. Few of many triangles or many of few: a twentieth of the
  view must be more than the ring around the eye. Here a tree has about a hundred triangles, as in
  other scenes of the time: 17,000 trees, 1,480 in the view, 70 drawn.
- A tree for each square of 2.6 metres, crowns 3.8 metres wide; so 1,480 trees take 10,000 square
  metres, which a view 58 degrees wide has within 140 metres. So far is the far plane.
- The ground is all but flat: a hill would show its trees over those before it.
- The walk winds, with no more room than it needs: what lies along it is soon out of sight too.
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
from visref_datasets_gen.shapes import Float64, Soup, icosphere, lathe, quarter_turn, snap
from visref_datasets_gen.stock import plain
from visref_datasets_gen.terrain import Height, Winding, ground, patch

TRIANGLES_AT_SCALE_1 = 1_694_426

TREE_PITCH_M = 2.6
CROWN_RADIUS_M = 1.9
TILE_M = 26.0
TILE_TRIANGLES = 32
SHAPES_A_KIND = 4
BROADLEAF_SHARE = 0.6
CLEARANCE_M = 2.2  # from the walk to a trunk, along x or z
WALK = Winding(step_m=0.6, reach=0.4, sway_m=4.0, bend_m=7.0, eye_m=1.7)
FAR_M = 140.0


def deep_forest(*, seed: int = 0, scale: float = 1.0, frames: int = 60) -> Dataset:
    """1,694,426 triangles in 17,000 objects at scale 1, and `scale` times as many triangles,
    rounded, at another. The path (1280 by 960) winds through the middle. Raises InputError for a
    scale too small for a tree, or a path without frames."""
    if not 0.0 < scale <= 20.0:
        raise InputError(
            f"the forest's scale is {scale}", place="scale", fix="give more than 0, at most 20"
        )
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    total = round(TRIANGLES_AT_SCALE_1 * scale)
    rng = np.random.Generator(np.random.PCG64(seed))
    height = partial(_height, rng.uniform(0.0, 2.0 * np.pi, 2))
    stock = {
        kind: [plain(f"{kind}-{k}", make(rng))[0] for k in range(SHAPES_A_KIND)]
        for kind, make in _KINDS.items()
    }
    sizes = {kind: _size(meshes[0]) for kind, meshes in stock.items()}
    average = BROADLEAF_SHARE * sizes["broadleaf"] + (1.0 - BROADLEAF_SHARE) * sizes["fir"]
    a_tile = TILE_TRIANGLES + (TILE_M / TREE_PITCH_M) ** 2 * average
    tiles = max(1, round(math.sqrt(total / a_tile)))
    left = total - tiles**2 * TILE_TRIANGLES
    if left < max(sizes.values()):
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
    return Dataset("deep_forest", (*nodes, *trees), walk)


def _size(mesh: Mesh) -> int:
    return sum(len(part.triangles) for part in mesh.primitives)


def _height(phases: Float64, x: Float64, z: Float64) -> Float64:
    """Less than half a metre up and down, some 100 metres from crest to crest."""
    result: Float64 = 0.4 * np.sin(x / 15.7 + phases[0]) * np.sin(z / 17.3 + phases[1])
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
    places = (spots + rng.uniform(0.25, 0.75, spots.shape)) * TREE_PITCH_M
    places += 0.5 * (side - count * TREE_PITCH_M)
    places = places[np.argsort(np.abs(places - side / 2.0).max(axis=1), kind="stable")]
    broad = rng.random(len(places)) < BROADLEAF_SHARE
    picks = rng.integers(0, (SHAPES_A_KIND, 4), (len(places), 2))
    eyes = np.array([camera.eye for camera in walk])[:, [0, 2]]
    least = min(_size(mesh) for meshes in stock.values() for mesh in meshes)
    nodes: list[Node] = []
    for place, is_broad, (pick, turns) in zip(places, broad, picks.tolist(), strict=True):
        if np.abs(eyes - place).max(axis=1).min() < CLEARANCE_M:
            continue
        kind = "broadleaf" if is_broad else "fir"
        mesh = stock[kind][pick]
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
    for _, eye, ahead in WALK.steps(side, frames, height):
        pose = look_at(eye, eye + ahead)
        cameras.append(Camera(pose, 1280, 960, near=0.1, far=FAR_M, yfov=math.pi / 4))
    return CameraPath(tuple(cameras))


def _broadleaf(rng: np.random.Generator) -> dict[str, Soup]:
    """A crown from the ground up."""
    tall = rng.uniform(8.0, 10.0)
    points, faces = icosphere(1)
    wobble = 1.0 + rng.uniform(-0.06, 0.06, (len(points), 1))
    radius = np.array([CROWN_RADIUS_M, 0.52 * tall, CROWN_RADIUS_M])
    crown = points * wobble * radius + np.array([0.0, 0.5 * tall, 0.0])
    return {"bark": lathe([(0.2, 0.0), (0.1, 0.5 * tall)], 6, caps=""), "leaf": (crown, faces)}


def _fir(rng: np.random.Generator) -> dict[str, Soup]:
    """One whorl of branches above another, the widest near the ground."""
    tall = rng.uniform(8.0, 10.0)
    wide = CROWN_RADIUS_M * rng.uniform(0.95, 1.05)
    profile = [(0.8 * wide, 0.0), (wide, 0.2 * tall), (0.95 * wide, 0.5 * tall),
               (0.7 * wide, 0.8 * tall), (0.02, tall)]  # fmt: skip
    return {"bark": lathe([(0.2, 0.0), (0.1, 0.5 * tall)], 6, caps=""), "leaf": lathe(profile, 12)}


_KINDS: dict[str, Callable[[np.random.Generator], dict[str, Soup]]] = {
    "broadleaf": _broadleaf,
    "fir": _fir,
}
