"""The schedule of a run on a cluster: which stretches are judged, and what becomes of each."""

from __future__ import annotations

import math
import os
import pickle
import queue
import time
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from visref.cluster.order import Opening, Order
from visref.cluster.task import judge_stretch, looks_back
from visref.errors import InputError, Unfinished, raise_told
from visref.inputs import Inputs
from visref.judging.outcome import RunOutcome
from visref.judging.policy import Policy
from visref.kept import Kept
from visref.picking import Shard, Stretch, stretches
from visref.provenance import code_of, versions
from visref.recordings.truth_file import path_digest
from visref.shares import MakingAnew
from visref.workers import LEAST_FRAMES, Begun, Going, begun

# So many tasks for each worker, so that the last ones end at about the same time; what a task
# judges again where cullers look back is at most one part in so many of its own frames.
_ROUNDS = 4
# What is lost with a worker, and what its result holds, is no more than so many frames of work.
_MOST_FRAMES = 100

# A cluster that starts its workers by a queue may need long, and so may one that has lost them.
_FIRST_WORKER_S = 120.0
_NO_WORKER_S = 120.0
_LOOK_S = 2.0
_BEGUN, _ENDED_WELL = "begun", "ended well"


@contextmanager
def judging_on_dask(
    inputs: Inputs,
    anew: MakingAnew,
    out: Path | str,
    client: Any,
    *,
    opening: Opening | None = None,
    packages: Sequence[str] = ("visref", "visref_culling"),
    frames_each: int | None = None,
    truth: Path | str | None = None,
    policy: Policy | None = None,
    command: Mapping[str, str] | None = None,
    **given: Any,
) -> Iterator[Going]:
    """`visref.workers.judging_at_once` by the workers of a Dask cluster, of which `client` is a
    `distributed.Client`.

    `opening`: how a worker reads the inputs where it is, None to send them; `anew` and it can be
    pickled. `packages`: whose code must be the same there as here. `frames_each`: how many frames
    a task judges, by default by how many workers there are and how far cullers look back. A task
    whose worker is lost goes to another one.

    Raises what `judging_at_once` does; InputError too where a worker has other versions, code or
    files; Unfinished, once all else is judged, where a stretch ends each worker that judges it,
    and where there is no worker any more.
    """
    if frames_each is not None and frames_each < 1:
        raise InputError(f"--dask-frames is {frames_each}", fix="give 1 or more")
    file = None if truth is None else Path(truth)
    with begun(inputs, out, truth=file, policy=policy, command=command) as run:
        if run.alone:
            raise InputError(
                "a truth file of version 1 is read by one process", source=str(file),
                fix="leave --dask out, or cast the truth again",
            )  # fmt: skip
        order = Order(
            key=uuid.uuid4().hex,
            inputs=inputs if opening is None else opening,
            anew=anew,
            scene=inputs.scene.digest,
            path=path_digest(inputs.path),
            frames=tuple(map(int, inputs.frames)),
            versions=versions(),
            code={name: code_of(name) for name in packages},
            folder=os.getcwd(),
            asked={"policy": policy, **given},
            truth=file,
            truth_bytes=file.read_bytes() if file is not None and opening is None else None,
            threads=inputs.threads,
        )
        running = _Running(client, order, run)
        try:

            def finish(on_frame: Callable[[int], None]) -> RunOutcome:
                running.judge(frames_each, on_frame)
                return run.merged()

            yield run.going(finish)
        finally:
            running.end()


