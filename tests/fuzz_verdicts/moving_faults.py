"""Faults to plant in how visref poses, joins and follows: what the cases in motion have to notice.

Each is put in by a MonkeyPatch.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tests.fuzz_verdicts.faults import Patch, Plant
from visref import timeline
from visref.camera_path import CameraPath
from visref.engines.exact import ExactEngine
from visref.formats.gltf.deform import Part
from visref.formats.gltf.motion import GltfMotion
from visref.judging import asking, referee
from visref.judging.holders import UnitsSeen
from visref.rig import Moment
from visref.timeline import Timeline

# By name: what plants it, and the first case that shows it.
MOVING_FAULTS: dict[str, tuple[Plant, int]] = {}


def fault(case: int) -> Any:
    def register(plant: Plant) -> Plant:
        MOVING_FAULTS[plant.__name__] = plant, case
        return plant

    return register


def _moments(patch: Patch, change: Any) -> None:
    at = GltfMotion.at

    def changed(self: GltfMotion, clip: int, time_s: float) -> Moment:
        return change(self, at(self, clip, time_s))

    patch.setattr(GltfMotion, "at", changed)


@fault(0)
def skins_stay_at_rest(patch: Patch) -> None:
    """Joints move and their skin does not."""

    def at_rest(motion: GltfMotion, moment: Moment) -> Moment:
        kept = {o: at for o, at in moment.positions.items() if not motion.skinned[o]}
        return replace(moment, positions=kept)

    _moments(patch, at_rest)


@fault(0)
def morph_weights_are_ignored(patch: Patch) -> None:
    """Every target weighs nothing."""
    at = Part.at
    patch.setattr(Part, "at", lambda self, weights, world: at(self, [0.0 for _ in weights], world))


@fault(0)
def visibility_is_ignored(patch: Patch) -> None:
    """What the file switches off is there."""
    _moments(patch, lambda _, moment: replace(moment, hidden=np.zeros_like(moment.hidden)))


@fault(0)
def the_frame_before_is_posed(patch: Patch) -> None:
    """Every frame but the first has the pose of the one before it."""
    make = Timeline._make_pose
    patch.setattr(Timeline, "_make_pose", lambda self, frame: make(self, max(frame - 1, 0)))


@fault(0)
def what_is_absent_is_kept(patch: Patch) -> None:
    """The path's `absent` takes nothing away."""
    init = Timeline.__init__

    def forgetful(self: Timeline, *given: Any, **more: Any) -> None:
        init(self, *given, **more)
        frames = [replace(frame, absent=()) for frame in self._path.frames]
        self._path = CameraPath(frames, self._path.source, self._path.numbers)

    patch.setattr(Timeline, "__init__", forgetful)


@fault(1)
def the_finest_level_is_always_there(patch: Patch) -> None:
    """The path's `levels` are not looked at."""
    init = Timeline.__init__

    def forgetful(self: Timeline, *given: Any, **more: Any) -> None:
        init(self, *given, **more)
        frames = [replace(frame, levels={}) for frame in self._path.frames]
        self._path = CameraPath(frames, self._path.source, self._path.numbers)

    patch.setattr(Timeline, "__init__", forgetful)


@fault(0)
def a_group_is_placed_as_an_object(patch: Patch) -> None:
    """A matrix for a group, or a skinned object, is taken for its place."""
    make = Timeline._make_pose

    def misplaced(self: Timeline, frame: int) -> Any:
        pose = make(self, frame)
        pose.worlds.update(pose.before)
        pose.positions = {o: at for o, at in pose.positions.items() if o not in pose.before}
        pose.before.clear()
        return pose

    patch.setattr(Timeline, "_make_pose", misplaced)


@fault(0)
def mirrored_poses_keep_their_winding(patch: Patch) -> None:
    """A pose that mirrors an object does not turn its triangles round."""
    patch.setattr(timeline, "_mirrors", lambda world: False)


@fault(0)
def views_are_joined_by_the_first(patch: Patch) -> None:
    """A set for all views is judged by the first view's samples."""
    clean = referee.judge_all_drawn
    patch.setattr(referee, "joined", lambda settled: settled[0])
    patch.setattr(referee, "judge_all_drawn", lambda settled, said: clean(settled[:1], said))


@fault(0)
def what_hides_in_one_view_is_superfluous(patch: Patch) -> None:
    """A unit that is hidden in a view is superfluous, whatever the other views show."""
    joined = UnitsSeen.joined

    def hasty(self: UnitsSeen, other: UnitsSeen) -> UnitsSeen:
        return replace(joined(self, other), may=self.may & other.may)

    patch.setattr(UnitsSeen, "joined", hasty)


@fault(0)
def an_engine_keeps_the_first_scene(patch: Patch) -> None:
    """The exact engine does not follow the scene."""
    patch.setattr(ExactEngine, "pose", lambda self, scene: None)


@fault(0)
def what_is_not_there_is_counted_as_drawn(patch: Patch) -> None:
    """A unit whose objects are all absent is drawn, and for nothing."""
    nobody = np.zeros(0, np.int32)
    patch.setattr(asking, "without_absent", lambda scene, units, drawn: (drawn, nobody))
