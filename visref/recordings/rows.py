"""The rows of a recording of visible sets, from JSON Lines, CSV and Parquet: `READERS`.

What they take is claimed before it is made; whoever wrote the file need not mean well.
"""

from __future__ import annotations

import csv
import io
import reprlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from visref.camera import ALL_VIEWS
from visref.culler import QueryStats, is_count, is_duration
from visref.errors import InputError
from visref.files import json_bytes, map_file, open_file, parse_json
from visref.memory import Budget
from visref.numerals import as_whole, whole_number
from visref.recordings.names import shown_name
from visref.scene import clean_name

_COUNTERS = {f.name for f in fields(QueryStats)} - {"ms"}
# Beyond float64; not one of Python's whole numbers without end.
_HUGE = 1 << 1024
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
# Rows at a time: what a batch takes beside the rows kept is small.
_BATCH = 1 << 16


Entry = int | str


@contextmanager
def reading(source: str) -> Iterator[None]:
    """Whatever goes wrong as a recording is read is one InputError that names the file."""
    try:
        yield
    except InputError as error:
        raise error.at(source=source) from error
    except OSError as error:
        raise InputError(
            f"cannot read it: {error.strerror}", source=source, fix="check its name"
        ) from error
    except MemoryError as error:
        raise InputError(
            "it needs more memory than there is", source=source, fix="record fewer frames at once"
        ) from error
    except UnicodeDecodeError as error:
        raise InputError("it is not UTF-8 text", source=source, fix="write it anew") from error


@dataclass(frozen=True)
class Row:
    """What a recording says of one frame, and where. `sets`: by view, or under `ALL_VIEWS` for all
    views together, what was drawn: ids and names, or where `nodes` the glTF nodes' indices.
    `bounds`: by name, the least and greatest corner of the box that was tested, in world space."""

    place: str
    frame: int
    sets: dict[str, list[Entry]]
    stats: QueryStats
    bounds: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = field(default_factory=dict)
    nodes: bool = False


# What `row_of` reads of a line.
ROW_FIELDS = ("frame", "visible", "visible_nodes", "stats", "bounds")


