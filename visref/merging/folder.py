"""The run folder of all parts."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.files import for_arrow, refuse_inputs, replacing_folder
from visref.judging.outcome import CullerRecord, RunOutcome, verdict_json
from visref.merging.belonging import in_order
from visref.merging.joining import Cell, Joined, join
from visref.merging.reading import FIX, PartFolder, read_part
from visref.merging.truths import check_truths
from visref.provenance import machine
from visref.recordings.spool import Spool
from visref.recordings.truth_reading import read_rows, write_joined
from visref.run_folder.groups import RowGroups
from visref.run_folder.inside import file_inside, lines_inside
from visref.run_folder.layout import (
    FRAMES,
    FRAMES_SCHEMA,
    MANIFEST,
    OBJECTS,
    OBJECTS_SCHEMA,
    RUN_FOLDER,
    TIMINGS,
    TIMINGS_SCHEMA,
    TRUTH,
    VERDICT,
    VERSION,
    WITNESSES,
    slug,
)
from visref.run_folder.miss_facts import OF_SURROUNDINGS, box_too_small, causes_json
from visref.run_folder.motion import motion_json
from visref.run_folder.objects import name_causes
from visref.run_folder.picture_plan import PicturePlan, Shown, in_order_of
from visref.run_folder.rows import Motion, MovedObject, PictureSet
from visref.run_folder.witnesses import choose
from visref.run_folder.write import frames_json, samples_json, write_json, write_rows

_Place = tuple[int, str, int]
# Told of the whole run and of the pictures that it wants; returns those that it drew besides.
After = Callable[[Joined, PicturePlan], Iterable[PictureSet]]


def merge_runs(folders: Sequence[Path], out: Path) -> RunOutcome:
    """Write the run folder that one run would have left, of the folders of all its shards, in
    whatever order. Raises InputError, which names the folder, where they do not belong together or
    one is missing."""
    refuse_inputs(out, folders)
    parts = in_order([read_part(folder) for folder in folders])
    with replacing_folder(out, kind=RUN_FOLDER) as folder:
        return _Merging(folder, parts).run()


def merge_into(
    folder: Path,
    parts: Sequence[Path],
    *,
    path: CameraPath | None = None,
    truth: Path | None = None,
    on_cell: Callable[[Cell], None] = lambda cell: None,
    after: After = lambda joined, plan: (),
) -> RunOutcome:
    """The same into a folder that is there, and empty. Who has the scene at hand may look at each
    verdict, with what was drawn, and `after` that add to the records before they are written, and
    draw pictures into the folder beside those of the plan.
    Stretches, as parts that a run left on its way, have neither the whole `path` nor a copy of the
    `truth` file that they went by."""
    rows = None if truth is None else read_rows(truth)
    read = [read_part(part, rows) for part in parts]
    merging = _Merging(folder, in_order(read), path)
    return merging.run(on_cell, after)


class _Merging:
    def __init__(
        self, folder: Path, parts: Sequence[PartFolder], path: CameraPath | None = None
    ) -> None:
        self._folder = folder
        self._path = path
        self._parts = parts
        self._rows: list[dict[str, Any]] = []
        self._objects = RowGroups(folder / OBJECTS, OBJECTS_SCHEMA)
        self._plan = PicturePlan(parts[0].said.pictures)
        # By culler, whose part it is that may have pictures of a frame and view.
        self._drawn: dict[str, dict[Shown, PartFolder]] = {}
        # Pictures that no part has.
        self._more: list[PictureSet] = []

    def run(
        self,
        on_cell: Callable[[Cell], None] = lambda cell: None,
        after: After = lambda joined, plan: (),
    ) -> RunOutcome:
        """Write all files."""
        folder = self._folder

        def told(cell: Cell) -> None:
            self._on_cell(cell)
            on_cell(cell)

        joined = join(self._parts, told, None if self._path is None else self._path.numbers)
        self._more = list(after(joined, self._plan))
        self._objects.close()
        name_causes(folder / OBJECTS, {one.spec: one.causes for one in joined.outcome.cullers})
        write_rows(folder / FRAMES, self._rows, FRAMES_SCHEMA)
        self._write_timings(joined)
        self._write_truth()
        for record in joined.outcome.cullers:
            if record.totals.missed + record.totals.partly_missed:
                self._write_witnesses(record, joined)
        verdict = {"version": VERSION, **verdict_json(joined.outcome, joined.names)}
        write_json(folder / VERDICT, verdict)
        write_json(folder / MANIFEST, self._manifest(joined))
        return joined.outcome

    def _on_cell(self, cell: Cell) -> None:
        self._rows.append(cell.row)
        self._objects.add(cell.objects)
        frame, view = cell.record.frame, cell.record.view
        missed = self._plan.add(cell.spec, frame, view, cell.record.verdict.misses)
        if cell.settled and (missed or self._plan.planned(frame)):
            self._drawn.setdefault(cell.spec, {})[frame, view] = cell.part

    def _pictures(self, joined: Joined) -> list[dict[str, Any]]:
        """What the manifest says of the pictures, which are copied."""
        found = list(self._more)
        for spec, drawn in self._drawn.items():
            is_drawn = self._plan.drawn_of(spec)
            for (frame, view), part in drawn.items():
                if is_drawn((frame, view)):
                    found += self._of_part(part, spec, frame, view)
        cullers = [record.spec for record in joined.outcome.cullers]
        return [asdict(one) for one in in_order_of(found, cullers)]

    def _of_part(self, part: PartFolder, spec: str, frame: int, view: str) -> list[PictureSet]:
        views = part.run.manifest.samples[frame]
        mine = {view} if view in views else set(views)
        found = [
            one
            for one in part.run.manifest.pictures
            if (one.culler, one.frame) == (spec, frame) and one.view in mine
        ]
        if len(found) != len(mine):
            raise part.error(f"it lacks pictures of frame {frame}", MANIFEST)
        for one in found:
            for name in one.files.values():
                self._copy(part, name)
        return found

    def _copy(self, part: PartFolder, name: str) -> None:
        target = self._folder / name
        if not target.exists():
            target.parent.mkdir(exist_ok=True)
            shutil.copyfile(file_inside(part.folder, name, FIX), target)

    def _write_timings(self, joined: Joined) -> None:
        tables = [TIMINGS_SCHEMA.empty_table()]
        for number, part in enumerate(self._parts):
            rows = [asdict(row) for row in part.run.timings]
            table = pa.Table.from_pylist(rows, schema=TIMINGS_SCHEMA)
            gone = [spec for spec, end in joined.ends.items() if number >= end]
            tables.append(
                table.filter(pc.invert(pc.is_in(table["culler"], pa.array(gone, pa.string()))))
            )
        table = pa.concat_tables(tables).combine_chunks()
        with for_arrow(self._folder / TIMINGS, "wb") as out:
            pq.write_table(table, out, compression="zstd")

    def _write_truth(self) -> None:
        first = self._parts[0]
        truths = [part.truth for part in self._parts if part.truth is not None]
        if first.said.truth:
            assert first.truth is not None
            shutil.copyfile(first.truth.file, self._folder / TRUTH)
        elif truths:
            check_truths(truths)
            write_joined(self._folder / TRUTH, truths)

    def _write_witnesses(self, record: CullerRecord, joined: Joined) -> None:
        by_view, surrounded = choose(record)
        wanted = {
            (frame, view, one.object) for (frame, view), its in by_view.items() for one in its
        }
        spool = Spool()
        known = self._witnesses(record.spec, joined.ends[record.spec], wanted, spool)
        (self._folder / WITNESSES).mkdir(exist_ok=True)
        file = self._folder / WITNESSES / f"{slug(record.spec)}.jsonl"
        with file.open("w", encoding="utf-8") as lines:
            for frame, view in sorted(by_view):
                for miss in sorted(by_view[frame, view], key=lambda miss: miss.object):
                    place = frame, view, miss.object
                    if place not in known:
                        raise InputError(
                            f"no part has the witness of object {miss.object} in frame {frame}",
                            source=str(self._parts[0].folder),
                            fix=FIX,
                        )
                    witness = {**json.loads(spool.get_bytes(known[place])), "kind": miss.kind.value}
                    witness["causes"] = causes_json(record, frame, view, miss.object)
                    witness["facts"] = {
                        **witness.get("facts", {}),
                        "age": miss.age,
                        "box_too_small": box_too_small(record, miss.object),
                    }
                    if place not in surrounded:
                        witness.pop("surroundings", None)
                        witness["facts"] |= dict.fromkeys(OF_SURROUNDINGS)
                    lines.write(json.dumps(witness, sort_keys=True) + "\n")

    def _witnesses(
        self, spec: str, end: int, wanted: Set[_Place], spool: Spool
    ) -> dict[_Place, tuple[int, int]]:
        """Where in `spool` the lines are of the witnesses `wanted`, which it puts there."""
        found: dict[_Place, tuple[int, int]] = {}
        name = f"{WITNESSES}/{slug(spec)}.jsonl"
        for part in self._parts[:end]:
            if not (part.folder / name).exists():
                continue
            for place, line in lines_inside(part.folder, name, FIX):
                try:
                    its = line["frame"], line["view"], line["object"]
                    is_wanted = its in wanted
                except (KeyError, TypeError) as error:
                    raise part.error("it is no witness", f"{name}, {place}") from error
                if is_wanted:
                    found[its] = spool.put_bytes(json.dumps(line).encode())
        return found

    def _manifest(self, joined: Joined) -> dict[str, Any]:
        manifest = dict(self._parts[0].manifest)
        settings = manifest["settings"]
        policy = manifest["policy"]
        if policy is not None and joined.outcome.policy.today is not None:
            policy = {**policy, "today": joined.outcome.policy.today.isoformat()}
        if self._path is not None:
            numbers = self._path.numbers
            known = {name: manifest["path"][name] for name in ("source", "sha256")}
            manifest["path"] = {**known, **frames_json(numbers)}
            manifest["samples"] = samples_json(self._path, numbers)
        return {
            **manifest,
            "settings": {name: settings[name] for name in settings if name != "shard"},
            "policy": policy,
            "cullers": {
                record.spec: {
                    **manifest["cullers"][record.spec],
                    "raster": None if record.raster is None else asdict(record.raster),
                }
                for record in joined.outcome.cullers
            },
            "pictures": self._pictures(joined),
            "motion": motion_json(_motion(self._parts)),
            "machine": machine(),
        }


def _motion(parts: Sequence[PartFolder]) -> Motion | None:
    moved = [part.said.moved for part in parts if part.said.moved is not None]
    if len(moved) < len(parts):
        return None
    often: dict[int, MovedObject] = {}
    for one in (one for part in moved for one in part.most):
        before = often[one.object].frames if one.object in often else 0
        often[one.object] = MovedObject(one.object, one.name, before + one.frames)
    frames = tuple(frame for part in moved for frame in part.frames)
    return Motion(len(often), frames, tuple(often.values()))
