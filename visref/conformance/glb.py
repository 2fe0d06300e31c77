"""A scene as a GLB file that says exactly it: read back, it has the same vertices, triangles, ids,
names, groups, materials and masks.

Each object is a node at the root, in order, by default under the name that visref gives it
(`house#2`), so that every engine can tell which it means; a group is one node. What an engine with
a glTF loader of its own needs to draw it is there, and nothing else. Where a file cannot say a
scene exactly, that is an InputError and no file.

Source: glTF 2.0, sections 3.6 to 3.11 and 4.4; EXT_mesh_gpu_instancing.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.conformance.png import png_of_alpha
from visref.errors import InputError
from visref.masks.materials import Wrap
from visref.masks.store import CLAMP, MIRROR, REPEAT
from visref.scene import Alpha, Float32, Group, Scene

_FLOAT, _UNSIGNED_INT = 5126, 5125
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_NEAREST, _LINEAR, _MIPMAPS = 9728, 9729, 9987
_WRAP = {REPEAT: Wrap.REPEAT, MIRROR: Wrap.MIRRORED_REPEAT, CLAMP: Wrap.CLAMP_TO_EDGE}
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_INSTANCING = "EXT_mesh_gpu_instancing"


@dataclass(frozen=True, eq=False)
class Growth:
    """How objects change their shape, by morph targets. `moves`: by object id, (k, v, 3) float32,
    what each of k targets adds to each of its vertices, in the scene's order; `weights`: (s, k)
    float32, of each target at seconds 0, 1, … s - 1, and evenly between."""

    moves: Mapping[int, Float32]
    weights: Float32
    clip: str


@dataclass(frozen=True)
class _Look:
    """What a primitive's material hangs on; `mask`: its row in `MaskArrays.materials`, or -1."""

    alpha: Alpha
    one_sided: bool
    mask: int


def glb_of(scene: Scene, growth: Growth | None = None, *, given: bool = False) -> bytes:
    """The GLB file of a scene at rest, the same bytes for the same scene. `given`: objects have
    the names that they were given, which may repeat. Raises InputError where
    no file says it exactly: a mask that cannot be looked up, levels of detail, numbers that
    float32 does not hold, instances that are no translations of each other, no object at all."""
    return _File(scene, growth, scene.given_names if given else scene.names).pack()


