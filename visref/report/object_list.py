"""All that a run's cullers are convicted of, and what else they lost, as the page lists it.

A list has a column for each thing that is told, as arrays of numbers; what is said often, such as
names and causes, stands once in a table of its own. So 30,000 rows take about a megabyte.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from visref.report import words
from visref.report.crop_data import CropData
from visref.report.misses import cause_of, object_misses
from visref.report.summary import CullerSummary
from visref.run_folder.claims import witnesses_about
from visref.run_folder.layout import ObjectKind
from visref.run_folder.miss_facts import facts_text
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import HiddenUnit, LostObject
from visref.wording import legible

# Of so many objects of each culler, those that lose most, the witness is looked up: seconds.
MAX_LOOKED_UP = 2000
# What a column holds where there is nothing to tell.
NONE = -1

_COLUMNS = (
    "culler", "object", "name", "hidden", "samples", "frames", "misses", "partly", "frame", "view",
    "pixels", "owned", "x", "y", "depth", "triangle", "age", "margin", "cause", "why", "facts",
    "crop", "pictured",
)  # fmt: skip

Pictured = Sequence[tuple[int, str, str]]


class ObjectList:
    """The list of one run. `pictured`: (frame, view, culler) of each picture on the page, the
    likeliest to be looked at first."""

    def __init__(self, run: RunFolder, pictured: Pictured, crops: CropData) -> None:
        self._run = run
        self._crops = crops
        self._pictured = {place: number for number, place in enumerate(pictured)}
        self._columns: dict[str, list[Any]] = {name: [] for name in _COLUMNS}
        self._tables: dict[str, dict[str, int]] = {
            name: {} for name in ("names", "views", "causes", "whys", "facts")
        }

    def __len__(self) -> int:
        return len(self._columns["object"])

    def add(self, number: int, row: CullerSummary) -> None:
        """Add what the culler of that place lost, and what it drew against its promise."""
        run, culler = self._run, row.culler
        missed = object_misses(run, culler)
        texts = {cause["cause"]: cause["text"] for cause in run.verdict.cullers[culler].causes}
        some = row.lost[:MAX_LOOKED_UP]
        keys = {(one.worst.frame, one.worst.view, one.worst.object) for one in some}
        witnesses = witnesses_about(run.folder, run.manifest, culler, keys)
        shown = self._pictured_misses(culler)
        for lost in row.lost:
            worst = lost.worst
            its = missed.get(worst.object)
            codes = sorted(its.causes.items(), key=lambda item: (-item[1], item[0])) if its else []
            cause = texts.get(codes[0][0], codes[0][0]) if codes else ""
            witness = witnesses.get((worst.frame, worst.view, worst.object))
            why = cause_of(run, culler, its, doubts=True)
            self._add_lost(number, lost, cause, why, witness, shown.get(worst.object))
        for unit in row.hidden:
            self._add_hidden(number, row, unit)

    def _pictured_misses(self, culler: str) -> dict[int, int]:
        """By object that the culler lost in a pictured frame, the picture that shows most of it."""
        table = self._run.misses(culler, ObjectKind.CONFIRMED)
        if not len(table):
            return {}
        frames = {frame for frame, _, of in self._pictured if of == culler}
        best: dict[int, tuple[int, int]] = {}
        columns = (table[name].to_pylist() for name in ("frame", "view", "object", "pixels"))
        for frame, view, obj, pixels in zip(*columns, strict=True):
            if frame in frames and (frame, view, culler) in self._pictured:
                entry = -pixels, self._pictured[frame, view, culler]
                best[obj] = min(best.get(obj, entry), entry)
        return {obj: picture for obj, (_, picture) in best.items()}

    def _add_lost(
        self,
        number: int,
        lost: LostObject,
        cause: str,
        why: str,
        witness: Mapping[str, Any] | None,
        pictured: int | None,
    ) -> None:
        worst = lost.worst
        own = self._pictured.get((worst.frame, worst.view, self._run.cullers[number]))
        self._put(
            culler=number,
            object=worst.object,
            name=self._place("names", legible(worst.name)),
            hidden=0,
            samples=lost.samples,
            frames=lost.frames,
            misses=lost.misses,
            partly=lost.partly,
            frame=worst.frame,
            view=self._place("views", worst.view),
            pixels=worst.pixels,
            owned=worst.owned,
            x=worst.x,
            y=worst.y,
            depth=_short(worst.depth),
            triangle=worst.triangle,
            age=NONE if worst.age is None else worst.age,
            margin=NONE if worst.margin_px is None else _short(worst.margin_px, 3),
            cause=self._place("causes", cause),
            why=self._place("whys", why),
            facts=self._place("facts", facts_text(witness.get("facts", {})) if witness else ""),
            crop=self._crops.add(witness),
            pictured=own if own is not None else NONE if pictured is None else pictured,
        )

    def _add_hidden(self, number: int, row: CullerSummary, unit: HiddenUnit) -> None:
        self._put(
            culler=number,
            object=unit.unit,
            name=self._place("names", legible(words.hidden_name(row, unit))),
            hidden=1,
            samples=unit.samples,
            frames=unit.frames,
            misses=unit.frames,
            frame=unit.frame,
            view=self._place("views", unit.view),
            x=NONE if unit.x is None else unit.x,
            y=NONE if unit.y is None else unit.y,
            cause=self._place("causes", "drawn though hidden"),
            why=self._place("whys", legible(words.hidden_line(unit))),
            facts=self._place("facts", ""),
            pictured=self._pictured.get((unit.frame, unit.view, row.culler), NONE),
        )

    def _sizes(self) -> dict[str, tuple[int, int]]:
        """Width and height of what is pictured, by frame and view; under "" what is all views'."""
        sizes = self._run.sizes
        if len(sizes) == 1:
            return {"": next(iter(sizes))}
        return {f"{frame} {view}": self._run.size(frame, view) for frame, view, _ in self._pictured}

    def _put(self, **values: Any) -> None:
        for name, column in self._columns.items():
            column.append(values.get(name, NONE))

    def _place(self, table: str, text: str) -> int:
        its = self._tables[table]
        return its.setdefault(text, len(its))

    def data(self, rows: Sequence[CullerSummary], out: Path) -> dict[str, Any]:
        """What the page's script lists."""
        command = shlex.join(["visref", "explain", words.path_from(out, self._run.folder)])
        return {
            "cullers": [
                {"name": row.culler, "shown": legible(row.culler), "convicts": row.convicts}
                for row in rows
            ],
            "command": command,
            "columns": self._columns,
            "pictures": list(self._pictured),
            "sizes": self._sizes(),
            "crops": self._crops.take(),
            **{name: list(table) for name, table in self._tables.items()},
        }


def _short(value: float, digits: int = 6) -> float:
    """A number with few digits, which take less room."""
    return float(f"{value:.{digits}g}")
