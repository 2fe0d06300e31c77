"""A case: a scene over a few frames as plain values, which two files say exactly.

Whatever a run judged (groups, levels of detail, animation by time, skins) becomes objects at the
root of a scene, with what each frame says of them: a matrix, an absence, or, for what is deformed,
the vertices themselves. Written as `scene.glb` and `path.json` and read back by visref's own
readers it is the same case.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath, Frame
from visref.conformance.glb import Growth, glb_of
from visref.errors import InputError
from visref.formats import load_scene
from visref.inputs import Inputs
from visref.masks.store import Masks
from visref.registry import DEFAULT_ENGINE
from visref.rig import Moment, Rig
from visref.scene import Float32, Float64, Int32, Scene, unique_names
from visref.timeline import Timeline

SCENE, PATH = "scene.glb", "path.json"

_CLIP = "shapes"
_NOWHERE = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Case:
    """A scene, how its objects stand in each frame, and who looks.

    `scene`: objects at the root, each with vertices of its own that its triangles use, with the
    names that they were given where these can be told (`given_names`); it has no rig and no groups,
    and is `one_sided` as its file is. `path`: frames 0,
    1, …, with cameras in world coordinates; beyond these a frame says `world_from_object` and
    `absent` by object names, and nothing else. `shapes`: by the id of an object that is deformed,
    (frames, v, 3) float32, its vertices in each frame in place of the scene's. `cull_backfaces`:
    whether it is judged with that setting; without it `one_sided` is what other programs read.
    """

    scene: Scene
    path: CameraPath
    shapes: Mapping[int, Float32] = field(default_factory=dict)
    cull_backfaces: bool = True

    @classmethod
    def of(
        cls,
        scene: Scene,
        path: CameraPath,
        frames: Sequence[int] | None = None,
        *,
        rest_pose: bool = False,
        cull_backfaces: bool = True,
    ) -> Case:
        """The case of some of a path's frames, by number (by default all), over a scene as a reader
        or a generator gives it; with `rest_pose` nothing is animated. Raises InputError, which says
        what, where something cannot be carried over."""
        path = path.relative_to(scene.origin)
        timeline = Timeline(scene, path, rest_pose=rest_pose)
        return _Plain(timeline, path, path.numbers if frames is None else frames).case(
            cull_backfaces
        )

    @cached_property
    def digest(self) -> str:
        """SHA-256 (hexadecimal) of all that a verdict depends on, the same however its vertices are
        shared among an object's triangles."""
        state = hashlib.sha256(b"visref-case-1")
        scene = self.scene
        for array in (scene.object_offsets, scene.one_sided, scene.alpha, scene.origin):
            state.update(f"{array.shape}".encode() + array.tobytes())
        state.update(scene.vertices[scene.triangles].tobytes())
        state.update("\0".join([*scene.names, *scene.given_names]).encode())
        if scene.masks is not None:
            state.update(scene.masks.digest)
        for index, shapes in sorted(self.shapes.items()):
            part = slice(*scene.object_offsets[index : index + 2])
            own = scene.triangles[part] - self.vertex_starts[index]
            state.update(f"{index}".encode() + shapes[:, own].tobytes())
        state.update(json.dumps([self.cull_backfaces, self.path.to_json()]).encode())
        return state.hexdigest()

    @cached_property
    def vertex_starts(self) -> NDArray[np.int64]:
        """(n + 1,) int64: object i's vertices are `vertex_starts[i]:vertex_starts[i + 1]`."""
        return starts_of(self.scene)

    @property
    def moves(self) -> bool:
        """Whether any frame says more than where its cameras are."""
        return bool(self.shapes) or any(frame.poses for frame in self.path.frames)

    def inputs(self, engine: str = DEFAULT_ENGINE, threads: int | None = 1) -> Inputs:
        """What a run of this case works on."""
        scene, path = self.scene, self.path
        if not self.cull_backfaces and scene.has_one_sided:
            scene = replace(scene, one_sided=np.zeros(scene.triangle_count, np.bool_))
        if self.shapes:
            scene = _rigged(scene, self.vertex_starts, self.shapes)
            path = _timed(path)
        settings = {"cull_backfaces": self.cull_backfaces, "lenient": False}
        return Inputs(scene, path, path.numbers, engine, threads, settings)

    # Files.

    def files(self) -> dict[str, bytes]:
        """What `scene.glb` and `path.json` hold, the same bytes for the same case. Raises
        InputError where no file says the scene exactly (a mask that cannot be looked up, no
        object)."""
        scene, path, growth = self.scene, self.path, None
        if self.shapes:
            scene, growth = self._growing()
            path = _timed(path)
        said = json.dumps(path.to_json(), indent=1, ensure_ascii=True, allow_nan=False)
        return {SCENE: glb_of(scene, growth, given=True), PATH: f"{said}\n".encode()}

    def write(self, folder: Path) -> None:
        """Write both files into a folder that is there. Raises what `files` does."""
        for name, data in self.files().items():
            (folder / name).write_bytes(data)

    @classmethod
    def read(cls, folder: Path, *, cull_backfaces: bool = True) -> Case:
        """The case of a folder's two files. Raises InputError for anything wrong with them."""
        scene = load_scene(folder / SCENE, cull_backfaces=True)
        path = CameraPath.load(folder / PATH)
        return cls.of(scene, path, cull_backfaces=cull_backfaces)

    def read_back(self) -> Case:
        """The case as its files say it. Raises what `files` does."""
        with tempfile.TemporaryDirectory(prefix="visref-case-") as name:
            self.write(Path(name))
            return Case.read(Path(name), cull_backfaces=self.cull_backfaces)

    def _growing(self) -> tuple[Scene, Growth]:
        """The scene, and morph targets that make each frame's shapes of it, exactly."""
        count = len(self.path)
        vertices = self.scene.vertices.copy()
        moves = {index: shapes[1:] - shapes[0] for index, shapes in self.shapes.items()}
        exact = all(
            np.array_equal((shapes[0] + moves[index].astype(np.float64)).astype(np.float32), later)
            for index, shapes in self.shapes.items()
            for later in [shapes[1:]]
        )
        if not exact or count == 1:
            # From nothing: each target is a frame's vertices.
            for index in self.shapes:
                vertices[slice(*self.vertex_starts[index : index + 2])] = 0.0
            moves = dict(self.shapes)
        weights = np.eye(count, dtype=np.float32)[:, 1 if exact and count > 1 else 0 :]
        return replace(self.scene, vertices=vertices), Growth(moves, weights, _CLIP)


