"""What is said of verdicts once the frames before are known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref.judging.ages import CellAges, Followed
from visref.judging.judge import FrameVerdict
from visref.judging.names import Names
from visref.judging.outcome import ALL_VIEWS, FrameRecord
from visref.judging.policy import Accepting, Policy
from visref.promise import Promise
from visref.recordings.truth_file import RecordedTruth
from visref.scene import Scene


class Review:
    """What is said of verdicts once the frames before are known: how old their misses are, and what
    a policy makes of them. To be asked frame by frame, in the path's order."""

    def __init__(self, policy: Policy, scene: Names) -> None:
        self.accepting = Accepting(policy, scene)
        self._ages = CellAges()

    def look_back(
        self, path: CameraPath, frames: Iterable[int], truth: RecordedTruth, scene: Scene
    ) -> None:
        """Go on through frames that are not judged here, by what their truth on file says."""
        for frame in frames:
            views = path.views(frame)
            seen = {one.view: truth.seen(frame, one.view, scene.object_count) for one in views}
            self.look(frame, views[0].cut, seen)

    def look(self, frame: int, cut: bool, seen: Mapping[str, NDArray[np.bool_]]) -> None:
        """Go on to a frame. `seen`: by view, (n,) bool, the objects that own a sample."""
        self._ages.look(frame, cut, seen, ALL_VIEWS)

    def verdict(
        self, record: FrameRecord, promise: Promise, spec: str, cut: bool, followed: Followed | None
    ) -> FrameVerdict:
        """A culler's verdict, reviewed. `followed`: of its units, where they are finer than
        objects."""
        aged = self._ages.aged(record.verdict, record.frame, record.view, spec, cut, followed)
        return self.accepting.verdict(aged, promise, record.frame, spec)
