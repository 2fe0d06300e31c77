"""A scene over time: what a path's frames say of its objects becomes the Scene of each frame.

Vertices are transformed and blended in float64 and rounded once, as when the file was read, so that
a frame's scene is what a file of that moment would give. Only what moves is computed again.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.formats.placed import compose, transformed
from visref.recordings.names import Names
from visref.rig import Moment, Rig
from visref.scene import Float64, Int32, Scene
from visref.wording import did_you_mean

Bool = NDArray[np.bool_]


@dataclass(eq=False)
class _Pose:
    """How each moving object stands in one frame. `worlds`, `positions`: by object id, those that
    are not as in the rest pose; `before`: by object id, what is multiplied from the left last."""

    worlds: dict[int, Float64] = field(default_factory=dict)
    positions: dict[int, Float64] = field(default_factory=dict)
    before: dict[int, Float64] = field(default_factory=dict)
    absent: Bool = field(default_factory=lambda: np.zeros(0, np.bool_))

    def key(self, index: int) -> tuple[bytes, ...]:
        """The same for two frames in which an object stands alike."""
        found = (self.worlds.get(index), self.positions.get(index), self.before.get(index))
        return (
            bytes([bool(self.absent[index])]),
            *(b"" if one is None else one.tobytes() for one in found),
        )


class Timeline:
    """A scene and a path: the scene of each of its frames.

    `scene`: as it was read, with its `rig`. `rest_pose`: objects that the file animates stand as
    they do at rest. `still`: the scene at rest, marked with what moves (`Scene.moving`), without
    a rig: what does not move is the same in each frame's scene. `moves`: whether anything does.

    Raises InputError, naming the path's frame, for a name, a level, an animation or a matrix that
    cannot be, and where the file animates objects and a frame has no time.
    """

    def __init__(self, scene: Scene, path: CameraPath, *, rest_pose: bool = False) -> None:
        self._source = path.source
        self._path = path
        self._motion = None if rest_pose or scene.rig is None else scene.rig.motion
        # What is not there whatever level of detail is: of a scene from a file, what that hides.
        hidden = scene.absent if scene.rig is None else scene.rig.hidden
        self._rest_hidden = np.zeros(scene.object_count, np.bool_) if hidden is None else hidden
        self._scene = scene
        if self._motion is not None:
            self._refuse_without_time(scene)
        moving = self._moving(scene)
        self.moves = bool(moving.any())
        # The scene as it is, where nothing is to be marked or dropped.
        self.still = scene
        if self.moves or scene.rig is not None:
            self.still = replace(scene, rig=None, moving=moving if self.moves else None)
        self._last: tuple[int, Scene] | None = None

    def at(self, frame: int) -> Scene:
        """The scene of a frame: the very object of the frame asked for before where it is alike."""
        if not self.moves:
            return self.still
        if self._last is not None and self._last[0] == frame:
            return self._last[1]
        if self._last is not None and not self._between(self._last[0], frame).any():
            scene = self._last[1]
        else:
            scene = self._posed(frame)
        self._last = frame, scene
        return scene

    def changed(self, frame: int) -> Bool:
        """(n,) bool, the objects that stand otherwise than in the path's frame before, appear or
        vanish; none in the first frame."""
        if not self.moves or (before := self.before(frame)) is None:
            return np.zeros(self._scene.object_count, np.bool_)
        return self._between(before, frame)

    def before(self, frame: int) -> int | None:
        """The number of the path's frame before, None of the first."""
        place = self._path.place(frame)
        return self._path.numbers[place - 1] if place else None

    def absent(self, frame: int) -> Bool:
        """(n,) bool, the objects that are not there in a frame."""
        if self.moves:
            return self._pose(frame).absent
        gone = self.still.absent
        return np.zeros(self.still.object_count, np.bool_) if gone is None else gone

    def worlds(self, frame: int) -> Float64 | None:
        """(n, 4, 4) float64, world_from_object of each object in a frame, in the world; None where
        the scene's file has no transforms."""
        if self._scene.rig is None:
            return None
        worlds = self._scene.rig.worlds.copy()
        if self.moves:
            pose = self._pose(frame)
            for place, world in pose.worlds.items():
                worlds[place] = world
            for place, matrix in pose.before.items():
                worlds[place] = compose(matrix[None], worlds[place][None])[0]
        return worlds

    def standing(self, frame: int, place: int) -> tuple[Float64, NDArray[Any]] | None:
        """How a moving object stands in a frame, there or not: world_from_object, (4, 4), and its
        vertices in its own space, (v, 3) float32 or float64, of which `at` makes those of the
        scene. None where it shares vertices with others, and so has none of its own."""
        rig, pose = self._rig, self._pose(frame)
        world = pose.worlds.get(place, rig.worlds[place])
        if place in pose.before:
            world = compose(pose.before[place][None], world[None])[0]
        mesh = int(rig.mesh_of_object[place])
        if mesh < 0:
            return None
        points = pose.positions.get(place)
        if points is None:
            points = rig.positions[mesh]
        return world, points[self._rows(place)[0]]

    def rows(self, place: int) -> slice:
        """Where a moving object's vertices are in each frame's scene; what `standing` gives are
        as many, in the same order."""
        return self._rows(place)[1]

    def mirrored_at_rest(self, place: int) -> bool:
        """Whether the rest pose mirrors an object, so that its triangles are turned round."""
        return _mirrors(self._rig.worlds[place])

    def _between(self, one: int, other: int) -> Bool:
        result = np.zeros(self._scene.object_count, np.bool_)
        a, b = self._pose(one), self._pose(other)
        for index in np.flatnonzero(self._moving_objects):
            result[index] = a.key(int(index)) != b.key(int(index))
        return result

    @cached_property
    def _rig(self) -> Rig:
        return self._scene.rig if self._scene.rig is not None else _rig_of(self._scene)

    @cached_property
    def whole_triangles(self) -> Int32:
        """(t, 3) int32, those of all objects: of what is absent at rest, the scene's collapse."""
        return self._scene.triangles if self._rig.triangles is None else self._rig.triangles

    @cached_property
    def _meanings(self) -> _Meanings:
        return _Meanings(self._scene, self._source)

    @cached_property
    def _moving_objects(self) -> Bool:
        moving = self.still.moving
        assert moving is not None
        return moving

    def _refuse_without_time(self, scene: Scene) -> None:
        assert self._motion is not None
        for index, frame in zip(self._path.numbers, self._path.frames, strict=True):
            if frame.time_s is not None:
                continue
            affected = self._motion.affected(self._clip(frame, index))
            if affected.any():
                first = scene.names[int(np.argmax(affected))]
                raise InputError(
                    f"the scene animates {np.count_nonzero(affected)} objects (first '{first}'), "
                    "and the frame has no time",
                    source=self._source,
                    place=f"frames[{index}]",
                    fix="give the path 'fps' or its frames 'time_s', or say --rest-pose",
                )

    def _clip(self, frame: Frame, index: int) -> int:
        assert self._motion is not None
        clips = list(self._motion.clips)
        if frame.clip is None:
            return 0
        if frame.clip not in clips:
            raise InputError(
                f"the scene has no animation '{frame.clip}'",
                source=self._source,
                place=f"frames[{index}].animation",
                fix=did_you_mean(frame.clip, clips),
            )
        return clips.index(frame.clip)

    def _moving(self, scene: Scene) -> Bool:
        """(n,) bool, what any frame poses, hides or shows."""
        moving = np.zeros(scene.object_count, np.bool_)
        clips = set()
        for index, frame in zip(self._path.numbers, self._path.frames, strict=True):
            for name in frame.world_from_object:
                moving[list(self._meanings.objects(name, index, "world_from_object"))] = True
            for name in frame.absent:
                moving[list(self._meanings.objects(name, index, "absent"))] = True
            for name, level in frame.levels.items():
                if level:
                    moving[list(self._meanings.level_objects(name, level, index))] = True
                else:
                    self._meanings.level(name, level, index)
            if self._motion is not None and frame.time_s is not None:
                clips.add(self._clip(frame, index))
        if self._motion is not None:
            for clip in clips:
                moving |= self._motion.affected(clip)
        return moving

    def _pose(self, index: int) -> _Pose:
        kept: dict[int, _Pose] = self.__dict__.setdefault("_poses", {})
        if index not in kept:
            while len(kept) > 2:
                kept.pop(next(iter(kept)))
            kept[index] = self._make_pose(index)
        return kept[index]

    def _make_pose(self, index: int) -> _Pose:
        frame, rig = self._path.frame(index), self._rig
        pose = _Pose(absent=self._rest_hidden.copy())
        skinned = np.zeros(len(pose.absent), np.bool_)
        if self._motion is not None and frame.time_s is not None:
            moment: Moment = self._motion.at(self._clip(frame, index), frame.time_s)
            for place, world in zip(moment.objects.tolist(), moment.worlds, strict=True):
                if not np.array_equal(world, rig.worlds[place]):
                    pose.worlds[place] = world
            pose.positions.update(moment.positions)
            if len(moment.hidden):
                pose.absent[moment.objects] = moment.hidden[moment.objects]
            skinned = self._motion.skinned
        for name, matrix in frame.world_from_object.items():
            _check_affine(matrix, self._source, f"frames[{index}].world_from_object.{name}")
            objects, group = self._meanings.meaning(name, index, "world_from_object")
            for place in objects:
                if group or skinned[place]:
                    pose.before[place] = matrix
                else:
                    pose.worlds[place] = matrix
        there = {group.levels: 0 for group in self._scene.groups if group.levels}
        for name, level in frame.levels.items():
            there[self._meanings.level(name, level, index)] = level
        for levels, chosen in there.items():
            for number, objects in enumerate(levels):
                if number != chosen:
                    pose.absent[list(objects)] = True
        for name in frame.absent:
            pose.absent[list(self._meanings.objects(name, index, "absent"))] = True
        return pose

    def _posed(self, index: int) -> Scene:
        still, rig, pose = self.still, self._rig, self._pose(index)
        vertices = still.vertices.copy()
        moved = None if still.moved is None else still.moved.copy()
        triangles: Int32 = self.whole_triangles
        flips = []
        posed = sorted(pose.worlds.keys() | pose.positions.keys() | pose.before.keys())
        for place in posed:
            if pose.absent[place]:
                continue
            stands = self.standing(index, place)
            if stands is None:
                self._refuse_shared(place, index)
                continue
            world, points = stands
            new, by = (one[0] for one in transformed(world[None], points, still.origin))
            rows = self._rows(place)[1]
            if not np.isfinite(new).all():
                raise InputError(
                    "a vertex is NaN or infinite as it is posed",
                    source=self._source,
                    place=f"frames[{index}]: object '{still.names[place]}'",
                    fix="mend the animation or the matrix",
                )
            vertices[rows] = new
            if by.any() or moved is not None:
                moved = np.zeros(len(vertices), np.float32) if moved is None else moved
                moved[rows] = by
            if _mirrors(world) != _mirrors(rig.worlds[place]):
                flips.append(place)
        if flips:
            triangles = self._flipped(triangles, flips, index)
        return replace(
            still, vertices=vertices, triangles=triangles, moved=moved, absent=pose.absent
        )

    def _refuse_shared(self, place: int, index: int) -> None:
        """An object without a mesh has nothing to pose, unless it has triangles all the same."""
        start, end = self.still.object_offsets[place : place + 2]
        if end > start:
            raise InputError(
                "it shares vertices with other objects, and cannot be posed alone",
                source=self._source,
                place=f"frames[{index}]: object '{self.still.names[place]}'",
                fix="give each object vertices of its own",
            )

    def _rows(self, place: int) -> tuple[Bool | slice, slice]:
        """Which of an object's vertices are in the scene, and where they stand there."""
        start, end = (int(at) for at in self._rig.vertex_starts[place : place + 2])
        kept = self._rig.kept
        if kept is None:
            return slice(None), slice(start, end)
        before = self._places[start]
        return kept[start:end], slice(int(before), int(self._places[end]))

    @cached_property
    def _places(self) -> NDArray[np.int64]:
        assert self._rig.kept is not None
        return np.concatenate([[0], np.cumsum(self._rig.kept)])

    def _flipped(self, triangles: Int32, flips: list[int], index: int) -> Int32:
        """Triangles of objects that a pose mirrors, and rest does not, the other way round."""
        still, result = self.still, triangles.copy()
        for place in flips:
            part = slice(*still.object_offsets[place : place + 2])
            if still.masks is not None and (still.masks.row[part] >= 0).any():
                raise InputError(
                    "an object with an alpha mask is mirrored",
                    source=self._source,
                    place=f"frames[{index}]: object '{still.names[place]}'",
                    fix="mirror it in the file",
                )
            result[part] = triangles[part, ::-1]
        return result


