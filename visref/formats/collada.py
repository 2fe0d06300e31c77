"""COLLADA through pycollada, with its units and up axis applied: metres, +Y up, as glTF.

Why not through trimesh: measured with trimesh 5.2, it applies neither `<unit>` nor
`<up_axis>`, drops instanced nodes and nodes' names, and splits a geometry by its materials.
"""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from visref.errors import InputError
from visref.files import map_file
from visref.findings import Code
from visref.formats.in_a_child import read_in_a_child
from visref.formats.placed import Mesh, Placed, below, compose
from visref.formats.polygons import triangulated
from visref.memory import Budget
from visref.scene import Float64, Int64, check_indices

# y_up_from_axis, by rows: what the new x, y and z are made of (COLLADA 1.4, "up_axis").
_Y_UP = {
    "Y_UP": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "Z_UP": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "X_UP": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
}


def read_collada(path: Path, *, budget: Budget) -> Placed:
    """The objects of a .dae or zipped .zae file: each instance of a geometry.

    Raises InputError where the file cannot be read, or pycollada is not installed.
    """
    return read_in_a_child("visref.formats.collada:parse_collada", path, budget)


def parse_collada(path: Path, budget: Budget) -> Placed:
    """`read_collada`, in this process."""
    try:
        import collada
        from collada.common import DaeBrokenRefError, DaeUnsupportedError
    except ImportError as error:
        raise InputError(
            "reading COLLADA needs pycollada", fix="run: pip install 'visref[collada]'"
        ) from error
    try:
        document = collada.Collada(
            io.BytesIO(_without_comments(_text(path, budget))),
            ignore=[DaeBrokenRefError, DaeUnsupportedError],
        )
    except (InputError, MemoryError, RecursionError):
        raise
    except Exception as error:  # pycollada and its XML parser fail in their own many ways.
        raise InputError(
            f"this is not valid COLLADA: {str(error)[:200]}", fix="export the file anew"
        ) from error
    return _Reader(collada, document, budget).placed


# Comments and processing instructions; CDATA sections, in which neither is one.
_NO_ELEMENT = re.compile(rb"<!\[CDATA\[.*?\]\]>|<!--.*?-->|<\?(?!xml\s).*?\?>", re.DOTALL)


def _without_comments(text: bytes) -> bytes:
    """The same document: pycollada takes a comment for an element that it does not know."""
    return _NO_ELEMENT.sub(lambda found: found[0] if found[0][2:3] == b"[" else b"", text)


def _text(path: Path, budget: Budget) -> bytes:
    if path.suffix.lower() != ".zae":
        return map_file(path).tobytes()
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".dae")]
            if not names:
                raise InputError("the archive has no .dae file", fix="give a .dae file")
            size = archive.getinfo(names[0]).file_size
            budget.need(f"'{names[0][:80]}', unzipped,", size)
            return archive.read(names[0])
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise InputError(
            f"not a zip archive: {str(error)[:200]}", fix="give a .dae file"
        ) from error


