"""What a record says of each object that a culler missed, and why, in the words of all reports."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from visref.report.summary import CullerSummary
from visref.report.words import (
    accepted,
    count,
    counted,
    frame_of,
    missed_in,
    replay_command,
)
from visref.run_folder.claims import witnesses_about
from visref.run_folder.layout import ObjectKind
from visref.run_folder.miss_facts import facts_text
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import LostObject

_COLUMNS = ["object", "name", "kind", "cause"]


@dataclass(slots=True)
class ObjectMisses:
    """One object that a culler missed, in full or in part, or may have missed: how many of its
    frames and views are of each `ObjectKind`, and how many of its confirmed misses have each cause
    (a code of `verdict.json`'s `causes`)."""

    object: int
    name: str
    kinds: Counter[str] = field(default_factory=Counter)
    causes: Counter[str] = field(default_factory=Counter)

    @property
    def accepted(self) -> str:
        """The misses that a policy accepts, by kind; empty where there are none."""
        kinds = (ObjectKind.SMALL, ObjectKind.LATE, ObjectKind.WAIVED)
        return accepted(*(self.kinds[kind.value] for kind in kinds))


def object_misses(run: RunFolder, culler: str) -> dict[int, ObjectMisses]:
    """By id, the objects that the culler missed or may have missed, as objects.parquet has them."""
    found: dict[int, ObjectMisses] = {}
    if not len(run.objects):
        return found
    mine = pc.and_(
        pc.equal(run.objects["culler"], culler),
        pc.not_equal(run.objects["kind"], ObjectKind.SUPERFLUOUS.value),
    )
    table = run.objects.filter(mine).select([*_COLUMNS, "frame"])
    rows = table.group_by(_COLUMNS).aggregate([("frame", "count")]).to_pylist()
    for row in sorted(rows, key=lambda row: (row["object"], row["kind"], row["cause"] or "")):
        one = found.setdefault(row["object"], ObjectMisses(row["object"], row["name"]))
        one.kinds[row["kind"]] += row["frame_count"]
        if row["cause"] and row["kind"] == ObjectKind.CONFIRMED:
            one.causes[row["cause"]] += row["frame_count"]
    return found


def convicted(row: CullerSummary) -> Sequence[LostObject]:
    """The objects whose misses are violations, the most samples lost first."""
    return row.lost if row.convicts and not row.misaligned else ()


def why_lines(causes: Sequence[Mapping[str, Any]]) -> list[str]:
    """Why things were missed, a line per cause that `verdict.json` names, the commonest first."""
    return [
        f"{count(cause['misses'])} of {counted(cause['examined'], 'miss', 'misses')}: "
        f"{', or: '.join([cause['text'], *(one['text'] for one in cause['alternatives'])])} "
        f"({counted(cause['objects'], 'object')})"
        for cause in causes
    ]


def cause_of(
    run: RunFolder, culler: str, misses: ObjectMisses | None, *, doubts: bool = False
) -> str:
    """Why one object was missed, the commonest cause first; empty where none is known. `doubts`:
    with what may be the cause as well, and the score."""
    if misses is None or not misses.causes:
        return ""
    causes = {cause["cause"]: cause for cause in run.verdict.cullers[culler].causes}
    confirmed = misses.kinds[ObjectKind.CONFIRMED.value]
    said = []
    for code, number in sorted(misses.causes.items(), key=lambda item: (-item[1], item[0])):
        part = f" ({count(number)} of {count(confirmed)})" if number < confirmed else ""
        cause = causes.get(code, {"text": code})
        others = cause.get("alternatives", []) if doubts else []
        text = ", or: ".join([cause["text"], *(one["text"] for one in others)])
        score = f" (score {cause['score']:.2f} of 1)" if doubts and "score" in cause else ""
        said.append(f"{text}{part}{score}")
    return "; ".join(said)


def lost_line(lost: LostObject) -> str:
    """How an object was missed, and how much of it."""
    return (
        f"{missed_in(lost)}: {counted(lost.samples, 'sample')} over {counted(lost.frames, 'frame')}"
    )


def witness_line(lost: LostObject) -> str:
    """The sample that proves an object's worst miss."""
    worst = lost.worst
    return f"{frame_of(worst)}, pixel ({worst.x}, {worst.y}), depth {worst.depth:.9g}"


def facts_of(run: RunFolder, row: CullerSummary, most: int) -> dict[int, str]:
    """By object, the plain facts about the worst miss of the first `most` convicted ones, in words;
    of records of old there are none."""
    keys = {
        (one.worst.frame, one.worst.view, one.worst.object): one.worst.object
        for one in convicted(row)[:most]
    }
    found = witnesses_about(run.folder, run.manifest, row.culler, keys.keys())
    told = {keys[key]: facts_text(witness.get("facts", {})) for key, witness in found.items()}
    return {obj: text for obj, text in told.items() if text}


def convicted_lines(
    run: RunFolder,
    row: CullerSummary,
    lost: LostObject,
    misses: ObjectMisses | None,
    out: Path,
    facts: str = "",
) -> list[str]:
    """All that is to be said of one convicted object, a line for each thing: how it was missed,
    the witness, why, the plain `facts`, what was accepted besides, and the command that explains
    it, in `out`."""
    lines = [f"{lost.worst.name}, {lost_line(lost)}", f"witness: {witness_line(lost)}"]
    if cause := cause_of(run, row.culler, misses):
        lines.append(f"cause: {cause}")
    if facts:
        lines.append(facts)
    if misses is not None and misses.accepted:
        lines.append(f"accepted by the policy besides: {misses.accepted}")
    lines.append(f"explain it: {replay_command(run, lost.worst, out)}")
    return lines
