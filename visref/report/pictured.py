"""The frames of which the page shows pictures, and what each shows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from visref.judging.status import Status
from visref.picking import evenly_picked
from visref.report import words
from visref.report.embedded import data_uri
from visref.report.summary import CullerSummary
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import FrameRow, PictureSet
from visref.wording import legible

# Pictures are most of the page's weight: about 100 kB each.
MAX_FRAMES = 12

_VIEWS = {
    "picture": "The scene",
    "drawn": "Who was drawn, and for what",
    "ids": "Objects",
    "errors": "Missed samples",
}


@dataclass(frozen=True)
class Picture:
    """An image of a frame: what it shows, in words, and the bytes."""

    what: str
    title: str
    uri: str


@dataclass(frozen=True)
class CullerView:
    """One culler's part of a frame of the browser. `row` is that of its drawn set, which is for all
    views of the frame where it is `joint`."""

    number: int
    culler: str
    row: FrameRow
    joint: bool
    pictures: dict[str, Picture]


@dataclass(frozen=True)
class FrameView:
    """A view of a frame in the browser: pictures that all cullers share, and each culler's own.
    `moved`: what moved since the frame before, in words."""

    frame: int
    view: str
    moved: str
    shared: dict[str, Picture]
    cullers: list[CullerView]

    @property
    def title(self) -> str:
        return f"Frame {self.frame}" + (f", view {legible(self.view)}" if self.view else "")

    @property
    def visible(self) -> int | None:
        """Objects that are visible in this view; None where no culler's set was for it alone."""
        return next((one.row.visible for one in self.cullers if not one.joint), None)


def opens_at(
    rows: Sequence[CullerSummary], frames: Sequence[FrameView]
) -> tuple[int, int, str] | None:
    """Where the browser opens, (culler number, frame, view): at the worst pictured violation, else
    the worst miss, else the last culler's first frame."""
    candidates = [
        (
            rows[one.number].status is Status.VIOLATION,
            one.row.missed_pixels,
            # Of the views of one set, one in which something is lost.
            "errors" in one.pictures,
            one.number,
            -index,
        )
        for index, view in enumerate(frames)
        for one in view.cullers
    ]
    if not candidates:
        return None
    *_, number, index = max(candidates)
    return number, frames[-index].frame, frames[-index].view


def frame_views(run: RunFolder) -> tuple[list[FrameView], int]:
    """The pictured views of frames: all, or those that lost most and the rest evenly picked."""
    by_view: dict[tuple[int, str], dict[str, PictureSet]] = defaultdict(dict)
    for entry in run.manifest.pictures:
        by_view[entry.frame, entry.view][entry.culler] = entry
    rows = {(row.culler, row.frame, view): row for row in run.frames for view in run.views_of(row)}
    order = {
        (frame, view): (frame, place)
        for frame in {frame for frame, _ in by_view}
        for place, view in enumerate(run.manifest.samples[frame])
    }
    lost = {
        (frame, view): sum(
            rows[culler, frame, view].missed_pixels
            for culler, entry in entries.items()
            if "errors" in entry.files
        )
        for (frame, view), entries in by_view.items()
    }
    guilty = sorted((one for one in lost if lost[one]), key=lambda one: (-lost[one], order[one]))
    chosen = guilty[: MAX_FRAMES // 2]
    others = sorted(set(by_view) - set(chosen), key=order.__getitem__)
    room = MAX_FRAMES - len(chosen)
    others = [others[i] for i in evenly_picked(len(others), room)]
    views = []
    for frame, view in sorted([*chosen, *others], key=order.__getitem__):
        shared: dict[str, Picture] = {}
        cullers = []
        for number, culler in enumerate(run.cullers):
            found = by_view[frame, view].get(culler)
            if found is None:
                continue
            pictures = {
                what: Picture(what, _VIEWS[what], data_uri(run, found.files[what], frame, view))
                for what in _VIEWS
                if what in found.files and not (what in ("picture", "ids") and what in shared)
            }
            for what in ("picture", "ids"):
                if what in pictures:
                    shared[what] = pictures.pop(what)
            row = rows[culler, frame, view]
            joint = len(run.views_of(row)) > 1
            cullers.append(CullerView(number, culler, row, joint, pictures))
        views.append(FrameView(frame, view, words.moved_in(run, frame), shared, cullers))
    return views, len(by_view) - len(views)
