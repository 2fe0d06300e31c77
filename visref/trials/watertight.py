"""Does an engine let rays slip through a closed surface at its vertices and edges?

The surface is a finely tessellated height field over the image, closed behind by a cone. Its
vertices stand on a lattice of two pixels: on the rays of a quarter of the samples, exactly.
Every other sample's ray meets, exactly, the middle (on the screen) of an edge. So each ray of
the frame aims at a vertex or an edge, and meets the front in exactly one point; one that is
owned by no front triangle has slipped through.

All coordinates are multiples of 1/16 up to 1,024, so that the whole may be moved by 1e6, eye and
all, and stays the same to the bit: float32 resolves 1/16 up to 2^20.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from visref.camera import Camera
from visref.engines import make_engine
from visref.engines.base import TruthEngine
from visref.scene import Int64, Scene

SIDE = 128
# The exact engine takes its time over every one of these samples.
SIDE_EXACT = 64
LATTICE = 4  # of a and b, which grow by two a pixel
AWAY = (0.0, 1e5, 1e6)
SEED = 20
OBJECT = "surface"


@dataclass(frozen=True)
class Leak:
    """Of `rays` at vertices and edges, `missed` met no front triangle; `away`: the distance
    from the origin along each axis."""

    away: float
    rays: int
    missed: int

    @property
    def rate(self) -> float:
        return self.missed / self.rays


def watertight_rates(
    engine: str, make: Callable[[str, Scene], TruthEngine] = make_engine
) -> list[Leak]:
    """An engine's leaks near the origin and away from it, a perspective and an orthographic
    frame together. Raises what making the engine raises."""
    leaks = []
    side = SIDE_EXACT if engine == "exact" else SIDE
    for away in AWAY:
        rays = missed = 0
        for perspective in (True, False):
            scene, camera, front = closed_surface(side, away, perspective=perspective)
            caster = make(engine, scene)
            try:
                owner = caster.frame(camera).buffer.triangle
            finally:
                caster.close()
            rays += owner.size
            missed += int(np.count_nonzero((owner < 0) | (owner >= front)))
        leaks.append(Leak(away, rays, missed))
    return leaks


def leaks_line(leaks: list[Leak]) -> str:
    """`0 of 32,768 rays at vertices and edges missed (near), 0 (1e5 away), …`."""
    first, *others = leaks
    line = f"{first.missed:,} of {first.rays:,} rays at vertices and edges missed (near)"
    return ", ".join(
        [line, *(f"{leak.missed:,} (1e{math.log10(leak.away):.0f} away)" for leak in others)]
    )


def closed_surface(side: int, away: float, *, perspective: bool) -> tuple[Scene, Camera, int]:
    """The surface, its camera, and how many triangles are its front (they come first).

    `side`: pixels, a power of two up to 128. No vertex of the front is deeper than its rim, so
    that the cone, which goes back from there, lies behind it.
    """
    # Beyond the image on every side: a and b are odd and end at side - 1.
    ticks = np.arange(-side - 3, side + 6, LATTICE)
    count = len(ticks)
    a, b = (grid.ravel().astype(np.float64) for grid in np.meshgrid(ticks, ticks))
    rim = _rim(count)
    rough = np.random.default_rng(SEED).integers(0, 2, len(a))
    rough[rim] = 1
    if perspective:
        # One unit of a at depth m * side / 8 is m / 16 wide.
        steps = 16.0 + rough
        depth, across = steps * (side / 8.0), steps / 16.0
    else:
        depth, across = 2.0 * side + rough, np.full(len(a), 0.25)
    apex = np.array([[0.0, 0.0, -8.0 * side]])
    points = np.concatenate([np.stack([a * across, b * across, -depth], axis=1), apex])
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()[:, None]
    cells = [np.add(first, (0, 1, count + 1)), np.add(first, (0, count + 1, count))]
    front = np.concatenate(cells)
    cone = np.stack([np.roll(rim, -1), rim, np.full(len(rim), len(points) - 1)], axis=1)
    shift = away * np.array([1.0, -1.0, 1.0])
    scene = Scene.from_objects([(OBJECT, points + shift, np.concatenate([front, cone]))])
    pose = np.eye(4)
    pose[:3, 3] = shift
    yfov, ymag = (_yfov_of_half(), None) if perspective else (None, 0.25 * side)
    return scene, Camera(pose, side, side, 1.0, 16.0 * side, yfov=yfov, ymag=ymag), len(front)


def _rim(count: int) -> Int64:
    """The lattice's outer vertices, counter-clockwise."""
    grid = np.arange(count * count).reshape(count, count)
    sides = [grid[0, :-1], grid[:-1, -1], grid[-1, :0:-1], grid[:0:-1, 0]]
    return np.concatenate(sides).astype(np.int64)


def _yfov_of_half() -> float:
    """The field of view whose half has a tangent of exactly 1/2, so that the samples are dyadic
    numbers: a step of yfov moves the tangent by 0.6 of its spacing, so one of these has it."""
    yfov = 2.0 * math.atan(0.5)
    near = (yfov, math.nextafter(yfov, 0.0), math.nextafter(yfov, math.pi))
    return next(value for value in near if math.tan(value / 2) == 0.5)
