"""Writing objects.parquet, a batch of rows at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from visref.judging.asking import Job
from visref.judging.causes import CausesFound
from visref.judging.judge import FrameVerdict
from visref.judging.outcome import witness_json
from visref.judging.referee import JudgedFrame
from visref.run_folder.causes import superfluous_causes
from visref.run_folder.groups import RowGroups
from visref.run_folder.layout import OBJECTS_SCHEMA, ObjectKind
from visref.scene import OBJECT, Int32, Scene


class ObjectsWriter:
    """Collects rows and writes them. Superfluous units are explained in the frames `explained`."""

    def __init__(self, file: Path, scene: Scene, explained: Sequence[int]) -> None:
        self._file = file
        self._groups = RowGroups(file, OBJECTS_SCHEMA)
        self._scene = scene
        self._explained = frozenset(explained)
        self._names = pa.array(scene.names, pa.string())

    def add(self, job: Job, judged: JudgedFrame) -> None:
        """Add what a culler missed, drew for nothing or left in doubt in one view of a frame."""
        record, verdict = judged.record, judged.record.verdict
        misses = []
        for miss in verdict.misses:
            witness = witness_json(self._scene, record.frame, miss)
            witness["name"] = witness.pop("object_name")
            misses.append({"culler": job.spec, **witness, "age": miss.age})
        self._groups.add(pa.Table.from_pylist(misses, schema=OBJECTS_SCHEMA))

        def rows(kind: ObjectKind, count: int, columns: dict[str, pa.Array]) -> None:
            """Rows of which all columns that are not given are null."""
            columns = columns | {
                "culler": pa.repeat(pa.scalar(job.spec), count),
                "frame": pa.repeat(pa.scalar(record.frame, pa.int32()), count),
                "view": pa.repeat(pa.scalar(record.view), count),
                "kind": pa.repeat(pa.scalar(kind.value), count),
            }
            every = [columns.get(f.name, pa.nulls(count, f.type)) for f in OBJECTS_SCHEMA]
            self._groups.add(pa.table(every, schema=OBJECTS_SCHEMA))

        units = pa.array(verdict.superfluous_units, pa.int32())
        columns: dict[str, pa.Array] = {"unit": units, "cause": self._causes(job, judged)}
        columns |= self._hiders(verdict.superfluous_units, verdict)
        if job.units.kind == OBJECT:
            columns |= {"object": units, "name": self._names.take(units)}
        else:
            columns["object"] = pa.repeat(pa.scalar(-1, pa.int32()), len(units))
        rows(ObjectKind.SUPERFLUOUS, len(units), columns)
        objects = pa.array(verdict.undecided_objects, pa.int32())
        columns = {"object": objects, "name": self._names.take(objects)}
        rows(ObjectKind.UNDECIDED, len(objects), columns)

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

    def _causes(self, job: Job, judged: JudgedFrame) -> pa.Array:
        """Why each superfluous unit was drawn; null in frames that are not explained."""
        units = judged.record.verdict.superfluous_units
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


def name_causes(file: Path, causes: Mapping[str, CausesFound]) -> None:
    """Write objects.parquet again, with the causes of misses, by culler. They are known only when
    every answer was judged, and the rows are too many to be held until then."""
    if not any(found.named for found in causes.values()):
        return
    named = file.with_name(file.name + ".named")
    groups = RowGroups(named, OBJECTS_SCHEMA)
    with pq.ParquetFile(file) as read:
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
    columns = [rows.column(name) for name in ("culler", "frame", "view", "object")]
    for row in missed.tolist():
        culler, frame, view, obj = (column[row].as_py() for column in columns)
        found = causes.get(culler, CausesFound()).of(frame, view, obj)
        values[row] = found[0].cause if found else None
    return rows.set_column(place, OBJECTS_SCHEMA.field(place), pa.array(values, pa.string()))