class _Running:
    """An order, given to a cluster stretch by stretch."""

    def __init__(self, client: Any, order: Order, run: Begun) -> None:
        self._client, self._order, self._run = client, order, run
        self._ended: queue.SimpleQueue[_Ended] = queue.SimpleQueue()
        self._under_way: dict[str, _Task] = {}
        self._suspects: list[Stretch] = []
        self._held: Any = None

    def judge(self, frames_each: int | None, on_frame: Callable[[int], None]) -> None:
        """Until each frame that is left is kept."""
        left = self._run.left
        if not left:
            return
        self._wait_for_workers()
        self._held = self._hand_over()
        if frames_each is None:
            # Whether a worker has what the run needs is seen by this, too.
            self._submit(None, _look_back_there, self._held)
            said = self._next()[1]
            frames_each = _frames_each(len(left), len(self._workers()), said["memory"])
        for stretch in _cut(left, frames_each):
            self._submit(stretch, _judge_there, self._held, stretch, self._order.threads)
        while self._under_way:
            self._take(on_frame)
        # Who was at work on it when a worker was lost may have had nothing to do with that: each
        # once more, alone, telling what it does.
        for stretch in self._suspects:
            topic = f"visref-{self._order.key}-{stretch}"
            self._submit(stretch, _judge_there, self._held, stretch, self._order.threads, topic)
            self._take(on_frame, topic)

    def end(self) -> None:
        """Nothing is left to be done, whatever happened."""
        with suppress(Exception):
            self._client.cancel([task.future for task in self._under_way.values()])
        self._under_way = {}
        self._held = None

    def _hand_over(self) -> Any:
        """The order, as a task's result: the scheduler keeps what it is made of, so that it is made
        again where all workers that have it are lost."""
        import cloudpickle

        try:
            data = cloudpickle.dumps(self._order)
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            raise InputError(
                f"what is to be judged cannot be sent to a worker: {error}",
                fix="leave --dask out",
            ) from error
        with warnings.catch_warnings():
            # Of a large graph: a scene that is sent is one.
            warnings.simplefilter("ignore", UserWarning)
            return self._client.submit(_unpacked, data, key=f"visref-order-{self._order.key}")

    def _submit(self, stretch: Stretch | None, work: Callable[..., Any], *given: Any) -> None:
        key = f"visref-{'look' if stretch is None else stretch}-{uuid.uuid4().hex}"
        future = self._client.submit(work, *given, key=key)
        self._under_way[key] = _Task(stretch, future)
        self._client.loop.add_callback(self._fetch, future)

    async def _fetch(self, future: Any) -> None:
        """Wait for what a task says, until it is here: a worker that is lost takes with it what its
        tasks had said, and that is then found again, by tasks that are no longer done."""
        said: dict[str, Any] = {}
        raised = None
        try:
            said = await self._client.gather(future, asynchronous=True)
        except Exception as error:
            raised = error
        self._ended.put(_Ended(future.key, said, raised))

    def _take(self, on_frame: Callable[[int], None], topic: str | None = None) -> None:
        """Wait for one task, and keep what it found. One that ended its workers is a suspect; where
        it has told of what it does under a `topic`, it is convicted."""
        try:
            stretch, said = self._next()
        except _WorkersLost as lost:
            if topic is None:
                self._suspects.append(lost.stretch)
                return
            raise self._poisonous(lost.stretch, topic) from None
        if topic is not None and "poisonous" in said:
            raise self._poisonous(stretch, topic)
        assert stretch is not None
        self._keep(stretch, said["files"])
        for frame in stretch.of(self._order.frames):
            on_frame(frame)

    def _next(self) -> tuple[Stretch, dict[str, Any]]:
        """What the next task that ends has said, and of which stretch. Raises what it raised."""
        from distributed import CancelledError, KilledWorker

        ended = self._wait()
        task = self._under_way.pop(ended.key)
        stretch = task.stretch or Stretch(0, 0)
        why = ended.raised
        if why is None:
            raise_told(ended.said)
            return stretch, ended.said
        if isinstance(why, CancelledError):
            raise Unfinished(
                "the scheduler let go of a part of the run: it was restarted, or has lost it"
            ) from why
        if isinstance(why, KilledWorker):
            if task.stretch is None:
                raise Unfinished(
                    "each worker that reads the inputs and makes the cullers ends by that"
                )
            raise _WorkersLost(stretch)
        if isinstance(why, ImportError):
            raise InputError(
                f"a worker cannot import what the run needs: {why}",
                fix="install visref and your cullers where the workers are",
            )
        raise self._broken(why) from why

    def _wait(self) -> _Ended:
        """The next task that has ended."""
        empty_since = None
        while True:
            with suppress(queue.Empty):
                return self._ended.get(timeout=_LOOK_S)
            if self._workers():
                empty_since = None
            elif empty_since is None:
                empty_since = time.monotonic()
            elif time.monotonic() - empty_since > _NO_WORKER_S:
                raise Unfinished(f"the cluster has had no worker for {_NO_WORKER_S:g} s")

    def _workers(self) -> Sequence[str]:
        """The addresses of those that there are. Raises Unfinished where the scheduler is gone."""
        try:
            if self._client.status not in ("running", "connecting"):
                raise OSError(f"the client is {self._client.status}")
            return list(self._client.nthreads())
        except (OSError, TimeoutError, ValueError) as error:
            raise self._broken(error) from error

    def _wait_for_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=_FIRST_WORKER_S)
        except (OSError, TimeoutError) as error:
            raise InputError(
                f"the cluster has had no worker for {_FIRST_WORKER_S:g} s",
                fix="start some with `dask worker`",
            ) from error

    def _broken(self, error: BaseException) -> Unfinished:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return Unfinished(f"the cluster broke down: {text}")

    def _poisonous(self, stretch: Stretch, topic: str) -> Unfinished:
        """What is said of a stretch that ends each worker that judges it."""
        frames = stretch.of(self._order.frames)
        which = f"frame {frames[0]}" if len(frames) == 1 else f"frames {frames[0]} to {frames[-1]}"
        marks = (_BEGUN, _ENDED_WELL)
        said = [word for word in _told_under(self._client, topic) if word not in marks]
        at = f"; the last one ended as {said[-1]}" if said else ""
        return Unfinished(f"{which}: each worker that judged this part ended by it{at}")

    def _keep(self, stretch: Stretch, files: Mapping[str, bytes]) -> None:
        _write(self._run.kept, stretch, files)


