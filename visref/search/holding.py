"""Whether a case still shows the fault that is being shrunk: trials, kept and counted."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

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
    (`left_out`), or drawn for nothing, in the last frame; by this cause, if one is given, which is
    to be among those that explain it."""

    name: str
    left_out: bool
    cause: str = ""

    @classmethod
    def of(cls, violation: Violation, *, cause: str | None = None) -> Wanted:
        """As a violation, with its own cause unless another is given."""
        kept = violation.cause if cause is None else cause
        return cls(violation.name, violation.kind is not Kind.SUPERFLUOUS, kept)

    def among(self, verdict: Verdict, frame: int) -> Violation | None:
        """The violation in a frame, with the most samples, of a verdict by which a run fails; None
        where there is none."""
        return self.picked(self.shown(verdict, frame))

    def shown(self, verdict: Verdict, frame: int) -> list[Violation]:
        """The violations of this kind in a frame, whatever the cause, those with the most samples
        first, of a verdict by which a run fails."""
        if verdict.status is not Status.VIOLATION:
            return []
        matching = [
            one
            for one in verdict.violations
            if one.frame == frame
            and one.name == self.name
            and (one.kind is not Kind.SUPERFLUOUS) == self.left_out
        ]
        return sorted(matching, key=lambda one: -one.samples)

    def picked(self, shown: Sequence[Violation], *, untold: bool = False) -> Violation | None:
        """The first that the cause explains; with `untold`, if there is none, the first that
        nothing explains."""
        if not self.cause:
            return shown[0] if shown else None
        for one in shown:
            if self.cause in one.causes:
                return one.by(self.cause)
        unexplained = (one for one in shown if untold and not one.causes)
        return next(unexplained, None)


@dataclass(frozen=True)
class Effort:
    """How much is tried at most: `trials`, and `seconds` (None: whatever that takes). What comes of
    it is the same each time if the trials end it, or nothing does."""

    trials: int = 3000
    seconds: float | None = None


# What a step was, how many trials were made, and the smallest case so far.
Progress = Callable[[str, int, Case], None]


class Holding:
    """Tries cases, each once. A cause that is wanted is asked for at every step; while it is
    `untold`, a step may also leave so little that nothing is named. `firm`: it never may."""

    def __init__(
        self,
        suspect: Suspect,
        wanted: Wanted,
        *,
        engine: str = DEFAULT_ENGINE,
        effort: Effort | None = None,
        firm: bool = False,
    ) -> None:
        self.suspect, self.wanted, self.engine, self.firm = suspect, wanted, engine, firm
        self.untold = False
        # What was named before the first step.
        self.first_cause = wanted.cause
        self.effort = effort or Effort()
        self.trials = 0
        self._known: dict[str, list[Violation]] = {}
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
        return self.wanted.picked(self.shown(case), untold=self.untold)

    def starts(self, case: Case) -> bool:
        """Whether a case shows it, to begin with. A cause that is not named there is wanted no
        more, unless it is firm."""
        if self.at(case) is not None:
            return True
        if self.firm or not self.shown(case):
            return False
        self.wanted = replace(self.wanted, cause="")
        return True

    def shown(self, case: Case) -> list[Violation]:
        """The violations that the case shows, whatever the cause; none where nothing more is to be
        tried, or nobody can judge it."""
        if case.digest in self._known:
            return self._known[case.digest]
        if self.spent:
            return []
        self.trials += 1
        self._known[case.digest] = found = self._tried(case)
        return found

    def _tried(self, case: Case) -> list[Violation]:
        last = len(case.path) - 1
        wanted = self.wanted
        try:
            # A reader chooses a far scene's origin anew, and so what its samples are.
            judged = case.read_back() if case.scene.origin.any() else case
            threads = 1 if case.scene.triangle_count <= _LARGE else None
            verdict = verdict_of(
                judged,
                self.suspect,
                engine=self.engine,
                threads=threads,
                explained=(lambda found: bool(wanted.shown(found, last))) if wanted.cause else None,
            )
        except InputError:
            return []
        return wanted.shown(verdict, last)
