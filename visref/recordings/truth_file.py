"""Truth files: one row per frame, view and object that owns a sample, as Parquet.

Columns `frame int32, view string, object int32, name string, pixels int64, status string
("visible" or "tie"), x int32, y int32, depth float64`, where (x, y, depth) is one witness. The
metadata (JSON under the key `visref`) names the engine, whether it is exact, and the hashes of
scene and path; it lists the frames, their views and how many samples anything owns there; and it
seals rows and metadata with a digest, so that an edited file is refused.

Version 1 has no column `view`, no digest, and does not say whether the engine is exact; it is
still read.
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
from visref.errors import InputError
from visref.files import for_arrow
from visref.findings import Code, Finding
from visref.recordings.spool import Spool
from visref.scene import Scene
from visref.visibility import ObjectVisibility

_SCHEMA = pa.schema(
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
_KEY = b"visref"
_FORMAT = "visref-truth"
_VERSION = 2
_READABLE = (1, 2)

# The view of a frame that has one camera without a name.
_UNNAMED = ""
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
    views: dict[tuple[int, str], FrameRows]
    findings: tuple[Finding, ...] = ()

    def seen(self, frame: int, view: str, objects: int) -> NDArray[np.bool_]:
        """(objects,) bool, those that own a sample of a view."""
        result = np.zeros(objects, np.bool_)
        result[self.views[frame, view].objects] = True
        return result

    @cached_property
    def frames(self) -> dict[int, FrameRows]:
        """By frame, the view without a name."""
        return {frame: rows for (frame, view), rows in self.views.items() if view == _UNNAMED}


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

    def add(self, frame: int, width: int, seen: ObjectVisibility, *, view: str = _UNNAMED) -> None:
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
            "format": _FORMAT,
            "version": _VERSION,
            "engine": engine,
            "exact": exact,
            "scene": self._scene.digest,
            "path": path_digest(path),
            "ties_complete": ties_complete,
            "frames": self._frames,
            "views": self._views,
            "owned": self._owned,
        }
        _seal(file, self._parts, facts)


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


class _Columns(Protocol):
    """A table's rows, a column at a time."""

    def __getitem__(self, name: str, /) -> Any: ...


def _seal(file: Path, parts: Sequence[_Columns], facts: dict[str, Any]) -> None:
    """Write rows and facts, with a digest of both. Never more rows are held than a row group has,
    and a part's."""
    facts = {**facts, "digest": _digest(parts, facts)}
    schema = _SCHEMA.with_metadata({_KEY: json.dumps(facts, sort_keys=True)})
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
            more = pa.table([part[name] for name in _SCHEMA.names], schema=schema)
            table = pa.concat_tables([table, more])
            while len(table) > _GROUP_ROWS:
                table = write(_GROUP_ROWS)
        write(len(table))


def _digest(parts: Sequence[_Columns], facts: dict[str, Any]) -> str:
    """SHA-256 (hexadecimal) of the rows, in their order, and of the facts but for the digest.
    It depends on the values alone, not on how the file is laid out."""
    said = {name: value for name, value in facts.items() if name != "digest"}
    digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for name in _SCHEMA.names:
        if pa.types.is_string(_SCHEMA.field(name).type):
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


def read_truth(
    file: Path | str, scene: Scene, path: CameraPath, frames: Sequence[int]
) -> RecordedTruth:
    """Read a truth file for these frames of this scene and path.

    Raises InputError if it is no truth file, or belongs to another scene or path, or lacks
    one of the frames.
    """
    source = str(file)
    table, facts = _table_and_facts(Path(file), source, scene.object_count)
    for what, now in (("scene", scene.digest), ("path", path_digest(path))):
        if facts[what] != now:
            raise InputError(
                f"it was cast for another {what}", source=source, fix="cast the truth again"
            )
    wanted = set(frames)
    if not wanted <= set(facts["frames"]):
        raise InputError("it lacks frames of this run", source=source, fix="cast them all")
    version_1 = facts["version"] == 1
    on_file = _cells(facts, path, source)
    _check_rows(table, on_file, scene, path, source)
    cells = {cell: count for cell, count in on_file.items() if cell[0] in wanted}
    rows = _rows_by_cell(table, cells, None if version_1 else table["view"])
    unsealed = Finding(Code.TRUTH_UNSEALED, f"{source} is of version 1 and has no digest")
    findings = (unsealed,) if version_1 else ()
    return RecordedTruth(facts["engine"], facts.get("exact"), rows, findings)


