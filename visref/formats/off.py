"""OFF: ASCII, polygons as polygons.

Why not through trimesh: measured with trimesh 5.2, it makes fans of polygons, which cover too
much where they are not convex, and reads a file that is cut off in its faces as if it were whole.

Source: Geomview's manual, "OFF Files". A line holds a vertex or a face; what stands on it behind
the coordinates, or behind a face's corners, is not geometry. A file is one object, named after
itself.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.files import map_file
from visref.formats.numbers import read_numbers
from visref.formats.placed import Mesh, Placed
from visref.formats.polygons import triangulated
from visref.memory import Budget
from visref.scene import Float64, Int64, check_indices

# Optional: texture coordinates, colours, normals. A "4" or an "n" would be other spaces.
_HEADER = re.compile(rb"(ST)?C?N?OFF(?=\s|$)")


def read_off(path: Path, *, budget: Budget) -> Placed:
    """The object of an OFF file. Raises InputError where it is cut, or not such a file."""
    data = map_file(path)
    lines_at_most = int(np.count_nonzero((data == 10) | (data == 13)))
    # The text thrice, a number of eight bytes for every two of text, and up to ten int64 for a
    # corner that takes as many; 41 for each line that is a string of its own.
    budget.need("reading it", 47 * len(data) + 41 * lines_at_most)
    text = re.sub(rb"#[^\r\n]*", b"", data.tobytes())
    start = _HEADER.match(text.lstrip())
    if start is None:
        raise InputError("this is not an OFF file of three dimensions", fix="check it")
    body = text.lstrip()[start.end() :]
    if body.split(maxsplit=1)[:1] == [b"BINARY"]:
        raise InputError("this is a binary OFF file", fix="export it as text, or as PLY")
    lines = [line for line in body.splitlines() if line.strip()]
    counts = read_numbers(lines[0]) if lines else np.zeros(0)
    if len(counts) < 2 or not all(0 <= n < 2**53 and n.is_integer() for n in counts.tolist()):
        raise InputError("the counts of vertices and faces are missing", fix="export it anew")
    vertex_count, face_count = int(counts[0]), int(counts[1])
    if len(lines) - 1 < vertex_count + face_count:
        vertices = min(vertex_count, len(lines) - 1)
        faces = max(0, len(lines) - 1 - vertex_count)
        raise InputError(
            f"truncated: it holds {vertices} of its {vertex_count} vertices"
            f" and {faces} of its {face_count} faces",
            fix="export or copy it anew",
        )
    values, firsts, ends = _table(lines[1 : vertex_count + 1])
    _refuse_short("vertex", firsts + 3 > ends)
    positions = values[firsts[:, None] + np.arange(3)]
    placed = Placed(meshes=[Mesh.plain(positions, _faces(positions, lines, face_count))])
    placed.add(path.name, 0, np.eye(4))
    return placed


def _faces(positions: Float64, lines: list[bytes], face_count: int) -> Int64:
    start = 1 + len(positions)
    values, firsts, ends = _table(lines[start : start + face_count])
    counts = values[firsts].astype(np.int64)
    _refuse_short("face", (counts != values[firsts]) | (counts < 0) | (firsts + 1 + counts > ends))
    within = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    named = values[np.repeat(firsts + 1, counts) + within]
    corners = named.astype(np.int64)
    face = np.repeat(np.arange(face_count), counts)
    if (corners != named).any():
        bad = face[int(np.argmax(corners != named))]
        raise InputError("a vertex index is not whole", place=f"face {bad}", fix="export it anew")
    check_indices(corners, len(positions), lambda at: f"face {face[at]}")
    return triangulated(positions, corners, counts, lambda at: f"face {at}")[0]


def _table(lines: list[bytes]) -> tuple[Float64, Int64, Int64]:
    """All numbers of the lines, and where each line's start and end among them."""
    ends = np.cumsum(np.array([len(line.split()) for line in lines], np.int64))
    return read_numbers(b"\n".join(lines)), np.insert(ends, 0, 0)[:-1], ends


def _refuse_short(what: str, bad: NDArray[np.bool_]) -> None:
    if bad.any():
        raise InputError(
            "the line holds too few numbers, or a count that is none",
            place=f"{what} {int(np.argmax(bad))}",
            fix="export or copy it anew",
        )
