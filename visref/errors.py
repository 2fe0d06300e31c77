"""The ways a run can stop: bad input that its author can fix, nothing to judge, and what it runs on
breaking down."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from typing import Any


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


class Unfinished(RuntimeError):
    """What the run goes on, a cluster say, broke down, or what it judges ends each process that
    judges it: exit status 70. Its text is one line."""


def error_json(error: BaseException) -> dict[str, Any]:
    """An error for another process, which raises it by `raise_told`."""
    if isinstance(error, InputError):
        fields = ("problem", "fix", "place", "source")
        return {"input": {name: getattr(error, name) for name in fields}}
    if isinstance(error, NothingToJudge):
        return {"nothing": str(error)}
    return {"fault": "".join(traceback.format_exception(error))}


def raise_told(said: Mapping[str, Any]) -> None:
    """Raise what `error_json` says, if that is what this is: RuntimeError for a fault."""
    if "input" in said:
        raise InputError(**said["input"])
    if "nothing" in said:
        raise NothingToJudge(said["nothing"])
    if "fault" in said:
        raise RuntimeError(f"in a worker:\n{said['fault']}")
