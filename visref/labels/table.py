"""Label files: a row per frame, view and object that is there, hidden or not, as Parquet.

`docs/labels.md` defines the columns. The metadata (JSON under the key `visref`) names the engine,
whether it is exact, and the hashes of scene and path; it lists the frames and views, and seals rows
and metadata with a digest, so that an edited file is refused when files are merged.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.files import for_arrow, refuse_inputs, replacing_file
from visref.labels.frame import FrameLabels
from visref.recordings.spool import Spool
from visref.recordings.truth_file import TRUTH_BEGINS, path_digest
from visref.scene import Scene

_BOX = pa.list_(pa.field("element", pa.int32(), nullable=False), 4)
_OCCLUDER = pa.struct(
    [
        pa.field("object", pa.int32(), nullable=False),
        pa.field("samples", pa.int64(), nullable=False),
        pa.field("share", pa.float64(), nullable=False),
    ]
)
SCHEMA = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("view", pa.string(), nullable=False),
        pa.field("object", pa.int32(), nullable=False),
        pa.field("name", pa.string(), nullable=False),
        pa.field("visible_samples", pa.int64(), nullable=False),
        pa.field("silhouette_samples", pa.int64(), nullable=False),
        ("visibility_fraction", pa.float64()),
        ("in_view_fraction", pa.float64()),
        ("undecided_fraction", pa.float64()),
        ("visible_box", _BOX),
        ("amodal_box", _BOX),
        ("depth", pa.float64()),
        pa.field("occluders", pa.list_(_OCCLUDER), nullable=False),
    ]
)
_KEY = b"visref"
FORMAT, VERSION = "visref-labels", 1
_FACTS: dict[str, type | tuple[type, ...]] = {
    "engine": str, "exact": bool, "scene": str, "path": str, "frames": list, "views": list,
    "digest": str,
}  # fmt: skip
# Of one scene, path and engine.
_SAME = {
    "scene": "of another scene",
    "path": "of another path",
    "engine": "cast by another engine",
}
# Of the frames at hand; more goes to disk.
_IN_MEMORY = 16 << 20


class LabelTable:
    """Collects frames and makes the file. What frames say is kept on disk until then."""

    def __init__(self, scene: Scene) -> None:
        self._names = pa.array(scene.names, pa.string())
        self._spool = Spool(_IN_MEMORY)
        self._cells: list[tuple[int, str, tuple[int, int]]] = []

    def add(self, frame: int, labels: FrameLabels) -> None:
        """Add one view of a frame."""
        there = np.flatnonzero(labels.there)
        kept = labels.there[labels.occluders[:, 0]]
        place = self._spool.put_arrays(
            [
                there,
                labels.visible_samples[there],
                labels.silhouette_samples[there],
                labels.visibility_fraction[there],
                labels.in_view_fraction[there],
                labels.undecided_fraction[there],
                labels.visible_box[there],
                labels.amodal_box[there],
                labels.depth[there],
                labels.occluders[kept],
            ]
        )
        self._cells.append((frame, labels.camera.view, place))

    def write(self, file: Path, *, engine: str, exact: bool, scene: str, path: CameraPath) -> None:
        """Write the file; the caller has made the place safe. `engine` names it, `scene` is the
        scene's digest."""
        facts = {
            "format": FORMAT,
            "version": VERSION,
            "engine": engine,
            "exact": exact,
            "scene": scene,
            "path": path_digest(path),
            "frames": [frame for frame, _, _ in self._cells],
            "views": [view for _, view, _ in self._cells],
        }
        _seal(file, lambda: map(self._rows, self._cells), facts)

    def _rows(self, cell: tuple[int, str, tuple[int, int]]) -> pa.Table:
        frame, view, place = cell
        arrays = self._spool.get_arrays(place)
        objects, visible, silhouette, *fractions = arrays[:6]
        visible_box, amodal_box, depth, occluders = arrays[6:]
        count = len(objects)
        starts = np.searchsorted(occluders[:, 0], objects)
        offsets = np.append(starts, len(occluders)).astype(np.int32)
        of = silhouette[np.searchsorted(objects, occluders[:, 0])]
        hiding = pa.StructArray.from_arrays(
            [
                pa.array(occluders[:, 1].astype(np.int32)),
                pa.array(occluders[:, 2]),
                pa.array(occluders[:, 2] / np.maximum(of, 1)),
            ],
            fields=list(_OCCLUDER),
        )
        columns = [
            pa.repeat(pa.scalar(frame, pa.int32()), count),
            pa.repeat(pa.scalar(view), count),
            pa.array(objects.astype(np.int32)),
            self._names.take(pa.array(objects)),
            pa.array(visible),
            pa.array(silhouette),
            *(pa.array(one, from_pandas=True) for one in fractions),
            _boxes(visible_box),
            _boxes(amodal_box),
            pa.array(depth, from_pandas=True),
            pa.ListArray.from_arrays(pa.array(offsets), hiding),
        ]
        return pa.table(columns, schema=SCHEMA)


