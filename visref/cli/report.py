"""visref report: make a page from run folders."""

from __future__ import annotations

import argparse
from pathlib import Path

from visref.cli.terminal import OUT
from visref.judging.status import Exit
from visref.report import write_report
from visref.report.bench_folder import is_bench
from visref.report.words import overall
from visref.run_folder.read import read_run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="a run folder, or one of `visref bench`"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")


def run(given: argparse.Namespace) -> Exit:
    OUT.line(f"The report: {write_report(given.runs, given.out)}")
    runs = [folder for folder in given.runs if not is_bench(folder)]
    _, exit_ = overall([read_run(folder, objects=False) for folder in runs])
    return exit_
