"""The judge: a frame's truth and a drawn set in, a verdict out. Pure; nothing is read or kept.

- A sample is *missed* if no triangle at its nearest depth was drawn.
- An object is *missed* if it is visible and none of its owned samples shows it because its
  triangles there were not drawn. A miss is a *tie* if every sample of the object shows a
  co-owner at exactly the same depth; *within raster tolerance* if the rulings say so; else
  *confirmed*. So missed = confirmed + ties + within_raster_tolerance.
- A unit is *superfluous* if it was drawn and none of its triangles is visible.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from visref import kernels
from visref.culler import Promise
from visref.judging.disputes import Rulings, blended_triangles
from visref.judging.settle import SettledFrame
from visref.judging.walk import SampleWalk
from visref.scene import Alpha, Int32, Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility


class MissKind(StrEnum):
    """The three parts of `missed`."""

    CONFIRMED = "confirmed"
    TIE = "tie"
    WITHIN_RASTER = "within_raster_tolerance"


@dataclass(frozen=True)
class Miss:
    """A visible object that was not drawn, with the sample that witnesses it.

    `pixels`: samples lost (0 for a tie); `owned`: samples it owns. `sample` is a flat index,
    `depth` view depth there. Margins are None where they were not computed.
    """

    object: int
    kind: MissKind
    pixels: int
    owned: int
    sample: int
    triangle: int
    depth: float
    margin_px: float | None = None
    margin_depth: float | None = None


@dataclass(frozen=True)
class Counts:
    """The numbers of `verdict.json`, for a frame or summed over frames.

    `visible`, `missed` and its parts, `violations` and `undecided` count objects; `drawn` and
    `superfluous` count units; `missed_pixels` counts samples.
    """

    visible: int = 0
    missed: int = 0
    confirmed: int = 0
    ties: int = 0
    within_raster_tolerance: int = 0
    violations: int = 0
    undecided: int = 0
    missed_pixels: int = 0
    drawn: int = 0
    superfluous: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(**{name: getattr(self, name) + getattr(other, name) for name in vars(self)})


@dataclass(frozen=True, eq=False)
class FrameVerdict:
    """What the judge says of one frame. `misses` come with the most samples lost first; `owned`:
    how many decided samples anything owns, None where the truth on file does not say.
    `superfluous_units` ascend."""

    counts: Counts
    misses: tuple[Miss, ...] = ()
    superfluous_units: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    undecided_objects: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    owned: int | None = None


def judge(frame: SettledFrame, units: Units, drawn_units: Int32, promise: Promise) -> FrameVerdict:
    """Judge one frame's drawn set, settled against its truth."""
    scene, truth, seen, walk = frame.scene, frame.truth, frame.seen, frame.walk
    drawn, rulings = frame.drawn, frame.rulings
    shows = walk.shows.copy()
    for object_id in truth.blend.object:
        shows[object_id] |= bool(drawn[blended_triangles(scene, int(object_id))].any())
    missed = np.flatnonzero(seen.visible & ~shows)
    misses = [_miss(scene, truth, seen, rulings, int(o), walk) for o in missed]
    misses.sort(key=lambda miss: (-miss.pixels, miss.object))

    superfluous = _superfluous(scene, truth, units, drawn_units)
    undecided = _undecided(scene, truth, seen, drawn)
    kinds = [miss.kind for miss in misses]
    confirmed = kinds.count(MissKind.CONFIRMED)
    counts = Counts(
        visible=int(np.count_nonzero(seen.visible)),
        missed=len(misses),
        confirmed=confirmed,
        ties=kinds.count(MissKind.TIE),
        within_raster_tolerance=kinds.count(MissKind.WITHIN_RASTER),
        violations=confirmed if promise.convicts else 0,
        undecided=len(undecided),
        missed_pixels=walk.missed_pixels,
        drawn=len(drawn_units),
        superfluous=len(superfluous),
    )
    return FrameVerdict(counts, tuple(misses), superfluous, undecided, seen.owned)