class JsonLines:
    """The lines of a file that are not empty, parsed one at a time: each fits `budget` alone.

    `cut_off`: where the last line is not whole, as if its writer had died, once all are read. With
    `whole` that is an error like any other line that is no JSON.
    """

    def __init__(self, path: Path, budget: Budget, *, whole: bool = True) -> None:
        self._path, self._budget, self._whole = path, budget, whole
        self.cut_off = ""

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        with open_file(self._path) as lines:
            for number in count(1):
                place = f"line {number}"
                # Nothing is left: then a line is refused, and not taken for the end.
                longest = max(1, self._budget.left // 4)
                line = lines.readline(longest)
                if number == 1:
                    line = line.removeprefix(_BYTE_ORDER_MARK)
                if not line:
                    return
                size = json_bytes(np.frombuffer(line, np.uint8))
                if len(line) == longest:
                    size = self._budget.left + 1
                elif not line.strip():
                    continue
                # Parsed, and a number for each entry.
                self._budget.need("the line", size + 40 * line.count(b","), place=place)
                try:
                    value = parse_json(line)
                except InputError as error:
                    if not self._whole and not line.endswith(b"\n"):
                        self.cut_off = place
                        return
                    raise InputError(
                        error.problem, place=place, fix="write an object a line"
                    ) from error
                yield place, value


def row_of(values: Any, place: str) -> Row:
    """A frame's row from its line. Raises InputError naming `place`."""
    drawn = []
    if isinstance(values, dict):
        drawn = [name for name in ("visible", "visible_nodes") if name in values]
    if not drawn or "frame" not in values:
        raise InputError(
            "a line needs 'frame' and 'visible'",
            place=place,
            fix='write {"frame": 0, "visible": [3, "name"]}',
        )
    if len(drawn) > 1:
        raise InputError(
            "both visible and visible_nodes", place=place, fix="give one of them in a line"
        )
    frame = as_whole(values["frame"])
    if isinstance(frame, bool) or not isinstance(frame, int):
        raise InputError(f"frame is {reprlib.repr(frame)}", place=place, fix="give an integer")
    nodes = drawn == ["visible_nodes"]
    return Row(
        place,
        frame,
        _sets(values[drawn[0]], drawn[0], place),
        _stats(values.get("stats", {}), place),
        _bounds(values.get("bounds", {}), place),
        nodes,
    )


def _json_lines(path: Path, budget: Budget) -> Iterator[Row]:
    for place, values in JsonLines(path, budget):
        yield row_of(values, place)


def _sets(visible: Any, name: str, place: str) -> dict[str, list[Entry]]:
    """One list for all views, or lists by view."""
    by_view = visible if isinstance(visible, dict) else {ALL_VIEWS: visible}
    nodes = name == "visible_nodes"
    kinds = {int} if nodes else {int, str}
    sets: dict[str, list[Entry]] = {}
    for view, entries in by_view.items():
        if isinstance(entries, list) and float in set(map(type, entries)):
            entries = list(map(as_whole, entries))
        if not isinstance(entries, list) or not set(map(type, entries)) <= kinds:
            of_view = "" if by_view is not visible else f" of view {shown_name(view)}"
            what, fix = ("node indices", "[3, 7]") if nodes else ("ids and names", "[3, 'name']")
            raise InputError(
                f"{name}{of_view} is not a list of {what}", place=place, fix=f"write {fix}"
            )
        sets[clean_name(view)] = entries
    return sets


def _bounds(values: Any, place: str) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    """Boxes by name."""
    if not isinstance(values, dict):
        raise InputError(
            "bounds is not an object", place=place, fix='write {"name": [[0,0,0],[1,1,1]]}'
        )
    boxes = {}
    for name, box in values.items():
        corners = box if isinstance(box, list) and len(box) == 2 else []
        numbers = [value for corner in corners if isinstance(corner, list) for value in corner]
        plain = all(type(value) in (int, float) and abs(value) < _HUGE for value in numbers)
        if len(numbers) != 6 or not plain or any(len(corner) != 3 for corner in corners):
            raise InputError(
                f"the box of {shown_name(name)} is no two corners of three numbers",
                place=place,
                fix="write [[least x, y, z], [greatest x, y, z]]",
            )
        low, high = (tuple(map(float, corner)) for corner in corners)
        if any(one > other for one, other in zip(low, high, strict=True)):
            raise InputError(
                f"the box of {shown_name(name)} has a least corner above its greatest",
                place=place,
                fix="write the least corner first; leave out what has no box",
            )
        boxes[clean_name(name)] = (low, high)
    return boxes


def _stats(values: Any, place: str) -> QueryStats:
    if not isinstance(values, dict):
        raise InputError("stats is not an object", place=place, fix="write {…}")
    stats = QueryStats()
    for name, value in values.items():
        if name == "ms" and isinstance(value, dict) and all(map(is_duration, value.values())):
            stats.ms = {clean_name(phase): float(ms) for phase, ms in value.items()}
        elif name in _COUNTERS and is_count(as_whole(value)):
            setattr(stats, name, as_whole(value))
        else:
            raise InputError(
                f"stats has {reprlib.repr(name)}: {reprlib.repr(value)}",
                place=place,
                fix='"ms" holds milliseconds by phase; known counters, whole numbers, are '
                + ", ".join(sorted(_COUNTERS)),
            )
    return stats


def _csv(path: Path, budget: Budget) -> Iterator[Row]:
    data = map_file(path)
    # The text twice, as bytes and characters; a row's object, its tuple and places.
    rows = np.count_nonzero((data == 10) | (data == 13))
    budget.claim("its rows", 5 * len(data) + 300 * int(rows))
    with io.TextIOWrapper(io.BytesIO(data.tobytes()), encoding="utf-8-sig", newline="") as file:
        reader = csv.DictReader(file)
        columns = reader.fieldnames or []
        column = _object_column(list(columns))
        by_view = "view" in columns
        frames: dict[int, tuple[str, dict[str, list[Entry]]]] = {}
        while (row := _csv_row(reader)) is not None:
            place = f"line {reader.line_num}"
            if None in row or None in row.values():
                raise InputError(
                    "the row has not as many fields as the header",
                    place=place,
                    fix="quote names that hold commas",
                )
            frame = _whole(row["frame"], "frame", place)
            view = clean_name(row["view"]) if by_view else ALL_VIEWS
            objects = frames.setdefault(frame, (place, {}))[1].setdefault(view, [])
            value = row[column]
            # A frame in which nothing was drawn is a row with an empty object.
            if value:
                by_id = column == "object_id"
                objects.append(_whole(value, column, place) if by_id else clean_name(value))
    for frame, (place, sets) in frames.items():
        yield Row(place, frame, sets, QueryStats())


def _csv_row(reader: csv.DictReader[str]) -> dict[str, str] | None:
    try:
        return next(reader, None)
    except csv.Error as error:
        raise InputError(
            f"not valid CSV: {str(error)[:200]}",
            place=f"line {reader.line_num}",
            fix="write it anew",
        ) from error


def _parquet(path: Path, budget: Budget) -> Iterator[Row]:
    data = map_file(path)
    frames: dict[int, dict[str, list[Entry]]] = {}
    index = 0
    try:
        with pq.ParquetFile(pa.BufferReader(pa.py_buffer(data))) as file:
            column = _object_column(file.schema_arrow.names)
            columns = ["frame", column, *(["view"] if "view" in file.schema_arrow.names else [])]
            _check_types(file.schema_arrow, columns)
            metadata = file.metadata
            # Counted by the file itself, and again by what comes out of it.
            budget.need(f"its {metadata.num_rows:,} rows", 200 * max(0, metadata.num_rows))
        # A name that is repeated stays one name.
        strings = [name for name in columns if name in ("object", "view")]
        source = pa.BufferReader(pa.py_buffer(data))
        with pq.ParquetFile(source, read_dictionary=strings) as file:
            for batch in file.iter_batches(batch_size=_BATCH, columns=columns):
                budget.claim(f"its first {index + len(batch):,} rows", 200 * len(batch))
                names = batch.column(column)
                budget.need("the names in it", names.nbytes * 5)
                views = [None] * len(batch)
                if "view" in columns:
                    budget.need("the views in it", batch.column("view").nbytes * 5)
                    views = _listed(batch.column("view"))
                for frame, value, view in zip(
                    _listed(batch.column("frame")), _listed(names), views, strict=True
                ):
                    place = f"row {index}"
                    index += 1
                    sets = frames.setdefault(_whole(frame, "frame", place), {})
                    objects = sets.setdefault(view or ALL_VIEWS, [])
                    if value is not None:
                        by_id = column == "object_id"
                        objects.append(_whole(value, column, place) if by_id else value)
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise InputError(
            "it is not a Parquet file, or not a whole one", fix="write it anew"
        ) from error
    for frame, sets in frames.items():
        yield Row(f"frame {frame}", frame, sets, QueryStats())


def _check_types(schema: Any, columns: list[str]) -> None:
    for name in columns:
        if schema.names.count(name) != 1:
            raise InputError(f"it has several columns '{name}'", place="header", fix="keep one")
        kind = schema.field(name).type
        if pa.types.is_dictionary(kind):
            kind = kind.value_type
        text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
        number = name not in ("object", "view") and pa.types.is_integer(kind)
        if not (text or number or (name != "frame" and pa.types.is_null(kind))):
            fixes = {"object": "write names as text, or object_id", "view": "write names as text"}
            raise InputError(
                f"{name} is of type {str(kind)[:80]}",
                place="header",
                fix=fixes.get(name, "give integers"),
            )


def _listed(array: Any) -> list[Any]:
    """A column's values; those of a dictionary are made once each."""
    if not pa.types.is_dictionary(array.type):
        return [clean_name(v) if isinstance(v, str) else v for v in array.to_pylist()]
    known = _listed(array.dictionary)
    return [None if i is None else known[i] for i in array.indices.to_pylist()]


def _object_column(columns: list[str]) -> str:
    if "frame" in columns:
        for column in ("object_id", "object"):
            if column in columns:
                return column
    raise InputError(
        f"columns are {', '.join(name[:40] for name in columns[:9]) or 'missing'}",
        place="header",
        fix="give 'frame' and 'object_id' or 'object'",
    )


def _whole(value: Any, column: str, place: str) -> int:
    try:
        if isinstance(value, int) and not isinstance(value, bool):
            return value
        if isinstance(value, str):
            return whole_number(value.strip(" \t"))
    except ValueError:
        pass
    raise InputError(f"{column} is {reprlib.repr(value)}", place=place, fix="give an integer")


READERS: dict[str, Callable[[Path, Budget], Iterator[Row]]] = {
    ".jsonl": _json_lines,
    ".ndjson": _json_lines,
    ".csv": _csv,
    ".parquet": _parquet,
}
