"""Work in copies of this process, which share what it holds until they write to it.

A copy tells of its progress, and of how it ended, over a pipe. Where one fails, the others end too.
"""

from __future__ import annotations

import ctypes
import json
import os
import selectors
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from visref.errors import error_json, raise_told

Tell = Callable[[Any], None]
Work = Callable[[Tell], None]

_BLOCK = 1 << 16


class Copies:
    """Pieces of work, each in a process of its own: `wait` for them. To be made by `at_work`."""

    def __init__(self) -> None:
        self._pids: dict[int, int] = {}
        self._said: dict[int, bytes] = {}

    def start(self, work: Work) -> None:
        reading, writing = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        parent = os.getpid()
        child = os.fork()
        if child == 0:
            end_with(parent)
            os.close(reading)
            for other in self._pids:
                os.close(other)
            _run(work, writing)
        os.close(writing)
        self._pids[reading] = child
        self._said[reading] = b""

    def wait(self, on_told: Callable[[Any], None]) -> None:
        """Until all have ended well; `on_told` is given what they tell. Raises what the first one
        that failed raised: InputError, NothingToJudge, or RuntimeError for all else."""
        with selectors.DefaultSelector() as selector:
            for reading in self._pids:
                selector.register(reading, selectors.EVENT_READ)
            while self._pids:
                for key, _ in selector.select():
                    reading = key.fd
                    part = os.read(reading, _BLOCK)
                    *lines, self._said[reading] = (self._said[reading] + part).split(b"\n")
                    ended = False
                    for line in lines:
                        ended |= _understood(json.loads(line), on_told)
                    if ended or not part:
                        selector.unregister(reading)
                        self._ended(reading, well=ended)

    def _ended(self, reading: int, *, well: bool) -> None:
        os.close(reading)
        _, status = os.waitpid(self._pids.pop(reading), 0)
        if not well:
            code = os.waitstatus_to_exitcode(status)
            how = f"by signal {-code}" if code < 0 else f"with status {code}"
            raise RuntimeError(f"a worker ended {how} before its part was judged")

    def end(self) -> None:
        """End those that are still at work."""
        for reading, pid in self._pids.items():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            os.close(reading)
            os.waitpid(pid, 0)
        self._pids = {}


@contextmanager
def at_work(pieces: Sequence[Work]) -> Iterator[Copies]:
    """Start the pieces; none is left at work when the block ends."""
    copies = Copies()
    try:
        for work in pieces:
            copies.start(work)
        yield copies
    finally:
        copies.end()


def _understood(said: dict[str, Any], on_told: Callable[[Any], None]) -> bool:
    """Take in what a copy said; whether it has ended well."""
    if "told" in said:
        on_told(said["told"])
    raise_told(said)
    return "ended" in said


def end_with(parent: int) -> None:
    """End this process when its parent ends, however that does, where the system can."""
    if sys.platform == "linux":
        PR_SET_PDEATHSIG = 1
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(1)


def _run(work: Work, writing: int) -> None:
    """The whole life of a copy."""
    status = 1
    try:
        with os.fdopen(writing, "wb", buffering=0) as pipe:

            def say(what: dict[str, Any]) -> None:
                pipe.write(json.dumps(what).encode() + b"\n")

            try:
                work(lambda told: say({"told": told}))
                say({"ended": True})
                status = 0
            except KeyboardInterrupt:
                pass  # whoever started it is told too
            except BaseException as error:  # the parent's to tell
                say(error_json(error))
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:  # the parent is gone, say
        pass
    finally:
        # Exit handlers are those of the process that this is a copy of.
        os._exit(status)
