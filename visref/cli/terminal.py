"""Where commands print: standard output, standard error and progress over frames.

Everything goes through here. Lines are made of what `visref.wording.shown` leaves: no name in a
scene moves the cursor, hides text or speaks to a CI server. And printing costs no verdict: an
encoding that lacks a character gets another, and who cannot be written to misses the rest.
"""

from __future__ import annotations

import argparse
import codecs
import io
import json
import logging
import os
import re
import sys
import time
import unicodedata
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from itertools import islice
from typing import IO, TYPE_CHECKING, Any, NoReturn, Self, cast

from visref.cli.manners import MANNERS, coloured
from visref.wording import shown

if TYPE_CHECKING:
    from rich.progress import Progress

    from visref.doing import Reach
    from visref.judging.asking import Job
    from visref.judging.referee import JudgedFrame
    from visref.visibility import FrameTruth, ObjectVisibility

# For terminals whose encoding lacks them; anything else becomes an escape.
_READABLE = {
    "✓": "ok", "✕": "x", "–": "-", "—": "-", "…": "...", "‘": "'", "’": "'", "“": '"',
    "”": '"', "×": "x", "≥": ">=", "≤": "<=", "→": "->", "·": "-", "µ": "u", "²": "^2",
}  # fmt: skip
_BACKSLASH = codecs.lookup_error("backslashreplace")
# Rows that are written at a time.
_CHUNK = 4096


def _readable(error: UnicodeError) -> tuple[str | bytes, int]:
    if isinstance(error, UnicodeEncodeError):
        other = _READABLE.get(error.object[error.start])
        if other is not None:
            return other, error.start + 1
        one = UnicodeEncodeError(
            error.encoding, error.object, error.start, error.start + 1, error.reason
        )
        return _BACKSLASH(one)
    raise error


codecs.register_error("visref-readable", _readable)