class _Meanings:
    """What the names in a path's frames stand for in the scene."""

    def __init__(self, scene: Scene, source: str) -> None:
        self._names, self._source = Names(scene), source
        self._groups = {
            ids: group for group in scene.groups for ids in (group.objects,) if group.levels
        }
        self._by_name = {
            key: group for group in scene.groups if group.levels for key in (group.path, group.name)
        }
        self._known: dict[str, tuple[int, ...]] = {}

    def objects(self, name: str, index: int, field_name: str) -> tuple[int, ...]:
        """The ids of the object, or of the group's objects."""
        if name not in self._known:
            places = {name: f"frames[{index}].{field_name}"}
            self._known.update(self._names.resolved(places, self._source))
        return self._known[name]

    def meaning(self, name: str, index: int, field_name: str) -> tuple[tuple[int, ...], bool]:
        """The ids, and whether they are a group's."""
        objects = self.objects(name, index, field_name)
        return objects, len(objects) != 1 or name.startswith("group:") or objects in self._groups

    def level(self, name: str, level: int, index: int) -> tuple[tuple[int, ...], ...]:
        """The ids of each level of a group. Raises InputError where it has no such level."""
        place = f"frames[{index}].levels.{name}"
        group = self._by_name.get(name.removeprefix("group:").removeprefix("/"))
        if group is None:
            raise InputError(
                f"no group with levels of detail is named '{name}'",
                source=self._source,
                place=place,
                fix=did_you_mean(name, self._by_name, "the scene's file has none (MSFT_lod)"),
            )
        if level >= len(group.levels):
            raise InputError(
                f"level {level} of '{name}' is none of its {len(group.levels)}",
                source=self._source,
                place=place,
                fix=f"give 0 to {len(group.levels) - 1}",
            )
        return group.levels

    def level_objects(self, name: str, level: int, index: int) -> tuple[int, ...]:
        """The ids that a level other than the finest hides or shows."""
        levels = self.level(name, level, index)
        return (*levels[0], *levels[level])


