"""PLY: ASCII or binary, polygons as polygons.

Why not through trimesh: measured with trimesh 5.2, it makes fans of polygons, which cover too
much where they are not convex, refuses binary files of mixed triangles and quads, and reads an
ASCII file that is cut off in its faces as if it were whole.

Source: Turk, "The PLY Polygon File Format", 1994. Faces are the list `vertex_indices` (or
`vertex_index`) of the element `face`; triangle strips those of `tristrips`, with -1 between two.
A file is one object, named after itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.files import Bytes, map_file
from visref.findings import Code
from visref.formats.numbers import read_numbers
from visref.formats.placed import Mesh, Placed
from visref.formats.polygons import triangulated
from visref.memory import Budget
from visref.numerals import whole_number
from visref.scene import Int64, check_indices

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
# A vertex is three float64 twice. A corner of a face is its int64 vertex, and at most a triangle of
# three int64, both twice, and the triangle's face.
_VERTEX_BYTES, _CORNER_BYTES = 48, 72
_INDICES = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class _Property:
    """`count`: the type of a list's length, None for a scalar."""

    name: str
    type: str
    count: str | None = None


@dataclass
class _Element:
    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)


@dataclass(frozen=True)
class _Column:
    """A property's values, one row after another, and how many each row has."""

    values: NDArray[Any]
    counts: Int64


def read_ply(path: Path, *, budget: Budget) -> Placed:
    """The object of a PLY file. Raises InputError where it is cut, or not PLY."""
    data = map_file(path)
    order, elements, start = _header(data)
    if order:
        body = data[start:]
    else:
        # The same rows, every number in them a float64: eight bytes for two of text.
        budget.need("its text", 6 * (len(data) - start))
        body = read_numbers(data[start:].tobytes()).astype("<f8").view(np.uint8)
    columns = _columns(body, elements, budget)
    try:
        xyz = [columns["vertex", axis].values.astype(np.float64) for axis in "xyz"]
    except KeyError as error:
        raise InputError("its vertices have no x, y and z", fix="export the file anew") from error
    positions = np.stack(xyz, axis=1)
    corners = sum(len(c.values) for (_, name), c in columns.items() if name in _INDICES)
    budget.need(
        f"{len(positions):,} vertices and {corners:,} corners of faces",
        len(positions) * _VERTEX_BYTES + corners * _CORNER_BYTES,
    )
    triangles = np.concatenate([_faces(columns, positions), _strips(columns, len(positions))])
    placed = Placed(meshes=[Mesh.plain(positions, triangles)])
    placed.add(path.name, 0, np.eye(4))
    known = {"vertex", "face", "tristrips", "edge", "material"}
    others = [f"'{element.name}'" for element in elements if element.name not in known]
    if others:
        placed.notes.append((Code.PARTLY_READ, f"not read: elements {', '.join(others)}"))
    return placed


def _faces(columns: dict[tuple[str, str], _Column], positions: NDArray[np.float64]) -> Int64:
    found = [columns["face", name] for name in _INDICES if ("face", name) in columns]
    if not found:
        return np.zeros((0, 3), np.int64)
    corners, counts = _whole(found[0]), found[0].counts
    face = np.repeat(np.arange(len(counts)), counts)
    check_indices(corners, len(positions), lambda at: f"face {face[at]}")
    return triangulated(positions, corners, counts, lambda at: f"face {at}")[0]


def _whole(column: _Column) -> Int64:
    indices = column.values.astype(np.int64)
    if (indices != column.values).any():
        raise InputError("a vertex index is not a whole number", fix="export the file anew")
    return indices


def _strips(columns: dict[tuple[str, str], _Column], vertex_count: int) -> Int64:
    """Triangles of strips: each corner with the two before it, every other one turned."""
    found = [columns["tristrips", name] for name in _INDICES if ("tristrips", name) in columns]
    parts = [np.zeros((0, 3), np.int64)]
    for column in found:
        ends = np.cumsum(column.counts)
        corners = np.insert(_whole(column), ends, -1)
        at = 0
        for stop in np.flatnonzero(corners == -1).tolist():
            strip, at = corners[at:stop], stop + 1
            first = np.arange(max(0, len(strip) - 2))
            odd = first % 2
            parts.append(strip[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)])
    triangles = np.concatenate(parts)
    check_indices(triangles, vertex_count, lambda at: f"triangle {at} of the strips")
    return triangles


