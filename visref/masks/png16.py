"""Alpha of a PNG with 16 bits a channel, all 16 of them.

PNG (Portable Network Graphics) Specification, third edition, W3C 2025: chunks (section 5),
interlacing (8.1), filters (9.2), transparency (11.3.1.1). The file has been decoded once by
another decoder before, so checksums and the order of chunks are known to be right.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit

# Samples in a pixel, by colour type: grey, RGB, grey with alpha, RGBA.
_SAMPLES = {0: 1, 2: 3, 4: 2, 6: 4}
# Adam7: each pass's first column and row, and the steps between its columns and rows.
_PASSES = (
    (0, 0, 8, 8),
    (4, 0, 8, 8),
    (0, 4, 4, 8),
    (2, 0, 4, 4),
    (0, 2, 2, 4),
    (1, 0, 2, 2),
    (0, 1, 1, 2),
)


def alpha_of_16_bit_png(data: bytes, max_pixels: int) -> NDArray[np.uint16]:
    """(height, width) uint16 alpha of a PNG of colour type 4 or 6, or with a tRNS chunk.

    Raises ValueError where the data are short, damaged or more than `max_pixels` pixels.
    """
    width, height, depth, colour, _, _, interlaced = struct.unpack_from(">IIBBBBB", data, 16)
    if depth != 16 or colour not in _SAMPLES or not 0 < width * height <= max_pixels:
        raise ValueError("not a PNG with 16 bits a channel that can be decoded")
    samples = _SAMPLES[colour]
    packed, key = _chunks(data)
    grids = _PASSES if interlaced else ((0, 0, 1, 1),)
    sizes = [
        (max(0, -(-(width - x) // across)), max(0, -(-(height - y) // down)))
        for x, y, across, down in grids
    ]
    total = sum(rows * (1 + 2 * samples * columns) for columns, rows in sizes if columns)
    # Not a byte more than the picture takes, whatever the stream holds.
    raw = np.frombuffer(zlib.decompressobj().decompress(packed, total), np.uint8)
    if len(raw) != total:
        raise ValueError("picture data end early")
    alpha = np.empty((height, width), np.uint16)
    start = 0
    for (x, y, across, down), (columns, rows) in zip(grids, sizes, strict=True):
        if not columns or not rows:
            continue
        length = 1 + 2 * samples * columns
        lines = raw[start : start + rows * length].reshape(rows, length)
        start += rows * length
        plain = np.zeros((rows, length - 1), np.uint8)
        if not _unfilter(lines, plain, 2 * samples):
            raise ValueError("unknown PNG filter")
        pixels = plain.view(">u2").reshape(rows, columns, samples)
        alpha[y::down, x::across] = _alpha(pixels, colour, key)
    return alpha


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """All picture data, still compressed, and the tRNS chunk (empty if there is none)."""
    packed, key, place = [], b"", 8
    while place + 8 <= len(data):
        length, name = struct.unpack_from(">I4s", data, place)
        body = data[place + 8 : place + 8 + length]
        if name == b"IDAT":
            packed.append(body)
        elif name == b"tRNS":
            key = body
        place += 12 + length
    return b"".join(packed), key


def _alpha(pixels: NDArray[Any], colour: int, key: bytes) -> NDArray[np.uint16]:
    if colour in (4, 6):
        return pixels[..., -1].astype(np.uint16)
    transparent = np.frombuffer(key[: 2 * pixels.shape[-1]], ">u2")
    return np.where(np.all(pixels == transparent, axis=-1), 0, 65535).astype(np.uint16)


@njit()
def _unfilter(lines: NDArray[Any], plain: NDArray[Any], pixel_bytes: int) -> bool:
    """Undo each line's filter, named by its first byte; False where there is no such filter."""
    for y in range(len(lines)):
        kind = lines[y, 0]
        if kind > 4:
            return False
        for i in range(plain.shape[1]):
            left: Any = np.int64(plain[y, i - pixel_bytes]) if i >= pixel_bytes else 0
            above: Any = np.int64(plain[y - 1, i]) if y else 0
            corner: Any = np.int64(plain[y - 1, i - pixel_bytes]) if y and i >= pixel_bytes else 0
            guess: Any = 0
            if kind == 1:
                guess = left
            elif kind == 2:
                guess = above
            elif kind == 3:
                guess = (left + above) // 2
            elif kind == 4:
                by_left = abs(above - corner)
                by_above = abs(left - corner)
                by_corner = abs(left + above - 2 * corner)
                if by_left <= by_above and by_left <= by_corner:
                    guess = left
                elif by_above <= by_corner:
                    guess = above
                else:
                    guess = corner
            plain[y, i] = np.uint8((np.int64(lines[y, i + 1]) + guess) & 255)
    return True