def given_names(
    names: Sequence[str], given: Sequence[str], frames: Sequence[Frame]
) -> tuple[str, ...]:
    """The names that objects were given, where a file that has them is read with these `names`, and
    frames say nothing of one that is several objects'; else `names`."""
    repeated = {name for name, count in Counter(given).items() if count > 1}
    told = {n for frame in frames for n in (*frame.world_from_object, *frame.absent)}
    plain = unique_names(given) == tuple(names) and not repeated & told
    return tuple(given if plain else names)


def starts_of(scene: Scene) -> NDArray[np.int64]:
    """(n + 1,) int64, where each object's vertices start in a scene whose objects have their own,
    one after another."""
    count, offsets = scene.object_count, scene.object_offsets
    starts = np.full(count + 1, len(scene.vertices), np.int64)
    some = np.flatnonzero(np.diff(offsets))
    if len(some):
        starts[some] = np.minimum.reduceat(scene.triangles.min(axis=1), offsets[some])
    result: NDArray[np.int64] = np.minimum.accumulate(starts[::-1])[::-1]
    return result


def _timed(path: CameraPath) -> CameraPath:
    """A frame per second, so that each has its own shapes."""
    frames = [replace(frame, time_s=float(at), clip=_CLIP) for at, frame in enumerate(path.frames)]
    return CameraPath(frames, path.source)


