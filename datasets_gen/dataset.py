"""What a generator returns: a small scene graph and a camera path, and the two ways out of it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datasets_gen.glb import glb_bytes
from datasets_gen.graph import Node
from visref.camera import CameraPath
from visref.errors import InputError
from visref.scene import Alpha, Scene, unique_names


@dataclass(frozen=True, eq=False)
class Dataset:
    """A scene graph, the path through it, and where it is a test case what must be seen.

    `nodes`: the roots, in file order. `expected`: the right verdict in JSON form, or None.
    """

    name: str
    nodes: tuple[Node, ...]
    path: CameraPath
    expected: dict[str, Any] | None = field(default=None)

    def write(self, directory: Path) -> tuple[Path, Path]:
        """Write NAME.glb and NAME.path.json (and NAME.expected.json where there is one).

        Deterministic to the byte; each file is written beside its name, then renamed. Returns
        the first two paths. Raises InputError where the directory cannot be written.
        """
        scene_file = directory / f"{self.name}.glb"
        path_file = directory / f"{self.name}.path.json"
        try:
            directory.mkdir(parents=True, exist_ok=True)
            _replace(scene_file, glb_bytes(self.nodes))
            _replace(path_file, _json_bytes(self.path.to_json()))
            if self.expected is not None:
                _replace(directory / f"{self.name}.expected.json", _json_bytes(self.expected))
        except OSError as error:
            raise InputError(
                f"cannot write: {error.strerror}",
                source=str(error.filename or directory),
                mend="give a directory that can be written",
            ) from error
        return scene_file, path_file


def scene_of(dataset: Dataset) -> Scene:
    """The scene that loading the data set's GLB gives, without the file.

    Raises InputError as loading does (a vertex that is not finite).
    """
    vertices: list[NDArray[np.float32]] = []
    triangles: list[NDArray[np.int64]] = []
    one_sided: list[NDArray[np.bool_]] = []
    alpha: list[NDArray[np.uint8]] = []
    names: list[str] = []
    offsets = [0]
    base = 0
    for node, world_from_mesh in _depth_first(dataset.nodes, np.eye(4)):
        if node.mesh is None:
            continue
        names.append(node.name or node.mesh.name or "object")
        mirrored = np.linalg.det(world_from_mesh[:3, :3]) < 0.0
        count = 0
        for primitive in node.mesh.primitives:
            local = primitive.vertices.astype(np.float64)
            world = local @ world_from_mesh[:3, :3].T + world_from_mesh[:3, 3]
            corners = primitive.triangles.astype(np.int64) + base
            vertices.append(world.astype(np.float32))
            triangles.append(corners[:, [0, 2, 1]] if mirrored else corners)
            one_sided.append(np.full(len(corners), not primitive.material.double_sided))
            alpha.append(np.full(len(corners), int(primitive.material.alpha), np.uint8))
            base += len(world)
            count += len(corners)
        offsets.append(offsets[-1] + count)
    return Scene(
        vertices=np.concatenate([np.zeros((0, 3), np.float32), *vertices]),
        triangles=np.concatenate([np.zeros((0, 3), np.int64), *triangles]).astype(np.int32),
        object_offsets=np.array(offsets, np.int64),
        names=unique_names(names),
        one_sided=np.concatenate([np.zeros(0, np.bool_), *one_sided]),
        alpha=np.concatenate([np.full(0, Alpha.OPAQUE, np.uint8), *alpha]),
        source=f"{dataset.name}.glb",
    )


def _depth_first(
    nodes: tuple[Node, ...], world_from_parent: NDArray[np.float64]
) -> Iterator[tuple[Node, NDArray[np.float64]]]:
    for node in nodes:
        world_from_node = world_from_parent @ node.parent_from_node
        yield node, world_from_node
        yield from _depth_first(node.children, world_from_node)


def _json_bytes(value: Any) -> bytes:
    return (json.dumps(value, indent=1) + "\n").encode()


def _replace(path: Path, content: bytes) -> None:
    beside = path.with_name(path.name + ".part")
    beside.write_bytes(content)
    os.replace(beside, path)
