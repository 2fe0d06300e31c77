"""What a culler's record gives to say: its findings."""

from __future__ import annotations

from visref.findings import Code, Finding
from visref.judging.judge import MissKind
from visref.judging.outcome import CullerRecord
from visref.judging.status import MAX_UNDECIDED
from visref.scene import Scene
from visref.wording import counted

_CODES = {
    MissKind.TIE: Code.MISSED_TIE,
    MissKind.WITHIN_RASTER: Code.MISSED_WITHIN_RASTER,
}


def culler_findings(record: CullerRecord, scene: Scene) -> list[Finding]:
    """One finding per object and kind, and what else a reader of the numbers should know."""
    found: list[Finding] = []
    confirmed = Code.MISSED_OBJECT if record.promise.convicts else Code.MISSED_DECLARED
    frames_of: dict[int, int] = {}
    for row in record.frames:
        for miss in row.verdict.misses:
            if miss.kind is MissKind.CONFIRMED:
                frames_of[miss.object] = frames_of.get(miss.object, 0) + 1
    for pixels, frame, miss in record.losses():
        lost, seen = counted(pixels, "sample"), counted(frames_of[miss.object], "frame")
        text = f"{lost} lost over {seen}, worst in frame {frame}"
        name = scene.names[miss.object]
        found.append(Finding(confirmed, text, record.spec, frame, name))
    found += _hidden_findings(record)
    for kind, code in _CODES.items():
        first: dict[int, int] = {}
        for row in record.frames:
            for miss in row.verdict.misses:
                if miss.kind is kind:
                    first.setdefault(miss.object, row.frame)
        found += [
            Finding(code, f"first in frame {frame}", record.spec, frame, scene.names[obj])
            for obj, frame in sorted(first.items())
        ]
    undecided: dict[int, int] = {}
    for row in record.frames:
        for obj in row.verdict.undecided_objects:
            undecided.setdefault(int(obj), row.frame)
    found += [
        Finding(
            Code.UNDECIDED_OBJECT, f"first in frame {frame}", record.spec, frame, scene.names[obj]
        )
        for obj, frame in sorted(undecided.items())
    ]
    corrections = sum(row.corrections for row in record.frames)
    if corrections:
        found.append(Finding(Code.ENGINE_CORRECTED, counted(corrections, "sample"), record.spec))
    differ = [row for row in record.frames if row.image_pixels_differ]
    if differ:
        pixels = sum(row.image_pixels_differ or 0 for row in differ)
        text = f"{counted(pixels, 'pixel')} over {counted(len(differ), 'frame')}"
        found.append(Finding(Code.IMAGE_DIFFERS, text, record.spec, differ[0].frame))
    totals = record.totals
    if totals.undecided_samples > MAX_UNDECIDED * totals.owned_samples:
        share = totals.undecided_samples / totals.owned_samples
        text = f"{share:.0%} of the samples that something owns or may own"
        found.append(Finding(Code.MOSTLY_UNDECIDED, text, record.spec))
    if not record.failed and not record.totals.visible:
        text = "no frame was judged" if not record.frames else "no object is visible in any frame"
        found.append(Finding(Code.NOTHING_JUDGED, text, record.spec))
    return found


def _hidden_findings(record: CullerRecord) -> list[Finding]:
    """One finding per hidden unit drawn against the promise, the most often drawn first."""
    frames_of: dict[int, list[int]] = {}
    for row in record.frames:
        for one in row.verdict.confirmed_superfluous:
            frames_of.setdefault(one.unit, []).append(row.frame)
    order = sorted(frames_of, key=lambda unit: (-len(frames_of[unit]), unit))
    return [
        Finding(
            Code.DRAWN_HIDDEN,
            f"{record.unit_kind} {unit}, drawn and hidden in "
            f"{counted(len(frames_of[unit]), 'frame')}, first in frame {frames_of[unit][0]}",
            record.spec,
            frames_of[unit][0],
        )
        for unit in order
    ]
