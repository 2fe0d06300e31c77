"""The process that a plug-in lives in: it makes the culler, and answers the judge's questions."""

from __future__ import annotations

import ctypes
import os
import pickle
import resource
import signal
import socket
import sys
from collections.abc import Callable
from typing import Any

from visref.camera import Camera
from visref.culler import Culler, CullerError, fault_text
from visref.plug_ins import answers
from visref.plug_ins.in_process import BadSpec, make
from visref.plug_ins.shared import shared_value
from visref.plug_ins.wire import Deadline, Message, receive, send
from visref.stopwatch import Stopwatch

_FOREVER = Deadline(None)
_RECURSION = sys.getrecursionlimit()


def main(descriptor: int, memory_limit: int | None) -> None:
    """Answer until the judge hangs up. `memory_limit`: bytes of memory of the process's own."""
    _die_with_the_judge()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if memory_limit is not None:
        resource.setrlimit(resource.RLIMIT_DATA, (memory_limit, memory_limit))
    end = socket.socket(fileno=descriptor)
    # A fork of a plug-in's is nobody whom the judge asked.
    os.register_at_fork(after_in_child=end.close)
    me = os.getpid()
    worker = _Worker()
    while True:
        question = receive(end, _FOREVER, max_bytes=1 << 40, descriptors=1)
        answer = worker.answer(question)
        if os.getpid() != me:
            os._exit(0)
        header = {**answer.header, "number": question.header["number"]}
        send(end, Message(header, answer.arrays), _FOREVER)


class _Worker:
    """The culler, once it is made, and what each question asks of it."""

    def __init__(self) -> None:
        self._culler: Culler | None = None
        self._raster: Any = None

    def answer(self, question: Message) -> Message:
        """The answer, with what the culler now declares; or the fault."""
        ask = question.header["ask"]
        try:
            said = getattr(self, f"_{ask}")(question)
            about = {} if self._culler is None else {"declared": answers.declared(self._culler)}
            return Message({**said.header, **about}, said.arrays)
        except BadSpec as error:
            return Message({"fault": str(error), "kind": "input"})
        except BaseException as error:  # a plug-in may raise anything
            return Message({"fault": fault_text(error), "kind": "culler"})
        finally:
            sys.setrecursionlimit(_RECURSION)

    @property
    def _made(self) -> Culler:
        if self._culler is None:
            raise CullerError("it was never made")
        return self._culler

    def _make(self, question: Message) -> Message:
        self._culler = make(question.header["spec"])
        return Message({})

    def _prepare(self, question: Message) -> Message:
        return answers.units_message(self._made.prepare(shared_value(question.descriptors[0])))

    def _update(self, question: Message) -> Message:
        self._made.update(shared_value(question.descriptors[0]))
        return Message({})

    def _cull(self, question: Message) -> Message:
        (camera,) = _cameras(question)
        return self._timed(lambda: self._made.cull(camera))

    def _cull_joint(self, question: Message) -> Message:
        cameras = _cameras(question)
        return self._timed(lambda: self._made.cull_joint(cameras))

    def _timed(self, cull: Callable[[], object]) -> Message:
        with Stopwatch() as watch:
            drawn = cull()
        return answers.drawn_message(drawn, watch.ms if self._made.timed else None)

    def _bounds(self, _: Message) -> Message:
        return answers.array_message(self._made.bounds(), "bounds()")

    def _item_buffer(self, question: Message) -> Message:
        raster = self._made.raster
        (camera,) = _cameras(question)
        picture = None if raster is None else raster.item_buffer(camera)
        return answers.array_message(picture, "the item buffer")

    def _close(self, _: Message) -> Message:
        culler, self._culler = self._made, None
        culler.close()
        return Message({})


def _cameras(question: Message) -> list[Camera]:
    return list(pickle.loads(question.arrays["cameras"].tobytes()))


def _die_with_the_judge() -> None:
    """However the judge ends, this process does. (Where the system has no such way, it ends at the
    next question that does not come.)"""
    if sys.platform == "linux":
        PR_SET_PDEATHSIG = 1
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
