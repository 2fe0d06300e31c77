"""Data as a page carries it: JSON, deflated, in base64. A browser unpacks it by itself, with
`DecompressionStream` (https://compression.spec.whatwg.org/)."""

from __future__ import annotations

import base64
import json
import zlib


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
