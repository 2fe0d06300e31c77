"""Where to stop paying, said in sentences that the numbers make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from visref.bench.subsets import ALL
from visref.bench.timing import PROBER, REFERENCE, Bench, GeometricRow, ImageRow
from visref.report.words import count, counted, percent

Row = TypeVar("Row")

# What leaving no numeric error may cost, as a multiple of the float32 engine's time, and still
# be the advice: the project's own goal for the exact engine.
WORTH = 2.0


def pareto(
    rows: Sequence[Row], cost: Callable[[Row], float], error: Callable[[Row], float]
) -> list[Row]:
    """The rows than which none is both cheaper and no worse (or as cheap and better), by cost."""
    front: list[Row] = []
    for row in sorted(rows, key=lambda row: (cost(row), error(row))):
        if not front or error(row) < error(front[-1]):
            front.append(row)
    return front


def headline(bench: Bench) -> str:
    """The advice in a few words."""
    exact, ray = _whole(bench, REFERENCE), _whole(bench, PROBER)
    if exact.seconds <= WORTH * ray.seconds:
        return "Pay for exact, no more"
    return f"Stop at {PROBER}"


def sentences(bench: Bench) -> list[str]:
    """The numeric error, the sampling error and the definitional one, a sentence each."""
    return [_numeric(bench), _sampling(bench), _definitional(bench)]


def _numeric(bench: Bench) -> str:
    exact, ray = _whole(bench, REFERENCE), _whole(bench, PROBER)
    wrong = ray.numeric_wrong_samples
    ratio = f"{exact.seconds / ray.seconds:.1f}×"
    missed = counted(ray.numeric_missed, "visible object") if ray.numeric_missed else "none of them"
    blame = (
        f"gives {counted(wrong, 'sample')} of {count(bench.samples)} to a wrong object, and of "
        f"{count(exact.visible)} visible objects misses {missed}"
    )
    if exact.seconds <= WORTH * ray.seconds:
        if not wrong:
            return (
                f"Exact costs {ratio} what Embree costs here and leaves no numeric error; Embree "
                "happens to make none on these frames, but cannot know it."
            )
        return (
            f"Exact costs {ratio} what Embree costs here and leaves no numeric error; "
            f"Embree {blame}."
        )
    if not wrong:
        return (
            "Embree makes no numeric error on these frames; exact, which is sure of it, costs "
            f"{ratio} as much."
        )
    return f"Exact costs {ratio} what Embree costs here; Embree {blame}."


def _sampling(bench: Bench) -> str:
    rows = {row.sixteenths: row for row in bench.image if row.engine == REFERENCE}
    whole = rows[ALL]
    partial = [row for row in rows.values() if row.sixteenths < ALL]
    if not partial:
        return "Fewer samples were not tried: the image's sides are not multiples of 4."
    # The cheapest that finds the same objects, else the dearest that does not.
    free = [row for row in partial if not row.sampling_missed]
    row = min(free or partial, key=lambda row: row.sixteenths if free else -row.sixteenths)
    told = f"{_share(row)} of the samples takes {percent(row.seconds / whole.seconds)} of the time"
    if free:
        return f"{told[0].upper()}{told[1:]} and finds the same objects here; the rest buys pixels."
    return (
        f"Do not save samples: {told} and loses {count(row.sampling_missed or 0)} of "
        f"{count(whole.visible)} visible objects."
    )


def _definitional(bench: Bench) -> str:
    aimed = next(row for row in bench.geometric if row.method.endswith("aimed rays"))
    centres = bench.geometric[0]
    jittered = [row for row in bench.geometric if row.bound is not None]
    dearest = max(jittered, key=lambda row: row.rays)
    between = bench.objects_known - centres.found
    if not between:
        return "No object was found to show between the samples alone."
    return (
        f"{counted(between, 'object')} more show between the samples alone: aimed rays find "
        f"{count(aimed.found - centres.found)} of the {count(between)} for "
        f"{aimed.seconds - centres.seconds:.2g} s a frame; {dearest.rays_per_pixel} rays in every "
        f"pixel find {count(between - dearest.missed_of_known)} for {dearest.seconds:.2g} s, and "
        f"leave at most {_tiny(dearest)} of the image to what they have not seen."
    )


def _whole(bench: Bench, engine: str) -> ImageRow:
    return next(row for row in bench.image if (row.engine, row.sixteenths) == (engine, ALL))


def _share(row: ImageRow) -> str:
    return {1: "a sixteenth", 2: "an eighth", 4: "a quarter", 8: "half"}[row.sixteenths]


def _tiny(row: GeometricRow) -> str:
    bound = row.bound or 0.0
    return f"{bound:.1e}" if bound < 1e-3 else percent(bound)
