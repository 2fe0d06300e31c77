"""A program of somebody else's, run to its end, and never waited for without end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from visref.culler import CullerError
from visref.plug_ins import starter
from visref.plug_ins.printed import SECONDS_TO_DIE, Printed, Said, signal_name
from visref.plug_ins.wire import Deadline


def run_program(
    words: Sequence[str],
    *,
    environment: Mapping[str, str],
    time_limit_s: float | None,
    memory_limit: int | None = None,
    say: Said | None = None,
    tidy: Callable[[str], str] = lambda text: text,
) -> None:
    """Run a program (its file, then its arguments) in the current folder until it ends, and end
    whatever it has started and left.

    `environment`: what its own adds to ours; `time_limit_s` None: no limit; `memory_limit`: bytes
    for the memory of each process and for each file that it writes; `say` is given each line that
    it prints. Raises CullerError, which says in one line how it failed: with a status, by a signal,
    by taking too long or by not starting at all; its last line on standard error, which `tidy` may
    change, is part of that.
    """
    reading, writing = os.pipe()
    try:
        # -I -S: what it imports is Python's own, whatever lies in the current folder.
        process = subprocess.Popen(
            [
                *(sys.executable, "-I", "-S", str(Path(starter.__file__))),
                *(str(writing), str(memory_limit or 0), *words),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            pass_fds=[writing],
            env={**os.environ, **environment},
            # Ctrl-C is for the judge, which ends it.
            start_new_session=True,
        )
    except BaseException:
        os.close(reading)
        raise
    finally:
        os.close(writing)
    assert process.stdout is not None
    assert process.stderr is not None
    printed = [Printed(process.stdout, say), Printed(process.stderr, say)]
    try:
        report = _first_line(reading, time_limit_s)
    finally:
        os.close(reading)
        _end(process)
        for one in printed:
            one.finish()
    last = tidy(printed[1].last)
    fault = _fault(report, time_limit_s)
    if fault:
        raise CullerError(f"{fault}; its last words: {last}" if last else fault)


def _first_line(file: int, time_limit_s: float | None) -> str | None:
    """What comes to a pipe's end until the first line's; None where none comes in time."""
    deadline = Deadline(time_limit_s)
    data = b""
    while not data.endswith(b"\n"):
        if not deadline.comes(file):
            return None
        part = os.read(file, 64)
        if not part:
            break
        data += part
    return data.decode().strip()


def _fault(report: str | None, time_limit_s: float | None) -> str:
    if report is None:
        return f"it took longer than {time_limit_s:g} s (--time-limit)"
    number = int(report[1:]) if report else 0
    if report.startswith("E"):
        return f"it could not be started: {os.strerror(number)}"
    if not report.startswith("S"):
        return "it ended the process that started it"
    if number < 0:
        return f"it was killed by {signal_name(-number)}"
    return f"it ended with status {number}" if number else ""


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the starter, which first ends all that is below it."""
    process.terminate()
    try:
        process.wait(SECONDS_TO_DIE)
    except subprocess.TimeoutExpired:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.wait()
