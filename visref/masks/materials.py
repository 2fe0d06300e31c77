"""What a masked material says of its alpha: a texture, how it is read, a factor, a cutoff."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError


class Wrap(IntEnum):
    """What stands beyond a texture's edges; the values are glTF's, which are OpenGL's."""

    REPEAT = 10497
    CLAMP_TO_EDGE = 33071
    MIRRORED_REPEAT = 33648


@dataclass(frozen=True)
class Sampler:
    """`nearest`: magFilter is NEAREST (9728) and minFilter is NEAREST (9728), so that a lookup
    is one texel of the full image; anything else, and what is not said, filters."""

    wrap_s: Wrap = Wrap.REPEAT
    wrap_t: Wrap = Wrap.REPEAT
    nearest: bool = False


@dataclass(frozen=True)
class TextureTransform:
    """KHR_texture_transform: scale, then rotate, then move (`rotation` in radians).

    The rotation is counter-clockwise as the image is seen. v points down the image, so

        u' = offset_u + cos(r) scale_u u + sin(r) scale_v v
        v' = offset_v - sin(r) scale_u u + cos(r) scale_v v

    as in the ratified text; an early draft had the signs of the sines exchanged.
    """

    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)

    def apply(self, uv: NDArray[Any]) -> NDArray[np.float64]:
        """Texture coordinates, (n, 2) or (…, 2) floats, transformed: float64 of the same shape."""
        u = uv[..., 0].astype(np.float64) * self.scale[0]
        v = uv[..., 1].astype(np.float64) * self.scale[1]
        if self.rotation:
            cos, sin = math.cos(self.rotation), math.sin(self.rotation)
            u, v = cos * u + sin * v, cos * v - sin * u
        return np.stack([u + self.offset[0], v + self.offset[1]], axis=-1)


@dataclass(frozen=True)
class MaskMaterial:
    """A material whose alpha mode is MASK: there where
    texture alpha x `factor` x vertex alpha >= `cutoff`.

    `texture`: index of its image, -1 without one (alpha 1). `unknown`: why the texture cannot
    be looked up, empty if it can; its alpha may then be anything from 0 to 1.

    Raises InputError where factor or cutoff is negative or not finite.
    """

    texture: int = -1
    sampler: Sampler = Sampler()
    factor: float = 1.0
    cutoff: float = 0.5
    unknown: str = ""

    def __post_init__(self) -> None:
        for name in ("factor", "cutoff"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise InputError(f"alpha {name} {getattr(self, name)} is not 0 or more")
