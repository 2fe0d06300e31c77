"""Whether a case still shows the fault that is being shrunk: trials, kept and counted."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from visref.errors import InputError
from visref.judging.status import Status
from visref.registry import DEFAULT_ENGINE
from visref.search.case import Case
from visref.search.judging import Kind, Verdict, Violation, verdict_of
from visref.search.suspects import Suspect

# Threads for a scene of more triangles than this; a smaller one is through before they are asked.
_LARGE = 20_000


@dataclass(frozen=True)
class Wanted:
    """What every step must keep: that the object of this name is left out, in whole or in part
    (`left_out`), or drawn for nothing, in the last frame; by this cause, if one is given."""

    name: str
    left_out: bool
    cause: str = ""

    @classmethod
    def of(cls, violation: Violation, *, cause: str | None = None) -> Wanted:
        """As a violation, with its own cause unless another is given."""
        kept = violation.cause if cause is None else cause
        return cls(violation.name, violation.kind is not Kind.SUPERFLUOUS, kept)

    def among(self, verdict: Verdict, frame: int) -> Violation | None:
        """The violation of this kind in a frame, with the most samples, of a verdict by which a run
        fails; None where there is none."""
        if verdict.status is not Status.VIOLATION:
            return None
        matching = [
            one
            for one in verdict.violations
            if one.frame == frame
            and one.name == self.name
            and (one.kind is not Kind.SUPERFLUOUS) == self.left_out
            and self.cause in ("", one.cause)
        ]
        return max(matching, key=lambda one: one.samples, default=None)


@dataclass(frozen=True)
class Effort:
    """How much is tried at most: `trials`, and `seconds` (None: whatever that takes). What comes of
    it is the same each time if the trials end it, or nothing does."""

    trials: int = 3000
    seconds: float | None = None


# What a step was, how many trials were made, and the smallest case so far.
Progress = Callable[[str, int, Case], None]


class Holding:
    """Tries cases, each once."""

    def __init__(
        self,
        suspect: Suspect,
        wanted: Wanted,
        *,
        engine: str = DEFAULT_ENGINE,
        effort: Effort | None = None,
    ) -> None:
        self.suspect, self.wanted, self.engine = suspect, wanted, engine
        self.effort = effort or Effort()
        self.trials = 0
        self._known: dict[str, Violation | None] = {}
        self._begun = time.monotonic()

    @property
    def spent(self) -> bool:
        """Whether nothing more is to be tried."""
        limit = self.effort.seconds
        late = limit is not None and time.monotonic() - self._begun >= limit
        return late or self.trials >= self.effort.trials

    def at(self, case: Case) -> Violation | None:
        """The violation that the case shows; None where it shows none, or nothing more is to be
        tried, or nobody can judge it."""
        if case.digest in self._known:
            return self._known[case.digest]
        if self.spent:
            return None
        self.trials += 1
        self._known[case.digest] = found = self._tried(case)
        return found

    def _tried(self, case: Case) -> Violation | None:
        try:
            # A reader chooses a far scene's origin anew, and so what its samples are.
            judged = case.read_back() if case.scene.origin.any() else case
            threads = 1 if case.scene.triangle_count <= _LARGE else None
            verdict = verdict_of(judged, self.suspect, engine=self.engine, threads=threads)
        except InputError:
            return None
        return self.wanted.among(verdict, len(case.path) - 1)
