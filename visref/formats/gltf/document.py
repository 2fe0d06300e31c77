"""A glTF file's JSON and bytes: the container, the buffers, and which extensions matter."""

from __future__ import annotations

import base64
import binascii
import re
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from visref.errors import InputError
from visref.files import Bytes, json_bytes, map_file, named_beside, parse_json
from visref.formats.gltf.extensions import is_known
from visref.formats.gltf.meshopt import compression, decoded
from visref.formats.gltf.values import Items, Json
from visref.memory import Budget

_GLB_MAGIC = b"glTF"
_CHUNK_JSON = 0x4E4F534A
_CHUNK_BIN = 0x004E4942


class Document:
    """An open glTF or GLB file. Bytes are mapped, not read: images that no mask
    needs cost nothing. `budget`: what is decoded or made up out of nothing is claimed there.

    Raises InputError (without the file's name; `visref.formats` adds it).
    """

    def __init__(self, path: Path, budget: Budget | None = None) -> None:
        self.path = path
        self.budget = Budget.of(None) if budget is None else budget
        data = map_file(path)
        self._chunk: Bytes | None = None
        if data[:4].tobytes() == _GLB_MAGIC:
            text, self._chunk = _chunks(data)
        else:
            text = data
        self.budget.claim("its JSON", json_bytes(text))
        self.root = Json(parse_json(text.tobytes()), "")
        self._buffers: dict[int, Bytes] = {}
        self._decompressed: dict[int, Bytes] = {}
        self._lists: dict[str, Items] = {}
        self._check_asset()
        self.used_extensions = self._check_extensions()
        self.unknown_extensions = [name for name in self.used_extensions if not is_known(name)]

    def entries(self, kind: str) -> Items:
        """The file's top-level list `kind` ("nodes", "meshes", …), empty where it is absent."""
        if kind not in self._lists:
            found = self.root.get(kind)
            self._lists[kind] = found.items() if found is not None else Items([], kind)
        return self._lists[kind]

    def entry(self, kind: str, reference: Json) -> Json:
        """The entry of `kind` that `reference` names by index."""
        entries = self.entries(kind)
        index = reference.integer(0)
        if index >= len(entries):
            reference.fail(f"{kind}[{index}] is named, but the file has {len(entries)}")
        return entries[index]

    def view(self, reference: Json) -> tuple[Bytes, int | None]:
        """A buffer view's bytes, (n,) uint8, decompressed, and its stride if it states one."""
        view = self.entry("bufferViews", reference)
        extension = compression(view)
        data = self._part(view) if extension is None else self._decoded(reference, view, extension)
        stride = view.get("byteStride")
        return data, None if stride is None else stride.integer(1, 65535)

    def _decoded(self, reference: Json, view: Json, extension: Json) -> Bytes:
        """Of a compressed view, once. Where the file has the same uncompressed for other readers,
        that is not looked at."""
        index = reference.integer(0)
        if index not in self._decompressed:
            data = self._part(extension)
            self._decompressed[index] = decoded(extension, view, data, self.budget)
        return self._decompressed[index]

    def _part(self, owner: Json) -> Bytes:
        """The bytes of a buffer that a buffer view, or its compression, names."""
        data = self._buffer(owner["buffer"])
        offset = _integer(owner, "byteOffset", 0)
        length = owner["byteLength"].integer(1)
        if offset + length > len(data):
            owner.fail(f"it ends at byte {offset + length} of a buffer of {len(data)}")
        return data[offset : offset + length]

    def image(self, image: Json) -> tuple[bytes, str | None]:
        """The bytes of an entry of `images`, undecoded, and its MIME type if it states one."""
        mime, view = image.get("mimeType"), image.get("bufferView")
        data = self.view(view)[0] if view is not None else self._uri(image["uri"])
        return data.tobytes(), None if mime is None else mime.text()

    def _buffer(self, reference: Json) -> Bytes:
        index = reference.integer(0)
        if index in self._buffers:
            return self._buffers[index]
        buffer = self.entry("buffers", reference)
        length = buffer["byteLength"].integer(1)
        uri = buffer.get("uri")
        if uri is not None:
            data = self._uri(uri)
        elif index == 0 and self._chunk is not None:
            data = self._chunk
        else:
            buffer.fail("the buffer has neither a uri nor bytes in the file")
        if len(data) < length:
            buffer.fail(f"it holds {len(data)} of its {length} bytes: the file is truncated")
        self._buffers[index] = data[:length]
        return self._buffers[index]

    def _uri(self, uri: Json) -> Bytes:
        text = uri.text()
        if text.startswith("data:"):
            header, _, payload = text.partition(",")
            if not header.endswith(";base64"):
                uri.fail("the data URI is not base64")
            self.budget.claim("a data URI", len(payload), place=uri.place)
            try:
                return np.frombuffer(base64.b64decode(payload, validate=True), np.uint8)
            except (binascii.Error, ValueError):
                uri.fail("the data URI is not valid base64")
        if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", text):
            uri.fail(f"{text[:60]!a} is not a file beside this one", "download it first")
        try:
            return map_file(named_beside(self.path, unquote(text)))
        except InputError as error:
            uri.fail(f"file {text[:200]!a}: {error.problem}", "put the file there")

    def _check_asset(self) -> None:
        version = self.root["asset"]["version"].text()
        if not version.startswith("2."):
            self.root["asset"]["version"].fail(
                f"this is glTF {version}", "convert it: visref reads glTF 2"
            )

    def _check_extensions(self) -> list[str]:
        """Refuse what is required and not known; return what is used."""
        required = self.root.get("extensionsRequired")
        for name in required.items() if required is not None else []:
            if not is_known(name.text()):
                name.fail(
                    f"the file requires extension {name.text()}, which visref does not know",
                    "export without it",
                )
        used = self.root.get("extensionsUsed")
        return [name.text() for name in used.items()] if used is not None else []


def _integer(owner: Json, name: str, default: int) -> int:
    member = owner.get(name)
    return default if member is None else member.integer()


def _chunks(data: Bytes) -> tuple[Bytes, Bytes | None]:
    """The JSON chunk and the binary chunk of a GLB file (section 4.4)."""
    if len(data) < 12:
        raise InputError("truncated GLB: the header is cut", fix="export or copy it anew")
    version, length = (int(v) for v in data[4:12].view("<u4"))
    if version != 2:
        raise InputError(f"this is GLB version {version}", fix="convert it: visref reads 2")
    if length > len(data):
        raise InputError(
            f"truncated GLB: it has {len(data)} of its {length} bytes",
            fix="export or copy it anew",
        )
    chunks: dict[int, Bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = (int(v) for v in data[at : at + 8].view("<u4"))
        if at + 8 + size > length:
            raise InputError(
                f"truncated GLB: the chunk at byte {at} is cut", fix="export or copy it anew"
            )
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if _CHUNK_JSON not in chunks:
        raise InputError("the GLB has no JSON chunk", fix="export or copy it anew")
    return chunks[_CHUNK_JSON], chunks.get(_CHUNK_BIN)
