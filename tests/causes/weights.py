"""Finds the weights of `visref.causes.weighing` from the known faults that are not kept back.

    python -m tests.causes.weights [--only GLOB] [--but GLOB] [--spent] [--every N] [--workers N]

Each fault gives one choice: of the causes that explain enough of what it lost, each by its
likeliest hypothesis, a right one should be taken, and none where no right one is among them. The
weights are those under which that is likeliest over all faults, a fault counting by the root of how
many objects it lost, with a small charge for going far from those now in use; they are found by
steps up the slope (Adam), from these.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from tests.causes.catalogue import FAULTS
from tests.causes.drawn import KEPT_BACK
from tests.causes.fault import Fault
from visref.causes.evidence import Evidence
from visref.causes.search import Search
from visref.causes.sights import Moments, Sights
from visref.causes.weighing import WEIGHTS, features, likelihoods
from visref.engines import TruthEngine, make_engine
from visref.judging.referee import Referee
from visref.registry import DEFAULT_ENGINE
from visref.timeline import Timeline

# Objects of one fault beyond so many count no more.
MOST_OBJECTS = 40
STEPS, RATE, SLOWER, CHARGE = 60, 0.3, 0.97, 0.03
# Lots of faults that people reported.
REPORTED = frozenset({"reported", "spare", "later", "recent", "newest"})


@dataclass(frozen=True, eq=False)
class Choice:
    """`features`: (k, f) float64, of hypotheses; `cause`: (k,) int; `right`: (k,) bool; `weight`:
    what the fault counts for."""

    features: NDArray[np.float64]
    cause: NDArray[np.int64]
    right: NDArray[np.bool_]
    weight: float


def choice(fault: Fault) -> Choice | None:
    """None where there is nothing to choose, as no cause explains enough."""
    given = fault.make()
    timeline = Timeline(given.scene, given.path)
    evidence = Evidence()

    def engine() -> TruthEngine:
        return make_engine(DEFAULT_ENGINE, timeline.still)

    frames = list(given.path.numbers)
    outcome = Referee(given.scene, engine, timeline=timeline).run(
        given.path, frames, [(fault.name, given.culler)], [evidence]
    )
    answers = evidence.answers[fault.name]
    if not answers.lossy:
        return None
    moments = Moments(timeline, given.path.relative_to(timeline.still.origin), frames, engine)
    search = Search(Sights(moments, answers), answers, outcome.cullers[0])
    weighed = search.weighed(search.look_closely())
    lost = weighed.told.lost
    tried = weighed.candidates(lost) if lost.any() else []
    moments.close()
    causes = sorted({one.hypothesis.cause for one in tried})
    right = np.array([one.hypothesis.cause in fault.accepted for one in tried], np.bool_)
    if not len(tried):
        return None
    objects = sum(len(answer.missed) for answer in answers.lossy)
    return Choice(
        np.array([features(one.hypothesis, one.culled, weighed.told, lost) for one in tried]),
        np.array([causes.index(one.hypothesis.cause) for one in tried]),
        right,
        float(np.sqrt(min(objects, MOST_OBJECTS))),
    )


def found(choices: Sequence[Choice], start: NDArray[np.float64]) -> NDArray[np.float64]:
    """The weights, (f,), under which right causes are likeliest."""
    weights = start.copy()
    mean, square = np.zeros_like(weights), np.zeros_like(weights)
    total = sum(one.weight for one in choices)
    for step in range(1, STEPS + 1):
        slope = -CHARGE * (weights - start)
        slope[-1] = 0.0
        for one in choices:
            worth = one.features @ weights[:-1]
            order = np.lexsort((-worth, one.cause))
            causes = one.cause[order]
            best = order[np.append(True, causes[1:] != causes[:-1])]
            likely = likelihoods(worth[best], float(weights[-1]))
            right = np.append(one.right[best], not one.right.any())
            among = np.where(right, likely, 0.0)
            among /= max(float(among.sum()), 1e-12)
            more = one.weight / total * (among - likely)
            slope[:-1] += more[:-1] @ one.features[best]
            slope[-1] += more[-1]
        mean = 0.9 * mean + 0.1 * slope
        square = 0.99 * square + 0.01 * slope**2
        rate = RATE * SLOWER ** (step - 1)
        weights += rate * (mean / (1 - 0.9**step)) / (np.sqrt(square / (1 - 0.99**step)) + 1e-8)
    return weights


def choice_of(name: str) -> Choice | None:
    return choice(FAULTS[name])


def choices(names: Sequence[str], workers: int) -> list[Choice]:
    """In the order of the names, so that the same weights are found with any number of workers."""
    with get_context("spawn").Pool(workers) as pool:
        made = []
        for name, one in zip(names, pool.imap(choice_of, names), strict=True):
            sys.stderr.write(f"{name}: {'nothing to choose' if one is None else 'a choice'}\n")
            made.append(one)
    return [one for one in made if one is not None]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.causes.weights", description=__doc__)
    parser.add_argument("--only", default="*", metavar="GLOB", help="names of faults")
    parser.add_argument("--but", default="", metavar="GLOB", help="names of faults left out")
    parser.add_argument(
        "--every", type=int, default=1, metavar="N", help="of the suites' faults so many fewer"
    )
    parser.add_argument("--spent", action="store_true", help="those too that were kept back once")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes")
    asked = parser.parse_args(arguments)
    some = [name for name in FAULTS if asked.spent or name not in KEPT_BACK]
    some = [name for name in some if not fnmatchcase(name, asked.but)]
    people = [name for name in some if name.split("/")[0] in REPORTED]
    suites = sorted(name for name in some if name.split("/")[0] not in REPORTED)
    chosen = {*people, *suites[asked.every // 4 :: asked.every]}
    names = [name for name in some if name in chosen and fnmatchcase(name, asked.only)]
    weights = found(choices(names, asked.workers), np.array(list(WEIGHTS.values())))
    for name, value in zip(WEIGHTS, weights, strict=True):
        sys.stdout.write(f'    "{name}": {value:.2f},\n')
    return 0


if __name__ == "__main__":
    sys.exit(main())
