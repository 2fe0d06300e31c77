"""What spoils a document: its bytes, its tokens, its JSON, its XML, its archive or its table.

Each takes a document that is good, or was, and gives one that is spoilt in a place or in a few.
"""

from __future__ import annotations

import copy
import io
import json
import re
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tests.fuzz.draws import Draws

Spoil = Callable[[bytes, Draws], bytes]

# What `visref` must never read or write: files of the machine, and one that stands outside on
# purpose (`limits.py` watches it).
OUTSIDE = (
    "../outside/secret.txt", "../../outside/secret.txt", "/etc/passwd", "/dev/zero", "/dev/stdin",
    "file:///etc/passwd", "~/.bashrc", "/proc/self/environ", "..", ".", "/",
)  # fmt: skip
TEXTS = (
    "", "x", " ", "a\nb", "a\rb", "\x1b[31m", "\0", "\u202e", "\ud800", "::error::x", "%s{0}",
    "<script>", "'\"&", "é" * 300, "/" * 300, "0", "nan",
)  # fmt: skip
NUMBERS = (
    0, 1, 2, 3, 7, -1, 255, 256, 65535, 2**31 - 1, 2**31, 2**32, 2**53 + 1, 2**63, 10**30, 10**400,
    0.5, -0.0, 5e-324, 1e-300, 1e18, 1e300, -1e300, float("nan"), float("inf"), float("-inf"),
    5121, 5123, 5125, 5126,
)  # fmt: skip
OTHERS = (None, True, False, [], {}, [0], [1, 2, 3], [[]], {"a": 1}, "VEC3", "MASK", "CUBICSPLINE")
WORDS = (
    "1_0", "nan", "inf", "-1", "0", "1e999", "99999999999", "3000000000", "1" * 5000, "0x10", "١",
    "1.5", "1/2/3", "-1//-1", "\0", "\udcff", "#", "\\", '"', "{", "x", "1,5", "+1", "1e", "e1",
    "%", "mtllib", "../outside/secret.txt", "/dev/zero",
)  # fmt: skip


def any_bytes(data: bytes, draws: Draws) -> bytes:
    """A flip, a cut, an insertion, a copy, a splice, or a number made extreme."""
    place = draws.span(len(data))
    kind = draws.below(8)
    before, part, after = data[: place.start], data[place], data[place.stop :]
    if kind == 0:
        return before + after
    if kind == 1:
        return before
    if kind == 2 and part:
        return before + bytes([part[0] ^ 1 << draws.below(8)]) + part[1:] + after
    if kind == 3:
        return before + bytes([draws.pick((0, 255, 10, 32, 47, 127, 128))] * len(part)) + after
    if kind == 4:
        number = draws.pick((0, 1, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1))
        return before + number.to_bytes(4, "little") + data[place.start + 4 :]
    if kind == 5:
        return before + part * draws.pick((2, 3, 100)) + after
    if kind == 6:
        return before + data[draws.span(len(data))] + after
    return after + before + part


def tokens(data: bytes, draws: Draws) -> bytes:
    """A word or a line replaced, left out, repeated or exchanged."""
    words = re.split(rb"(\s+)", data) if draws.below(2) else data.splitlines(keepends=True)
    if not words:
        return data
    place, kind = draws.below(len(words)), draws.below(6)
    if kind == 0:
        del words[place]
    elif kind in (1, 2):
        words[place] = draws.pick(WORDS).encode("utf-8", "surrogateescape")
    elif kind == 3:
        words.insert(place, words[place])
    elif kind == 4:
        other = draws.below(len(words))
        words[place], words[other] = words[other], words[place]
    else:
        words = words[:place]
    return b"".join(words)


def places(value: Any) -> list[tuple[Any, Any]]:
    """(list or dict, index or key) of every value in parsed JSON but the whole."""
    found: list[tuple[Any, Any]] = []
    waiting = [value]
    while waiting:
        owner = waiting.pop()
        keys = owner if isinstance(owner, dict) else range(len(owner))
        for key in keys:
            found.append((owner, key))
            if isinstance(owner[key], dict | list):
                waiting.append(owner[key])
    return found


def json_value(value: Any, draws: Draws) -> Any:
    """Parsed JSON with one place changed."""
    value = copy.deepcopy(value)
    everywhere = places(value) if isinstance(value, dict | list) else []
    if not everywhere or draws.one_in(60):
        return draws.pick((*OTHERS, *NUMBERS, *TEXTS))
    owner, key = draws.pick(everywhere)
    old, kind = owner[key], draws.below(8)
    if kind == 0:
        del owner[key]
    elif kind == 1:
        owner[key] = draws.pick(NUMBERS)
    elif kind == 2:
        owner[key] = _text(draws)
    elif kind == 3:
        owner[key] = copy.deepcopy(draws.pick(OTHERS))
    elif kind == 4 and isinstance(old, int | float) and not isinstance(old, bool):
        owner[key] = draws.pick((old + 1, old - 1, old * 2, -old, old * 10**6))
    elif kind == 4 and isinstance(old, list):
        owner[key] = old * draws.pick((2, 3, 50))
    elif kind == 5:
        owner[key] = copy.deepcopy(draws.pick(everywhere)[0])
    elif kind == 6 and isinstance(owner, dict):
        owner[_text(draws)] = owner.pop(key)
    else:
        other, there = draws.pick(everywhere)
        if isinstance(other[there], int | float | str):
            owner[key] = other[there]
    return value


