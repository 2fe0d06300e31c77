"""How things of a generated scene move: from frame to frame, by what is said in the path."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.search.kinds import YES, Catalogue, Gene, log, register, whole

MOTIONS: Catalogue = {}

Float64 = NDArray[np.float64]


@dataclass(eq=False)
class Moves:
    """What one object does: `worlds`: by frame, (4, 4) float64 that take the place of the identity;
    `there`: by frame; `grown`: (v, 3) float64 that its vertices move by in each further frame."""

    worlds: list[Float64] = field(default_factory=list)
    there: list[bool] = field(default_factory=list)
    grown: NDArray[Any] | None = None


def _carried(by: Float64) -> Float64:
    result = np.eye(4)
    result[:3, 3] = by
    return result


# `points`: (v, 3) the object's vertices; `size`: its box's diagonal; `frames`: how many there are.


@register(MOTIONS, 3.0, x=Gene(-1.0, 1.0), y=Gene(-1.0, 1.0), z=Gene(-0.5, 0.5),
          far=log(0.05, 8.0), when=whole(0, 4), back=YES)  # fmt: skip
def carried(points, frames, x, y, z, far, when, back) -> Moves:  # type: ignore[no-untyped-def]
    """carried off, or into view: boxes and depth of another frame"""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    way = far * max(size, 0.1) * np.array([x, y, z])
    steps = [k if when == 0 else float(k >= when % max(frames, 1)) for k in range(frames)]
    if back:
        # It comes to its place in the last frame.
        steps = [one - steps[-1] for one in steps]
    return Moves([_carried(way * step) for step in steps])


@register(MOTIONS, 1.5, axis=whole(0, 2), turn=Gene(0.1, 3.1), when=whole(0, 4))
def turned(points, frames, axis, turn, when) -> Moves:  # type: ignore[no-untyped-def]
    """turned about its middle: what is long sticks out elsewhere"""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    worlds = []
    for k in range(frames):
        angle = turn * (k if when == 0 else float(k >= when % max(frames, 1)))
        about = np.eye(4)
        i, j = (int(axis) + 1) % 3, (int(axis) + 2) % 3
        about[i, i] = about[j, j] = math.cos(angle)
        about[i, j], about[j, i] = -math.sin(angle), math.sin(angle)
        worlds.append(_carried(middle) @ about @ _carried(-middle))
    return Moves(worlds)


@register(MOTIONS, 3.0, mask=whole(1, 30))
def come_and_go(points, frames, mask) -> Moves:  # type: ignore[no-untyped-def]
    """there in some frames and not in others"""
    return Moves(there=[bool(int(mask) >> k & 1) for k in range(frames)])


@register(MOTIONS, 1.2, way=Gene(-1.0, 1.0), up=Gene(0.0, 1.5), axis=whole(0, 1))
def bent(points, frames, way, up, axis) -> Moves:  # type: ignore[no-untyped-def]
    """bent out of its box at rest, as by a skin"""
    low = points.min(axis=0)
    size = max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-6)
    along = 1 - int(axis)
    height = (points[:, along] - low[along]) / size
    grown = np.zeros(points.shape)
    grown[:, int(axis)] = way * size * height**2
    grown[:, along] = up * size * height
    return Moves(grown=grown)
