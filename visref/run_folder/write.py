"""The run folder: what a run leaves on disk, and all that reports are made from.

manifest.json      versions, hashes of the inputs, settings, samples' definition, machine
verdict.json       statuses, sums, findings
frames.parquet     a row a culler and frame: counts and costs
timings.parquet    a row a culler, frame and phase: milliseconds (the one file that
                   differs between two runs of the same inputs)
objects.parquet    a row a culler, frame and object that was missed, undecided or drawn
                   for nothing; the last with its cause, in the frames that have pictures
truth.parquet      the truth, as `visref truth` writes it
witnesses/         a file a culler; a JSON line a miss: its ray and the triangles along it
                   as hexadecimal floats, so that it replays without the scene
pictures/          PNGs of a few frames, listed in manifest.json
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref.culler import QueryStats
from visref.judging.judge import Counts, FrameVerdict
from visref.judging.outcome import RunOutcome, verdict_json, witness_json
from visref.judging.referee import Job, JudgedFrame
from visref.recordings.truth_file import TruthTable, path_digest
from visref.run_folder.causes import superfluous_causes
from visref.run_folder.pictures import PictureSet, draw_pictures
from visref.run_folder.witnesses import write_witnesses
from visref.scene import OBJECT, Int32, Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility

MANIFEST = "manifest.json"
VERDICT = "verdict.json"
TRUTH = "truth.parquet"

# File systems take names of 255 bytes; frame, kind and ending come on top.
SLUG_LENGTH = 80

_PACKAGES = ("numpy", "numba", "embreex", "open3d-cpu", "moderngl", "trimesh", "pyarrow")

_OBJECTS = pa.schema(
    [
        ("culler", pa.string()),
        ("frame", pa.int32()),
        ("object", pa.int32()),
        ("name", pa.string()),
        ("kind", pa.string()),
        ("pixels", pa.int64()),
        ("owned", pa.int64()),
        ("x", pa.int32()),
        ("y", pa.int32()),
        ("triangle", pa.int32()),
        ("depth", pa.float64()),
        ("margin_px", pa.float64()),
        ("margin_depth", pa.float64()),
        ("unit", pa.int32()),
        ("cause", pa.string()),
    ]
)
_COUNTERS = tuple(name for name in vars(QueryStats()) if name != "ms")
_FRAMES = pa.schema(
    [
        ("culler", pa.string()),
        *(
            (name, pa.int64())
            for name in (
                "frame",
                *vars(Counts()),
                *_COUNTERS,
                "corrections",
                "image_pixels_differ",
                "owned",
            )
        ),
    ]
)
_TIMINGS = pa.schema(
    [("culler", pa.string()), ("frame", pa.int64()), ("phase", pa.string()), ("ms", pa.float64())]
)
# Rows of objects.parquet that are held before they are written: some 10 MB. A culler of small
# units over a long path has tens of millions.
_PENDING_ROWS = 1 << 17


def slug(spec: str) -> str:
    """A culler's spec as part of a file name: itself where it may be, else a likeness of it
    with a digest, so that two specs never share a name."""
    likeness = re.sub(r"[^A-Za-z0-9._-]+", "_", spec)[:SLUG_LENGTH]
    if likeness == spec:
        return spec
    return f"{likeness}-{hashlib.sha256(spec.encode()).hexdigest()[:8]}"


class Recorder:
    """A run's listener that writes its folder. `folder` exists and is empty."""

    def __init__(
        self,
        folder: Path,
        scene: Scene,
        path: CameraPath,
        *,
        engine: str,
        settings: dict[str, Any],
        picture_frames: Sequence[int] = (),
    ) -> None:
        self._folder = folder
        self._scene = scene
        self._path = path
        self._engine = engine
        self._settings = settings
        self._picture_frames = frozenset(picture_frames)
        self._truth = TruthTable(scene)
        self._ties_complete = False
        self._has_truth = False
        self._frames: list[dict[str, Any]] = []
        self._timings: list[dict[str, Any]] = []
        self._names = pa.array(scene.names, pa.string())
        self._pending: list[pa.Table] = []
        self._objects: pq.ParquetWriter | None = None
        self._pictures: list[PictureSet] = []
        # By culler its units, and by frame the units drawn where something was missed.
        self._drawn: dict[str, tuple[Units, dict[int, Int32]]] = {}
        self._extra_pictures: dict[str, int] = {}

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        self._has_truth = True
        self._ties_complete = truth.ties_complete
        self._truth.add(frame, truth.camera.width, seen)
        self._timings.append(_timing("", frame, "truth", ms))

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        record, verdict = judged.record, judged.record.verdict
        counters = {name: getattr(record.stats, name) for name in _COUNTERS}
        if counters["triangles_drawn"] is None:
            counters["triangles_drawn"] = record.triangles_drawn
        if counters["units_drawn"] is None:
            counters["units_drawn"] = len(judged.drawn_units)
        self._frames.append(
            {
                "culler": job.spec,
                "frame": record.frame,
                **vars(verdict.counts),
                **counters,
                "corrections": record.corrections,
                "image_pixels_differ": record.image_pixels_differ,
                "owned": verdict.owned,
            }
        )
        self._timings += [
            _timing(job.spec, record.frame, phase, ms) for phase, ms in record.stats.ms.items()
        ]
        self._add_objects(job, judged)
        if verdict.misses:
            drawn = self._drawn.setdefault(job.spec, (job.units, {}))[1]
            drawn[record.frame] = judged.drawn_units
        if judged.settled is not None and self._wants_picture(job.spec, record.frame, verdict):
            self._pictures.append(
                draw_pictures(
                    self._folder / "pictures",
                    slug(job.spec),
                    judged.settled,
                    verdict,
                    culler=job.spec,
                    frame=record.frame,
                )
            )

    def on_frame_done(self, frame: int) -> None:
        pass

    def _wants_picture(self, spec: str, frame: int, verdict: FrameVerdict) -> bool:
        """The planned frames, and as many more in which something was missed."""
        if frame in self._picture_frames:
            return True
        taken = self._extra_pictures.get(spec, 0)
        if not verdict.counts.confirmed or taken >= len(self._picture_frames):
            return False
        self._extra_pictures[spec] = taken + 1
        return True

    def _causes(self, job: Job, judged: JudgedFrame) -> pa.Array:
        """Why each superfluous unit was drawn; null in frames that are not explained, which are
        all but the planned pictures'."""
        units = judged.record.verdict.superfluous_units
        if judged.truth is None or judged.record.frame not in self._picture_frames:
            return pa.nulls(len(units), pa.string())
        causes = superfluous_causes(self._scene, judged.truth, job.units, judged.drawn_set, units)
        names = np.full(len(units), None, object)
        names[np.searchsorted(units, list(causes))] = list(causes.values())
        return pa.array(names, pa.string())

    def _add_objects(self, job: Job, judged: JudgedFrame) -> None:
        frame, verdict = judged.record.frame, judged.record.verdict
        width = self._path.frames[frame].width
        misses = []
        for miss in verdict.misses:
            witness = witness_json(self._scene, width, frame, miss)
            witness["name"] = witness.pop("object_name")
            misses.append({"culler": job.spec, **witness})
        self._pending.append(pa.Table.from_pylist(misses, schema=_OBJECTS))
        units = pa.array(verdict.superfluous_units, pa.int32())
        columns: dict[str, pa.Array] = {"unit": units, "cause": self._causes(job, judged)}
        if job.units.kind == OBJECT:
            columns |= {"object": units, "name": self._names.take(units)}
        else:
            columns["object"] = pa.repeat(pa.scalar(-1, pa.int32()), len(units))
        self._pending.append(_object_rows(job.spec, frame, "superfluous", len(units), columns))
        objects = pa.array(verdict.undecided_objects, pa.int32())
        columns = {"object": objects, "name": self._names.take(objects)}
        self._pending.append(_object_rows(job.spec, frame, "undecided", len(objects), columns))
        if sum(map(len, self._pending)) >= _PENDING_ROWS:
            self._write_objects()

    def _write_objects(self) -> None:
        if self._objects is None:
            file = self._folder / "objects.parquet"
            self._objects = pq.ParquetWriter(file, _OBJECTS, compression="zstd")
        self._objects.write_table(pa.concat_tables([_OBJECTS.empty_table(), *self._pending]))
        self._pending = []

    def finish(self, outcome: RunOutcome) -> None:
        """Write everything that is left to write."""
        folder = self._folder
        for name, rows, schema in (
            ("frames", self._frames, _FRAMES),
            ("timings", self._timings, _TIMINGS),
        ):
            table = pa.Table.from_pylist(rows, schema=schema)
            pq.write_table(table, folder / f"{name}.parquet", compression="zstd")
        self._write_objects()
        assert self._objects is not None
        self._objects.close()
        if self._has_truth:
            self._truth.write(
                folder / TRUTH,
                engine=self._engine,
                path=self._path,
                ties_complete=self._ties_complete,
            )
        self._write_witnesses(outcome)
        widths = {index: camera.width for index, camera in enumerate(self._path)}
        write_json(folder / VERDICT, verdict_json(outcome, self._scene, widths))
        write_json(folder / MANIFEST, self._manifest(outcome))

    def _write_witnesses(self, outcome: RunOutcome) -> None:
        folder = self._folder / "witnesses"
        for record in outcome.cullers:
            if record.totals.missed + record.totals.partly_missed:
                folder.mkdir(exist_ok=True)
                file = folder / f"{slug(record.spec)}.jsonl"
                write_witnesses(file, self._scene, self._path, record, self._drawn_in(record.spec))

    def _drawn_in(self, spec: str) -> Callable[[int], NDArray[np.bool_]]:
        units, drawn = self._drawn[spec]
        return lambda frame: units.mask(drawn[frame], self._scene.triangle_count)

    def _manifest(self, outcome: RunOutcome) -> dict[str, Any]:
        scene, path = self._scene, self._path
        return {
            "format": "visref-run",
            "version": 1,
            "scene": {
                "source": scene.source,
                "sha256": scene.digest,
                "objects": scene.object_count,
                "triangles": scene.triangle_count,
            },
            "path": {"source": path.source, "sha256": path_digest(path), "frames": len(path)},
            "engine": self._engine,
            "settings": self._settings,
            "cullers": {
                record.spec: {
                    "promise": record.promise.value,
                    "unit_kind": record.unit_kind,
                    "units": record.unit_count,
                    "slug": slug(record.spec),
                }
                for record in outcome.cullers
            },
            "pictures": [vars(pictures) for pictures in self._pictures],
            "samples": [camera.definition() for camera in path],
            "versions": versions(),
            "machine": machine(),
        }


def _timing(culler: str, frame: int, phase: str, ms: float) -> dict[str, Any]:
    return {"culler": culler, "frame": frame, "phase": phase, "ms": ms}


def _object_rows(
    culler: str, frame: int, kind: str, count: int, columns: dict[str, pa.Array]
) -> pa.Table:
    """`count` rows of objects.parquet; what `columns` does not give is null."""
    columns = columns | {
        "culler": pa.repeat(pa.scalar(culler), count),
        "frame": pa.repeat(pa.scalar(frame, pa.int32()), count),
        "kind": pa.repeat(pa.scalar(kind), count),
    }
    return pa.table(
        [columns.get(f.name, pa.nulls(count, f.type)) for f in _OBJECTS], schema=_OBJECTS
    )


def write_json(path: Path, value: object) -> None:
    """Write JSON with sorted keys, two spaces and a final newline."""
    path.write_text(json.dumps(value, indent=2, sort_keys=True, allow_nan=False) + "\n")


def versions() -> dict[str, str]:
    """visref, Python, and the libraries that a verdict leans on."""
    found = {"visref": version("visref"), "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, Any]:
    """The machine, in words."""
    model = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                model = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass
    return {"cpu": model, "cores": os.cpu_count(), "system": platform.platform()}
