"""Sprites, as those who draw them and those who judge them both take them.

A sprite is a square of whole pixels that faces the camera, at the view depth of its centre: a
quad parallel to the image. It is placed as OpenGL places a wide point of an even size: its corner
is the pixel border nearest to where it belongs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visref.errors import InputError
from visref.scene import Float32


@dataclass(frozen=True, eq=False)
class Sprites:
    """`centres`: (n, 3) float32, world space; `side_px`: pixels on a side, all the same, an even
    number. Raises InputError where these do not hold."""

    centres: Float32
    side_px: int

    def __post_init__(self) -> None:
        if self.side_px < 2 or self.side_px % 2:
            raise InputError(
                f"sprites of {self.side_px} pixels", place="side_px", fix="give an even number"
            )
        if self.centres.dtype != np.float32 or not np.isfinite(self.centres).all():
            raise InputError("a sprite's centre is no finite float32", fix="mend the centres")
