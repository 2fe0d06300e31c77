"""What a judging command leaves for a CI server: JUnit XML, a summary in Markdown, annotations.

Each is made from the run folder by `visref.report`, as `visref report` makes it, and is written
too where there is none: a command that came to no verdict says so in them in the one line that it
prints. GitHub Actions gets summary and annotations without being asked. A file takes its place in
one step, and is refused before anything is judged.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from visref.beside import steady
from visref.cli.breakdown import BROKE_DOWN, INTERRUPTED
from visref.cli.manners import MANNERS
from visref.cli.terminal import ERRORS, OUT
from visref.errors import InputError
from visref.files import check_replacing, refuse_inputs, replacing_file
from visref.judging.status import Exit

# What GitHub shows of a step's summary; of a longer one it shows nothing.
STEP_SUMMARY_BYTES = 1 << 20
_CUT = b"\n\n*GitHub shows a mebibyte of a step: the rest is left out.*\n"

# The commands' arguments that name files, which no report may replace.
_INPUTS = ("scene", "path", "recording", "visible", "truth", "policy")
_OUTPUTS = ("out", "write_waivers")

_KINDS = {
    Exit.BAD_INPUT: "bad-input",
    Exit.NOTHING_JUDGED: "nothing-judged",
    BROKE_DOWN: "fault",
    INTERRUPTED: "interrupted",
}


def add_report_arguments(parser: argparse.ArgumentParser) -> None:
    """--junit, --summary and --annotate; `visref.cli.main` reads them, for `TELLING` commands."""
    parser.add_argument(
        "--junit", type=Path, metavar="FILE", help="write the result as JUnit XML, whatever it is"
    )
    summary = parser.add_mutually_exclusive_group()
    summary.add_argument(
        "--summary",
        type=Path,
        metavar="FILE",
        help="write it in Markdown (default on GitHub Actions: added to the job's summary)",
    )
    summary.add_argument(
        "--no-summary", action="store_true", help="add nothing to the job's summary"
    )
    parser.add_argument(
        "--annotate",
        action=argparse.BooleanOptionalAction,
        help="print errors and warnings as GitHub Actions' annotations (default: only there)",
    )


@dataclass(frozen=True)
class Wanted:
    """Where the reports go: `junit` and `summary` to files, `step` is the file that GitHub keeps
    for a step's summary, and `annotate` is to standard output."""

    junit: Path | None
    summary: Path | None
    step: Path | None
    annotate: bool

    @property
    def nothing(self) -> bool:
        return not (self.junit or self.summary or self.step or self.annotate)


def wanted_of(given: argparse.Namespace, environment: Mapping[str, str] | None = None) -> Wanted:
    """What the arguments ask for, and else the environment (of the process, by default)."""
    environment = os.environ if environment is None else environment
    on_github = environment.get("GITHUB_ACTIONS") == "true"
    named = environment.get("GITHUB_STEP_SUMMARY", "")
    step = Path(named) if on_github and named and not given.no_summary else None
    summary: Path | None = given.summary
    if summary is not None and step is not None and _same(summary, step):
        # It holds what others wrote, and GitHub waits for more.
        summary = None
    elif summary is not None:
        step = None
    annotate = on_github if given.annotate is None else bool(given.annotate)
    return Wanted(given.junit, summary, step, annotate)


def check_reports(given: argparse.Namespace) -> None:
    """Raises InputError where a report cannot be written, or would replace an input, another output
    or what is no report."""
    for error in _refused(given, wanted_of(given)).values():
        raise error


def write_reports(given: argparse.Namespace) -> None:
    """Write what is wanted of the run in `--out`. Raises InputError and OSError."""
    wanted = wanted_of(given)
    if wanted.nothing:
        return
    from visref.report.annotations import annotation_lines, annotations_of
    from visref.report.junit import BEGINS, junit_xml
    from visref.report.markdown import TITLE, markdown_summary
    from visref.run_folder.read import read_run

    run, here = steady(given.out, read_run), Path()
    if wanted.junit is not None:
        _replace(wanted.junit, junit_xml([run], here), BEGINS)
    if wanted.summary is not None or wanted.step is not None:
        text = markdown_summary([run], [], here)
        if wanted.summary is not None:
            _replace(wanted.summary, text, TITLE.encode())
        if wanted.step is not None:
            _add_to_step(wanted.step, text)
    if wanted.annotate:
        # GitHub reads both streams, and a program reads one.
        (ERRORS if MANNERS.json else OUT).commands(annotation_lines(annotations_of(run, here)))


