"""A PNG writer for alpha: white pixels, uncompressed, the same bytes everywhere.

A deflate library may pack the same pixels otherwise in its next version, and a scene's bytes
are to depend on its seed alone. So the zlib stream (RFC 1950) is of stored blocks (RFC 1951,
section 3.2.4), written here.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

_GREY_AND_ALPHA = 4
_BLOCK = 65535


def png_bytes(alpha: NDArray[np.uint8]) -> bytes:
    """The PNG file, 8 bits of grey and 8 of alpha, whose alpha is (height, width)."""
    height, width = alpha.shape
    lines = np.zeros((height, 1 + 2 * width), np.uint8)  # each begins with filter 0: none
    lines[:, 1::2] = 255
    lines[:, 2::2] = alpha
    header = struct.pack(">IIBBBBB", width, height, 8, _GREY_AND_ALPHA, 0, 0, 0)
    body = _chunk(b"IHDR", header) + _chunk(b"IDAT", _stored(lines.tobytes()))
    return b"\x89PNG\r\n\x1a\n" + body + _chunk(b"IEND", b"")


def _chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def _stored(data: bytes) -> bytes:
    parts = [b"\x78\x01"]
    for at in range(0, len(data), _BLOCK):
        part = data[at : at + _BLOCK]
        final = at + _BLOCK >= len(data)
        parts.append(struct.pack("<BHH", final, len(part), len(part) ^ 0xFFFF) + part)
    return b"".join([*parts, struct.pack(">I", zlib.adler32(data))])
