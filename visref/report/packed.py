"""Data as a page carries it: JSON, deflated, in base64. A browser unpacks it by itself, with
`DecompressionStream` (https://compression.spec.whatwg.org/)."""

from __future__ import annotations

import base64
import json
import zlib

import numpy as np

from visref.scene import Int64


def packed(value: object) -> str:
    """The value as JSON, packed. The same value gives the same text."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    # Half of a surrogate pair, which a file's name may hold, has no bytes.
    return packed_bytes(text.encode("utf-8", "replace"))


def packed_bytes(content: bytes) -> str:
    """Bytes, packed."""
    return base64.b64encode(deflated(content)).decode("ascii")


def deflated(content: bytes) -> bytes:
    """Bytes as `deflate-raw` has them: without zlib's head, which says nothing here."""
    squeezer = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    return squeezer.compress(content) + squeezer.flush()


def run_lengths(cells: Int64) -> list[int]:
    """(k,) numbers from 0 on as run lengths: so many of a number, and so on."""
    starts = np.flatnonzero(np.diff(cells, prepend=-1))
    lengths = np.diff(starts, append=len(cells))
    flat: list[int] = np.stack([lengths, cells[starts]], axis=1).reshape(-1).tolist()
    return flat