def _text(draws: Draws) -> str:
    return draws.pick(draws.pick((TEXTS, OUTSIDE, OUTSIDE[:2])))


def json_bytes(value: Any) -> bytes:
    return json.dumps(value).encode()


def json_text(data: bytes, draws: Draws) -> bytes:
    """A JSON document: a value changed, or now and then its text."""
    if draws.one_in(8):
        return tokens(data, draws)
    if draws.one_in(30):
        return b"[" * 100_000 + data
    try:
        return json_bytes(json_value(json.loads(data), draws))
    except (ValueError, RecursionError):
        return tokens(data, draws)


def json_lines(data: bytes, draws: Draws) -> bytes:
    """One JSON value a line: one of them changed, or the lines."""
    lines = data.splitlines(keepends=True)
    if not lines or draws.one_in(6):
        return tokens(data, draws)
    at = draws.below(len(lines))
    lines[at] = json_text(lines[at], draws) + b"\n"
    return b"".join(lines)


# Entities that stand for much, and for a file: a parser that expands them is caught.
_LAUGHS = "".join(f'<!ENTITY l{i + 1} "{f"&l{i};" * 10}">' for i in range(9))
_DOCTYPES = (
    f'<!DOCTYPE x [<!ENTITY l0 "0 "> {_LAUGHS}]>',
    '<!DOCTYPE x [<!ENTITY l9 SYSTEM "file:///etc/passwd">]>',
    '<!DOCTYPE x [<!ENTITY % p SYSTEM "http://127.0.0.1:9/x"> %p;]>',
)


def xml(data: bytes, draws: Draws) -> bytes:
    """An XML document: an element, an attribute or a word in it changed."""
    try:
        root = ET.fromstring(data)
    except ET.ParseError:
        return tokens(data, draws)
    elements = list(root.iter())
    parents = {child: parent for parent in elements for child in parent}
    element, kind = draws.pick(elements), draws.below(9)
    if kind == 0 and element in parents:
        parents[element].remove(element)
    elif kind == 1 and element in parents:
        for _ in range(draws.pick((1, 2, 300))):
            parents[element].append(element)
    elif kind == 2 and element.attrib:
        del element.attrib[draws.pick(sorted(element.attrib))]
    elif kind == 3 and element.attrib:
        words = [word for word in (*WORDS, *TEXTS, *map(str, NUMBERS[:-12])) if _writable(word)]
        element.attrib[draws.pick(sorted(element.attrib))] = draws.pick(words)
    elif kind == 4 and element.attrib:
        others = [value for other in elements for value in other.attrib.values()]
        element.attrib[draws.pick(sorted(element.attrib))] = draws.pick(others)
    elif kind == 5:
        spoilt = tokens((element.text or "").encode(), draws).decode("utf-8", "replace")
        element.text = "".join(filter(_writable, spoilt))
    elif kind == 6:
        element.tag = draws.pick(elements).tag
    elif kind == 7:
        # As deep as a parser may be asked to go, and deeper.
        for _ in range(draws.pick((30, 3000))):
            child = ET.Element(element.tag, element.attrib)
            element.append(child)
            element = child
    else:
        body = ET.tostring(root).replace(b">0 ", b">&l9; ", 1).replace(b"0", b"&l9;", 0)
        return draws.pick(_DOCTYPES).encode() + body
    try:
        return ET.tostring(root)
    except (RecursionError, ValueError):
        return tokens(data, draws)


def _writable(text: str) -> bool:
    """Whether XML 1.0 can say it."""
    return all(character in "\t\n\r" or " " <= character < "\ud800" for character in text)


def archive(inner: Spoil, ending: str) -> Spoil:
    """A ZIP archive, whose files that end so are spoilt by `inner`."""

    def spoil(data: bytes, draws: Draws) -> bytes:
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as zipped:
                entries = [(name, zipped.read(name)) for name in zipped.namelist()]
        except Exception:  # What is no archive any more fails in many ways.
            return any_bytes(data, draws)
        if not entries:
            return any_bytes(data, draws)
        at, kind = draws.below(len(entries)), draws.below(12)
        name, content = entries[at]
        if kind == 0:
            return any_bytes(data, draws)
        if kind == 1:
            del entries[at]
        elif kind == 2:
            entries[at] = (draws.pick((*OUTSIDE[:2], "x", "3D/" * 50 + name, name[::-1])), content)
        elif kind == 3:
            entries.append((name + draws.pick(("", ".model", ".dae")), content))
        elif kind == 4:
            entries[at] = (name, b" " * 64 * 2**20 + content)
        else:
            fitting = [i for i, (own, _) in enumerate(entries) if own.endswith(ending)] or [at]
            at = draws.pick(fitting)
            entries[at] = (entries[at][0], inner(entries[at][1], draws))
        return zipped_up(entries)

    return spoil


