"""Volumes that do not hold their objects, fitted: what a culler tests in place of an object's box.

Which volume it is, nobody says. It is some part of the box, or lies beside it or about the origin,
and stays the same from frame to frame. Of so many that are thought of, the one is taken that agrees
best with what was lost and drawn where the box reaches across a side of the view, as nothing is
told elsewhere: one for all objects, one for all that get lost, or one for each. That of each is
found from other frames than it is asked about, so that it cannot fit by chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.causes.boxes import Boxes, edges, every, some
from visref.causes.evidence import Answer
from visref.causes.fitted import ODDS, odds
from visref.causes.in_view import kept_by_depth, origins
from visref.causes.sights import At, Hypothesis, Told
from visref.picking import evenly_picked
from visref.scene import Float64, Int32, Int64

Bool = NDArray[np.bool_]


class Looked(Protocol):
    """Some of an answer's units, as `visref.causes.weighed.Looked` has them."""

    answer: Answer
    views: tuple[At, ...]
    ids: Int32
    lost: Bool
    good: Bool
    idle: Bool


# From the middle of a box's side, in halves of it: all of it, its halves, its middle half, its
# middle, its ends, and as much beside it.
PARTS = (
    (-1.0, 1.0), (-1.0, 0.0), (0.0, 1.0), (-0.5, 0.5), (0.0, 0.0), (-1.0, -1.0), (1.0, 1.0),
    (-2.0, -1.0), (1.0, 2.0),
)  # fmt: skip
# Radii about a middle, in halves of the box's diagonal. Of a negative one, which is what a negative
# scale makes of it, a side of the view has to be so far away.
RADII = (0.75, 0.5, 0.25, -0.5, -1.0)
# What a volume lies about.
MIDDLE, PIVOT, ORIGIN = range(3)
# What an object's own volume is asked about is left out, so many parts of the run one by one.
BLOCKS = 6
# What all objects tell of a volume counts for each as so many of its own misses.
COMMON = 1.5
# So many units of answers are looked at, at most.
MOST = 6000


@dataclass(frozen=True, eq=False)
class Volumes:
    """Kinds of volumes, (c,), the largest first: boxes from a box's middle, or spheres. `about`:
    (c,) what they lie about; `middle` and `half`: (c, 3) in halves of the box's sides; `radius`:
    (c,) in halves of its diagonal."""

    about: Int64
    middle: Float64
    half: Float64
    radius: Float64

    def of(self, boxes: Float64, pivots: Float64, kinds: Int64) -> tuple[Float64, Float64, Float64]:
        """Centres and halves, (k, m, 3), and radii, (k, m), of (k, m) or (1, m) kinds of volumes,
        about (k, 2, 3) boxes and (k, 3) pivots."""
        side = (boxes[:, 1] - boxes[:, 0])[:, None] / 2.0
        middle = boxes.mean(axis=1)[:, None]
        about = self.about[kinds][..., None]
        base = np.where(about == MIDDLE, middle, np.where(about == PIVOT, pivots[:, None], 0.0))
        away = np.linalg.norm(side, axis=2)
        return base + side * self.middle[kinds], side * self.half[kinds], away * self.radius[kinds]


def _volumes() -> Volumes:
    made: list[tuple[float, int, tuple[float, ...], tuple[float, ...], float]] = []
    for parts in product(PARTS, repeat=3):
        middle = tuple((low + high) / 2.0 for low, high in parts)
        half = tuple((high - low) / 2.0 for low, high in parts)
        inside = sum(0.001 for low, high in parts if low >= -1.0 and high <= 1.0)
        made.append((float(np.prod(np.add(half, 0.01))) + inside, MIDDLE, middle, half, 0.0))
    zero = (0.0, 0.0, 0.0)
    made += [(share**3, MIDDLE, zero, zero, share) for share in RADII]
    made += [(share**3, PIVOT, zero, zero, share) for share in (1.0, *RADII)]
    made.append((-1.0, ORIGIN, zero, zero, 0.0))
    made.sort(key=lambda one: -one[0])
    _, about, middle, half, radius = zip(*made, strict=True)
    return Volumes(np.array(about), np.array(middle), np.array(half), np.array(radius))


