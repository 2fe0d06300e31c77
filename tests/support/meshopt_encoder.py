"""Writes meshopt's bitstreams, from the specification, one Python number after another: an oracle
for the decoder, which it shares no code with. It aims at using every code, not at being short."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.support.gltf_files import COMPONENT, KIND, Gltf


def _zigzag(value: int, bits: int) -> int:
    """Of a difference modulo 2^bits."""
    value %= 1 << bits
    if value >> (bits - 1):
        return (~(value << 1)) % (1 << bits)
    return value << 1


def _packed(values: Sequence[int], bits: int) -> bytes:
    """A group of 16 deltas: what is too wide for `bits` follows, and a sentinel stands for it."""
    if bits == 0:
        assert not any(values)
        return b""
    if bits == 8:
        return bytes(values)
    top = (1 << bits) - 1
    small = [min(value, top) for value in values]
    number, out = 8 // bits, []
    for i in range(0, 16, number):
        part = small[i : i + number]
        if bits > 1:
            part = part[::-1]
        out.append(sum(value << (bits * k) for k, value in enumerate(part)))
    return bytes(out) + bytes(value for value in values if value >= top)


def attributes(
    rows: Any, *, version: int = 0, modes: Sequence[int] = (), controls: Sequence[int] = ()
) -> bytes:
    """`rows`: (n, stride) uint8. Of version 1: `modes`, one for four bytes, and `controls`, one for
    each byte, each repeated. A group takes, in turn, each width that can hold it."""
    rows = np.asarray(rows, np.uint8)
    count, stride = rows.shape
    modes = [modes[i % len(modes)] if modes else 0 for i in range(stride // 4)]
    controls = [controls[k % len(controls)] if controls else 1 for k in range(stride)]
    out, turn = bytes([0xA0 + version]), 0
    last = [int(value) for value in rows[0]]
    most = min((8192 // stride) // 16 * 16, 256)
    for start in range(0, count, most):
        block = rows[start : start + most].tolist()
        lanes: list[list[int]] = [[] for _ in range(stride)]
        for row in block:
            for channel in range(stride // 4):
                for k, byte in enumerate(_differences(last, row, 4 * channel, modes[channel])):
                    lanes[4 * channel + k].append(byte)
            last = row
        if version:
            used = [2 if c == 2 and not any(lanes[k]) else c % 4 for k, c in enumerate(controls)]
            used = [3 if c == 2 and any(lanes[k]) else c for k, c in enumerate(used)]
            quads = (used[k : k + 4] for k in range(0, stride, 4))
            out += bytes(a | b << 2 | c << 4 | d << 6 for a, b, c, d in quads)
        for k, lane in enumerate(lanes):
            if version and used[k] == 2:
                continue
            if version and used[k] == 3:
                out += bytes(lane)
                continue
            widths = ((0, 2, 4, 8), (0, 1, 2, 4), (1, 2, 4, 8))[version and 1 + used[k]]
            padded = lane + [0] * (-len(lane) % 16)
            names, groups = [], b""
            for at in range(0, len(padded), 16):
                values = padded[at : at + 16]
                turn += 1
                possible = [i for i in range(4) if widths[i] or not any(values)]
                name = possible[turn % len(possible)]
                names.append(name)
                groups += _packed(values, widths[name])
            names += [0] * (-len(names) % 4)
            for i in range(0, len(names), 4):
                out += bytes([sum(name << (2 * j) for j, name in enumerate(names[i : i + 4]))])
            out += groups
    tail = bytes(rows[0].tolist()) + (bytes(modes) if version else b"")
    return out + bytes(max(0, (24 if version else 32) - len(tail))) + tail


def _differences(last: list[int], row: list[int], k: int, mode: int) -> list[int]:
    if mode == 0:
        return [_zigzag(row[j] - last[j], 8) for j in range(k, k + 4)]
    if mode == 1:
        out = []
        for j in (k, k + 2):
            value = _zigzag(row[j] + 256 * row[j + 1] - last[j] - 256 * last[j + 1], 16)
            out += [value & 255, value >> 8]
        return out
    turn = mode >> 4
    value = sum((row[k + j] ^ last[k + j]) << (8 * j) for j in range(4))
    value = (value << turn | value >> (32 - turn)) & 0xFFFFFFFF
    return [value >> (8 * j) & 255 for j in range(4)]


def _varint(value: int) -> bytes:
    out = []
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def indices(sequence: Sequence[int]) -> bytes:
    """An index sequence, its two baselines in turn."""
    out, last = b"\xd1", [0, 0]
    for i, index in enumerate(sequence):
        which = i % 2
        difference = _zigzag((index - last[which] + (1 << 30)) % (1 << 31) - (1 << 30), 31)
        out += _varint(difference << 1 | which)
        last[which] = index
    return out + bytes(4)


class Triangles:
    """A stream of triangles: each call adds a code, what it needs beside, and the triangle that the
    specification makes of it."""

    def __init__(self, table: Sequence[int] = ()) -> None:
        self.table = [*table, *[0] * (16 - len(table))]
        self.codes = self.data = b""
        self.made: list[tuple[int, int, int]] = []
        self.edges: list[tuple[int, int]] = []
        self.vertices: list[int] = []
        self.next = self.last = 0

    def _new(self) -> int:
        self.next += 1
        return self.next - 1

    def _free(self, vertex: int) -> int:
        self.data += _varint(_zigzag(vertex - self.last, 32))
        self.last = vertex
        return vertex

    def edge(self, back: int, low: int, vertex: int = 0) -> None:
        """Code 0xXY, X below 15: an edge of `back` edges ago, and a vertex by `low`; `vertex`
        where `low` is 15."""
        self.codes += bytes([back << 4 | low])
        a, b = self.edges[back]
        if low == 0:
            c = self._new()
        elif low < 13:
            c = self.vertices[low]
        elif low < 15:
            c = self.last = self.last + (1 if low == 14 else -1)
        else:
            c = self._free(vertex)
        self.edges[:0] = [(a, c), (c, b)]
        if low == 0 or low > 12:
            self.vertices.insert(0, c)
        self.made.append((a, b, c))

    def three(self, code: int, named: int = 0, free: Sequence[int] = ()) -> None:
        """Code 0xfY: three vertices by the table, or by `named` and the `free` ones."""
        self.codes += bytes([code])
        rest = list(free)
        if code >= 0xFE:
            self.data += bytes([named])
            if named == 0:
                self.next = 0
        else:
            named = self.table[code & 15]
        a = self._free(rest.pop(0)) if code == 0xFF else self._new()
        b, c = (
            self._new() if how == 0 else self._free(rest.pop(0)) if how == 15
            else self.vertices[how - 1] for how in (named >> 4, named & 15)
        )  # fmt: skip
        self.edges[:0] = [(a, c), (c, b), (b, a)]
        self.vertices.insert(0, a)
        for vertex, how in ((b, named >> 4), (c, named & 15)):
            if how in (0, 15):
                self.vertices.insert(0, vertex)
        self.made.append((a, b, c))

    def stream(self) -> bytes:
        return b"\xe1" + self.codes + self.data + bytes(self.table)


def triangles(corners: Sequence[int]) -> bytes:
    """Any triangles, each of three vertices that are written out."""
    made = Triangles()
    for i in range(0, len(corners), 3):
        made.three(0xFF, 0xFF, corners[i : i + 3])
    return made.stream()


def compressed_accessor(gltf: Gltf, values: Any, data: bytes, mode: str, **more: Any) -> int:
    """An accessor of `values` whose buffer view holds `data` instead; its own buffer, number 1, is
    a placeholder. `more`: of the extension ("filter", its "name")."""
    array = np.ascontiguousarray(values)
    array = array.reshape(len(array), -1)
    name = more.pop("name", "EXT_meshopt_compression")
    stride = more.pop("byteStride", array.strides[0])
    own = {"byteStride": stride} if more.pop("states_stride", False) else {}
    place = gltf.view(data)
    entry = gltf.json["bufferViews"][place]
    extension = {**entry, "byteStride": stride, "count": len(array), "mode": mode, **more}
    gltf.json["bufferViews"][place] = {
        "buffer": 1,
        "byteLength": stride * len(array),
        **own,
        "extensions": {name: extension},
    }
    accessor = {
        "bufferView": place,
        "componentType": COMPONENT[array.dtype.str[1:]],
        "count": len(array),
        "type": KIND[array.shape[1]],
    }
    gltf.json["accessors"].append(accessor)
    gltf.json["buffers"] = [
        {"byteLength": len(gltf.blob)},
        {"byteLength": 1 << 20, "extensions": {name: {"fallback": True}}},
    ]
    if name not in gltf.json.setdefault("extensionsRequired", []):
        gltf.json["extensionsRequired"].append(name)
    return len(gltf.json["accessors"]) - 1