def zipped_up(entries: list[tuple[str, bytes]]) -> bytes:
    """A ZIP archive whose bytes depend on its content alone."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as zipped:
        known = set()
        for name, content in entries:
            if name not in known:
                zipped.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
            known.add(name)
    return out.getvalue()


_TYPES = (pa.int8(), pa.int64(), pa.float32(), pa.string(), pa.large_string(), pa.bool_(),
          pa.binary(), pa.list_(pa.int32()), pa.null())  # fmt: skip


def parquet(data: bytes, draws: Draws) -> bytes:
    """A Parquet file: a column, a cell, its rows or its metadata changed, or its bytes."""
    if draws.one_in(6):
        return any_bytes(data, draws)
    try:
        table = pq.read_table(io.BytesIO(data))
    except (pa.ArrowException, OSError):
        return any_bytes(data, draws)
    try:
        return parquet_bytes(_table(table, draws))
    except (pa.ArrowException, OverflowError, ValueError, TypeError):
        return any_bytes(data, draws)


def _table(table: pa.Table, draws: Draws) -> pa.Table:
    kind = draws.below(9)
    if not table.num_columns or (kind == 0 and table.schema.metadata):
        metadata = dict(table.schema.metadata or {})
        if metadata:
            key = draws.pick(sorted(metadata))
            metadata[key] = json_text(metadata[key], draws)
        return table.replace_schema_metadata(metadata)
    at = draws.below(table.num_columns)
    name = table.column_names[at]
    if kind == 1:
        return table.drop_columns([name])
    if kind == 2:
        names = list(table.column_names)
        names[at] = draws.pick(("frame", "note", *TEXTS[:8]))
        return table.rename_columns([_valid(name) for name in names])
    if kind == 3:
        return table.set_column(at, name, table[name].cast(draws.pick(_TYPES), safe=False))
    if kind == 4:
        return table.slice(draws.below(table.num_rows + 1))
    if kind == 5:
        return pa.concat_tables([table] * draws.pick((2, 3)))
    field = table.schema.field(at)
    values = table[name].to_pylist()
    if values:
        values[draws.below(len(values))] = _cell(field.type, values, draws)
    return table.set_column(at, field.with_nullable(True), pa.array(values, field.type))


def _cell(kind: pa.DataType, values: list[Any], draws: Draws) -> Any:
    if draws.one_in(4):
        return None
    if pa.types.is_string(kind):
        return _valid(_text(draws))
    if pa.types.is_floating(kind):
        return float(draws.pick(NUMBERS[16:]))
    if pa.types.is_integer(kind):
        return draws.pick((0, 1, -1, 5, 100, 2**31 - 1, -(2**31)))
    return draws.pick(values)


def _valid(text: str) -> str:
    return text.encode("utf-8", "replace").decode()


def parquet_bytes(table: pa.Table, **options: Any) -> bytes:
    out = io.BytesIO()
    pq.write_table(table, out, **options)
    return out.getvalue()


def glb(data: bytes, draws: Draws) -> bytes:
    """A GLB: its JSON, its bytes, or the lengths and types of header and chunks."""
    kind = draws.below(10)
    chunks = glb_chunks(data)
    if not chunks or kind == 0:
        return any_bytes(data, draws)
    if kind == 1:
        # Headers: any of the 4-byte numbers that say how long what is.
        at = draws.pick((0, 4, 8, 12, 16, 20 + len(chunks[0][1]), 24 + len(chunks[0][1])))
        number = draws.pick((0, 1, len(data), 2**31, 2**32 - 1, 0x4E4F534A, 0x004E4942))
        return data[:at] + number.to_bytes(4, "little") + data[at + 4 :]
    if kind == 2:
        at = draws.below(len(chunks))
        chunks[at : at + 1] = draws.pick(([], [chunks[at]] * 2, [(b"XXXX", b"abcd"), chunks[at]]))
        return glb_of(chunks)
    at = draws.below(len(chunks)) if kind == 3 else 0
    name, content = chunks[at]
    chunks[at] = (name, (json_text if name == b"JSON" else any_bytes)(content, draws))
    return glb_of(chunks)


def glb_chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """(type, content) of a GLB's chunks, as far as they are whole."""
    found, at = [], 12
    while at + 8 <= len(data):
        length = int.from_bytes(data[at : at + 4], "little")
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 8 + length
    return found


def glb_of(chunks: list[tuple[bytes, bytes]]) -> bytes:
    body = b""
    for name, content in chunks:
        content += (b" " if name == b"JSON" else b"\0") * (-len(content) % 4)
        body += len(content).to_bytes(4, "little") + name + content
    return b"glTF\2\0\0\0" + (12 + len(body)).to_bytes(4, "little") + body


def headed(end: bytes, body: Spoil) -> Spoil:
    """A document of a header in words, up to and with `end`, and of a body."""

    def spoil(data: bytes, draws: Draws) -> bytes:
        head, mark, rest = data.partition(end)
        if draws.below(2):
            return head + mark + body(rest, draws)
        return tokens(head + mark, draws) + rest

    return spoil
