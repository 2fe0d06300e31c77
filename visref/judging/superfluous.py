"""What was drawn for nothing, and which of it exact arithmetic confirms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.exact import ExactScene
from visref.judging.holders import DrawList, UnitsSeen
from visref.picking import distinct
from visref.scene import Int32, Int64, Scene, Units
from visref.visibility import FrameTruth, hit_depths

# Triangles whose hits are looked at together: memory for the hits, not for the scene.
_TRIANGLES = 1 << 17


@dataclass(frozen=True)
class Superfluous:
    """A unit that was drawn and is hidden at every sample that its triangles cover.

    `samples`: how many those are, all of them examined. `occluder`: the triangle that comes
    closest to it in depth where it hides it, at `sample` (flat index in the image of `view`,
    `width` samples wide); -1 each where the unit covers no sample at all.
    """

    unit: int
    samples: int
    occluder: int
    sample: int
    view: str = ""
    width: int = 0


def superfluous_units(scene: Scene, seen: UnitsSeen, drawn: DrawList) -> Int32:
    """Those of the drawn units none of whose triangles is, or may be, visible: (h,) int32,
    ascending. Doubt never makes a unit superfluous. One of which no triangle is there draws
    nothing, and is not among them."""
    there = drawn.holders.sizes_there(scene) > 0
    hidden: Int32 = np.flatnonzero(drawn.by_unit & ~seen.may & there).astype(np.int32)
    return hidden


def confirm(
    exact: ExactScene, truth: FrameTruth, units: Units, unit_ids: Int32
) -> tuple[Superfluous, ...]:
    """Those of the units that exact arithmetic finds hidden: over every sample that their
    triangles cover, none is at the nearest depth or tied with it. A sample that a mask leaves
    open clears a unit, and so does glass that may show. `unit_ids`: (k,) int32."""
    found: list[Superfluous] = []
    sizes = units.sizes[unit_ids]
    part = np.cumsum(sizes) // _TRIANGLES
    for index in np.unique(part):
        found += _confirm(exact, truth, units, unit_ids[part == index])
    return tuple(found)


def _confirm(
    exact: ExactScene, truth: FrameTruth, units: Units, unit_ids: Int32
) -> list[Superfluous]:
    scene, camera = exact.scene, truth.camera
    of_unit = np.repeat(np.arange(len(unit_ids)), units.sizes[unit_ids])
    triangles = units.gather(unit_ids)
    theirs = np.zeros(scene.triangle_count, np.bool_)
    theirs[triangles] = True
    hits = exact.hits(camera, theirs)
    right = truth
    if not truth.ties_complete:
        right = exact.certify(camera, distinct(hits.sample))
    open_ = np.isin(hits.sample, right.doubt.sample)
    open_ |= _shown(scene, right, hits.sample, hits.triangle)
    owner = right.buffer.triangle.reshape(-1)[hits.sample]
    gap = hit_depths(scene, camera, hits.sample, hits.triangle)
    gap = np.where(owner >= 0, gap - right.buffer.depth.reshape(-1)[hits.sample], np.inf)
    # Units may overlap: each of a unit's triangles brings its own hits.
    order = np.argsort(hits.triangle, kind="stable")
    low = np.searchsorted(hits.triangle[order], triangles, side="left")
    high = np.searchsorted(hits.triangle[order], triangles, side="right")
    counts = high - low
    place = np.repeat(of_unit, counts)
    within = np.arange(len(place)) - np.repeat(np.cumsum(counts) - counts, counts)
    own = order[np.repeat(low, counts) + within]
    cleared = np.zeros(len(unit_ids), np.bool_)
    cleared[place[open_[own]]] = True
    covered = distinct(place * camera.samples + hits.sample[own]) // camera.samples
    samples = np.bincount(covered, minlength=len(unit_ids))
    nearest = np.lexsort((hits.sample[own], gap[own], place))
    closest = np.full(len(unit_ids), -1)
    at, first = np.unique(place[nearest], return_index=True)
    closest[at] = own[nearest[first]]
    return [
        Superfluous(int(unit), int(count), int(owner[hit]), int(hits.sample[hit]))
        if hit >= 0
        else Superfluous(int(unit), 0, -1, -1)
        for unit, count, hit, clear in zip(unit_ids, samples, closest, cleared, strict=True)
        if not clear
    ]


def _shown(scene: Scene, truth: FrameTruth, sample: Int64, triangle: Int32) -> NDArray[np.bool_]:
    """(h,) bool: which hits are seen, as an owner, tied with one, or as glass."""
    count = scene.triangle_count
    pairs = sample * count + triangle
    shown: NDArray[np.bool_] = truth.buffer.triangle.reshape(-1)[sample] == triangle
    shown |= np.isin(pairs, truth.ties.sample * count + truth.ties.triangle)
    shown |= np.isin(pairs, truth.blend.sample * count + truth.blend.triangle)
    return shown