def _rig_of(scene: Scene) -> Rig:
    """A rig for a scene that has none: each object is where its vertices are. An object's vertices
    are those from its first one to the next object's; where objects share some, none can be posed.
    """
    count, offsets = scene.object_count, scene.object_offsets
    some = np.flatnonzero(np.diff(offsets))
    starts = np.full(count + 1, len(scene.vertices), np.int64)
    ends = np.zeros(count, np.int64)
    if len(some):
        starts[some] = np.minimum.reduceat(scene.triangles.min(axis=1), offsets[some])
        ends[some] = np.maximum.reduceat(scene.triangles.max(axis=1), offsets[some]) + 1
    # An object without triangles ends where it starts, at the next one's start.
    starts = np.minimum.accumulate(starts[::-1])[::-1]
    worlds = np.tile(np.eye(4), (count, 1, 1))
    if (ends > starts[1:]).any():
        return Rig((), np.full(count, -1), worlds, starts)
    exact = scene.vertices.astype(np.float64) + scene.origin
    pairs = zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)
    return Rig([exact[start:end] for start, end in pairs], np.arange(count), worlds, starts)


def _mirrors(world: Float64) -> bool:
    return bool(np.linalg.det(world[:3, :3]) < 0.0)


def _check_affine(matrix: Float64, source: str, place: str) -> None:
    """Raise InputError unless a (4, 4) matrix is finite, affine and invertible."""
    problem = ""
    if not np.isfinite(matrix).all():
        problem = "the matrix is not finite"
    elif not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        problem = "the matrix's last row is not 0 0 0 1"
    elif np.linalg.det(matrix[:3, :3] / np.abs(matrix[:3, :3]).max(initial=1e-300)) == 0.0:
        problem = "the matrix cannot be inverted"
    if problem:
        raise InputError(problem, source=source, place=place, fix="give an affine matrix")
