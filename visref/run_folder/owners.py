"""Objects' ids as a picture, and read back from it."""

from __future__ import annotations

import numpy as np
from PIL import Image

from visref.scene import Int32


def owner_picture(owner: Int32) -> Image.Image:
    """Objects' ids, (h, w) int32, -1 for none, as a picture: an id and 1 more in 24 bits, red the
    highest."""
    shifted = (owner + 1).astype(np.uint32)
    return Image.fromarray(np.stack([shifted >> 16, shifted >> 8, shifted], -1).astype(np.uint8))


def owners_of(picture: Image.Image) -> Int32:
    """The ids, (h, w) int32, of such a picture."""
    red, green, blue = np.moveaxis(np.asarray(picture.convert("RGB"), np.int32), -1, 0)
    ids: Int32 = ((red << 16) + (green << 8) + blue) - 1
    return ids
