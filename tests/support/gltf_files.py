"""Small glTF files for tests, written plainly: a list of buffer views, and what names them."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

COMPONENT = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KIND = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "f4")
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "f4")
TWO = np.array([0, 1, 2, 0, 2, 3], "u2")


class Gltf:
    """A document under construction; `json` may be changed freely before it is written."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
        }
        self.blob = b""

    def view(self, data: bytes, **more: Any) -> int:
        self.blob += b"\0" * (-len(self.blob) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data), **more}
        self.json["bufferViews"].append(entry)
        self.blob += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: Any, **more: Any) -> int:
        array = np.ascontiguousarray(values)
        array = array.reshape(len(array), -1)
        entry = {
            "bufferView": self.view(array.tobytes()),
            "componentType": COMPONENT[array.dtype.str[1:]],
            "count": len(array),
            "type": KIND[array.shape[1]],
            **more,
        }
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def primitive(self, positions: Any, indices: Any = None, **more: Any) -> dict[str, Any]:
        entry: dict[str, Any] = {"attributes": {"POSITION": self.accessor(positions)}}
        if indices is not None:
            entry["indices"] = self.accessor(indices)
        return {**entry, **more}

    def mesh(self, *primitives: dict[str, Any], **more: Any) -> int:
        self.json["meshes"].append({"primitives": list(primitives), **more})
        return len(self.json["meshes"]) - 1

    def node(self, *, root: bool = True, **entry: Any) -> int:
        self.json["nodes"].append(entry)
        index = len(self.json["nodes"]) - 1
        if root:
            self.json["scenes"][0]["nodes"].append(index)
        return index

    def entry(self, kind: str, **value: Any) -> int:
        self.json.setdefault(kind, []).append(value)
        return len(self.json[kind]) - 1

    def glb(self) -> bytes:
        document = {k: v for k, v in self.json.items() if v != []}
        if self.blob:
            document.setdefault("buffers", [{"byteLength": len(self.blob)}])
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        if self.blob:
            blob = self.blob + b"\0" * (-len(self.blob) % 4)
            body += struct.pack("<I4s", len(blob), b"BIN\0") + blob
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def write(self, path: Path) -> Path:
        path.write_bytes(self.glb())
        return path

    def write_gltf(self, path: Path, uri: str | None = None) -> Path:
        """As text, with the bytes in a file named by `uri`, or within."""
        if uri is None:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.blob).decode()
        buffers = [{"byteLength": len(self.blob), "uri": uri}]
        path.write_text(json.dumps({**self.json, "buffers": buffers}))
        return path


def one_triangle() -> Gltf:
    """A file with a single object, 'part'."""
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(gltf.primitive(TRIANGLE, np.arange(3, dtype="u2"))), name="part")
    return gltf
