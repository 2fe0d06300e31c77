"""What a culler's record gives to say: its findings."""

from __future__ import annotations

from visref.findings import Code, Finding
from visref.judging.losses import Losses, first_frames
from visref.judging.misses import MissKind
from visref.judging.names import Names
from visref.judging.outcome import CullerRecord
from visref.judging.superfluous import Superfluous
from visref.scene import OBJECT
from visref.wording import counted

_CODES = {
    MissKind.TIE: Code.MISSED_TIE,
    MissKind.WITHIN_RASTER: Code.MISSED_WITHIN_RASTER,
    MissKind.SMALL: Code.MISSED_SMALL,
    MissKind.LATE: Code.MISSED_LATE,
    MissKind.WAIVED: Code.MISSED_WAIVED,
}


def culler_findings(record: CullerRecord, scene: Names) -> list[Finding]:
    """One finding per object and kind, and what else a reader of the numbers should know."""
    found: list[Finding] = []
    confirmed = Code.MISSED_OBJECT if record.promise.convicts else Code.MISSED_DECLARED
    losses = Losses.of(record.frames)
    totals = losses.samples.tolist(), losses.frames.tolist()
    worst = losses.worst(record.frames)
    for pixels, frames, (frame, miss) in zip(*totals, worst, strict=True):
        lost, seen = counted(pixels, "sample"), counted(frames, "frame")
        text = f"{lost} lost over {seen}, worst in frame {frame}"
        text += f", view '{miss.view}'" if miss.view else ""
        name = scene.names[miss.object]
        found.append(Finding(confirmed, text, record.spec, frame, name))
    found += _hidden_findings(record, scene)
    for kind, code in _CODES.items():
        found += [
            Finding(code, f"first in frame {frame}", record.spec, frame, scene.names[obj])
            for obj, frame in first_frames(record.frames, kind).items()
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
    for small in sorted(record.too_small, key=lambda one: (-one.samples, -one.outside, one.unit)):
        name = scene.names[small.unit] if record.unit_kind == OBJECT else ""
        text = (
            f"the box of {record.unit_kind} {small.unit} leaves out up to {small.outside:.3g} of "
            f"it, in {counted(small.frames, 'frame')}, worst in frame {small.frame}; "
            f"{counted(small.samples, 'sample')} of what it leaves out can be seen"
        )
        found.append(Finding(Code.BOUNDS_TOO_SMALL, text, record.spec, small.frame, name))
    if record.ignored:
        unit, frame = min(record.ignored.items(), key=lambda pair: (pair[1], pair[0]))
        of_object = record.unit_kind == OBJECT
        name = scene.names[unit] if of_object else ""
        which = "this one" if of_object else f"{record.unit_kind} {unit}"
        text = f"{len(record.ignored)} different, first {which} in frame {frame}"
        found.append(Finding(Code.ABSENT_NAMED, text, record.spec, frame, name))
    sums = record.totals
    if sums.undecided_samples > record.max_undecided * sums.owned_samples:
        share = sums.undecided_samples / sums.owned_samples
        text = f"{share:.0%} of the samples that something owns or may own"
        found.append(Finding(Code.MOSTLY_UNDECIDED, text, record.spec))
    if not record.failed and not sums.visible:
        text = "no frame was judged" if not record.frames else "no object is visible in any frame"
        found.append(Finding(Code.NOTHING_JUDGED, text, record.spec))
    return found


def _hidden_findings(record: CullerRecord, scene: Names) -> list[Finding]:
    """One finding for each hidden unit that was drawn against the promise, the most often drawn
    first, with what was found where most of its samples were examined."""
    found: dict[int, list[tuple[int, Superfluous]]] = {}
    for row in record.frames:
        for one in row.verdict.confirmed_superfluous:
            found.setdefault(one.unit, []).append((row.frame, one))
    result = []
    for unit in sorted(found, key=lambda unit: (-len(found[unit]), unit)):
        frame, worst = max(found[unit], key=lambda pair: pair[1].samples)
        where = "it covers no sample"
        if worst.occluder >= 0:
            occluder = scene.owner_name(worst.occluder)
            where = (
                f"hidden at all {counted(worst.samples, 'sample')} that it covers, nearest by "
                f"triangle {worst.occluder} of '{occluder}'"
            )
        text = (
            f"{record.unit_kind} {unit}, drawn though hidden in "
            f"{counted(len({at for at, _ in found[unit]}), 'frame')}; in frame {frame} {where}"
        )
        name = scene.names[unit] if record.unit_kind == OBJECT else ""
        result.append(Finding(Code.DRAWN_HIDDEN, text, record.spec, frame, name))
    return result
