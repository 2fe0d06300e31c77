"""What lies around a witness, as the page's script draws it: cells, each with what is seen there,
so that whatever the pointer is at can be named."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from visref.report.packed import deflated, run_lengths
from visref.run_folder.colours import BRIGHTEST, DARKEST, pastel, srgb
from visref.run_folder.layout import OTHERS, SHADES
from visref.scene import Int64
from visref.wording import legible

# All crops of a page together, as they stand in it; and of these, those that are whole. Beyond them
# come small ones: of so many cells a side.
MAX_BYTES = 2_000_000
WHOLE_BYTES = 1_000_000
SMALL_CELLS = 24
# Base64 takes four bytes for three.
_GROWN = 4 / 3


class CropData:
    """The crops of a page, as far as it may carry them, over all its runs and cullers: whole ones
    of the objects that are added first, then small ones."""

    def __init__(self) -> None:
        self._left = MAX_BYTES / _GROWN
        self._whole = WHOLE_BYTES / _GROWN
        self._crops: list[dict[str, Any]] = []

    def add(self, witness: Mapping[str, Any] | None) -> int:
        """The crop's place in what `take` gives next; -1 where a witness has none, or the page
        takes no more."""
        if witness is None or "surroundings" not in witness or self._left <= 0.0:
            return -1
        crop = _crop(witness["surroundings"])
        size = _size(crop)
        if size > self._whole:
            self._whole = 0.0
            crop = _small(crop)
            size = _size(crop)
        self._whole -= size
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


def _size(crop: Mapping[str, Any]) -> int:
    return len(deflated(json.dumps(crop, separators=(",", ":")).encode("utf-8", "replace")))


def _small(crop: dict[str, Any]) -> dict[str, Any]:
    """At most `SMALL_CELLS` a side: the middle, about what was lost, where that is small; else
    every so many-th cell, of which some are lost."""
    width, height = crop["size"]
    truth, drawn = (_cells(crop[name]).reshape(height, width) for name in ("truth", "drawn"))
    lost = np.array([look[2] for look in crop["looks"]], np.bool_)[truth]
    y, x = np.nonzero(lost) if lost.any() else np.array([[height // 2], [width // 2]])
    span = int(max(np.ptp(y), np.ptp(x))) + 1
    step = -(-max(width, height) // SMALL_CELLS) if 2 * span > SMALL_CELLS else 1
    parts = []
    for at, side in ((y, height), (x, width)):
        first = int(at.min()) % step
        if step == 1:
            middle = int(at.min() + at.max()) // 2
            first = min(max(middle - SMALL_CELLS // 2, 0), max(side - SMALL_CELLS, 0))
        parts.append(slice(first, first + step * SMALL_CELLS, step))
    rows, columns = parts
    truth, drawn = truth[rows, columns], drawn[rows, columns]
    used, place = np.unique(np.concatenate([truth.ravel(), drawn.ravel()]), return_inverse=True)
    looks = [crop["looks"][look] for look in used.tolist()]
    named = sorted({look[1] for look in looks} - {-1})
    left, top, apart = crop["at"]
    return {
        "at": [left + columns.start * apart, top + rows.start * apart, apart * step],
        "size": [truth.shape[1], truth.shape[0]],
        "names": [crop["names"][name] for name in named],
        "looks": [
            [colour, named.index(name) if name >= 0 else -1, gone] for colour, name, gone in looks
        ],
        "truth": run_lengths(place[: truth.size]),
        "drawn": run_lengths(place[truth.size :]),
    }


def _cells(runs: list[int]) -> Int64:
    lengths, values = np.array(runs, np.int64).reshape(-1, 2).T
    return np.repeat(values, lengths)


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
