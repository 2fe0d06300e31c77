"""COLLADA through pycollada, with its units and up axis applied: metres, +Y up, as glTF.

Why not through trimesh: measured with trimesh 5.2, it applies neither `<unit>` nor
`<up_axis>`, drops instanced nodes and nodes' names, and splits a geometry by its materials.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from visref.errors import InputError
from visref.findings import Code
from visref.formats.placed import Mesh, Placed, compose
from visref.scene import Float64, check_vertices

# y_up_from_axis, by rows: what the new x, y and z are made of (COLLADA 1.4, "up_axis").
_Y_UP = {
    "Y_UP": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "Z_UP": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "X_UP": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
}


def read_collada(path: Path) -> Placed:
    """The objects of a .dae or zipped .zae file: each instance of a geometry.

    Raises InputError where the file cannot be read, or pycollada is not installed.
    """
    try:
        import collada
        from collada.common import DaeBrokenRefError, DaeUnsupportedError
    except ImportError as error:
        raise InputError(
            "reading COLLADA needs pycollada", fix="run: pip install 'visref[collada]'"
        ) from error
    try:
        document = collada.Collada(
            io.BytesIO(_text(path)), ignore=[DaeBrokenRefError, DaeUnsupportedError]
        )
    except InputError:
        raise
    except Exception as error:  # pycollada and its XML parser fail in their own many ways.
        raise InputError(
            f"this is not valid COLLADA: {error}", fix="export the file anew"
        ) from error
    return _Reader(collada, document).placed


def _text(path: Path) -> bytes:
    if path.suffix.lower() != ".zae":
        return path.read_bytes()
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".dae")]
            if not names:
                raise InputError("the archive has no .dae file", fix="give a .dae file")
            return archive.read(names[0])
    except zipfile.BadZipFile as error:
        raise InputError(f"not a zip archive: {error}", fix="give a .dae file") from error


class _Reader:
    """Walks the node tree, a geometry read once for each binding of its materials."""

    def __init__(self, collada: Any, document: Any) -> None:
        self.collada = collada
        self.placed = Placed()
        self.known: dict[tuple[Any, ...], int] = {}
        self.skinned = self.see_through = 0
        if document.scene is None:
            raise InputError("the file has no scene", fix="export the file anew")
        for node in document.scene.nodes:
            self.walk(node, "", _world_from_file(document.assetInfo))
        for error in map(str, document.errors):
            if "eometry" in error:  # pycollada: "Unknown geometry tag", "Geometry … not found"
                raise InputError(f"a geometry is lost: {error}", fix="export triangles")
        notes = self.placed.notes
        if document.errors:
            notes.append((Code.PARTLY_READ, f"pycollada skipped a part: {document.errors[0]}"))
        if self.skinned:
            notes.append(
                (Code.PARTLY_READ, f"{self.skinned} skinned or morphed meshes stand as bound")
            )
        if self.see_through:
            notes.append(
                (Code.PARTLY_READ, f"{self.see_through} transparent materials count as opaque")
            )
        if len(document.animations):
            notes.append(
                (Code.ANIMATION_IGNORED, f"{len(document.animations)} animations are not played")
            )

    def walk(self, node: Any, name: str, world_from_parent: Float64) -> None:
        scene = self.collada.scene
        if isinstance(node, scene.GeometryNode):
            self.place(node, node.geometry, name, world_from_parent)
        elif isinstance(node, scene.ControllerNode):
            self.skinned += 1
            controller = node.controller
            bind = np.asarray(getattr(controller, "bind_shape_matrix", np.eye(4)), np.float64)
            geometry = getattr(controller, "geometry", None)
            geometry = geometry or getattr(controller, "source_geometry", None)
            if geometry is not None:
                self.place(node, geometry, name, compose(world_from_parent, bind))
        elif isinstance(node, scene.Node):
            owner = node.node if isinstance(node, scene.NodeNode) else node
            world = world_from_parent
            for transform in owner.transforms:
                world = compose(world, np.asarray(transform.matrix, np.float64))
            for child in owner.children:
                self.walk(child, owner.name or owner.id or "", world)

    def place(self, node: Any, geometry: Any, name: str, world: Float64) -> None:
        effects = {bound.symbol: bound.target.effect for bound in node.materials if bound.target}
        key = (id(geometry), *sorted((symbol, id(effect)) for symbol, effect in effects.items()))
        if key not in self.known:
            self.known[key] = len(self.placed.meshes)
            self.placed.meshes.append(self.mesh(geometry, effects))
        self.placed.add(name or geometry.name or geometry.id or "", self.known[key], world)

    def mesh(self, geometry: Any, effects: dict[str, Any]) -> Mesh:
        parts = []
        for primitive in geometry.primitives:
            if isinstance(primitive, self.collada.polylist.Polylist):
                primitive = primitive.triangleset()
            if not isinstance(primitive, self.collada.triangleset.TriangleSet):
                continue
            if primitive.vertex is None or primitive.vertex_index is None:
                continue
            positions = np.asarray(primitive.vertex)
            triangles = np.asarray(primitive.vertex_index).reshape(-1, 3)
            check_vertices(triangles, len(positions), lambda _: f"geometry '{geometry.id}'")
            effect = effects.get(primitive.material)
            one_sided = not (effect is not None and effect.double_sided)
            self.see_through += effect is not None and _see_through(effect)
            parts.append(Mesh.plain(positions, triangles, one_sided=one_sided))
        return Mesh.joined(parts)


def _see_through(effect: Any) -> bool:
    """Whether the effect asks for transparency at all; writers disagree what its values mean."""
    for value in (effect.transparent, effect.transparency):
        if value is None:
            continue
        if not np.isscalar(value) and not isinstance(value, tuple):
            return True  # a texture
    opacity = effect.transparency
    return isinstance(opacity, float) and 0.0 < opacity < 1.0


def _world_from_file(asset: Any) -> Float64:
    """Metres and +Y up, from the file's unit and up axis."""
    metres = 1.0 if asset.unitmeter is None else float(asset.unitmeter)
    if not 0.0 < metres < np.inf:
        raise InputError(
            f"the unit is {metres} metres", place="asset.unit", fix="give a positive length"
        )
    result = np.eye(4)
    result[:3, :3] = metres * np.array(_Y_UP[asset.upaxis or "Y_UP"], np.float64)
    return result
