"""What each culler costs and saves in pixels, lookups, queries, triangles and draws, beside `none`
and `frustum` where the same run judged them.

Fragments are counted where they were asked for (`visref run --fragments`); what was not counted in
every judged frame, as by a culler that broke down, is None. All numbers are means over frames,
views of a frame together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import fmean

from visref.report.summary import of_frames
from visref.run_folder.read import RunFolder

BASELINES = ("none", "frustum")


@dataclass(frozen=True)
class Quantity:
    """One column. `counter`: of `QueryStats`. `of`: the baseline's counter of which it is a share.
    `saved`: it is what the baseline has more of. `by_unit`: comparable only where both decide about
    the same kind of units."""

    key: str
    name: str
    meaning: str
    counter: str
    of: str
    saved: bool = False
    by_unit: bool = False


QUANTITIES = (
    Quantity("box_fragments", "box fragments", "samples that query boxes cover",
             "query_fragments", "depth_tests"),
    Quantity("box_fragments_passed", "of boxes that passed",
             "of these, those of boxes that were found visible: what a map saves in Staneker's "
             "Table 2", "query_fragments_passed", "depth_tests"),
    Quantity("depth_tests", "depth tests", "fragments of drawing and of queries",
             "depth_tests", "depth_tests"),
    Quantity("lookups", "lookups", "depths looked up where others rasterise a box",
             "lookups", "depth_tests"),
    Quantity("queries", "queries", "asked of the depth buffer", "queries", "units_drawn"),
    Quantity("queries_skipped", "queries skipped", "that the method itself saved",
             "tests_skipped", "units_drawn"),
    Quantity("triangles_saved", "triangles saved", "that the baseline draws and it does not",
             "triangles_drawn", "triangles_drawn", saved=True),
    Quantity("draws_saved", "draws saved", "units that the baseline draws and it does not",
             "units_drawn", "units_drawn", saved=True, by_unit=True),
)  # fmt: skip


@dataclass(frozen=True)
class Amount:
    """A culler's number of a quantity, and its share of each baseline's, 1 for all of it; None for
    what was not counted or has no baseline. Saved is measured against the first baseline."""

    value: float | None
    shares: Mapping[str, float | None]


@dataclass(frozen=True)
class Savings:
    """`rows`: by culler, by quantity's key; a culler of which nothing was counted has none.
    `baselines`: which were judged in this run, by the culler's name. `frames`: how many frames the
    means are over."""

    rows: Mapping[str, Mapping[str, Amount]]
    baselines: Mapping[str, str]
    frames: int

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Those that at least one culler has a number of."""
        return tuple(
            quantity
            for quantity in QUANTITIES
            if any(row[quantity.key].value is not None for row in self.rows.values())
        )


def savings(run: RunFolder) -> Savings | None:
    """What a run's cullers cost and save, None where nothing was counted."""
    cullers = [culler for culler in run.cullers if run.frames_of[culler]]
    if not cullers:
        return None
    frames = set(run.frame_numbers)
    baselines = baselines_of(run)
    means = {culler: _means(run, culler, frames) for culler in cullers}
    units = {culler: run.manifest.cullers[culler].unit_kind for culler in cullers}
    rows = {
        culler: {
            quantity.key: _amount(
                quantity,
                means[culler],
                {
                    kind: means[name]
                    for kind, name in baselines.items()
                    if not quantity.by_unit or units[name] == units[culler]
                },
            )
            for quantity in QUANTITIES
        }
        for culler in cullers
    }
    rows = {
        culler: row
        for culler, row in rows.items()
        if any(amount.value is not None for amount in row.values())
    }
    found = Savings(rows, baselines, len(frames))
    return found if found.quantities else None


def baselines_of(run: RunFolder) -> dict[str, str]:
    """By kind of `BASELINES`, the first culler of that kind which judged a frame of the run."""
    cullers = [culler for culler in run.cullers if run.frames_of[culler]]
    return {
        kind: next(culler for culler in cullers if kind_of(culler) == kind)
        for kind in BASELINES
        if any(kind_of(culler) == kind for culler in cullers)
    }


def kind_of(culler: str) -> str:
    """A culler's name without its options."""
    return culler.partition(":")[0]


def _means(run: RunFolder, culler: str, frames: set[int]) -> dict[str, float]:
    """Each counter's mean over frames; those that were not counted in every one are left out."""
    found = {}
    for counter in {name for quantity in QUANTITIES for name in (quantity.counter, quantity.of)}:
        sums = of_frames(run.frames_of[culler], counter)
        if frames and frames <= sums.keys():
            found[counter] = fmean(sums[frame] for frame in frames)
    return found


def _amount(
    quantity: Quantity, own: Mapping[str, float], of: Mapping[str, Mapping[str, float]]
) -> Amount:
    value = own.get(quantity.counter)
    if value is None:
        return Amount(None, dict.fromkeys(of))
    parts = {
        kind: None if (whole := other.get(quantity.of)) is None else whole - value
        for kind, other in of.items()
    }
    if not quantity.saved:
        parts = dict.fromkeys(of, value)
    shares = {
        kind: part / whole if part is not None and (whole := of[kind].get(quantity.of)) else None
        for kind, part in parts.items()
    }
    return Amount(next(iter(parts.values()), None) if quantity.saved else value, shares)
