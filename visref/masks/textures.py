"""The alpha channel of an image file, exactly as stored: PNG, JPEG and WebP."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from visref.errors import InputError
from visref.masks.png16 import alpha_of_16_bit_png
from visref.memory import Budget

# A few kilobytes of PNG can stand for gigabytes. 8192 x 8192 is WebGPU's default limit of a
# texture's side; as RGBA that is 256 MiB while it is decoded.
MAX_PIXELS = 1 << 26

# Decoded by Pillow, and where a channel has 16 bits its lines twice more and the alpha.
_PIXEL_BYTES = 4 + 8 + 8 + 2

_SIGNATURES = (
    (b"\x89PNG\r\n\x1a\n", "PNG"),
    (b"\xff\xd8\xff", "JPEG"),
    (b"\xabKTX 20\xbb\r\n\x1a\n", "KTX2"),
    (b"\xabKTX 11\xbb\r\n\x1a\n", "KTX"),
    (b"DDS ", "DDS"),
)
_DECODED = ("PNG", "JPEG", "WEBP")


class UndecodableImage(ValueError):
    """An image whose alpha cannot be had; its text is the reason."""


@dataclass(frozen=True, eq=False)
class AlphaImage:
    """`alpha`: (height, width) uint8 or uint16, row 0 at the top of the image, v = 0.
    A texel's alpha is `alpha / scale`; `scale` is 255 or 65535."""

    alpha: NDArray[Any]
    scale: int


def decode_alpha(data: bytes, mime: str | None = None, budget: Budget | None = None) -> AlphaImage:
    """The alpha of an image file's bytes; all `scale` where the format or file has none.

    What the file is, its first bytes say; `mime` only names what they do not. Palettes with
    transparency, transparent colours and 16 bits a channel are read as PNG defines them. Of an
    animation this is the first picture.

    Raises UndecodableImage: another format, damaged data, more than MAX_PIXELS pixels; and
    InputError where decoding it does not fit `budget`.
    """
    kind = _kind(data)
    if kind not in _DECODED:
        raise UndecodableImage(f"no decoder for {kind or mime or 'an unknown image format'}")
    try:
        with warnings.catch_warnings():
            # The bound below is stricter than the one that this warning goes by.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data), formats=[kind])
        with image:
            width, height = image.size
            if width * height > MAX_PIXELS:
                raise UndecodableImage(
                    f"{width} x {height} pixels, more than {MAX_PIXELS >> 20} Mi are not decoded"
                )
            if budget is not None:
                what = f"an image of {width} × {height} pixels"
                budget.need(what, width * height * _PIXEL_BYTES)
            image.load()
            return _alpha_of(image, data)
    except (UndecodableImage, InputError):
        raise
    # Pillow's decoders answer damaged data with any of these.
    except (
        OSError,
        SyntaxError,
        ValueError,
        EOFError,
        IndexError,
        struct.error,
        zlib.error,
    ) as error:
        raise UndecodableImage(f"damaged {kind}: {error}") from error
    except (Image.DecompressionBombError, MemoryError) as error:
        raise UndecodableImage(f"{kind} too large to decode: {error}") from error


def _kind(data: bytes) -> str:
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "WEBP"
    return next((name for start, name in _SIGNATURES if data.startswith(start)), "")


def _alpha_of(image: Image.Image, data: bytes) -> AlphaImage:
    width, height = image.size
    transparent = image.info.get("transparency")
    if "A" not in image.getbands() and transparent is None:
        return AlphaImage(np.full((height, width), 255, np.uint8), 255)
    if image.format == "PNG":
        depth, colour = data[24], data[25]
        if depth == 16:
            # Pillow keeps only the high bytes.
            return AlphaImage(alpha_of_16_bit_png(data, MAX_PIXELS), 65535)
        if colour == 0 and depth in (2, 4):
            # Pillow widens these to 8 bits, but not the grey that is transparent.
            grey = np.asarray(image.convert("L"))
            key = int(transparent) * (255 // ((1 << depth) - 1)) if transparent is not None else -1
            return AlphaImage(np.where(grey == key, 0, 255).astype(np.uint8), 255)
    alpha = np.array(image.convert("RGBA").getchannel("A"), np.uint8)
    return AlphaImage(alpha, 255)
