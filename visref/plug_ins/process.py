"""A culler in a process of its own, asked over a socket and never waited for without end."""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Culler, CullerError, DrawnSet, Promise, Raster, RasterTolerance
from visref.errors import InputError
from visref.plug_ins import answers
from visref.plug_ins.printed import SECONDS_TO_DIE, Printed, Said, signal_name
from visref.plug_ins.shared import share
from visref.plug_ins.wire import BrokenMessage, Deadline, Message, receive, send
from visref.scene import Int32, Scene, Units

# A culler that is freed need not take as long as one that prepares.
_SECONDS_TO_CLOSE = 10.0

# The judge's own way of finding modules: not the current folder, where a `numpy.py` may lie.
_START = """import sys
sys.path[:] = {path!r}
from visref.plug_ins.worker import main
main({end}, {limit})
"""


class CullerApart(Culler):
    """Stands for the culler `spec` in another process, which starts now.

    Every question has `time_limit_s` seconds (None: no limit), and the process `memory_limit` bytes
    of its own. `say` is given each line that it prints. A culler that cannot even be made fails
    when it is prepared, like one that breaks down there; a spec that names nothing is an
    InputError.
    """

    name = "apart"
    timed = False  # its own process measures it

    def __init__(
        self,
        spec: str,
        *,
        time_limit_s: float | None,
        memory_limit: int | None = None,
        say: Said | None = None,
    ) -> None:
        self.spec = spec
        self._begin: Callable[[], _Process] = partial(_Process, time_limit_s, memory_limit, say)
        self._process = self._begin()
        self._make()

    def _make(self) -> None:
        """Have it made in its process."""
        self._declared: dict[str, Any] = {}
        self._unmade: CullerError | None = None
        try:
            self._ask("make", {"spec": self.spec})
        except CullerError as error:
            self._unmade = error
        except BaseException:
            self.end()
            raise

    # The contract.

    @property
    def promise(self) -> Promise:  # type: ignore[override]
        said: Promise = self._declared.get("promise", Promise.CONSERVATIVE)
        return said

    @property
    def joint(self) -> bool:  # type: ignore[override]
        return bool(self._declared.get("joint"))

    @property
    def moves(self) -> bool:
        return bool(self._declared.get("moves"))

    @property
    def memory(self) -> int | None:  # type: ignore[override]
        return self._declared.get("memory")

    @property
    def raster(self) -> Raster | None:  # type: ignore[override]
        said = self._declared.get("raster")
        return None if said is None else _RasterApart(self, said)

    def prepare(self, scene: Scene) -> Units:
        if self._unmade is not None:
            raise self._unmade
        return answers.read_units(self._ask("prepare", value=scene))

    def update(self, scene: Scene) -> None:
        self._ask("update", value=scene)

    def cull(self, camera: Camera) -> DrawnSet:
        return answers.read_drawn(self._ask("cull", cameras=(camera,)))

    def cull_joint(self, cameras: Sequence[Camera]) -> DrawnSet:
        return answers.read_drawn(self._ask("cull_joint", cameras=cameras))

    def bounds(self) -> NDArray[np.float64] | None:
        return answers.read_array(self._ask("bounds"))

    def item_buffer(self, camera: Camera) -> Int32 | None:
        """The picture of its rasteriser."""
        return answers.read_array(self._ask("item_buffer", cameras=(camera,)))

    def close(self) -> None:
        try:
            if self._process.runs and self._unmade is None:
                self._ask("close")
        finally:
            self.end()

    def end(self) -> None:
        """End its process, whatever it does."""
        self._process.end()

    def _ask(
        self,
        ask: str,
        header: dict[str, Any] | None = None,
        *,
        cameras: Sequence[Camera] = (),
        value: object = None,
    ) -> Message:
        """One question and its answer. Raises CullerError for every fault of the culler's."""
        question = {"ask": ask, **(header or {})}
        arrays = {}
        if cameras:
            pickled = pickle.dumps(tuple(cameras), protocol=5)
            arrays["cameras"] = np.frombuffer(pickled, np.uint8)
        shared = [] if value is None else [share(value)]
        try:
            answer = self._process.ask(Message(question, arrays, shared))
        finally:
            for file in shared:
                os.close(file)
        if "fault" in answer.header:
            fault = str(answer.header["fault"])
            raise InputError(fault) if answer.header.get("kind") == "input" else CullerError(fault)
        said = answer.header.get("declared")
        if isinstance(said, dict):
            self._declared = said
        return answer