def _cells(
    facts: dict[str, Any], path: CameraPath, source: str
) -> dict[tuple[int, str], int | None]:
    """By frame and view, all that the file has: how many samples anything owns. Raises InputError
    where the lists do not go together, or name a frame or a view that the path lacks."""
    frames = facts["frames"]
    views = facts["views"] if facts["version"] > 1 else [_UNNAMED] * len(frames)
    # Some files of version 1 do not say it.
    owned = facts.get("owned") or [None] * len(frames)
    known = {
        (frame, camera.view): camera.samples
        for frame in path.numbers
        for camera in path.views(frame)
    }
    cells: dict[tuple[int, str], int | None] = {}
    for cell, count in zip(zip(frames, views, strict=False), owned, strict=False):
        whole = count is None or (_is_whole(count) and count <= known.get(cell, 0))
        if cell not in known or cell in cells or not whole:
            break
        cells[cell] = count
    if not len(cells) == len(frames) == len(views) == len(owned):
        raise _spoilt(source, "its frames, views and owned samples do not go together")
    return cells


def _check_rows(
    table: pa.Table,
    cells: dict[tuple[int, str], int | None],
    scene: Scene,
    path: CameraPath,
    source: str,
) -> None:
    """Raises InputError where a row tells of an object, a frame, a view or a sample that there is
    not, or of the same object again."""
    objects = table["object"].to_numpy().astype(np.int64)
    if len(objects) and not 0 <= objects.min() <= objects.max() < scene.object_count:
        raise InputError(
            "a row names an object that the scene lacks",
            source=source,
            place="object",
            fix="cast the truth again",
        )
    numbers = {cell: number for number, cell in enumerate(cells)}
    views = table["view"] if "view" in table.column_names else [_UNNAMED] * len(table)
    view_names = views if isinstance(views, list) else views.to_pylist()
    frames = table["frame"].to_pylist()
    place = [numbers.get(cell, -1) for cell in zip(frames, view_names, strict=True)]
    cell_of = np.array(place, np.int64)
    if len(cell_of) and cell_of.min() < 0:
        raise _spoilt(source, "a row is of a frame or a view that its metadata does not list")
    if len(np.unique(cell_of * scene.object_count + objects)) < len(objects):
        raise _spoilt(source, "an object stands twice in a frame")
    by_view = {
        (frame, camera.view): camera for frame in path.numbers for camera in path.views(frame)
    }
    sizes = np.array(
        [(by_view[cell].width, by_view[cell].height) for cell in cells], np.int64
    ).reshape(-1, 2)[cell_of]
    x, y, pixels = (table[name].to_numpy().astype(np.int64) for name in ("x", "y", "pixels"))
    inside = (x >= 0) & (x < sizes[:, 0]) & (y >= 0) & (y < sizes[:, 1])
    counted = (pixels >= 1) & (pixels <= sizes[:, 0] * sizes[:, 1])
    if not (inside & counted & np.isfinite(table["depth"].to_numpy())).all():
        raise _spoilt(source, "a row tells of samples that its view does not have")
    if not set(pc.unique(table["status"]).to_pylist()) <= {"visible", "tie"}:
        raise _spoilt(source, "its status is neither 'visible' nor 'tie'")


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _spoilt(source: str, problem: str) -> InputError:
    return InputError(problem, source=source, fix="cast the truth again")


def _rows_by_cell(
    table: pa.Table, owned: dict[tuple[int, str], int | None], views: pa.ChunkedArray | None
) -> dict[tuple[int, str], FrameRows]:
    """The rows of each frame and view of `owned`, which says how many samples anything owns."""
    frame = table["frame"].to_numpy()
    objects, pixels = table["object"].to_numpy().astype(np.int64), table["pixels"].to_numpy()
    order = np.argsort(frame, kind="stable")
    in_order = frame[order]
    found = {}
    for (index, view), count in owned.items():
        low, high = np.searchsorted(in_order, [index, index + 1])
        at = order[low:high]
        if views is not None:
            at = at[pc.equal(views.take(pa.array(at)), view).to_numpy()]
        found[index, view] = FrameRows(objects[at], pixels[at], count)
    return found


@dataclass(frozen=True, eq=False)
class TruthRows:
    """A truth file as it stands, without the scene and the path that it is of: its rows, and what
    its metadata says."""

    file: Path
    table: pa.Table
    facts: dict[str, Any]

    @cached_property
    def cells(self) -> dict[tuple[int, str], int]:
        """By frame and view, how many samples anything owns."""
        lists = (self.facts[name] for name in ("frames", "views", "owned"))
        return {(frame, view): owned for frame, view, owned in zip(*lists, strict=True)}

    @cached_property
    def recorded(self) -> RecordedTruth:
        """By frame and view."""
        rows = _rows_by_cell(self.table, dict(self.cells), self.table["view"])
        return RecordedTruth(self.facts["engine"], self.facts["exact"], rows)


