"""A blood-vessel tree as an isosurface: many shapes, almost no occlusion.

The counterpart of "Angio", the scan on which Staneker, Bartz and Meissner ("Improving
Occlusion Query Efficiency with Occupancy Maps", 2003, section 5) measure low occlusion: 177
shapes, 419,639 triangles, seen at 876 by 584 while the model turns about its axes, then from
nearer and back. Theirs is a medical scan; this one is grown and scanned here. The tree grows
by space colonisation (Runions et al. 2007), its radii follow Murray's law, and the surface is
that of a volume: tapered capsules, blended, sampled on a grid and cut open where the trunk
leaves it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import Material, Mesh, Node, Primitive
from visref_datasets_gen.isosurface import isosurface
from visref_datasets_gen.orbit import orbit
from visref_datasets_gen.refine import split_to

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Surface = tuple[Float64, Int64]

SHAPES = 177
TRIANGLES_AT_SCALE_1 = 419_639
# Below this many triangles a shape, there are fewer shapes.
LEAST_TRIANGLES_A_SHAPE = 40

HALF_EXTENT_MM = (60.0, 70.0, 50.0)
TIP_RADIUS_MM = 0.65
ENDS_AT_SCALE_1 = 520

_BLOOD = Material("vessel", (0.55, 0.07, 0.06, 1.0), double_sided=False)


def angio(*, seed: int = 0, scale: float = 1.0, frames: int = 90) -> Dataset:
    """419,639 triangles at scale 1 and in proportion otherwise: fewer branches below 1, a
    finer scan above. 177 shapes of equal size, each of neighbouring triangles.

    Two thirds of the path turn the model about its three axes, one after another; the rest
    moves in on it and back. Raises InputError for a scale or a number of frames that makes
    no vessel.
    """
    count = round(TRIANGLES_AT_SCALE_1 * scale) if 0.0 < scale <= 10.0 else 0
    if count < 1000:
        raise InputError(f"the vessels' scale is {scale}", place="scale", fix="give 0.0025 to 10")
    rng = np.random.Generator(np.random.PCG64(seed))
    points, parent = _grow(rng, round(ENDS_AT_SCALE_1 * min(max(scale, 0.05), 1.0)))
    vertices, triangles = _surface(points, parent, _radii(parent), count)
    shapes = max(1, min(SHAPES, count // LEAST_TRIANGLES_A_SHAPE))
    nodes = tuple(
        Node(f"vessel-{number:03d}", _mesh(f"vessel-{number:03d}", vertices, part))
        for number, part in enumerate(_parts(vertices, triangles, shapes))
    )
    return Dataset("angio", nodes, orbit(frames, nodes, (14.0, 8.0, 0.0), nearest=0.4))


def _grow(rng: np.random.Generator, count: int) -> tuple[Float64, Int64]:
    """A tree to `count` ends: its points (n, 3), millimetres, and each one's parent (the
    root's is itself)."""
    step, reach = 2.0, 4.0
    half = np.array(HALF_EXTENT_MM)
    ball = rng.normal(size=(count, 3))
    ball *= (rng.random((count, 1)) ** 0.35) / np.linalg.norm(ball, axis=1)[:, None]
    ends = ball * (half - 4.0)
    points = [np.array([0.0, -half[1], 0.0])]
    parent = [0]
    while points[-1][1] < -0.55 * half[1]:
        drift = rng.normal(scale=0.15, size=3)
        points.append(points[-1] + step * np.array([drift[0], 1.0, drift[2]]))
        parent.append(len(points) - 2)
    tree = np.array(points)
    line = np.array(parent, np.int64)
    nearest = np.full(len(ends), np.inf)
    owner = np.zeros(len(ends), np.int64)
    fresh = 0
    while len(ends):
        gap = np.linalg.norm(ends[:, None] - tree[None, fresh:], axis=2)
        closer = gap.min(axis=1) < nearest
        owner = np.where(closer, gap.argmin(axis=1) + fresh, owner)
        nearest = np.minimum(nearest, gap.min(axis=1))
        wanted = nearest > reach
        ends, nearest, owner = ends[wanted], nearest[wanted], owner[wanted]
        if not len(ends):
            break
        pull = (ends - tree[owner]) / nearest[:, None]
        growing, index = np.unique(owner, return_inverse=True)
        way = np.zeros((len(growing), 3))
        np.add.at(way, index, pull)
        before = tree[growing] - tree[line[growing]]
        # A vessel keeps some of its course, and wanders.
        way = _unit(_unit(way) + 0.5 * _unit(before) + rng.normal(scale=0.22, size=way.shape))
        fresh = len(tree)
        tree = np.concatenate([tree, tree[growing] + step * way])
        line = np.concatenate([line, growing])
    return tree, line


