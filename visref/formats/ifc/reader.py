"""The products of an IFC file, as its spatial structure holds them, depth-first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.util.unit
import numpy as np

from visref.errors import InputError
from visref.findings import Code
from visref.formats.placed import NO_MESH, Mesh, Placed, below, compose
from visref.memory import Budget
from visref.scene import Alpha, Float64, Group, check_indices
from visref.wording import counted

# +Z is up in IFC; by rows, what the new x, y and z are made of.
_Y_UP = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
# A vertex is three float64, here and in the library; a triangle three int32 there, int64 here.
_VERTEX_BYTES, _TRIANGLE_BYTES = 48, 40
# What no renderer shows: voids that the library cuts out, and what has no surface.
_NO_SURFACE = ("IfcFeatureElementSubtraction", "IfcAnnotation", "IfcGrid", "IfcPort")
_SURFACES = ("Body", "Body-FallBack", "Facetation", "Mesh", "Surface", "Tessellation")
_SPACES = ("IfcSpace", "IfcSpatialZone")


def parse_ifc(path: Path, budget: Budget) -> Placed:
    """`visref.formats.ifc.read_ifc`, in this process."""
    try:
        file = ifcopenshell.open(str(path.absolute()))
        return _Reader(file, budget).placed()
    except (InputError, MemoryError, RecursionError):
        raise
    except Exception as error:  # The library fails in its own many ways.
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"this is not valid IFC: {said}", fix="export the file anew") from error


@dataclass(frozen=True)
class _Shape:
    """A product's mesh, by number, and (4, 4) float64, world_from_object, +Z up."""

    mesh: int
    world: Float64


@dataclass
class _Reader:
    file: Any
    budget: Budget
    meshes: list[Mesh] = field(default_factory=list)
    _known: dict[tuple[Any, ...], int] = field(default_factory=dict)

    def placed(self) -> Placed:
        """The objects, and what was found."""
        products = list(self.structure())
        spaces = [product for product, _ in products if _is_any(product, _SPACES)]
        self.budget.claim(f"{len(products):,} products", objects=len(products))
        shapes = self.shapes([product for product, _ in products if not _drawn(product)])
        placed, failed = Placed(meshes=self.meshes), []
        for product, path in products:
            if not _drawn(product):
                continue
            shape = shapes.get(int(product.id()), _Shape(NO_MESH, np.eye(4)))
            own, name = _text(product.GlobalId), _text(product.Name)
            placed.add(name or own, shape.mesh, compose(_Y_UP, shape.world), path=path)
            if shape.mesh == NO_MESH and _has_body(product):
                failed.append(name or own)
            if own and name:
                number = len(placed.names) - 1
                placed.groups.append(Group(own, own, (number,)))
        scale = float(ifcopenshell.util.unit.calculate_unit_scale(self.file))
        if not 0.0 < scale < np.inf:
            raise InputError(f"the unit is {scale} metres", fix="give a positive length")
        placed.notes.append(
            (
                Code.UNITS_CONVERTED,
                f"from units of {scale:g} metres, +Z up, to metres, +Y up",
            )
        )
        if spaces:
            what = counted(len(spaces), "space")
            first = _text(spaces[0].Name) or _text(spaces[0].GlobalId)
            placed.notes.append((Code.PARTLY_READ, f"{what} left out, first {first[:200]!a}"))
        if failed:
            has = "product has" if len(failed) == 1 else "products have"
            first = f"{failed[0][:200]!a}"
            text = f"ifcopenshell cannot make all shapes: {len(failed):,} {has} none, first {first}"
            placed.notes.append((Code.PARTLY_READ, text))
        return placed

    def structure(self) -> Iterator[tuple[Any, str]]:
        """Every product and its path, below what it is a part of, or contained in; those that
        nothing holds come last."""
        seen: set[int] = set()
        waiting = [(root, "") for root in reversed(self.file.by_type("IfcProject"))]
        others = sorted(self.file.by_type("IfcProduct"), key=lambda product: int(product.id()))
        while waiting or others:
            item, above = waiting.pop() if waiting else (others.pop(0), "")
            if int(item.id()) in seen:
                continue
            seen.add(int(item.id()))
            path = below(above, _text(item.Name) or _text(item.GlobalId))
            if item.is_a("IfcProduct"):
                yield item, path
            waiting.extend((child, path) for child in reversed(_children(item)))

    def shapes(self, left_out: list[Any]) -> dict[int, _Shape]:
        """The shapes of all products, by their number in the file."""
        result: dict[int, _Shape] = {}
        settings = ifcopenshell.geom.settings()
        every = ifcopenshell.geom.iterator(settings, self.file, 1, exclude=left_out or None)
        more = every.initialize()
        while more:
            shape = every.get()
            flat = np.array(shape.transformation.matrix, np.float64)
            result[int(shape.id)] = _Shape(self.mesh(shape.geometry), flat.reshape(4, 4).T)
            more = every.next()
        return result

    def mesh(self, geometry: Any) -> int:
        """The number of a mesh, which is read once for all that have the same geometry."""
        alphas = [_alpha(material) for material in geometry.materials]
        key = (str(geometry.id), *alphas)
        if key not in self._known:
            positions = np.frombuffer(geometry.verts_buffer, np.float64).reshape(-1, 3)
            triangles = np.frombuffer(geometry.faces_buffer, np.int32).reshape(-1, 3)
            size = len(positions) * _VERTEX_BYTES + len(triangles) * _TRIANGLE_BYTES
            self.budget.claim(f"{len(triangles):,} triangles of a shape", size)
            check_indices(triangles, len(positions), lambda bad: f"triangle {bad}")
            of_triangle = np.frombuffer(geometry.material_ids_buffer, np.int32)
            # What has no style is opaque, and -1 there.
            table = np.array([*alphas, Alpha.OPAQUE], np.uint8)
            plain = Mesh.plain(positions.copy(), triangles.copy(), one_sided=False)
            alpha = table[np.where(of_triangle < len(alphas), of_triangle, -1)]
            self._known[key] = len(self.meshes)
            self.meshes.append(Mesh(plain.positions, plain.triangles, plain.one_sided, alpha))
        return self._known[key]


def _children(item: Any) -> list[Any]:
    """What an object is made of, nests and contains, in the file's order."""
    found: list[Any] = []
    for relations, related in (
        ("IsDecomposedBy", "RelatedObjects"),
        ("IsNestedBy", "RelatedObjects"),
        ("ContainsElements", "RelatedElements"),
    ):
        for relation in sorted(getattr(item, relations, None) or (), key=lambda r: int(r.id())):
            found.extend(getattr(relation, related, None) or ())
    return found


def _drawn(product: Any) -> bool:
    """Whether a product is an object: it has a shape, and is neither a space nor a void."""
    return bool(product.Representation) and not _is_any(product, (*_SPACES, *_NO_SURFACE))


def _has_body(product: Any) -> bool:
    """Whether a product's shape says that it has surfaces, not only lines."""
    for shape in getattr(product.Representation, "Representations", None) or ():
        named, kind = _text(shape.RepresentationIdentifier), _text(shape.RepresentationType)
        if named in _SURFACES and "Curve" not in kind:
            return True
    return False


def _is_any(product: Any, kinds: tuple[str, ...]) -> bool:
    return any(product.is_a(kind) for kind in kinds)


def _alpha(material: Any) -> int:
    """Glass where a surface style is transparent at all."""
    clear = bool(material.has_transparency()) and float(material.transparency) > 0.0
    return int(Alpha.BLEND if clear else Alpha.OPAQUE)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""
