"""Alpha of image files, written here byte by byte or by Pillow."""

from __future__ import annotations

import io
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from visref.masks import textures
from visref.masks.png16 import alpha_of_16_bit_png
from visref.masks.textures import UndecodableImage, decode_alpha

SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}


def chunk(name: bytes, body: bytes) -> bytes:
    checksum = zlib.crc32(name + body)
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", checksum)


def paeth(left: int, above: int, corner: int) -> int:
    guess = left + above - corner
    return min(
        (abs(guess - left), 0, left),
        (abs(guess - above), 1, above),
        (abs(guess - corner), 2, corner),
    )[2]


def filter_lines(lines: list[bytes], step: int, kinds: list[int]) -> bytes:
    """Filter as an encoder does: each byte less its guess from bytes before filtering."""
    out = bytearray()
    for y, line in enumerate(lines):
        kind = kinds[y % len(kinds)]
        before = lines[y - 1] if y else bytes(len(line))
        out.append(kind)
        for i, byte in enumerate(line):
            left = line[i - step] if i >= step else 0
            corner = before[i - step] if i >= step else 0
            above = before[i]
            guesses = [0, left, above, (left + above) // 2, paeth(left, above, corner)]
            out.append((byte - guesses[kind]) % 256)
    return bytes(out)


def png(
    pixels: NDArray[Any],
    depth: int,
    colour: int,
    extra: bytes = b"",
    interlaced: bool = False,
    kinds: tuple[int, ...] = (0, 1, 2, 3, 4),
) -> bytes:
    """A PNG of (height, width, samples) whole numbers."""
    height, width, samples = pixels.shape
    step = max(1, samples * depth // 8)
    grids = [(0, 0, 1, 1)]
    if interlaced:
        # From the standard's picture of an 8 x 8 tile.
        grids = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4)]
        grids += [(1, 0, 2, 2), (0, 1, 1, 2)]
    packed = b""
    for x, y, across, down in grids:
        part = pixels[y::down, x::across]
        if not part.size:
            continue
        lines = []
        for row in part.reshape(len(part), -1):
            bits = "".join(f"{int(value):0{depth}b}" for value in row)
            bits += "0" * (-len(bits) % 8)
            lines.append(bytes(int(bits[i : i + 8], 2) for i in range(0, len(bits), 8)))
        packed += filter_lines(lines, step, list(kinds))
    header = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, interlaced)
    stream = zlib.compress(packed)
    half = len(stream) // 2
    picture = chunk(b"IDAT", stream[:half]) + chunk(b"IDAT", stream[half:])
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + extra + picture + chunk(b"IEND", b"")


def pixels(shape: tuple[int, int], samples: int, depth: int, seed: int = 0) -> NDArray[Any]:
    return np.random.default_rng(seed).integers(0, 1 << depth, (*shape, samples))


@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize("colour", [4, 6])
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (9, 18), (3, 2)])
def test_alpha_channel_of_a_png_is_taken_as_stored(
    shape: tuple[int, int], depth: int, colour: int, interlaced: bool
) -> None:
    values = pixels(shape, SAMPLES[colour], depth)
    image = decode_alpha(png(values, depth, colour, interlaced=interlaced))
    assert image.scale == (1 << depth) - 1
    assert image.alpha.dtype == (np.uint8 if depth == 8 else np.uint16)
    assert np.array_equal(image.alpha, values[..., -1])


def test_16_bit_alpha_has_the_high_bytes_that_pillow_reads() -> None:
    data = png(pixels((13, 11), 4, 16, seed=3), 16, 6, interlaced=True)
    high = np.asarray(Image.open(io.BytesIO(data)).getchannel("A"))
    assert np.array_equal(decode_alpha(data).alpha >> 8, high)


@pytest.mark.parametrize("depth", [1, 2, 4, 8, 16])
def test_transparent_grey_is_a_hole_and_no_other(depth: int) -> None:
    values = pixels((6, 9), 1, min(depth, 3)) if depth > 1 else pixels((6, 9), 1, 1)
    key = int(values[2, 3, 0])
    data = png(values, depth, 0, chunk(b"tRNS", struct.pack(">H", key)))
    image = decode_alpha(data)
    assert np.array_equal(image.alpha == 0, values[..., 0] == key)
    assert set(np.unique(image.alpha)) <= {0, image.scale}


@pytest.mark.parametrize("depth", [8, 16])
def test_transparent_colour_is_compared_in_all_its_bits(depth: int) -> None:
    values = pixels((4, 4), 3, depth)
    values[1, 1] = values[0, 0] ^ np.array([0, 0, 1])
    key = struct.pack(">3H", *values[0, 0].tolist())
    image = decode_alpha(png(values, depth, 2, chunk(b"tRNS", key)))
    wanted = np.full((4, 4), image.scale)
    wanted[0, 0] = 0
    assert np.array_equal(image.alpha, wanted)


