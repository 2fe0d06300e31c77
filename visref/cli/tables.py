"""visref tables: measure the papers' tables again, beside the published numbers."""

from __future__ import annotations

import argparse
import csv
import io
import math
from pathlib import Path
from typing import Any

from visref.cli.manners import add_json
from visref.cli.terminal import ERRORS, OUT, Steps, progress
from visref.judging.status import Exit
from visref.numerals import decimal_number, whole_number
from visref.papers import load_paper, paper_names
from visref.tables import default_workers, run_all, write_tables


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--paper",
        action="append",
        metavar="NAME",
        help=f"repeat for several; {', '.join(paper_names())} (default: all)",
    )
    parser.add_argument(
        "--frames",
        type=whole_number,
        metavar="N",
        help="only N frames of each path, for a quick look",
    )
    parser.add_argument(
        "--shift",
        type=decimal_number,
        default=0.0,
        metavar="SHARE",
        help="other frames: moved by this share of the way to the next, -0.5 to 0.5",
    )
    parser.add_argument(
        "--seed",
        type=whole_number,
        default=0,
        metavar="N",
        help="other scenes, of this seed, and other resamples for the intervals",
    )
    parser.add_argument(
        "--large", action="store_true", help="the 34-million-triangle city too: some 12 GiB"
    )
    parser.add_argument(
        "--workers",
        type=whole_number,
        metavar="N",
        help="scenes measured at once, each on cores of its own (default: one per core)",
    )
    parser.add_argument(
        "--threads",
        type=whole_number,
        metavar="N",
        help="of what is measured alone (default: all cores)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="continues with what is there",
    )
    add_json(parser, "print every row of every table with its grade, for programs")
    kept = "what was measured is kept, and the same command continues from there"
    parser.set_defaults(interrupted=kept)


def run(given: argparse.Namespace) -> Exit:
    names = list(dict.fromkeys(given.paper or paper_names()))
    papers = [load_paper(name) for name in names]
    workers = default_workers() if given.workers is None else given.workers
    with Steps(progress()) as steps:
        measured = run_all(
            papers,
            given.out,
            steps,
            frames=given.frames,
            large=given.large,
            threads=given.threads,
            shift=given.shift,
            seed=given.seed,
            workers=workers,
        )
    page, status = write_tables(measured)
    for label, why in measured.failures.items():
        ERRORS.line(f"not measured: {label}: {why}")
    if given.json:
        OUT.json(
            {
                "page": str(page),
                "exit_status": int(status),
                "not_measured": measured.failures,
                "rows": rows_of((given.out / "tables.csv").read_text(encoding="utf-8")),
            }
        )
        return status
    OUT.lines((given.out / "claims.md").read_text(encoding="utf-8"))
    OUT.line()
    OUT.line(f"The tables: {page}")
    return status


# The columns that are numbers, where there is one; what is published may be words.
_NUMBERS = ("published", "ours", "low", "high", "ratio")


def rows_of(text: str) -> list[dict[str, Any]]:
    """The rows of tables.csv: numbers as such, None for what is empty, or for an interval's end
    that is nowhere."""
    return [
        {name: _value(name, cell) for name, cell in row.items()}
        for row in csv.DictReader(io.StringIO(text))
    ]


def _value(name: str, cell: str) -> str | float | None:
    if not cell:
        return None
    if name in _NUMBERS:
        try:
            number = float(cell)
        except ValueError:
            return cell
        return number if math.isfinite(number) else None
    return cell
