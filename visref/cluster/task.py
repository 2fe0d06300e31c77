"""What runs in a worker: one stretch of frames, judged into the files of a part.

A culler on OpenGL keeps to the thread that made its context, so all that one process judges it
judges in one thread, a task after another.
"""

from __future__ import annotations

import math
import os
import shutil
import socket
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import chdir, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from visref.cluster.order import Order
from visref.culler import Culler, Recorded
from visref.errors import InputError, error_json
from visref.inputs import Inputs
from visref.judging.asking import Job, memory_of
from visref.judging.referee import JudgedFrame
from visref.picking import Stretch
from visref.provenance import code_of, versions
from visref.recordings.truth_file import path_digest
from visref.shares import Asked, judge_share
from visref.visibility import FrameTruth, ObjectVisibility

# Told what is about to be done.
Trace = Callable[[str], None]

_SAME = "install the same there as here"
_THREAD = ThreadPoolExecutor(1, "visref")
# The inputs of the last run that this process worked for, by its key.
_OPEN: dict[str, Inputs] = {}


def judge_stretch(
    order: Order, stretch: Stretch, *, threads: int, trace: Trace | None = None
) -> dict[str, Any]:
    """The files of a part, as bytes by path with "/", under `files`; or what `error_json` says of
    what was raised. `threads`: how many there are for it. `trace` is told what is about to be
    done, before it is: if this process ends, that was the last."""
    return _told(lambda: {"files": _judged(order, stretch, threads, trace)})


def looks_back(order: Order) -> dict[str, Any]:
    """How many frames the culler that looks back furthest does, as far as is known before it is
    prepared, under `memory`: None for no limit; or what `error_json` says of what was raised, as
    where this worker has not what the run needs."""

    def furthest() -> int | None:
        with _there(order):
            _inputs(order)
            with order.anew() as cullers:
                depths = [memory_of(one) for _, one in cullers if not isinstance(one, Recorded)]
                for _, culler in cullers:
                    culler.close()
        return None if None in depths else max((k for k in depths if k is not None), default=0)

    return _told(lambda: {"memory": furthest()})


def _told(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    try:
        return _THREAD.submit(work).result()
    except Exception as error:  # who gave the order is told
        return error_json(error)


def _judged(order: Order, stretch: Stretch, threads: int, trace: Trace | None) -> dict[str, bytes]:
    # Mesa's rasteriser takes all cores, where nobody says otherwise.
    os.environ.setdefault("LP_NUM_THREADS", str(threads))
    with tempfile.TemporaryDirectory(prefix="visref-part-") as folder, _there(order):
        inputs = replace(_inputs(order), threads=threads)
        truth = order.truth
        if order.truth_bytes is not None:
            truth = Path(folder) / "truth.parquet"
            truth.write_bytes(order.truth_bytes)
        asked = Asked(truth=truth, anew=order.anew, **order.asked)
        part = _OnePart(Path(folder))
        with order.anew() as cullers:
            listeners = []
            if trace is not None:
                listeners = [_Traced(trace, cullers, inputs.frames[stretch.start])]
            judge_share(
                inputs, cullers, None, asked, share=stretch, parts=part, listeners=listeners,
                shares_cores=True,
            )  # fmt: skip
        return part.files


@contextmanager
def _there(order: Order) -> Iterator[None]:
    """Where relative paths mean what they do to who gave the order, if that folder is here."""
    here = chdir(order.folder) if os.path.isdir(order.folder) else nullcontext()
    with here:
        yield


def _inputs(order: Order) -> Inputs:
    """The inputs of an order. Raises InputError, which names this machine, where something is not
    what it is where the order comes from."""
    if order.key in _OPEN:
        return _OPEN[order.key]
    me = f"the worker on {socket.gethostname()}"
    mine = versions()
    for name in sorted({*mine, *order.versions}):
        if mine.get(name) != order.versions.get(name):
            has, wanted = mine.get(name, "none"), order.versions.get(name, "none")
            raise InputError(f"{me} has {name} {has}, not {wanted}", fix=_SAME)
    for name, digest in order.code.items():
        if _code(name) != digest:
            raise InputError(f"{me} has other code of '{name}', or none", fix=_SAME)
    inputs = order.inputs if isinstance(order.inputs, Inputs) else order.inputs()
    for what, same, source in (
        ("scene", inputs.scene.digest == order.scene, inputs.scene.source),
        ("path", path_digest(inputs.path) == order.path, inputs.path.source),
        ("choice of frames", tuple(inputs.frames) == order.frames, inputs.path.source),
    ):
        if not same:
            raise InputError(
                f"{me} finds another {what} there", source=source, fix="use --dask-scene send"
            )
    _OPEN.clear()
    _OPEN[order.key] = inputs
    return inputs


@cache
def _code(package: str) -> str:
    """As it was when it was first asked for: later on disk is not what this process has loaded."""
    return code_of(package)


class _OnePart:
    """`visref.shares.Parts` of a stretch that is judged in one go: its files, in memory."""

    seconds = math.inf

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.files: dict[str, bytes] = {}

    def begin(self) -> Path:
        return Path(tempfile.mkdtemp(dir=self._folder))

    def keep(self, folder: Path, stretch: Stretch) -> None:
        for file in folder.rglob("*"):
            if file.is_file():
                self.files[file.relative_to(folder).as_posix()] = file.read_bytes()
        shutil.rmtree(folder)


@dataclass(eq=False)
class _Traced:
    """A run's listener, and what stands before each culler's answers: both tell what comes next."""

    trace: Trace
    cullers: Sequence[tuple[str, Culler]]
    first: int

    def __post_init__(self) -> None:
        self._where = f"before frame {self.first}"
        self.trace(f"at work {self._where}")
        for name, culler in self.cullers:
            for step, said in (
                ("prepare", "meets the scene"), ("update", "meets what moved"),
                ("cull", "is asked"), ("cull_joint", "is asked"),
            ):  # fmt: skip
                self._tell_before(name, culler, step, said)

    def _tell_before(self, name: str, culler: Culler, step: str, said: str) -> None:
        asked = getattr(culler, step)

        def told(*given: Any) -> Any:
            self.trace(f"'{name}' {said} {self._where}")
            answer = asked(*given)
            self.trace(f"at work {self._where}")
            return answer

        # One that takes no attributes is told of by its frame alone.
        with suppress(AttributeError):
            setattr(culler, step, told)

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        self._where = f"in frame {frame}"

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        self._where = f"in frame {judged.record.frame}"

    def on_frame_done(self, frame: int) -> None:
        self._where = f"after frame {frame}"