@pytest.mark.parametrize("depth", [1, 2, 4, 8])
def test_palette_has_the_transparency_of_its_entries(depth: int) -> None:
    values = pixels((5, 7), 1, min(depth, 3))
    table = np.random.default_rng(1).integers(0, 256, 8)
    opaque = np.full(1 << depth, 255)
    count = min(3, 1 << depth)
    opaque[:count] = table[:count]
    extra = chunk(b"PLTE", bytes(3 << depth)) + chunk(b"tRNS", bytes(opaque[:count].tolist()))
    image = decode_alpha(png(values, depth, 3, extra))
    assert image.scale == 255
    assert np.array_equal(image.alpha, opaque[values[..., 0]])


@pytest.mark.parametrize(("colour", "depth"), [(0, 8), (2, 8), (2, 16), (0, 16)])
def test_png_without_alpha_is_opaque(colour: int, depth: int) -> None:
    image = decode_alpha(png(pixels((3, 4), SAMPLES[colour], depth), depth, colour))
    assert image.alpha.shape == (3, 4)
    assert np.all(image.alpha == image.scale)


def written(mode: str, kind: str, **options: Any) -> tuple[bytes, NDArray[np.uint8]]:
    bands = len(mode)
    values = pixels((6, 10), bands, 8, seed=7).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(values, mode if bands > 1 else None).save(file, kind, **options)
    return file.getvalue(), values


def test_jpeg_is_opaque() -> None:
    data, _ = written("RGB", "JPEG")
    image = decode_alpha(data, "image/jpeg")
    assert image.alpha.shape == (6, 10)
    assert image.scale == 255
    assert np.all(image.alpha == 255)


def test_webp_alpha_is_taken_as_stored() -> None:
    data, values = written("RGBA", "WEBP", lossless=True, exact=True)
    assert np.array_equal(decode_alpha(data, "image/webp").alpha, values[..., 3])
    data, _ = written("RGB", "WEBP")
    assert np.all(decode_alpha(data).alpha == 255)


def test_first_bytes_say_what_a_file_is() -> None:
    data, _ = written("RGB", "JPEG")
    assert decode_alpha(data, "image/png").alpha.shape == (6, 10)


@pytest.mark.parametrize(
    ("data", "mime", "reason"),
    [
        (b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(80), "image/ktx2", "KTX2"),
        (b"DDS " + bytes(124), None, "DDS"),
        (b"GIF89a" + bytes(20), "image/gif", "image/gif"),
        (b"", None, "unknown image format"),
    ],
)
def test_other_formats_are_refused_by_name(data: bytes, mime: str | None, reason: str) -> None:
    with pytest.raises(UndecodableImage, match=f"no decoder for .*{reason}"):
        decode_alpha(data, mime)


FILES = [
    png(pixels((9, 8), 4, 8), 8, 6),
    png(pixels((9, 8), 4, 16), 16, 6),
    png(pixels((9, 8), 1, 2), 2, 0, chunk(b"tRNS", b"\0\1")),
    written("RGB", "JPEG")[0],
    written("RGBA", "WEBP", lossless=True)[0],
]


@pytest.mark.parametrize("data", FILES)
def test_damaged_file_is_refused_with_a_reason_or_read(data: bytes) -> None:
    refused = 0
    random = np.random.default_rng(6)
    for _ in range(150):
        bad = bytearray(data[: random.integers(1, len(data))])
        if random.integers(2):
            bad = bytearray(data)
        for place in random.integers(0, len(bad), random.integers(1, 4)):
            bad[place] = random.integers(256)
        try:
            image = decode_alpha(bytes(bad))
        except UndecodableImage:
            refused += 1
        else:
            assert image.alpha.ndim == 2
    assert refused > 75
    with pytest.raises(UndecodableImage, match=r"damaged|no decoder"):
        decode_alpha(data[: len(data) // 2])


@pytest.mark.parametrize("side", [10_000, 16_384])
def test_few_bytes_that_stand_for_many_pixels_are_refused_unread(side: int) -> None:
    header = struct.pack(">IIBBBBB", side, side, 8, 6, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(99)))
    with pytest.raises(UndecodableImage, match=r"10000 x 10000 pixels|too large"):
        decode_alpha(bomb + chunk(b"IEND", b""))


def test_bound_on_pixels_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(textures, "MAX_PIXELS", 71)
    with pytest.raises(UndecodableImage, match="8 x 9 pixels"):
        decode_alpha(FILES[0])


def test_no_more_of_a_stream_is_unpacked_than_the_picture_takes() -> None:
    data = png(pixels((2, 2), 4, 16), 16, 6)
    place = data.index(b"IDAT") - 4
    long = zlib.compress(bytes(1 << 24))
    swollen = data[:place] + chunk(b"IDAT", long) + chunk(b"IEND", b"")
    assert not alpha_of_16_bit_png(swollen, 4).any()