class CullerKept(CullerApart):
    """One that is asked about scene after scene: its process stays when it is closed, until `end`,
    and what its module keeps stays there."""

    def renewed(self) -> CullerKept:
        """Itself, made anew; in a new process where the last one has ended."""
        if not self._process.runs:
            self._process = self._begin()
        self._make()
        return self

    def close(self) -> None:
        if self._process.runs and self._unmade is None:
            self._ask("close")


class _RasterApart(Raster):
    """The rasteriser of a culler in another process."""

    def __init__(self, culler: CullerApart, said: object) -> None:
        self._culler, self._said = culler, said

    @property
    def tolerance(self) -> RasterTolerance:  # type: ignore[override]
        return answers.read_tolerance(self._said)

    def item_buffer(self, camera: Camera) -> Int32 | None:
        return self._culler.item_buffer(camera)


class _Process:
    """The other process, its socket and what it prints."""

    def __init__(
        self, time_limit_s: float | None, memory_limit: int | None, say: Said | None
    ) -> None:
        self._time_limit_s = time_limit_s
        # Nor can an answer be larger than what its sender may hold.
        self._max_bytes = memory_limit if memory_limit is not None else 1 << 40
        self._asked, self._ended = 0, False
        self._end, its_end = socket.socketpair()
        path = [entry for entry in sys.path if entry]
        start = _START.format(path=path, end=its_end.fileno(), limit=memory_limit)
        with its_end:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", start],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                pass_fds=[its_end.fileno()],
                # Ctrl-C is for the judge, which ends this; and all that this starts ends with it.
                start_new_session=True,
            )
        assert self._process.stdout is not None
        self.printed = Printed(self._process.stdout, say)

    @property
    def runs(self) -> bool:
        return not self._ended

    def ask(self, question: Message) -> Message:
        """The answer to a question. Raises CullerError where none comes."""
        ask = question.header["ask"]
        if not self.runs:
            raise CullerError(f"its process has ended, so {_step(ask)} could not be asked")
        self._asked += 1
        header = {**question.header, "number": self._asked}
        limit = self._time_limit_s
        if ask == "close":
            limit = _SECONDS_TO_CLOSE if limit is None else min(limit, _SECONDS_TO_CLOSE)
        deadline = Deadline(limit)
        try:
            send(self._end, Message(header, question.arrays, question.descriptors or [0]), deadline)
            answer = receive(self._end, deadline, max_bytes=self._max_bytes)
        except TimeoutError:
            self.end()
            raise CullerError(f"{_step(ask)} took longer than {limit:g} s") from None
        except (EOFError, OSError):
            raise CullerError(self._obituary(ask)) from None
        except BrokenMessage as error:
            self.end()
            raise CullerError(f"its process answered {error} in {_step(ask)}") from None
        if answer.header.get("number") != self._asked:
            self.end()
            raise CullerError(f"its process answered out of turn in {_step(ask)}")
        return answer

    def _obituary(self, ask: str) -> str:
        try:
            status = self._process.wait(SECONDS_TO_DIE)
        except subprocess.TimeoutExpired:
            self.end()
            return f"its process hung up in {_step(ask)}"
        self.end()
        last = self.printed.last
        words = f"; its last words: {last}" if last else ""
        if status < 0:
            return f"its process was killed by {signal_name(-status)} in {_step(ask)}{words}"
        return f"its process ended with status {status} in {_step(ask)}{words}"

    def end(self) -> None:
        """End it and all that it started, now; the first time."""
        if self._ended:
            return
        self._ended = True
        try:
            os.killpg(self._process.pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            self._process.kill()
        self._process.wait()
        self.printed.finish()
        self._end.close()


# What is asked, where its name is not the method's.
_STEPS = {
    "make": "its import or constructor",
    "item_buffer": "its rasteriser's item_buffer()",
}


def _step(ask: str) -> str:
    return _STEPS.get(ask, f"{ask}()")
