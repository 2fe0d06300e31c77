"""Truth files, written: one row per frame, view and object that owns a sample, as Parquet.

Columns `frame int32, view string, object int32, name string, pixels int64, status string
("visible" or "tie"), x int32, y int32, depth float64`, where (x, y, depth) is one witness. The
metadata (JSON under the key `visref`) names the engine, whether it is exact, and the hashes of
scene and path; it lists the frames, their views and how many samples anything owns there; and it
seals rows and metadata with a digest, so that an edited file is refused.

Version 1 has no column `view`, no digest, and does not say whether the engine is exact; it is
still read (`visref.recordings.truth_reading`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref.files import for_arrow
from visref.findings import Finding
from visref.recordings.spool import Spool
from visref.scene import Scene
from visref.visibility import ObjectVisibility

SCHEMA = pa.schema(
    [
        ("frame", pa.int32()),
        ("view", pa.string()),
        ("object", pa.int32()),
        ("name", pa.string()),
        ("pixels", pa.int64()),
        ("status", pa.string()),
        ("x", pa.int32()),
        ("y", pa.int32()),
        ("depth", pa.float64()),
    ]
)
# How every Parquet file begins: what is none is no earlier truth.
TRUTH_BEGINS = b"PAR1"
KEY = b"visref"
FORMAT = "visref-truth"
VERSION = 2

# The view of a frame that has one camera without a name.
UNNAMED = ""
_STATUS = pa.array(["visible", "tie"])
# What pyarrow takes without being told.
_GROUP_ROWS = 1 << 20
# Of the frames at hand; more goes to disk.
_IN_MEMORY = 4 << 20


@dataclass(frozen=True, eq=False)
class FrameRows:
    """One view of a frame of a truth file: visible objects, ascending, samples owned by each, and
    samples that anything owns (None in a file that does not say)."""

    objects: NDArray[np.int64]
    samples: NDArray[np.int64]
    owned: int | None


@dataclass(frozen=True, eq=False)
class RecordedTruth:
    """A truth file's content by frame and view, and which engine cast it. `exact`: whether that
    engine is exact, None where the file does not say. `findings`: what its reader should know."""

    engine: str
    exact: bool | None
    views: Mapping[tuple[int, str], FrameRows]
    findings: tuple[Finding, ...] = ()

    def seen(self, frame: int, view: str, objects: int) -> NDArray[np.bool_]:
        """(objects,) bool, those that own a sample of a view."""
        result = np.zeros(objects, np.bool_)
        result[self.views[frame, view].objects] = True
        return result

    def known(self, objects: int, frame: int, view: str) -> NDArray[np.bool_] | None:
        """The same, None for what the file does not hold."""
        return self.seen(frame, view, objects) if (frame, view) in self.views else None

    @cached_property
    def frames(self) -> dict[int, FrameRows]:
        """By frame, the view without a name."""
        return {frame: rows for (frame, view), rows in self.views.items() if view == UNNAMED}


class TruthTable:
    """Collects frames and makes the file. What frames say is kept on disk until then."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._names = pa.array(scene.names, pa.string())
        self._spool = Spool(_IN_MEMORY)
        self._parts: list[_Frame] = []
        self._frames: list[int] = []
        self._views: list[str] = []
        self._owned: list[int] = []

    def add(self, frame: int, width: int, seen: ObjectVisibility, *, view: str = UNNAMED) -> None:
        """Add one view of a frame, `width` samples wide."""
        self._frames.append(frame)
        self._views.append(view)
        self._owned.append(seen.owned)
        objects = np.flatnonzero(seen.visible)
        y, x = np.divmod(seen.sample[objects], width)
        columns: dict[str, NDArray[Any]] = {
            "object": objects.astype(np.int32),
            "pixels": seen.samples[objects].astype(np.int64),
            "status": seen.alone[objects] > 0,
            "x": x.astype(np.int32),
            "y": y.astype(np.int32),
            "depth": seen.depth[objects],
        }
        places = {name: self._spool.put_arrays([column]) for name, column in columns.items()}
        self._parts.append(_Frame(self._spool, self._names, frame, view, len(objects), places))

    def write(
        self,
        file: Path,
        *,
        engine: str,
        path: CameraPath,
        ties_complete: bool,
        exact: bool | None = None,
    ) -> None:
        """Write the file; the caller has made the place safe. `exact`: whether the engine is,
        None where that is not known."""
        facts: dict[str, Any] = {
            "format": FORMAT,
            "version": VERSION,
            "engine": engine,
            "exact": exact,
            "scene": self._scene.digest,
            "path": path_digest(path),
            "ties_complete": ties_complete,
            "frames": self._frames,
            "views": self._views,
            "owned": self._owned,
        }
        seal(file, self._parts, facts)


