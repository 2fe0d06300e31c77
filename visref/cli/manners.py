"""How much a command says, and to whom: a person, a person in a hurry, or a program."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from dataclasses import dataclass

from visref.judging.status import Status


@dataclass
class Manners:
    """`quiet`: only errors and what was asked for; `verbose`: every finding, and what each step
    took; `json`: standard output is for a program."""

    quiet: bool = False
    verbose: bool = False
    json: bool = False

    def take(self, given: argparse.Namespace) -> None:
        """From a command's arguments."""
        self.quiet = getattr(given, "quiet", False)
        self.verbose = getattr(given, "verbose", False)
        self.json = getattr(given, "json", None) is True

    @property
    def remarks(self) -> bool:
        """Whether what is only good to know is said."""
        return not (self.quiet or self.json)


# Of the command that runs.
MANNERS = Manners()

RED, GREEN, YELLOW, BLUE = "31", "32", "33", "34"
OF_STATUS = {
    Status.NO_VIOLATION_FOUND: GREEN,
    Status.VIOLATION: RED,
    Status.INCONCLUSIVE: YELLOW,
    Status.MEASURED: BLUE,
}
OF_SEVERITY = {"error": RED, "warning": YELLOW}


def add_manners(parser: argparse.ArgumentParser) -> None:
    """-q and -v, before a command's name or after it."""
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "-q",
        "--quiet",
        action="store_true",
        default=argparse.SUPPRESS,
        help="only what was asked for, and errors: no progress, no remarks",
    )
    how.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        default=argparse.SUPPRESS,
        help="every finding, and how long each step took",
    )


def add_json(parser: argparse.ArgumentParser, what: str = "for programs") -> None:
    """--json: standard output holds one JSON value and nothing else."""
    parser.add_argument("--json", action="store_true", help=what)


def coloured(is_terminal: bool, environment: Mapping[str, str] | None = None) -> bool:
    """Whether a stream gets colours: a terminal that can, unless NO_COLOR says no; others where
    FORCE_COLOR asks for them. Source: no-color.org and force-color.org, where an empty value is
    none."""
    environment = os.environ if environment is None else environment
    if environment.get("NO_COLOR"):
        return False
    if environment.get("FORCE_COLOR"):
        return True
    return is_terminal and environment.get("TERM", "") not in ("", "dumb")
