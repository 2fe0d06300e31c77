"""The city data set at the size of Hey, Tobler, Purgathofer 2001: 34,034,176 triangles.

"Real-Time Occlusion Culling With A Lazy Occlusion Grid" (TR-186-2-01-02, section 7) walks
through a city of so many triangles, made of several copies of a model of Vienna. This one is
`city` with as many blocks as fit, instanced, and a field on the first plot that is
left, tessellated so that the number is exact. As in an old town no street runs on for
kilometres: every third one, or so, ends at a house.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref_datasets_gen.city import BLOCK_M, PITCH_M, STREET_M, VARIANTS, CityMaker
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import Node
from visref_datasets_gen.shapes import Float64
from visref_datasets_gen.stock import placed, plain
from visref_datasets_gen.terrain import patch
from visref_datasets_gen.walk import walk

TRIANGLES_AT_SCALE_1 = 34_034_176

FAR_M = 1000.0

# Of the streets between two crossings, how many a house closes; and how many crossings around
# the walk are left open.
CLOSED_SHARE = 0.35
OPEN_AROUND = 1

# A little less than a block has with its streets, so that some plots are left over.
LEAST_A_BLOCK = 21_000


def city_large(*, seed: int = 0, scale: float = 1.0, frames: int = 60) -> Dataset:
    """34,034,176 triangles at scale 1, and `scale` times as many, rounded, at another.

    The path (1280 by 960) is the city's: round a corner, a cut, round another; but it sees a
    kilometre far, which leaves some 6 % of the triangles in the view, as in the paper. Raises
    InputError for a scale that leaves no room for a block, or a path without frames.
    """
    if not 0.0 < scale <= 4.0:
        raise InputError(
            f"the city's scale is {scale}", place="scale", fix="give more than 0, at most 4"
        )
    total = round(TRIANGLES_AT_SCALE_1 * scale)
    plots = max(1, -(-total // LEAST_A_BLOCK))
    columns = math.ceil(math.sqrt(plots))
    rows = math.ceil(plots / columns)
    maker = CityMaker(seed, columns, rows)
    nodes = [maker.ground(), *maker.streets(), *_closures(maker)]
    left = total - sum(map(triangles_of, nodes))
    built = 0
    while built < columns * rows:
        block = maker.block(built)
        size = triangles_of(block)
        if size > left:
            break
        nodes.append(block)
        left -= size
        built += 1
    if not built:
        raise InputError(
            f"{total} triangles are not enough for a block",
            place="scale",
            fix="give a greater scale",
        )
    if left:
        i, j = built % columns, built // columns
        nodes.append(_field((i + 0.5) * PITCH_M[0], (j + 0.5) * PITCH_M[1], left))
    path = walk(columns, rows, PITCH_M, STREET_M, frames)
    path = CameraPath(tuple(replace(camera, far=FAR_M) for camera in path))
    return Dataset("city_large", tuple(nodes), path)


def _closures(maker: CityMaker) -> list[Node]:
    """Houses across streets, away from the walk, which turns at two crossings of the middle."""
    rng = np.random.Generator(np.random.PCG64([maker.seed, *b"closures"]))
    middle = np.array([(maker.columns + 1) // 2, (maker.rows + 1) // 2])
    nodes = []
    for j in range(maker.rows + 1):
        for i in range(maker.columns + 1):
            for along, (x, z) in enumerate(((PITCH_M[0] / 2, 0.0), (0.0, PITCH_M[1] / 2))):
                closed = rng.random() < CLOSED_SHARE
                variant, tint, turns = rng.integers(0, (VARIANTS, 3, 2)).tolist()
                away = np.array([i, j]) - middle
                if not closed or np.abs(away + 0.5).max() <= OPEN_AROUND + 1.0:
                    continue
                mesh, _, _ = maker.stock.building("walkup", int(STREET_M), variant, tint)
                at = (i * PITCH_M[0] - STREET_M / 2 + x, 0.0, j * PITCH_M[1] - STREET_M / 2 + z)
                # Its front looks along the street.
                nodes.append(placed(f"closure-{i}-{j}-{along}", mesh, at, 2 * turns + 1 - along))
    return nodes


def triangles_of(node: Node) -> int:
    """Triangles of a node and all below it."""
    own = sum(len(part.triangles) for part in node.mesh.primitives) if node.mesh else 0
    return own + sum(map(triangles_of, node.children))


def _field(x: float, z: float, triangles: int) -> Node:
    """A ploughed field on a plot around (x, z)."""
    half = (BLOCK_M[0] / 2, BLOCK_M[1] / 2)

    def furrows(x: Float64, z: Float64) -> Float64:
        result: Float64 = 0.02 + 0.06 * np.sin(7.0 * x) ** 2 + 0.0 * z
        return result

    soup = patch((-half[0], -half[1]), half, triangles, furrows)
    return placed("field", plain("field", {"earth": soup}), (x, 0.0, z))
