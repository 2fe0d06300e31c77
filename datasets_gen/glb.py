"""A binary glTF 2.0 writer: geometry and instances, the same bytes for the same nodes.

Only what the project's scenes need: positions, indices, base colours, sides, alpha and its
textures. A mesh is stored once however many nodes show it, an array once however many
primitives use it, and a texture once however many materials.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.scene import Alpha
from visref_datasets_gen.graph import AlphaTexture, Material, Mesh, Node, Primitive
from visref_datasets_gen.png import png_bytes

_FLOAT, _UNSIGNED_INT = 5126, 5125
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_POINTS = 0
# Filtered with mipmaps, as leaves are drawn, and without the far edge's texels at the near one.
_SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}


def glb_bytes(nodes: tuple[Node, ...]) -> bytes:
    """The GLB file that holds `nodes`, in their order."""
    document = GlbDocument()
    roots = [document.node(node) for node in nodes]
    return document.pack(roots)


class GlbDocument:
    """Collects the parts of one file; ids are handed out in the order of first use.

    `more`: top-level properties besides those of a still scene.
    """

    def __init__(self) -> None:
        self.nodes: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self.chunks: list[bytes] = []
        self.size = 0
        self._mesh_ids: dict[int, int] = {}
        self._material_ids: dict[Material, int] = {}
        self._accessor_ids: dict[tuple[int, int], int] = {}
        self.images: list[dict[str, Any]] = []
        self._texture_ids: dict[AlphaTexture, int] = {}
        self.more: dict[str, Any] = {}

    def node(self, node: Node) -> int:
        index = len(self.nodes)
        entry: dict[str, Any] = {"name": node.name} if node.name else {}
        self.nodes.append(entry)
        matrix = np.asarray(node.parent_from_node, np.float64)
        if np.array_equal(matrix[:3, :3], np.eye(3)):
            if matrix[:3, 3].any():
                entry["translation"] = _short(matrix[:3, 3])
        else:
            entry["matrix"] = _short(matrix.T.reshape(-1))
        if node.mesh is not None:
            entry["mesh"] = self.mesh(node.mesh)
        if node.children:
            entry["children"] = [self.node(child) for child in node.children]
        return index

    def mesh(self, mesh: Mesh) -> int:
        if id(mesh) not in self._mesh_ids:
            self._mesh_ids[id(mesh)] = len(self.meshes)
            primitives = [self.primitive(primitive) for primitive in mesh.primitives]
            self.meshes.append({"name": mesh.name, "primitives": primitives})
        return self._mesh_ids[id(mesh)]

    def primitive(self, primitive: Primitive) -> dict[str, Any]:
        entry: dict[str, Any] = {
            "attributes": {"POSITION": self.accessor(primitive.vertices, _ARRAY_BUFFER)},
            "material": self._material(primitive.material),
        }
        if primitive.uv is not None:
            entry["attributes"]["TEXCOORD_0"] = self.accessor(primitive.uv, _ARRAY_BUFFER)
        if len(primitive.triangles):
            entry["indices"] = self.accessor(primitive.triangles, _ELEMENT_ARRAY_BUFFER)
        else:
            # glTF has no empty primitive; points are an object without triangles.
            entry["mode"] = _POINTS
        return entry

    def _material(self, material: Material) -> int:
        if material not in self._material_ids:
            self._material_ids[material] = len(self.materials)
            entry: dict[str, Any] = {
                "name": material.name,
                "pbrMetallicRoughness": {
                    "baseColorFactor": list(material.colour),
                    "metallicFactor": 0.0,
                    "roughnessFactor": 0.9,
                },
            }
            if material.texture is not None:
                texture = {"index": self._texture(material.texture)}
                entry["pbrMetallicRoughness"]["baseColorTexture"] = texture
            if material.double_sided:
                entry["doubleSided"] = True
            if material.alpha is not Alpha.OPAQUE:
                entry["alphaMode"] = material.alpha.name
            self.materials.append(entry)
        return self._material_ids[material]

    def _texture(self, texture: AlphaTexture) -> int:
        """A texture's id, which is its image's too."""
        if texture not in self._texture_ids:
            self._texture_ids[texture] = len(self.images)
            view = self.view(png_bytes(texture.alpha))
            self.images.append({"bufferView": view, "mimeType": "image/png"})
        return self._texture_ids[texture]

    def view(self, data: bytes, **more: Any) -> int:
        """A buffer view's id; the next one starts at a multiple of 4 bytes."""
        entry = {"buffer": 0, "byteOffset": self.size, "byteLength": len(data), **more}
        self.views.append(entry)
        self.chunks.append(data + bytes(-len(data) % 4))
        self.size += len(self.chunks[-1])
        return len(self.views) - 1

    def accessor(self, array: NDArray[Any], target: int) -> int:
        key = (id(array), target)
        if key in self._accessor_ids:
            return self._accessor_ids[key]
        entry: dict[str, Any] = {}
        if target == _ARRAY_BUFFER:
            data = np.ascontiguousarray(array, "<f4")
            width = data.shape[1]
            entry |= {"componentType": _FLOAT, "count": len(data), "type": f"VEC{width}"}
            finite = data[np.isfinite(data).all(axis=1)]
            if width == 3 and len(finite):
                entry |= {"min": finite.min(axis=0).tolist(), "max": finite.max(axis=0).tolist()}
        else:
            data = np.ascontiguousarray(array, "<u4")
            entry |= {"componentType": _UNSIGNED_INT, "count": data.size, "type": "SCALAR"}
        view = self.view(data.tobytes(), target=target)
        self.accessors.append({"bufferView": view, **entry})
        self._accessor_ids[key] = len(self.accessors) - 1
        return self._accessor_ids[key]

    def pack(self, roots: list[int]) -> bytes:
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "visref datasets_gen"},
            "scene": 0,
            "scenes": [{"nodes": roots} if roots else {}],
        }
        lists = {
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "images": self.images,
        }
        document |= {name: entries for name, entries in lists.items() if entries}
        if self.images:
            document["samplers"] = [_SAMPLER]
            document["textures"] = [{"source": k, "sampler": 0} for k in range(len(self.images))]
        document |= self.more
        if self.size:
            document["buffers"] = [{"byteLength": self.size}]
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        parts = [struct.pack("<I4s", len(text), b"JSON"), text]
        if self.size:
            parts += [struct.pack("<I4s", self.size, b"BIN\0"), *self.chunks]
        body = b"".join(parts)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _short(values: NDArray[np.float64]) -> list[float | int]:
    """Whole numbers without a decimal point: a large city is mostly matrices."""
    return [int(v) if v == int(v) else float(v) for v in values.tolist()]