@dataclass(eq=False)
class _File:
    scene: Scene
    growth: Growth | None
    names: Sequence[str]
    nodes: list[dict[str, Any]] = field(default_factory=list)
    meshes: list[dict[str, Any]] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    views: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)
    textures: list[dict[str, Any]] = field(default_factory=list)
    samplers: list[dict[str, Any]] = field(default_factory=list)
    animations: list[dict[str, Any]] = field(default_factory=list)
    used: list[str] = field(default_factory=list)
    data: bytearray = field(default_factory=bytearray)
    _looks: dict[_Look, int] = field(default_factory=dict)
    _images: dict[int, int] = field(default_factory=dict)

    def pack(self) -> bytes:
        scene = self.scene
        if not scene.object_count:
            raise self._cannot("it has no object", "")
        groups = {group.objects[0]: group for group in scene.groups}
        inside = {member for group in scene.groups for member in group.objects}
        for index in range(scene.object_count):
            if index in groups:
                self._instances(groups[index])
            elif index not in inside:
                self._node(index, index)
        if self.growth is not None:
            self._animate(self.growth)
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "visref"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self.nodes)))}],
        }
        if self.used:
            document |= {"extensionsUsed": self.used, "extensionsRequired": self.used}
        lists = {
            "nodes": self.nodes, "meshes": self.meshes, "materials": self.materials,
            "textures": self.textures, "samplers": self.samplers, "images": self.images,
            "animations": self.animations, "accessors": self.accessors, "bufferViews": self.views,
        }  # fmt: skip
        document |= {name: entries for name, entries in lists.items() if entries}
        document["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(self.data), b"BIN\0") + bytes(self.data)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def _cannot(self, problem: str, place: str) -> InputError:
        return InputError(
            f"no file can say this scene exactly: {problem}", source=self.scene.source, place=place
        )

    def _place(self, index: int) -> str:
        return f"object '{self.scene.names[index]}'"

    # Objects.

    def _node(self, index: int, mesh_of: int) -> dict[str, Any]:
        entry: dict[str, Any] = {"name": self.names[index]}
        if self.scene.paths[index] != self.scene.given_names[index]:
            raise self._cannot("an object is not at the root", self._place(index))
        if self.scene.origin.any():
            entry["translation"] = self.scene.origin.tolist()
        entry["mesh"] = len(self.meshes)
        self.meshes.append({"primitives": self._primitives(mesh_of)})
        self.nodes.append(entry)
        return entry

    def _instances(self, group: Group) -> None:
        """A group as one node, its objects as translations of the first."""
        scene, first = self.scene, group.objects[0]
        if group.levels or group.objects != tuple(range(first, first + len(group.objects))):
            raise self._cannot("a group is no row of instances", f"group '{group.name}'")
        corners = [self._corners(index) for index in group.objects]
        moves = np.array([own[0] - corners[0][0] for own in corners], np.float32)
        for index, own, move in zip(group.objects, corners, moves, strict=True):
            same = own.shape == corners[0].shape and self._looks_of(index) == self._looks_of(first)
            exact = corners[0].astype(np.float64) + move
            if not same or not np.array_equal(exact, own) or scene.given_names[index] != group.name:
                raise self._cannot("an instance is no moved copy", self._place(index))
        entry = self._node(first, first)
        if _INSTANCING not in self.used:
            self.used.append(_INSTANCING)
        places = self._accessor(moves, None)
        entry["extensions"] = {_INSTANCING: {"attributes": {"TRANSLATION": places}}}

    def _triangles(self, index: int) -> slice:
        return slice(*self.scene.object_offsets[index : index + 2].tolist())

    def _corners(self, index: int) -> Float32:
        """(t * 3, 3) float32, the corners of an object's triangles."""
        found: Float32 = self.scene.vertices[self.scene.triangles[self._triangles(index)]]
        return found.reshape(-1, 3)

    def _looks_of(self, index: int) -> list[_Look]:
        """What each of an object's triangles looks like."""
        scene, part = self.scene, self._triangles(index)
        count = part.stop - part.start
        mask = np.full(count, -1)
        if scene.masks is not None:
            rows = scene.masks.row[part]
            mask[rows >= 0] = scene.masks.arrays.triangles["material"][rows[rows >= 0]]
        columns = zip(scene.alpha[part], scene.one_sided[part], mask, strict=True)
        looks = [_Look(Alpha(a), bool(side), int(m)) for a, side, m in columns]
        if any((look.alpha is Alpha.MASK) != (look.mask >= 0) for look in looks):
            raise self._cannot("an alpha mask cannot be looked up", self._place(index))
        return looks

    def _primitives(self, index: int) -> list[dict[str, Any]]:
        """An object's primitives, one for each run of triangles that look alike."""
        looks, start = self._looks_of(index), self._triangles(index).start
        if not looks:
            # One vertex makes no triangle, and a primitive must have one.
            nothing = self._accessor(np.zeros((1, 3), np.float32), _ARRAY_BUFFER)
            return [{"attributes": {"POSITION": nothing}}]
        ends = [k for k in range(1, len(looks)) if looks[k] != looks[k - 1]]
        return [
            self._primitive(index, np.arange(start + a, start + b), looks[a])
            for a, b in zip([0, *ends], [*ends, len(looks)], strict=True)
        ]

    def _primitive(self, index: int, triangles: NDArray[Any], look: _Look) -> dict[str, Any]:
        faces = self.scene.triangles[triangles]
        attributes: dict[str, int] = {}
        entry: dict[str, Any] = {"attributes": attributes}
        if look.mask >= 0:
            assert self.scene.masks is not None
            # Corners of their own, since coordinates may differ from triangle to triangle.
            kept = faces.reshape(-1)
            indices = np.arange(len(kept))
            rows = self.scene.masks.arrays.triangles[self.scene.masks.row[triangles]]
            uv = self._exact(rows["uv"].reshape(-1, 2), index)
            opacity = self._exact(rows["vertex_alpha"].reshape(-1), index)
        else:
            kept, indices = np.unique(faces, return_inverse=True)
        attributes["POSITION"] = self._accessor(self.scene.vertices[kept], _ARRAY_BUFFER)
        if look.mask >= 0:
            attributes["TEXCOORD_0"] = self._accessor(uv, _ARRAY_BUFFER)
            if (opacity != 1.0).any():
                colours = np.ones((len(opacity), 4), np.float32)
                colours[:, 3] = opacity
                attributes["COLOR_0"] = self._accessor(colours, _ARRAY_BUFFER)
        count = np.asarray(indices.reshape(-1), np.uint32)
        entry["indices"] = self._accessor(count, _ELEMENT_ARRAY_BUFFER)
        entry["material"] = self._material(look)
        if self.growth is not None and index in self.growth.moves:
            # The object's own vertices are in the scene's order.
            rows = kept - int(self.scene.triangles[self._triangles(index)].min())
            entry["targets"] = [
                {"POSITION": self._accessor(moves[rows], _ARRAY_BUFFER)}
                for moves in self.growth.moves[index]
            ]
        return entry

    def _exact(self, values: NDArray[Any], index: int) -> Float32:
        result = values.astype(np.float32)
        if not np.array_equal(result, values):
            raise self._cannot("a mask's coordinates are no float32 numbers", self._place(index))
        return result

    # Materials.

    def _material(self, look: _Look) -> int:
        if look not in self._looks:
            self._looks[look] = len(self.materials)
            surface: dict[str, Any] = {"metallicFactor": 0.0}
            entry: dict[str, Any] = {"pbrMetallicRoughness": surface}
            if not look.one_sided:
                entry["doubleSided"] = True
            if look.alpha is not Alpha.OPAQUE:
                entry["alphaMode"] = look.alpha.name
            if look.alpha is Alpha.BLEND:
                surface["baseColorFactor"] = [1.0, 1.0, 1.0, 0.5]
            if look.mask >= 0:
                self._mask(look.mask, entry, surface)
            self.materials.append(entry)
        return self._looks[look]

    def _mask(self, number: int, entry: dict[str, Any], surface: dict[str, Any]) -> None:
        assert self.scene.masks is not None
        arrays = self.scene.masks.arrays
        material = arrays.materials[number]
        if material["unknown"] or material["texture"] < 0:
            raise self._cannot("an alpha mask has no texture", f"mask {number}")
        entry["alphaCutoff"] = float(material["cutoff"])
        surface["baseColorFactor"] = [1.0, 1.0, 1.0, float(material["factor"])]
        nearest = bool(material["nearest"])
        sampler = {
            "magFilter": _NEAREST if nearest else _LINEAR,
            "minFilter": _NEAREST if nearest else _MIPMAPS,
            "wrapS": int(_WRAP[int(material["wrap_s"])]),
            "wrapT": int(_WRAP[int(material["wrap_t"])]),
        }
        if sampler not in self.samplers:
            self.samplers.append(sampler)
        texture = {
            "source": self._image(int(material["texture"])),
            "sampler": self.samplers.index(sampler),
        }
        if texture not in self.textures:
            self.textures.append(texture)
        surface["baseColorTexture"] = {"index": self.textures.index(texture)}

    def _image(self, number: int) -> int:
        assert self.scene.masks is not None
        if number not in self._images:
            arrays = self.scene.masks.arrays
            of = arrays.textures[number]
            if of["scale"] != 255:
                raise self._cannot("an image has 16 bits a channel", f"image {number}")
            width, height = int(of["width"]), int(of["height"])
            start = int(arrays.levels[int(of["level"])]["least"])
            alpha = arrays.alpha[start : start + width * height].reshape(height, width)
            view = self._view(png_of_alpha(alpha.astype(np.uint8)), None)
            self._images[number] = len(self.images)
            self.images.append({"bufferView": view, "mimeType": "image/png"})
        return self._images[number]

    # Motion.

    def _animate(self, growth: Growth) -> None:
        """The weights of each object's morph targets; a key in every second."""
        seconds = np.arange(len(growth.weights), dtype=np.float32)
        keys = self._accessor(seconds, None, bounded=True)
        sampler = {"input": keys, "output": self._accessor(growth.weights.reshape(-1), None)}
        channels = [
            {"sampler": 0, "target": {"node": self._node_of(index), "path": "weights"}}
            for index in growth.moves
        ]
        self.animations.append({"name": growth.clip, "channels": channels, "samplers": [sampler]})

    def _node_of(self, index: int) -> int:
        if self.scene.groups:
            raise self._cannot("it has groups, and shapes that change", self._place(index))
        return index

    # Bytes.

    def _view(self, data: bytes, target: int | None) -> int:
        entry: dict[str, Any] = {
            "buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)
        }  # fmt: skip
        if target is not None:
            entry["target"] = target
        self.data += data + bytes(-len(data) % 4)
        self.views.append(entry)
        return len(self.views) - 1

    def _accessor(
        self, array: NDArray[Any], target: int | None, *, bounded: bool | None = None
    ) -> int:
        """`bounded`: whether least and greatest are said; by default of positions."""
        kind = "<u4" if array.dtype == np.uint32 else "<f4"
        width = 1 if array.ndim == 1 else array.shape[1]
        entry: dict[str, Any] = {
            "bufferView": self._view(np.ascontiguousarray(array, kind).tobytes(), target),
            "componentType": _UNSIGNED_INT if kind == "<u4" else _FLOAT,
            "count": len(array),
            "type": _KINDS[width],
        }
        if (width == 3 and target is not None) if bounded is None else bounded:
            rows = array.reshape(len(array), width)
            entry |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(entry)
        return len(self.accessors) - 1