VOLUMES = _volumes()
EVERY = np.arange(len(VOLUMES.about))
WITHIN = (VOLUMES.about == MIDDLE) & (VOLUMES.radius == 0.0)
WITHIN &= every(np.abs(VOLUMES.middle) + VOLUMES.half <= 1.0, 1)
POINTS = (VOLUMES.about != ORIGIN) & (VOLUMES.radius == 0.0) & every(VOLUMES.half == 0.0, 1)
POINTS &= every(VOLUMES.middle == 0.0, 1)


def sides_of(camera: Camera) -> Float64:
    """(6, 4): the view is where n p + d >= 0 for each: left, right, bottom, top, near and far."""
    left, right, bottom, top = edges(camera)
    ends = np.array([-left, right, -bottom, top])
    local = np.zeros((6, 4))
    local[[0, 1, 2, 3], [0, 0, 1, 1]] = 1.0, -1.0, 1.0, -1.0
    local[:4, 2 if camera.is_perspective else 3] = ends
    local[4], local[5] = (0.0, 0.0, 1.0, -camera.near), (0.0, 0.0, -1.0, min(camera.far, 1e12))
    local /= np.linalg.norm(local[:, :3], axis=1, keepdims=True)
    axes = camera.world_from_camera[:3, :3] * np.array([1.0, 1.0, -1.0])
    normals = local[:, :3] @ axes.T
    return np.asarray(np.column_stack([normals, local[:, 3] - normals @ camera.eye]))


def inward(camera: Camera, centres: Float64, halves: Float64) -> Float64:
    """(…, 6) how far boxes, (…, 3) centres and halves, reach in beyond each side of the view;
    negative where they do not."""
    sides = sides_of(camera)
    signed = centres @ sides[:, :3].T + sides[:, 3]
    return np.asarray(signed + halves @ np.abs(sides[:, :3]).T)


def ever_lost(looked: Sequence[Looked], count: int) -> Bool:
    """(count,) bool, the units that were lost in some of the answers."""
    ever = np.zeros(count, np.bool_)
    for one in looked:
        ever[one.ids[one.lost]] = True
    return ever


def reaches(camera: Camera, centres: Float64, halves: Float64, radii: Float64) -> Bool:
    """(…,) whether volumes, (…, 3) centres and halves and (…,) radii, reach into the view, as far
    as each side tells alone."""
    return every(inward(camera, centres, halves) + radii[..., None] >= 0.0, -1)


def _boxes(at: At) -> Float64:
    return np.asarray(np.where(at.boxes.there[:, None, None], at.boxes.boxes, 0.0))


def kept_by(at: At, kinds: Int64, *, hidden: bool) -> Bool:
    """(k,) bool: the volume of each unit, of (k,) kinds, is in the view, and (`hidden`) not behind
    what else is there."""
    found = VOLUMES.of(_boxes(at), origins(at), kinds[:, None])
    centres, halves, radii = (one[:, 0] for one in found)
    kept = reaches(at.camera, centres, halves, radii)
    if hidden:
        half = np.maximum(halves + radii[:, None], 0.0)
        kept &= kept_by_depth(at, Boxes(at.camera, np.stack([centres - half, centres + half], 1)))
    return kept | ~at.boxes.there


@dataclass(frozen=True, eq=False)
class Pairs:
    """(n,) units of answers: the `unit`, the answer's `block`, whether it was `lost` or else drawn,
    whether its box reaches `across` a side of the view, and (n, c) which volumes would be kept."""

    unit: Int64
    block: Int64
    lost: Bool
    across: Bool
    inside: Bool

    def of(self, some: Bool) -> Pairs:
        return Pairs(*(getattr(self, name)[some] for name in COLUMNS))

    def net(self) -> Int64:
        """(c,) lost ones explained, less drawn ones that would not have been."""
        sign = np.where(self.lost, 1, -1)
        return np.asarray(sign @ ~self.inside)

    def believed(self, kind: int) -> bool:
        """Whether chance would not do as well, by the best of as many kinds as there are. Within
        the view a part of the box is in it too, whatever was lost there."""
        told = self.across if WITHIN[kind] else np.ones_like(self.across)
        lost, out = self.lost[told], ~self.inside[told, kind]
        right, wrong = int((out & lost).sum()), int((out & ~lost).sum())
        found = odds(right, wrong, int(lost.sum()), len(lost))
        return right > wrong and found >= ODDS * self.inside.shape[1]


