"""Tables on disk, in row groups of one size: the same rows give the same bytes."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from visref.files import for_arrow

# Rows that are held before they are written: some 10 MB. A culler of small units over a long path
# has tens of millions.
GROUP_ROWS = 1 << 17


class RowGroups:
    """A Parquet file that is written as rows come, a group of so many at a time."""

    def __init__(self, file: Path, schema: pa.Schema, group: int = GROUP_ROWS) -> None:
        self._file = file
        self._schema = schema
        self._pending: list[pa.Table] = []
        self._rows = 0
        self._group = group
        self._writer: pq.ParquetWriter | None = None

    def add(self, table: pa.Table) -> None:
        self._pending.append(table)
        self._rows += len(table)
        while self._rows >= self._group:
            self._write(self._group)

    def close(self) -> None:
        """Write what is left, and the file if there was nothing at all."""
        if self._rows or self._writer is None:
            self._write(self._rows)
        assert self._writer is not None
        self._writer.close()
        self._out.close()

    def _write(self, rows: int) -> None:
        if self._writer is None:
            self._out = for_arrow(self._file, "wb")
            self._writer = pq.ParquetWriter(self._out, self._schema, compression="zstd")
        # How a table is put together shows in a file's bytes.
        table = pa.concat_tables([self._schema.empty_table(), *self._pending]).combine_chunks()
        self._writer.write_table(table.slice(0, rows).combine_chunks(), row_group_size=self._group)
        rest = table.slice(rows)
        self._pending, self._rows = [rest], len(rest)
