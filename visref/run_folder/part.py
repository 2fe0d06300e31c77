"""What a part of a run keeps for the whole one.

A shard's folder is a run folder of its frames. Beside what every run folder has it holds
`part.json`, which says what verdicts do not and whose part it is, and `part.parquet`, with a row
per verdict of what its ages hang on where units are finer than objects. `visref.merging` reads
both.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from visref.camera_path import CameraPath
from visref.findings import Finding
from visref.judging.again import Difference
from visref.judging.ages import Followed
from visref.judging.asking import Job
from visref.judging.outcome import RunOutcome, finding_json
from visref.judging.referee import JudgedFrame
from visref.judging.summary import Caster, Facts
from visref.picking import Shard, Stretch
from visref.run_folder.groups import RowGroups
from visref.run_folder.layout import PART_CELLS, PART_SCHEMA, PART_UNITS, PART_UNITS_SCHEMA
from visref.run_folder.rows import Motion
from visref.scene import OBJECT, Int32, Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility

PART_FORMAT = "visref-part"
PART_VERSION = 1
# Verdicts that are held before they are written. Of one that misses 50,000 of finer units than
# objects, a row takes a megabyte.
_VERDICTS = 16


@dataclass(frozen=True)
class Part:
    """A part of a run over `frames`. `latency`: below which age a policy accepts a miss. `since`:
    the place of the frame from which on it is known what was seen, where that is before its own."""

    shard: Shard | Stretch
    frames: tuple[int, ...]
    latency: int = 0
    since: int | None = None

    @property
    def judged(self) -> Sequence[int]:
        """Its own frames."""
        return self.shard.of(self.frames)

    @property
    def open(self) -> frozenset[int]:
        """Its frames in which a miss may be younger than the part can know, and so accepted."""
        if self.since is None:
            return frozenset(() if self.shard.begins else self.judged[: self.latency])
        unsure = self.frames[self.since : self.since + self.latency] if self.since else ()
        return frozenset(unsure).intersection(self.judged)


@dataclass(eq=False)
class InputFindings:
    """What a run says of its inputs: of recordings that fit others, and whose culler's; of the
    scene and the path; and of the truth on file."""

    misaligned: list[Finding] = field(default_factory=list)
    excused: list[str] = field(default_factory=list)
    notes: list[Finding] = field(default_factory=list)
    recorded: list[Finding] = field(default_factory=list)

    def put_first(self, outcome: RunOutcome) -> None:
        """Add them to a run's findings, in the order in which a reader wants them."""
        outcome.findings[:0] = [*self.misaligned, *self.notes, *self.recorded]
        for record in outcome.cullers:
            record.misaligned |= record.spec in self.excused


class PartKeeper:
    """A run's listener that writes what a part keeps. `folder` exists."""

    def __init__(self, folder: Path, scene: Scene, path: CameraPath) -> None:
        self._folder = folder
        self._scene = scene
        self._path = path
        self._cells = RowGroups(folder / PART_CELLS, PART_SCHEMA, _VERDICTS)
        self._missed: set[int] = set()
        self._units: dict[str, Units] = {}

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        record, followed = judged.record, judged.followed
        self._missed.update(record.verdict.misses.columns.object.tolist())
        if job.units.kind != OBJECT:
            self._units[job.spec] = job.units
        row = {
            "culler": job.spec,
            "frame": record.frame,
            "view": record.view,
            "settled": bool(judged.settled),
            "drawn": _bits(judged.drawn_units, job.units.count),
            **(_packed(followed) if followed is not None else {}),
        }
        self._cells.add(pa.Table.from_pylist([row], schema=PART_SCHEMA))

    def on_frame_done(self, frame: int) -> None:
        pass

    def discard(self) -> None:
        """It was no part after all."""
        self._cells.close()
        (self._folder / PART_CELLS).unlink()

    def finish(
        self,
        part: Part,
        outcome: RunOutcome,
        facts: Facts,
        inputs: InputFindings,
        again: Sequence[Mapping[str, Difference]],
        *,
        pictures: Sequence[int],
        moved: Motion | None,
        truth: bool,
    ) -> dict[str, Any]:
        """Write the rest, but for `part.json`; returns what that says. `again`: for each time that
        cullers were asked again, what was otherwise; `pictures`: the frames of the whole run that
        get some; `truth`: whether it went by a truth on file."""
        self._cells.close()
        units = RowGroups(self._folder / PART_UNITS, PART_UNITS_SCHEMA)
        for spec, its in self._units.items():
            row = {"culler": [spec], "offsets": [its.offsets], "triangles": [its.triangles]}
            units.add(pa.table(row, schema=PART_UNITS_SCHEMA))
        units.close()
        scene = self._scene
        return {
            "format": PART_FORMAT,
            "version": PART_VERSION,
            **_share_json(part.shard),
            "frames": list(part.frames),
            "cuts": [frame for frame in part.judged if self._path.views(frame)[0].cut],
            "pictures": list(pictures),
            "truth": truth,
            "caster": _caster_json(facts.caster),
            "recorded": _caster_json(facts.recorded),
            "examined": [finding_json(one) for one in facts.examined],
            "failures": [
                {
                    "step": int(one.step),
                    "frame": one.frame,
                    "finding": finding_json(one.finding),
                }
                for one in facts.failures
            ],
            "rounded": [{**asdict(one), "pixels": one.pixels.hex()} for one in facts.moved],
            "inputs": {
                "misaligned": [finding_json(one) for one in inputs.misaligned],
                "excused": inputs.excused,
                "notes": [finding_json(one) for one in inputs.notes],
                "recorded": [finding_json(one) for one in inputs.recorded],
            },
            "remarks": [finding_json(one) for one in outcome.policy.remarks],
            "moved": None if moved is None else asdict(moved),
            "paths": {str(index): scene.paths[index] for index in sorted(self._missed)},
            "again": [
                {spec: asdict(difference) for spec, difference in time.items()} for time in again
            ],
            "cullers": [
                {
                    "name": record.spec,
                    "promise": record.promise.value,
                    "unit_kind": record.unit_kind,
                    "units": record.unit_count,
                    "failed": record.failed,
                    "raster": None if record.raster is None else asdict(record.raster),
                    "too_small": [
                        {
                            **asdict(one),
                            "outside": one.outside.hex(),
                            "name": self._unit_name(record.unit_kind, one.unit),
                        }
                        for one in record.too_small
                    ],
                    "ignored": [
                        {
                            "unit": unit,
                            "frame": frame,
                            "name": self._unit_name(record.unit_kind, unit),
                        }
                        for unit, frame in record.ignored.items()
                    ],
                }
                for record in outcome.cullers
            ],
        }

    def _unit_name(self, kind: str, unit: int) -> str:
        return self._scene.names[unit] if kind == OBJECT else ""


