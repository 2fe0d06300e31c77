"""The two ways a run can stop: bad input that its author can fix, and nothing to judge."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input. Its text is one line: the file, the place in it, what is wrong, the fix.

    Code deep inside knows the problem, code further out knows the file; each adds what it
    knows with `at`.
    """

    def __init__(self, problem: str, *, fix: str = "", place: str = "", source: str = "") -> None:
        self.problem = problem
        self.fix = fix
        self.place = place
        self.source = source
        super().__init__(problem)

    def at(self, *, place: str = "", source: str = "") -> InputError:
        """The same error, with what an outer layer knows about where it happened."""
        joined = ".".join(part for part in (place, self.place) if part).replace(".[", "[")
        return InputError(self.problem, fix=self.fix, place=joined, source=self.source or source)

    def __str__(self) -> str:
        where = ": ".join(part for part in (self.source, self.place, self.problem) if part)
        line = f"{where}; {self.fix}" if self.fix else where
        return " ".join(line.split())


class NothingToJudge(RuntimeError):
    """The run cannot reach a verdict (no GL context for a GL method, say): exit status 3."""
