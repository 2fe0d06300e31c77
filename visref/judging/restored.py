"""What a plug-in in the judge's own process may leave changed behind it, put back."""

from __future__ import annotations

import gc
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np


@contextmanager
def settings_restored() -> Iterator[None]:
    """Call a plug-in within this: numpy's error handling, the warning filters, the working folder,
    the recursion limit and whether garbage is collected are afterwards as they were."""
    try:
        folder = os.getcwd()
    except FileNotFoundError:  # somebody removed it
        folder = ""
    limit, collects = sys.getrecursionlimit(), gc.isenabled()
    try:
        with np.errstate(), warnings.catch_warnings():
            yield
    finally:
        if sys.getrecursionlimit() != limit:
            sys.setrecursionlimit(limit)
        if gc.isenabled() != collects:
            (gc.enable if collects else gc.disable)()
        with suppress(OSError):
            if folder and os.getcwd() != folder:
                os.chdir(folder)
