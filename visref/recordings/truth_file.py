"""Truth files: a row per frame and object that owns a sample, as Parquet.

Columns `frame int32, object int32, name string, pixels int64, status string ("visible" or
"tie"), x int32, y int32, depth float64`, where (x, y, depth) is one witness. The metadata
names the engine and the hashes of scene and path.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.scene import Scene
from visref.visibility import ObjectVisibility

_SCHEMA = pa.schema(
    [
        ("frame", pa.int32()),
        ("object", pa.int32()),
        ("name", pa.string()),
        ("pixels", pa.int64()),
        ("status", pa.string()),
        ("x", pa.int32()),
        ("y", pa.int32()),
        ("depth", pa.float64()),
    ]
)
_KEY = b"visref"
_FORMAT = "visref-truth"
_VERSION = 1


@dataclass(frozen=True, eq=False)
class FrameRows:
    """One frame of a truth file: visible objects, ascending, samples owned by each, and samples
    that anything owns (None in a file that does not say)."""

    objects: NDArray[np.int64]
    pixels: NDArray[np.int64]
    owned: int | None


@dataclass(frozen=True, eq=False)
class RecordedTruth:
    """A truth file's content by frame, which engine cast it, and whether that engine is exact."""

    engine: str
    exact: bool
    frames: dict[int, FrameRows]


class TruthTable:
    """Collects frames and makes the table."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._names = np.array(scene.names, dtype=object)
        self._parts: list[pa.Table] = []
        self._frames: list[int] = []
        self._owned: list[int] = []

    def add(self, frame: int, width: int, seen: ObjectVisibility) -> None:
        """Add one frame, `width` samples wide."""
        self._frames.append(frame)
        self._owned.append(seen.owned)
        objects = np.flatnonzero(seen.visible)
        sample = seen.sample[objects]
        status = np.where(seen.alone[objects] > 0, "visible", "tie")
        columns = [
            np.full(len(objects), frame, np.int32),
            objects.astype(np.int32),
            pa.array(self._names[objects], pa.string()),
            seen.pixels[objects],
            pa.array(status.tolist(), pa.string()),
            (sample % width).astype(np.int32),
            (sample // width).astype(np.int32),
            seen.depth[objects],
        ]
        self._parts.append(pa.table(columns, schema=_SCHEMA))

    def write(self, file: Path, *, engine: str, path: CameraPath, ties_complete: bool) -> None:
        """Write the table; the caller has made the place safe."""
        facts = {
            "format": _FORMAT,
            "version": _VERSION,
            "engine": engine,
            "scene": self._scene.digest,
            "path": path_digest(path),
            "ties_complete": ties_complete,
            "frames": self._frames,
            "owned": self._owned,
        }
        table = pa.concat_tables([_SCHEMA.empty_table(), *self._parts])
        table = table.replace_schema_metadata({_KEY: json.dumps(facts, sort_keys=True)})
        pq.write_table(table, file, compression="zstd")


def path_digest(path: CameraPath) -> str:
    """SHA-256 (hexadecimal) of the samples' definition in every frame."""
    definitions = [camera.definition() for camera in path]
    return hashlib.sha256(json.dumps(definitions, sort_keys=True).encode()).hexdigest()


def read_truth(
    file: Path | str, scene: Scene, path: CameraPath, frames: Sequence[int]
) -> RecordedTruth:
    """Read a truth file for these frames of this scene and path.

    Raises InputError if it is no truth file, or belongs to another scene or path, or lacks
    one of the frames.
    """
    source = str(file)
    table, facts = _table_and_facts(Path(file), source)
    for what, now in (("scene", scene.digest), ("path", path_digest(path))):
        if facts[what] != now:
            raise InputError(
                f"it was cast for another {what}", source=source, fix="cast the truth again"
            )
    if not set(frames) <= set(facts["frames"]):
        raise InputError("it lacks frames of this run", source=source, fix="cast them all")
    frame = table["frame"].to_numpy()
    objects = table["object"].to_numpy().astype(np.int64)
    if len(objects) and not 0 <= objects.min() <= objects.max() < scene.object_count:
        raise InputError(
            "a row names an object that the scene lacks",
            source=source,
            place="object",
            fix="cast the truth again",
        )
    pixels = table["pixels"].to_numpy()
    order = np.argsort(frame, kind="stable")
    low = np.searchsorted(frame, frames, side="left", sorter=order)
    high = np.searchsorted(frame, frames, side="right", sorter=order)
    # Files that an earlier visref wrote do not say it.
    owned = dict(zip(facts["frames"], facts.get("owned", ()), strict=False))
    rows = {
        index: FrameRows(objects[order[start:end]], pixels[order[start:end]], owned.get(index))
        for index, start, end in zip(frames, low, high, strict=True)
    }
    return RecordedTruth(facts["engine"], facts["ties_complete"], rows)


def _table_and_facts(file: Path, source: str) -> tuple[pa.Table, dict[str, Any]]:
    """The table, and what its metadata says, both of the form that `TruthTable` writes."""
    fix = "write one with `visref truth`"
    if not file.is_file():
        raise InputError("there is no such truth file", source=source, fix=fix)
    try:
        table = pq.read_table(file)
    except (OSError, pa.ArrowException) as error:
        raise InputError("cannot read it as a truth file", source=source, fix=fix) from error
    try:
        facts = json.loads((table.schema.metadata or {}).get(_KEY, b"{}"))
    except ValueError:
        facts = None
    if not isinstance(facts, dict) or facts.get("format") != _FORMAT:
        raise InputError("this is not a truth file", source=source, fix=fix)
    if facts.get("version") != _VERSION:
        raise InputError(
            f"its version is {facts.get('version')!r}, and this visref reads {_VERSION}",
            source=source,
            fix="cast the truth again",
        )
    kinds = {"engine": str, "scene": str, "path": str, "ties_complete": bool, "frames": list}
    odd = [name for name, kind in kinds.items() if not isinstance(facts.get(name), kind)]
    if odd or not table.schema.equals(_SCHEMA) or any(c.null_count for c in table.columns):
        where = ", ".join(odd) or "columns"
        raise InputError(
            f"its {where} are not those of a truth file",
            source=source,
            fix="cast the truth again",
        )
    return table, facts
