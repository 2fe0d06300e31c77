"""From counts to a status. One function decides it, for the exit code and every report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from visref.judging.judge import Counts


class Exit(IntEnum):
    """Exit statuses of the command line."""

    NO_VIOLATION = 0
    VIOLATION = 1
    BAD_INPUT = 2
    NOTHING_JUDGED = 3

    @property
    def status(self) -> str:
        """The word for it in `verdict.json`."""
        words = {Exit.NO_VIOLATION: "no_violation_found", Exit.VIOLATION: "violation"}
        return words.get(self, "inconclusive")


# Over several cullers: bad input before a violation before nothing judged before all well.
_PRECEDENCE = (Exit.BAD_INPUT, Exit.VIOLATION, Exit.NOTHING_JUDGED, Exit.NO_VIOLATION)


@dataclass(frozen=True)
class CullerOutcome:
    """What the gate looks at: a culler's sums over `frames` judged frames, and whether it
    broke down before its last one."""

    counts: Counts
    frames: int
    failed: bool = False


def status_of(outcome: CullerOutcome) -> Exit:
    """One culler's status. A vacuous or broken run proves nothing, but a violation stands."""
    if outcome.counts.violations:
        return Exit.VIOLATION
    if outcome.failed or not outcome.frames or not outcome.counts.visible:
        return Exit.NOTHING_JUDGED
    return Exit.NO_VIOLATION


def decide(statuses: Iterable[Exit]) -> Exit:
    """The run's status; where no culler was asked for, nothing was violated."""
    present = set(statuses)
    return next((status for status in _PRECEDENCE if status in present), Exit.NO_VIOLATION)
