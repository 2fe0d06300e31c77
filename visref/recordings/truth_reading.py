"""Truth files, read: see `visref.recordings.truth_file`.

A file may have more rows than memory holds (a row per frame and object that shows). It is gone
through by row groups, and what a run asks of it, frame by frame, is put aside on disk.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.files import for_arrow
from visref.findings import Code, Finding
from visref.recordings.spool import Spool
from visref.recordings.truth_file import (
    FORMAT,
    KEY,
    SCHEMA,
    UNNAMED,
    VERSION,
    Columns,
    FrameRows,
    RecordedTruth,
    digest_of,
    path_digest,
    seal,
)
from visref.scene import Int64, Scene

_READABLE = (1, 2)
_FIX = "write one with `visref truth`"

# A frame and a view of it.
Cell = tuple[int, str]


class SpooledRows(Mapping[Cell, FrameRows]):
    """The rows of a truth file by frame and view, put aside. `owned`: by frame and view, all that
    there are, how many samples anything owns (None where the file does not say)."""

    def __init__(self, owned: Mapping[Cell, int | None]) -> None:
        self._owned = dict(owned)
        self._places: dict[Cell, list[tuple[int, int]]] = {}
        self._spool = Spool()

    def add(self, cell: Cell, objects: Int64, samples: Int64) -> None:
        """More rows of a cell: (k,) integers each."""
        at = self._spool.put_arrays([objects, samples])
        self._places.setdefault(cell, []).append(at)

    @property
    def in_pieces(self) -> list[Cell]:
        """Those whose rows were added in several pieces."""
        return [cell for cell, places in self._places.items() if len(places) > 1]

    def __getitem__(self, cell: Cell) -> FrameRows:
        owned = self._owned[cell]
        parts = [self._spool.get_arrays(at) for at in self._places.get(cell, ())]
        none = np.zeros(0, np.int64)
        objects, samples = (
            np.concatenate([none, *(part[column] for part in parts)]) for column in (0, 1)
        )
        return FrameRows(objects, samples, owned)

    def __iter__(self) -> Iterator[Cell]:
        return iter(self._owned)

    def __len__(self) -> int:
        return len(self._owned)


def read_truth(
    file: Path | str, scene: Scene, path: CameraPath, frames: Sequence[int]
) -> RecordedTruth:
    """Read a truth file for these frames of this scene and path.

    Raises InputError if it is no truth file, or belongs to another scene or path, or lacks
    one of the frames.
    """
    source = str(file)
    facts, span = _checked(Path(file), source, scene.object_count)
    for what, now in (("scene", scene.digest), ("path", path_digest(path))):
        if facts[what] != now:
            raise InputError(
                f"it was cast for another {what}", source=source, fix="cast the truth again"
            )
    wanted = set(frames)
    if not wanted <= set(facts["frames"]):
        raise InputError("it lacks frames of this run", source=source, fix="cast them all")
    if not _within(span, scene.object_count):
        raise InputError(
            "a row names an object that the scene lacks",
            source=source,
            place="object",
            fix="cast the truth again",
        )
    cells = _Cells(_cells(facts, path, source), source)
    sizes = _sizes(cells, path)
    rows = SpooledRows({cell: count for cell, count in cells.owned.items() if cell[0] in wanted})
    for table in _tables(_groups(Path(file)), source):
        cell_of = cells.of(table)
        _check_samples(table, sizes[cell_of], source)
        cells.share_out(table, cell_of, rows)
    _check_each_once(rows, source)
    unsealed = Finding(Code.TRUTH_UNSEALED, f"{source} is of version 1 and has no digest")
    findings = (unsealed,) if facts["version"] == 1 else ()
    return RecordedTruth(facts["engine"], facts.get("exact"), rows, findings)


class _Cells:
    """The frames and views that a file lists. `owned`: by each, how many samples anything owns."""

    def __init__(self, owned: Mapping[Cell, int | None], source: str) -> None:
        self.owned = owned
        self._source = source
        self._cells = list(owned)
        names = sorted({view for _, view in owned})
        place = {view: number for number, view in enumerate(names)}
        self._views = pa.array(names, pa.string())
        keys = np.array([frame * len(names) + place[view] for frame, view in owned], np.int64)
        self._order = np.argsort(keys)
        self._keys = keys[self._order]

    def of(self, table: pa.Table) -> Int64:
        """(k,) int64, which of them each row is of. Raises InputError for a row of another."""
        frames = table["frame"].to_numpy().astype(np.int64)
        views = np.zeros(len(table), np.int64)
        if "view" in table.column_names:
            found = pc.index_in(table["view"], value_set=self._views)
            views = pc.fill_null(found, -1).to_numpy().astype(np.int64)
        elif self._views.to_pylist() != [UNNAMED]:
            views -= 1
        keys = frames * len(self._views) + views
        at = np.searchsorted(self._keys, keys)
        known = (views >= 0) & (at < len(self._keys))
        known[known] = self._keys[at[known]] == keys[known]
        if not known.all():
            problem = "a row is of a frame or a view that its metadata does not list"
            raise _spoilt(self._source, problem)
        return np.asarray(self._order[at], np.int64)

    def share_out(self, table: pa.Table, cell_of: Int64, rows: SpooledRows) -> None:
        """Add the rows of what is in `rows`. Raises InputError where an object stands twice."""
        objects, samples = (table[name].to_numpy() for name in ("object", "pixels"))
        order = np.argsort(cell_of, kind="stable")
        starts = np.flatnonzero(np.diff(cell_of[order], prepend=-1))
        for at in np.split(order, starts[1:]) if len(order) else []:
            cell = self._cells[cell_of[at[0]]]
            _check_once(objects[at], self._source)
            if cell in rows:
                rows.add(cell, objects[at], samples[at])


def _check_once(objects: Int64, source: str) -> None:
    if len(np.unique(objects)) < len(objects):
        raise _spoilt(source, "an object stands twice in a frame")


def _check_each_once(rows: SpooledRows, source: str) -> None:
    """Where row groups part the rows of a frame and view."""
    for cell in rows.in_pieces:
        _check_once(rows[cell].objects, source)


def _cells(facts: dict[str, Any], path: CameraPath, source: str) -> dict[Cell, int | None]:
    """By frame and view, all that the file has: how many samples anything owns. Raises InputError
    where the lists do not go together, or name a frame or a view that the path lacks."""
    frames = facts["frames"]
    views = facts["views"] if facts["version"] > 1 else [UNNAMED] * len(frames)
    # Some files of version 1 do not say it.
    owned = facts.get("owned") or [None] * len(frames)
    known = {
        (frame, camera.view): camera.samples
        for frame in path.numbers
        for camera in path.views(frame)
    }
    cells: dict[Cell, int | None] = {}
    for cell, count in zip(zip(frames, views, strict=False), owned, strict=False):
        whole = count is None or (_is_whole(count) and count <= known.get(cell, 0))
        if cell not in known or cell in cells or not whole:
            break
        cells[cell] = count
    if not len(cells) == len(frames) == len(views) == len(owned):
        raise _spoilt(source, "its frames, views and owned samples do not go together")
    return cells


def _sizes(cells: _Cells, path: CameraPath) -> Int64:
    """(k, 2) int64, the width and height of each cell's image."""
    by_view = {
        (frame, camera.view): camera for frame in path.numbers for camera in path.views(frame)
    }
    sizes = [(by_view[cell].width, by_view[cell].height) for cell in cells.owned]
    return np.array(sizes, np.int64).reshape(-1, 2)


