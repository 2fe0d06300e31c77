"""visref shrink: the smallest scene that still shows a miss of a run."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from visref.cli.arguments import memory_of
from visref.cli.commands import (
    add_command_arguments,
    add_time_limit,
    commands_of,
    saying,
)
from visref.cli.manners import add_json
from visref.cli.terminal import OUT, progress
from visref.errors import InputError
from visref.files import refuse_inputs, replacing_folder
from visref.judging.causes import CODES
from visref.judging.status import Exit
from visref.memory import default_budget
from visref.numerals import whole_number
from visref.plug_ins import Making
from visref.search.case import Case
from visref.search.fault_folder import FAULT_FOLDER, write_fault
from visref.search.fault_texts import size_text
from visref.search.holding import Effort, Holding, Wanted
from visref.search.of_run import open_run, starting_case
from visref.search.shrinking import shrink
from visref.search.suspects import Program, Suspect, suspect_of
from visref.wording import counted, did_you_mean


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="the run folder that has the miss")
    parser.add_argument("--frame", type=whole_number, required=True, metavar="F")
    parser.add_argument("--object", required=True, metavar="O", help="object id or name")
    parser.add_argument(
        "--cause",
        metavar="CODE",
        help="the cause that every step must keep (default: what the run names for the object, as "
        "long as small scenes tell it)",
    )
    parser.add_argument(
        "--culler",
        action="append",
        metavar="NAME[:option=value,…]",
        help="who missed it, as `visref run` is told; module:Class is your own",
    )
    add_command_arguments(parser)
    parser.add_argument(
        "--in-process",
        action="store_true",
        help="run your own culler in visref's process, to debug it: no limits hold there",
    )
    add_time_limit(parser)
    parser.add_argument(
        "--max-memory", metavar="SIZE", help="what your own culler may take, such as 2G"
    )
    parser.add_argument(
        "--trials",
        type=whole_number,
        default=Effort.trials,
        metavar="N",
        help="smaller scenes that are tried at most (default %(default)s)",
    )
    parser.add_argument(
        "--time", type=float, metavar="SECONDS", help="stop after so long (default: no limit)"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the fault's folder")
    add_json(parser)


def run(given: argparse.Namespace) -> Exit:
    if given.trials < 1:
        raise InputError(f"--trials is {given.trials}", fix="give 1 or more")
    if given.time is not None and not given.time > 0.0:
        raise InputError(f"--time is {given.time:g}", fix="give seconds above 0")
    refuse_inputs(given.out, [given.run])
    with _suspect(given) as suspect, progress() as shown:
        judged = open_run(given.run, given.frame, given.object, suspect.name)
        wanted = _with_cause(judged.wanted, given.cause)
        engine = judged.inputs.engine
        effort = Effort(given.trials, given.time)
        firm = given.cause is not None
        holding = Holding(suspect, wanted, engine=engine, effort=effort, firm=firm)
        bar = shown.add_task("reading the run", total=given.trials)

        def tell(step: str, trials: int, case: Case) -> None:
            shown.update(bar, completed=trials, description=f"{step}: {size_text(case)}")

        with replacing_folder(given.out, kind=FAULT_FOLDER) as folder:
            first = starting_case(judged, holding)
            shrunk = shrink(first, holding, tell)
            write_fault(folder, shrunk, suspect, engine=engine)
    if given.json:
        said = {"out": str(given.out), "trials": shrunk.trials, "whole": shrunk.whole}
        OUT.json({**said, "from": size_text(first), "to": size_text(shrunk.case)})
        return Exit.NO_VIOLATION
    OUT.remark(f"From {size_text(first)} to {size_text(shrunk.case)}, by {_trials(shrunk.trials)}")
    if not shrunk.whole:
        OUT.remark("It may be made smaller yet: give more --trials, or --time")
    OUT.line(f"The fault: {given.out}; its REPORT.md can be pasted into a tracker")
    return Exit.NO_VIOLATION


def _with_cause(wanted: Wanted, cause: str | None) -> Wanted:
    """With the cause that is given, if one is. Raises InputError where there is none such, or where
    it is about what is drawn for nothing."""
    if cause is None:
        return wanted
    if cause not in CODES:
        raise InputError(
            f"no cause is called '{cause}'",
            place="--cause",
            fix=did_you_mean(cause, CODES, "give one that the run's verdict.json names"),
        )
    if not wanted.left_out:
        raise InputError(
            f"'{wanted.name}' is drawn for nothing there, and causes are of what is missed",
            place="--cause",
            fix="leave it out",
        )
    return replace(wanted, cause=cause)


def _trials(count: int) -> str:
    return counted(count, "trial")


def _suspect(given: argparse.Namespace) -> Suspect:
    """The one culler that is named. Raises InputError where there is none, or several."""
    specs, commands = given.culler or [], commands_of(given)
    if not specs and not commands:
        raise InputError(
            "no culler is named, and a smaller scene needs an answer of its own: what was recorded "
            "says nothing of it",
            fix="give --culler or --command, as `visref run` is told",
        )
    if len(specs) + len(commands) > 1:
        raise InputError("several cullers are named", fix="shrink for one at a time")
    memory = memory_of(given)
    limit = default_budget() if memory is None else memory
    if commands:
        return Program(commands[0], given.time_limit, limit, saying(commands[0].name))
    making = Making(
        given.in_process, given.time_limit, limit, say=lambda spec, line: saying(spec)(line)
    )
    return suspect_of(specs[0], making)
