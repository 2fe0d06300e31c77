"""The colours of pictures: what things mean, and which object is which.

Those with a meaning are Okabe and Ito's (2008), told apart by readers of every colour vision
(https://jfly.uni-koeln.de/color/).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

VISIBLE_RGB = (0x00, 0x72, 0xB2)
SUPERFLUOUS_RGB = (0xE6, 0x9F, 0x00)
MISSED_RGB = (0xD5, 0x5E, 0x00)
MOVED_RGB = (0xCC, 0x79, 0xA7)

# How strongly a surface is lit at the least and at the most (`pictures.light_on`).
DARKEST, BRIGHTEST = 0.26, 1.04


def _spread(ids: NDArray[Any], ratio: float) -> NDArray[np.float64]:
    """In 0…1: neighbours far apart, the same for an id in every scene."""
    return np.mod(ids.astype(np.float64) * ratio, 1.0)


def pastel(ids: NDArray[Any]) -> NDArray[np.float64]:
    """(k, 3) linear RGB, a calm colour per object of `ids`, (k,): hue by the golden ratio,
    lightness and chroma by Roberts's R2 sequence."""
    return _linear_from_oklch(
        0.80 + 0.12 * _spread(ids, 0.7548776662466927),
        0.025 + 0.05 * _spread(ids, 0.5698402909980532),
        _spread(ids, 0.6180339887498949),
    )


def vivid(ids: NDArray[Any]) -> NDArray[np.uint8]:
    """(k, 3) sRGB bytes of `ids`, (k,): colours that tell neighbouring ids apart."""
    linear = _linear_from_oklch(
        0.52 + 0.36 * _spread(ids, 0.7548776662466927),
        0.07 + 0.08 * _spread(ids, 0.5698402909980532),
        _spread(ids, 0.6180339887498949),
    )
    return np.round(srgb(linear) * 255.0).astype(np.uint8)


def _linear_from_oklch(
    lightness: NDArray[np.float64], chroma: NDArray[np.float64], turn: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Linear sRGB from OKLCh (Ottosson 2020), hue in turns; clipped to the gamut."""
    a, b = chroma * np.cos(2 * np.pi * turn), chroma * np.sin(2 * np.pi * turn)
    cone = np.stack(
        [
            lightness + 0.3963377774 * a + 0.2158037573 * b,
            lightness - 0.1055613458 * a - 0.0638541728 * b,
            lightness - 0.0894841775 * a - 1.2914855480 * b,
        ],
        axis=1,
    )
    rgb_from_cone = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    linear: NDArray[np.float64] = np.clip(cone**3 @ rgb_from_cone.T, 0.0, 1.0)
    return linear


def srgb(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sRGB transfer curve, 0…1."""
    linear = np.clip(linear, 0.0, 1.0)
    curve: NDArray[np.float64] = np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
    )
    return curve
