"""Scenes and camera paths from files: the reader is found by the file's extension.

The entry-point group `visref.scene_formats` names a reader for each extension; a file whose
extension nobody has registered goes through trimesh. Readers are imported when they are needed.
"""

from __future__ import annotations

import gc
import inspect
import sys
from collections.abc import Callable
from functools import cache, wraps
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, Protocol, TypeVar, cast

import numpy as np

from visref.camera_path import CameraPath
from visref.doing import doing
from visref.errors import InputError
from visref.formats.placed import Placed, flatten
from visref.memory import Budget
from visref.scene import Scene
from visref.wording import did_you_mean

if TYPE_CHECKING:
    import trimesh

P = ParamSpec("P")
T = TypeVar("T")

FORMATS = "visref.scene_formats"
# These hold cameras too; and their scene graph may mean its objects to be empty.
GLTF = (".glb", ".gltf", ".vrm")
# trimesh skips what it cannot read in an archive, without a word.
_ARCHIVES = (".zip", ".gz", ".bz2", ".xz", ".7z", ".tar", ".rar")

# Numbers that overflow become vertices and cameras that are not finite, and those are refused.
_quiet_overflow = np.errstate(over="ignore", invalid="ignore")


def _no_collection(read: Callable[P, T]) -> Callable[P, T]:
    """Let Python's collector of cycles rest meanwhile: a file's millions of small objects are there
    to stay, and it would look at all of them again and again."""

    @wraps(read)
    def resting(*args: P.args, **kwargs: P.kwargs) -> T:
        was_on = gc.isenabled()
        gc.disable()
        try:
            return read(*args, **kwargs)
        finally:
            if was_on:
                gc.enable()

    return resting


class Reader(Protocol):
    """What an entry point of `visref.scene_formats` names; the point's own name is the file
    extension in small letters, without its dot. A reader of several extensions has several
    points.

    A reader that has a parameter `budget` gets a `visref.memory.Budget`, and claims what the file
    expands to before it allocates it. The objects that it places are claimed for it in any case,
    before they become a scene."""

    def __call__(self, path: Path) -> Placed:
        """The objects of a file that exists and is not empty. Raises InputError for whatever
        is wrong with it, with the place in the file where it can; the caller adds its name."""
        ...


@_quiet_overflow
@_no_collection
def load_scene(
    path: Path | str,
    *,
    cull_backfaces: bool = False,
    lenient: bool = False,
    max_memory: int | None = None,
) -> Scene:
    """A scene from a file of any known format (`docs/formats.md`).

    `cull_backfaces`: triangles whose material is not double-sided become `one_sided` (without
    it none is). `lenient`: triangles with a NaN or infinite vertex are dropped and counted in
    `Scene.notes`, instead of an error. `max_memory`: bytes that the scene may take, by default
    a share of what is free (`visref.memory.default_budget`).

    Raises InputError, naming the file and the place, for whatever is wrong with the file, and
    where it expands to more than the limit.
    """
    file = Path(path)
    budget = Budget.of(max_memory)
    try:
        _check_file(file)
        with doing(f"reading {file.name}"):
            placed = _read(_reader(file.suffix.lower()), file, budget)
        if not isinstance(placed, Placed):
            raise InputError(
                f"the reader of '{file.suffix}' files returned no visref.formats.Placed",
                fix="mend that reader",
            )
        scene = flatten(
            placed,
            source=str(file),
            cull_backfaces=cull_backfaces,
            lenient=lenient,
            budget=budget,
        )
        if not scene.triangle_count and file.suffix.lower() not in GLTF:
            raise InputError("there is no triangle in it", fix="give a file with a mesh")
        return scene
    except _FAILURES as error:
        raise _refused(error, file) from error


