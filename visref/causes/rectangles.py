"""A box's rectangle against depths."""

from __future__ import annotations

from visref.causes.layers import Layers, Tested, ask
from visref.causes.sights import At, Sight
from visref.scene import Float64, Int32


def asked(
    at: At,
    rectangles: Int32,
    depths: Float64,
    *,
    sight: Sight | None = None,
    layers: Layers | None = None,
    own: bool = False,
    whole: bool = False,
) -> Tested:
    """Ask the depth of others (of now, or of another sight or of these layers) about the rectangles
    of `at.ids`, (k, 4) int32, at (k,) view depths."""
    if layers is None:
        layers = (sight or at.now).layers()
    return ask(layers, rectangles, depths, at.ids, own=own or at.own, whole=whole)
