"""The frames of which the page shows pictures, and what each shows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from visref.judging.status import Status
from visref.report import words
from visref.report.caused import instances
from visref.report.embedded import data_uri, picture_of
from visref.report.owner_map import ObjectNames, owner_map
from visref.report.packed import packed
from visref.report.summary import CullerSummary
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import FrameRow, PictureSet
from visref.wording import legible

# Pictures are most of the page's weight, about 100 kB each: as they stand in it, over all its runs
# and cullers. What is left out is in the run folder.
MAX_PICTURE_BYTES = 3_500_000

_VIEWS = {
    "picture": "The scene",
    "drawn": "Who was drawn, and for what",
    "ids": "Objects",
    "errors": "Missed samples",
}


@dataclass(frozen=True)
class Picture:
    """An image of a frame: what it shows, and what is to be seen on it, in words, and the bytes."""

    what: str
    title: str
    uri: str
    says: str = ""


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
    `moved`: what moved since the frame before, in words; `owners`: whose each part of its pictures
    is, packed, empty where that is not on file."""

    frame: int
    view: str
    moved: str
    shared: dict[str, Picture]
    cullers: list[CullerView]
    owners: str

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


class PictureBudget:
    """What pictures a page may still carry, over all its runs."""

    def __init__(self) -> None:
        self._left = MAX_PICTURE_BYTES

    def takes(self, size: int) -> bool:
        """Whether so many bytes more are taken; else none of them are."""
        if size > self._left:
            return False
        self._left -= size
        return True


Place = tuple[int, str]


def frame_views(
    run: RunFolder, rows: Sequence[CullerSummary], budget: PictureBudget
) -> tuple[list[FrameView], int]:
    """The pictured views of frames, as many as the page takes, and how many it leaves out: first
    the worst of the object that each culler lost most of, of the next, and so on, and along with
    these one for each cause, the commonest first; then those in which most was lost; then the
    others."""
    by_view: dict[Place, dict[str, PictureSet]] = defaultdict(dict)
    for entry in run.manifest.pictures:
        by_view[entry.frame, entry.view][entry.culler] = entry
    of_row = {
        (row.culler, row.frame, view): row for row in run.frames for view in run.views_of(row)
    }
    names = ObjectNames(run, {frame for frame, _ in by_view})
    views = []
    for place in _by_weight(run, rows, by_view, of_row):
        view = _frame_view(run, place, by_view[place], of_row, names)
        if budget.takes(_size(view)):
            views.append(view)
    order = _order(run, by_view)
    views.sort(key=lambda view: order[view.frame, view.view])
    return views, len(by_view) - len(views)


def _order(run: RunFolder, by_view: Iterable[Place]) -> dict[Place, tuple[int, int]]:
    """By frame, and as the manifest has its views."""
    return {
        (frame, view): (frame, list(run.manifest.samples[frame]).index(view))
        for frame, view in by_view
    }


def _by_weight(
    run: RunFolder,
    rows: Sequence[CullerSummary],
    by_view: Mapping[Place, Mapping[str, PictureSet]],
    of_row: Mapping[tuple[str, int, str], FrameRow],
) -> list[Place]:
    """The pictured views, those that should be on the page first."""
    order = _order(run, by_view)
    ranks: dict[Place, int] = {}
    for row in rows:
        worst = [(lost.worst.frame, lost.worst.view) for lost in row.lost]
        mine = [at for at in dict.fromkeys(worst) if row.culler in by_view.get(at, ())]
        for rank, at in enumerate(mine):
            ranks[at] = min(rank, ranks.get(at, rank))
        for rank, at in enumerate(_of_causes(run, row.culler, by_view, ranks)):
            ranks[at] = min(rank, ranks.get(at, rank))
    lost = {
        place: sum(
            of_row[culler, *place].missed_pixels
            for culler, entry in entries.items()
            if "errors" in entry.files
        )
        for place, entries in by_view.items()
    }
    return sorted(
        by_view, key=lambda place: (ranks.get(place, len(by_view)), -lost[place], order[place])
    )


def _of_causes(
    run: RunFolder,
    culler: str,
    by_view: Mapping[Place, Mapping[str, PictureSet]],
    ranks: Mapping[Place, int],
) -> list[Place]:
    """A pictured view for each cause of a culler's misses, the commonest cause first: of those that
    show it the one that the page wants most already, else the one that loses most by it."""
    mine = {at for at, entries in by_view.items() if culler in entries}
    shown = instances(run, culler, mine)
    found: list[Place] = []
    for cause in run.verdict.cullers[culler].causes:
        places = [(one.frame, one.view) for one in shown.get(cause["cause"], ())]
        if places and not any(place in found for place in places):
            found.append(min(places, key=lambda place: ranks.get(place, len(by_view))))
    return found


def _frame_view(
    run: RunFolder,
    place: Place,
    entries: Mapping[str, PictureSet],
    of_row: Mapping[tuple[str, int, str], FrameRow],
    names: ObjectNames,
) -> FrameView:
    frame, view = place
    shared: dict[str, Picture] = {}
    owners = ""
    cullers = []
    for number, culler in enumerate(run.cullers):
        found = entries.get(culler)
        if found is None:
            continue
        pictures = {
            what: Picture(
                what,
                _VIEWS[what],
                data_uri(run, found.files[what], frame, view),
                _says(what, of_row[culler, *place]),
            )
            for what in _VIEWS
            if what in found.files and not (what in ("picture", "ids") and what in shared)
        }
        for what in ("picture", "ids"):
            if what in pictures:
                shared[what] = pictures.pop(what)
        if not owners and "owners" in found.files:
            owners = packed(
                owner_map(
                    picture_of(run, found.files["owners"], frame, view), names.of(frame, view)
                )
            )
        row = of_row[culler, frame, view]
        joint = len(run.views_of(row)) > 1
        cullers.append(CullerView(number, culler, row, joint, pictures))
    return FrameView(frame, view, words.moved_in(run, frame), shared, cullers, owners)


def _says(what: str, row: FrameRow) -> str:
    """What is to be seen on a picture of one culler's, for those who cannot."""
    if what == "drawn":
        counts = (
            f"{words.counted(row.drawn, 'unit')} drawn",
            f"{words.count(row.superfluous)} of them superfluous",
            f"{words.count(row.missed)} missed",
            f"{words.count(row.partly_missed)} partly",
        )
        return ", ".join(counts)
    return f"{words.counted(row.missed_pixels, 'sample')} lost" if what == "errors" else ""


def _size(view: FrameView) -> int:
    """How many bytes its pictures take in the page."""
    pictures = [*view.shared.values()]
    for one in view.cullers:
        pictures += one.pictures.values()
    return sum(len(picture.uri) for picture in pictures) + len(view.owners)
