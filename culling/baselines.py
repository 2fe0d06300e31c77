"""The baselines: no culling, the frustum alone, and a single occlusion query for each object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import ClassVar

import numpy as np

from visref.camera import Camera
from visref.culler import DrawnSet, Option, QueryStats
from visref.errors import InputError
from visref.scene import Int64
from visref_culling.gl.view import View
from visref_culling.method import GL_OPTIONS, QUERY_OPTIONS, Frame, GLCuller


class NoCulling(GLCuller):
    """Draws everything: what culling is measured against."""

    name = "none"
    memory = 0
    summary = "no culling: draws every object"
    notes_asked = True

    def in_frustum(self, view: View) -> Int64:
        """(k,) int64: the ids of all units that are not empty, ascending."""
        return np.sort(self.tree.ids)

    def decide(self, frame: Frame) -> None:
        self.draw(frame, np.arange(len(frame.ids)))


VIEWS_OPTION = {
    "views": Option(
        "each",
        "one set for each view of a frame, or one for all: what any needs",
        ("each", "union"),
    )
}


class ViewsCulling(GLCuller):
    """A method that may answer for all views of a frame together, with what any of them needs: one
    draw list for both eyes of a stereo image."""

    def __init__(self, *, views: str, depth: int, fragments: bool) -> None:
        super().__init__(depth=depth, fragments=fragments)
        self.joint = views == "union"

    def cull_joint(self, cameras: Sequence[Camera]) -> DrawnSet:
        """Each view is decided by itself. Costs add up; units come in the order in which a view
        first needed them."""
        answers = [self.cull(camera) for camera in cameras]
        if len(answers) == 1:
            return answers[0]
        ids = np.concatenate([np.zeros(0, np.int32), *(answer.unit_ids for answer in answers)])
        _, first = np.unique(ids, return_index=True)
        return DrawnSet(ids[np.sort(first)], sum_of([answer.stats for answer in answers]))


def sum_of(parts: Sequence[QueryStats]) -> QueryStats:
    """Counts and times added up; what one of them did not measure is not known of all."""
    total = QueryStats()
    for f in fields(QueryStats):
        values = [getattr(part, f.name) for part in parts]
        if f.name != "ms" and None not in values:
            setattr(total, f.name, sum(values))
    for part in parts:
        for phase, ms in part.ms.items():
            total.ms[phase] = total.ms.get(phase, 0.0) + ms
    return total


class FrustumCulling(ViewsCulling):
    """Draws what meets the view frustum, front to back."""

    name = "frustum"
    memory = 0
    summary = "view-frustum culling alone, by bounding boxes"
    notes_asked = True
    options: ClassVar[Mapping[str, Option]] = {**VIEWS_OPTION, **GL_OPTIONS}

    def __init__(self, *, views: str = "each", depth: int = 24, fragments: bool = False) -> None:
        super().__init__(views=views, depth=depth, fragments=fragments)

    def decide(self, frame: Frame) -> None:
        self.draw(frame, np.arange(len(frame.ids)))


class SingleQueryCulling(ViewsCulling):
    """Front to back, an occlusion query for each object's box before the object is drawn.

    The baseline of Staneker, Bartz, Meissner 2003 (section 2) and of most later papers. With
    `query=sync` each answer is waited for; the other ways ask `size` boxes together and then
    draw the visible ones, so that boxes of one group cannot be hidden by each other's objects.
    """

    name = "occlusion-query"
    memory = 0
    summary = "front to back, one occlusion query for each object's box"
    notes_asked = True
    options: ClassVar[Mapping[str, Option]] = {
        **QUERY_OPTIONS,
        "size": Option(64, "boxes asked together, unless query=sync"),
        **VIEWS_OPTION,
        **GL_OPTIONS,
    }

    def __init__(
        self,
        *,
        query: str = "sync",
        backfaces: bool = False,
        size: int = 64,
        views: str = "each",
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(views=views, depth=depth, fragments=fragments)
        if size < 1:
            raise InputError(f"size is {size}", place="size", fix="ask 1 box or more together")
        self.way = query
        self.query_back_faces = backfaces
        self.size = 1 if query == "sync" else size

    def decide(self, frame: Frame) -> None:
        every, any_sure = np.arange(len(frame.ids)), bool(frame.sure.any())
        for start in range(0, len(every), self.size):
            places = every[start : start + self.size]
            if any_sure:
                sure = frame.sure[places]
                self.draw(frame, places[sure])
                places = places[~sure]
            if len(places):
                self.draw(frame, places[self.query(frame, places)])