COLUMNS = ("unit", "block", "lost", "across", "inside")


def pairs_of(looked: Sequence[Looked], blocks: Sequence[int], ever: Bool) -> Pairs:
    """Of those that are ever lost (flags of all units), and of others across a side of the view."""
    found = [_pairs(one, block, ever) for one, block in zip(looked, blocks, strict=True)]
    made = Pairs(*(np.concatenate([getattr(one, name) for one in found]) for name in COLUMNS))
    flags = np.zeros(len(made.unit), np.bool_)
    flags[evenly_picked(len(flags), MOST)] = True
    return made.of(flags)


def _pairs(one: Looked, block: int, ever: Bool) -> Pairs:
    told = one.lost | one.good | one.idle
    whole, inside = np.zeros(len(one.ids), np.bool_), np.zeros(len(one.ids), np.bool_)
    for at in one.views:
        inside |= at.boxes.in_view
        whole |= ~some(at.boxes.planes, (1, 2)) & at.boxes.there
    telling = np.flatnonzero(told & inside & (~whole | ever[one.ids]))
    volumes = np.zeros((len(telling), len(EVERY)), np.bool_)
    for at in one.views:
        boxes, pivots = _boxes(at)[telling], origins(at)[telling]
        volumes |= reaches(at.camera, *VOLUMES.of(boxes, pivots, EVERY[None]))
    units = one.ids[telling].astype(np.int64)
    lost, across = one.lost[telling], ~whole[telling]
    return Pairs(units, np.full(len(units), block), lost, across, volumes)


def fitted_volumes(looked: Sequence[Looked], count: int) -> list[Hypothesis]:
    """Hypotheses of volumes that do not hold their objects, of `count` units in all, fitted to
    answers in order of their frames."""
    if not looked:
        return []
    frames = sorted({one.answer.frame for one in looked})
    block_of = {frame: i * BLOCKS // len(frames) for i, frame in enumerate(frames)}
    ever = ever_lost(looked, count)
    pairs = pairs_of(looked, [block_of[one.answer.frame] for one in looked], ever)
    if not pairs.lost.any() or pairs.lost.all():
        return []
    made: list[Hypothesis] = []
    whole = np.full(count, 0)
    across = pairs.of(pairs.across)
    common = int(np.argmax(np.where(POINTS, -len(pairs.unit), across.net())))
    if across.believed(common):
        made += _hypotheses("one for all", lambda at: np.full(len(at.ids), common))
    theirs = pairs.of(ever[pairs.unit])
    best = int(np.argmax(theirs.net()))
    if best != common and theirs.believed(best):
        kinds = np.where(ever, best, whole)
        made += _hypotheses("one for those lost", lambda at: kinds[at.ids])
    each = np.stack([_each(theirs, count, block) for block in (*range(BLOCKS), -1)])
    if each[:-1].any():
        made += _hypotheses("one for each", lambda at: each[block_of.get(at.frame, -1)][at.ids])
    return made


def _each(pairs: Pairs, count: int, block: int) -> Int64:
    """(count,) the kind of each unit's volume, by all blocks but this one."""
    rest = pairs.of(pairs.block != block)
    result = np.zeros(count, np.int64)
    if not rest.lost.any():
        return result
    prior = COMMON * rest.net() / np.count_nonzero(rest.lost)
    for unit in np.unique(rest.unit[rest.lost]):
        own = rest.of(rest.unit == unit)
        result[unit] = np.argmax(own.net() + prior)
    return result


def _hypotheses(variant: str, kinds: Callable[[At], Int64]) -> list[Hypothesis]:
    def tell(hidden: bool) -> Callable[[At], Told]:
        return lambda at: kept_by(at, kinds(at), hidden=hidden)

    return [
        Hypothesis(
            "bounds-too-small",
            f"volume, {variant}{', hidden' * hidden}",
            tell(hidden),
            depth=hidden,
            fitted=True,
        )
        for hidden in (False, True)
    ]
