"""Tables from Parquet, of the house's columns: whatever else a file holds is refused before its
rows are made, and so is what no row of ours says.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from visref.errors import InputError
from visref.files import for_arrow
from visref.run_folder.inside import file_inside, quoted
from visref.run_folder.layout import SINCE_VERSION_2

_REPEATED = pa.dictionary(pa.int32(), pa.string())


def table_inside(
    folder: Path,
    name: str,
    schema: pa.Schema,
    version: int,
    fix: str,
    *,
    required: frozenset[str],
    most: int,
    repeated: tuple[str, ...] = (),
    views: bool = True,
) -> pa.Table:
    """A table of a run folder of this version, with the columns of `schema`; those that it lacks,
    and need not have, are null. Of a column that is `repeated`, which holds few different texts,
    each is kept once. `views`: whether its rows are of views.

    Raises InputError for a file that is no such table: another kind of column, a column that
    stands twice, an empty cell in one that is `required`, more than `most` rows.
    """
    file = file_inside(folder, name, fix)

    def spoilt(problem: str) -> InputError:
        return InputError(problem, source=str(file), fix=fix)

    try:
        with for_arrow(file) as data, pq.ParquetFile(data) as opened:
            found, rows = opened.schema_arrow, opened.metadata.num_rows
        if rows > most:
            raise spoilt(f"it has {rows} rows, where at most {most} can be")
        # An unknown column is somebody else's.
        names = [column for column in schema.names if column in found.names]
        of_views = {"view"} if views else set[str]()
        needed = required | of_views if version >= 2 else required.difference(SINCE_VERSION_2)
        if missing := sorted(needed.difference(names)):
            raise spoilt(f"it has no column '{missing[0]}'")
        for column in names:
            if found.names.count(column) > 1:
                raise spoilt(f"its column '{column}' stands twice")
            kind = found.field(column).type
            plain = kind.value_type if pa.types.is_dictionary(kind) else kind
            if plain != schema.field(column).type:
                raise spoilt(f"its column '{column}' holds {kind}, not {schema.field(column).type}")
        read = [column for column in repeated if column in names]
        with for_arrow(file) as data:
            table = pq.read_table(data, columns=names, read_dictionary=read)
        # Texts that are not UTF-8 among them.
        table.validate(full=True)
        rows = len(table)
        columns = {}
        for field in schema:
            kind = _REPEATED if field.name in read else field.type
            cells = table[field.name].cast(kind) if field.name in names else _absent(field, rows)
            if field.name in needed and cells.null_count:
                raise spoilt(f"its column '{field.name}' has an empty cell")
            if pa.types.is_string(field.type) and _has_nul(cells):
                raise spoilt(f"a text of its column '{field.name}' holds NUL")
            columns[field.name] = cells
        # Each row group has dictionaries of its own, and grouping wants one for all.
        return pa.table(columns).unify_dictionaries()
    except (OSError, pa.ArrowException, UnicodeError) as error:
        raise spoilt("cannot read this table") from error


def check_range(
    table: pa.Table, column: str, low: int | float, high: int | float, file: Path, fix: str
) -> None:
    """Raises InputError if a cell that is not null is less than `low` or more than `high`, or is
    NaN."""
    cells = table[column]
    if cells.null_count == len(cells):
        return
    ends = pc.min_max(cells).as_py()
    inside = low <= ends["min"] and ends["max"] <= high
    if inside and pa.types.is_floating(cells.type):
        inside = not pc.any(pc.is_nan(cells)).as_py()
    if not inside:
        raise InputError(
            f"a cell of its column '{column}' is not from {low:g} to {high:g}",
            source=str(file),
            fix=fix,
        )


def check_among(
    table: pa.Table,
    column: str,
    known: Mapping[str, object] | Mapping[int, object] | frozenset[str],
    file: Path,
    fix: str,
) -> None:
    """Raises InputError if a cell that is not null is none of the `known` texts or numbers."""
    for value in pc.unique(table[column]).to_pylist():
        if value is not None and value not in known:
            shown = quoted(value) if isinstance(value, str) else str(value)
            raise InputError(f"its column '{column}' holds {shown}", source=str(file), fix=fix)


def _absent(field: pa.Field, count: int) -> pa.ChunkedArray:
    """The values of a column that the file does not have."""
    value = pa.scalar(SINCE_VERSION_2.get(field.name), field.type)
    return pa.chunked_array([pa.repeat(value, count)])


def _has_nul(cells: pa.ChunkedArray) -> bool:
    chunks = [c.dictionary if pa.types.is_dictionary(c.type) else c for c in cells.chunks]
    return any(pc.any(pc.match_substring(chunk, "\0")).as_py() for chunk in chunks)
