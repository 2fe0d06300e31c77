"""Scenes and camera paths from files, and scenes from trimesh.

glTF, OBJ and COLLADA have readers of their own (their modules say what trimesh gets wrong in
them); every other format goes through trimesh, with its clean-up switched off, since a
verdict is about the triangles as given.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.findings import Code
from visref.formats.collada import read_collada
from visref.formats.gltf.cameras import read_cameras
from visref.formats.gltf.document import Document
from visref.formats.gltf.objects import read_objects
from visref.formats.obj import read_obj
from visref.formats.placed import NO_MESH, Mesh, Placed, compose, flatten
from visref.scene import Alpha, Scene

_GLTF = (".glb", ".gltf", ".vrm")
_COLLADA = (".dae", ".zae")
# trimesh skips what it cannot read in an archive, without a word.
_ARCHIVES = (".zip", ".gz", ".bz2")

# Numbers that overflow become vertices and cameras that are not finite, and those are refused.
_quiet_overflow = np.errstate(over="ignore", invalid="ignore")


@_quiet_overflow
def load_scene(path: Path | str, *, cull_backfaces: bool = False, lenient: bool = False) -> Scene:
    """A scene from a file: GLB, glTF, OBJ, COLLADA, PLY, STL, OFF, 3MF and what trimesh reads.

    `cull_backfaces`: triangles whose material is not double-sided become `one_sided` (without
    it none is). `lenient`: triangles with a NaN or infinite vertex are dropped and counted in
    `Scene.notes`, instead of an error.

    Raises InputError, naming the file and the place, for whatever is wrong with the file.
    """
    file = Path(path)
    try:
        _check_file(file)
        placed = _read(file)
        scene = flatten(placed, source=str(file), cull_backfaces=cull_backfaces, lenient=lenient)
        if not scene.triangle_count and file.suffix.lower() not in _GLTF:
            # glTF's scene graph may mean its objects to be empty; elsewhere this is no mesh.
            raise InputError("there is no triangle in it", fix="give a file with a mesh")
        return scene
    except InputError as error:
        raise error.at(source=str(file)) from error
    except RecursionError as error:
        raise InputError(
            "its nodes are nested too deep", source=str(file), fix="export the file anew"
        ) from error
    except MemoryError as error:
        raise InputError(
            "it needs more memory than there is", source=str(file), fix="give a smaller scene"
        ) from error


@_quiet_overflow
def load_path(
    path: Path | str, *, width: int = 1280, height: int = 960, fps: float | None = None
) -> CameraPath:
    """A camera path from a path file (JSON), or from the cameras of a glTF or GLB file.

    `width`, `height` and `fps` are for glTF alone, which says nothing of pixels: the image's
    size, and frames a second of its animation (None: one at each keyframe).

    Raises InputError naming the file and the place.
    """
    file = Path(path)
    if file.suffix.lower() not in _GLTF:
        return CameraPath.load(file)
    try:
        _check_file(file)
        cameras = read_cameras(Document(file), width=width, height=height, fps=fps)
    except InputError as error:
        raise error.at(source=str(file)) from error
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
    graph = loaded if isinstance(loaded, trimesh.Scene) else trimesh.Scene(loaded)
    placed = _from_trimesh(graph)
    return flatten(placed, source=source, cull_backfaces=cull_backfaces, lenient=lenient)


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


def _read(file: Path) -> Placed:
    suffix = file.suffix.lower()
    if suffix in _GLTF:
        return read_objects(Document(file))
    if suffix in _COLLADA:
        return read_collada(file)
    if suffix == ".obj":
        return read_obj(file)
    known = sorted(trimesh.available_formats())
    if suffix in _ARCHIVES:
        raise InputError("this is an archive", fix="unpack it and give the mesh itself")
    if suffix[1:] not in known and suffix[1:] not in trimesh.exchange.load.mesh_loaders:
        raise InputError(
            f"files ending in '{suffix}' are not known", fix=f"known are {', '.join(known)}"
        )
    said = _Said(logging.WARNING)
    logger = logging.getLogger("trimesh")
    logger.addHandler(said)
    try:
        loaded = trimesh.load_scene(str(file.absolute()), process=False)
    except ImportError as error:
        raise InputError(
            f"reading '{suffix}' files needs a package: {error}", fix="install it with pip"
        ) from error
    except Exception as error:  # trimesh's readers fail in as many ways as there are formats.
        kind = type(error).__name__
        raise InputError(
            f"this is not a readable '{suffix}' file ({kind}: {str(error)[:120]})",
            fix="export the file anew",
        ) from error
    finally:
        logger.removeHandler(said)
    placed = _from_trimesh(loaded)
    placed.notes.extend((Code.PARTLY_READ, f"trimesh says: {line}") for line in said.lines)
    return placed


class _Said(logging.Handler):
    """Collects what a library only logs: a loader's warning is a finding, not a line lost."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


def _from_trimesh(loaded: trimesh.Scene) -> Placed:
    placed = Placed()
    known: dict[str, int] = {}
    forest = loaded.graph.transforms
    children: dict[Any, list[Any]] = {}
    for child, parent in forest.parents.items():
        children.setdefault(parent, []).append(child)
    waiting = [(loaded.graph.base_frame, np.eye(4))]
    while waiting:
        frame, world = waiting.pop()
        for child in reversed(children.get(frame, [])):
            matrix = forest.edge_data[(frame, child)].get("matrix", np.eye(4))
            waiting.append((child, compose(world, np.asarray(matrix, np.float64))))
        name = forest.node_data.get(frame, {}).get("geometry")
        if name is None:
            continue
        if name not in known:
            geometry = loaded.geometry[name]
            known[name] = NO_MESH
            if isinstance(geometry, trimesh.Trimesh):
                known[name] = len(placed.meshes)
                placed.meshes.append(_mesh(geometry, str(frame)))
        placed.add(str(frame), known[name], world)
    return placed


def _mesh(geometry: trimesh.Trimesh, name: str) -> Mesh:
    positions = np.asarray(geometry.vertices).reshape(-1, 3)
    triangles = np.asarray(geometry.faces).reshape(-1, 3)
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(positions):
        raise InputError(
            f"a triangle names a vertex: index out of range 0…{len(positions) - 1}",
            place=f"object '{name}'",
            fix="mend the index buffer",
        )
    material: Any = getattr(geometry.visual, "material", None)
    one_sided = not getattr(material, "doubleSided", None)
    alpha = Alpha.__members__.get(getattr(material, "alphaMode", None) or "", Alpha.OPAQUE)
    if alpha == Alpha.MASK and material.baseColorTexture is None:
        # A constant alpha decides it, as in glTF.
        factor, cutoff = material.baseColorFactor, material.alphaCutoff
        opacity = 1.0 if factor is None else float(factor[3]) / 255.0
        if opacity < (0.5 if cutoff is None else cutoff):
            triangles = triangles[:0]
        alpha = Alpha.OPAQUE
    return Mesh.plain(positions, triangles, one_sided=one_sided, alpha=alpha)
