"""The jobs of a batch, each a command of its own, so many at a time."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from visref.batch.plan import Job
from visref.files import FolderKind

# A batch's folder:
#
#     batch.json, batch.md, index.html   what came of it, for programs, for CI servers, for readers
#     runs/NAME/                         run folders
#     pages/NAME/                        their reports
#     stamps/NAME.json                   by which command a run folder was left
#     logs/NAME.txt                      what that command said
RECORD, MARKDOWN, PAGE = "batch.json", "batch.md", "index.html"
RUNS, PAGES, STAMPS, LOGS = "runs", "pages", "stamps", "logs"
FORMAT = "visref-batch"

# A process that ends with this one; then the command line as it is.
_START = (
    "import sys; from visref.forked import end_with; end_with(int(sys.argv.pop(1))); "
    "from visref.cli.entry import main; sys.exit(main())"
)
_LAST_WORDS_BYTES = 1 << 14
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def _wrote(record: Any) -> Sequence[str] | None:
    ours = isinstance(record, dict) and record.get("format") == FORMAT
    return [] if ours else None


BATCH_FOLDER = FolderKind(RECORD, _wrote)


@dataclass(frozen=True)
class Run:
    """How all jobs of a batch are run: paths in them start from the folder `at`, and `out` is the
    batch's own. `more`: arguments of `visref run`; `at_once`: so many jobs at a time."""

    at: Path
    out: Path
    more: tuple[str, ...] = ()
    at_once: int = 1

    def folder(self, job: Job) -> Path:
        return self.out / RUNS / job.name

    def page(self, job: Job) -> Path:
        return self.out / PAGES / job.name

    def stamp(self, job: Job) -> Path:
        return self.out / STAMPS / f"{job.name}.json"

    def log(self, job: Job) -> Path:
        return self.out / LOGS / f"{job.name}.txt"


@dataclass(frozen=True)
class Ended:
    """A job that has ended: its exit status (128 + n after signal n), and where it came to no
    verdict the last line that it said."""

    job: Job
    status: int
    error: str = ""


def run_jobs(jobs: Sequence[Job], run: Run, on_ended: Callable[[Ended], None]) -> list[Ended]:
    """Run all jobs; what came of each, in their order. A job whose run folder stands as the same
    command left it judges nothing again. KeyboardInterrupt reaches the jobs, too."""
    for name in (RUNS, PAGES, STAMPS, LOGS):
        (run.out / name).mkdir(parents=True, exist_ok=True)
    found: dict[str, Ended] = {}
    children = _Children()
    with ThreadPoolExecutor(run.at_once) as pool:
        work = [pool.submit(_one, job, run, children) for job in jobs]
        try:
            for done in as_completed(work):
                ended = done.result()
                found[ended.job.name] = ended
                on_ended(ended)
        except BaseException:
            for one in work:
                one.cancel()
            children.interrupt()
            raise
    return [found[job.name] for job in jobs]


def worst(statuses: Sequence[int]) -> int:
    """The status of a batch: a fault before bad input before a violation before nothing judged."""
    if any(status >= 70 for status in statuses):
        return 70
    return next((status for status in (2, 1, 3) if status in statuses), 0)


class _Children:
    """The processes that are at work."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[bytes]] = set()
        self._lock = threading.Lock()
        self._over = False

    def run(self, arguments: Sequence[str], at: Path, log: Any) -> int:
        """The exit status of a command."""
        with self._lock:
            if self._over:
                return 128 + signal.SIGINT
            child = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, str(os.getpid()), *arguments],
                cwd=at, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                # Ctrl-C is for this process, which tells them.
                start_new_session=True,
            )  # fmt: skip
            self._running.add(child)
        status = child.wait()
        with self._lock:
            self._running.discard(child)
        return status if status >= 0 else 128 - status

    def interrupt(self) -> None:
        """They end, and keep what they have; no other begins."""
        with self._lock:
            self._over = True
            for child in self._running:
                with suppress(ProcessLookupError):
                    child.send_signal(signal.SIGINT)


def _one(job: Job, run: Run, children: _Children) -> Ended:
    folder, stamp, log = run.folder(job), run.stamp(job), run.log(job)
    with log.open("wb") as opened:
        status = children.run(
            [
                "run", f"--out={folder}", f"--stamp={stamp}", *run.more, "--no-summary",
                "--no-annotate", *job.arguments,
            ],
            run.at, opened,
        )  # fmt: skip
        if status == 3 and stamp.exists():
            pass  # a verdict that says nothing: it is on disk
        elif status not in (0, 1):
            return Ended(job, status, _last_line(log))
        page = run.page(job)
        if not (page / "report.html").exists() or _older(page / "report.html", stamp):
            made = children.run(["report", f"--out={page}", "--", str(folder)], run.at, opened)
            if made not in (0, 1, 3):
                return Ended(job, made, f"its report was not made: {_last_line(log)}")
    return Ended(job, status)


def _older(file: Path, other: Path) -> bool:
    return file.stat().st_mtime_ns < other.stat().st_mtime_ns


def _last_line(log: Path) -> str:
    with log.open("rb") as opened:
        opened.seek(max(0, log.stat().st_size - _LAST_WORDS_BYTES))
        text = opened.read().decode("utf-8", "replace")
    lines = [line for line in map(str.strip, _lines(text)) if line]
    return lines[-1] if lines else "it said nothing"


def _lines(text: str) -> Iterator[str]:
    yield from _ESCAPES.sub("", text).splitlines()