def _header(data: Bytes) -> tuple[str, list[_Element], int]:
    """The byte order ("" for ASCII), the elements, and where the body starts."""
    if data[:3].tobytes() != b"ply":
        raise InputError("this is not a PLY file: it does not start with 'ply'", fix="check it")
    order: str | None = None
    types: dict[str, str] = {}
    elements: list[_Element] = []
    at, number = 0, 0
    while True:
        line = data[at : at + 4096].tobytes().partition(b"\n")
        if not line[1]:
            raise InputError(
                "truncated: the header has no end_header", fix="export or copy it anew"
            )
        at, number = at + len(line[0]) + 1, number + 1
        words = line[0].decode("utf-8", "replace").split()
        try:
            match words:
                case ["end_header"]:
                    break
                case ["format", name, *_]:
                    order = _ORDERS[name]
                    if not order:
                        types = dict.fromkeys(_TYPES, "<f8")
                    else:
                        types = {name: order + kind for name, kind in _TYPES.items()}
                case ["element", name, rows]:
                    elements.append(_Element(name, whole_number(rows)))
                    if elements[-1].rows < 0:
                        raise ValueError
                case ["property", "list", count, kind, name]:
                    if _TYPES[count][0] == "f":
                        raise ValueError
                    elements[-1].properties.append(_Property(name, types[kind], types[count]))
                case ["property", kind, name]:
                    elements[-1].properties.append(_Property(name, types[kind]))
                case [] | ["ply" | "comment" | "obj_info", *_]:
                    pass
                case _:
                    raise ValueError
        except (KeyError, ValueError, IndexError) as error:
            raise InputError(
                f"{' '.join(words)[:60]!a} is not understood",
                place=f"line {number}",
                fix="export the file anew",
            ) from error
    if order is None:
        raise InputError("the header states no format", fix="export the file anew")
    return order, elements, at


def _cut(element: _Element, row: int) -> InputError:
    return InputError(
        f"truncated: it holds {row} of its {element.rows} rows of '{element.name}'",
        fix="export or copy it anew",
    )


def _columns(
    body: Bytes, elements: list[_Element], budget: Budget
) -> dict[tuple[str, str], _Column]:
    """Every property by its element's and its own name."""
    columns: dict[tuple[str, str], _Column] = {}
    at = 0
    for element in elements:
        if element.properties:
            count = min(element.rows, len(body) - at) * len(element.properties)
            what = f"{element.rows:,} rows of {element.name[:40]!a}"
            budget.need(what, 8 * count)
            read = _rows_alike(body, at, element)
            if read is None:
                # Two of Python's integers each, in lists, and then in arrays.
                budget.need(what, 96 * count)
                read = _rows_one_by_one(body, at, element)
            at, found = read
            columns |= {(element.name, name): column for name, column in found.items()}
    if at != len(body):
        raise InputError("there is more in it than its header announces", fix="export it anew")
    return columns


def _rows_alike(body: Bytes, at: int, element: _Element) -> tuple[int, dict[str, _Column]] | None:
    """An element whose lists are all as long as its first row's; None where they are not."""
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    lengths: dict[str, int] = {}
    for number, prop in enumerate(element.properties):
        if prop.count is not None:
            offset = at + np.dtype(fields).itemsize
            lengths[f"c{number}"] = length = _length(body, offset, prop.count)
            if not 0 <= length <= len(body):
                return None
            fields.append((f"c{number}", prop.count, ()))
            fields.append((f"v{number}", prop.type, (length,)))
        else:
            fields.append((f"v{number}", prop.type, ()))
    row = np.dtype(fields)
    end = at + element.rows * row.itemsize
    if end > len(body):
        return None
    rows = body[at:end].view(row)
    if any((rows[name] != length).any() for name, length in lengths.items()):
        return None
    return end, {
        prop.name: _Column(
            rows[f"v{number}"].reshape(-1),
            np.full(element.rows, lengths.get(f"c{number}", 1), np.int64),
        )
        for number, prop in enumerate(element.properties)
    }


def _rows_one_by_one(body: Bytes, at: int, element: _Element) -> tuple[int, dict[str, _Column]]:
    starts: list[list[int]] = [[] for _ in element.properties]
    counts: list[list[int]] = [[] for _ in element.properties]
    shapes = [
        (prop.count, np.dtype(prop.count or "u1").itemsize, np.dtype(prop.type).itemsize)
        for prop in element.properties
    ]
    for row in range(element.rows):
        for number, (count, count_size, size) in enumerate(shapes):
            length = 1
            if count is not None:
                length = _length(body, at, count)
                if length < 0:
                    raise _cut(element, row)
                at += count_size
            starts[number].append(at)
            counts[number].append(length)
            at += length * size
        if at > len(body):
            raise _cut(element, row)
    return at, {
        prop.name: _gathered(body, starts[number], counts[number], prop.type)
        for number, prop in enumerate(element.properties)
    }


def _length(body: Bytes, at: int, kind: str) -> int:
    """A list's length, -1 where the body ends before it, or it is no whole number."""
    size = np.dtype(kind).itemsize
    if at + size > len(body):
        return -1
    value = float(body[at : at + size].view(kind)[0])
    return int(value) if value >= 0.0 and value.is_integer() else -1


def _gathered(body: Bytes, starts: list[int], counts: list[int], kind: str) -> _Column:
    each = np.array(counts, np.int64)
    size = np.dtype(kind).itemsize
    within = np.arange(int(each.sum())) - np.repeat(np.cumsum(each) - each, each)
    places = np.repeat(np.array(starts, np.int64), each) + within * size
    values = body[places[:, None] + np.arange(size)].reshape(-1).view(kind)
    return _Column(values, each)
