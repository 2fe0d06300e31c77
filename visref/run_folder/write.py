"""Writing a run folder; what stands in it is said in `visref.run_folder.layout`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref.files import for_arrow
from visref.judging.asking import Job
from visref.judging.outcome import RunOutcome, verdict_json
from visref.judging.policy import Policy
from visref.judging.referee import JudgedFrame
from visref.picking import Stretch
from visref.provenance import machine, versions
from visref.recordings.spool import Spool
from visref.recordings.truth_file import TruthTable, path_digest
from visref.run_folder.cuts import CutKeeper
from visref.run_folder.layout import (
    COUNTERS,
    CULL_PHASE,
    FIRST_PHASE,
    FORMAT,
    FRAMES,
    FRAMES_SCHEMA,
    MANIFEST,
    OBJECTS,
    PICTURES,
    TIMINGS,
    TIMINGS_SCHEMA,
    TRUTH,
    TRUTH_PHASE,
    VERDICT,
    VERSION,
    WITNESSES,
    slug,
)
from visref.run_folder.motion import MotionRecord, motion_json
from visref.run_folder.objects import ObjectsWriter
from visref.run_folder.part import Part
from visref.run_folder.picture_plan import PicturePlan, Shown, in_order_of
from visref.run_folder.pictures import Painter, Sketch
from visref.run_folder.rows import Motion, PictureSet
from visref.run_folder.witnesses import WITNESSES_PER_CULLER, write_witnesses
from visref.scene import Scene, Units
from visref.timeline import Timeline
from visref.visibility import FrameTruth, ObjectVisibility

# Half of a surrogate pair, as JSON writes one and as Python's texts hold one that has no other.
_SURROGATE = re.compile(r"\\ud[89a-f]")
_LONE = re.compile("[\ud800-\udfff]")
# What is held in memory of what was drawn where something was missed; the rest goes to disk.
_IN_MEMORY = 4 << 20


class RunWriter:
    """A run's listener that writes its folder. `folder` exists and is empty. `exact`: whether a
    truth that is on file already is exact, None where that is not known. `timeline`: the scene
    of each frame; by default `scene` and `path` make it. `policy`: what the run is judged by.
    `part`: which part of a run this may become, None where it will be the whole. `plan`: of
    pictures, where this is one of several parts; by default one of its own. `superfluous_rows`:
    list what was drawn for nothing in all frames, not only in `picture_frames`. `first`: by culler,
    the first frame that it was asked about in this process, where that was before."""

    def __init__(
        self,
        folder: Path,
        scene: Scene,
        path: CameraPath,
        *,
        timeline: Timeline | None = None,
        engine: str,
        settings: dict[str, Any],
        exact: bool | None = None,
        picture_frames: Sequence[int] = (),
        policy: Policy | None = None,
        part: Part | None = None,
        plan: PicturePlan | None = None,
        superfluous_rows: bool = False,
        first: dict[str, int] | None = None,
    ) -> None:
        self._folder = folder
        self._scene = scene
        self._path = path
        self._timeline = timeline or Timeline(scene, path)
        self._motion = MotionRecord(self._timeline)
        self._engine = engine
        self._exact = exact
        self._settings = settings
        self._policy = policy
        self._part = part
        self._truth = TruthTable(scene)
        self._has_truth = False
        self._frames: list[dict[str, Any]] = []
        self._timings: list[dict[str, Any]] = []
        self._objects = ObjectsWriter(
            folder / OBJECTS, scene, picture_frames, every=superfluous_rows
        )
        self._plan = plan or PicturePlan(
            picture_frames, part.open if part is not None else frozenset()
        )
        self._first = {} if first is None else first
        self._pictures: list[PictureSet] = []
        # By culler, and by frame and view, of what pictures may be wanted.
        self._sketches: dict[str, dict[Shown, list[Sketch]]] = {}
        self._painter = Painter(folder / PICTURES)
        # By culler its units, and by frame and view where the units are spooled that were drawn
        # where something was missed.
        self._drawn: dict[str, tuple[Units, dict[tuple[int, str], tuple[int, int]]]] = {}
        self._spool = Spool(_IN_MEMORY)
        # By culler what is kept around its misses.
        self._cuts: dict[str, CutKeeper] = {}

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        self._has_truth = True
        self._painter.see(frame, truth)
        # The referee has a truth list its ties where its engine is exact, and nowhere else.
        self._exact = truth.ties_complete
        camera = truth.camera
        self._truth.add(frame, camera.width, seen, view=camera.view)
        self._timings.append(_timing("", frame, camera.view, TRUTH_PHASE, ms))

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        record, verdict = judged.record, judged.record.verdict
        counters = {name: getattr(record.stats, name) for name in COUNTERS}
        if counters["triangles_drawn"] is None:
            counters["triangles_drawn"] = record.triangles_drawn
        if counters["units_drawn"] is None:
            counters["units_drawn"] = len(judged.drawn_units)
        self._frames.append(
            {
                "culler": job.spec,
                "frame": record.frame,
                "view": record.view,
                **vars(verdict.counts),
                **counters,
                "corrections": record.corrections,
                "image_pixels_differ": record.image_pixels_differ,
                "owned": verdict.owned,
            }
        )
        phases = dict(record.stats.ms)
        if CULL_PHASE in phases and self._first.setdefault(job.spec, record.frame) == record.frame:
            phases[FIRST_PHASE] = phases[CULL_PHASE]
        self._timings += [
            _timing(job.spec, record.frame, record.view, phase, ms) for phase, ms in phases.items()
        ]
        self._objects.add(job, judged)
        if verdict.misses:
            drawn = self._drawn.setdefault(job.spec, (job.units, {}))[1]
            put = self._spool.put_set(np.sort(judged.drawn_units))
            keeper = self._cuts.get(job.spec)
            if keeper is None:
                keeper = self._cuts[job.spec] = CutKeeper(WITNESSES_PER_CULLER)
            open_ = self._part is not None and record.frame in self._part.open
            keeper.add(record.frame, verdict.misses, judged.settled, open_=open_)
            for one in judged.settled:
                drawn[record.frame, one.truth.camera.view] = put
        if judged.settled:
            self._picture(job, judged)

    def _picture(self, job: Job, judged: JudgedFrame) -> None:
        """Draw what is planned, and keep what may be wanted when all is known."""
        spec, record = job.spec, judged.record
        at = record.frame, record.view
        missed = self._plan.add(spec, *at, record.verdict.misses)
        planned = self._plan.planned(record.frame)
        if not planned and not missed:
            return
        draw = self._painter.draw if planned else self._painter.sketch
        made = [
            draw(
                settled,
                record.verdict,
                stem=slug(spec),
                culler=spec,
                frame=record.frame,
                moved=self._motion.changed(record.frame),
            )
            for settled in judged.settled
        ]
        self._pictures += [one for one in made if isinstance(one, PictureSet)]
        if planned:
            return
        mine = self._sketches.setdefault(spec, {})
        mine[at] = [one for one in made if isinstance(one, Sketch)]
        wanted = self._plan.wanted(spec)
        self._sketches[spec] = {place: mine[place] for place in mine if place in wanted}

    def _paint_wanted(self) -> None:
        """Draw what is wanted, frame by frame, so that what cullers share is drawn once."""
        wanted = [
            (at, number, sketch)
            for number, spec in enumerate(self._sketches)
            for at in self._plan.wanted(spec) & self._sketches[spec].keys()
            for sketch in self._sketches[spec][at]
        ]
        for (frame, _), _, sketch in sorted(wanted, key=lambda one: one[:2]):
            self._pictures.append(self._painter.paint(sketch, self._timeline.at(frame)))
        self._sketches = {}

    def add_pictures(self, pictures: Iterable[PictureSet]) -> None:
        """Take note of pictures that were drawn into the folder by others."""
        self._pictures += pictures

    def on_frame_done(self, frame: int) -> None:
        self._motion.add(frame)

    def finish(self, outcome: RunOutcome, part: Part | None = None) -> None:
        """Write everything that is left to write, of the `part` that this became, or of the whole
        run."""
        self._part = part
        folder = self._folder
        write_rows(folder / FRAMES, self._frames, FRAMES_SCHEMA)
        write_rows(folder / TIMINGS, self._timings, TIMINGS_SCHEMA)
        self._objects.close({record.spec: record.causes for record in outcome.cullers})
        if self._has_truth:
            self._truth.write(
                folder / TRUTH,
                engine=self._engine,
                path=self._path,
                ties_complete=bool(self._exact),
                exact=self._exact,
            )
        self._write_witnesses(outcome)
        self._paint_wanted()
        write_json(folder / VERDICT, self._verdict(outcome))
        write_json(folder / MANIFEST, self._manifest(outcome))

    def _write_witnesses(self, outcome: RunOutcome) -> None:
        folder = self._folder / WITNESSES
        for record in outcome.cullers:
            if record.totals.missed + record.totals.partly_missed:
                folder.mkdir(exist_ok=True)
                file = folder / f"{slug(record.spec)}.jsonl"
                drawn = self._drawn_in(record.spec)
                cuts = self._cuts.get(record.spec)
                write_witnesses(file, self._timeline, self._path, record, drawn, cuts, self._part)

    def _drawn_in(self, spec: str) -> Callable[[int, str], NDArray[np.bool_]]:
        units, drawn = self._drawn[spec]
        return lambda frame, view: units.mask(
            self._spool.get_set(drawn[frame, view]), self._scene.triangle_count
        )

    def _verdict(self, outcome: RunOutcome) -> dict[str, Any]:
        return {"version": VERSION, **verdict_json(outcome, self._scene)}

    @property
    def moved(self) -> Motion | None:
        """What moved in the frames so far, with every object that did."""
        return self._motion.found()

    def _manifest(self, outcome: RunOutcome) -> dict[str, Any]:
        scene, path = self._scene, self._path
        return {
            "format": FORMAT,
            "version": VERSION,
            "scene": {
                "source": scene.source,
                "sha256": scene.digest,
                "objects": scene.object_count,
                "triangles": scene.triangle_count,
            },
            "path": {
                "source": path.source,
                "sha256": path_digest(path),
                **frames_json(self._numbers),
            },
            "engine": self._engine,
            "exact": self._exact,
            "settings": self._settings,
            "policy": self._policy.to_json() if self._policy is not None else None,
            "cullers": {
                record.spec: {
                    "promise": record.promise.value,
                    "unit_kind": record.unit_kind,
                    "units": record.unit_count,
                    "slug": slug(record.spec),
                    "raster": asdict(record.raster) if record.raster is not None else None,
                }
                for record in outcome.cullers
            },
            "pictures": [
                asdict(one)
                for one in in_order_of(self._pictures, [record.spec for record in outcome.cullers])
            ],
            "motion": motion_json(self.moved),
            "samples": samples_json(path, self._numbers),
            "versions": versions(),
            "machine": machine(),
        }

    @property
    def _numbers(self) -> Sequence[int]:
        """Of the path's frames that the manifest describes: a stretch has no others than its own,
        as there are many stretches."""
        if self._part is not None and isinstance(self._part.shard, Stretch):
            return self._part.judged
        return self._path.numbers


def frames_json(numbers: Sequence[int]) -> dict[str, Any]:
    """How many frames a path has, and their numbers, but for 0, 1, …"""
    count = len(numbers)
    plain = tuple(numbers) == tuple(range(count))
    return {"frames": count, **({} if plain else {"numbers": list(numbers)})}


def samples_json(path: CameraPath, numbers: Sequence[int]) -> list[dict[str, Any]]:
    """The samples of these frames, by view."""
    return [{camera.view: camera.definition() for camera in path.views(frame)} for frame in numbers]


def _timing(culler: str, frame: int, view: str, phase: str, ms: float) -> dict[str, Any]:
    return {"culler": culler, "frame": frame, "view": view, "phase": phase, "ms": ms}


def write_rows(file: Path, rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> None:
    """Write a table whose rows are at hand."""
    with for_arrow(file, "wb") as out:
        pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), out, compression="zstd")


def write_json(path: Path, value: object) -> None:
    """Write JSON with sorted keys, two spaces and a final newline. Of a text that is no Unicode,
    as a file's name may be, what is none is replaced, so that every reader takes it."""
    text = json.dumps(value, indent=2, sort_keys=True, allow_nan=False)
    if _SURROGATE.search(text):
        plain = json.dumps(value, ensure_ascii=False)
        text = json.dumps(json.loads(_LONE.sub("\ufffd", plain)), indent=2, sort_keys=True)
    path.write_text(text + "\n", encoding="utf-8")
