"""The baselines: no culling, the frustum alone, and a single occlusion query for each object."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from visref.culler import Option
from visref.errors import InputError
from visref.scene import Int64
from visref_culling.gl.view import View
from visref_culling.method import GL_OPTIONS, QUERY_OPTIONS, Frame, GLCuller


class NoCulling(GLCuller):
    """Draws everything: what culling is measured against."""

    name = "none"
    summary = "no culling: draws every object"
    notes_asked = True

    def in_frustum(self, view: View) -> Int64:
        """(k,) int64: the ids of all units that are not empty, ascending."""
        return np.sort(self.tree.ids)

    def decide(self, frame: Frame) -> None:
        self.draw(frame, np.arange(len(frame.ids)))


class FrustumCulling(GLCuller):
    """Draws what meets the view frustum, front to back."""

    name = "frustum"
    summary = "view-frustum culling alone, by bounding boxes"
    notes_asked = True

    def decide(self, frame: Frame) -> None:
        self.draw(frame, np.arange(len(frame.ids)))


class SingleQueryCulling(GLCuller):
    """Front to back, an occlusion query for each object's box before the object is drawn.

    The baseline of Staneker, Bartz, Meissner 2003 (section 2) and of most later papers. With
    `query=sync` each answer is waited for; the other ways ask `size` boxes together and then
    draw the visible ones, so that boxes of one group cannot be hidden by each other's objects.
    """

    name = "occlusion-query"
    summary = "front to back, one occlusion query for each object's box"
    notes_asked = True
    options: ClassVar[Mapping[str, Option]] = {
        **QUERY_OPTIONS,
        "size": Option(64, "boxes asked together, unless query=sync"),
        **GL_OPTIONS,
    }

    def __init__(
        self,
        *,
        query: str = "sync",
        backfaces: bool = False,
        size: int = 64,
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(depth=depth, fragments=fragments)
        if size < 1:
            raise InputError(f"size is {size}", place="size", fix="ask 1 box or more together")
        self.way = query
        self.query_back_faces = backfaces
        self.size = 1 if query == "sync" else size

    def decide(self, frame: Frame) -> None:
        for start in range(0, len(frame.ids), self.size):
            places = np.arange(start, min(start + self.size, len(frame.ids)))
            sure = frame.sure[places]
            self.draw(frame, places[sure])
            unsure = places[~sure]
            if len(unsure):
                self.draw(frame, unsure[self.query(frame, unsure)])
