"""A seismic survey as an interpreter sees it: horizons, faults, and slices of the volume.

The kinds of data of a set of slides, "Occlusion Culling" for seismic visualisation: horizons of
high resolution, layered, height fields; faults of lower resolution; slices of the volume, opaque
and of few polygons, or semi-transparent, a stack of them standing in for volume rendering. Those
occlude nothing and may be occluded. No model or path of theirs is available.

Each horizon is a grid of heights, cut into tiles, an object each. Faults throw the layers, and
where a fault cuts a horizon the interpretation has a gap, through which the next layer shows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.scene import Alpha
from visref_datasets_gen.dataset import Dataset
from visref_datasets_gen.graph import Material, Mesh, Node, Primitive

Float64 = NDArray[np.float64]

# The survey: inlines along x, crosslines along z, y up; the first horizon lies 600 m deep.
EXTENT_M = (6000.0, 4500.0)
HORIZONS = 5
FIRST_DEPTH_M = 600.0
LAYER_M = 380.0
TILES = (8, 6)
QUADS_AT_SCALE_1 = 46  # a tile's side
LEAST_QUADS = 4

FAULTS = 4
FAULT_QUADS = (14, 9)  # along strike, along dip
THROW_M = (40.0, 110.0)
GAP_M = 45.0  # on each side of a fault's trace; no interpretation reaches nearer

VOLUME_SLICES = 14

_HORIZON_COLOURS = (
    (0.80, 0.66, 0.25), (0.35, 0.62, 0.30), (0.25, 0.50, 0.70), (0.62, 0.35, 0.55),
    (0.70, 0.40, 0.25),
)  # fmt: skip
_FAULT = Material("fault", (0.55, 0.08, 0.08, 1.0))
_SLICE = Material("slice", (0.60, 0.60, 0.60, 1.0))
_VOLUME = Material("volume", (0.75, 0.75, 0.95, 0.15), alpha=Alpha.BLEND)


@dataclass(frozen=True, eq=False)
class _Fault:
    """A plane that bends a little: x = at + slope * z + bend * sin(z), and leans by `dip`.

    The layers on its far side in x lie `throw_m` lower, and less towards the ends of its
    strike, which reaches from `start` to `end` in z.
    """

    at: float
    start: float
    end: float
    slope: float
    bend_m: float
    phase: float
    throw_m: float
    dip: float

    def trace(self, z: Float64, y: Float64 | float) -> Float64:
        """x of the fault at depth y."""
        bend = self.bend_m * np.sin(2.0 * math.pi * z / EXTENT_M[1] + self.phase)
        return self.at + self.slope * z + bend + self.dip * (y + FIRST_DEPTH_M)

    def throw(self, x: Float64, z: Float64, y: float) -> Float64:
        """By how much layers at depth y have sunk."""
        along = np.clip((z - self.start) / (self.end - self.start), 0.0, 1.0)
        sunk = self.throw_m * np.sin(math.pi * along) * (x > self.trace(z, y))
        return np.asarray(sunk)

    def gap(self, x: Float64, z: Float64, y: float) -> NDArray[np.bool_]:
        """Where layers at depth y are torn."""
        torn = (np.abs(x - self.trace(z, y)) < GAP_M) & (self.start < z) & (z < self.end)
        return np.asarray(torn)


@dataclass(frozen=True, eq=False)
class _Layers:
    """The heights of all horizons. `waves`: (HORIZONS, n, 4): amplitude, two wave numbers and
    a phase of each wave; the deeper a horizon, the more it has been folded."""

    waves: Float64
    faults: tuple[_Fault, ...]

    def height(self, number: int, x: Float64, z: Float64) -> Float64:
        """y in metres."""
        base = -FIRST_DEPTH_M - LAYER_M * number
        y = np.full(np.broadcast(x, z).shape, base)
        # A broad dome and a tilt that all layers share.
        y += 160.0 * np.exp(-(((x - 3400.0) / 1500.0) ** 2) - ((z - 2300.0) / 1300.0) ** 2)
        y += 0.03 * (x - 0.5 * EXTENT_M[0]) - 0.02 * (z - 0.5 * EXTENT_M[1])
        for amplitude, kx, kz, phase in self.waves[number]:
            y += amplitude * np.sin(kx * x + kz * z + phase)
        for fault in self.faults:
            y -= fault.throw(x, z, base)
        return y

    def gap(self, number: int, x: Float64, z: Float64) -> NDArray[np.bool_]:
        """Where no interpretation reaches."""
        base = -FIRST_DEPTH_M - LAYER_M * number
        near = np.zeros(np.broadcast(x, z).shape, np.bool_)
        for fault in self.faults:
            near |= fault.gap(x, z, base)
        return near


def seismic(*, seed: int = 0, scale: float = 1.0, frames: int = 60, tiled: bool = True) -> Dataset:
    """About a million triangles at scale 1, and in proportion: 240 horizon tiles, 4 faults, 3
    opaque and 14 semi-transparent slices. Without `tiled` each of the 5 horizons is one object.

    The path (1024 by 768) looks down on the first horizon, goes round the survey's rim, dives
    between the first two layers and flies there, cuts to between the third and the fourth, and
    ends below them all, looking up. Raises InputError for a scale or a number of frames that
    makes no survey.
    """
    if not 0.0 < scale <= 20.0:
        raise InputError(
            f"the survey's scale is {scale}", place="scale", fix="give more than 0, at most 20"
        )
    if frames < 1:
        raise InputError(f"a path of {frames} frames", place="frames", fix="give 1 or more")
    layers = _layers(np.random.Generator(np.random.PCG64(seed)))
    quads = max(LEAST_QUADS, round(QUADS_AT_SCALE_1 * math.sqrt(scale)))
    nodes = [node for number in range(HORIZONS) for node in _horizon(layers, number, quads, tiled)]
    nodes += [_fault(number, fault) for number, fault in enumerate(layers.faults)]
    return Dataset("seismic", (*nodes, *_slices()), _path(layers, frames))


def _layers(rng: np.random.Generator) -> _Layers:
    waves = np.empty((HORIZONS, 9, 4))
    for number in range(HORIZONS):
        # Long folds to short roughness: a wave number twice as great is half as high.
        length = np.array([2600.0, 1700.0, 1100.0, 700.0, 420.0, 260.0, 160.0, 110.0, 75.0])
        course = rng.uniform(0.0, 2.0 * math.pi, 9)
        waves[number, :, 0] = 0.014 * length * rng.uniform(0.6, 1.4, 9) * (1.0 + 0.15 * number)
        waves[number, :, 1] = 2.0 * math.pi / length * np.cos(course)
        waves[number, :, 2] = 2.0 * math.pi / length * np.sin(course)
        waves[number, :, 3] = rng.uniform(0.0, 2.0 * math.pi, 9)
    faults = []
    for number in range(FAULTS):
        at = EXTENT_M[0] * (number + 1 + rng.uniform(-0.2, 0.2)) / (FAULTS + 1)
        throw = rng.uniform(*THROW_M) * (-1.0 if number % 2 else 1.0)
        slope, bend = rng.uniform(-0.12, 0.12), rng.uniform(40.0, 110.0)
        phase, dip = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(-0.35, 0.35)
        start = rng.uniform(0.0, 0.5) * EXTENT_M[1]
        end = start + rng.uniform(0.35, 0.5) * EXTENT_M[1]
        faults.append(_Fault(at, start, end, slope, bend, phase, throw, dip))
    return _Layers(waves, tuple(faults))


def _horizon(layers: _Layers, number: int, quads: int, tiled: bool) -> list[Node]:
    """The tiles, neighbours sharing the heights along their common side; or the horizon whole."""
    colour = (*_HORIZON_COLOURS[number % len(_HORIZON_COLOURS)], 1.0)
    material = Material(f"horizon-{number}", colour)
    columns, rows = TILES[0] * quads + 1, TILES[1] * quads + 1
    x = EXTENT_M[0] * np.arange(columns) / (columns - 1)
    z = EXTENT_M[1] * np.arange(rows) / (rows - 1)
    grid = np.stack(np.broadcast_arrays(x[:, None], 0.0, z[None]), axis=-1).copy()
    grid[..., 1] = layers.height(number, x[:, None], z[None])
    open_here = layers.gap(number, x[:, None], z[None])
    if not tiled:
        return [_grid_node(f"horizon-{number}", grid, material, open_here)]
    nodes = []
    for i in range(TILES[0]):
        for j in range(TILES[1]):
            part = (
                slice(i * quads, (i + 1) * quads + 1),
                slice(j * quads, (j + 1) * quads + 1),
            )
            name = f"horizon-{number}-tile-{i}-{j}"
            nodes.append(_grid_node(name, grid[part], material, open_here[part]))
    return nodes


def _fault(number: int, fault: _Fault) -> Node:
    """From above the first horizon to below the last, on a coarse grid."""
    z = fault.start + (fault.end - fault.start) * np.arange(FAULT_QUADS[0] + 1) / FAULT_QUADS[0]
    top, bottom = -FIRST_DEPTH_M + 220.0, -FIRST_DEPTH_M - LAYER_M * HORIZONS
    y = top + (bottom - top) * np.arange(FAULT_QUADS[1] + 1) / FAULT_QUADS[1]
    grid = np.empty((len(z), len(y), 3))
    grid[..., 0] = fault.trace(z[:, None], y[None])
    grid[..., 1], grid[..., 2] = y, z[:, None]
    return _grid_node(f"fault-{number}", grid, _FAULT)


def _slices() -> list[Node]:
    """An inline, a crossline and a time slice, opaque; and a block of the volume as a stack."""
    x, z = EXTENT_M
    top, bottom = -FIRST_DEPTH_M + 300.0, -FIRST_DEPTH_M - LAYER_M * HORIZONS
    height = (0.0, top - bottom, 0.0)
    middle = -FIRST_DEPTH_M - 2.45 * LAYER_M
    opaque = {
        "inline": _rectangle((0.62 * x, bottom, 0.0), (0.0, 0.0, 0.55 * z), height),
        "crossline": _rectangle((0.0, bottom, 0.7 * z), (0.45 * x, 0.0, 0.0), height),
        "time": _rectangle((0.5 * x, middle, 0.4 * z), (0.5 * x, 0.0, 0.0), (0.0, 0.0, 0.6 * z)),
    }
    nodes = [_grid_node(f"slice-{name}", points, _SLICE) for name, points in opaque.items()]
    for number in range(VOLUME_SLICES):
        at = 0.30 * x + 0.22 * x * number / (VOLUME_SLICES - 1)
        part = _rectangle((at, top - 950.0, 0.15 * z), (0.0, 0.0, 0.4 * z), (0.0, 700.0, 0.0))
        nodes.append(_grid_node(f"volume-slice-{number:02d}", part, _VOLUME))
    return nodes


Way = tuple[float, float, float]


def _rectangle(corner: Way, along: Way, up: Way) -> Float64:
    """(2, 2, 3) corners."""
    ways = np.array([along, up])
    steps = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    points: Float64 = np.array(corner) + steps[:, :1] * ways[0] + steps[:, 1:] * ways[1]
    return points.reshape(2, 2, 3)


def _grid_node(
    name: str, points: Float64, material: Material, open_here: NDArray[np.bool_] | None = None
) -> Node:
    """A node of two triangles for each cell of (n, m, 3) points, none where a corner is open."""
    n, m = points.shape[:2]
    corner = (np.arange(n - 1)[:, None] * m + np.arange(m - 1)).reshape(-1)
    if open_here is not None:
        shut = ~(open_here[:-1, :-1] | open_here[1:, :-1] | open_here[:-1, 1:] | open_here[1:, 1:])
        corner = corner[shut.reshape(-1)]
    a, b, c, d = corner, corner + 1, corner + m + 1, corner + m
    triangles = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    used, index = np.unique(triangles, return_inverse=True)
    vertices = points.reshape(-1, 3)[used].astype(np.float32)
    primitive = Primitive(vertices, index.reshape(-1, 3).astype(np.uint32), material)
    return Node(name, Mesh(name, (primitive,)))


def _path(layers: _Layers, frames: int) -> CameraPath:
    """Five stretches of the path, in turn."""
    cameras = []
    for k in range(frames):
        at = 5.0 * (k + 0.5) / frames
        stretch, s = int(at), at % 1.0
        previous = int(5.0 * (k - 0.5) / frames) if k else stretch
        eye, target = _STRETCHES[stretch](layers, s)
        cameras.append(
            Camera(
                look_at(eye, target),
                width=1024,
                height=768,
                near=4.0,
                far=20000.0,
                yfov=math.radians(55.0),
                cut=stretch != previous and stretch in _CUTS,
            )
        )
    return CameraPath(tuple(cameras))


Shot = tuple[Float64, Float64]


def _above(layers: _Layers, s: float) -> Shot:
    """Over the survey, looking obliquely down."""
    eye = np.array([-1400.0 + 2600.0 * s, 900.0 - 250.0 * s, 5200.0 - 1500.0 * s])
    return eye, np.array([3200.0, -900.0, 2000.0])


def _dive(layers: _Layers, s: float) -> Shot:
    """Down along the rim, and in between the first two layers."""
    eye = np.array([-1500.0 + 1900.0 * s, 700.0 * (1.0 - s) ** 2, 1900.0])
    eye[1] += (1.0 - (1.0 - s) ** 2) * _between(layers, 0, max(eye[0], 200.0), eye[2])
    return eye, np.array([4200.0, -900.0 - 150.0 * s, 2300.0])


def _within(layers: _Layers, s: float) -> Shot:
    """Between the first two layers, winding."""
    x, z = 400.0 + 4200.0 * s, 1900.0 + 900.0 * math.sin(2.4 * s)
    eye = np.array([x, _between(layers, 0, x, z), z])
    yaw = 0.7 * math.sin(5.0 * s)
    return eye, eye + np.array([math.cos(yaw), 0.05 * math.sin(9.0 * s) - 0.05, math.sin(yaw)])


def _deeper(layers: _Layers, s: float) -> Shot:
    """Between the third and the fourth, back and across the faults."""
    x, z = 5300.0 - 3800.0 * s, 3300.0 - 2200.0 * s
    eye = np.array([x, _between(layers, 2, x, z), z])
    yaw = 0.5 * math.cos(4.0 * s)
    return eye, eye + np.array([-math.cos(yaw), 0.04 - 0.08 * s, -math.sin(yaw)])


def _below(layers: _Layers, s: float) -> Shot:
    """Under the last layer, looking up at its faults' gaps."""
    eye = np.array([5200.0 - 2600.0 * s, -3300.0 + 150.0 * s, 600.0 + 2300.0 * s])
    return eye, np.array([2600.0 + 900.0 * s, -1500.0, 2400.0])


def _between(layers: _Layers, number: int, x: float, z: float) -> float:
    """Half-way from a horizon to the next."""
    above, below = (layers.height(n, np.array(x), np.array(z)) for n in (number, number + 1))
    return float(above + below) / 2.0


_STRETCHES = (_above, _dive, _within, _deeper, _below)
_CUTS = (3, 4)
