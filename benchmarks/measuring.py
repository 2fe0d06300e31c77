"""Jobs that take turns, timed by the wall clock and by processor time."""

from __future__ import annotations

import resource
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import median
from typing import Any

Job = Callable[[], object]


@dataclass(frozen=True)
class Skipped:
    """A peer that is not there, and why."""

    reason: str


@dataclass(frozen=True)
class Spent:
    """Seconds of each round."""

    wall_s: list[float]
    cpu_s: list[float]

    @classmethod
    def nothing(cls) -> Spent:
        return cls([], [])

    def median(self, clock: str) -> float:
        return median(self.wall_s if clock == "wall" else self.cpu_s)


def cpu_seconds() -> float:
    """Processor time of this process, all its threads, and of those children that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def alternate(jobs: list[Job], rounds: int) -> list[float]:
    """Median seconds of each job; the jobs take turns, and a first turn does not count."""
    seconds: list[list[float]] = [[] for _ in jobs]
    for turn in range(rounds + 1):
        for job, spent in zip(jobs, seconds, strict=True):
            start = time.perf_counter()
            job()
            if turn:  # The first turn warms caches and compiled code.
                spent.append(time.perf_counter() - start)
    return [median(spent) for spent in seconds]


class Turns:
    """What the fixture `turns` gives a benchmark: `run` it against others, and `say` more of it."""

    def __init__(self, benchmark: Any, quick: bool) -> None:
        self._benchmark = benchmark
        self._quick = quick

    def run(
        self,
        kind: str,
        name: str,
        jobs: Mapping[str, Job | Skipped],
        *,
        rounds: int = 3,
        warm: bool = True,
        clock: str = "cpu",
    ) -> dict[str, Spent]:
        """Time the jobs in turns; the first is pytest-benchmark's, and the others' speeds are told
        as multiples of its.

        `kind` and `name`: the heading and the row on the page. `warm`: whether a first turn is not
        counted. `clock`: "cpu" or "wall", by which speeds are told. Returns what each took.
        """
        first, *_ = jobs
        spent = {
            title: Spent.nothing() for title, job in jobs.items() if not isinstance(job, Skipped)
        }

        def timed(title: str) -> None:
            job = jobs[title]
            assert not isinstance(job, Skipped)
            wall, cpu = time.perf_counter(), cpu_seconds()
            job()
            spent[title].cpu_s.append(cpu_seconds() - cpu)
            spent[title].wall_s.append(time.perf_counter() - wall)

        def others() -> None:
            for title in spent:
                if title != first:
                    timed(title)

        warm = warm and not self._quick
        rounds = 1 if self._quick else rounds
        self._benchmark.pedantic(
            lambda: timed(first), setup=others, rounds=rounds, warmup_rounds=int(warm)
        )
        if warm:
            spent = {title: Spent(one.wall_s[1:], one.cpu_s[1:]) for title, one in spent.items()}
        of_first = _seconds(spent[first], clock)
        rows = {}
        for title, job in jobs.items():
            if isinstance(job, Skipped):
                rows[title] = {"skipped": job.reason}
                continue
            one = spent[title]
            pairs = zip(of_first, _seconds(one, clock), strict=True)
            rows[title] = {
                "wall_s": one.median("wall"),
                "cpu_s": one.median("cpu"),
                # Round by round, so that what slows the machine slows both.
                "speed": median(ours / max(other, 1e-9) for ours, other in pairs),
            }
        info = self._benchmark.extra_info
        info.update(kind=kind, name=name, clock=clock, rounds=rounds, jobs=rows)
        info.setdefault("said", {})
        return spent

    def say(self, **figures: float | str) -> None:
        """More figures of this benchmark, or a word about it: a column of the page each."""
        said = {name.replace("_", " "): value for name, value in figures.items()}
        self._benchmark.extra_info.setdefault("said", {}).update(said)


def _seconds(spent: Spent, clock: str) -> list[float]:
    return spent.wall_s if clock == "wall" else spent.cpu_s


def command(*words: object, environment: Mapping[str, str] | None = None, status: int = 0) -> str:
    """Run a command, and give what it printed. Raises RuntimeError where its exit status is not
    `status`."""
    done = subprocess.run(
        [str(word) for word in words],
        capture_output=True,
        text=True,
        check=False,
        env=None if environment is None else dict(environment),
    )
    if done.returncode != status:
        told = done.stderr.strip()[-2000:]
        raise RuntimeError(f"{words} ended with {done.returncode}, not {status}: {told}")
    return done.stdout
