"""What moves in a run, frame by frame, for the manifest."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from visref.run_folder.rows import Motion, MovedFrame, MovedObject
from visref.timeline import Bool, Timeline

# So many of those that move most often are named.
MOST_NAMED = 50


class MotionRecord:
    """Counts what moved, appeared and vanished since the path's frame before."""

    def __init__(self, timeline: Timeline) -> None:
        self._timeline = timeline
        self._frames: list[MovedFrame] = []
        self._often = np.zeros(timeline.still.object_count, np.int64)
        self._changed: tuple[int, Bool] | None = None

    def changed(self, frame: int) -> Bool | None:
        """(n,) bool, the objects that stand otherwise than in the frame before; None where nothing
        ever moves."""
        if not self._timeline.moves:
            return None
        if self._changed is None or self._changed[0] != frame:
            self._changed = frame, self._timeline.changed(frame)
        return self._changed[1]

    def add(self, frame: int) -> None:
        changed = self.changed(frame)
        if changed is None or not changed.any():
            return
        earlier = self._timeline.before(frame)
        assert earlier is not None, "nothing changes in the first frame"
        before, now = self._timeline.absent(earlier), self._timeline.absent(frame)
        self._often += changed
        self._frames.append(
            MovedFrame(
                frame,
                moved=int(np.count_nonzero(changed & ~before & ~now)),
                appeared=int(np.count_nonzero(changed & before & ~now)),
                vanished=int(np.count_nonzero(changed & ~before & now)),
            )
        )

    def found(self) -> Motion | None:
        """What moved so far, with every object that did; None where nothing ever moves."""
        if not self._timeline.moves:
            return None
        names = self._timeline.still.names
        often = tuple(
            MovedObject(int(index), names[index], int(self._often[index]))
            for index in np.flatnonzero(self._often)
        )
        return Motion(len(often), tuple(self._frames), often)


def motion_json(motion: Motion | None) -> dict[str, object] | None:
    """The manifest's `motion`, of all objects that moved those that did most often."""
    if motion is None:
        return None
    often = sorted(motion.most, key=lambda one: (-one.frames, one.object))
    return asdict(replace(motion, most=tuple(often[:MOST_NAMED])))
