"""Boxes that lie beside their objects, all by the same way: camera and boxes are about different
origins.

The way is found by steps that become smaller, as the one that agrees best with what was lost and
drawn. It is believed only if chance would not do as well with as many ways as were tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import every
from visref.causes.fitted import ODDS, odds
from visref.causes.inner import Looked, ever_lost, inward, sides_of
from visref.causes.sights import At, Hypothesis, Told
from visref.picking import evenly_picked
from visref.scene import Float64

Bool = NDArray[np.bool_]

# Ways, in half diagonals of the boxes' median, each axis by itself and together.
STEPS = (-16.0, -8.0, -4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 8.0, 16.0)
# Then around the best, so many times by half of its step.
TIMES = 6
# So many units of answers are looked at, at most.
MOST = 1500


def reach(looked: Looked, only: Bool) -> tuple[Float64, Float64, Float64, Bool]:
    """Of the units `only`, (u,) bool, that were lost or drawn: (k, 6) how far each box reaches in
    beyond each side of the view (negative: it does not), (k, 6, 3) the sides' normals, (k,) half
    diagonals and whether it was lost. Of an answer for several views nothing is told."""
    if len(looked.views) != 1:
        return np.zeros((0, 6)), np.zeros((0, 6, 3)), np.zeros(0), np.zeros(0, np.bool_)
    at = looked.views[0]
    known = np.flatnonzero((looked.lost | looked.good) & only[looked.ids] & at.boxes.there)
    boxes = at.boxes.boxes[known]
    half = (boxes[:, 1] - boxes[:, 0]) / 2.0
    normals = np.broadcast_to(sides_of(at.camera)[:, :3], (len(known), 6, 3))
    size = np.asarray(np.linalg.norm(half, axis=1))
    return inward(at.camera, boxes.mean(axis=1), half), normals, size, looked.lost[known]


def displaced(looked: Sequence[Looked], count: int) -> list[Hypothesis]:
    """Hypotheses of boxes displaced alike, of `count` units: of all, and of those that get lost."""
    made: list[Hypothesis] = []
    for only in (np.ones(count, np.bool_), ever_lost(looked, count)):
        way = _found(looked, only)
        if way is not None:
            made.append(_displaced(way, only))
    return made


def _found(looked: Sequence[Looked], only: Bool) -> Float64 | None:
    """(3,) the way that agrees best, None if chance would do as well."""
    parts = [reach(one, only) for one in looked]
    if not parts:
        return None
    inside, normals, size, lost = (np.concatenate(part) for part in zip(*parts, strict=True))
    some = evenly_picked(len(lost), MOST)
    inside, normals, size, lost = inside[some], normals[some], size[some], lost[some]
    if not lost.any() or lost.all():
        return None
    unit = float(np.median(size))
    sign = np.where(lost, 1, -1)
    tried, best, way = 1, 0, np.zeros(3)

    near = unit * np.array(list(product(STEPS, repeat=3)))
    for _ in range(TIMES + 1):
        tried += len(near)
        nets = sign @ _out(inside, normals, near)
        first = int(np.argmax(nets))
        if nets[first] > best:
            best, way = int(nets[first]), near[first]
            unit_of = np.abs(way).max()
        if not best:
            return None
        unit_of = unit_of / 2.0
        near = way + unit_of * np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
    out = _out(inside, normals, way[None])[:, 0]
    right, wrong = int((out & lost).sum()), int((out & ~lost).sum())
    found_odds = odds(right, wrong, int(lost.sum()), len(lost))
    return way if found_odds >= ODDS * tried else None


def _out(inside: Float64, normals: Float64, ways: Float64) -> Bool:
    """(k, m) which boxes lie beyond a side of the view, (k, 6) and (k, 6, 3), moved by each of the
    ways, (m, 3)."""
    found = np.zeros((len(inside), len(ways)), np.bool_)
    for side in range(inside.shape[1]):
        along = normals[:, side, :, None] * ways.T
        found |= ~(inside[:, side, None] + (along[:, 0] + along[:, 1] + along[:, 2]) >= 0.0)
    return found


def _displaced(way: Float64, only: Bool) -> Hypothesis:
    def tell(at: At) -> Told:
        boxes = np.where(at.boxes.there[:, None, None], at.boxes.boxes, 0.0) + way
        half = (boxes[:, 1] - boxes[:, 0]) / 2.0
        kept = every(inward(at.camera, boxes.mean(axis=1), half) >= 0.0, 1)
        return kept | ~at.boxes.there | ~only[at.ids]

    told = " ".join(f"{step:.4g}" for step in way)
    found = Hypothesis("origin-forgotten", f"boxes by {told}", tell, fitted=True)
    return found if only.all() else found.of_some(tell)