def _within(span: tuple[int, int], objects: int | None) -> bool:
    """Whether the least and the greatest object of all rows are of a scene with so many."""
    return span[0] >= 0 and (objects is None or span[1] < objects)


def _check_samples(table: pa.Table, sizes: Int64, source: str) -> None:
    """Raises InputError where a row tells of a sample that there is not. `sizes`: (k, 2) int64,
    each row's image."""
    x, y, pixels = (table[name].to_numpy().astype(np.int64) for name in ("x", "y", "pixels"))
    inside = (x >= 0) & (x < sizes[:, 0]) & (y >= 0) & (y < sizes[:, 1])
    counted = (pixels >= 1) & (pixels <= sizes[:, 0] * sizes[:, 1])
    if not (inside & counted & np.isfinite(table["depth"].to_numpy())).all():
        raise _spoilt(source, "a row tells of samples that its view does not have")
    if not set(pc.unique(table["status"]).to_pylist()) <= {"visible", "tie"}:
        raise _spoilt(source, "its status is neither 'visible' nor 'tie'")


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _spoilt(source: str, problem: str) -> InputError:
    return InputError(problem, source=source, fix="cast the truth again")


@dataclass(frozen=True, eq=False)
class TruthRows:
    """A truth file as it stands, without the scene and the path that it is of: what its metadata
    says, and its rows, which are read when they are asked for."""

    file: Path
    facts: dict[str, Any]

    @cached_property
    def cells(self) -> dict[Cell, int]:
        """By frame and view, how many samples anything owns."""
        lists = (self.facts[name] for name in ("frames", "views", "owned"))
        return {(frame, view): owned for frame, view, owned in zip(*lists, strict=True)}

    @cached_property
    def recorded(self) -> RecordedTruth:
        """By frame and view."""
        cells = _Cells(self.cells, str(self.file))
        rows = SpooledRows(self.cells)
        for table in self.tables():
            cells.share_out(table, cells.of(table), rows)
        _check_each_once(rows, str(self.file))
        return RecordedTruth(self.facts["engine"], self.facts["exact"], rows)

    def tables(self) -> Iterator[pa.Table]:
        """The rows, a row group at a time, as `visref.recordings.truth_file` describes them."""
        return _tables(_groups(self.file), str(self.file))