class _Reader:
    """Walks the node tree, a geometry read once for each binding of its materials."""

    def __init__(self, collada: Any, document: Any, budget: Budget) -> None:
        self.collada = collada
        self.budget = budget
        self.placed = Placed()
        self.known: dict[tuple[Any, ...], int] = {}
        self.skinned = self.see_through = 0
        if document.scene is None:
            raise InputError("the file has no scene", fix="export the file anew")
        count = self.count(document.scene.nodes)
        budget.claim(f"{count:,} instances of its geometries", objects=count)
        for node in document.scene.nodes:
            self.walk(node, (), _world_from_file(document.assetInfo))
        for error in map(str, document.errors):
            if "eometry" in error:  # pycollada: "Unknown geometry tag", "Geometry … not found"
                raise InputError(f"a geometry is lost: {error[:200]}", fix="export triangles")
        notes = self.placed.notes
        if document.errors:
            notes.append(
                (Code.PARTLY_READ, f"pycollada skipped a part: {str(document.errors[0])[:200]}")
            )
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

    def count(self, roots: list[Any]) -> int:
        """How many nodes the walk meets, each as often as it is named: nodes that name one twice
        double it at every level."""
        met: dict[int, int] = {}
        waiting = [(root, False) for root in roots]
        while waiting:
            node, done = waiting.pop()
            children = self.children(node)
            if done:
                met[id(node)] = 1 + sum(met[id(child)] for child in children)
            elif id(node) not in met:
                met[id(node)] = 1  # until its children are counted: pycollada lets no cycle through
                waiting.append((node, True))
                waiting.extend((child, False) for child in children)
        return sum(met[id(root)] for root in roots)

    def children(self, node: Any) -> list[Any]:
        if not isinstance(node, self.collada.scene.Node):
            return []
        owner = node.node if isinstance(node, self.collada.scene.NodeNode) else node
        return list(owner.children)

    def walk(self, node: Any, names: tuple[str, ...], world_from_parent: Float64) -> None:
        scene = self.collada.scene
        if isinstance(node, scene.GeometryNode):
            self.place(node, node.geometry, names, world_from_parent)
        elif isinstance(node, scene.ControllerNode):
            self.skinned += 1
            controller = node.controller
            bind = np.asarray(getattr(controller, "bind_shape_matrix", np.eye(4)), np.float64)
            geometry = getattr(controller, "geometry", None)
            geometry = geometry or getattr(controller, "source_geometry", None)
            if geometry is not None:
                self.place(node, geometry, names, compose(world_from_parent, bind))
        elif isinstance(node, scene.Node):
            owner = node.node if isinstance(node, scene.NodeNode) else node
            world = world_from_parent
            for transform in owner.transforms:
                world = compose(world, np.asarray(transform.matrix, np.float64))
            for child in owner.children:
                self.walk(child, (*names, owner.name or owner.id or ""), world)

    def place(self, node: Any, geometry: Any, names: tuple[str, ...], world: Float64) -> None:
        effects = {bound.symbol: bound.target.effect for bound in node.materials if bound.target}
        key = (id(geometry), *sorted((symbol, id(effect)) for symbol, effect in effects.items()))
        if key not in self.known:
            self.known[key] = len(self.placed.meshes)
            self.placed.meshes.append(self.mesh(geometry, effects))
        above = [name for name in names[:-1] if name]
        own = (names[-1] if names else "") or geometry.name or geometry.id or ""
        path = ""
        for name in (*above, own):
            path = below(path, name)
        self.placed.add(own or (above[-1] if above else ""), self.known[key], world, path=path)

    def mesh(self, geometry: Any, effects: dict[str, Any]) -> Mesh:
        parts = []
        for primitive in geometry.primitives:
            polygons = isinstance(primitive, self.collada.polylist.Polylist)
            if not polygons and not isinstance(primitive, self.collada.triangleset.TriangleSet):
                continue
            place = f"geometry '{geometry.id}'"
            if polygons and any(child.tag.endswith("}ph") for child in primitive.xmlnode):
                # pycollada passes over a polygon with holes.
                raise InputError("a polygon has holes", place=place, fix="export triangles")
            if primitive.vertex is None or primitive.vertex_index is None:
                continue
            positions = np.asarray(primitive.vertex)
            corners = np.asarray(primitive.vertex_index).reshape(-1).astype(np.int64)
            try:
                check_indices(corners, len(positions), lambda _: "")
            except InputError as error:
                raise error.at(place=place) from error
            if polygons:
                triangles = self.polygons(primitive, positions, corners, place)
            else:
                triangles = corners.reshape(-1, 3)
            effect = effects.get(primitive.material)
            one_sided = not (effect is not None and effect.double_sided)
            self.see_through += effect is not None and _see_through(effect)
            parts.append(Mesh.plain(positions, triangles, one_sided=one_sided))
        return Mesh.joined(parts)

    def polygons(self, primitive: Any, positions: Any, corners: Int64, place: str) -> Int64:
        """(t, 3) vertex ids of the polygons of a <polylist> or <polygons>."""
        counts = np.asarray(primitive.vcounts, np.int64)
        if counts.sum() != len(corners) or (counts < 0).any():
            raise InputError(
                f"its polygons have {counts.sum()} corners, and {len(corners)} are listed",
                place=place,
                fix="export the file anew",
            )
        return triangulated(
            positions, corners, counts, lambda polygon: f"{place}, polygon {polygon}"
        )[0]


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
