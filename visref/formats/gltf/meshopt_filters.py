"""The filters of meshopt compression: what a decoded element means.

Source: the specifications of EXT_meshopt_compression and KHR_meshopt_compression, appendix B, in
the float32 operations that stand there, one by one: the same numbers on every machine, where the
specification allows one unit in the last place. What it calls unspecified is refused: two engines
may make different things of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]


class UnspecifiedElement(ValueError):
    """An element, by its number, for which the specification gives no result."""

    def __init__(self, element: int) -> None:
        super().__init__(element)
        self.element = element


def octahedral(elements: Bytes) -> Bytes:
    """Unit vectors: (n, 4 or 8) uint8, four signed integers each, of which the last stays."""
    kind = np.dtype("<i1") if elements.shape[1] == 4 else np.dtype("<i2")
    given = elements.view(kind)
    x, y, one = (given[:, i].astype(np.int64) for i in range(3))
    # 2^(K - 1) - 1, and K is 2 at least.
    _specified((one > 0) & (one & (one + 1) == 0) & (abs(x) <= one) & (abs(y) <= one))
    scale = one.astype(np.float32)
    u, v = x.astype(np.float32) / scale, y.astype(np.float32) / scale
    z = np.float32(1.0) - np.abs(u) - np.abs(v)
    fold = np.minimum(z, np.float32(0.0))
    u, v = u - np.copysign(fold, u), v - np.copysign(fold, v)
    length = np.sqrt(u * u + v * v + z * z)
    result = given.copy()
    for i, value in enumerate((u, v, z)):
        result[:, i] = _rounded(value / length * np.float32(np.iinfo(kind).max))
    return result.view(np.uint8)


def quaternion(elements: Bytes) -> Bytes:
    """Rotations: (n, 8) uint8, four signed integers each; the largest component is left out, and
    its number is in the last two bits."""
    given = elements.view("<i2").astype(np.int64)
    one = given[:, 3] | 3
    small = (np.abs(given[:, :3]) <= one[:, None]).all(axis=1)
    # 2^(K - 1) - 1, and K is 4 at least.
    _specified((one >= 7) & (one & (one + 1) == 0) & small)
    reach = np.float32(1.0) / np.sqrt(np.float32(2.0))
    scale = one.astype(np.float32)
    x, y, z = (given[:, i].astype(np.float32) / scale * reach for i in range(3))
    w = np.sqrt(np.maximum(np.float32(0.0), np.float32(1.0) - x * x - y * y - z * z))
    result = np.empty((len(given), 4), "<i2")
    rows, largest = np.arange(len(given)), given[:, 3] & 3
    for step, value in ((1, x), (2, y), (3, z), (0, w)):
        result[rows, (largest + step) % 4] = _rounded(value * np.float32(32767.0))
    return result.view(np.uint8)


def exponential(elements: Bytes) -> Bytes:
    """Floats: (n, 4 k) uint8, k times 24 bits of mantissa and 8 of exponent, both signed."""
    given = elements.view("<i4")
    exponent, mantissa = given >> 24, (given << 8) >> 8
    _specified((np.abs(exponent) <= 100).all(axis=1))
    # Exact: at most 23 bits of mantissa, and no exponent leaves the normal numbers.
    result: NDArray[np.float32] = np.ldexp(mantissa.astype("<f4"), exponent).astype("<f4")
    return result.view(np.uint8)


def color(elements: Bytes) -> Bytes:
    """Colours: (n, 4 or 8) uint8, luma, two of chroma, and alpha below a bit that says how many
    bits there are."""
    wide = np.dtype("<u1") if elements.shape[1] == 4 else np.dtype("<u2")
    signed = elements.view("<i1" if elements.shape[1] == 4 else "<i2").astype(np.int64)
    y, alpha = (elements.view(wide)[:, i].astype(np.int64) for i in (0, 3))
    orange, green = signed[:, 1], signed[:, 2]
    # K is 2 at least: the bit above alpha's is not the lowest.
    _specified(alpha >= 2)
    most = 2 ** np.frexp(alpha.astype(np.float64))[1].astype(np.int64) - 1
    channels = [y + orange - green, y + green, y - orange - green]
    inside = np.ones(len(y), np.bool_)
    for channel in channels:
        inside &= (channel >= 0) & (channel <= most)
    _specified(inside)
    alpha = alpha & (most >> 1)
    channels.append(alpha << 1 | alpha & 1)
    scale = np.float32(np.iinfo(wide).max) / most.astype(np.float32)
    result = np.empty((len(y), 4), wide)
    for i, channel in enumerate(channels):
        result[:, i] = _rounded(channel.astype(np.float32) * scale)
    return result.view(np.uint8)


# By the name that the extension gives it; the lengths of an element that it takes, None for any.
FILTERS: dict[str, tuple[Callable[[Bytes], Bytes], tuple[int, ...] | None]] = {
    "OCTAHEDRAL": (octahedral, (4, 8)),
    "QUATERNION": (quaternion, (8,)),
    "EXPONENTIAL": (exponential, None),
    "COLOR": (color, (4, 8)),
}


def _rounded(values: NDArray[Any]) -> NDArray[np.int64]:
    """To the nearest integer, halfway cases away from zero."""
    wide = values.astype(np.float64)
    return (np.copysign(np.floor(np.abs(wide) + 0.5), wide)).astype(np.int64)


def _specified(good: NDArray[np.bool_]) -> None:
    if not good.all():
        raise UnspecifiedElement(int(np.argmin(good)))
