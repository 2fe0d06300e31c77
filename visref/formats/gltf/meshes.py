"""A glTF file's meshes: primitives (section 3.7) and what their materials hide.

A mesh's primitives become one `Mesh`. Strips and fans become triangles; points and lines have
none. Morph targets and skins stand in their rest pose: the file's default weights, the joints
where the nodes put them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.formats.gltf.accessors import MAX_COUNT, UNSIGNED, decode, read_floats, read_raw
from visref.formats.gltf.deform import Deformer, Influences, Part
from visref.formats.gltf.document import Document
from visref.formats.gltf.extensions import MESHOPT
from visref.formats.gltf.masks import MaskReader
from visref.formats.gltf.materials import transmission
from visref.formats.gltf.values import Json
from visref.formats.placed import Mesh, used_vertices
from visref.masks.instances import MeshMasks
from visref.scene import Alpha, Float64, check_indices

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
# A Mesh's vertex is three float64 at most; a triangle three int64 and two bytes; masked, it has
# three float64 texture coordinates of two, and three of alpha.
_VERTEX_BYTES, _TRIANGLE_BYTES, _MASKED_BYTES = 24, 26, 72
# What the decoder allocates: a corner table of six uint32 for a face, beside the face; values of
# up to four attributes for a point.
_DRACO_POINT_BYTES, _DRACO_FACE_BYTES = 64, 48
_DRACO = "KHR_draco_mesh_compression"


def read_mesh(
    document: Document,
    mesh: Json,
    weights: list[float],
    skin: Float64 | None,
    masks: MaskReader,
    deforms: bool = False,
) -> tuple[Mesh, Deformer | None]:
    """One mesh, all its primitives together, and where it `deforms` what is needed to place its
    vertices anew.

    `weights` are its morph targets'; `skin`: (j, 4, 4) float64, world_from_mesh by joint, or
    None where the mesh is rigid. `masks` reads the masked materials. Raises InputError naming
    the place.
    """
    parts = [_Primitive(document, entry, weights, masks) for entry in mesh["primitives"].items()]
    whole = Mesh.joined([part.read(skin) for part in parts])
    return whole, Deformer([part.part() for part in parts]) if deforms else None


def morphs_masks(document: Document, mesh: Json) -> bool:
    """Whether a morph target moves the texture coordinates or colours of a masked primitive."""
    for primitive in mesh["primitives"].items():
        reference, targets = primitive.get("material"), primitive.get("targets")
        if reference is None or targets is None:
            continue
        mode = document.entry("materials", reference).get("alphaMode")
        names = {name for target in targets.items() for name in target.names()}
        looked_up = any(name.startswith(("TEXCOORD_", "COLOR_")) for name in names)
        if mode is not None and mode.value == "MASK" and looked_up:
            return True
    return False


class _Primitive:
    """One primitive, its attributes compressed or not."""

    def __init__(
        self, document: Document, primitive: Json, weights: list[float], masks: MaskReader
    ) -> None:
        self.document = document
        self.weights = weights
        self.masks = masks
        self.json = primitive
        self.drawn: NDArray[Any] | None = None
        self.influences: Influences | None = None
        extensions = primitive.get("extensions")
        for name in MESHOPT:
            if extensions is not None and extensions.get(name) is not None:
                extensions.fail(f"{name} does not belong to a primitive")
        compressed = extensions.get(_DRACO) if extensions is not None else None
        self.draco = _Draco(document, compressed) if compressed is not None else None

    def read(self, skin: Float64 | None) -> Mesh:
        """The primitive's triangles: none where it is made of points or lines."""
        mode = self.json.get("mode")
        kind = _TRIANGLES if mode is None else mode.integer(0, _FAN)
        if kind < _TRIANGLES:
            return Mesh.joined([])
        self.claim(kind)
        positions = self.attribute("POSITION", ("VEC3",))
        if positions is None:
            return Mesh.joined([])  # Section 3.7.2: without positions there is nothing to draw.
        triangles = self.triangles(kind, len(positions))
        positions = self.morphed("POSITION", positions)
        if skin is not None:
            self.influences = self.joints(len(positions), len(skin))
            positions = self.influences.place(positions, skin)
        return self.with_material(positions, triangles)

    def part(self) -> Part:
        """What places the vertices of the Mesh that was read, in its order."""
        positions = None if self.drawn is None else self.attribute("POSITION", ("VEC3",))
        if positions is None or self.drawn is None:
            return Part(np.zeros((0, 3)), [], None)
        rows = used_vertices(len(positions), self.drawn)
        budget, place = self.document.budget, self.json.place
        kept: list[NDArray[Any] | None] = []
        targets = self.json.get("targets")
        for target in targets.items() if targets is not None else []:
            moved = self.displacement(target, "POSITION", positions)
            if moved is not None:
                budget.claim("its morph targets", 3 * moved.itemsize * len(rows), place=place)
                moved = moved[rows]
            kept.append(moved)
        influences = None
        if self.influences is not None:
            size = self.influences.joints.nbytes + self.influences.weights.nbytes
            budget.claim("its joints and weights", size, place=place)
            influences = self.influences.take(rows)
        budget.claim("its vertices once more", 3 * positions.itemsize * len(rows), place=place)
        return Part(positions[rows], kept, influences)

    def claim(self, kind: int) -> None:
        """Claim the Mesh, which many primitives may make of the same few bytes."""
        corners = vertices = 0
        position = self.json["attributes"].get("POSITION")
        if position is not None:
            accessor = self.document.entry("accessors", position)
            corners = vertices = accessor["count"].integer(1, MAX_COUNT)
        indices = self.json.get("indices")
        if indices is not None:
            corners = self.document.entry("accessors", indices)["count"].integer(1, MAX_COUNT)
        if self.draco is not None:
            corners = self.draco.faces.size
        triangles = corners // 3 if kind == _TRIANGLES else corners
        bytes_each = _TRIANGLE_BYTES
        if self.json.get("material") is not None:
            bytes_each += _MASKED_BYTES
        what = f"{vertices:,} vertices and {triangles:,} triangles"
        size = vertices * _VERTEX_BYTES + triangles * _TRIANGLE_BYTES
        self.document.budget.need(what, size + triangles * bytes_each, place=self.json.place)
        self.document.budget.claim(what, size, place=self.json.place)

    def attribute(self, name: str, kinds: tuple[str, ...]) -> NDArray[Any] | None:
        """An attribute's (v, width) values, None where the primitive lacks it."""
        reference = self.json["attributes"].get(name)
        if reference is None:
            return None
        if self.draco is not None and self.draco.has(name):
            normalized = self.document.entry("accessors", reference).get("normalized")
            return decode(
                self.draco.attribute(name),
                normalized=normalized is not None and normalized.flag(),
            )
        return read_floats(self.document, reference, kinds, integers=True)

    def triangles(self, kind: int, vertex_count: int) -> NDArray[Any]:
        """(t, 3) vertex ids, each checked against the number of vertices."""
        indices = self.json.get("indices")
        if self.draco is not None:
            corners = self.draco.faces.reshape(-1)
            kind = _TRIANGLES  # The decoder has taken strips apart.
        elif indices is not None:
            corners = read_raw(self.document, indices, ("SCALAR",), UNSIGNED)[:, 0]
        else:
            corners = np.arange(vertex_count)
        count = max(0, len(corners) - 2)
        first, odd = np.arange(count), np.arange(count) % 2
        if kind == _TRIANGLES:
            # As in OpenGL, one or two vertices left over form no triangle.
            triangles = corners[: len(corners) // 3 * 3].reshape(-1, 3)
        elif kind == _STRIP:
            triangles = corners[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)]
        else:
            triangles = corners[np.stack([first + 1, first + 2, np.zeros_like(first)], axis=1)]
        check_indices(triangles, vertex_count, lambda _: (indices or self.json).place)
        return triangles

    def morphed(self, name: str, values: NDArray[Any]) -> NDArray[Any]:
        """(v, width) of an attribute, moved by the morph targets' weights."""
        targets = self.json.get("targets")
        if targets is None or not any(self.weights):
            return values
        result = values.astype(np.float64)
        for target, weight in zip(targets.items(), self.weights, strict=False):
            moved = None if weight == 0.0 else self.displacement(target, name, values)
            if moved is not None:
                result += np.multiply(moved, weight, dtype=np.float64)
        return result

    def displacement(self, target: Json, name: str, values: NDArray[Any]) -> NDArray[Any] | None:
        """(v, width) that a morph target adds to an attribute's values, None where nothing."""
        reference = target.get(name)
        if reference is None:
            return None
        kind = f"VEC{values.shape[1]}"
        moved = read_floats(self.document, reference, (kind,), integers=True)
        if len(moved) != len(values):
            reference.fail(f"{len(moved)} displacements for {len(values)} vertices")
        return moved

    def joints(self, vertex_count: int, joint_count: int) -> Influences:
        """The joints of each vertex and their weights (section 3.7.3.3)."""
        joints, weights = [], []
        names = self.json["attributes"].names()
        sets = sum(name.startswith("JOINTS_") for name in names)
        # int32 and float64, four of each, and once more while they are put together.
        size = vertex_count * sets * 4 * 12 * 2
        self.document.budget.need("its joints and weights", size, place=self.json.place)
        for number in range(len(names)):
            joint = self.attribute(f"JOINTS_{number}", ("VEC4",))
            weight = self.attribute(f"WEIGHTS_{number}", ("VEC4",))
            if joint is None or weight is None:
                break
            if len(joint) != vertex_count or len(weight) != vertex_count:
                self.json.fail(f"JOINTS_{number} or WEIGHTS_{number} is not one a vertex")
            if not 0 <= joint.min() <= joint.max() < joint_count:
                self.json.fail(f"JOINTS_{number} names a joint outside 0…{joint_count - 1}")
            joints.append(joint.astype(np.int32))
            weights.append(weight.astype(np.float64))
        none = np.zeros((vertex_count, 0))
        influences = Influences(
            np.concatenate(joints or [none.astype(np.int32)], axis=1),
            np.concatenate(weights or [none], axis=1),
        )
        if not (influences.totals() > 0.0).all():
            self.json.fail("a vertex of a skinned mesh has no weight")
        return influences

    def with_material(self, positions: NDArray[Any], triangles: NDArray[Any]) -> Mesh:
        """The Mesh, without the triangles that a constant alpha below the cutoff hides."""
        self.drawn = triangles
        reference = self.json.get("material")
        if reference is None:
            return Mesh.plain(positions, triangles)
        material = self.document.entry("materials", reference)
        double = material.get("doubleSided")
        one_sided = not (double is not None and double.flag())
        named = material.get("alphaMode")
        mode = named.text() if named is not None else "OPAQUE"
        if mode not in Alpha.__members__:
            material["alphaMode"].fail(f"'{mode}' is not OPAQUE, MASK or BLEND")
        glass, _ = transmission(material)
        # Through a mask's holes as through what is left of it, one sees what is behind the glass.
        if mode != "MASK" or (glass and _textured(material)):
            alpha = Alpha.BLEND if glass else Alpha[mode]
            return Mesh.plain(positions, triangles, one_sided=one_sided, alpha=alpha)
        mesh = self.masked(reference, positions, triangles, one_sided)
        if glass:
            mesh.alpha[:] = Alpha.BLEND
            mesh = replace(mesh, masks=None)
        return mesh

    def masked(
        self, reference: Json, positions: NDArray[Any], triangles: NDArray[Any], one_sided: bool
    ) -> Mesh:
        """The Mesh of a masked material, without the triangles that are a hole all over; those
        that are solid all over are opaque, the others are looked up."""
        material = self.masks.material(reference)
        cutoff, uniform = material.cutoff, material.uniform
        alpha = self.vertex_alpha(len(positions))[triangles]
        # Alpha is interpolated between the corners, and a texture only lowers it.
        greatest = 1.0 if uniform is None else uniform
        high = greatest * material.factor * alpha.max(axis=1)
        # Not `>=`: what is no number decides nothing.
        kept = ~(high < cutoff) | (cutoff <= 0.0)
        self.drawn = triangles = triangles[kept]
        alpha = alpha[kept]
        mesh = Mesh.plain(positions, triangles, one_sided=one_sided, alpha=Alpha.MASK)
        if cutoff <= 0.0:
            solid = np.ones(len(triangles), np.bool_)
        elif uniform is not None:
            solid = uniform * material.factor * alpha.min(axis=1) >= cutoff
        else:
            solid = np.zeros(len(triangles), np.bool_)
        mesh.alpha[solid] = Alpha.OPAQUE
        if solid.all():
            if material.texture is None and not material.unknown:
                self.masks.is_constant(material)
            return mesh
        uv, without = None, ""
        if material.texture is not None and uniform is None:
            name = f"TEXCOORD_{material.texture.coordinates}"
            uv = self.attribute(name, ("VEC2",))
            without = f"a primitive has no {name}" if uv is None else ""
        if uv is None or material.texture is None:
            corners = np.zeros((*triangles.shape, 2))
        else:
            if len(uv) != len(positions):
                self.json.fail(f"{name} has {len(uv)} values for {len(positions)} vertices")
            corners = material.texture.transform.apply(self.morphed(name, uv))[triangles]
        index = self.masks.add(material, without)
        return replace(mesh, masks=MeshMasks.of(~solid, index, corners, alpha))

    def vertex_alpha(self, vertex_count: int) -> Float64:
        """(v,) float64, COLOR_0's alpha, which glTF clamps to 0…1; 1 without one."""
        color = self.attribute("COLOR_0", ("VEC3", "VEC4"))
        if color is None or color.shape[1] == 3:
            return np.ones(vertex_count)
        if len(color) != vertex_count:
            self.json.fail(f"COLOR_0 has {len(color)} values for {vertex_count} vertices")
        alpha = self.morphed("COLOR_0", color)[:, 3].astype(np.float64)
        result: Float64 = np.clip(alpha, 0.0, 1.0)
        return result


