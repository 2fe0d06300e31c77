"""visref fuzz: search for the views and the scenes in which a culler fails."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from visref.cli.arguments import add_memory_argument, memory_of
from visref.cli.commands import add_command_arguments, add_time_limit, commands_of, saying
from visref.cli.manners import add_json
from visref.cli.terminal import OUT, progress
from visref.conformance.declared import can_of
from visref.engines import check_engine
from visref.errors import InputError
from visref.judging.status import Exit
from visref.memory import default_budget
from visref.numerals import whole_number
from visref.plug_ins import Making
from visref.search.folder import FAULTS, SUMMARY, SearchFolder
from visref.search.fuzz import Shown, fuzz
from visref.search.trying import Asked
from visref.threads import available_threads
from visref.wording import counted

# Where neither an end in trials nor one in seconds is given.
_SECONDS = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--culler", metavar="NAME[:option=value,…]", help="who is tried; module:Class is your own"
    )
    add_command_arguments(parser)
    parser.add_argument(
        "--scene",
        metavar="SCENE",
        help="views of this scene (a file, or a generated one), in place of generated scenes",
    )
    parser.add_argument(
        "--cull-backfaces",
        action="store_true",
        help="of --scene: triangles whose material is not double-sided show their front only",
    )
    parser.add_argument(
        "--lenient",
        action="store_true",
        help="of --scene: drop triangles with a NaN or infinite vertex",
    )
    parser.add_argument(
        "--can",
        metavar="CLASS,…",
        help="the classes of conformance cases that the culler is for (default: all; 'plain' is "
        "none of them)",
    )
    ends = parser.add_mutually_exclusive_group()
    ends.add_argument("--trials", type=whole_number, metavar="N", help="how many, in all")
    ends.add_argument(
        "--time",
        type=float,
        metavar="SECONDS",
        help=f"how long, from now on (default {_SECONDS:g}, without --trials)",
    )
    parser.add_argument("--seed", type=whole_number, default=0, metavar="N", help="(default 0)")
    parser.add_argument(
        "--workers", type=whole_number, metavar="N", help="processes (default: all cores)"
    )
    parser.add_argument(
        "--engine", metavar="NAME[:option=value]", help="default: exact; of --scene, embree"
    )
    parser.add_argument(
        "--in-process",
        action="store_true",
        help="run your own culler in visref's processes, for speed: no limits hold there",
    )
    add_time_limit(parser)
    add_memory_argument(parser)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="what is found, and the corpus that the next search goes on from",
    )
    add_json(parser, "print summary.json, and nothing else")


def run(given: argparse.Namespace) -> Exit:
    asked = _asked(given)
    seconds = given.time
    if seconds is None and given.trials is None:
        seconds = _SECONDS
    for name, value in (("trials", given.trials), ("time", seconds), ("workers", given.workers)):
        if value is not None and not value > 0:
            raise InputError(f"--{name} is {value:g}", fix="give more than 0")
    given.interrupted = "what was tried before stands in --out"
    with _line() as shown:
        found = fuzz(
            asked,
            given.out,
            trials=given.trials,
            seconds=seconds,
            workers=given.workers or available_threads(),
            shown=shown,
        )
    if given.json:
        OUT.json(found.summary())
    else:
        _print(found)
    return found.exit


def _asked(given: argparse.Namespace) -> Asked:
    commands = commands_of(given)
    if (given.culler is None) == (not commands) or len(commands) > 1:
        raise InputError("a search tries one culler", fix="give --culler or --command, one of them")
    for name in ("cull_backfaces", "lenient"):
        if getattr(given, name) and given.scene is None:
            raise InputError(f"--{name.replace('_', '-')} is of --scene", fix="name a scene")
    if given.engine is not None:
        check_engine(given.engine)
    limit = memory_of(given)
    return Asked(
        culler=given.culler or "",
        command=commands[0] if commands else None,
        scene=given.scene or "",
        making=Making(
            given.in_process,
            given.time_limit,
            default_budget() if limit is None else limit,
            _say,
        ),
        engine=given.engine or "",
        cull_backfaces=given.cull_backfaces,
        lenient=given.lenient,
        can=None if given.can is None else can_of(given.can),
        seed=given.seed,
    )


def _say(name: str, line: str) -> None:
    """What a culler prints, in whichever process it is tried."""
    saying(name)(line)


@contextmanager
def _line() -> Iterator[Shown]:
    """A line of progress; its first call says where the search began."""
    began = time.monotonic()
    first: list[int] = []
    with progress() as bar:
        task = bar.add_task("searching", total=None)

        def shown(folder: SearchFolder, doing: str) -> None:
            tally = folder.tally
            first[:] = first or [tally.trials]
            passed = max(time.monotonic() - began, 1e-9)
            rate = (tally.trials - first[0]) / passed
            text = (
                f"{counted(tally.trials, 'trial')} ({rate:.1f} per second), "
                f"{counted(tally.violations, 'violation')}, "
                f"{counted(len(folder.distinct), 'distinct fault')}"
            )
            if doing:
                text = f"{doing} ({counted(tally.trials, 'trial')} made)"
            bar.update(task, description=text)

        yield shown


def _print(found: SearchFolder) -> None:
    tally = found.tally
    OUT.line(
        f"{counted(tally.trials, 'trial')}: {tally.judged} judged, {tally.skipped} skipped, "
        f"{tally.broke_down} in which the culler broke down; "
        f"{counted(tally.violations, 'violation')} in {counted(tally.violating, 'trial')}."
    )
    if tally.failed:
        OUT.line(f"It broke down first in trial {tally.failed_in}: {tally.failed}")
    if not found.faults:
        said = "No violation was found" if tally.judged else "Nothing could be judged"
        OUT.line(f"{said}; {found.out / SUMMARY}")
        return
    headings = ("fault", "what", "cause", "smallest scene", "triangles", "trial", "in trials")
    rows = [
        (
            one.folder or "-",
            one.key.kind,
            one.key.cause or "-",
            one.structure or one.note,
            str(one.triangles or "-"),
            str(one.trial),
            str(one.trials),
        )
        for one in found.distinct
    ]
    OUT.table(headings, rows, left=headings[:4])
    OUT.line(f"{counted(len(found.distinct), 'distinct fault')}: {found.out / FAULTS}")