@_quiet_overflow
def load_path(
    path: Path | str,
    *,
    width: int = 1280,
    height: int = 960,
    fps: float | None = None,
    max_memory: int | None = None,
) -> CameraPath:
    """A camera path from a path file (JSON), or from the cameras of a glTF or GLB file.

    `width`, `height` and `fps` are for glTF alone, which says nothing of pixels: the image's
    size, and frames a second of its animation (None: one at each keyframe). `max_memory` as in
    `load_scene`.

    Raises InputError naming the file and the place.
    """
    file = Path(path)
    budget = Budget.of(max_memory)
    if file.suffix.lower() not in GLTF:
        return CameraPath.load(file, budget=budget)
    from visref.formats.gltf.cameras import read_cameras
    from visref.formats.gltf.document import Document

    try:
        _check_file(file)
        document = Document(file, budget)
        cameras = read_cameras(document, width=width, height=height, fps=fps)
    except _FAILURES as error:
        raise _refused(error, file) from error
    return CameraPath(cameras.frames, str(file))


@_quiet_overflow
def scene_from_trimesh(
    loaded: trimesh.Trimesh | trimesh.Scene,
    *,
    cull_backfaces: bool = False,
    lenient: bool = False,
    source: str = "trimesh",
) -> Scene:
    """A scene from trimesh's own types: an object for each node with a geometry, depth-first.

    Point clouds and paths become objects without triangles. Raises InputError as `load_scene`.
    """
    from visref.formats.through_trimesh import from_trimesh

    placed = from_trimesh(loaded)
    return flatten(
        placed,
        source=source,
        cull_backfaces=cull_backfaces,
        lenient=lenient,
        budget=Budget.of(None),
    )


def known_extensions() -> list[str]:
    """The extensions that can be read, sorted: those registered, and what trimesh reads."""
    from visref.formats.through_trimesh import extensions

    registered = {point.name for point in _registered(entry_points, tuple(sys.path))}
    archives = {ending[1:] for ending in _ARCHIVES}
    return sorted(registered | {name for name in extensions() if name not in archives})


# Every package's metadata is a file: too many to read for each scene.
@cache
def _registered(find: Callable[..., EntryPoints], path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    return tuple(find(group=FORMATS))


_FAILURES = (InputError, RecursionError, MemoryError)


def _refused(error: BaseException, file: Path) -> InputError:
    """What a reader stopped at, in one line."""
    if isinstance(error, InputError):
        return error.at(source=str(file))
    if isinstance(error, RecursionError):
        problem, fix = "its nodes are nested too deep", "export the file anew"
    else:
        problem, fix = "it needs more memory than there is", "give a smaller scene"
    return InputError(problem, source=str(file), fix=fix)


def _read(reader: Reader, file: Path, budget: Budget) -> Placed:
    """What a reader makes of a file, with the budget if it asks for one."""
    called: Any = reader
    if "budget" in inspect.signature(called).parameters:
        return cast(Placed, called(file, budget=budget))
    return reader(file)


def _reader(suffix: str) -> Reader:
    """The reader of files ending in `suffix`, which has its dot."""
    named = [
        point for point in _registered(entry_points, tuple(sys.path)) if point.name == suffix[1:]
    ]
    points = {point.value: point for point in named}
    if len(points) > 1:
        raise InputError(
            f"'{suffix}' files have several readers: {', '.join(sorted(points))}",
            fix="uninstall all but one of the packages",
        )
    if suffix in _ARCHIVES and not points:
        raise InputError("this is an archive", fix="unpack it and give the mesh itself")
    for point in points.values():
        try:
            return cast(Reader, point.load())
        except ImportError as error:
            raise InputError(
                f"the reader of '{suffix}' files does not import: {error}",
                fix=f"mend or uninstall {point.value}",
            ) from error
    from visref.formats.through_trimesh import can_read, read_with_trimesh

    if not can_read(suffix[1:]):
        known = known_extensions()
        listed = f"known are {', '.join(known)}"
        hint = f"{did_you_mean(suffix[1:], known)} {listed}" if suffix else listed
        raise InputError(f"files ending in '{suffix}' are not known", fix=hint)
    return cast(Reader, read_with_trimesh)


def _check_file(file: Path) -> None:
    if not file.exists():
        raise InputError("there is no such file", fix="check the name")
    if not file.is_file():
        raise InputError("this is not a file", fix="give the file itself")
    try:
        with file.open("rb") as stream:
            empty = not stream.read(1)
    except OSError as error:
        raise InputError(
            f"cannot read the file: {error.strerror}", fix="check its permissions"
        ) from error
    if empty:
        raise InputError("the file is empty", fix="give a complete file")
