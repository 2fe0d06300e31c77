"""A frame for every cause that the page names: one with a picture, and in it the object that loses
most by that cause."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from urllib.parse import urlencode

import pyarrow as pa
import pyarrow.compute as pc

from visref.report.misses import why_lines
from visref.run_folder.layout import MISS_KINDS
from visref.run_folder.read import RunFolder
from visref.wording import legible

# A frame and a view that has pictures.
Place = tuple[int, str]


@dataclass(frozen=True)
class Instance:
    """An object that was missed by some cause, in a frame and view, and how many samples it lost
    there."""

    frame: int
    view: str
    object: int
    name: str
    pixels: int


@dataclass(frozen=True)
class Why:
    """A cause in words, and where the page shows it: `link` is a place on the page, `seen` what it
    leads to. Both are empty where no picture on the page shows it."""

    line: str
    link: str = ""
    seen: str = ""


def instances(run: RunFolder, culler: str, places: Collection[Place]) -> dict[str, list[Instance]]:
    """By cause, what a culler missed in these places, the most samples lost first."""
    table = run.objects
    found: dict[str, list[Instance]] = {}
    if not len(table) or not places:
        return found
    frames = pa.array(sorted({frame for frame, _ in places}), table["frame"].type)
    kinds = pa.array([kind.value for kind in MISS_KINDS])
    mine = pc.and_(pc.equal(table["culler"], culler), pc.is_in(table["frame"], frames))
    mine = pc.and_(mine, pc.is_in(table["kind"].cast(pa.string()), kinds))
    rows = table.filter(pc.and_(mine, pc.is_valid(table["cause"])))
    columns = (
        rows[name].to_pylist() for name in ("cause", "frame", "view", "object", "name", "pixels")
    )
    for cause, frame, view, obj, name, pixels in zip(*columns, strict=True):
        if (frame, view) in places:
            found.setdefault(cause, []).append(Instance(frame, view, obj, name, pixels or 0))
    for its in found.values():
        its.sort(key=lambda one: (-one.pixels, one.frame, one.view, one.object))
    return found


def whys(run: RunFolder, culler: str, places: Collection[Place], run_id: str) -> list[Why]:
    """Why things were missed, the commonest cause first, each with the worst that it did in the
    `places` of which the page has this culler's pictures."""
    causes = run.verdict.cullers[culler].causes
    shown = instances(run, culler, places)
    found = []
    for line, cause in zip(why_lines(causes), causes, strict=True):
        its = shown.get(cause["cause"])
        if not its:
            found.append(Why(line))
            continue
        worst = its[0]
        where = {
            **({} if run_id == "run0" else {"run": run_id}),
            "culler": culler,
            "frame": worst.frame,
            **({"view": worst.view} if worst.view else {}),
            "object": worst.object,
        }
        at = f"frame {worst.frame}" + (f", view {legible(worst.view)}" if worst.view else "")
        text = urlencode(where, errors="replace")
        found.append(Why(line, f"#{text}", f"{legible(worst.name)}, {at}"))
    return found
