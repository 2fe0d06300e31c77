"""How many of the faults that are planted here a search finds, in how many trials and seconds.

    python -m tests.search.benchmark generated --seed 0 --out FILE.json

tries generated scenes, guided, on every unsafe mutant and wrong culler until each is convicted or
the time is over: each case's truth is cast once for all of them, and each subject goes through the
trials until it is found, none spending more time than another.
`--unguided` draws every scene anew. What a culler's trials are before it is convicted depends on
truths alone, so these are the trials that `visref fuzz` would make.

    python -m tests.search.benchmark random --seed 0 --out FILE.json

is what people do: one scene, a city, with cameras anywhere in it.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from tests.search.subjects import Subject, Trial, sound, subjects
from visref.camera_path import CameraPath
from visref.conformance.building import Case as Laid
from visref.conformance.building import box, camera, case, city
from visref.errors import InputError
from visref.search.generated import GeneratedScenes
from visref.search.novelty import features_of
from visref.search.stream import Stream, round_of
from visref.visibility import objects_seen
from visref.wording import counted

# Processor seconds between two words on how far it is.
_TOLD_EVERY = 10.0


class RandomCameras:
    """Cameras anywhere in and about a city of houses, three frames of a walk from each: what
    somebody sees who flies around. It learns nothing."""

    def __init__(self) -> None:
        rng = np.random.default_rng(1)
        self.objects = city(rng)
        for _ in range(60):
            at = rng.uniform((-24.0, 0.0, -24.0), (24.0, 0.0, 24.0))
            half = rng.uniform(0.1, 0.8, 3)
            self.objects.append(("thing", box(at - half * (1, 0, 1), at + half * (1, 2, 1))))

    def random(self, rng: np.random.Generator) -> Laid:
        eye = rng.uniform((-30.0, 0.3, -30.0), (30.0, 6.0, 30.0))
        way = rng.normal(size=3) * (1.0, 0.25, 1.0)
        step = rng.normal(0.0, 0.4, 3) * (1.0, 0.1, 1.0)
        views = [camera(tuple(eye + k * step), tuple(eye + k * step + way)) for k in range(3)]
        return case(self.objects, views)


def features(trial: Trial, called: Any) -> set[str]:
    """Of all views of a trial, as `visref.search.novelty.Watching` gathers them."""
    found: set[str] = set()
    before: dict[str, Any] = {}
    truths = iter(trial.truths)
    for scene, frame in zip(trial.scenes, trial.path.frames, strict=True):
        for view in frame.cameras:
            truth = next(truths)
            seen = objects_seen(truth, scene)
            found |= set(features_of(truth, seen, scene, before.get(view.view), called))
            before[view.view] = seen.visible
    return found


class Trials:
    """The trials of a seed, made as far as somebody asks for them, and kept: None where no case can
    be made."""

    def __init__(self, kind: str, seed: int, guided: bool) -> None:
        self.seed, self.made = seed, []
        self.source = GeneratedScenes()
        self.stream = Stream(self.source, seed, guided=guided)
        self.cities = RandomCameras() if kind == "random" else None

    def __getitem__(self, number: int) -> Trial | None:
        while len(self.made) <= number:
            self._make(round_of(len(self.made)))
        return self.made[number]

    def _make(self, numbers: range) -> None:
        if self.cities is not None:
            for number in numbers:
                plain = self.cities.random(np.random.default_rng([self.seed, number]))
                self.made.append(Trial(plain.scene, CameraPath(plain.path.frames)))
            return
        genomes = [self.stream.genome(number) for number in numbers]
        for number, genome in zip(numbers, genomes, strict=True):
            try:
                laid = self.source.case(genome)
                trial = Trial.of(laid)
                shown = features(trial, self.source.called(laid))
            except InputError:
                self.made.append(None)
                continue
            self.stream.learn(number, genome, shown)
            self.made.append(trial)


@dataclass(frozen=True)
class Step:
    """A subject was tried: its `place` among all, the trial's number, the processor seconds that it
    has `spent` in all and that all have, and what a verdict says against it."""

    place: int
    number: int
    spent: float
    seconds: float
    said: str


@dataclass(eq=False)
class Progress:
    """How far a search is. By a subject's place: `number`, the trial that is its next, and `spent`,
    its processor seconds, of those that go on; `found`, the step that found it; `crashed`, the
    trial that ended its process. `seconds`: of all."""

    number: dict[int, int]
    spent: dict[int, float]
    found: dict[int, Step] = field(default_factory=dict)
    crashed: dict[int, int] = field(default_factory=dict)
    seconds: float = 0.0

    @classmethod
    def of(cls, count: int) -> Progress:
        """Before the first trial of so many subjects."""
        return cls(dict.fromkeys(range(count), 0), dict.fromkeys(range(count), 0.0))

    @property
    def next(self) -> int:
        """Whose turn it is: who has spent least, so that time is shared evenly, and who is slow
        makes fewer trials."""
        return min(self.number, key=lambda place: (self.spent[place], place))

    def take(self, step: Step) -> None:
        self.seconds = step.seconds
        if step.said:
            self.found[step.place] = step
            del self.number[step.place], self.spent[step.place]
        else:
            self.number[step.place], self.spent[step.place] = step.number + 1, step.spent

    def crash(self) -> int:
        """Whose turn it is has ended the process: it is out. Returns its place."""
        place = self.next
        self.crashed[place] = self.number.pop(place)
        del self.spent[place]
        return place

    def row(self, every: Sequence[Subject]) -> dict[str, Any]:
        """In JSON values, by the subjects' names: `found`, trials, own seconds, seconds of all and
        words; `not_found`, the trials that it went through; `crashed`, the trial."""
        return {
            "seconds": round(self.seconds, 1),
            "found": {
                every[place].name: [
                    one.number + 1, round(one.spent, 2), round(one.seconds, 1), one.said
                ]
                for place, one in self.found.items()
            },
            "not_found": {every[place].name: number for place, number in self.number.items()},
            "crashed": {every[place].name: number + 1 for place, number in self.crashed.items()},
        }  # fmt: skip


def search(
    every: Sequence[Subject],
    kind: str,
    seed: int,
    seconds: float,
    guided: bool,
    progress: Progress,
) -> Iterator[Step]:
    """Trials from where `progress` is on until all subjects are found or the time is over; whoever
    asks for the next step has taken the last one in. Time is this process's processor time, so that
    what else a machine does is not counted."""
    trials = Trials(kind, seed, guided)
    if progress.seconds:
        # What an earlier process made is made again, in nobody's time.
        for number in range(max(progress.number.values(), default=0)):
            trials[number]
    began = time.process_time() - progress.seconds
    while progress.number and time.process_time() - began < seconds:
        place = progress.next
        number = progress.number[place]
        trial = trials[number]
        start = time.process_time()
        said = "" if trial is None else trial.problem(every[place])
        now = time.process_time()
        yield Step(place, number, progress.spent[place] + now - start, now - began, said)


def chosen(one_each: bool) -> list[Subject]:
    """All subjects, or the first of each fault."""
    every = subjects()
    return list({one.fault: one for one in reversed(every)}.values())[::-1] if one_each else every


@dataclass(frozen=True)
class Part:
    """Every so many of the subjects, searched by a process of its own."""

    part: int
    parts: int
    kind: str
    seed: int
    seconds: float
    guided: bool
    one_each: bool

    @property
    def subjects(self) -> list[Subject]:
        return chosen(self.one_each)[self.part :: self.parts]


def _searching(part: Part, progress: Progress, sent: Connection) -> None:
    """In a process of its own: tells each step, and at the end nothing."""
    every = part.subjects
    for step in search(every, part.kind, part.seed, part.seconds, part.guided, progress):
        progress.take(step)
        sent.send(step)
    sent.send(None)


class Ended(Exception):
    """The process ended before its search did."""


def _steps(part: Part, progress: Progress) -> Iterator[Step]:
    """The steps of a search in a process of its own. Raises Ended where that ends before."""
    context = multiprocessing.get_context("spawn")
    received, sent = context.Pipe(duplex=False)
    process = context.Process(target=_searching, args=(part, progress, sent))
    process.start()
    sent.close()
    try:
        while (step := received.recv()) is not None:
            yield step
    except EOFError:
        raise Ended from None
    finally:
        received.close()
        process.terminate()
        process.join()


def searched(part: Part, beside: Path) -> Progress:
    """A part's search to its end. Whoever takes its process along is out, and the others go on in
    another. How far it is stands in a file beside, now and then."""
    every = part.subjects
    progress, told = Progress.of(len(every)), 0.0
    while True:
        steps = 0
        try:
            for step in _steps(part, progress):
                steps += 1
                progress.take(step)
                if step.seconds - told > _TOLD_EVERY:
                    told = step.seconds
                    text = json.dumps(progress.row(every), indent=1)
                    beside.write_text(f"{text}\n", encoding="utf-8")
        except Ended:
            if not progress.number:
                return progress
            name = every[progress.crash()].name
            print(f"{name} ended its process after {counted(steps, 'step')}", flush=True)
        else:
            return progress


def benchmark(given: argparse.Namespace) -> dict[str, Any]:
    """The same over several processes, each with its share of the subjects."""
    guided, count = not given.unguided, given.workers
    parts = [
        Part(part, count, given.kind, given.seed, given.seconds, guided, given.one_each)
        for part in range(count)
    ]
    with ThreadPoolExecutor(count) as pool:
        besides = [given.out.with_suffix(f".part{part.part}") for part in parts]
        found = list(pool.map(searched, parts, besides))
    rows = [one.row(part.subjects) for one, part in zip(found, parts, strict=True)]
    every = chosen(given.one_each)
    by_name = {
        what: {name: value for row in rows for name, value in row[what].items()}
        for what in ("found", "not_found", "crashed")
    }
    last = [[*one.number.values(), *(s.number + 1 for s in one.found.values())] for one in found]
    return {
        "kind": given.kind,
        "seed": given.seed,
        "guided": guided,
        "seconds": round(sum(row["seconds"] for row in rows), 1),
        "trials": max(number for numbers in last for number in [0, *numbers]),
        "subjects": len(every),
        **{
            what: {one.name: names[one.name] for one in every if one.name in names}
            for what, names in by_name.items()
        },
    }


def sound_ones(seed: int, seconds: float) -> dict[str, Any]:
    """The sound methods over the same trials: nothing is to be found."""
    began = time.monotonic()
    every = sound()
    source = GeneratedScenes()
    stream = Stream(source, seed)
    against: dict[str, Any] = {}
    trial = 0
    while time.monotonic() - began < seconds:
        numbers = round_of(trial)
        genomes = [stream.genome(number) for number in numbers]
        for number, genome in zip(numbers, genomes, strict=True):
            trial = number + 1
            try:
                laid = source.case(genome)
                tried = Trial.of(laid)
                stream.learn(number, genome, features(tried, source.called(laid)))
            except InputError:
                continue
            for subject in every:
                said = tried.problem(subject)
                if said:
                    against[f"{subject.name} {number}"] = [said, source.written(genome)]
                    print(subject.name, number, said, flush=True)
    return {"seed": seed, "trials": trial, "against": against, "methods": len(every)}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("kind", choices=("generated", "random", "sound"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=1200.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--unguided", action="store_true")
    parser.add_argument("--one-each", action="store_true", help="one method per fault")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    if given.kind == "sound":
        result = sound_ones(given.seed, given.seconds)
    else:
        result = benchmark(given)
        print(
            f"{given.kind}, seed {given.seed}: {len(result['found'])} of {result['subjects']} "
            f"in {result['trials']} trials, {result['seconds']} s",
            flush=True,
        )
    given.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
