"""How long what is missed had been in view: its age, in frames of the path.

The age is 0 in the frame in which it comes into view, and one more in each frame after that in
which it still owns a sample. In the first frame, at a cut, and in the first frame that is judged
after others were not, everything is in view by right: it has no age, there or later, until it goes
out of view and comes back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.judging.frame import SettledFrame
from visref.judging.judge import FrameVerdict
from visref.picking import distinct
from visref.scene import OBJECT, Int64, Units

Bool = NDArray[np.bool_]

# In place of an age: out of view, and in view by right. What comes into view goes on from GONE.
_GONE, _BY_RIGHT = -1, -2
# What `Misses` has for a miss without an age.
_NONE = -1


class Ages:
    """The ages of things, objects or units, by which of them own a sample in each frame."""

    def __init__(self) -> None:
        self._age = np.zeros(0, np.int64)
        self._frame: int | None = None
        self._by_right = True

    def look(self, frame: int, cut: bool, seen: Bool) -> None:
        """Go on to a frame, later than the one before. `seen`: (n,) bool, what owns a sample."""
        self._by_right = cut or self._frame is None or frame != self._frame + 1
        self._frame = frame
        if self._by_right:
            self._age = np.where(seen, _BY_RIGHT, _GONE)
        else:
            older = self._age + (self._age != _BY_RIGHT)
            self._age = np.where(seen, older, _GONE)

    def of(self, indices: NDArray[Any]) -> Int64:
        """The ages of (k,) of them, which are in view whatever `look` was told: exact arithmetic
        may have found them. -1 where one has none."""
        age = self._age[indices]
        fresh = (age == _GONE) & (not self._by_right)
        return np.where(fresh, 0, np.where(age >= 0, age, _NONE))


@dataclass(eq=False)
class CellAges:
    """The ages of objects in each view, and in all views of a frame together, and for a culler
    those of its units where they are finer than objects."""

    objects: dict[str, Ages] = field(default_factory=dict)
    units: dict[tuple[str, str], Ages] = field(default_factory=dict)

    def look(self, frame: int, cut: bool, seen: Mapping[str, Bool], all_views: str) -> None:
        """Go on to a frame. `seen`: by view, (n,) bool, the objects that own a sample."""
        together = dict(seen)
        if len(seen) > 1:
            together[all_views] = np.logical_or.reduce(list(seen.values()))
        for view, objects in together.items():
            self.objects.setdefault(view, Ages()).look(frame, cut, objects)

    def aged(
        self,
        verdict: FrameVerdict,
        frame: int,
        view: str,
        culler: str,
        cut: bool,
        followed: Followed | None,
    ) -> FrameVerdict:
        """A culler's verdict on one drawn set, with the ages of its misses. To be asked in every
        frame, misses or not: where units are finer than objects, this is how they are followed.
        """
        misses = verdict.misses
        if followed is None:
            if not misses:
                return verdict
            age = self.objects[view].of(misses.columns.object)
            return replace(verdict, misses=misses.with_columns(age=age))
        of_units = self.units.setdefault((culler, view), Ages())
        of_units.look(frame, cut, followed.seen)
        if not misses:
            return verdict
        age = np.array(
            [_oldest(followed.lost.get(obj), of_units) for obj in misses.columns.object.tolist()],
            np.int64,
        )
        return replace(verdict, misses=misses.with_columns(age=age))


@dataclass(frozen=True, eq=False)
class Followed:
    """Of units that are finer than objects: which of them own a sample, (u,) bool, and by object
    those by which it is missed, (k,) ids."""

    seen: Bool
    lost: Mapping[int, Int64]

    @classmethod
    def of(
        cls, units: Units, settled: Sequence[SettledFrame], verdict: FrameVerdict
    ) -> Followed | None:
        """Of one drawn set and the verdict on it; None where objects are followed."""
        if units.kind == OBJECT or not settled:
            return None
        seen = np.logical_or.reduce([one.units_seen.own for one in settled])
        return cls(seen, lost_units(settled) if verdict.misses else {})


def _oldest(lost: Int64 | None, ages: Ages) -> int:
    """The age of the oldest of the units by which an object is missed, -1 if one has none."""
    if lost is None or not len(lost):
        return _NONE
    found = ages.of(lost)
    return _NONE if (found < 0).any() else int(found.max())


def lost_units(settled: Sequence[SettledFrame]) -> dict[int, Int64]:
    """By object, the units (ids) that were not drawn and hold a triangle of it that is lost."""
    scene, units = settled[0].scene, settled[0].units
    lost = np.logical_or.reduce([one.walk.lost_triangle for one in settled])
    entry = np.flatnonzero(lost[units.triangles])
    unit = np.searchsorted(units.offsets, entry, side="right") - 1
    entry, unit = (one[~np.isin(unit, settled[0].drawn_units)] for one in (entry, unit))
    objects = scene.object_of_triangle[units.triangles[entry]].astype(np.int64)
    objects, unit = np.divmod(distinct(objects * units.count + unit), max(units.count, 1))
    each, starts = np.unique(objects, return_index=True)
    parts = np.split(unit, starts[1:]) if len(each) else []
    return dict(zip(each.tolist(), parts, strict=True))
