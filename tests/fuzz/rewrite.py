"""What writes a document in another way: it must be read as before.

The other order of keys, other white space, comments, fields that nobody knows, another packing.
"""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tests.fuzz.draws import Draws
from tests.fuzz.spoil import Spoil, glb_chunks, glb_of, parquet_bytes, zipped_up


def _shuffled(value: Any, draws: Draws) -> Any:
    if isinstance(value, dict):
        return {key: _shuffled(value[key], draws) for key in draws.shuffled(list(value))}
    if isinstance(value, list) and len(value) < 20:
        return [_shuffled(item, draws) for item in value]
    return value


def json_text(data: bytes, draws: Draws) -> bytes:
    """The same JSON with its keys in another order and other white space."""
    value = _shuffled(json.loads(data), draws)
    text = json.dumps(
        value,
        indent=draws.pick((None, 1, "\t")),
        ensure_ascii=bool(draws.below(2)),
        separators=draws.pick(((",", ":"), (", ", ": "), (" ,\r\n", " : "))),
    )
    return text.encode()


def with_unknown(data: bytes, draws: Draws) -> bytes:
    """As `json_text`, with a field at the top that nobody knows."""
    value = json.loads(data)
    return json_text(json.dumps({**value, "someday": draws.pick((1, [], {"a": "b"}))}).encode(),
                     draws)  # fmt: skip


def gltf_text(data: bytes, draws: Draws) -> bytes:
    """A glTF's JSON with `extras`, which mean nothing, on some of its objects."""
    value = json.loads(data)
    for kind in ("nodes", "meshes", "accessors", "bufferViews", "materials", "buffers", "scenes"):
        for entry in value.get(kind, []):
            if draws.below(2):
                entry["extras"] = draws.pick(({"a": [1]}, 7, "x"))
    return json_text(json.dumps(value).encode(), draws)


def glb(data: bytes, draws: Draws) -> bytes:
    (name, text), *rest = glb_chunks(data)
    after = [(b"XXXX", b"whatever")] if draws.below(2) else []
    return glb_of([(name, gltf_text(text, draws)), *rest, *after])


def json_lines(data: bytes, draws: Draws) -> bytes:
    """A value a line, with empty lines and other line ends."""
    return draws.pick((b"\n", b"\r\n", b"\n\n")).join(_lines(data, draws)) + b"\n"


def json_rows(data: bytes, draws: Draws) -> bytes:
    """A value a line, and no line is empty."""
    return b"\n".join(_lines(data, draws)) + b"\n"


def _lines(data: bytes, draws: Draws) -> list[bytes]:
    return [_one_line(json_text(line, draws)) for line in data.splitlines()]


def _one_line(text: bytes) -> bytes:
    return re.sub(rb"[\r\n]\s*", b" ", text)


def csv_text(data: bytes, draws: Draws) -> bytes:
    """Other quotes, line ends and order of columns."""
    rows = list(csv.reader(io.StringIO(data.decode())))
    order = draws.shuffled(range(len(rows[0])))
    out = io.StringIO()
    writer = csv.writer(
        out,
        quoting=draws.pick((csv.QUOTE_MINIMAL, csv.QUOTE_ALL)),
        lineterminator=draws.pick(("\n", "\r\n")),
    )
    writer.writerows([[row[at] for at in order] for row in rows])
    return draws.pick((b"", b"\xef\xbb\xbf")) + out.getvalue().encode()


def lines(comment: bytes | None, *, first: int = 1) -> Spoil:
    """Text of lines: white space at their ends, other line ends, and from line `first` on
    comments and empty lines."""

    def rewrite(data: bytes, draws: Draws) -> bytes:
        found, out = data.splitlines(), []
        for number, line in enumerate(found):
            # What goes on in the next line ends in its backslash.
            going_on = number > 0 and found[number - 1].endswith(b"\\")
            if comment is not None and number >= first and not going_on and draws.one_in(4):
                out.append(draws.pick((comment + b" 1 2 3", comment)))
            ends = number >= first and not line.endswith(b"\\")
            out.append(line + draws.pick((b"", b" ")) if ends else line)
        return draws.pick((b"\n", b"\r\n")).join(out) + b"\n"

    return rewrite


def ply(data: bytes, draws: Draws) -> bytes:
    """Comments in the header."""
    head, mark, body = data.partition(b"end_header\n")
    kept = head.splitlines(keepends=True)
    for _ in range(1 + draws.below(3)):
        kept.insert(2 + draws.below(len(kept) - 1), b"comment element vertex 7\n")
    return b"".join(kept) + mark + body


def stl(data: bytes, draws: Draws) -> bytes:
    """Other words in the 80 bytes that mean nothing."""
    return bytes([draws.pick((0, 32, 65, 255))]) * 80 + data[80:]


def xml(data: bytes, draws: Draws) -> bytes:
    """White space and comments between elements."""
    spaces = (b"", b"\n", b" <!-- <mesh/> --> ")
    parts = re.split(rb"(?<=>)(?=\s*<(?![!?]))", data)
    return parts[0] + b"".join(draws.pick(spaces) + part for part in parts[1:])


def archive(inner: Spoil, ending: str) -> Spoil:
    """A ZIP archive with its files in another order, not compressed, or rewritten by `inner`."""

    def rewrite(data: bytes, draws: Draws) -> bytes:
        with zipfile.ZipFile(io.BytesIO(data)) as zipped:
            entries = [(name, zipped.read(name)) for name in zipped.namelist()]
        entries = [
            (name, inner(content, draws) if name.endswith(ending) else content)
            for name, content in draws.shuffled(entries)
        ]
        if draws.below(2):
            return zipped_up(entries)
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as stored:
            for name, content in entries:
                stored.writestr(zipfile.ZipInfo(name), content)
        return out.getvalue()

    return rewrite


def parquet(data: bytes, draws: Draws) -> bytes:
    """The same rows, packed in another way."""
    table = pq.read_table(io.BytesIO(data))
    return parquet_bytes(
        table,
        compression=draws.pick(("snappy", "zstd", "none")),
        row_group_size=draws.pick((1, 2, 100)),
        use_dictionary=bool(draws.below(2)),
    )


def parquet_with_unknown(data: bytes, draws: Draws) -> bytes:
    """As `parquet`, with a column that nobody knows."""
    table = pq.read_table(io.BytesIO(data))
    note = pa.array(["x"] * table.num_rows, pa.string())
    return parquet(parquet_bytes(table.append_column("someday", note)), draws)