class Printer:
    """One of the two standard streams."""

    def __init__(self, name: str) -> None:
        self._name = name
        # The stream that nobody reads any more, and the one that could not be written to.
        self._deaf: IO[str] | None = None
        self._broken: IO[str] | None = None

    @property
    def whole(self) -> bool:
        """Whether all was printed that somebody wanted to read: no disk was full, say."""
        return self._broken is None or self._broken is not getattr(sys, self._name)

    def line(self, text: str = "", *, colour: str | None = None, of: str = "") -> None:
        """One line, whatever is in the text; on a terminal its beginning `of` has a colour."""
        self._write(f"{self._painted(shown(text), shown(of), colour)}\n")

    def remark(self, text: str = "") -> None:
        """A line that is only good to know: not for programs, nor for who wants quiet."""
        if MANNERS.remarks:
            self.line(text)

    def lines(self, text: str) -> None:
        """Text of several lines, which are ours to break."""
        self._write("".join(f"{shown(line)}\n" for line in text.removesuffix("\n").split("\n")))

    def commands(self, lines: Iterable[str]) -> None:
        """Lines that a CI server is to obey, each one made for it (`visref.report.annotations`)."""
        self._write("".join(f"{line}\n" for line in lines))

    def table(
        self,
        headings: Sequence[str],
        rows: Iterable[Sequence[str]],
        *,
        left: Sequence[str] = (),
        colours: Sequence[str | None] = (),
    ) -> None:
        """A table in columns: those that `left` names are aligned to the left, others to the
        right. `colours`: of each row's last cell, on a terminal."""
        cells = [list(map(shown, row)) for row in (headings, *rows)]
        widths = [max(map(_width, column)) for column in zip(*cells, strict=True)]
        to_left = [heading in left for heading in headings]
        if not any(colours) or not self._coloured:
            self.columns(cells, widths, left=to_left)
            return
        for row, colour in zip(cells, (None, *colours), strict=True):
            line = _aligned(row, widths, to_left).removesuffix("\n")
            if row[-1] and line.endswith(row[-1]):
                line = line.removesuffix(row[-1]) + self._painted(row[-1], row[-1], colour)
            self._write(f"{line}\n")

    def columns(
        self, rows: Iterable[Sequence[str]], widths: Sequence[int], *, left: Sequence[bool]
    ) -> None:
        """Rows of a table as they come, in columns of given widths; the last one's may be 0."""
        lines = (_aligned(row, widths, left) for row in rows)
        while chunk := list(islice(lines, _CHUNK)):
            if not self._write("".join(chunk)):
                return

    def json(self, value: Any) -> None:
        """A value for programs: exact, in ASCII."""
        self._write(f"{_ascii(json.dumps(value, indent=2))}\n")

    def json_rows(self, rows: Iterable[Any]) -> None:
        """A JSON array, an element on each line, as they come."""
        between, texts = "[\n", iter(rows)
        while chunk := [_ascii(json.dumps(row)) for row in islice(texts, _CHUNK)]:
            if not self._write(between + ",\n".join(chunk)):
                return
            between = ",\n"
        self._write("\n]\n" if between != "[\n" else "[]\n")

    @property
    def _coloured(self) -> bool:
        stream = getattr(sys, self._name)
        with suppress(OSError, ValueError, AttributeError):
            return coloured(bool(stream.isatty()))
        return False

    def _painted(self, text: str, part: str, colour: str | None) -> str:
        """The text, whose beginning has a colour where colours are shown."""
        if colour is None or not part or not text.startswith(part) or not self._coloured:
            return text
        return f"\x1b[1;{colour}m{part}\x1b[0m{text[len(part) :]}"

    def _write(self, text: str) -> bool:
        """Whether somebody reads on."""
        stream: IO[str] | None = getattr(sys, self._name)
        if stream is None or stream is self._deaf:
            return False
        encoding = getattr(stream, "encoding", None) or "utf-8"
        try:
            stream.write(text.encode(encoding, "visref-readable").decode(encoding))
            stream.flush()
        except (OSError, ValueError) as error:
            self._deaf = stream
            self._let_go(stream)
            if not isinstance(error, BrokenPipeError):
                self._broken = stream
                if self is not ERRORS:
                    ERRORS.line(f"standard output: {error}")
            return False
        return True

    @staticmethod
    def _let_go(stream: IO[str]) -> None:
        """What the stream still holds goes nowhere; Python would try again at its end, and end
        with a status of its own."""
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)


def _ascii(text: str) -> str:
    """The same JSON without a command of a CI server in it."""
    return re.sub("#(?=#)", r"\\u0023", text)


def _width(text: str) -> int:
    """The columns of a terminal that a text takes."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1
        for c in text
    )


def _aligned(row: Sequence[str], widths: Sequence[int], left: Sequence[bool]) -> str:
    parts = []
    for text, width, to_left in zip(map(shown, row), widths, left, strict=True):
        space = " " * (width - _width(text))
        parts.append(text + space if to_left else space + text)
    return f"{'  '.join(parts).rstrip(' ')}\n"


OUT = Printer("stdout")
ERRORS = Printer("stderr")


# What Python's names of types mean to people.
_KINDS = {"int": "whole number", "float": "number", "decimal_number": "number"}


class WrongArguments(SystemExit):
    """Argparse's own way out, with the line that was said."""

    def __init__(self, line: str) -> None:
        super().__init__(2)
        self.line = line


class Parser(argparse.ArgumentParser):
    """A parser whose words go the same way: arguments may be names out of a scene."""

    def _print_message(self, message: str, file: Any = None) -> None:
        if message:
            (OUT if file is sys.stdout else ERRORS).lines(message)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """An argument's value; what it should have been is told in words, not as Python has it."""
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError as error:
            name = getattr(action.type, "__name__", "")
            kind = _KINDS.get(name, name.replace("_", " "))
            error.message = error.message.replace(f"invalid {name} value", f"not a {kind}", 1)
            raise

    def error(self, message: str) -> NoReturn:
        """The usage, and one line: a word that nobody asked for may hold line ends."""
        self.print_usage(sys.stderr)
        line = f"{self.prog}: error: {message}"
        ERRORS.line(line)
        raise WrongArguments(line)