class _Draco:
    """A primitive's attributes and faces, decoded by DracoPy."""

    def __init__(self, document: Document, extension: Json) -> None:
        try:
            import DracoPy
        except ImportError as error:
            raise InputError(
                "its geometry is compressed with Draco, and DracoPy is not installed",
                place=extension.place,
                fix="run: pip install DracoPy",
            ) from error
        data, _ = document.view(extension["bufferView"])
        points, faces = draco_counts(data[:64].tobytes())
        document.budget.need(
            f"{points:,} vertices and {faces:,} triangles, compressed with Draco,",
            points * _DRACO_POINT_BYTES + faces * _DRACO_FACE_BYTES,
            place=extension.place,
        )
        try:
            self.mesh = DracoPy.decode(data.tobytes())
            self.faces: NDArray[Any] = np.asarray(self.mesh.faces)
        except Exception as error:  # The decoder's own kinds of failure are its secret.
            raise InputError(
                f"the Draco decoder refused the data: {error}",
                place=extension.place,
                fix="export the file anew",
            ) from error
        attributes = extension["attributes"]
        self.ids: Mapping[str, Json] = {name: attributes[name] for name in attributes.names()}

    def has(self, name: str) -> bool:
        return name in self.ids

    def attribute(self, name: str) -> NDArray[Any]:
        wanted = self.ids[name].integer()
        found = [a for a in self.mesh.attributes if a["unique_id"] == wanted]
        if not found:
            self.ids[name].fail(f"the compressed data has no attribute {wanted}")
        return np.asarray(found[0]["data"]).reshape(-1, found[0]["num_components"])


def draco_counts(data: bytes) -> tuple[int, int]:
    """The vertices and faces that compressed data announce, 0 where they do not say so up front.

    Source: Draco bitstream specification, version 2.2, "Header" and "Connectivity".
    """
    if len(data) < 12 or data[:5] != b"DRACO" or data[10] & 0x80:
        return 0, 0
    at = 11 + (data[8] == 1)  # an edgebreaker's kind of traversal stands first
    values = []
    for _ in range(2):
        value = shift = 0
        while at < len(data):
            value |= (data[at] & 0x7F) << shift
            at, shift = at + 1, shift + 7
            if data[at - 1] < 0x80:
                break
        values.append(value)
    points, faces = values if data[8] == 1 else values[::-1]
    return points, faces


def _textured(material: Json) -> bool:
    """Whether a texture multiplies the material's alpha."""
    for owner, name in (
        (material.extension("KHR_materials_pbrSpecularGlossiness"), "diffuseTexture"),
        (material.get("pbrMetallicRoughness"), "baseColorTexture"),
    ):
        if owner is not None:
            return owner.get(name) is not None
    return False
