"""The rows of a recording of visible sets, from JSON Lines, CSV and Parquet: `READERS`.

What they take is claimed before it is made; whoever wrote the file need not mean well.
"""

from __future__ import annotations

import csv
import io
import reprlib
from collections.abc import Callable, Iterator
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
from visref.numerals import whole_number
from visref.recordings.names import shown_name
from visref.scene import clean_name

_COUNTERS = {f.name for f in fields(QueryStats)} - {"ms"}
# Beyond float64; not one of Python's whole numbers without end.
_HUGE = 1 << 1024
# Rows at a time: what a batch takes beside the rows kept is small.
_BATCH = 1 << 16


@dataclass(frozen=True)
class Row:
    """What a recording says of one frame, and where. `sets`: by view, or under `ALL_VIEWS` for all
    views together, the ids and names of what was drawn. `bounds`: by name, the least and greatest
    corner of the box that was tested, in world space."""

    place: str
    frame: int
    sets: dict[str, list[int | str]]
    stats: QueryStats
    bounds: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = field(default_factory=dict)


def _json_lines(path: Path, budget: Budget) -> Iterator[Row]:
    with open_file(path) as lines:
        for number in count(1):
            place = f"line {number}"
            longest = budget.left // 4
            line = lines.readline(longest)
            if not line:
                return
            size = json_bytes(np.frombuffer(line, np.uint8))
            if len(line) == longest:
                size = budget.left + 1
            elif not line.strip():
                continue
            # Parsed, and an entry's tuple and place in three lists.
            budget.claim("its lines up to here", size + 160 * line.count(b","), place=place)
            try:
                row = parse_json(line)
            except InputError as error:
                raise InputError(
                    error.problem, place=place, fix="write an object a line"
                ) from error
            if not isinstance(row, dict) or "frame" not in row or "visible" not in row:
                raise InputError(
                    "a line needs 'frame' and 'visible'",
                    place=place,
                    fix='write {"frame": 0, "visible": [3, "name"]}',
                )
            if isinstance(row["frame"], bool) or not isinstance(row["frame"], int):
                raise InputError(
                    f"frame is {reprlib.repr(row['frame'])}", place=place, fix="give an integer"
                )
            sets = _sets(row["visible"], place)
            stats = _stats(row.get("stats", {}), place)
            yield Row(place, row["frame"], sets, stats, _bounds(row.get("bounds", {}), place))


def _sets(visible: Any, place: str) -> dict[str, list[int | str]]:
    """One list for all views, or lists by view."""
    by_view = visible if isinstance(visible, dict) else {ALL_VIEWS: visible}
    sets: dict[str, list[int | str]] = {}
    for view, entries in by_view.items():
        if not isinstance(entries, list) or not all(
            isinstance(entry, (int, str)) and not isinstance(entry, bool) for entry in entries
        ):
            of_view = "" if by_view is not visible else f" of view {shown_name(view)}"
            raise InputError(
                f"visible{of_view} is not a list of ids and names",
                place=place,
                fix="write [3, 'name']",
            )
        sets[clean_name(view)] = [
            clean_name(entry) if isinstance(entry, str) else entry for entry in entries
        ]
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
            stats.ms = {phase: float(ms) for phase, ms in value.items()}
        elif name in _COUNTERS and is_count(value):
            setattr(stats, name, value)
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
        frames: dict[int, tuple[str, dict[str, list[int | str]]]] = {}
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
    frames: dict[int, dict[str, list[int | str]]] = {}
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
