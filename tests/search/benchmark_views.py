"""How many trials views of one scene take until a planted fault is found: guided, or anywhere.

    python -m tests.search.benchmark_views SCENE --seeds 3 --most 200

For faults of each place where views go wrong: at the near plane, with the eye in a box, and in the
depth that hides. *Guided* is what `visref fuzz --scene` does; *anywhere* draws eye and direction
evenly within the scene's bounds, and learns nothing.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable
from dataclasses import replace

from tests.search.subjects import subjects
from visref.culler import Culler
from visref.search.stream import Stream, round_of
from visref.search.suspects import Made
from visref.search.trying import Asked, Trier
from visref.search.views import ViewsOf

PLANTED = (
    "wrong near-too-large",
    "wrong eye-inside-dropped",
    "G1-CornersBehindTheEye-occupancy-map-one",
    "G3-SizeRoundedToNearest-lazy-grid-gl",
    "G4-LastColumnLeftOut-n-buffer-four",
    "G7-DepthReadBackInSixteenBits-n-buffer-four",
    "U8-OneTexelOff-n-buffer-four",
    "U11-HalfFloatLevels-n-buffer-four",
)


def trials_until_found(
    make: Callable[[], Culler], source: ViewsOf, seed: int, most: int, *, guided: bool
) -> int | None:
    """The number of the first trial with a violation, from 1; None where there is none."""
    source = replace(source, hard=guided, seed=seed)
    stream = Stream(source, seed, guided=guided)
    trier = Trier(Asked(scene="given"), Made("planted", make), source)
    for first in range(0, most, trier.together):
        numbers = range(first, min(first + trier.together, most, round_of(first).stop))
        genomes = {number: stream.genome(number) for number in numbers}
        task = [(number, source.written(genome)) for number, genome in genomes.items()]
        for outcome in trier.try_all(task):
            if outcome.violations:
                return outcome.trial + 1
            if not outcome.skipped:
                stream.learn(outcome.trial, genomes[outcome.trial], outcome.features)
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scene")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--most", type=int, default=200)
    given = parser.parse_args()
    by_name = {one.name: one for one in subjects()}
    source = Asked(scene=given.scene).source(moves=False)
    assert isinstance(source, ViewsOf)
    for name in PLANTED:
        told = []
        for guided in (True, False):
            found = [
                trials_until_found(by_name[name].make, source, seed, given.most, guided=guided)
                for seed in range(given.seeds)
            ]
            middle = statistics.median(given.most + 1 if one is None else one for one in found)
            told.append(f"{'guided' if guided else 'anywhere'} {found}, median {middle:g}")
        print(f"{name}: {'; '.join(told)}", flush=True)


if __name__ == "__main__":
    main()
