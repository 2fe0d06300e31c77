"""The three bitstreams of meshopt compression: attributes, triangles, index sequences.

Source: the specifications of the glTF extensions EXT_meshopt_compression (attributes of version 0)
and KHR_meshopt_compression (version 1 too), appendix A. They are written from there, not from the
reference decoder: nothing that a stream says is read beyond its end or written beyond the result.

Every kernel returns the place in the stream, in bytes, up to which it was valid, and whether all of
it was: a stream ends where its tail starts, and holds neither more nor less.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit

Bytes = NDArray[np.uint8]

ATTRIBUTES_0, ATTRIBUTES_1, TRIANGLES, INDICES = 0xA0, 0xA1, 0xE1, 0xD1
# Elements that are stored together, and a group of them.
_BLOCK_BYTES, _BLOCK, _GROUP = 8192, 256, 16
_FIFO = 16
_CODEAUX = 16
_INDICES_TAIL = 4
# A varint of 32 bits takes five bytes at most.
_VARINT = 5


def tail_bytes(header: int, stride: int) -> int:
    """How long the tail of an attribute stream is, with its padding."""
    if header == ATTRIBUTES_0:
        return max(stride, 32)
    return max(stride + stride // 4, 24)


@njit()
def _byte(value: Any) -> Any:
    """As a signed number of 64 bits: what numba makes of one and of a uint8 together is a float."""
    return np.int64(value)


@njit()
def _group(data: Any, at: int, end: int, bits: int, deltas: Any, first: int) -> int:
    """Read a group of 16 deltas of `bits` each (0, 1, 2, 4 or 8). Returns where it ends, -1 where
    the stream does before it."""
    if bits == 0:
        for i in range(_GROUP):
            deltas[first + i] = 0
        return at
    packed = 2 * bits
    if end - at < packed:
        return -1
    if bits == 8:
        for i in range(_GROUP):
            deltas[first + i] = data[at + i]
        return at + packed
    extra = at + packed
    sentinel = (1 << bits) - 1
    in_byte = 8 // bits
    for i in range(_GROUP):
        place = i % in_byte
        # One bit each stands from the least significant; wider ones from the most.
        shift = place if bits == 1 else 8 - bits * (place + 1)
        value = (_byte(data[at + i // in_byte]) >> shift) & sentinel
        if value == sentinel:
            if extra >= end:
                return -1
            value = _byte(data[extra])
            extra += 1
        deltas[first + i] = value
    return extra


@njit()
def _lane(
    data: Any, at: int, end: int, count: int, first_bits: int, deltas: Any, widths: Any
) -> int:
    """Read the deltas of one byte of each of `count` elements: two bits of header a group, then
    the groups. `widths[first_bits:]`: the widths that the header names."""
    groups = (count + _GROUP - 1) // _GROUP
    header = at
    at += (groups + 3) // 4
    if at > end:
        return -1
    for group in range(groups):
        named = (_byte(data[header + group // 4]) >> (2 * (group % 4))) & 3
        at = _group(data, at, end, widths[first_bits + named], deltas, group * _GROUP)
        if at < 0:
            return -1
    return at


@njit()
def _unzigzag(value: int) -> int:
    """-1 for 1, 1 for 2, -2 for 3; the caller keeps as many bits as it has."""
    return ~(value >> 1) if value & 1 else value >> 1


@njit()
def decode_attributes(
    data: Bytes, tail: int, stride: int, version: int, result: Bytes
) -> tuple[int, bool]:
    """`result`: (n, stride) uint8, elements that `data`, (m,) uint8 with its header, holds.
    `tail`: as `tail_bytes` says."""
    count = len(result)
    end = len(data) - tail
    modes = len(data) - stride // 4
    baseline = len(data) - stride if version == 0 else modes - stride
    last = np.empty(stride, np.int64)
    for k in range(stride):
        last[k] = data[baseline + k]
    if version == 1:
        for channel in range(stride // 4):
            mode = data[modes + channel]
            if mode & 15 > 2 or (mode & 15 < 2 and mode >> 4):
                return modes + channel, False
    most = min((_BLOCK_BYTES // stride) & ~15, _BLOCK)
    # {0, 1, 2, 4} and {1, 2, 4, 8}, of version 1; {0, 2, 4, 8}, of version 0.
    widths = np.array([0, 1, 2, 4, 8, 0, 2, 4, 8], np.int64)
    deltas = np.empty((stride, most), np.uint8)
    at = 1
    for start in range(0, count, most):
        size = min(most, count - start)
        control = at
        if version == 1:
            at += stride // 4
            if at > end:
                return control, False
        for k in range(stride):
            before = at
            mode = -1
            if version == 1:
                mode = _byte(data[control + k // 4]) >> (2 * (k % 4)) & 3
            if mode == 2:
                deltas[k, :size] = 0
            elif mode == 3:
                if end - at < size:
                    return before, False
                deltas[k, :size] = data[at : at + size]
                at += size
            else:
                at = _lane(data, at, end, size, 5 if mode < 0 else mode, deltas[k], widths)
                if at < 0:
                    return before, False
        for channel in range(stride // 4):
            k = 4 * channel
            kind, turn = 0, 0
            if version == 1:
                kind, turn = _byte(data[modes + channel]) & 15, _byte(data[modes + channel]) >> 4
            for i in range(size):
                row = result[start + i]
                if kind == 0:
                    for j in range(k, k + 4):
                        last[j] = (last[j] + _unzigzag(_byte(deltas[j, i]))) & 0xFF
                        row[j] = last[j]
                elif kind == 1:
                    for j in range(k, k + 4, 2):
                        delta = _byte(deltas[j, i]) | _byte(deltas[j + 1, i]) << 8
                        value = (last[j] | last[j + 1] << 8) + _unzigzag(delta)
                        last[j], last[j + 1] = value & 0xFF, (value >> 8) & 0xFF
                        row[j], row[j + 1] = last[j], last[j + 1]
                else:
                    delta = 0
                    for j in range(4):
                        delta |= _byte(deltas[k + j, i]) << (8 * j)
                    # The difference was turned left when it was written.
                    delta = ((delta >> turn) | (delta << (32 - turn))) & 0xFFFFFFFF
                    for j in range(4):
                        last[k + j] ^= (delta >> (8 * j)) & 0xFF
                        row[k + j] = last[k + j]
    return at, at == end


@njit()
def _varint(data: Any, at: int, end: int) -> tuple[int, int]:
    """A number in 7 bits a byte, least first, and where it ends; -1 where it does not."""
    value = 0
    for i in range(_VARINT):
        if at + i >= end:
            return 0, -1
        byte = _byte(data[at + i])
        value |= (byte & 0x7F) << (7 * i)
        if byte < 0x80:
            return value & 0xFFFFFFFF, at + i + 1
    return 0, -1


@njit()
def decode_indices(data: Bytes, result: Any) -> tuple[int, bool]:
    """`result`: (n,) uint16 or uint32, the index sequence that `data`, (m,) uint8 with its header,
    holds. Two baselines: each index is a difference from the last of its own."""
    end = len(data) - _INDICES_TAIL
    last = np.zeros(2, np.int64)
    at = 1
    for i in range(len(result)):
        before = at
        value, at = _varint(data, at, end)
        if at < 0:
            return before, False
        which = value & 1
        last[which] = (last[which] + _unzigzag(value >> 1)) & 0xFFFFFFFF
        result[i] = last[which]
    return at, at == end


@njit()
def _recent(fifo: Any, pushed: int, back: int) -> int:
    """What was pushed `back` pushes before the last one; -1 where that was none."""
    return fifo[(pushed - 1 - back) % _FIFO] if back < min(pushed, _FIFO) else -1


@njit()
def decode_triangles(data: Bytes, result: Any) -> tuple[int, bool]:
    """`result`: (3 t,) uint16 or uint32, the triangles that `data`, (m,) uint8 with its header,
    holds: a byte of code each, then what the codes need beside, then a table of 16 codes."""
    count = len(result) // 3
    end = len(data) - _CODEAUX
    at = 1 + count
    if at > end:
        return 1, False
    for i in range(_CODEAUX):
        entry = data[end + i]
        if entry >> 4 == 15 or entry & 15 == 15 or (i >= 14 and entry):
            return end + i, False
    # Vertices, and edges' two, each in a ring; how often each was pushed to.
    vertices, edges = np.zeros(_FIFO, np.int64), np.zeros((_FIFO, 2), np.int64)
    vertices_in = edges_in = 0
    following = last = 0
    for triangle in range(count):
        before = at
        code = _byte(data[1 + triangle])
        high, low = code >> 4, code & 15
        if high < 15:
            if high >= min(edges_in, _FIFO):
                return 1 + triangle, False
            edge = (edges_in - 1 - high) % _FIFO
            a, b = edges[edge, 0], edges[edge, 1]
            new = True
            if low == 0:
                c = following
                following = (following + 1) & 0xFFFFFFFF
            elif low < 13:
                new = False
                c = _recent(vertices, vertices_in, low)
                if c < 0:
                    return 1 + triangle, False
            elif low < 15:
                c = last = (last + (1 if low == 14 else -1)) & 0xFFFFFFFF
            else:
                value, at = _varint(data, at, end)
                if at < 0:
                    return before, False
                c = last = (last + _unzigzag(value)) & 0xFFFFFFFF
            if new:
                vertices[vertices_in % _FIFO] = c
                vertices_in += 1
        else:
            explicit = low >= 14
            if explicit:
                if at >= end:
                    return before, False
                named = _byte(data[at])
                at += 1
                if named == 0:
                    following = 0
            else:
                named = _byte(data[end + low])
            if code == 0xFF:
                value, at = _varint(data, at, end)
                if at < 0:
                    return before, False
                a = last = (last + _unzigzag(value)) & 0xFFFFFFFF
            else:
                a = following
                following = (following + 1) & 0xFFFFFFFF
            b = c = 0
            new_b = new_c = True
            for which in range(2):
                how = named >> 4 if which == 0 else named & 15
                new = True
                if how == 0:
                    corner = following
                    following = (following + 1) & 0xFFFFFFFF
                elif how < 15:
                    new = False
                    corner = _recent(vertices, vertices_in, how - 1)
                    if corner < 0:
                        return before, False
                else:
                    value, at = _varint(data, at, end)
                    if at < 0:
                        return before, False
                    corner = last = (last + _unzigzag(value)) & 0xFFFFFFFF
                if which == 0:
                    b, new_b = corner, new
                else:
                    c, new_c = corner, new
            edges[edges_in % _FIFO, 0], edges[edges_in % _FIFO, 1] = b, a
            edges_in += 1
            vertices[vertices_in % _FIFO] = a
            vertices_in += 1
            if new_b:
                vertices[vertices_in % _FIFO] = b
                vertices_in += 1
            if new_c:
                vertices[vertices_in % _FIFO] = c
                vertices_in += 1
        for first, second in ((c, b), (a, c)):
            edges[edges_in % _FIFO, 0], edges[edges_in % _FIFO, 1] = first, second
            edges_in += 1
        result[3 * triangle] = a
        result[3 * triangle + 1] = b
        result[3 * triangle + 2] = c
    return at, at == end