def report_failure(name: str, given: argparse.Namespace, line: str, status: int) -> None:
    """Write of a command, by its name, that it came to no verdict: the line that it said, and its
    status. A report that cannot be written costs the others nothing, and the status stays."""
    wanted = wanted_of(given)
    if wanted.nothing:
        return
    from visref.report.annotations import annotation_lines, annotations_of_failure
    from visref.report.junit import BEGINS, junit_of_failure
    from visref.report.markdown import TITLE, markdown_of_failure

    kind = _KINDS.get(status, "ended")
    summary = markdown_of_failure(name, line)
    refused = _refused(given, wanted)
    for file, text, begins in (
        (wanted.junit, junit_of_failure(f"visref {name}", kind, line), BEGINS),
        (wanted.summary, summary, TITLE.encode()),
    ):
        if file is None:
            continue
        try:
            if file in refused:
                raise refused[file]
            _replace(file, text, begins)
        except (InputError, OSError) as error:
            # Of the report that is refused, the line may tell already.
            if str(error) not in line:
                ERRORS.line(f"error: {error}")
    if wanted.step is not None:
        _add_to_step(wanted.step, summary)
    if wanted.annotate:
        OUT.commands(annotation_lines(annotations_of_failure(name, line)))


def arguments_alone(arguments: Sequence[str]) -> argparse.Namespace:
    """The reports' arguments out of a command line that is not understood, as far as they are."""
    parser = _Quiet(add_help=False)
    add_report_arguments(parser)
    parser.add_argument("--out", type=Path)
    try:
        return parser.parse_known_args(arguments)[0]
    except ValueError:
        return parser.parse_args([])


class _Quiet(argparse.ArgumentParser):
    """A parser that raises ValueError, and prints nothing."""

    def error(self, message: str) -> NoReturn:
        raise ValueError(message)


def _refused(given: argparse.Namespace, wanted: Wanted) -> dict[Path, InputError]:
    """The files among the reports that are not to be written, and why."""
    from visref.report.junit import BEGINS
    from visref.report.markdown import TITLE

    inputs = [getattr(given, name, None) for name in _INPUTS] + getattr(given, "parts", [])
    outputs = [getattr(given, name, None) for name in _OUTPUTS]
    refused: dict[Path, InputError] = {}
    for file, begins in ((wanted.junit, BEGINS), (wanted.summary, TITLE.encode())):
        if file is None:
            continue
        try:
            refuse_inputs(file, inputs)
            for other in outputs:
                if other is not None and _overlap(file, other):
                    raise InputError(
                        f"cannot write here: this command writes {str(other)!r}, too",
                        source=str(file),
                        fix="name a file outside it",
                    )
            if wanted.junit and wanted.summary and _same(wanted.junit, wanted.summary):
                raise InputError("--junit and --summary are the same file", fix="name two")
            check_replacing(file, begins=begins)
        except InputError as error:
            refused[file] = error
    return refused


def _same(one: Path, other: Path) -> bool:
    return os.path.realpath(one) == os.path.realpath(other)


def _overlap(one: Path, other: Path) -> bool:
    """Whether one is the other, or lies in it."""
    first, second = Path(os.path.realpath(one)), Path(os.path.realpath(other))
    return first.is_relative_to(second) or second.is_relative_to(first)


def _replace(file: Path, text: str, begins: bytes) -> None:
    with replacing_file(file, begins=begins) as beside:
        beside.write_text(text, encoding="utf-8")


def _add_to_step(step: Path, text: str) -> None:
    """Add a summary to the step's, whole or not at all. GitHub's file is nobody's request: where it
    cannot be written to, a line says so, and the status stays."""
    try:
        opened = os.open(step, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            before = os.fstat(opened).st_size
            added = _fitting(("\n" if before else "") + text, STEP_SUMMARY_BYTES - before)
            try:
                # The system may take a part of it.
                while added:
                    added = added[os.write(opened, added) :]
            except OSError:
                os.ftruncate(opened, before)
                raise
        finally:
            os.close(opened)
    except OSError as error:
        ERRORS.line(f"the job's summary was not written: {error}")


def _fitting(text: str, most: int) -> bytes:
    """The text in UTF-8, cut at the end of a line where it takes more bytes than there are."""
    data = text.encode("utf-8")
    if len(data) <= most:
        return data
    kept = data[: max(0, most - len(_CUT))].rpartition(b"\n")[0]
    return kept + _CUT if kept.strip() else b""
