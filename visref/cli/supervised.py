"""Work in a copy of this process, whose word counts only if it comes to its end.

A culler of somebody else's that runs in visref's process can end it by `os._exit(0)`, by a signal
or in an exit handler. The status of a run is then what the copy said last, over a pipe, and not
what its process ended with.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable

from visref.cli.breakdown import BROKE_DOWN


def supervised(work: Callable[[], int], lost: Callable[[str, int], int]) -> int:
    """The status that `work` returns; where its process ends before, what `lost` makes of a line
    that says so and of a status that is neither 0 nor 1. `work` runs before any thread is
    started."""
    reading, writing = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _work(work, writing)
    os.close(writing)
    # Ctrl-C reaches the copy too, which says what it means.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        said = b""
        while part := os.read(reading, 16):
            said += part
        _, ended = os.waitpid(child, 0)
    finally:
        signal.signal(signal.SIGINT, before)
        os.close(reading)
    if said:
        return said[0]
    code = os.waitstatus_to_exitcode(ended)
    how = f"by signal {-code}" if code < 0 else f"with status {code}"
    line = f"the process ended {how} before there was a verdict"
    return lost(line, 128 - code if code < 0 else BROKE_DOWN)


def _work(work: Callable[[], int], writing: int) -> None:
    status = BROKE_DOWN
    try:
        status = work()
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
    except BaseException:  # a printer's fault, say; the status is what was returned
        pass
    finally:
        os.write(writing, bytes([status]))
        # Neither threads that never end nor exit handlers come between.
        os._exit(status)
