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
import heapq
import json
import multiprocessing
import time
from collections.abc import Callable, Sequence
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


def search(
    every: Sequence[Subject],
    kind: str,
    seed: int,
    seconds: float,
    guided: bool,
    shown: Callable[[dict[str, Any]], None] = lambda _: None,
) -> dict[str, Any]:
    """Trials until all subjects are found or the time is over: `found`, `{name: [trials, own
    seconds, seconds of all, words]}`, and `tried`, the trials that each
    of the others went through. Time is this process's processor time, so that what else a machine
    does is not counted; it is shared evenly: who is slow makes fewer trials. `shown` is told how
    far it is now and then."""

    def so_far() -> dict[str, Any]:
        return {
            "found": found,
            "tried": {every[place].name: number for _, place, number in queue},
            "trials": len(trials.made),
            "seconds": round(time.process_time() - began, 1),
        }

    began = told = time.process_time()
    trials = Trials(kind, seed, guided)
    found: dict[str, Any] = {}
    # Seconds spent, the subject's place, trials made.
    queue = [(0.0, place, 0) for place in range(len(every))]
    while queue and time.process_time() - began < seconds:
        spent, place, number = heapq.heappop(queue)
        trial, subject = trials[number], every[place]
        start = time.process_time()
        said = "" if trial is None else trial.problem(subject)
        spent += time.process_time() - start
        if said:
            at = time.process_time() - began
            found[subject.name] = [number + 1, round(spent, 2), round(at, 1), said]
        else:
            heapq.heappush(queue, (spent, place, number + 1))
        if time.process_time() - told > _TOLD_EVERY:
            told = time.process_time()
            shown(so_far())
    return so_far()


def chosen(one_each: bool) -> list[Subject]:
    """All subjects, or the first of each fault."""
    every = subjects()
    return list({one.fault: one for one in reversed(every)}.values())[::-1] if one_each else every


def _part(of: tuple[int, int, str, int, float, bool, bool, Path]) -> dict[str, Any]:
    part, parts, kind, seed, seconds, guided, one_each, out = of
    every = chosen(one_each)[part::parts]
    beside = out.with_suffix(f".part{part}")

    def shown(result: dict[str, Any]) -> None:
        beside.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")

    return search(every, kind, seed, seconds, guided, shown)


def benchmark(given: argparse.Namespace) -> dict[str, Any]:
    """The same over several processes, each with its share of the subjects; how far each is stands
    in a file beside `out`."""
    guided = not given.unguided
    asked = (given.kind, given.seed, given.seconds, guided, given.one_each, given.out)
    shares = [(part, given.workers, *asked) for part in range(given.workers)]
    with multiprocessing.get_context("spawn").Pool(given.workers) as pool:
        parts = pool.map(_part, shares, chunksize=1)
    every = chosen(given.one_each)
    found = {name: row for part in parts for name, row in part["found"].items()}
    return {
        "kind": given.kind,
        "seed": given.seed,
        "guided": guided,
        "seconds": round(sum(part["seconds"] for part in parts), 1),
        "trials": max(part["trials"] for part in parts),
        "subjects": len(every),
        "found": {one.name: found[one.name] for one in every if one.name in found},
        "not_found": {name: n for part in parts for name, n in sorted(part["tried"].items())},
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
