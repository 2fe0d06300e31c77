"""visref warm: compile ahead what runs need, a part on each core."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from visref.cli.breakdown import BROKE_DOWN
from visref.cli.manners import add_json
from visref.cli.terminal import ERRORS, OUT, Steps, progress
from visref.errors import InputError
from visref.judging.status import Exit
from visref.numerals import whole_number
from visref.threads import available_threads
from visref.warming import (
    PARTS,
    can_keep,
    holds,
    keep_loaded,
    keep_packages,
    place,
    write_record,
)
from visref.wording import counted, did_you_mean

# How often the parts that run are asked whether they have ended.
_LOOK_S = 0.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--jobs", type=whole_number, metavar="N", help="parts at a time (default: all cores)"
    )
    parser.add_argument("--part", metavar="NAME", help="compile one part alone, in this process")
    add_json(parser, "print where they are kept and how each part ended, for programs")


def run(given: argparse.Namespace) -> int:
    if given.part is not None:
        if given.json:
            raise InputError("--json and --part", fix="leave one out: a part prints what it runs")
        return _one(given.part)
    jobs = available_threads() if given.jobs is None else given.jobs
    if jobs < 1:
        raise InputError(f"--jobs is {jobs}", fix="give 1 or more")
    keep_packages()
    waiting = [name for name in PARTS if not holds(name)]
    if not waiting:
        _print_json(given, {})
        OUT.remark(f"all is compiled already: {place()}")
        return Exit.NO_VIOLATION
    can_keep()
    OUT.remark(
        f"compiling {counted(len(waiting), 'part')} of {len(PARTS)}, {min(jobs, len(waiting))} at "
        f"a time, into {place()}: some minutes where all is new"
    )
    started = time.monotonic()
    ended, broken = _all(waiting, jobs)
    _print_json(given, ended)
    OUT.remark(f"{time.monotonic() - started:.0f} s")
    return BROKE_DOWN if broken else Exit.NO_VIOLATION


def _print_json(given: argparse.Namespace, ended: Mapping[str, str | None]) -> None:
    """With --json: each part, and why it was left out, None where it was not."""
    if not given.json:
        return
    parts = [
        {"part": name, "new": name in ended, "left_out_because": ended.get(name)} for name in PARTS
    ]
    OUT.json({"folder": str(place()), "parts": parts})


def _one(name: str) -> int:
    """Do a part here, and record it if it came to an end."""
    from visref.cli.main import main

    if name not in PARTS:
        raise InputError(f"no part is named '{name}'", fix=did_you_mean(name, PARTS))
    can_keep()
    with tempfile.TemporaryDirectory(prefix="visref-warm-") as folder:
        status = PARTS[name](Path(folder), main)
    keep_loaded()
    if status == Exit.NO_VIOLATION:
        write_record(name)
    return status


@dataclass
class _Running:
    name: str
    process: subprocess.Popen[bytes]
    errors: IO[bytes]
    started: float

    def last_line(self) -> str:
        self.errors.seek(0)
        lines = self.errors.read().decode(errors="replace").split("\n")
        said = f"it ended with status {self.process.returncode}"
        return next((line for line in reversed(lines) if line.strip()), said)


def _all(waiting: Sequence[str], jobs: int) -> tuple[dict[str, str | None], bool]:
    """Do the parts, so many at a time, each in a process. One that this machine cannot do, for lack
    of OpenGL say, is told and left out. Returns why each was left out, None where it was not, and
    whether one broke down."""
    queue, running, broken = list(waiting), list[_Running](), False
    result: dict[str, str | None] = {}
    with ExitStack() as closing, progress() as shown:
        steps = Steps(shown)
        steps.begin(len(waiting))
        closing.callback(_end, running)
        while queue or running:
            while queue and len(running) < jobs:
                running.append(_start(queue.pop(0), closing))
                steps.task(", ".join(one.name for one in running))
            ended = next((one for one in running if one.process.poll() is not None), None)
            if ended is None:
                time.sleep(_LOOK_S)
                continue
            running.remove(ended)
            steps.advance(1)
            status = ended.process.returncode
            if status == Exit.NO_VIOLATION:
                result[ended.name] = None
                OUT.remark(f"{ended.name}: {time.monotonic() - ended.started:.0f} s")
                continue
            result[ended.name] = ended.last_line()
            ERRORS.line(f"{ended.name} is left out: {result[ended.name]}")
            broken = broken or status not in (Exit.BAD_INPUT, Exit.NOTHING_JUDGED)
    return result, broken


def _start(name: str, closing: ExitStack) -> _Running:
    errors: IO[bytes] = closing.enter_context(tempfile.TemporaryFile())  # noqa: SIM115
    # Each part has a core; Mesa's own threads would only wait for it.
    environment = {"LP_NUM_THREADS": "0", **os.environ}
    process = subprocess.Popen(
        _line(name),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=errors,
        env=environment,
    )
    return _Running(name, process, errors, time.monotonic())


def _line(name: str) -> list[str]:
    """The command line of the process that does a part."""
    return [sys.executable, "-m", "visref", "warm", "--part", name]


def _end(running: Sequence[_Running]) -> None:
    """End what still runs, after an interrupt say."""
    for one in running:
        one.process.terminate()
    for one in running:
        one.process.wait()