def _share_json(share: Shard | Stretch) -> dict[str, int]:
    if isinstance(share, Stretch):
        return {"start": share.start, "stop": share.stop}
    return {"shard": share.number, "shards": share.count}


def _caster_json(caster: Caster | None) -> dict[str, Any] | None:
    return None if caster is None else asdict(caster)


def _bits(units: Int32, count: int) -> bytes:
    drawn = np.zeros(count, np.bool_)
    drawn[units] = True
    return zlib.compress(np.packbits(drawn).tobytes(), 1)


def drawn_units(packed: bytes, count: int) -> Int32:
    """(k,) int32, the units drawn, ascending, of so many. Raises ValueError for what is no set of
    them."""
    try:
        bits = np.frombuffer(zlib.decompressobj().decompress(packed, count // 8 + 2), np.uint8)
    except zlib.error as error:
        raise ValueError("what was drawn cannot be read") from error
    if len(bits) != (count + 7) // 8:
        raise ValueError("what was drawn has not a bit for each unit")
    return np.flatnonzero(np.unpackbits(bits, count=count)).astype(np.int32)


def _packed(followed: Followed) -> dict[str, bytes]:
    lost = sorted(followed.lost.items())
    units = [np.asarray(units, "<i8") for _, units in lost]
    return {
        "seen": np.packbits(followed.seen).tobytes(),
        "objects": np.array([index for index, _ in lost], "<i8").tobytes(),
        "counts": np.array([len(one) for one in units], "<i8").tobytes(),
        "units": b"".join(one.tobytes() for one in units),
    }


def unpacked(row: Mapping[str, Any], units: int) -> Followed | None:
    """What `part.parquet` says of one verdict, of a culler of so many units; None where objects are
    followed. Raises ValueError for what does not go together."""
    if row["seen"] is None:
        return None
    bits = np.frombuffer(row["seen"], np.uint8)
    if len(bits) != (units + 7) // 8:
        raise ValueError("it does not have a bit for each unit")
    packed = [row[name] for name in ("objects", "counts", "units")]
    if None in packed:
        raise ValueError("it does not say by which units objects were missed")
    objects, counts, lost = (np.frombuffer(one, "<i8") for one in packed)
    if len(objects) != len(counts) or (counts < 0).any() or counts.sum() != len(lost):
        raise ValueError("its lost units are not those of its objects")
    if len(lost) and not 0 <= lost.min() <= lost.max() < units:
        raise ValueError("it lost a unit that there is not")
    ends = np.cumsum(counts)[:-1]
    each = np.split(lost.astype(np.int64), ends) if len(counts) else []
    seen = np.unpackbits(bits, count=units).astype(np.bool_)
    return Followed(seen, dict(zip(objects.tolist(), each, strict=True)))
