"""From counts to a status. One function decides it, for the exit code and every report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING

from visref.promise import Promise

if TYPE_CHECKING:
    from visref.judging.judge import Counts

# Above this share of the owned samples on which a verdict hangs and which nobody can decide, the
# verdict says nothing.
MAX_UNDECIDED = 0.5


class Exit(IntEnum):
    """Exit statuses of the command line."""

    NO_VIOLATION = 0
    VIOLATION = 1
    BAD_INPUT = 2
    NOTHING_JUDGED = 3


class Status(StrEnum):
    """The word for a culler, or a run, in `verdict.json`. `MEASURED` is no praise: a culler that
    promises nothing can violate nothing."""

    NO_VIOLATION_FOUND = "no_violation_found"
    MEASURED = "measured"
    VIOLATION = "violation"
    INCONCLUSIVE = "inconclusive"

    @property
    def exit(self) -> Exit:
        return {
            Status.NO_VIOLATION_FOUND: Exit.NO_VIOLATION,
            Status.MEASURED: Exit.NO_VIOLATION,
            Status.VIOLATION: Exit.VIOLATION,
            Status.INCONCLUSIVE: Exit.NOTHING_JUDGED,
        }[self]


@dataclass(frozen=True)
class CullerOutcome:
    """What the status hangs on: a culler's promise, its sums over `frames` judged frames, whether
    it broke down in any step, whether it answered otherwise when it was asked again, and whether
    its recording fits another input and the user chose that nothing be concluded from it then."""

    counts: Counts
    frames: int
    failed: bool = False
    promise: Promise = Promise.CONSERVATIVE
    unsteady: bool = False
    misaligned: bool = False


def status_of(outcome: CullerOutcome, *, max_undecided: float = MAX_UNDECIDED) -> Status:
    """One culler's status. A vacuous or broken run proves nothing, but a violation stands."""
    counts = outcome.counts
    if outcome.misaligned:
        return Status.INCONCLUSIVE
    if counts.violations:
        return Status.VIOLATION
    decided = counts.owned_samples - counts.undecided_samples
    if (
        outcome.failed
        or outcome.unsteady
        or not outcome.frames
        or not counts.visible
        or (counts.undecided_samples and not decided)
        or counts.undecided_samples > max_undecided * counts.owned_samples
    ):
        return Status.INCONCLUSIVE
    if outcome.promise is Promise.APPROXIMATE:
        return Status.MEASURED
    return Status.NO_VIOLATION_FOUND


def run_status(statuses: Iterable[Status], *, fails: bool = False) -> Status:
    """The run's word: a violation before what is inconclusive before what is well; measured only
    if every culler is. Where no culler was asked for, nothing was violated. `fails`: a finding
    makes it a violation by itself (`visref.findings.fails_run`)."""
    present = set(statuses)
    if fails:
        return Status.VIOLATION
    if present == {Status.MEASURED}:
        return Status.MEASURED
    for status in (Status.VIOLATION, Status.INCONCLUSIVE):
        if status in present:
            return status
    return Status.NO_VIOLATION_FOUND


# Over several: bad input before a violation before nothing judged before all well.
_PRECEDENCE = (Exit.BAD_INPUT, Exit.VIOLATION, Exit.NOTHING_JUDGED, Exit.NO_VIOLATION)


def decide(statuses: Iterable[Exit]) -> Exit:
    """The exit status over several; where no culler was asked for, nothing was violated."""
    present = set(statuses)
    return next((status for status in _PRECEDENCE if status in present), Exit.NO_VIOLATION)