@dataclass(frozen=True, eq=False)
class _Task:
    """Something that a worker does: a `stretch`, or a look at what there is."""

    stretch: Stretch | None
    future: Any


@dataclass(frozen=True, eq=False)
class _Ended:
    """What the task of this key has said, or raised."""

    key: str
    said: dict[str, Any]
    raised: Exception | None


class _WorkersLost(Exception):
    """More workers were lost while they had this stretch than the scheduler allows for."""

    def __init__(self, stretch: Stretch) -> None:
        super().__init__(str(stretch))
        self.stretch = stretch


def _write(kept: Kept, stretch: Stretch, files: Mapping[str, bytes]) -> None:
    """A part that came from a worker, where parts go."""
    folder = kept.begin()
    for name, data in files.items():
        place = PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts:
            raise Unfinished(f"a worker has sent a file named {name!r}")
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_bytes(data)
    kept.keep(folder, stretch)


def _frames_each(frames: int, workers: int, memory: int | None) -> int:
    """How many frames a task judges: each asks cullers about those that they look back to."""
    workers = max(1, workers)
    if memory is None:
        # About all before: the fewer tasks the better.
        return math.ceil(frames / workers)
    least = max(LEAST_FRAMES, _ROUNDS * memory)
    return max(least, min(_MOST_FRAMES, math.ceil(frames / (_ROUNDS * workers))))


def _cut(left: Sequence[int], frames_each: int) -> list[Stretch]:
    """The places that are left, in stretches of about the same length, none longer than that."""
    found = []
    for whole in stretches(left):
        places = range(whole.start, whole.stop)
        count = math.ceil(len(places) / frames_each)
        for number in range(1, count + 1):
            part = Shard(number, count).of(places)
            found.append(Stretch(part[0], part[-1] + 1))
    return found


# What follows runs in a worker.


def _unpacked(data: bytes) -> Order:
    order = pickle.loads(data)
    assert isinstance(order, Order)
    return order


def _look_back_there(order: Order) -> dict[str, Any]:
    return looks_back(order)


def _judge_there(
    order: Order, stretch: Stretch, threads: int | None, topic: str | None = None
) -> dict[str, Any]:
    from distributed import get_client, get_worker

    if threads is None:
        threads = get_worker().state.nthreads
    if topic is None:
        return judge_stretch(order, stretch, threads=threads)
    client = get_client()
    told = _told_under(client, topic)
    if told and told[-1] != _ENDED_WELL:
        # Once is enough: it ended the worker that told what it does.
        return {"poisonous": True}
    client.log_event(topic, _BEGUN)
    said = judge_stretch(
        order, stretch, threads=threads, trace=lambda words: client.log_event(topic, words)
    )
    client.log_event(topic, _ENDED_WELL)
    return said


def _told_under(client: Any, topic: str) -> list[str]:
    return [words for _, words in client.get_events(topic)]
