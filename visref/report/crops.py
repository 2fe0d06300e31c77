"""The pictures of convicted objects on the page: what ought to be seen, and what was drawn."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from visref.run_folder.panels import PANEL_PX, panels
from visref.wording import legible

# A page carries pictures of at most so many objects, and of no more than take so many bytes as they
# stand in it, whichever comes first: about as much as its pictures of six frames.
MAX_CROPPED = 24
MAX_CROP_BYTES = 600_000
_COLOURS = 64


@dataclass(frozen=True)
class Crop:
    """One picture: its caption, the same for those who cannot see it, and the bytes."""

    title: str
    alt: str
    uri: str
    side: int = PANEL_PX


class CropBudget:
    """What a page may still carry, over all its runs and cullers."""

    def __init__(self) -> None:
        self._objects, self._bytes = MAX_CROPPED, MAX_CROP_BYTES

    def crops(self, witness: Mapping[str, Any] | None) -> tuple[Crop, ...]:
        """The two pictures of a witness's surroundings; none where it has no surroundings, or where
        they are more than the page takes."""
        if witness is None or "surroundings" not in witness or not self._objects:
            return ()
        name = legible(witness["object_name"])
        at = f"around pixel ({witness['x']}, {witness['y']}) of frame {witness['frame']}"
        says = {
            "ought": f"What ought to be seen {at}: {name}, in vermilion, among what surrounds it",
            "drawn": f"What was drawn {at}: the outline of {name}, and what shows in its place",
        }
        found = []
        for panel in panels(witness):
            if panel.what in says:
                content = io.BytesIO()
                panel.image.quantize(_COLOURS).save(content, format="PNG", optimize=True)
                uri = f"data:image/png;base64,{base64.b64encode(content.getvalue()).decode()}"
                found.append(Crop(panel.title, says[panel.what], uri))
        size = sum(len(crop.uri) for crop in found)
        if size > self._bytes:
            # What comes after is not shown either: the page lists the worst first.
            self._objects = 0
            return ()
        self._objects -= 1
        self._bytes -= size
        return tuple(found)