def can_be_merged(file: Path) -> bool:
    """Whether a truth file says that it is of version 2, which alone `read_rows` takes."""
    try:
        with for_arrow(file) as data, pq.ParquetFile(data) as opened:
            found = json.loads((opened.schema_arrow.metadata or {}).get(_KEY, b"{}"))
    except (OSError, pa.ArrowException, ValueError, RecursionError):
        return False
    return isinstance(found, dict) and found.get("version") == _VERSION


def read_rows(file: Path, objects: int | None = None) -> TruthRows:
    """A truth file of version 2, and of a scene with so many `objects` (None: any). Raises
    InputError where it is none, or was changed after it was written."""
    source = str(file)
    table, facts = _table_and_facts(file, source, objects)
    if facts["version"] != _VERSION:
        raise InputError("it is of version 1", source=source, fix="cast the truth again")
    lists = [facts[name] for name in ("frames", "views", "owned")]
    whole = all(map(_is_whole, facts["owned"]))
    if (
        len(set(map(len, lists))) > 1
        or not whole
        or len(set(zip(*lists[:2], strict=True))) < len(lists[0])
    ):
        raise _spoilt(source, "its frames, views and owned samples do not go together")
    found = table["object"].to_numpy()
    if len(found) and (found.min() < 0 or (objects is not None and found.max() >= objects)):
        raise _spoilt(source, "a row names an object that there is not")
    return TruthRows(file, table, facts)


def write_joined(file: Path, parts: Sequence[TruthRows]) -> None:
    """Write the truth of all parts, of frames that ascend from one to the next, as if it had been
    cast at once; the caller has made the place safe."""
    first = parts[0].facts
    lists = {
        name: [value for part in parts for value in part.facts[name]]
        for name in ("frames", "views", "owned")
    }
    tables = [part.table.replace_schema_metadata(None) for part in parts]
    facts = {name: value for name, value in first.items() if name != "digest"}
    _seal(file, tables, {**facts, **lists})


def _table_and_facts(
    file: Path, source: str, objects: int | None
) -> tuple[pa.Table, dict[str, Any]]:
    """The table, and what its metadata says, both of the form that `TruthTable` writes. `objects`:
    how many the scene has, None where that is not known."""
    fix = "write one with `visref truth`"
    if not file.is_file():
        raise InputError("there is no such truth file", source=source, fix=fix)
    try:
        with for_arrow(file) as data, pq.ParquetFile(data) as opened:
            found, count = opened.schema_arrow, opened.metadata.num_rows
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise InputError("cannot read it as a truth file", source=source, fix=fix) from error
    try:
        facts = json.loads((found.metadata or {}).get(_KEY, b"{}"))
    except (ValueError, RecursionError):
        facts = None
    if not isinstance(facts, dict) or facts.get("format") != _FORMAT:
        raise InputError("this is not a truth file", source=source, fix=fix)

    def spoilt(problem: str) -> InputError:
        return _spoilt(source, problem)

    version = facts.get("version")
    if not _is_whole(version) or version not in _READABLE:
        raise spoilt(f"its version is {version!r}, and this visref reads 1 to {_VERSION}")
    kinds: dict[str, type | tuple[type, ...]] = {
        "engine": str, "scene": str, "path": str, "ties_complete": bool, "frames": list,
    }  # fmt: skip
    schema = _SCHEMA
    if version == 1:
        schema = schema.remove(schema.get_field_index("view"))
    else:
        kinds |= {"exact": (bool, type(None)), "views": list, "owned": list, "digest": str}
    odd = [
        name
        for name, kind in kinds.items()
        if name not in facts or not isinstance(facts[name], kind)
    ]
    if odd or not found.equals(schema):
        where = ", ".join(odd) or "columns"
        raise spoilt(f"its {where} are not those of a truth file")
    if not all(map(_is_whole, facts["frames"])) or not all(
        isinstance(view, str) for view in facts.get("views", ())
    ):
        raise spoilt("its frames or views are not those of a truth file")
    # An object has one row at most in each view of a frame; looked at before rows are made.
    if objects is not None and count > len(facts["frames"]) * objects:
        raise spoilt(f"it has {count} rows, more than objects in its frames")
    try:
        with for_arrow(file) as data:
            table = pq.read_table(data)
        # Texts that are not UTF-8 among them.
        table.validate(full=True)
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise InputError("cannot read it as a truth file", source=source, fix=fix) from error
    if any(column.null_count for column in table.columns):
        raise spoilt("its columns are not those of a truth file: a cell is empty")
    if version >= 2 and facts["digest"] != _digest([table], facts):
        raise spoilt("it was changed after it was written: its digest is another")
    return table, facts
