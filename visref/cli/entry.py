"""Where the program starts, with next to nothing imported yet: statuses that hold whatever fails.

Python's own status for an error is 1, which would say "violation"; this is the one place that
stands between such an error and the caller, while visref itself is imported too.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable

from visref.cli.breakdown import INTERRUPTED, broke_down, said


def main() -> int:
    """Run the command line of this process; returns its exit status."""
    # While modules are imported, and after the last word, an interrupt just ends the process:
    # nothing is half done there, and what imports something may swallow an exception.
    told = signal.getsignal(signal.SIGINT)
    if told is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        return _main(lambda: signal.signal(signal.SIGINT, told))
    finally:
        if told is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


def _main(ready: Callable[[], object]) -> int:
    imported = False
    # What is imported stays: garbage is looked for elsewhere alone, here and in copies of this
    # process. While modules are imported that would be a tenth of the time.
    gc.disable()

    def all_imported() -> None:
        gc.freeze()
        gc.enable()
        ready()

    try:
        from visref.cli.main import main as run

        imported = True
        status = run(ready=all_imported)
    except KeyboardInterrupt:
        return said("interrupted; nothing was written", INTERRUPTED)
    except SystemExit:
        if not imported:
            return broke_down()
        _flush()  # argparse's: help, or a wrong argument
        raise
    except BaseException:
        return broke_down()
    _flush()
    return status


def _flush() -> None:
    """What is still to print, now: a reader that has gone costs no status at the very end."""
    for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
        try:
            stream.flush()
        except (OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
