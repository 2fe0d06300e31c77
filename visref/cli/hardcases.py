"""visref hardcases: try engines and cullers on the hard numerical cases."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from visref.cli.commands import (
    add_command_arguments,
    add_time_limit,
    command_names,
    commands_of,
    saying,
)
from visref.cli.terminal import OUT, frame_bar
from visref.culler import Culler
from visref.files import replacing_file
from visref.judging.status import Exit
from visref.memory import default_budget
from visref.plug_ins.command import Command, CommandCuller
from visref.registry import CULLERS, ENGINES
from visref.trials.doctor import engine_checks
from visref.trials.hardcases import HardCase, HardCaseTable, every_spec, run_hard_cases
from visref.trials.hardcases_page import culler_summary, hard_cases_page


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--engine", action="append", metavar="NAME[:option=value]", help="repeat for several"
    )
    parser.add_argument(
        "--culler", action="append", metavar="NAME[:option=value,…]", help="repeat for several"
    )
    add_command_arguments(parser)
    add_time_limit(parser)
    parser.add_argument("--only", action="append", metavar="CASE", help="repeat for several")
    parser.add_argument("--json", action="store_true", help="for programs")
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="write a page as well")


def run(given: argparse.Namespace) -> Exit:
    engines, cullers = given.engine, given.culler
    programs = _programs(given)
    if engines is None and cullers is None and not programs:
        engines, cullers = every_spec(ENGINES), every_spec(CULLERS)
    with frame_bar(len(given.only or ()) or None) as bar:
        table = run_hard_cases(
            engines or (),
            cullers or (),
            programs=programs,
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


def _programs(given: argparse.Namespace) -> dict[str, Callable[[HardCase], Culler]]:
    """By the name of each program of --command, what makes its culler for a case."""
    commands = commands_of(given)
    names = command_names(given.culler or (), commands)
    return {
        name: _on_case(command, name, given.time_limit)
        for name, command in zip(names, commands, strict=True)
    }


def _on_case(command: Command, name: str, time_limit_s: float) -> Callable[[HardCase], Culler]:
    return lambda case: CommandCuller(
        command,
        case.scene_file,
        case.path,
        cull_backfaces=case.cull_backfaces,
        time_limit_s=time_limit_s,
        memory_limit=default_budget(),
        say=saying(name),
    )


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
