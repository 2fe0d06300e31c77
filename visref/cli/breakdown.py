"""What a run says that came to no end, and its statuses, which are clear of every verdict's."""

from __future__ import annotations

import sys
import traceback
from contextlib import suppress

# By convention: 128 + SIGINT, and the EX_SOFTWARE of sysexits.h.
INTERRUPTED = 130
BROKE_DOWN = 70


def broke_down() -> int:
    """Say so of the error in hand, and that it is no verdict; returns the status for it."""
    text = traceback.format_exc()
    try:
        from visref.cli.terminal import ERRORS

        # A name in the traceback is shown, and never obeyed.
        ERRORS.lines(text)
    except BaseException:  # what prints may be what failed
        with suppress(BaseException):
            sys.stderr.write(text)
    return said("visref broke down: this is a bug in it, not a verdict", BROKE_DOWN)


def said(line: str, status: int) -> int:
    """The status, once the line is on standard error, if that is still there."""
    with suppress(BaseException):
        print(line, file=sys.stderr)
    return status
