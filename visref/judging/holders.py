"""Which units hold a triangle, and what that says of a frame.

A triangle is looked up, never searched for among those of a unit: what a question costs hangs on
what is seen or drawn, and not on how many triangles there are.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Int32, Int64, Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility

Bool = NDArray[np.bool_]

# In place of a unit's id: no unit holds the triangle. What is below stands for several units.
_NONE = -1


@dataclass(frozen=True, eq=False)
class Holders:
    """The units that hold each triangle of a scene, at any of its moments.

    `of`: (t,) int32, the one unit that holds a triangle, -1 for none, and -2 - k where several do,
    or one more than once: those are `several[first[k]:first[k + 1]]`, int32. `are_objects`: unit i
    is object i.
    """

    units: Units
    of: Int32
    first: Int64
    several: Int32
    are_objects: bool
    _there: dict[str, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of_units(cls, units: Units, scene: Scene) -> Holders:
        """Looked up once for a scene and its units: this goes through all triangles."""
        alone = np.zeros(1, np.int64), np.zeros(0, np.int32)
        if units.are_objects(scene):
            return cls(units, scene.object_of_triangle, *alone, True)
        times = np.bincount(units.triangles, minlength=scene.triangle_count)
        unit = np.repeat(np.arange(units.count, dtype=np.int32), units.sizes)
        of = np.full(scene.triangle_count, _NONE, np.int32)
        of[units.triangles] = unit
        if times.max(initial=0) < 2:
            return cls(units, of, *alone, False)
        shared = np.flatnonzero(times > 1)
        entries = np.flatnonzero(times[units.triangles] > 1)
        order = np.argsort(units.triangles[entries], kind="stable")
        of[shared] = -2 - np.arange(len(shared), dtype=np.int32)
        first = np.append(0, np.cumsum(times[shared])).astype(np.int64)
        return cls(units, of, first, unit[entries[order]], False)

    @property
    def triangle_count(self) -> int:
        return len(self.of)

    @property
    def apart(self) -> bool:
        """Whether no triangle is in the units more than once."""
        return not len(self.several)

    def mark(self, triangles: Int32, drawn: Bool, marked: Bool) -> bool:
        """Mark, in `marked`, (u,) bool, the units that hold any of these triangles, int32, of which
        a negative one is none; whether each of these is in a unit that is `drawn`, (u,) bool."""
        if not len(triangles):
            return True
        here = np.zeros_like(marked)
        if self.are_objects:
            here[self.of[triangles[triangles >= 0]]] = True
            whole = True
        else:
            # What one unit holds is nearly all: so its loop has nothing else to wait for.
            others = _mark_alone(triangles, self.of, here)
            whole = not others or bool(
                _mark_others(triangles, self.of, self.first, self.several, drawn, marked)
            )
        marked |= here
        return whole and not (here & ~drawn).any()

    def sizes_there(self, scene: Scene) -> Int64:
        """(u,) int64, how many of each unit's triangles are there in a scene, which is one of the
        moments of that which this was made for."""
        absent = scene.absent
        if absent is None or not absent.any():
            return self.units.sizes
        if self.are_objects:
            return np.where(absent, 0, self.units.sizes)
        if "absent" not in self._there or not np.array_equal(self._there["absent"], absent):
            of_gone = self.of[scene.object_units().gather(np.flatnonzero(absent).astype(np.int32))]
            rows = (-2 - of_gone[of_gone < _NONE]).astype(np.int32)
            held = [of_gone[of_gone >= 0], Units(self.first, self.several).gather(rows)]
            gone = np.bincount(np.concatenate(held), minlength=self.units.count)
            self._there.update(absent=absent, sizes=self.units.sizes - gone)
        there: Int64 = self._there["sizes"]
        return there


@dataclass(frozen=True, eq=False)
class DrawList:
    """The triangles of a drawn set. What is asked by unit is answered by unit; they are listed one
    by one where somebody looks at them so. `unit_ids`: (k,) int32, each at most once."""

    holders: Holders
    unit_ids: Int32

    @classmethod
    def of_units(cls, scene: Scene, units: Units, unit_ids: Int32) -> DrawList:
        """Where the units' holders are not at hand."""
        return cls(Holders.of_units(units, scene), unit_ids)

    @cached_property
    def by_unit(self) -> Bool:
        """(u,) bool, one per unit: whether it is drawn."""
        drawn = np.zeros(self.holders.units.count, np.bool_)
        drawn[self.unit_ids] = True
        return drawn

    @cached_property
    def triangles(self) -> Bool:
        """(t,) bool, one per triangle of the scene: whether it is drawn."""
        units = self.holders.units
        if self.holders.are_objects:
            return np.repeat(self.by_unit, units.sizes)
        return units.mask(self.unit_ids, self.holders.triangle_count)

    @cached_property
    def triangle_count(self) -> int:
        """How many triangles are drawn, each counted once."""
        if self.holders.apart:
            return int(self.holders.units.sizes[self.unit_ids].sum())
        return int(np.count_nonzero(self.triangles))


