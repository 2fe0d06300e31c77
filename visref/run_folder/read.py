"""Reading a run folder back."""

from __future__ import annotations

import json
import statistics
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from visref.errors import InputError
from visref.judging.status import Exit
from visref.run_folder.write import MANIFEST, VERDICT

_FIX = "give a folder that `visref run` or `visref check` wrote"

# The wall time of a culler's one call a frame; other phases are parts of it.
CULL_PHASE = "cull"

Row = dict[str, Any]


@dataclass(frozen=True)
class LostObject:
    """One object that a culler missed, over all frames: samples lost, in how many frames,
    and the row (of objects.parquet) of the frame that lost most."""

    pixels: int
    frames: int
    worst: Row


@dataclass(frozen=True, eq=False)
class RunRecord:
    """A run folder's content. `frames` and `timings` are rows of the tables, in file order."""

    folder: Path
    manifest: dict[str, Any]
    verdict: dict[str, Any]
    frames: list[Row]
    timings: list[Row]
    objects: pa.Table

    @property
    def exit(self) -> Exit:
        return Exit(self.verdict["exit_status"])

    @property
    def scene_name(self) -> str:
        """The scene's file name, without its folders."""
        return Path(self.manifest["scene"]["source"]).name or "scene"

    @cached_property
    def cullers(self) -> tuple[str, ...]:
        """Their names in the order they ran; those that never judged a frame come last."""
        ran = dict.fromkeys(row["culler"] for row in self.frames)
        return tuple(dict.fromkeys([*ran, *self.verdict["cullers"]]))

    @cached_property
    def frame_numbers(self) -> tuple[int, ...]:
        return tuple(sorted({row["frame"] for row in self.frames}))

    @cached_property
    def frames_of(self) -> dict[str, list[Row]]:
        """Each culler's rows of frames.parquet, by frame."""
        result: dict[str, list[Row]] = {culler: [] for culler in self.cullers}
        for row in sorted(self.frames, key=lambda row: row["frame"]):
            result[row["culler"]].append(row)
        return result

    @cached_property
    def cull_ms(self) -> dict[str, dict[int, float]]:
        """Milliseconds by culler and frame."""
        result: dict[str, dict[int, float]] = defaultdict(dict)
        for row in self.timings:
            if row["phase"] == CULL_PHASE:
                result[row["culler"]][row["frame"]] = row["ms"]
        return dict(result)

    @cached_property
    def truth_ms(self) -> float | None:
        """The median milliseconds of casting a frame's truth, None if none was cast."""
        times = [row["ms"] for row in self.timings if row["phase"] == "truth"]
        return statistics.median(times) if times else None

    def samples_of(self, frame: int) -> int:
        """How many samples a frame has."""
        definition = self.manifest["samples"][frame]
        return int(definition["width"]) * int(definition["height"])

    def resolution(self) -> str:
        """The judged frames' size in words."""
        sizes = {
            (self.manifest["samples"][frame]["width"], self.manifest["samples"][frame]["height"])
            for frame in self.frame_numbers
        }
        if len(sizes) != 1:
            return "several sizes"
        width, height = sizes.pop()
        return f"{width} × {height}"

    def missed_rows(self, culler: str) -> list[Row]:
        """The culler's rows of objects.parquet that tell of a miss or a doubt."""
        mine = pc.equal(self.objects["culler"], culler)
        told = pc.not_equal(self.objects["kind"], "superfluous")
        return _pylist(self.objects.filter(pc.and_(mine, told)))

    def lost_objects(self, culler: str) -> list[LostObject]:
        """Objects with a confirmed miss, the most samples lost first."""
        rows: dict[int, list[Row]] = defaultdict(list)
        for row in self.missed_rows(culler):
            if row["kind"] == "confirmed":
                rows[row["object"]].append(row)
        lost = [
            LostObject(
                sum(row["pixels"] for row in of_object),
                len(of_object),
                max(of_object, key=lambda row: (row["pixels"], -row["frame"])),
            )
            for of_object in rows.values()
        ]
        return sorted(lost, key=lambda one: (-one.pixels, one.worst["object"]))

    def superfluous_causes(self, culler: str) -> dict[str, int]:
        """Superfluous units by cause (`visref.run_folder.causes`), summed over the frames that were
        explained; empty where none was."""
        if "cause" not in self.objects.column_names:
            return {}
        mine = pc.and_(pc.equal(self.objects["culler"], culler), pc.is_valid(self.objects["cause"]))
        counts = pc.value_counts(self.objects["cause"].filter(mine))
        return {row["values"]: row["counts"] for row in counts.to_pylist()}

    def superfluous_units(self, culler: str) -> list[tuple[int, str, int]]:
        """(unit, name, frames) of what was drawn for nothing, the most often first; the name
        is empty unless units are objects."""
        # Only what is counted: of small units there are tens of millions of rows.
        table = self.objects.select(["culler", "kind", "unit", "name", "frame"])
        mine = pc.equal(table["culler"], culler)
        table = table.filter(pc.and_(mine, pc.equal(table["kind"], "superfluous")))
        counted = table.group_by(["unit", "name"]).aggregate([("frame", "count")])
        rows = [(row["unit"], row["name"] or "", row["frame_count"]) for row in _pylist(counted)]
        return sorted(rows, key=lambda row: (-row[2], row[0]))


def _pylist(table: pa.Table) -> list[Row]:
    rows: list[Row] = table.to_pylist()
    return rows


def read_run(folder: Path, *, objects: bool = True) -> RunRecord:
    """Read a run folder. Without its `objects`, of which there may be tens of millions, that table
    is empty. Raises InputError if it is none, or a file of it is spoilt."""
    if not (folder / MANIFEST).is_file():
        raise InputError(
            f"this is no run folder: it has no {MANIFEST}", source=str(folder), fix=_FIX
        )
    manifest = _read_json(folder / MANIFEST)
    if manifest.get("format") != "visref-run" or manifest.get("version") != 1:
        raise InputError(
            "this manifest is not a run's (format visref-run, version 1)",
            source=str(folder / MANIFEST),
            fix=_FIX,
        )
    return RunRecord(
        folder,
        manifest,
        _read_json(folder / VERDICT),
        _pylist(_read_table(folder / "frames.parquet")),
        _pylist(_read_table(folder / "timings.parquet")),
        _read_table(folder / "objects.parquet", "culler", "kind", "name")
        if objects
        else pa.table({}),
    )


def _read_json(file: Path) -> dict[str, Any]:
    try:
        value = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read it: {error}", source=str(file), fix=_FIX) from error
    if not isinstance(value, dict):
        raise InputError("it holds no JSON object", source=str(file), fix=_FIX)
    return value


def _read_table(file: Path, *repeated: str) -> pa.Table:
    """A table; its `repeated` columns hold few different texts, so each is kept once."""
    try:
        return pq.read_table(file, read_dictionary=list(repeated))
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError("cannot read this table", source=str(file), fix=_FIX) from error
