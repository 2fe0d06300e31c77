"""visref report: make a page from run folders."""

from __future__ import annotations

import argparse
from pathlib import Path

from visref.cli.terminal import OUT
from visref.judging.status import Exit
from visref.report import write_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="a run folder, or one of `visref bench`"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")


def run(given: argparse.Namespace) -> Exit:
    OUT.print(f"The report: {write_report(given.runs, given.out)}", markup=False)
    return Exit.NO_VIOLATION