def can_be_merged(file: Path) -> bool:
    """Whether a truth file says that it is of version 2, which alone `read_rows` takes."""
    try:
        with for_arrow(file) as data, pq.ParquetFile(data) as opened:
            found = json.loads((opened.schema_arrow.metadata or {}).get(KEY, b"{}"))
    except (OSError, pa.ArrowException, ValueError, RecursionError):
        return False
    return isinstance(found, dict) and found.get("version") == VERSION


def read_rows(file: Path, objects: int | None = None) -> TruthRows:
    """A truth file of version 2, and of a scene with so many `objects` (None: any). Raises
    InputError where it is none, or was changed after it was written."""
    source = str(file)
    facts, span = _checked(file, source, objects)
    if facts["version"] != VERSION:
        raise InputError("it is of version 1", source=source, fix="cast the truth again")
    lists = [facts[name] for name in ("frames", "views", "owned")]
    whole = all(map(_is_whole, facts["owned"]))
    if (
        len(set(map(len, lists))) > 1
        or not whole
        or len(set(zip(*lists[:2], strict=True))) < len(lists[0])
    ):
        raise _spoilt(source, "its frames, views and owned samples do not go together")
    if not _within(span, objects):
        raise _spoilt(source, "a row names an object that there is not")
    return TruthRows(file, facts)


def write_joined(file: Path, parts: Sequence[TruthRows]) -> None:
    """Write the truth of all parts, of frames that ascend from one to the next, as if it had been
    cast at once; the caller has made the place safe."""
    first = parts[0].facts
    lists = {
        name: [value for part in parts for value in part.facts[name]]
        for name in ("frames", "views", "owned")
    }
    facts = {name: value for name, value in first.items() if name != "digest"}
    seal(file, [group for part in parts for group in _groups(part.file)], {**facts, **lists})