def _unit(vectors: Float64) -> Float64:
    length = np.linalg.norm(vectors, axis=1)[:, None]
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def _radii(parent: Int64) -> Float64:
    """Murray's law: a vessel's radius cubed is the sum of its branches' cubed."""
    cubed = np.zeros(len(parent))
    for point in range(len(parent) - 1, 0, -1):
        # Children have greater numbers than their parents, so this one's sum is complete.
        cubed[point] = max(cubed[point], TIP_RADIUS_MM**3)
        cubed[parent[point]] += cubed[point]
    return np.asarray(np.cbrt(cubed))


def _surface(points: Float64, parent: Int64, radius: Float64, count: int) -> Surface:
    """The vessels' surface with exactly `count` triangles."""
    # Triangles go with the inverse square of the grid's step; the first guess is measured on a
    # coarse grid, and two or three more settle just below the number wanted.
    step = 3.0
    aim = 0.985 * count
    surface = _scan(points, parent, radius, step)
    while not 0.96 * count <= len(surface[1]) <= count:
        step *= math.sqrt(len(surface[1]) / aim)
        surface = _scan(points, parent, radius, step)
    return split_to(surface, count)


def _scan(points: Float64, parent: Int64, radius: Float64, step: float) -> Surface:
    """The isosurface on a grid of `step` millimetres."""
    # A vessel thinner than a grid step would break into beads.
    radius = np.maximum(radius, 0.9 * step)
    blend = 0.35 * TIP_RADIUS_MM
    low = np.minimum(points.min(axis=0), -np.array(HALF_EXTENT_MM)) - radius.max() - 3 * step
    high = np.maximum(points.max(axis=0), np.array(HALF_EXTENT_MM)) + radius.max() + 3 * step
    # The trunk leaves the volume through its floor.
    low[1] = points[0, 1] + 0.5 * step
    shape = np.ceil((high - low) / step).astype(np.int64) + 1
    total = np.zeros(shape, np.float32)
    for point in range(1, len(points)):
        a, b = points[parent[point]], points[point]
        ra, rb = radius[parent[point]], radius[point]
        # A branch starts as thick as itself, not as its parent.
        ra = min(ra, 1.25 * rb)
        margin = max(ra, rb) + 6.0 * blend + step
        first = np.floor((np.minimum(a, b) - margin - low) / step).astype(np.int64)
        last = np.ceil((np.maximum(a, b) + margin - low) / step).astype(np.int64) + 1
        first, last = np.maximum(first, 0), np.minimum(last, shape)
        if (first >= last).any():
            continue
        x, y, z = (low[k] + step * np.arange(first[k], last[k]) - a[k] for k in range(3))
        along = b - a
        t = x[:, None, None] * along[0] + y[:, None] * along[1] + z * along[2]
        t = np.clip(t / (along @ along), 0.0, 1.0)
        gap = np.sqrt(
            (x[:, None, None] - t * along[0]) ** 2
            + (y[:, None] - t * along[1]) ** 2
            + (z - t * along[2]) ** 2
        )
        window = tuple(slice(i, j) for i, j in zip(first, last, strict=True))
        total[window] += np.exp(-(gap - (ra + t * (rb - ra))) / blend).astype(np.float32)
    # Far from every vessel the sum is 0; its logarithm only needs to be well outside.
    field = np.log(np.maximum(total, np.float32(1e-9)))
    vertices, triangles = isosurface(field)
    return low + step * vertices, triangles


def _parts(vertices: Float64, triangles: Int64, count: int) -> list[Int64]:
    """The triangles in `count` groups of nearly equal size, by halving along the widest axis."""
    if count == 1:
        return [triangles]
    centres = vertices[triangles].mean(axis=1)
    axis = int(np.argmax(np.ptp(centres, axis=0)))
    order = np.argsort(centres[:, axis], kind="stable")
    left = count // 2
    at = len(triangles) * left // count
    return [
        *_parts(vertices, triangles[order[:at]], left),
        *_parts(vertices, triangles[order[at:]], count - left),
    ]


def _mesh(name: str, vertices: Float64, triangles: Int64) -> Mesh:
    used, index = np.unique(triangles, return_inverse=True)
    primitive = Primitive(
        vertices[used].astype(np.float32), index.reshape(-1, 3).astype(np.uint32), _BLOOD
    )
    return Mesh(name, (primitive,))
