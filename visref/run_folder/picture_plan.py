"""Which frames get pictures, by what every part of a run can tell of its own frames.

Planned ones are evenly spaced. Beyond them each culler has those of its first and its last
confirmed miss, and of the worst miss of each of the objects that lose most in one frame: for `n`
planned frames at most 2 n objects, so at most 2 n + 2 frames.

A part draws what may be among them in the whole run. An object that is among the worst of the run
is so among its part's, as fewer are worse there; and the first miss of the run is the first of its
part. In `open` frames a policy may accept what is confirmed so far, so all of these are kept, and
push nothing out.

Once causes are known, each has a frame with a picture too (`visref.causes.pictured`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from visref.judging.misses import Misses, MissKind
from visref.run_folder.rows import PictureSet
from visref.scene import Int64

# A frame, and the view that a verdict is for.
Shown = tuple[int, str]
_OBJECTS_PER_FRAME = 2


class PicturePlan:
    """The choice of a run with so many planned `frames`, or of a part of it, whose misses are added
    in the order of its verdicts."""

    def __init__(self, frames: Sequence[int], open_: frozenset[int] = frozenset()) -> None:
        self._frames = frozenset(frames)
        self._open = open_
        self._worst: dict[str, _WorstMisses] = {}

    @property
    def draws(self) -> bool:
        """Whether it plans any picture at all."""
        return bool(self._frames)

    def planned(self, frame: int) -> bool:
        """Whether the frame gets pictures of every culler, whatever it missed."""
        return frame in self._frames

    def add(self, spec: str, frame: int, view: str, misses: Misses) -> bool:
        """Take note of a verdict's misses. Whether some of them are confirmed, so that its pictures
        may be wanted."""
        if not self._frames or not misses:
            return False
        at = misses.are(MissKind.CONFIRMED)
        if not at.any():
            return False
        worst = self._worst.setdefault(spec, _WorstMisses(_OBJECTS_PER_FRAME * len(self._frames)))
        columns = misses.columns
        worst.add(
            (frame, view),
            columns.object[at].astype(np.int64),
            columns.samples[at],
            open_=frame in self._open,
        )
        return True

    def wanted(self, spec: str) -> frozenset[Shown]:
        """The frames and views of a culler's verdicts that get pictures, beside the planned ones,
        as far as misses were added."""
        worst = self._worst.get(spec)
        return worst.places() if worst is not None else frozenset()

    def drawn_of(self, spec: str) -> Callable[[Shown], bool]:
        """Whether a frame and view in which a culler missed something gets pictures."""
        wanted = self.wanted(spec)
        return lambda at: self.planned(at[0]) or at in wanted


class _WorstMisses:
    """The worst confirmed miss of each object, the first of equals, of one culler."""

    def __init__(self, objects: int) -> None:
        self._objects = objects
        self._lost = np.full(0, -1, np.int64)
        self._place = np.full(0, -1, np.int64)
        self._places: list[Shown] = []
        self._always: set[Shown] = set()

    def add(self, place: Shown, objects: Int64, lost: Int64, *, open_: bool) -> None:
        if open_:
            self._always.add(place)
            return
        more = int(objects.max()) + 1 - len(self._lost)
        if more > 0:
            self._lost = np.append(self._lost, np.full(more, -1))
            self._place = np.append(self._place, np.full(more, -1))
        worse = lost > self._lost[objects]
        self._lost[objects[worse]] = lost[worse]
        self._place[objects[worse]] = len(self._places)
        self._places.append(place)

    def places(self) -> frozenset[Shown]:
        if not self._places:
            return frozenset(self._always)
        order = np.lexsort((np.arange(len(self._lost)), -self._lost))[: self._objects]
        worst = {self._places[at] for at in self._place[order].tolist() if at >= 0}
        return frozenset(worst | self._always | {self._places[0], self._places[-1]})


def in_order_of(pictures: Iterable[PictureSet], cullers: Sequence[str]) -> list[PictureSet]:
    """Pictures by frame, then by culler, as these stand, then by the view's name."""
    place = {culler: number for number, culler in enumerate(cullers)}
    return sorted(pictures, key=lambda one: (one.frame, place[one.culler], one.view))
