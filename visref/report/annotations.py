"""Annotations of GitHub Actions: workflow commands, a line each, that a runner shows at the run.

GitHub shows at most ten errors and ten warnings of a step; the last of ours says how many it leaves
out. What others named is data in them: `%`, line ends, and in a title `:` and `,` are escaped as
the runner reads them back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from visref.findings import fails_run
from visref.judging.status import Status
from visref.report.misses import (
    ObjectMisses,
    cause_of,
    convicted,
    lost_line,
    object_misses,
    witness_line,
)
from visref.report.summary import CullerSummary, summarise
from visref.report.words import (
    HEADLINES,
    accepted,
    culler_sentence,
    found_at,
    hidden_line,
    hidden_name,
    replay_command,
)
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import LostObject
from visref.wording import shown

# Of each kind that GitHub shows of a step.
MOST = 10
# GitHub cuts a longer one, and says nothing of it.
_TITLE, _MESSAGE = 200, 2000

_MISSES = ("MISSED_OBJECT", "DRAWN_HIDDEN")


@dataclass(frozen=True)
class Annotation:
    """`level` is "error", "warning" or "notice"; title and message are text of a line."""

    level: str
    title: str
    message: str


def annotation_lines(annotations: Sequence[Annotation]) -> list[str]:
    """Workflow commands, at most `MOST` of each level, in the order of the annotations."""
    kept: list[Annotation] = []
    for level in ("error", "warning", "notice"):
        of_level = [one for one in annotations if one.level == level]
        if len(of_level) > MOST:
            more = len(of_level) - MOST + 1
            rest = f"… and {more:,} more, in the run folder and in the reports made from it"
            of_level = [*of_level[: MOST - 1], Annotation(level, "visref", rest)]
        kept += of_level
    return [_command(one) for one in kept]


def _command(one: Annotation) -> str:
    title = _cut(shown(one.title), _TITLE)
    message = _cut(shown(one.message), _MESSAGE)
    escaped = _escaped(title).replace(":", "%3A").replace(",", "%2C")
    return f"::{one.level} title={escaped}::{_escaped(message)}"


def _escaped(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 1]}…"


def annotations_of(run: RunFolder, out: Path) -> list[Annotation]:
    """What a run has to say: what fails it first, then the cullers' worst in turn, so that one with
    many does not hide another's. Replay commands start in `out`."""
    rows = [summarise(run, culler) for culler in run.cullers]
    found = [
        Annotation("error", f"visref: {finding.code}", finding.message)
        for finding in run.verdict.findings
        if fails_run(finding.code, finding.severity)
    ]
    by_culler = [_errors_of(run, row, out) for row in rows]
    found += [one for turn in zip_longest(*by_culler) for one in turn if one is not None]
    for finding in run.verdict.findings:
        if finding.severity != "warning" or finding.code in _MISSES:
            continue
        message = ": ".join(filter(None, (found_at(finding), finding.message)))
        found.append(Annotation("warning", f"visref: {finding.code}", message))
    for row in rows:
        counts = row.counts
        if said := accepted(counts.small, counts.late, counts.waived):
            message = f"{said}: object-frames that were missed, and that the policy accepts"
            found.append(Annotation("notice", f"visref: {row.culler}, accepted", message))
    return found


def _errors_of(run: RunFolder, row: CullerSummary, out: Path) -> list[Annotation]:
    """A culler's errors, the worst first."""
    if row.status is Status.INCONCLUSIVE:
        title = f"visref: {row.culler}, {HEADLINES[row.status].lower()}"
        return [Annotation("error", title, culler_sentence(row))]
    if row.status is not Status.VIOLATION:
        return []
    missed = object_misses(run, row.culler)
    found = [
        Annotation(
            "error",
            f"visref: {row.culler} misses {lost.worst.name}",
            _message(run, row, lost, missed.get(lost.worst.object), out),
        )
        for lost in convicted(row)
    ]
    found += [
        Annotation(
            "error",
            f"visref: {row.culler} draws {hidden_name(row, one)}",
            hidden_line(one),
        )
        for one in row.hidden
    ]
    # A status of the record stands, though its tables tell of nothing.
    return found or [Annotation("error", f"visref: {row.culler}, violation", culler_sentence(row))]


def _message(
    run: RunFolder, row: CullerSummary, lost: LostObject, misses: ObjectMisses | None, out: Path
) -> str:
    parts = [lost_line(lost), witness_line(lost)]
    if cause := cause_of(run, row.culler, misses):
        parts.append(f"cause: {cause}")
    parts.append(replay_command(run, lost.worst, out))
    return "; ".join(parts)


def annotations_of_failure(name: str, line: str) -> list[Annotation]:
    """What a command says that came to no verdict."""
    return [Annotation("error", f"visref {name}", line)]
