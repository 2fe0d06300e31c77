"""A box's rectangle against depths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import some
from visref.causes.layers import Layers, Tested, ask
from visref.causes.sights import At, Sight
from visref.scene import Float64, Int32

Bool = NDArray[np.bool_]


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


def any_asked(at: At, rectangles: Int32, depths: Float64, counts: Bool | None = None) -> Bool:
    """(k,) whether some of the rectangles of each of `at.ids`, (k, m, 4) int32, is not hidden at
    (k, m) view depths by the depth of others, of those that count, (k, m)."""
    number = rectangles.shape[1]
    found = ask(
        at.now.layers(),
        rectangles.reshape(-1, 4),
        depths.reshape(-1),
        np.repeat(at.ids, number),
        own=at.own,
    )
    free = (found.passing > 0).reshape(-1, number)
    return some(free if counts is None else free & counts, 1)


def kept(at: At, passes: Bool) -> Bool:
    """The test of depth after the right one of the view."""
    boxes = at.boxes
    return boxes.in_view & (boxes.crossing | passes) | ~boxes.there


def by_box(at: At, layers: Layers) -> Bool:
    """(k,) the right test against these depths."""
    found = asked(at, at.boxes.rectangles, at.boxes.nearest, layers=layers).passing > 0
    return kept(at, found)


def by_sample(at: At, layers: Layers) -> Bool:
    """(k,) bool: some sample shows the unit's own triangles, among these depths."""
    owners = np.zeros(at.sights.units.count + 1, np.bool_)
    owners[layers.owner.reshape(-1)] = True
    return owners[at.ids] | ~at.boxes.there