def prepare() -> None:
    """Make the process's streams safe, before a file is opened: warnings and logs of libraries
    go through here too."""
    # A file that is opened where a standard stream is closed gets its number, and what libraries
    # print gets into the file.
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    # Else numba has colorama, where that is installed, end colours that nobody began.
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
    warnings.showwarning = _show_warning
    logging.lastResort = _Last(logging.WARNING)


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: Any = None,
    line: str | None = None,
) -> None:
    ERRORS.line(f"{filename}:{lineno}: {category.__name__}: {message}")


class _Last(logging.Handler):
    """The handler of records that nobody else handles."""

    def emit(self, record: logging.LogRecord) -> None:
        ERRORS.line(record.getMessage())


class Bar:
    """Progress over frames, as a run's listener; silent when standard error is no terminal."""

    def __init__(self, progress: Progress, frames: int | None) -> None:
        self._progress = progress
        self._task = progress.add_task("judging", total=frames)

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        pass

    def on_frame_done(self, frame: int) -> None:
        self._progress.advance(self._task)


class Steps:
    """Progress over what the papers' tables need, shown from where it begins to the block's end."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._bar = progress.add_task("measuring", total=None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def begin(self, steps: int) -> None:
        self._progress.update(self._bar, total=steps)
        self._progress.start()

    def task(self, label: str) -> None:
        self._progress.update(self._bar, description=shown(label))

    def advance(self, steps: float) -> None:
        self._progress.advance(self._bar, steps)


# The display that shows just now.
_showing: list[Progress] = []


def progress() -> Progress:
    """A progress display, gone once it is done."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    class Display(Progress):
        def start(self) -> None:
            if not self.disable:
                _showing[:] = [self]
            super().start()

        def stop(self) -> None:
            _showing.clear()
            super().stop()

    return Display(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=Console(file=cast(IO[str], _Careful())),
        transient=True,
        redirect_stdout=False,
        disable=not _shows_progress(),
    )


def _shows_progress() -> bool:
    return not MANNERS.quiet and _Careful().isatty()


@contextmanager
def step_shown(what: str, total: float | None) -> Iterator[Reach]:
    """Shows a step of `visref.doing` while it lasts, on a terminal; with -v, what it took."""
    began = time.monotonic()
    if not _shows_progress():
        yield lambda done: None
    else:
        with nullcontext(_showing[0]) if _showing else progress() as display:
            task = display.add_task(shown(what), total=total)
            try:
                yield lambda done: display.update(task, completed=done)
            finally:
                display.remove_task(task)
    if MANNERS.verbose:
        ERRORS.line(f"{what}: {time.monotonic() - began:.1f} s")


class _Careful(io.TextIOBase):
    """Standard error, for a display that anything may happen to: its terminal may be closed."""

    def __init__(self) -> None:
        # The display stands in for `sys.stderr` while it shows, and writes here.
        self._stream = sys.stderr

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return getattr(self._stream, "encoding", None) or "utf-8"

    def write(self, text: str) -> int:
        with suppress(OSError, ValueError, AttributeError):
            self._stream.write(text.encode(self.encoding, "visref-readable").decode(self.encoding))
        return len(text)

    def flush(self) -> None:
        with suppress(OSError, ValueError, AttributeError):
            self._stream.flush()

    def isatty(self) -> bool:
        with suppress(OSError, ValueError, AttributeError):
            return self._stream.isatty()
        return False


@contextmanager
def frame_bar(frames: int | None) -> Iterator[Bar]:
    """A bar over so many frames (None: nobody knows how many)."""
    with progress() as shown_bar:
        yield Bar(shown_bar, frames)