@dataclass(frozen=True, eq=False)
class _Shapes:
    """As `visref.rig.Motion`: at second k what is deformed has its vertices of frame k."""

    count: int
    shapes: Mapping[int, Float32]
    digest: str
    clips: Sequence[str] = (_CLIP,)

    @property
    def skinned(self) -> NDArray[np.bool_]:
        return np.zeros(self.count, np.bool_)

    def affected(self, clip: int) -> NDArray[np.bool_]:
        result = np.zeros(self.count, np.bool_)
        result[list(self.shapes)] = True
        return result

    def at(self, clip: int, time_s: float) -> Moment:
        objects = np.array(sorted(self.shapes), np.int64)
        posed = {index: self.shapes[index][int(time_s)].astype(np.float64) for index in objects}
        return Moment(objects, np.tile(np.eye(4), (len(objects), 1, 1)), posed)


def _rigged(scene: Scene, starts: NDArray[np.int64], shapes: Mapping[int, Float32]) -> Scene:
    count = scene.object_count
    digest = hashlib.sha256(b"".join(shapes[index].tobytes() for index in sorted(shapes)))
    motion = _Shapes(count, shapes, digest.hexdigest())
    positions = [scene.vertices[a:b] for a, b in pairwise(starts)]
    worlds = np.tile(np.eye(4), (count, 1, 1))
    rig = Rig(positions, np.arange(count), worlds, starts, motion=motion)
    return replace(scene, rig=rig, motion=motion.digest)


