"""visref hardcases: try engines and cullers on the hard numerical cases."""

from __future__ import annotations

import argparse
from pathlib import Path

from visref.cli.terminal import OUT, frame_bar
from visref.files import replacing_file
from visref.judging.status import Exit
from visref.registry import CULLERS, ENGINES
from visref.trials.doctor import engine_checks
from visref.trials.hardcases import HardCaseTable, every_spec, run_hard_cases
from visref.trials.hardcases_page import culler_summary, hard_cases_page


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--engine", action="append", metavar="NAME[:option=value]", help="repeat for several"
    )
    parser.add_argument(
        "--culler", action="append", metavar="NAME[:option=value,…]", help="repeat for several"
    )
    parser.add_argument("--only", action="append", metavar="CASE", help="repeat for several")
    parser.add_argument("--json", action="store_true", help="for programs")
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="write a page as well")


def run(given: argparse.Namespace) -> Exit:
    engines, cullers = given.engine, given.culler
    if engines is None and cullers is None:
        engines, cullers = every_spec(ENGINES), every_spec(CULLERS)
    with frame_bar(len(given.only or ()) or None) as bar:
        table = run_hard_cases(
            engines or (),
            cullers or (),
            only=given.only,
            on_case=lambda name: bar.on_frame_done(0),
        )
        if given.out is not None:
            machine = [f"{check.name}: {check.detail}" for check in engine_checks() if check.works]
            with replacing_file(given.out) as file:
                file.write_text(hard_cases_page(table, machine), encoding="utf-8")
    if given.json:
        OUT.json(table.to_json())
    else:
        _print(table)
    return table.exit


def _print(table: HardCaseTable) -> None:
    headings = ["case", *table.engines, *(["cullers"] if table.cullers else [])]
    rows = []
    for case in table.cases:
        cells = [str(table.cells[case.name][spec]) for spec in table.engines]
        cullers = [culler_summary(table, case.name)] if table.cullers else []
        rows.append([case.name, *cells, *cullers])
    OUT.table(headings, rows, left=headings)
    for reason in table.reasons():
        OUT.line(reason)
