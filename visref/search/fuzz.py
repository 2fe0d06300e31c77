"""Searches for violations: tries trials round by round, on all cores, and keeps what it finds.

What is tried next is decided here, from the outcomes in the order of the trials; how one is tried,
in `trying`. So the outcome is the same for any number of workers.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from visref.errors import InputError, NothingToJudge
from visref.judging.status import Status
from visref.search.distinct import shrink_all
from visref.search.folder import Fault, Key, SearchFolder, Tally
from visref.search.judging import Kind, Violation
from visref.search.stream import Stream, round_of
from visref.search.trying import Asked, Outcome, Trier, moves_of
from visref.search.views import ViewsOf

# Trials of one cause that are shrunk: their smallest scenes may differ.
EXAMPLES = 3
# A round of trials in a large scene takes long, and somebody may stop it.
_WRITTEN_EVERY_S = 10.0
# So many trials with a violation have their causes looked for, and later ones that show something
# new: that takes several times as long as judging them.
EXPLAINED = 32
# Faults that are kept: a culler that fails everywhere fails in more ways than anybody reads.
MOST_FAULTS = 50

Task = list[tuple[int, Any]]
# How far it is: the folder, and in words what is done, "" while it searches.
Shown = Callable[[SearchFolder, str], None]
TryAll = Callable[[Task], Iterator[tuple[Task, Sequence[Outcome]]]]


def fuzz(
    asked: Asked,
    out: Path,
    *,
    trials: int | None = None,
    seconds: float | None = None,
    workers: int = 1,
    shown: Shown = lambda *_: None,
) -> SearchFolder:
    """Search until so many trials are made in all, or for so many seconds more; the folder is
    written after each round of trials, in a long one now and then, and goes on where it stopped.
    Then each distinct fault is shrunk. `shown` is told after some trials, and before each fault.

    Raises InputError for anything wrong with what is asked or with the folder, and NothingToJudge
    where the culler cannot start here or ends a worker's process.
    """
    if trials is None and seconds is None:
        raise InputError("there is no end to it", fix="give --trials or --time")
    ends = None if seconds is None else time.monotonic() + seconds
    with asked.suspect() as suspect:
        moves = moves_of(suspect)
        trier = Trier(asked, suspect, asked.source(moves=moves))
        stream: Stream[Any] = Stream(trier.source, asked.seed)
        sha256 = trier.source.scene.digest if isinstance(trier.source, ViewsOf) else None
        about = {**described(asked), "scene_sha256": sha256, "moves": moves}
        folder = SearchFolder(out, about)
        folder.open(stream, trier.source)
        with _trying(trier, moves, workers) as try_all:
            while _goes_on(folder.tally, trials, ends):
                written = time.monotonic()
                for _ in _round(folder, stream, trier, trials, try_all):
                    shown(folder, "")
                    if not _goes_on(folder.tally, trials, ends):
                        break
                    if time.monotonic() - written > _WRITTEN_EVERY_S:
                        folder.write(stream, trier.source)
                        written = time.monotonic()
                folder.write(stream, trier.source)

        def before(text: str) -> None:
            # What was shrunk so far stays when somebody stops it.
            folder.write(stream, trier.source)
            shown(folder, text)

        shrink_all(folder, trier, before)
        folder.write(stream, trier.source)
    return folder


def _round(
    folder: SearchFolder, stream: Stream[Any], trier: Trier, trials: int | None, try_all: TryAll
) -> Iterator[None]:
    """Try the rest of the round at hand; gives way after each run of trials that is taken in."""
    source, first = trier.source, folder.tally.trials
    together = trier.together
    # Whole runs of trials, so that what stands before one is the same wherever it stopped.
    start = first - first % together
    end = round_of(first).stop
    numbers = range(start, end if trials is None else min(end, trials))
    genomes = {number: stream.genome(number) for number in numbers}
    for task, outcomes in try_all(
        [(number, source.written(genomes[number])) for number in numbers]
    ):
        for at, tried in enumerate(outcomes):
            if tried.trial < first:
                continue
            outcome = tried
            if outcome.misses and (
                folder.tally.violating < EXPLAINED or stream.is_new(outcome.features)
            ):
                outcome = trier.explained(task[: at + 1], outcome)
            if not outcome.skipped:
                stream.learn(outcome.trial, genomes[outcome.trial], outcome.features)
            _take_in(folder, outcome, task)
        yield


def described(asked: Asked) -> dict[str, Any]:
    """What is searched, in JSON values: what a search that goes on must share."""
    command = asked.command
    return {
        "culler": asked.name,
        "command": None if command is None else command.text,
        "scene": asked.scene or None,
        "engine": asked.engine or None,
        "cull_backfaces": asked.cull_backfaces,
        "can": None if asked.can is None else sorted(asked.can),
        "seed": asked.seed,
    }


def _goes_on(tally: Tally, trials: int | None, ends: float | None) -> bool:
    if trials is not None and tally.trials >= trials:
        return False
    return ends is None or time.monotonic() < ends


def _take_in(folder: SearchFolder, outcome: Outcome, task: Task) -> None:
    tally = folder.tally
    tally.trials = outcome.trial + 1
    if outcome.skipped:
        tally.skipped += 1
        return
    tally.promise = outcome.promise.value
    if outcome.failed:
        if not tally.broke_down:
            tally.failed, tally.failed_in = outcome.failed, outcome.trial
        tally.broke_down += 1
    elif outcome.status is not Status.INCONCLUSIVE:
        tally.judged += 1
    tally.violations += len(outcome.violations)
    tally.violating += bool(outcome.violations)
    first: dict[Key, Violation] = {}
    for violation in outcome.violations:
        # A miss whose cause nobody looked for is no fault of its own.
        if violation.kind is Kind.SUPERFLUOUS or outcome.looked_into:
            keys = [*(one.key for one in folder.faults), *first]
            first.setdefault(Key.among(violation, keys), violation)
    for key, violation in first.items():
        known = [one for one in folder.faults if one.key == key]
        if len(known) < EXAMPLES and len(folder.faults) < MOST_FAULTS:
            at = [number for number, _ in task].index(outcome.trial)
            before = [genome for _, genome in task[:at]]
            folder.faults.append(Fault(key, outcome.trial, task[at][1], before, violation))
        elif known:
            known[0].trials += 1


# Workers.


@contextmanager
def _trying(trier: Trier, moves: bool, workers: int) -> Iterator[TryAll]:
    """What tries trials: here, or in so many processes."""
    if workers == 1:
        yield lambda trials: ((t, trier.try_all(t)) for t in _tasks(trials, trier.together))
        return
    # A process of its own each: a copy of this one would share its GL context.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, context, _begin, (trier.asked, moves))

    def try_all(trials: Task) -> Iterator[tuple[Task, Sequence[Outcome]]]:
        tasks = _tasks(trials, trier.together)
        futures = [pool.submit(_try, task) for task in tasks]
        for task, future in zip(tasks, futures, strict=True):
            yield task, _result(future)

    try:
        yield try_all
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _tasks(trials: Task, together: int) -> list[Task]:
    """Trials in runs, the same for any number of workers and wherever a round was cut."""
    tasks: dict[int, Task] = {}
    for one in trials:
        tasks.setdefault(one[0] // together, []).append(one)
    return list(tasks.values())


def _result(future: Future[Sequence[Outcome]]) -> Sequence[Outcome]:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise NothingToJudge(
            "a worker's process ended before its trials did: the culler took it along, or the "
            "system had no memory left"
        ) from error


@dataclass
class _Worker:
    """A worker's own, made when it begins; what went wrong then is said with its first trials."""

    trier: Trier | None = None
    error: Exception | None = None


_worker = _Worker()


def _begin(asked: Asked, moves: bool) -> None:
    # Ctrl-C is for the search, which ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _worker.trier = Trier.of(asked, moves=moves)
    except (InputError, NothingToJudge) as error:
        _worker.error = error


def _try(task: Task) -> Sequence[Outcome]:
    if _worker.error is not None:
        raise _worker.error
    assert _worker.trier is not None
    return _worker.trier.try_all(task)
