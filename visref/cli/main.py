"""The parser, put together from the commands' modules, and exit statuses.

Each command is a module of this folder with its name, which has `add_arguments(parser)` and
`run(given)`. Only the module of the command that is asked for is imported, so that `visref --help`
is quick.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Sequence

from visref.cli.breakdown import BROKE_DOWN, INTERRUPTED, broke_down
from visref.cli.manners import MANNERS, RED, add_manners
from visref.cli.terminal import ERRORS, OUT, Parser, WrongArguments, prepare, step_shown
from visref.doing import watched_by
from visref.errors import InputError, NothingToJudge, Unfinished
from visref.judging.status import Exit

COMMANDS = {
    "demo": "judge four cullers on a generated city",
    "truth": "cast who owns which samples, to a Parquet file",
    "run": "judge cullers on a scene and a camera path",
    "check": "judge an engine's recorded visible sets",
    "batch": "judge many scenes, paths and cullers, from one file",
    "merge": "put the parts of a run together that --shard left",
    "bench": "speed against error: where to stop paying",
    "report": "make a page from run folders",
    "tables": "measure the papers' tables again, beside the published numbers",
    "path": "make camera paths, and say what their cameras see",
    "convert": "between a one-file recording and a path with visible sets",
    "explain": "replay a witness from the run folder alone",
    "shrink": "make the smallest scene that still shows a miss of a run",
    "objects": "list a scene's objects: ids, bounds, nodes, names, groups",
    "cullers": "list cullers, their options and promises",
    "scenes": "list the scenes that can be generated, and their options",
    "conformance": "hold an engine in any language, or a culler, to the suite",
    "hardcases": "try engines and cullers on the hard numerical cases",
    "fuzz": "search for scenes and views in which a culler fails",
    "doctor": "say what works on this machine",
    "warm": "compile ahead what runs need",
    "completion": "let the shell complete visref's commands and options",
}

# These write reports for CI servers (`visref.cli.reports`), of whatever ends them.
TELLING = ("run", "check", "merge")

# All that these do is print: where a full disk takes it, they have failed.
PRINTING = ("objects", "cullers", "scenes", "doctor", "completion")


def main(
    arguments: Sequence[str] | None = None, *, ready: Callable[[], object] = lambda: None
) -> int:
    """Run one command; returns its exit status (see `visref.judging.status.Exit`). `ready` is
    called once the command's modules are imported, before it does anything."""
    if arguments is None:
        prepare()
        arguments = sys.argv[1:]
    if "_ARGCOMPLETE" in os.environ:
        from visref.cli.completion import complete

        return complete(_parser)
    given = argparse.Namespace(asked=_asked(arguments), interrupted="nothing was written")
    given.in_process = False
    try:
        parser = _parser(given.asked)
    except InputError as error:
        return _said(f"error: {error}", Exit.BAD_INPUT)
    except (SystemExit, Exception):  # a library's too, as it was imported
        return _broke_down(given, arguments)
    # This leaves by SystemExit for help and for a wrong argument; nothing else may.
    try:
        parser.parse_args(arguments, given)
    except WrongArguments as wrong:
        _tell(given, wrong.line, Exit.BAD_INPUT, arguments)
        raise
    ready()
    if given.in_process:
        from visref.cli.supervised import supervised

        return supervised(lambda: _run(given), lambda line, status: _ended(given, line, status))
    return _run(given)


def _run(given: argparse.Namespace) -> int:
    MANNERS.take(given)
    with watched_by(step_shown):
        return _ran(given)


def _ran(given: argparse.Namespace) -> int:
    try:
        if given.asked not in TELLING:
            status = int(given.command(given))
            lost = given.asked in PRINTING and not OUT.whole
            return int(Exit.BAD_INPUT) if lost and status == Exit.NO_VIOLATION else status
        from visref.cli.reports import check_reports, write_reports

        check_reports(given)
        status = int(given.command(given))
        write_reports(given)
        return status
    except InputError as error:
        return _ended(given, f"error: {error}", Exit.BAD_INPUT)
    except NothingToJudge as error:
        return _ended(given, f"nothing could be judged: {error}", Exit.NOTHING_JUDGED)
    except Unfinished as error:
        return _ended(given, f"error: {error}", BROKE_DOWN)
    except KeyboardInterrupt:
        return _ended(given, f"interrupted; {given.interrupted}", INTERRUPTED)
    except OSError as error:
        # A full disk, say: nobody's bug.
        return _ended(given, f"error: {error}", Exit.BAD_INPUT)
    except BaseException:
        return _broke_down(given)


def _said(line: str, status: int) -> int:
    ERRORS.line(line, colour=RED, of="error:")
    return int(status)


def _ended(given: argparse.Namespace, line: str, status: int) -> int:
    """Say why there is no verdict, to the CI server too; returns the status."""
    ERRORS.line(line, colour=RED, of="error:")
    _tell(given, line, status)
    return int(status)


def _broke_down(given: argparse.Namespace, arguments: Sequence[str] | None = None) -> int:
    """`broke_down`, to the CI server too: the error in hand, in a line."""
    error = sys.exception()
    status = broke_down()
    name = type(error).__name__
    line = " ".join(f"visref broke down, this is a bug in it: {name}: {error}".split())
    _tell(given, line, status, arguments)
    return status


def _tell(
    given: argparse.Namespace, line: str, status: int, arguments: Sequence[str] | None = None
) -> None:
    """Write the reports of a command that came to no verdict. `arguments`: its own, where they were
    not parsed. Whatever goes wrong here, the status stays."""
    if given.asked not in TELLING:
        return
    try:
        from visref.cli.reports import arguments_alone, report_failure

        where = given if arguments is None else arguments_alone(arguments)
        report_failure(given.asked, where, line, status)
    except BaseException as error:  # what was imported for it may be what broke down
        ERRORS.line(f"no report was written: {type(error).__name__}: {error}")


def _asked(arguments: Sequence[str]) -> str | None:
    """The name of the command that is asked for."""
    return next((argument for argument in arguments if not argument.startswith("-")), None)


def _parser(asked: str | None) -> argparse.ArgumentParser:
    """A parser that knows every command by name, and the arguments of the one that is asked for."""
    parser = Parser(
        prog="visref",
        description="Is your occlusion culler safe, and what does it cost?",
        epilog="Exit status: 0 no violation found, 1 violation, 2 bad input, 3 nothing judged.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show it, and end")
    add_manners(parser)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, about in COMMANDS.items():
        command = commands.add_parser(name, help=about)
        if name == asked:
            module = importlib.import_module(f"visref.cli.{name}")
            module.add_arguments(command)
            add_manners(command)
            command.set_defaults(command=module.run)
    return parser


class _Version(argparse.Action):
    """Looks the version up where it is asked for alone."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        import visref

        OUT.line(f"visref {visref.__version__}")
        parser.exit()
