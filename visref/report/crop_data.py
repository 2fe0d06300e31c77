"""What lies around a witness, as the page's script draws it: cells, each with what is seen there,
so that whatever the pointer is at can be named."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from visref.report.packed import deflated
from visref.run_folder.colours import BRIGHTEST, DARKEST, pastel, srgb
from visref.run_folder.layout import OTHERS, SHADES
from visref.wording import legible

# All crops of a page together, as they stand in it.
MAX_BYTES = 2_000_000
# Base64 takes four bytes for three.
_GROWN = 4 / 3


class CropData:
    """The crops of a page, as far as it may carry them, over all its runs and cullers: of the
    objects that are added first."""

    def __init__(self) -> None:
        self._left = MAX_BYTES / _GROWN
        self._crops: list[dict[str, Any]] = []

    def add(self, witness: Mapping[str, Any] | None) -> int:
        """The crop's place in what `take` gives next; -1 where a witness has none, or the page
        takes no more."""
        if witness is None or "surroundings" not in witness or self._left <= 0.0:
            return -1
        crop = _crop(witness["surroundings"])
        size = len(deflated(json.dumps(crop, separators=(",", ":")).encode("utf-8", "replace")))
        if size > self._left:
            self._left = 0.0
            return -1
        self._left -= size
        self._crops.append(crop)
        return len(self._crops) - 1

    def take(self) -> list[dict[str, Any]]:
        """The crops that were added since the last time."""
        crops, self._crops = self._crops, []
        return crops


def _crop(around: Mapping[str, Any]) -> dict[str, Any]:
    """`at`: the sample of the first cell, and how far apart two are. `looks`: by appearance its
    colour, its object's place among `names` or -1, and whether it is lost. The cells of what ought
    to be seen, and of what was drawn, are run lengths: so many of an appearance, and so on."""
    looks = around["appearances"]
    names = {one["object"]: place for place, one in enumerate(around["objects"])}
    objects = np.array([-1 if one["object"] is None else one["object"] for one in looks], np.int64)
    shares = np.array([one["shade"] for one in looks], np.float64) / (SHADES - 1)
    light = DARKEST + shares * (BRIGHTEST - DARKEST)
    colours = srgb(pastel(np.maximum(objects, 0)) * light[:, None])
    hexes = np.round(colours * 255.0).astype(np.uint8)
    told = []
    for one, colour in zip(looks, hexes, strict=True):
        seen = one["glass"] if one["glass"] is not None else one["object"]
        known = seen is not None and one["object"] is not None and one["object"] != OTHERS
        shown = "#" + colour.tobytes().hex() if known else ""
        told.append([shown, names.get(seen, -1), int(one["lost"])])
    return {
        "at": [around["x"], around["y"], around["step"]],
        "size": [around["width"], around["height"]],
        "names": [legible(one["name"]) for one in around["objects"]],
        "looks": told,
        "truth": around["truth"],
        "drawn": around["drawn"],
    }
