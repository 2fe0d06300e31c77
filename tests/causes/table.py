"""Which cause is given to which fault, as Markdown.

    python -m tests.causes.table [--kept-back] [--only GLOB] [--workers N] [--json FILE]

Without `--kept-back` the kept-back third is not run, whatever is asked for; with it, that third
alone is. What is counted are convicted objects: an object that loses samples in a frame and view.
Up to three causes are named of each, the likeliest first: the answer is right if one of them is,
and wrong if none is; how often the first is the right one is told too. A plain fact, as that
nothing at all is drawn, is right where it is why, and else says as little as no cause does.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from multiprocessing import get_context
from pathlib import Path
from typing import Protocol

from tests.causes.catalogue import FAULTS
from tests.causes.drawn import KEPT_BACK
from tests.causes.families import FAMILIES
from tests.causes.fault import Fault
from visref.camera_path import CameraPath
from visref.engines import TruthEngine, make_engine
from visref.judging.judge import MissKind
from visref.judging.outcome import RunOutcome
from visref.judging.referee import Listener, Referee
from visref.registry import DEFAULT_ENGINE
from visref.scene import Scene
from visref.stopwatch import Stopwatch
from visref.timeline import Timeline

# Of a convicted object (frame, view, object), the causes named, best first.
Naming = Callable[[int, str, int], Sequence[str]]


class Causes(Protocol):
    """What names causes: it listens to a run, and afterwards says what it found."""

    listener: Listener

    def find(self, outcome: RunOutcome, run: Run) -> Naming: ...


@dataclass(frozen=True, eq=False)
class Run:
    """What a fault is judged on. `engine` casts the truth."""

    timeline: Timeline
    path: CameraPath
    engine: Callable[[], TruthEngine]


class ByVisref:
    """What visref names."""

    def __init__(self, scene: Scene) -> None:
        from visref.causes.evidence import Evidence

        self.listener = Evidence()

    def find(self, outcome: RunOutcome, run: Run) -> Naming:
        from visref.causes.search import find_causes

        (record,) = outcome.cullers
        frames = run.path.numbers
        find_causes(self.listener, outcome.cullers, run.timeline, run.path, frames, run.engine)
        return lambda *where: [one.cause for one in record.causes.of(*where)]


NONE = "none"
# Said only where it is so, as the answers show: where it is not why, nothing is said of that.
FACTS = frozenset({"nothing-drawn", "never-drawn"})


@dataclass
class Row:
    """What was said of one fault. `given`: how many objects got each cause first, `NONE` for none;
    `right`, `wrong`, `none`: the causes named, judged; `first`: how many have a right cause first;
    `failed`: why nothing was judged."""

    name: str
    family: str
    accepted: list[str]
    given: Counter[str] = field(default_factory=Counter)
    convicted: int = 0
    right: int = 0
    wrong: int = 0
    none: int = 0
    first: int = 0
    seconds: float = 0.0
    failed: str = ""

    def add(self, causes: Sequence[str]) -> None:
        """Count one convicted object."""
        first = causes[0] if causes else NONE
        causes = [cause for cause in causes if cause in self.accepted or cause not in FACTS]
        right = not set(self.accepted).isdisjoint(causes)
        self.convicted += 1
        self.given[first] += 1
        self.right += right
        self.wrong += bool(causes) and not right
        self.none += not causes
        self.first += first in self.accepted


def judge(fault: Fault, causes: Callable[[Scene], Causes] = ByVisref) -> Row:
    """Judge a fault, and count what is said of each object that it loses."""
    row = Row(fault.name, fault.family, sorted(fault.accepted))
    with Stopwatch() as watch:
        given = fault.make()
        scene, path = given.scene, given.path
        timeline = Timeline(scene, path.relative_to(scene.origin))
        run = Run(timeline, path, lambda: make_engine(DEFAULT_ENGINE, timeline.still))
        asked = causes(scene)
        referee = Referee(scene, run.engine, timeline=timeline)
        outcome = referee.run(path, path.numbers, [(fault.name, given.culler)], [asked.listener])
        naming = asked.find(outcome, run)
        (record,) = outcome.cullers
        for frame in record.frames:
            for miss in frame.verdict.misses:
                if miss.kind is MissKind.CONFIRMED:
                    row.add(naming(frame.frame, miss.view, miss.object))
    row.seconds = watch.ms / 1e3
    if record.failed:
        row.failed = "; ".join(one.message for one in outcome.findings if one.culler)
    elif not row.convicted:
        row.failed = "not convicted"
    return row


def judged(
    faults: Sequence[Fault], causes: Callable[[Scene], Causes], workers: int
) -> Iterator[Row]:
    """A row per fault, in order; in this process, or in so many others."""
    if not workers:
        yield from (judge(fault, causes) for fault in faults)
        return
    with get_context("spawn").Pool(workers) as pool:
        yield from pool.imap(_judged, [fault.name for fault in faults])


def _judged(name: str) -> Row:
    return judge(FAULTS[name])


# What is printed.


def share(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "-"


def counts(given: Counter[str]) -> str:
    """The most frequent first."""
    ordered = sorted(given.items(), key=lambda one: (-one[1], one[0]))
    return ", ".join(f"{cause} {count}" for cause, count in ordered)


def confusion(rows: Iterable[Row]) -> list[str]:
    """A line per family: how many objects got which cause."""
    lines = [
        "| what is wrong | causes that say so | faults | objects | right | first | wrong | none "
        "| given first |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    rows = list(rows)
    for family, accepted in FAMILIES.items():
        own = [row for row in rows if row.family == family]
        if not own:
            continue
        objects = sum(row.convicted for row in own)
        parts = [
            sum(getattr(row, kind) for row in own) for kind in ("right", "first", "wrong", "none")
        ]
        given = sum((row.given for row in own), Counter[str]())
        cells = [family, ", ".join(sorted(accepted)) or "-", len(own), objects, *parts]
        lines.append("| " + " | ".join(map(str, [*cells, counts(given)])) + " |")
    return lines


def each(rows: Iterable[Row]) -> list[str]:
    """A line per fault."""
    lines = [
        "| fault | objects | right | right first | wrong | none | given first | seconds |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = [row.name, row.convicted, row.right, row.first, row.wrong, row.none]
        said = row.failed or counts(row.given)
        lines.append("| " + " | ".join(map(str, [*cells, said, f"{row.seconds:.1f}"])) + " |")
    return lines


def totals(rows: Iterable[Row]) -> list[str]:
    """How often a cause is right and wrong, and of faults that no cause describes, how often one
    is named all the same."""
    rows = list(rows)
    known = [row for row in rows if row.accepted and row.convicted]
    unknown = [row for row in rows if not row.accepted and row.convicted]
    objects = sum(row.convicted for row in known)
    parts = {
        kind: share(sum(getattr(row, kind) for row in known), objects)
        for kind in ("right", "first", "wrong", "none")
    }
    lines = [
        f"Of {objects} objects lost by {len(known)} faults that a cause describes: "
        f"right {parts['right']} ({parts['first']} by the cause named first), "
        f"wrong {parts['wrong']}, none {parts['none']}."
    ]
    if known:
        mean = {
            kind: 100.0 * sum(getattr(row, kind) / row.convicted for row in known) / len(known)
            for kind in ("right", "wrong", "none")
        }
        lines.append(
            "Each of these faults counted once: "
            + ", ".join(f"{kind} {value:.1f} %" for kind, value in mean.items())
            + "."
        )
    if unknown:
        objects = sum(row.convicted for row in unknown)
        wrong = sum(row.wrong for row in unknown)
        lines.append(
            f"Of {objects} objects lost by {len(unknown)} faults that no cause describes: "
            f"one is named for {share(wrong, objects)}."
        )
    return lines


def chosen(only: str, *, back: bool) -> list[Fault]:
    """The faults whose name fits a pattern, of the kept-back third (`back`) or of the others."""
    return [
        fault
        for name, fault in FAULTS.items()
        if fnmatchcase(name, only) and (name in KEPT_BACK) == back
    ]


def main(
    arguments: Sequence[str] | None = None, causes: Callable[[Scene], Causes] = ByVisref
) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.causes.table", description=__doc__)
    parser.add_argument("--kept-back", action="store_true", help="run the kept-back third alone")
    parser.add_argument("--only", default="*", metavar="GLOB", help="names of faults")
    parser.add_argument("--workers", type=int, default=0, metavar="N", help="processes")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the counts there too")
    asked = parser.parse_args(arguments)
    faults = chosen(asked.only, back=asked.kept_back)
    if not faults:
        elsewhere = len(chosen(asked.only, back=not asked.kept_back))
        parser.error(
            f"no fault fits {asked.only!r}"
            + (f", but {elsewhere} of the other part (--kept-back)" if elsewhere else "")
        )
    rows = []
    for number, row in enumerate(judged(faults, causes, asked.workers), start=1):
        rows.append(row)
        told = row.failed or counts(row.given)
        sys.stderr.write(f"{number}/{len(faults)} {row.name}: {told}\n")
    lines = [*confusion(rows), "", *each(rows), "", *totals(rows)]
    sys.stdout.write("\n".join(lines) + "\n")
    if asked.json:
        asked.json.write_text(json.dumps([vars(row) for row in rows], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