@dataclass(frozen=True)
class _Group:
    """A row group of a file, a column at a time."""

    file: Path
    number: int

    def __getitem__(self, name: str) -> pa.ChunkedArray:
        return self.read([name]).column(0)

    def read(self, names: Collection[str] | None = None) -> pa.Table:
        with for_arrow(self.file) as data, pq.ParquetFile(data) as opened:
            return opened.read_row_group(self.number, columns=names)


def _groups(file: Path) -> list[_Group]:
    with for_arrow(file) as data, pq.ParquetFile(data) as opened:
        return [_Group(file, number) for number in range(opened.num_row_groups)]


def _tables(groups: Sequence[_Group], source: str) -> Iterator[pa.Table]:
    """Their rows. Raises InputError where a row cannot be read, or a cell is empty."""
    for group in groups:
        try:
            table = group.read()
            # Texts that are not UTF-8 among them.
            table.validate(full=True)
        except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
            raise _unreadable(source) from error
        if any(column.null_count for column in table.columns):
            raise _spoilt(source, "its columns are not those of a truth file: a cell is empty")
        yield table


def _unreadable(source: str) -> InputError:
    return InputError("cannot read it as a truth file", source=source, fix=_FIX)


def _checked(
    file: Path, source: str, objects: int | None
) -> tuple[dict[str, Any], tuple[int, int]]:
    """What its metadata says, once that and the rows are of the form that `TruthTable` writes, and
    none was changed since; and the least and the greatest object that a row names, 0 and -1 where
    there is no row. `objects`: how many the scene has, None where that is not known."""
    facts, count = _facts(file, source)
    # An object has one row at most in each view of a frame; looked at before rows are made.
    if objects is not None and count > len(facts["frames"]) * objects:
        raise _spoilt(source, f"it has {count} rows, more than objects in its frames")
    groups = _groups(file)
    parts: list[Columns] = list(groups)
    least, greatest = 0, -1
    for table in _tables(groups, source):
        named = table["object"].to_numpy()
        least, greatest = named.min(initial=least), named.max(initial=greatest)
        if len(groups) == 1:
            parts = [table]
    if facts["version"] >= 2 and facts["digest"] != digest_of(parts, facts):
        raise _spoilt(source, "it was changed after it was written: its digest is another")
    return facts, (int(least), int(greatest))


def _facts(file: Path, source: str) -> tuple[dict[str, Any], int]:
    """What its metadata says, which is of the form that `TruthTable` writes, and how many rows
    there are."""
    if not file.is_file():
        raise InputError("there is no such truth file", source=source, fix=_FIX)
    try:
        with for_arrow(file) as data, pq.ParquetFile(data) as opened:
            found, count = opened.schema_arrow, opened.metadata.num_rows
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise _unreadable(source) from error
    try:
        facts = json.loads((found.metadata or {}).get(KEY, b"{}"))
    except (ValueError, RecursionError):
        facts = None
    if not isinstance(facts, dict) or facts.get("format") != FORMAT:
        raise InputError("this is not a truth file", source=source, fix=_FIX)

    version = facts.get("version")
    if not _is_whole(version) or version not in _READABLE:
        problem = f"its version is {version!r}, and this visref reads 1 to {VERSION}"
        raise _spoilt(source, problem)
    kinds: dict[str, type | tuple[type, ...]] = {
        "engine": str, "scene": str, "path": str, "ties_complete": bool, "frames": list,
    }  # fmt: skip
    schema = SCHEMA
    if version == 1:
        schema = schema.remove(schema.get_field_index("view"))
    else:
        kinds |= {"exact": (bool, type(None)), "views": list, "owned": list, "digest": str}
    odd = [
        name
        for name, kind in kinds.items()
        if name not in facts or not isinstance(facts[name], kind)
    ]
    if odd or not found.equals(schema):
        where = ", ".join(odd) or "columns"
        raise _spoilt(source, f"its {where} are not those of a truth file")
    if not all(map(_is_whole, facts["frames"])) or not all(
        isinstance(view, str) for view in facts.get("views", ())
    ):
        raise _spoilt(source, "its frames or views are not those of a truth file")
    return facts, count