def _boxes(boxes: np.ndarray[Any, Any]) -> pa.Array:
    """A column of boxes, (k, 4) int64, null where one has no extent."""
    none = boxes[:, 2] <= boxes[:, 0]
    values = pa.array(boxes.astype(np.int32).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(values, type=_BOX, mask=pa.array(none))


def _seal(file: Path, parts: Any, facts: dict[str, Any]) -> None:
    """Write the rows of `parts()`, tables of a frame's view each, with a digest of rows and facts.
    A row group is a frame's view, however parts are put together."""
    digest = _Digest(facts)
    for part in parts():
        digest.add(part)
    sealed = {**facts, "digest": digest.value()}
    schema = SCHEMA.with_metadata({_KEY: json.dumps(sealed, sort_keys=True)})
    with (
        for_arrow(file, "wb") as out,
        pq.ParquetWriter(out, schema, compression="zstd") as writer,
    ):
        for part in parts():
            writer.write_table(part.combine_chunks(), row_group_size=max(1, len(part)))


class _Digest:
    """SHA-256 (hexadecimal) of facts and rows, whatever the layout of the file."""

    def __init__(self, facts: dict[str, Any]) -> None:
        said = {name: value for name, value in facts.items() if name != "digest"}
        self._state = hashlib.sha256(json.dumps(said, sort_keys=True).encode())

    def add(self, part: pa.Table) -> None:
        for column in part.columns:
            for piece in _pieces(pa.concat_arrays(column.chunks)) if column.num_chunks else ():
                self._state.update(piece)

    def value(self) -> str:
        return self._state.hexdigest()


def _pieces(values: pa.Array) -> Iterator[bytes]:
    """A column's values as bytes: no two columns of one type give the same."""
    yield values.is_valid().to_numpy(zero_copy_only=False).tobytes()
    kind = values.type
    if pa.types.is_string(kind):
        texts = [text.encode() for text in values.to_pylist()]
        yield np.array(list(map(len, texts)), "<i8").tobytes()
        yield b"".join(texts)
    elif pa.types.is_struct(kind):
        for field in values.flatten():
            yield from _pieces(field)
    elif pa.types.is_fixed_size_list(kind):
        yield from _pieces(values.flatten())
    elif pa.types.is_list(kind):
        yield values.value_lengths().to_numpy(zero_copy_only=False).astype("<i8").tobytes()
        yield from _pieces(values.flatten())
    else:
        numbers = values.drop_null().to_numpy(zero_copy_only=False)
        yield numbers.astype(numbers.dtype.newbyteorder("<")).tobytes()


def is_labels(file: Path) -> bool:
    """Whether a file says that it holds labels."""
    try:
        with for_arrow(file) as data, pq.ParquetFile(data) as opened:
            found = json.loads((opened.schema_arrow.metadata or {}).get(_KEY, b"{}"))
    except (OSError, pa.ArrowException, ValueError, RecursionError):
        return False
    return isinstance(found, dict) and found.get("format") == FORMAT


def merge_labels(files: Sequence[Path], out: Path) -> int:
    """Write the labels of all files to `out`, as `visref truth` writes those of all their frames;
    how many frames that is. Raises InputError where they do not belong together, or where one was
    changed after it was written."""
    parts = sorted(((_facts(file), file) for file in files), key=lambda one: one[0]["frames"][:1])
    first, first_file = parts[0]
    for facts, file in parts[1:]:
        for name, problem in _SAME.items():
            if facts[name] != first[name]:
                raise InputError(
                    f"it is {problem} than {first_file}",
                    source=str(file),
                    fix="merge labels of one scene, path and engine",
                )
    refuse_inputs(out, files)
    for (one, one_file), (other, other_file) in pairwise(parts):
        if one["frames"][-1:] >= other["frames"][:1]:
            raise InputError(
                f"its frames overlap with those of {one_file}, or lie between them",
                source=str(other_file),
                fix="label parts that follow each other, with --frames A:B",
            )
    lists = {name: [x for facts, _ in parts for x in facts[name]] for name in ("frames", "views")}
    said = {name: value for name, value in first.items() if name != "digest"}
    with replacing_file(out, begins=TRUTH_BEGINS) as beside:
        _seal(beside, lambda: (row for _, file in parts for row in _groups(file)), said | lists)
    return len(set(lists["frames"]))


def _groups(file: Path) -> Iterator[pa.Table]:
    """The rows of a label file, a frame's view after another."""
    with for_arrow(file) as data, pq.ParquetFile(data) as opened:
        for group in range(opened.num_row_groups):
            yield opened.read_row_group(group).replace_schema_metadata(None)


def _facts(file: Path) -> dict[str, Any]:
    """What a label file says of itself. Raises InputError where it is none, or was changed."""
    source, fix = str(file), "write one with `visref truth --labels`"
    try:
        with for_arrow(file) as data, pq.ParquetFile(data) as opened:
            found = opened.schema_arrow
        facts = json.loads((found.metadata or {}).get(_KEY, b"{}"))
    except (OSError, pa.ArrowException, ValueError, RecursionError) as error:
        raise InputError("cannot read it as a label file", source=source, fix=fix) from error
    if not isinstance(facts, dict) or facts.get("format") != FORMAT:
        raise InputError("this is not a label file", source=source, fix=fix)
    whole = all(isinstance(facts.get(name), kind) for name, kind in _FACTS.items())
    if facts.get("version") != VERSION or not whole or not found.equals(SCHEMA):
        raise InputError("its columns are not those of a label file", source=source, fix=fix)
    digest = _Digest(facts)
    try:
        for part in _groups(file):
            digest.add(part)
    except (OSError, pa.ArrowException, ValueError) as error:
        raise InputError("cannot read it as a label file", source=source, fix=fix) from error
    if digest.value() != facts["digest"]:
        problem = "it was changed after it was written: its digest is another"
        raise InputError(problem, source=source, fix="label again")
    return facts
