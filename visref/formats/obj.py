"""Wavefront OBJ read with NumPy, in chunks of whole lines.

Why not through trimesh, which reads the other formats: measured with trimesh 5.2, it returns
the objects in reverse, joins objects of one name, counts relative indices from the end of the
file instead of from their line, and takes index 0 for 1.

An object is what an `o` line starts; in a file without any, what `g` lines name. Polygons
become triangles (`visref.formats.polygons`). Materials say only how transparent they are: `d`
below 1 is blended, a `map_d` texture is alpha-masked and so undecided. (`Tr` is not read: its
writers disagree whether 0 or 1 is opaque.)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.files import Bytes, map_file, named_beside
from visref.findings import Code
from visref.formats.numbers import is_number, parsed
from visref.formats.placed import Mesh, Placed
from visref.formats.polygons import triangulated
from visref.memory import Budget
from visref.numerals import decimal_number
from visref.scene import Alpha, Int64, check_indices

# Bytes at a time: the index arrays of a chunk take some twenty times as much.
_CHUNK_BYTES = 1 << 23

# A line of text as Python's own: a string's head and its place in a list.
_LINE_BYTES = 100
# A vertex is three float64, twice while the chunks are joined. A face corner is its int64 vertex
# and at most a triangle of three int64, both twice, and the triangle's face. A name is a string.
_VERTEX_BYTES, _CORNER_BYTES, _NAME_BYTES = 48, 72, 200

Marks = list[tuple[int, str]]


@dataclass
class _Reading:
    """What has been read so far. `corners`: vertex ids, face after face; `counts` and `lines`: of
    each face. `marks`: by keyword, (face it starts at, argument)."""

    vertices: list[NDArray[np.float64]] = field(default_factory=list)
    corners: list[Int64] = field(default_factory=list)
    counts: list[Int64] = field(default_factory=list)
    lines: list[Int64] = field(default_factory=list)
    marks: dict[str, Marks] = field(
        default_factory=lambda: {"o": [], "g": [], "usemtl": [], "mtllib": []}
    )
    vertex_count: int = 0
    face_count: int = 0
    line: int = 1


def read_obj(path: Path, *, budget: Budget) -> Placed:
    """The objects of an OBJ file. Raises InputError naming the line."""
    data = map_file(path)
    reading = _Reading()
    at = corner_count = 0
    while at < len(data):
        chunk = data[at : at + _CHUNK_BYTES].tobytes()
        if at + len(chunk) < len(data):
            end = chunk.rfind(b"\n") + 1
            while end and chunk[:end].rstrip(b"\r\n").endswith(b"\\"):
                end = chunk.rfind(b"\n", 0, end - 1) + 1
            if not end:
                raise InputError("a line of more than 8 MB", fix="check that it is an OBJ file")
            chunk = chunk[:end]
        at += len(chunk)
        _read_chunk(reading, chunk)
        corner_count += len(reading.corners[-1])
        name_count = sum(map(len, reading.marks.values()))
        budget.need(
            f"its first {reading.vertex_count:,} vertices and {corner_count:,} corners of faces",
            reading.vertex_count * _VERTEX_BYTES
            + corner_count * _CORNER_BYTES
            + name_count * _NAME_BYTES,
        )
    vertices = np.concatenate([np.zeros((0, 3)), *reading.vertices])
    triangles, face = _triangles(reading, vertices)
    placed = Placed()
    alpha = _alpha(reading, path, placed, budget)[face]
    names, owner = _objects(reading, face)
    order = np.argsort(owner, kind="stable")
    offsets = np.searchsorted(owner[order], np.arange(len(names) + 1))
    for index, name in enumerate(names):
        mine = order[offsets[index] : offsets[index + 1]]
        mesh = Mesh.plain(vertices, triangles[mine])
        mesh.alpha[:] = alpha[mine]
        placed.meshes.append(mesh)
        placed.add(name, index, np.eye(4))
    return placed


def _read_chunk(reading: _Reading, chunk: bytes) -> None:
    """Read whole lines. Tokens are found by array arithmetic; only `o`, `g`, `usemtl` and
    `mtllib` lines are looked at one by one."""
    if (zero := chunk.find(0)) >= 0:
        place = f"line {reading.line + chunk.count(bytes([10]), 0, zero)}"
        raise InputError("a zero byte, and OBJ is text", place=place, fix="export anew")
    newlines = chunk.count(b"\n")
    text = (b"\n" + chunk + b"\n").replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ")
    # A backslash at the file's end continues nothing: the last line ends all the same.
    text += b"\n"
    raw = np.frombuffer(text, np.uint8)
    blank = raw <= 32
    starts = np.flatnonzero(blank[:-1] & ~blank[1:]) + 1
    ends = np.flatnonzero(~blank[:-1] & blank[1:]) + 1
    line = np.cumsum(raw == 10)[starts] - 1
    first = np.flatnonzero(np.diff(line, prepend=-1))
    counts = np.diff(first, append=len(starts)) - 1
    comments = np.flatnonzero(raw[starts] == ord("#"))
    if len(comments):
        of = np.searchsorted(first, comments, side="right") - 1
        np.minimum.at(counts, of, np.maximum(comments - first[of] - 1, 0))
    letter = raw[starts[first]]
    single = ends[first] - starts[first] == 1
    is_vertex = single & (letter == ord("v"))
    is_face = single & (letter == ord("f"))
    line_of = line[first] + reading.line

    rows = np.flatnonzero(is_vertex)
    if (counts[rows] < 3).any():
        bad = line_of[rows[np.argmax(counts[rows] < 3)]]
        raise InputError(
            "a vertex has fewer than 3 coordinates", place=f"line {bad}", fix="mend the line"
        )
    tokens = (first[rows, None] + np.arange(1, 4)).reshape(-1)
    values = _numbers(raw, starts[tokens], ends[tokens], np.float64, line_of, first, tokens)
    reading.vertices.append(values.reshape(-1, 3))

    rows = np.flatnonzero(is_face)
    tokens = np.repeat(first[rows] + 1, counts[rows]) + _ranges(counts[rows])
    slashes = np.append(np.flatnonzero(raw == ord("/")), len(raw))
    cut = np.minimum(ends[tokens], slashes[np.searchsorted(slashes, starts[tokens])])
    corners = _numbers(raw, starts[tokens], cut, np.int64, line_of, first, tokens)
    before = reading.vertex_count + np.cumsum(is_vertex)[rows]
    corner_line = np.repeat(line_of[rows], counts[rows])
    if (corners == 0).any():
        bad = corner_line[np.argmax(corners == 0)]
        raise InputError(
            "vertex index 0, and OBJ counts from 1", place=f"line {bad}", fix="mend the line"
        )
    corners = np.where(corners < 0, corners + np.repeat(before, counts[rows]), corners - 1)
    reading.corners.append(corners)
    reading.counts.append(counts[rows])
    reading.lines.append(line_of[rows])

    done = np.cumsum(is_face)
    named = ~(is_vertex | is_face) & np.isin(letter, np.frombuffer(b"ogum", np.uint8))
    for row in np.flatnonzero(named):
        keyword = text[starts[first[row]] : ends[first[row]]].decode("utf-8", "replace")
        if keyword in reading.marks:
            stop = text.index(b"\n", ends[first[row]])
            argument = text[ends[first[row]] : stop].decode("utf-8", "replace").strip()
            reading.marks[keyword].append((reading.face_count + int(done[row]), argument))
    reading.vertex_count += int(is_vertex.sum())
    reading.face_count += len(rows)
    reading.line += newlines


def _ranges(counts: Int64) -> Int64:
    """0, 1, …, c - 1 for each count c, one after another."""
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    result: Int64 = np.arange(total) - np.repeat(ends - counts, counts)
    return result


def _numbers(
    raw: NDArray[np.uint8],
    starts: Int64,
    ends: Int64,
    dtype: type,
    line_of: Int64,
    first: Int64,
    tokens: Int64,
) -> NDArray[Any]:
    """The tokens' numbers, in one pass over their bytes."""
    if not len(starts):
        return np.zeros(0, dtype)
    lengths = ends - starts + 1  # with the blank (or slash) behind each
    places = np.repeat(starts, lengths) + _ranges(lengths)
    text = raw[places]
    text[np.cumsum(lengths) - 1] = ord(" ")
    values = parsed(text.tobytes(), dtype)
    if values is None or len(values) != len(starts):
        words = (raw[start:end].tobytes() for start, end in zip(starts, ends, strict=True))
        bad, word = next(
            ((i, word) for i, word in enumerate(words) if not is_number(word, dtype)), (0, b"")
        )
        row = int(np.searchsorted(first, tokens[bad], side="right")) - 1
        raise InputError(
            f"{word[:40].decode('latin-1')!a} is not a number",
            place=f"line {line_of[row]}",
            fix="mend the line",
        )
    return values