@dataclass(eq=False)
class _Plain:
    """Makes a plain scene of one that a path poses, as it stands in some of the path's frames."""

    timeline: Timeline
    path: CameraPath
    frames: Sequence[int]
    # Of each object its vertices, and its triangles among them.
    points: list[Float32] = field(default_factory=list)
    faces: list[Int32] = field(default_factory=list)
    # By object: what the frames say of it.
    worlds: dict[int, list[Float64]] = field(default_factory=dict)
    shapes: dict[int, Float32] = field(default_factory=dict)

    def case(self, cull_backfaces: bool) -> Case:
        timeline = self.timeline
        still, whole = timeline.still, timeline.whole_triangles
        moving = np.zeros(still.object_count, np.bool_) if still.moving is None else still.moving
        scenes = [timeline.at(frame) for frame in self.frames] if moving.any() else []
        for index in range(still.object_count):
            part = slice(*still.object_offsets[index : index + 2])
            # Those that are used, in the order in which a file would have them.
            used, faces = np.unique(whole[part], return_inverse=True)
            self.points.append(still.vertices[used])
            self.faces.append(faces.reshape(-1, 3).astype(np.int32))
            if moving[index] and len(used):
                self._moving(index, used, part, scenes)
        path = self._path(still.names)
        scene = self._scene(still, path.frames)
        if scene.origin.any() and (self.worlds or self.shapes):
            # A matrix is of the world, and takes the place of whatever moved the object there.
            scene, path = _nearer(scene, path)
        return Case(scene, path, self.shapes, cull_backfaces)

    def _moving(self, index: int, used: NDArray[Any], part: slice, scenes: list[Scene]) -> None:
        timeline, still = self.timeline, self.timeline.still
        masked = still.masks is not None and bool((still.masks.row[part] >= 0).any())
        there = [k for k, frame in enumerate(self.frames) if not timeline.absent(frame)[index]]
        placed = np.stack([scene.vertices[used] for scene in scenes])
        if there:
            # Nobody sees it where it is absent.
            placed[: there[0]] = placed[there[0]]
            for k in range(there[0] + 1, len(scenes)):
                placed[k] = placed[k] if k in there else placed[k - 1]
        turned = {bool(self._mirrors(scenes[k], index)) for k in there}
        if not there or (placed == placed[0]).all():
            self.points[index] = placed[0]
            self._turn(index, turned)
            return
        stands = [timeline.standing(frame, index) for frame in self.frames]
        rest = timeline.mirrored_at_rest(index)
        own = self._own_vertices(index, used, stands)
        if own is None or (rest and masked):
            self.shapes[index] = placed
            self.points[index] = placed[0]
            if len(turned) > 1:
                raise InputError(
                    "an object is both deformed and mirrored, and no plain file says that",
                    source=self.path.source,
                    place=f"object '{still.names[index]}'",
                )
            self._turn(index, turned)
            return
        self.points[index] = own
        if rest:
            self.faces[index] = self.faces[index][:, ::-1]
        self.worlds[index] = [one[0] for one in stands if one is not None]

    def _mirrors(self, scene: Scene, index: int) -> bool:
        """Whether a frame's scene has the object's triangles the other way round."""
        part = slice(*scene.object_offsets[index : index + 2])
        return not np.array_equal(scene.triangles[part], self.timeline.whole_triangles[part])

    def _turn(self, index: int, turned: set[bool]) -> None:
        if turned == {True}:
            self.faces[index] = self.faces[index][:, ::-1]

    def _own_vertices(
        self, index: int, used: NDArray[Any], stands: Sequence[tuple[Float64, NDArray[Any]] | None]
    ) -> Float32 | None:
        """An object's vertices in its own space, if it has the same in all frames and float32
        holds them."""
        first = stands[0]
        if first is None or any(
            one is None or not np.array_equal(one[1], first[1]) for one in stands
        ):
            return None
        own = np.asarray(first[1])[used - self.timeline.rows(index).start]
        exact = own.astype(np.float32)
        return exact if np.array_equal(exact, own) else None

    def _scene(self, still: Scene, frames: Sequence[Frame]) -> Scene:
        given = given_names(still.names, still.given_names, frames)
        bases = np.cumsum([0, *map(len, self.points)])
        faces = [own + base for own, base in zip(self.faces, bases[:-1], strict=True)]
        return Scene(
            vertices=np.concatenate([*self.points, np.zeros((0, 3), np.float32)]),
            triangles=np.concatenate([*faces, np.zeros((0, 3), np.int32)]),
            object_offsets=still.object_offsets,
            names=still.names,
            one_sided=still.one_sided,
            alpha=still.alpha,
            source=SCENE,
            masks=still.masks,
            origin=still.origin,
            given_names=given,
            paths=given,
        )

    def _path(self, names: Sequence[str]) -> CameraPath:
        frames = []
        for k, number in enumerate(self.frames):
            absent = np.flatnonzero(self.timeline.absent(number))
            poses = {names[index]: worlds[k] for index, worlds in self.worlds.items()}
            frames.append(
                Frame(
                    self.path.views(number),
                    world_from_object=poses,
                    absent=tuple(names[int(index)] for index in absent),
                )
            )
        return CameraPath(frames, PATH).relative_to(_NOWHERE)


def _nearer(scene: Scene, path: CameraPath) -> tuple[Scene, CameraPath]:
    """The same, moved so that the scene's origin is at zero."""
    step = np.eye(4)
    step[:3, 3] = -scene.origin
    frames = [
        replace(
            frame,
            cameras=tuple(
                replace(camera.relative_to(scene.origin), origin=(0.0, 0.0, 0.0))
                for camera in frame.cameras
            ),
            world_from_object={n: step @ m for n, m in frame.world_from_object.items()},
        )
        for frame in path.frames
    ]
    return replace(scene, origin=np.zeros(3)), CameraPath(frames, path.source)


def masks_of(scene: Scene, kept: NDArray[np.bool_]) -> Masks | None:
    """The masks of the triangles where `kept`, (t,) bool, is True; None where none is left."""
    if scene.masks is None:
        return None
    masks = scene.masks.take(kept)
    return masks if (masks.row >= 0).any() else None
