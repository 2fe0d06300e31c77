"""Units of an engine, told beside its recording: meshlets, batches, chunks of a terrain.

A table (Parquet or CSV) with the columns `unit, object, first_triangle, triangle_count`: unit
numbers are dense from 0, and several rows may make one unit. `object` is an object's id, its name
or its path; `first_triangle` counts within the object, in the order of its file's primitives, with
degenerate triangles. Units may overlap, and each triangle of the scene is in one at least.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from visref.errors import InputError
from visref.files import map_file
from visref.findings import Code
from visref.memory import Budget
from visref.numerals import whole_number
from visref.recordings.names import Names, shown_name
from visref.scene import Int64, Scene, Units, clean_name

UNIT_KIND = "unit"

_COLUMNS = ("unit", "object", "first_triangle", "triangle_count")
_NUMBERS = ("unit", "first_triangle", "triangle_count")
# A row's numbers and its object, as Python holds them while they are read.
_ROW_BYTES = 400
_FIX = f"give the columns {', '.join(_COLUMNS)}"


def read_units(file: Path, scene: Scene, *, max_memory: int | None = None) -> Units:
    """The units of a file, .parquet or .csv, ready to be judged.

    Raises InputError, naming file and row, for a table of another form, an object or a triangle
    that the scene lacks, a number that is left out, and a triangle that is in no unit.
    """
    source = str(file)
    budget = Budget.of(max_memory)
    try:
        if file.suffix.lower() == ".csv":
            columns, objects = _csv(file, budget)
        elif file.suffix.lower() == ".parquet":
            columns, objects = _parquet(file, budget)
        else:
            raise InputError("units are .parquet or .csv", fix="rename it")
        return _units(columns, objects, scene, budget, source)
    except InputError as error:
        raise error.at(source=source) from error
    except OSError as error:
        raise InputError(
            f"cannot read it: {error.strerror}", source=source, fix="check its name"
        ) from error


def _csv(file: Path, budget: Budget) -> tuple[dict[str, Int64], list[int | str]]:
    data = map_file(file)
    budget.need(
        "its rows", 5 * len(data) + _ROW_BYTES * int(np.count_nonzero((data == 10) | (data == 13)))
    )
    try:
        text = data.tobytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("it is not UTF-8 text", fix="write it anew") from error
    reader = csv.DictReader(io.StringIO(text, newline=""))
    _check_columns(list(reader.fieldnames or []))
    numbers: dict[str, list[int]] = {name: [] for name in _NUMBERS}
    objects: list[int | str] = []
    try:
        for index, row in enumerate(reader):
            if None in row or None in row.values():
                raise InputError(
                    "the row has not as many fields as the header", place=f"row {index}", fix=_FIX
                )
            for name in _NUMBERS:
                numbers[name].append(_whole(row[name], name, index))
            value = row["object"]
            # What looks like an id is one; a name of digits is written as a path, `/7`.
            plain = value.isascii() and value.isdecimal() and len(value) < 12
            objects.append(int(value) if plain else clean_name(value))
    except csv.Error as error:
        place = f"line {reader.line_num}"
        raise InputError(
            f"not valid CSV: {str(error)[:200]}", place=place, fix="write it anew"
        ) from error
    return {name: np.array(values, np.int64) for name, values in numbers.items()}, objects


def _whole(text: str, name: str, index: int) -> int:
    try:
        value = whole_number(text.strip(" \t"))
        if -(1 << 62) < value < 1 << 62:
            return value
    except ValueError:
        pass
    raise InputError(
        f"{name} is {shown_name(text)}", place=f"row {index}", fix="give a whole number"
    )


def _parquet(file: Path, budget: Budget) -> tuple[dict[str, Int64], list[int | str]]:
    data = map_file(file)
    try:
        with pq.ParquetFile(pa.BufferReader(pa.py_buffer(data))) as opened:
            schema = opened.schema_arrow
            _check_columns(schema.names)
            for name in _NUMBERS:
                if not pa.types.is_integer(schema.field(name).type):
                    kind = str(schema.field(name).type)[:80]
                    raise InputError(
                        f"{name} is of type {kind}", place="header", fix="give integers"
                    )
            rows = max(0, opened.metadata.num_rows)
            budget.need(f"its {rows:,} rows", _ROW_BYTES * rows)
            table = opened.read(columns=list(_COLUMNS))
        budget.need("its names", 5 * table.nbytes)
        if any(column.null_count for column in table.columns):
            raise InputError("a cell is empty", place="rows", fix=_FIX)
        columns = {
            name: table[name].cast(pa.int64()).to_numpy().astype(np.int64) for name in _NUMBERS
        }
        values = table["object"].to_pylist()
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise InputError(
            "it is not a Parquet file, or not a whole one", fix="write it anew"
        ) from error
    if not set(map(type, values)) <= {int, str}:
        raise InputError(
            f"object is of type {str(table.schema.field('object').type)[:80]}",
            place="header",
            fix="give ids as integers, or names as text",
        )
    return columns, [clean_name(one) if isinstance(one, str) else one for one in values]


def _check_columns(names: list[str]) -> None:
    if any(names.count(name) != 1 for name in _COLUMNS):
        shown = ", ".join(name[:40] for name in names[:9]) or "missing"
        raise InputError(f"columns are {shown}", place="header", fix=_FIX)


def _units(
    columns: dict[str, Int64],
    objects: list[int | str],
    scene: Scene,
    budget: Budget,
    source: str,
) -> Units:
    unit, first, count = (columns[name] for name in _NUMBERS)
    dropped = [text for code, text in scene.notes if code == Code.NONFINITE_DROPPED]
    if dropped:
        raise InputError(
            f"its triangles are counted with those that are left out: {dropped[0]}",
            fix="mend the mesh",
        )
    if not len(unit):
        raise InputError("there are no units in it", fix="write a row per unit")
    object_of_row = _ids(objects, scene, source)
    sizes = np.diff(scene.object_offsets)[object_of_row]
    outside = (first < 0) | (count < 1) | (first > sizes) | (count > sizes - first)
    if outside.any():
        row = int(np.argmax(outside))
        raise InputError(
            f"triangles {first[row]} to {first[row] + count[row] - 1} are not all of the "
            f"{sizes[row]} of object '{scene.names[object_of_row[row]]}'",
            place=f"row {row}",
            fix="count from 0 within the object",
        )
    present = np.unique(unit)
    gaps = np.flatnonzero(present != np.arange(len(present)))
    if len(gaps):
        problem = f"unit {present[gaps[0]]} comes after unit {present[gaps[0] - 1]}"
        if not gaps[0]:
            problem = f"the first unit is {present[0]}"
        raise InputError(problem, place="unit", fix="number the units 0, 1, 2, …")
    budget.need("the units' triangles", 24 * int(count.sum()))
    order = np.argsort(unit, kind="stable")
    start, count = scene.object_offsets[object_of_row[order]] + first[order], count[order]
    ends = np.cumsum(count)
    triangles = np.repeat(start - (ends - count), count) + np.arange(ends[-1])
    offsets = np.concatenate([[0], ends[np.searchsorted(unit[order], present, side="right") - 1]])
    covered = np.zeros(scene.triangle_count, np.bool_)
    covered[triangles] = True
    if not covered.all():
        bare = int(np.argmin(covered))
        owner = int(scene.object_of_triangle[bare])
        raise InputError(
            f"{np.count_nonzero(~covered)} triangles are in no unit, first triangle "
            f"{bare - int(scene.object_offsets[owner])} of object '{scene.names[owner]}'",
            fix="give every triangle a unit, that of what is always drawn too",
        )
    return Units(offsets.astype(np.int64), triangles.astype(np.int32), UNIT_KIND)


def _ids(objects: list[int | str], scene: Scene, source: str) -> Int64:
    """(r,) int64, the object of each row."""
    known: dict[int | str, int] = {}
    places: dict[str, str] = {}
    for index, entry in enumerate(objects):
        if isinstance(entry, str):
            places.setdefault(entry, f"row {index}")
        elif entry not in known:
            if not 0 <= entry < scene.object_count:
                raise InputError(
                    f"object id {entry} is not in the scene (0…{scene.object_count - 1})",
                    place=f"row {index}",
                    fix="use the ids of `visref objects`",
                )
            known[entry] = entry
    for name, ids in Names(scene).resolved(places, source).items() if places else ():
        if len(ids) > 1:
            raise InputError(
                f"{shown_name(name)} is a group of {len(ids)} objects",
                place=places[name],
                fix="give a row for each of its objects, by id",
            )
        known[name] = ids[0]
    return np.array([known[entry] for entry in objects], np.int64)