@dataclass(frozen=True, eq=False)
class UnitsSeen:
    """Which units are seen in a frame, (u,) bool each. `own`: one of their triangles owns a decided
    sample, is tied with an owner or seen as glass. `may`: that, or may be seen: because a mask
    leaves it open or the engine cannot tell. `all_drawn`: whether each triangle that owns or may
    own a sample, ties there or is seen as glass was drawn, so that nothing is lost for certain."""

    own: Bool
    may: Bool
    all_drawn: bool

    @classmethod
    def of(cls, truth: FrameTruth, seen: ObjectVisibility, drawn: DrawList) -> UnitsSeen:
        """By a truth, and `objects_seen` of it. Where units are objects, that says it already."""
        holders, by_unit = drawn.holders, drawn.by_unit
        owner = truth.buffer.triangle.reshape(-1)
        if holders.are_objects:
            own = seen.visible
            whole = not (own & ~by_unit).any()
        else:
            own = np.zeros(len(by_unit), np.bool_)
            decided = owner[truth.decided] if len(truth.doubt) else owner
            whole = holders.mark(decided, by_unit, own)
        whole &= holders.mark(truth.ties.triangle, by_unit, own)
        whole &= holders.mark(truth.blend.triangle, by_unit, own)
        may = own.copy()
        whole &= holders.mark(owner[truth.undecided], by_unit, may)
        whole &= holders.mark(truth.doubt.triangle, by_unit, may)
        holders.mark(truth.veiled, by_unit, may)
        return cls(own, may, whole)

    def joined(self, other: UnitsSeen) -> UnitsSeen:
        """In two views together."""
        return UnitsSeen(
            self.own | other.own, self.may | other.may, self.all_drawn and other.all_drawn
        )


@njit()
def _mark_alone(triangles: NDArray[Any], of: NDArray[Any], marked: NDArray[Any]) -> int:
    """Mark the units that hold some of the triangles alone; how many others there are, which no
    unit holds or several do."""
    others = 0
    for t in triangles:
        if t >= 0:
            unit = of[t]
            if unit >= 0:
                marked[unit] = True
            else:
                others += 1
    return others


@njit()
def _mark_others(
    triangles: NDArray[Any],
    of: NDArray[Any],
    first: NDArray[Any],
    several: NDArray[Any],
    drawn: NDArray[Any],
    marked: NDArray[Any],
) -> bool:
    """Mark the units that share some of the triangles; whether one of each triangle's is drawn."""
    all_drawn = True
    for t in triangles:
        if t < 0 or of[t] >= 0:
            continue
        row = -2 - of[t]
        here = False
        for j in range(first[row], first[row + 1]) if row >= 0 else range(0):
            marked[several[j]] = True
            here = here or drawn[several[j]]
        all_drawn = all_drawn and here
    return all_drawn