def _triangles(reading: _Reading, vertices: NDArray[np.float64]) -> tuple[Int64, Int64]:
    """(t, 3) vertex ids, and (t,) the face of each."""
    none = np.zeros(0, np.int64)
    corners = np.concatenate([none, *reading.corners])
    counts = np.concatenate([none, *reading.counts])
    lines = np.concatenate([none, *reading.lines])
    face = np.repeat(np.arange(len(counts)), counts)
    check_indices(corners, len(vertices), lambda at: f"line {lines[face[at]]}")
    return triangulated(vertices, corners, counts, lambda at: f"line {lines[at]}")


def _objects(reading: _Reading, face: Int64) -> tuple[list[str], Int64]:
    """The objects' names, and the object of each triangle, whose face `face` says.

    Each `o` line starts an object, with triangles or without. `g` lines name one group
    wherever they stand, and groups without triangles (`g default`) are not objects.
    """
    marks = reading.marks["o"]
    if marks:
        names = ["object", *(name for _, name in marks)]
        starts = np.array([0, *(start for start, _ in marks)])
        owner = np.searchsorted(starts, face, side="right") - 1
        if marks[0][0] == 0:
            return names[1:], owner - 1
        return names, owner
    marks = [(0, "object"), *reading.marks["g"]]
    starts = np.array([start for start, _ in marks])
    piece = np.searchsorted(starts, face, side="right") - 1
    used = [marks[i][1] for i in np.unique(piece)]
    names = list(dict.fromkeys(used))
    number = {name: i for i, name in enumerate(names)}
    table = np.array([number.get(name, -1) for _, name in marks])
    return names, table[piece]