def _miss(
    scene: Scene,
    truth: FrameTruth,
    seen: ObjectVisibility,
    rulings: Rulings,
    object_id: int,
    walk: SampleWalk,
) -> Miss:
    owned = int(seen.pixels[object_id])
    lost = int(walk.lost[object_id])
    within_raster = object_id in rulings.within_raster
    blended = np.flatnonzero(truth.blend.object == object_id)
    if len(blended) and (lost == 0 or within_raster):
        # A blended part owns no sample of the visibility buffer, and no tolerance excuses it.
        at = int(blended[0])
        return Miss(
            object_id,
            MissKind.CONFIRMED,
            int(truth.blend.pixels[at]),
            owned,
            int(truth.blend.sample[at]),
            int(truth.blend.triangle[at]),
            float(truth.blend.depth[at]),
        )
    if lost == 0:
        sample = int(seen.sample[object_id])
        kind = MissKind.TIE
    else:
        sample = rulings.best_sample.get(object_id, int(walk.lost_sample[object_id]))
        kind = MissKind.WITHIN_RASTER if within_raster else MissKind.CONFIRMED
    margin_px, margin_depth = rulings.margins.get(object_id, (None, None))
    return Miss(
        object_id,
        kind,
        lost,
        owned,
        sample,
        _own_triangle(scene, truth, sample, object_id),
        float(truth.buffer.depth.reshape(-1)[sample]),
        margin_px,
        margin_depth,
    )


def _own_triangle(scene: Scene, truth: FrameTruth, sample: int, object_id: int) -> int:
    """The object's own triangle at a sample it owns or shares."""
    owner = int(truth.buffer.triangle.reshape(-1)[sample])
    if scene.object_of_triangle[owner] == object_id:
        return owner
    low, high = np.searchsorted(truth.ties.sample, (sample, sample + 1))
    tied = truth.ties.triangle[low:high]
    return int(tied[scene.object_of_triangle[tied] == object_id][0])


def visible_triangles(scene: Scene, truth: FrameTruth) -> NDArray[np.bool_]:
    """(t,) bool, True where a triangle is, or may be, visible.

    Besides owners and their ties: the owner of an undecided sample, every masked triangle of
    a frame with undecided samples, and the blended triangles of a visible blended object.
    Doubt never makes a unit superfluous.
    """
    visible = np.zeros(scene.triangle_count, np.bool_)
    owner = truth.buffer.triangle.reshape(-1)
    kernels.owned_triangles(owner, np.ones(len(owner), np.bool_), visible)
    visible[truth.ties.triangle] = True
    if len(truth.undecided):
        visible |= scene.alpha == Alpha.MASK
    if len(truth.blend.object):
        of_visible = np.zeros(scene.object_count, np.bool_)
        of_visible[truth.blend.object] = True
        visible |= of_visible[scene.object_of_triangle] & (scene.alpha == Alpha.BLEND)
    return visible


def _superfluous(scene: Scene, truth: FrameTruth, units: Units, drawn_units: Int32) -> Int32:
    visible = visible_triangles(scene, truth)[units.triangles]
    total = np.concatenate([[0], np.cumsum(visible, dtype=np.int64)])
    drawn = np.sort(drawn_units)
    hidden: Int32 = drawn[total[units.offsets[drawn + 1]] == total[units.offsets[drawn]]]
    return hidden


def _undecided(
    scene: Scene, truth: FrameTruth, seen: ObjectVisibility, drawn: NDArray[np.bool_]
) -> Int32:
    """Objects that nobody saw for certain and that were not drawn where they may be visible:
    owners of undecided samples, and objects with a masked triangle there."""
    owner = truth.buffer.triangle.reshape(-1)[truth.undecided]
    owner = owner[owner >= 0]
    behind = scene.object_of_triangle[owner[~drawn[owner]]]
    masks = drawn & (scene.alpha == Alpha.MASK)
    foliage = np.setdiff1d(truth.masked, scene.object_of_triangle[masks])
    objects: Int32 = np.union1d(behind, foliage).astype(np.int32)
    undecided: Int32 = objects[~seen.visible[objects]]
    return undecided