@dataclass(frozen=True, eq=False)
class _Frame:
    """The rows of one view of a frame, `rows` of them, a column at a time: where those are in the
    spool that hang on the frame. `names`: of the scene's objects."""

    spool: Spool
    names: pa.Array
    frame: int
    view: str
    rows: int
    places: Mapping[str, tuple[int, int]]

    def __getitem__(self, name: str) -> pa.Array:
        if name == "frame":
            return pa.repeat(pa.scalar(self.frame, pa.int32()), self.rows)
        if name == "view":
            return pa.repeat(pa.scalar(self.view), self.rows)
        (values,) = self.spool.get_arrays(self.places["object" if name == "name" else name])
        if name == "name":
            return self.names.take(pa.array(values))
        if name == "status":
            return _STATUS.take(pa.array(1 - values.astype(np.int8)))
        return pa.array(values)


class Columns(Protocol):
    """Rows of a truth file, a column at a time."""

    def __getitem__(self, name: str, /) -> Any: ...


def seal(file: Path, parts: Sequence[Columns], facts: dict[str, Any]) -> None:
    """Write rows and facts, with a digest of both. Never more rows are held than a row group has,
    and a part's."""
    facts = {**facts, "digest": digest_of(parts, facts)}
    schema = SCHEMA.with_metadata({KEY: json.dumps(facts, sort_keys=True)})
    table = schema.empty_table()
    with (
        for_arrow(file, "wb") as out,
        pq.ParquetWriter(out, schema, compression="zstd") as writer,
    ):

        def write(rows: int) -> pa.Table:
            # How a table is put together shows in a file's bytes.
            writer.write_table(table.slice(0, rows).combine_chunks(), row_group_size=_GROUP_ROWS)
            return table.slice(rows)

        for part in parts:
            more = pa.table([part[name] for name in SCHEMA.names], schema=schema)
            table = pa.concat_tables([table, more])
            while len(table) > _GROUP_ROWS:
                table = write(_GROUP_ROWS)
        write(len(table))


def digest_of(parts: Sequence[Columns], facts: dict[str, Any]) -> str:
    """SHA-256 (hexadecimal) of the rows, in their order, and of the facts but for the digest.
    It depends on the values alone, not on how the file is laid out."""
    said = {name: value for name, value in facts.items() if name != "digest"}
    digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for name in SCHEMA.names:
        if pa.types.is_string(SCHEMA.field(name).type):
            # Lengths before letters: no two columns of texts give the same bytes.
            for part in parts:
                digest.update(pc.binary_length(part[name]).to_numpy().astype("<i4").tobytes())
            for part in parts:
                for letters in _letters(part[name]):
                    digest.update(letters)
        else:
            for part in parts:
                values = part[name].to_numpy()
                digest.update(values.astype(values.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def _letters(texts: pa.Array | pa.ChunkedArray) -> Iterator[memoryview]:
    """The bytes of a column of texts, one after another, as they lie in memory (UTF-8)."""
    for array in texts.chunks if isinstance(texts, pa.ChunkedArray) else [texts]:
        _valid, offsets, letters = array.buffers()
        if letters is None or not len(array):
            continue
        at = np.frombuffer(offsets, np.int32)[array.offset : array.offset + len(array) + 1]
        yield memoryview(letters)[at[0] : at[-1]]


def path_digest(path: CameraPath) -> str:
    """SHA-256 (hexadecimal) of what every frame's samples and scene hang on."""
    definitions = [frame.definition() for frame in path.frames]
    if not path.without_gaps:
        definitions.append({"numbers": list(path.numbers)})
    return hashlib.sha256(json.dumps(definitions, sort_keys=True).encode()).hexdigest()