def _lines(data: Bytes) -> int:
    return 1 + int(np.count_nonzero((data == 10) | (data == 13)))


def _alpha(reading: _Reading, path: Path, placed: Placed, budget: Budget) -> NDArray[np.uint8]:
    """(f,) uint8 of each face, by the materials of the MTL files; a missing one is a note."""
    materials: dict[str, Alpha] = {}
    for _, named in reading.marks["mtllib"]:
        try:
            data = map_file(named_beside(path, named))
        except InputError as error:
            reason = f"material file {named[:200]!a}: {error.problem}; all is opaque"
            placed.notes.append((Code.PARTLY_READ, reason))
            continue
        budget.need(f"material file {named[:200]!a}", 2 * len(data) + _LINE_BYTES * _lines(data))
        text = data.tobytes().decode("utf-8", "replace")
        current = ""
        for line in text.splitlines():
            words = line.split()
            if len(words) < 2:
                continue
            if words[0] == "newmtl":
                current = line.strip()[6:].strip()
                materials[current] = Alpha.OPAQUE
            elif words[0] == "map_d":
                materials[current] = Alpha.MASK
            elif words[0] == "d" and materials.get(current) == Alpha.OPAQUE and _value(words) < 1:
                materials[current] = Alpha.BLEND
    marks = [(0, ""), *reading.marks["usemtl"]]
    starts = np.array([start for start, _ in marks])
    piece = np.searchsorted(starts, np.arange(reading.face_count), side="right") - 1
    table = np.array([materials.get(name, Alpha.OPAQUE) for _, name in marks], np.uint8)
    return table[piece]


def _value(words: list[str]) -> float:
    try:
        return decimal_number(words[-1], finite=False)
    except ValueError as error:
        raise InputError(str(error), place="the material file", fix="mend the line") from error
