"""Where commands print: standard output, standard error and progress over frames."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from visref.judging.referee import Job, JudgedFrame
    from visref.visibility import FrameTruth, ObjectVisibility


class _Out(Console):
    """Standard output. Who stops reading (`| head`) misses the rest and changes no status."""

    def on_broken_pipe(self) -> None:
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


# Names and specs are printed as they are: `:b:` in one is no emoji.
ERRORS = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)
# A table in a log or a pipe is not folded to a terminal that is not there.
OUT = _Out(highlight=False, soft_wrap=True, emoji=False, width=None if sys.stdout.isatty() else 200)


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
    """Progress over what the papers' tables need."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._bar = progress.add_task("measuring", total=None)

    def begin(self, steps: int) -> None:
        self._progress.update(self._bar, total=steps)

    def task(self, label: str) -> None:
        self._progress.update(self._bar, description=label)

    def advance(self, steps: float) -> None:
        self._progress.advance(self._bar, steps)


def progress() -> Progress:
    """A progress display, gone once it is done."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=ERRORS,
        transient=True,
        disable=not sys.stderr.isatty(),
    )


@contextmanager
def frame_bar(frames: int | None) -> Iterator[Bar]:
    """A bar over so many frames (None: nobody knows how many)."""
    with progress() as shown:
        yield Bar(shown, frames)
