"""A PNG writer whose bytes depend on nothing but the picture: its data is stored, not compressed,
since compressors change from version to version.

Source: PNG specification, third edition, sections 5 and 11; RFC 1950 and 1951 (stored blocks).
"""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# zlib's header for a window of 32 KiB and the fastest level: a multiple of 31.
_ZLIB = b"\x78\x01"
_BLOCK = 65535


def png_of_alpha(alpha: NDArray[Any]) -> bytes:
    """White with this alpha, (height, width) uint8, row 0 at the top, as RGBA of 8 bits each."""
    height, width = alpha.shape
    rows = np.full((height, 1 + 4 * width), 255, np.uint8)
    rows[:, 0] = 0  # no filter
    rows[:, 4::4] = alpha
    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    parts = [(b"IHDR", header), (b"IDAT", _stored(rows.tobytes())), (b"IEND", b"")]
    return _SIGNATURE + b"".join(_chunk(kind, data) for kind, data in parts)


def _stored(data: bytes) -> bytes:
    blocks = [data[at : at + _BLOCK] for at in range(0, len(data), _BLOCK)]
    written = [
        struct.pack("<BHH", block is blocks[-1], len(block), len(block) ^ 0xFFFF) + block
        for block in blocks
    ]
    return b"".join([_ZLIB, *written, struct.pack(">I", zlib.adler32(data))])


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
