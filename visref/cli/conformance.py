"""visref conformance: the suite for engines in any language, and for cullers."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from visref.cli.arguments import add_memory_argument, memory_of, parse_raster
from visref.cli.commands import add_time_limit, saying
from visref.cli.terminal import OUT, frame_bar
from visref.conformance.contest import (
    Ended,
    Row,
    counts_of,
    exit_of,
    results_json,
    results_junit,
    rows_of_culler,
    rows_of_files,
    run_rows,
)
from visref.conformance.declared import Declared, can_of, read_declared
from visref.conformance.files import (
    MANIFEST,
    check_manifest,
    check_suite,
    write_suite,
    written_cases,
)
from visref.conformance.programs import Program
from visref.conformance.recorded import read_recordings
from visref.conformance.suite import MakeCuller, Status, conformance_checks
from visref.culler import Culler, Promise, RasterTolerance
from visref.errors import InputError
from visref.files import replacing_file
from visref.judging.status import Exit
from visref.memory import default_budget
from visref.numerals import whole_number
from visref.plug_ins import Making, making_cullers
from visref.plug_ins.command import Command
from visref.plug_ins.making import check_time_limit
from visref.wording import counted, did_you_mean

_STDOUT = Path("-")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--write", type=Path, metavar="DIR", help="write the cases as files: GLB, path, manifest"
    )
    what.add_argument(
        "--recordings",
        type=Path,
        metavar="DIR",
        help="judge an engine's recordings, CASE.jsonl each",
    )
    what.add_argument(
        "--culler", metavar="NAME[:option=value,…]", help="judge a culler; module:Class is your own"
    )
    what.add_argument(
        "--command",
        # Each command's function is kept as `command`.
        dest="program",
        metavar='"PROGRAM … {scene} {path} {visible}"',
        help="judge a program that reads a scene and a path and writes what it draws",
    )
    parser.add_argument(
        "--suite",
        type=Path,
        metavar="DIR",
        help="the suite that was recorded, as --write wrote it (default: by the manifest.json "
        "beside the recordings, if there is one)",
    )
    parser.add_argument("--seed", type=whole_number, metavar="N", help="of the cases (default 0)")
    parser.add_argument("--only", action="append", metavar="CASE", help="repeat for several")
    parser.add_argument(
        "--can",
        metavar="CLASS,…",
        help="what the engine is made for (default: all classes; 'plain' is none of them)",
    )
    parser.add_argument(
        "--expected",
        type=Path,
        metavar="FILE.toml",
        help="what it is made for, and the cases that it is known to fail, with reasons",
    )
    promises = [promise.value for promise in Promise if promise is not Promise.APPROXIMATE]
    parser.add_argument(
        "--promise",
        choices=promises,
        help="of recordings and programs (default conservative)",
    )
    parser.add_argument(
        "--raster",
        metavar="snap=PX,depth=BITS",
        help="of recordings and programs: the engine's rasteriser, as for `check`",
    )
    parser.add_argument("--junit", type=Path, metavar="FILE", help="write the results as JUnit XML")
    parser.add_argument(
        "--json",
        type=Path,
        nargs="?",
        # As many programs have it: standard output.
        const=_STDOUT,
        metavar="FILE",
        help="write them for programs (without FILE: to standard output, and no table)",
    )
    parser.add_argument(
        "--in-process",
        action="store_true",
        help="run your own culler in visref's process, to debug it: no limits hold there",
    )
    add_time_limit(parser)
    add_memory_argument(parser)


# What is asked for, by its option, and the options that go with some of it alone.
_ASKED = {"write": "write", "recordings": "recordings", "culler": "culler", "program": "command"}
_JUDGED = ("recordings", "culler", "command")
_BELONGS = {
    "suite": ("recordings",),
    "promise": ("recordings", "command"),
    "raster": ("recordings", "command"),
    **dict.fromkeys(("only", "can", "expected", "junit", "json"), _JUDGED),
}


def run(given: argparse.Namespace) -> Exit:
    asked = next(option for name, option in _ASKED.items() if getattr(given, name) is not None)
    for option, owners in _BELONGS.items():
        if getattr(given, option) is not None and asked not in owners:
            raise InputError(
                f"--{option} does not go with --{asked}",
                fix=f"it is for {', '.join(f'--{owner}' for owner in owners)}",
            )
    if asked == "write":
        return _write(given.write, given.seed or 0)
    if asked == "recordings":
        return _judge_recordings(given)
    return _judge_program(given) if asked == "command" else _judge_culler(given)


def _write(folder: Path, seed: int) -> Exit:
    count = write_suite(folder, seed)
    OUT.line(f"{counted(count, 'case')} in {folder}; {folder / MANIFEST} lists them.")
    OUT.line("Let the engine draw each along its path and write what it drew to CASE.jsonl; then")
    OUT.line(f"visref conformance --recordings DIR --suite {folder}")
    return Exit.NO_VIOLATION


def _judge_recordings(given: argparse.Namespace) -> Exit:
    seed = _seed_of_suite(given)
    cases = written_cases(seed)
    names = [case.name for case in cases]
    declared = _declared(given, names)
    entrant = read_recordings(
        given.recordings,
        cases,
        declared,
        promise=_promise(given),
        raster=_raster(given),
        max_memory=memory_of(given),
    )
    picked = _picked(given, rows_of_files(entrant, cases, declared))
    return _run(given, entrant.name, seed, picked, declared)


def _seed_of_suite(given: argparse.Namespace) -> int:
    """The seed of the suite that was recorded: that of its folder, or of the manifest that stands
    among the recordings, where there is one."""
    if given.suite is not None:
        return check_suite(given.suite, given.seed)
    manifest: Path = given.recordings / MANIFEST
    if manifest.is_file():
        return check_manifest(manifest, given.seed)
    return int(given.seed or 0)


def _judge_program(given: argparse.Namespace) -> Exit:
    seed = int(given.seed or 0)
    check_time_limit(given.time_limit)
    command = Command.parse(given.program, promise=_promise(given), raster=_raster(given))
    cases = written_cases(seed)
    declared = _declared(given, [case.name for case in cases])
    program = Program(command, given.time_limit, _memory_limit(given), saying(command.name))
    picked = _picked(given, rows_of_files(program, cases, declared))
    return _run(given, program.name, seed, picked, declared)


def _promise(given: argparse.Namespace) -> Promise:
    return Promise(given.promise or Promise.CONSERVATIVE)


def _raster(given: argparse.Namespace) -> RasterTolerance | None:
    return None if given.raster is None else parse_raster("--raster", given.raster)


def _memory_limit(given: argparse.Namespace) -> int:
    limit = memory_of(given)
    return default_budget() if limit is None else limit


def _judge_culler(given: argparse.Namespace) -> Exit:
    seed = int(given.seed or 0)
    declared = _declared(given, [check.name for check in conformance_checks()])
    making = Making(
        given.in_process,
        given.time_limit,
        _memory_limit(given),
        say=lambda spec, line: saying(spec)(line),
    )

    @contextmanager
    def maker() -> Iterator[MakeCuller]:
        with ExitStack() as closing:

            def make() -> Culler:
                ((_, culler),) = closing.enter_context(making_cullers([given.culler], making))
                return culler

            yield make

    picked = _picked(given, rows_of_culler(given.culler, maker, seed))
    return _run(given, given.culler, seed, picked, declared)


def _declared(given: argparse.Namespace, names: Sequence[str]) -> Declared:
    found = Declared() if given.expected is None else read_declared(given.expected, names)
    if given.can is None:
        return found
    if found.can is not None:
        raise InputError(
            "--can is given, and the file of --expected has 'can'", fix="say it in one of them"
        )
    return Declared(can_of(given.can), found.reasons)


def _picked(given: argparse.Namespace, rows: Sequence[Row]) -> list[Row]:
    names = [row.name for row in rows]
    for name in given.only or ():
        if name not in names:
            raise InputError(
                f"there is no case '{name}'", source="--only", fix=did_you_mean(name, names)
            )
    return [row for row in rows if given.only is None or row.name in given.only]


def _run(
    given: argparse.Namespace, engine: str, seed: int, rows: Sequence[Row], declared: Declared
) -> Exit:
    ended = []
    with frame_bar(len(rows)) as bar:
        for number, one in enumerate(run_rows(rows, declared)):
            ended.append(one)
            bar.on_frame_done(number)
    if given.junit is not None:
        with replacing_file(given.junit, begins=b"<?xml") as file:
            file.write_text(results_junit(engine, seed, ended), encoding="utf-8")
    if given.json == _STDOUT:
        OUT.json(results_json(engine, seed, ended))
        return exit_of(ended)
    if given.json is not None:
        with replacing_file(given.json, begins=b"{") as file:
            text = json.dumps(results_json(engine, seed, ended), indent=1)
            file.write_text(f"{text}\n", encoding="utf-8")
    _print(ended)
    return exit_of(ended)


def _print(ended: Sequence[Ended]) -> None:
    headings = ("case", "classes", "result", "why")
    rows = [
        (one.row.name, " ".join(one.row.classes), one.result.status.value, one.first)
        for one in ended
    ]
    OUT.table(headings, rows, left=headings)
    told = [f"{count} {status.value}" for status, count in counts_of(ended).items() if count]
    OUT.line(f"{counted(len(ended), 'case')}: {', '.join(told)}.")
    if any(one.result.status in (Status.SKIPPED, Status.MEASURED) for one in ended):
        OUT.line("What was not run, or was measured alone, has not passed.")
