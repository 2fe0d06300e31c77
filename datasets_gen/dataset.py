"""What a generator returns: a small scene graph and a camera path, and the two ways out of it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.files import replacing_file
from visref.masks.instances import MaskRows, MaskTable, MeshMasks
from visref.masks.materials import MaskMaterial, Sampler, Wrap
from visref.masks.store import Masks
from visref.masks.textures import AlphaImage
from visref.placing import origin_of, placed_boxes, rounded
from visref.scene import Float64, Scene, unique_names
from visref_datasets_gen.glb import glb_bytes
from visref_datasets_gen.graph import AlphaTexture, Mesh, Node, Primitive

_CLAMPED = Sampler(Wrap.CLAMP_TO_EDGE, Wrap.CLAMP_TO_EDGE)


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
        files = {scene_file: glb_bytes(self.nodes), path_file: json_bytes(self.path.to_json())}
        if self.expected is not None:
            files[directory / f"{self.name}.expected.json"] = json_bytes(self.expected)
        write_files(directory, files)
        return scene_file, path_file

    def resized(self, width: int, height: int) -> Dataset:
        """The same with images of another size. Raises InputError where it says what is seen."""
        if self.expected is not None:
            raise InputError(
                f"'{self.name}' has a verdict for its own image size",
                fix="leave out --width and --height",
            )
        return replace(self, path=self.path.resized(width, height))


def scene_of(dataset: Dataset, *, cull_backfaces: bool = False) -> Scene:
    """The scene that loading the data set's GLB gives, without the file.

    `cull_backfaces`: triangles whose material is not double-sided become one-sided. Raises
    InputError as loading does (a vertex that is not finite).
    """
    vertices = [np.zeros((0, 3))]
    placed: list[tuple[NDArray[Any], Float64]] = []
    triangles = [np.zeros((0, 3), np.int64)]
    one_sided = [np.zeros(0, np.bool_)]
    alpha = [np.zeros(0, np.uint8)]
    names: list[str] = []
    offsets = [0]
    base = 0
    shown: list[tuple[Mesh, bool]] = []
    for node, above, world_from_mesh in _depth_first(dataset.nodes, "", np.eye(4)):
        if node.mesh is None:
            continue
        names.append(node.name or node.mesh.name or above or "object")
        mirrored = bool(np.linalg.det(world_from_mesh[:3, :3]) < 0.0)
        shown.append((node.mesh, mirrored))
        parts = [p.vertices for p in node.mesh.primitives if len(p.triangles)]
        if parts:
            placed.append((np.concatenate(parts), world_from_mesh[None]))
        count = 0
        for primitive in node.mesh.primitives:
            faces = primitive.triangles.astype(np.int64) + base
            if not len(faces):
                continue
            vertices.append(_transformed(world_from_mesh, primitive.vertices))
            triangles.append(faces[:, ::-1] if mirrored else faces)
            one_sided.append(
                np.full(len(faces), cull_backfaces and not primitive.material.double_sided)
            )
            alpha.append(np.full(len(faces), int(primitive.material.alpha), np.uint8))
            base += len(primitive.vertices)
            count += len(faces)
        offsets.append(offsets[-1] + count)
    origin = origin_of(placed_boxes(placed))
    held, moved = rounded(np.concatenate(vertices) - origin)
    return Scene(
        vertices=held,
        triangles=np.concatenate(triangles).astype(np.int32),
        object_offsets=np.array(offsets, np.int64),
        names=unique_names(names),
        one_sided=np.concatenate(one_sided),
        alpha=np.concatenate(alpha),
        source=f"{dataset.name}.glb",
        masks=_masks(shown, offsets),
        origin=origin,
        moved=moved if moved.any() else None,
    )


def _masks(shown: list[tuple[Mesh, bool]], offsets: list[int]) -> Masks | None:
    """Of objects: each one's mesh, whether it is mirrored, and where its triangles start."""
    table, rows = MaskTable(), MaskRows(offsets[-1])
    images: dict[AlphaTexture, int] = {}
    users: dict[Mesh, list[int]] = {}
    for number, (mesh, _) in enumerate(shown):
        users.setdefault(mesh, []).append(number)
    for mesh, numbers in users.items():
        parts = [(len(part.triangles), _masked(part, table, images)) for part in mesh.primitives]
        masks = MeshMasks.joined(parts)
        if masks is None:
            continue
        starts = np.array([offsets[number] for number in numbers])
        bases = rows.add(masks, np.array([shown[number][1] for number in numbers]))
        rows.fill(starts[:, None] + np.arange(len(masks.row)), masks, bases)
    return rows.masks(table)


def _masked(part: Primitive, table: MaskTable, images: dict[AlphaTexture, int]) -> MeshMasks | None:
    texture, uv = part.material.texture, part.uv
    if texture is None or uv is None or not len(part.triangles):
        return None
    if texture not in images:
        images[texture] = table.add_image(AlphaImage(texture.alpha, 255))
    material = MaskMaterial(images[texture], _CLAMPED, float(part.material.colour[3]))
    everywhere = np.ones(len(part.triangles), np.bool_)
    corners = uv[part.triangles].astype(np.float64)
    index = table.index_of(material)
    return MeshMasks.of(everywhere, index, corners, np.ones((len(part.triangles), 3)))


def _transformed(matrix: Float64, points: NDArray[np.float32]) -> Float64:
    """Points under an affine matrix, in float64 and in this order."""
    x, y, z = points.astype(np.float64).T
    # What is not finite stays so, and is refused as a whole.
    with np.errstate(invalid="ignore", over="ignore"):
        rows = [row[0] * x + row[1] * y + row[2] * z + row[3] for row in matrix[:3]]
        return np.stack(rows, axis=1)


def _depth_first(
    nodes: tuple[Node, ...], above: str, world_from_parent: Float64
) -> Iterator[tuple[Node, str, Float64]]:
    """Each node, the name of its nearest named ancestor, and its transform."""
    for node in nodes:
        world_from_node = _product(world_from_parent, node.parent_from_node)
        yield node, above, world_from_node
        yield from _depth_first(node.children, node.name or above, world_from_node)


def _product(a: Float64, b: Float64) -> Float64:
    """`a @ b`, with every sum in the same order on every machine."""
    result: Float64 = a[:, 0, None] * b[0]
    for k in range(1, 4):
        result = result + a[:, k, None] * b[k]
    return result


def json_bytes(value: Any) -> bytes:
    """A JSON value as a file holds it, innermost lists on a line each."""
    text = json.dumps(value, indent=1)
    # Innermost lists (a matrix's row, a span of pixels) on one line. No string holds a newline.
    text = re.sub(r"\[\n\s*([^][{}]*?)\s*\]", lambda row: f"[{_one_line(row[1])}]", text)
    return (text + "\n").encode()


def _one_line(text: str) -> str:
    return re.sub(r"\s*\n\s*", " ", text)


def write_files(directory: Path, files: Mapping[Path, bytes]) -> None:
    """Write files into a directory, in their order; each beside its name, then renamed. Raises
    InputError where the directory cannot be written."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for path, content in files.items():
            with replacing_file(path) as beside:
                beside.write_bytes(content)
    except OSError as error:
        raise InputError(
            f"cannot write: {error.strerror}",
            source=str(error.filename or directory),
            fix="give a directory that can be written",
        ) from error
