"""Writing objects.parquet, a batch of rows at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from visref.files import for_arrow
from visref.judging.asking import Job
from visref.judging.causes import CausesFound
from visref.judging.judge import FrameVerdict
from visref.judging.misses import Misses
from visref.judging.referee import JudgedFrame
from visref.run_folder.causes import superfluous_causes
from visref.run_folder.groups import RowGroups
from visref.run_folder.layout import OBJECTS_SCHEMA, ObjectKind
from visref.scene import OBJECT, Float64, Int32, Scene


class ObjectsWriter:
    """Collects rows and writes them. Superfluous units have rows, and are explained, in the frames
    `explained`. Elsewhere those have rows that a promise forbids, or all of them with `every`."""

    def __init__(
        self, file: Path, scene: Scene, explained: Sequence[int], *, every: bool = False
    ) -> None:
        self._file = file
        self._groups = RowGroups(file, OBJECTS_SCHEMA)
        self._scene = scene
        self._explained = frozenset(explained)
        self._every = every
        self._names = pa.array(scene.names, pa.string())

    def add(self, job: Job, judged: JudgedFrame) -> None:
        """Add what a culler missed, drew for nothing or left in doubt in one view of a frame."""
        record, verdict = judged.record, judged.record.verdict

        def rows(count: int, columns: dict[str, pa.Array], kind: ObjectKind | None = None) -> None:
            """Rows of which all columns that are not given are null."""
            if not count:
                return
            every = {
                "culler": pa.repeat(pa.scalar(job.spec), count),
                "frame": pa.repeat(pa.scalar(record.frame, pa.int32()), count),
                "view": pa.repeat(pa.scalar(record.view), count),
            }
            if kind is not None:
                every["kind"] = pa.repeat(pa.scalar(kind.value), count)
            every |= columns
            self._groups.add(
                pa.table(
                    [every.get(f.name, pa.nulls(count, f.type)) for f in OBJECTS_SCHEMA],
                    schema=OBJECTS_SCHEMA,
                )
            )

        if verdict.misses:
            rows(len(verdict.misses), self._missed(verdict.misses))
        hidden = verdict.superfluous_units
        if not (self._every or record.frame in self._explained):
            hidden = np.array([one.unit for one in verdict.confirmed_superfluous], np.int32)
        units = pa.array(hidden, pa.int32())
        columns: dict[str, pa.Array] = {"unit": units, "cause": self._causes(job, judged, hidden)}
        columns |= self._hiders(hidden, verdict)
        if job.units.kind == OBJECT:
            columns |= {"object": units, "name": self._names.take(units)}
        else:
            columns["object"] = pa.repeat(pa.scalar(-1, pa.int32()), len(units))
        rows(len(units), columns, ObjectKind.SUPERFLUOUS)
        objects = pa.array(verdict.undecided_objects, pa.int32())
        columns = {"object": objects, "name": self._names.take(objects)}
        rows(len(objects), columns, ObjectKind.UNDECIDED)

    def _missed(self, misses: Misses) -> dict[str, pa.Array]:
        """Columns of what was missed, each witness as `witness_json` tells it."""
        columns = misses.columns
        y, x = np.divmod(columns.sample, columns.width)
        found = {
            "view": misses.view_names(),
            "object": columns.object,
            "name": self._names.take(pa.array(columns.object)),
            "kind": misses.kind_names(),
            "pixels": columns.samples,
            "owned": columns.owned,
            "x": x.astype(np.int32),
            "y": y.astype(np.int32),
            "triangle": columns.triangle,
            "depth": columns.depth,
            "margin_px": _finite(columns.margin_px),
            "margin_depth": _finite(columns.margin_depth),
            "partly": columns.partly,
            "age": pa.array(columns.age, mask=columns.age < 0),
        }
        return {
            name: values if isinstance(values, pa.Array) else pa.array(values)
            for name, values in found.items()
        }

    def close(self, causes: Mapping[str, CausesFound]) -> None:
        """Write what is left, and the file if there was nothing at all. `causes`: by culler, why
        it missed what it missed."""
        self._groups.close()
        name_causes(self._file, causes)

    def _hiders(self, units: Int32, verdict: FrameVerdict) -> dict[str, pa.Array]:
        """What exact arithmetic found of each superfluous unit that a promise forbids; null for
        the others, and where a unit covers no sample."""
        if not verdict.confirmed_superfluous:
            return {}
        scene = self._scene
        rows: list[dict[str, Any]] = [{} for _ in units]
        for one in verdict.confirmed_superfluous:
            row = rows[int(np.searchsorted(units, one.unit))]
            row["samples"] = one.samples
            if one.occluder >= 0:
                row["occluder"] = one.occluder
                row["occluder_name"] = scene.owner_name(one.occluder)
                row["y"], row["x"] = divmod(one.sample, one.width)
        return {
            name: pa.array([row.get(name) for row in rows], OBJECTS_SCHEMA.field(name).type)
            for name in ("samples", "occluder", "occluder_name", "x", "y")
        }

    def _causes(self, job: Job, judged: JudgedFrame, units: Int32) -> pa.Array:
        """Why each of the superfluous units was drawn; null in frames that are not explained."""
        # A set for several views has causes of each of them.
        if len(judged.settled) != 1 or judged.record.frame not in self._explained:
            return pa.nulls(len(units), pa.string())
        (settled,) = judged.settled
        causes = superfluous_causes(
            settled.scene, settled.truth, job.units, judged.drawn_set, units
        )
        names = np.full(len(units), None, object)
        names[np.searchsorted(units, list(causes))] = list(causes.values())
        return pa.array(names, pa.string())


def _finite(margins: Float64) -> pa.Array:
    """Null where nothing limits a margin, as where it was not computed."""
    return pa.array(margins, mask=~np.isfinite(margins))


def name_causes(file: Path, causes: Mapping[str, CausesFound]) -> None:
    """Write objects.parquet again, with the causes of misses, by culler. They are known only when
    every answer was judged, and the rows are too many to be held until then."""
    if not any(found.named for found in causes.values()):
        return
    named = file.with_name(file.name + ".named")
    groups = RowGroups(named, OBJECTS_SCHEMA)
    with for_arrow(file) as data, pq.ParquetFile(data) as read:
        for number in range(read.num_row_groups):
            groups.add(_with_causes(read.read_row_group(number), causes))
    groups.close()
    named.replace(file)


def _with_causes(rows: pa.Table, causes: Mapping[str, CausesFound]) -> pa.Table:
    """The rows, those of misses with their likeliest cause."""
    place = OBJECTS_SCHEMA.get_field_index("cause")
    values = rows.column(place).to_pylist()
    # Of a miss alone the pixels lost are known.
    missed = np.flatnonzero(rows.column("pixels").is_valid().to_numpy(zero_copy_only=False))
    lost = rows.take(pa.array(missed))
    columns = (lost.column(name).to_pylist() for name in ("culler", "frame", "view", "object"))
    none = CausesFound()
    for row, culler, frame, view, obj in zip(missed.tolist(), *columns, strict=True):
        found = causes.get(culler, none).of(frame, view, obj)
        values[row] = found[0].cause if found else None
    return rows.set_column(place, OBJECTS_SCHEMA.field(place), pa.array(values, pa.string()))
