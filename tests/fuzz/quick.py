"""What makes a case quick and changes nothing of what is read: the installed packages are looked
through once, and readers that work in a process of their own get one that is forked, with the same
limits and the same answers, instead of a new interpreter.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, BinaryIO
from unittest import mock

from visref.formats import in_a_child

# What those readers import; a fork has it already.
_THEIRS = (
    "collada", "lxml.etree", "networkx", "trimesh", "visref.formats.collada",
    "visref.formats.through_trimesh",
)  # fmt: skip


class Forked:
    """As much of `subprocess.Popen` as `visref.formats.in_a_child` uses, of its own command."""

    def __init__(self, line: list[str], **ways: Any) -> None:
        del ways
        _, *asked = json.loads(line[-1])
        reading, writing = os.pipe()
        self._status: int | None = None
        self._process = os.fork()
        if self._process == 0:
            try:
                os.dup2(writing, 1)
                in_a_child.answer(*asked)
            finally:
                os._exit(1)
        os.close(writing)
        self.stdout: BinaryIO = os.fdopen(reading, "rb")

    def kill(self) -> None:
        if self._status is None:
            os.kill(self._process, signal.SIGKILL)

    def wait(self) -> int:
        if self._status is None:
            _, status = os.waitpid(self._process, 0)
            self._status = os.waitstatus_to_exitcode(status)
        return self._status


@cache
def _import_theirs() -> None:
    for name in _THEIRS:
        importlib.import_module(name)


@contextmanager
def quick() -> Iterator[None]:
    """In it, visref reads as it does elsewhere, sooner."""
    _import_theirs()
    spied = mock.Mock(wraps=in_a_child.subprocess)
    with mock.patch.object(in_a_child, "subprocess", spied) as own:
        own.Popen = Forked
        yield
