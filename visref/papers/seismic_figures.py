"""The slides' tables: the runs that they are made of, and the figures taken from these.

See `visref.papers.seismic`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from visref.papers.contents import Claim, Estimate, JudgedRun, Results, Sense, least, most
from visref.papers.culler_frames import CullerFrames, culler_frames
from visref.papers.printed.seismic import WORKS

REDUCTION = int(WORKS.value)

SCENE = "seismic:scale=0.5"
# The same horizons, each one object, as a user's would be; and the tiles of `SCENE`.
WHOLE, TILE = "seismic:scale=0.5,tiled=false", 2048
SIZE = (384, 288)
# Frames in a row, for what happens from one to the next.
DYNAMIC, STRETCH = "busy_street", 5
# The faults have 252 triangles and stand in for themselves, a tile 2,048.
EXTRA = 500

REDUCTIONS = (1, 10, 30, 100, 300, 1000)
CROSSED = (10, 100, 1000)
THRESHOLDS = (0, 5, 20)
SCALES = (1, 4)
CONSERVATIVE = (1, 10, 100, 1000)
FILL_SCALES = (1, 2, 4)
FRUSTUM, BOXES = "frustum", "occlusion-query"
MEASURES = ("deviation", "displacement", "outline")


def published(reduction: int, threshold: int = 0, scale: int = 1) -> str:
    """The spec of the published mode."""
    return _spec(reduction=reduction, threshold=threshold, scale=scale)


def conservative(reduction: int, scale: int = 1) -> str:
    """The spec of the conservative mode."""
    return _spec(mode="conservative", reduction=reduction, scale=scale)


def _spec(**options: Any) -> str:
    values = ",".join(f"{key}={value}" for key, value in options.items())
    return f"three-pass:{values},extra={EXTRA}"


def counted(spec: str) -> str:
    return f"{spec}{',' if ':' in spec else ':'}fragments=true"


def boxed(reduction: int) -> str:
    """The published mode with boxes asked in the second pass instead of stand-ins."""
    return f"{published(reduction)},ask=boxes"


def in_tiles(spec: str) -> str:
    """The same, of objects that the method divides."""
    return f"{spec},tile={TILE}"


CROSS = tuple(itertools.product(CROSSED, THRESHOLDS, SCALES))
PUBLISHED_SPECS = dict.fromkeys(
    [published(reduction) for reduction in REDUCTIONS]
    + [published(*at) for at in CROSS]
    + [boxed(reduction) for reduction in REDUCTIONS]
)
UNDIVIDED = (published(REDUCTION), conservative(REDUCTION))
FILLED = [FRUSTUM, published(1), *(published(REDUCTION, scale=scale) for scale in FILL_SCALES)]

JUDGED = (
    JudgedRun("published", SCENE, (FRUSTUM, BOXES, *PUBLISHED_SPECS), size=SIZE),
    JudgedRun(
        "conservative",
        SCENE,
        tuple(conservative(*at) for at in itertools.product(CONSERVATIVE, SCALES)),
        size=SIZE,
    ),
    JudgedRun("undivided", WHOLE, (FRUSTUM, *UNDIVIDED, *map(in_tiles, UNDIVIDED)), size=SIZE),
    JudgedRun("fill", SCENE, tuple(map(counted, FILLED)), size=SIZE),
    JudgedRun(
        "dynamic",
        DYNAMIC,
        (FRUSTUM, BOXES, published(REDUCTION), conservative(REDUCTION)),
        size=SIZE,
        stretch=STRETCH,
    ),
)
ByCuller = Mapping[str, CullerFrames]


def measured(results: Results, judged: JudgedRun) -> dict[str, CullerFrames]:
    run = results.run(judged.key)
    return {} if run is None else {spec: culler_frames(run, spec) for spec in judged.cullers}


def mean_of(by_spec: ByCuller, spec: str, counter: str) -> Estimate | None:
    one = by_spec.get(spec)
    return None if one is None else one.series(counter).mean()


def quotient(part: Estimate | None, whole: Estimate | None) -> Estimate | None:
    if part is None or whole is None or not whole.value:
        return None
    return part / whole


def number(figure: Estimate | None) -> float | None:
    return None if figure is None else figure.value


def missed_of(by_spec: ByCuller, spec: str) -> Estimate | None:
    """Missed objects over visible ones."""
    return quotient(mean_of(by_spec, spec, "confirmed"), mean_of(by_spec, spec, "visible"))


def lost_of(by_spec: ByCuller, spec: str) -> Estimate | None:
    """Samples lost over those of the image."""
    lost = mean_of(by_spec, spec, "missed_pixels")
    return None if lost is None else lost / (SIZE[0] * SIZE[1])


def wasted_of(by_spec: ByCuller, spec: str) -> Estimate | None:
    """What is drawn for nothing, of what is drawn."""
    return quotient(mean_of(by_spec, spec, "superfluous"), mean_of(by_spec, spec, "drawn"))


def least_step(runs: Iterable[Sequence[Estimate | None]]) -> Estimate | None:
    """The least step from one figure to the next, over several sequences; None where a figure was
    not measured."""
    steps = []
    for figures in runs:
        for before, after in itertools.pairwise(figures):
            if before is None or after is None:
                return None
            steps.append(after - before)
    return least(*steps) if steps else None


def never_less(statement: str, step: Estimate | None, **shown: Any) -> Claim:
    """A claim that a sequence does not fall, by its least step."""
    return Claim(f"{statement}: the least step", Sense.AT_LEAST, step, even=0.0, ties=True, **shown)


def most_missed(by_spec: ByCuller, specs: Iterable[str]) -> Estimate | None:
    """The most objects that any of several cullers misses in a frame."""
    found = [by_spec[spec].series("confirmed").most() for spec in specs if spec in by_spec]
    return most(*found) if found else None


def nothing_missed(statement: str, missed: Estimate | None) -> Claim:
    return Claim(
        f"{statement}: the most objects in a frame",
        Sense.AT_MOST,
        missed,
        even=0.0,
        ties=True,
        digits=0,
    )
