"""J. T. Klosowski, C. T. Silva: Efficient Conservative Visibility Culling Using the
Prioritized-Layered Projection Algorithm. IEEE TVCG 7(4), 2001.

Its times: of a frame by the way of asking (Figs. 6 and 8, section 4), of the primitive operations
(Table 2), of a query (section 3), and of what comes before the first frame (section 4). They belong
to machines of 2001 and compare as ratios within one run. The paper averages them over the frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from visref.papers.contents import (
    Basis,
    Claim,
    Curve,
    Estimate,
    Figure,
    Published,
    Results,
    Row,
    Sense,
    Table,
    least,
    one_more,
    product_of,
    ratio_of,
    single,
)
from visref.papers.culler_frames import culler_frames
from visref.papers.printed.klosowski2001 import (
    EXT_HZ,
    EXT_OVER_HP,
    FASTER_THAN_VF_BF,
    FEWER_A_LEAF,
    HISTOGRAM_US,
    HP_HZ,
    PREPROCESSING_S,
    QUERY_US,
    SECONDS,
    TABLE_2,
    TABLE_3,
)
from visref.run_folder.read import RunFolder

LEAF_TRIANGLES = int(FEWER_A_LEAF.value)
FASTEST_BUDGET = 25_000

EXT, HP, IB, HG = "fragment-histogram", "occlusion-query", "item-buffer", "histogram"
LABELS = {
    EXT: "cPLP-EXT",
    HP: "cPLP-HP",
    IB: "cPLP-IB",
    HG: "cPLP-HG",
    f"{IB},image=restore": "cPLP-IB, picture restored (3.5)",
    f"{HG},image=restore": "cPLP-HG, picture restored (3.5)",
}
SOME_BUDGETS = (1_000, FASTEST_BUDGET, 100_000)
WAY_BUDGETS = {way: (FASTEST_BUDGET,) if "restore" in way else SOME_BUDGETS for way in LABELS} | {
    EXT: tuple(TABLE_3)
}
VF_BF = "cplp:order=frustum"
HP_ALONE = "cplp:order=front-to-back,query=occlusion-query"


def spec(way: str, budget: int) -> str:
    """cPLP that asks in one way of `LABELS`, with the paper's leaves."""
    return f"cplp:query={way},budget={budget},leaf={LEAF_TRIANGLES}"


CULLERS = (*(spec(way, b) for way in LABELS for b in WAY_BUDGETS[way]), HP_ALONE, VF_BF)


def times(run: RunFolder | None) -> Table:
    """A frame's time by the way of asking and the budget."""
    ms: dict[str, dict[int, Estimate]] = {}
    alone: dict[str, Estimate] = {}
    if run is not None:
        ms = {
            way: {
                budget: culler_frames(run, spec(way, budget)).ms_series().mean()
                for budget in WAY_BUDGETS[way]
            }
            for way in LABELS
        }
        alone = {
            name: culler_frames(run, culler).ms_series().mean()
            for name, culler in (("HP", HP_ALONE), ("VF-BF", VF_BF))
        }
    rows = [
        Row(f"{label}, budget {budget:,}", None, value_of(ms.get(way, {}).get(budget)), "ms", 1,
            Basis.HARDWARE)
        for way, label in LABELS.items()
        for budget in WAY_BUDGETS[way]
    ]  # fmt: skip
    rows += [Row(f"{name}, no budget", None, value_of(alone.get(name)), "ms", 1, Basis.HARDWARE)
             for name in ("HP", "VF-BF")]  # fmt: skip
    at_25k = {way: by_budget[FASTEST_BUDGET] for way, by_budget in ms.items()} | alone
    # Of the budgets that all were tried on: a way that is tried more often has more luck.
    at_best = {
        way: least(*(by_budget[budget] for budget in SOME_BUDGETS if budget in by_budget))
        for way, by_budget in ms.items()
    }
    for (machine, way), seconds in SECONDS.items():
        spent = at_25k.get(way)
        name = f"{LABELS.get(way, way)} on the {machine}"
        ours = None if spent is None else spent.value / 1e3
        rows.append(Row(name, seconds, ours, "s", 3, Basis.HARDWARE))
    for way in FASTER_THAN_VF_BF:
        over = ratio_of(SECONDS["Octane", "VF-BF"], SECONDS["Octane", way])
        rows.append(_ratio(f"VF-BF over {LABELS[way]}", over, _gain(at_25k, way, "VF-BF")))
    for machine in ("Octane", "Onyx"):
        over = ratio_of(SECONDS[machine, HG], SECONDS[machine, IB])
        rows.append(_ratio(f"cPLP-HG over cPLP-IB on the {machine}", over, _gain(at_25k, IB, HG)))
    for way, rate in ((EXT, EXT_HZ), (HP, HP_HZ)):
        best = at_best.get(way)
        frames_a_second = None if best is None else 1e3 / best.value
        rows.append(Row(f"{LABELS[way]} at its best budget", rate, frames_a_second, "Hz", 1,
                        Basis.HARDWARE))  # fmt: skip
    rows.append(_ratio("cPLP-HP over cPLP-EXT, each at its best budget", one_more(EXT_OVER_HP),
                       _gain(at_best, EXT, HP)))  # fmt: skip
    curves = tuple(
        Curve(
            LABELS[way],
            tuple(map(float, by_budget)),
            tuple(spent.value for spent in by_budget.values()),
        )
        for way, by_budget in ms.items()
        if len(by_budget) > 1
    )
    return Table(
        "Time a frame",
        "Figs. 6 and 8, section 4",
        tuple(rows),
        _time_claims(at_25k, at_best),
        figure=Figure("budget, triangles", "ms a frame", curves) if curves else None,
    )


def value_of(figure: Estimate | None) -> float | None:
    """The figure without its interval, None where there is none."""
    return None if figure is None else figure.value


def _ratio(quantity: str, published: Published | None, ours: Estimate | None) -> Row:
    return Row(quantity, published, value_of(ours), "", 2, Basis.WITHIN_RUN)


def _gain(ms: Mapping[str, Estimate], way: str, other: str) -> Estimate | None:
    """How many times as fast as another a way is."""
    return ms[other] / ms[way] if ms else None


def _time_claims(ms: Mapping[str, Estimate], at_best: Mapping[str, Estimate]) -> tuple[Claim, ...]:
    """`ms`: at the budget that is fastest in the paper; `at_best`: of each way's own."""
    at = f"at {FASTEST_BUDGET:,}"
    onyx = ratio_of(SECONDS["Onyx", HG], SECONDS["Onyx", IB])
    octane = ratio_of(SECONDS["Octane", HG], SECONDS["Octane", IB])
    return (
        *(
            Claim(
                f"{LABELS[way]} is {times.value:.0f} times as fast as VF-BF, {at}",
                Sense.AT_LEAST,
                _gain(ms, way, "VF-BF"),
                times,
                digits=1,
            )
            for way, times in FASTER_THAN_VF_BF.items()
        ),
        Claim(
            f"cPLP-HP is faster than VF-BF, {at}",
            Sense.AT_LEAST,
            _gain(ms, HP, "VF-BF"),
            digits=1,
        ),
        Claim(
            f"cPLP-IB is considerably faster than cPLP-HG, {onyx.amount:.2f} times, {at}",
            Sense.AT_LEAST,
            _gain(ms, IB, HG),
            onyx,
            told=f"on the Onyx; on the Octane {octane.amount:.2f} times",
        ),
        Claim(
            f"cPLP-EXT is {EXT_OVER_HP.value:.0f} % faster than cPLP-HP, each at its best budget",
            Sense.AT_LEAST,
            _gain(at_best, EXT, HP),
            one_more(EXT_OVER_HP),
            told="theirs is an estimate",
        ),
        Claim(
            f"cPLP-HP is considerably faster than HP without PLP, 2.8 times, {at}",
            Sense.AT_LEAST,
            _gain(ms, HP, "HP"),
            product_of(HP_HZ, SECONDS["Kayak", "HP"]),
        ),
    )


def preprocessing(found: Mapping[str, Any] | None) -> Table:
    """What comes before the first frame. The paper reads text, and so at least half of its time is
    reading; here the file is binary."""
    ours: dict[str, float] = {}
    if found is not None:
        built = found["octree_ms"] + found["neighbours_ms"]
        ours = {
            "in all": found["load_ms"] + built + found["count_ms"],
            "reading the model": found["load_ms"],
            "octree, assignment, solidity": built + found["count_ms"],
            "octree, assignment, solidity from areas": built + found["area_ms"],
        }
    rows = [
        _seconds(f"{what}, {machine}", seconds, ours.get(what))
        for machine, all_of_it in PREPROCESSING_S.items()
        for what, seconds in zip(
            ("in all", "reading the model", "octree, assignment, solidity"), all_of_it, strict=True
        )
    ]
    areas = "octree, assignment, solidity from areas"
    rows.append(_seconds(areas, None, ours.get(areas)))
    return Table("Preprocessing", "section 4", tuple(rows))


def _seconds(quantity: str, published: Published | None, ms: float | None) -> Row:
    return Row(quantity, published, None if ms is None else ms / 1e3, "s", 2, Basis.HARDWARE)


def primitives(found: Mapping[str, Any] | None) -> Table:
    """Table 2, and the histogram beside it."""
    images = {image["side_px"]: image for image in found["images"]} if found is not None else {}
    rows: list[Row] = []
    for side in (64, 512):
        image = images.get(side)
        # All four channels, as the paper reads them.
        ours = {what: image[f"{what}_ms"][-1] for what in ("transfer", "scan")} if image else {}
        for machine, published in TABLE_2.items():
            for what, us in zip(("transfer", "scan"), published[side], strict=True):
                rows.append(_hardware(f"{what} of {side}², {machine}", us, ours.get(what)))
        for machine, histogram in HISTOGRAM_US.items():
            spent = image["histogram_ms"] if image else None
            rows.append(_hardware(f"histogram of {side}², {machine}", histogram[side], spent))
    return Table("Primitive operations", "Table 2 and section 4", tuple(rows))


def _hardware(quantity: str, published: Published | None, ms: float | None) -> Row:
    return Row(quantity, published, None if ms is None else 1e3 * ms, "µs", 1, Basis.HARDWARE)


# The ways of asking in an experiment's words.
ASKED = {
    "instanced": "-EXT",
    "counted": "-EXT, counters in place of marks",
    "sync": "-HP, one by one",
    "batch": "-HP, in a batch",
    "item-buffer": "-IB",
    "histogram": "-HG",
}


def queries(results: Results, fronts: Mapping[str, str]) -> Table:
    """The cost of a query of each way, all cells of a front at once. `fronts`: scenes by the
    experiment's key."""
    rows: list[Row] = []
    gains: dict[str, list[tuple[int, float]]] = {"sync": [], "batch": []}
    for key, scene in fronts.items():
        found = results.experiment(f"{key}-queries")
        for front in found["fronts"] if found is not None else []:
            ms, cells = front["ms"], front["cells"]
            at = f"{scene.partition(':')[0]}, leaf {front['leaf']:,}, {cells:,} cells"
            if not cells:
                continue
            for way, label in ASKED.items():
                published = QUERY_US if way == "sync" else None
                rows.append(_hardware(f"{at}: {label}", published, ms[way] / cells))
            for way, of_way in gains.items():
                gain = ms[way] / ms["instanced"]
                of_way.append((cells, gain))
                rows.append(Row(f"{at}: {ASKED[way]} over -EXT", None, gain, "", 1,
                                Basis.WITHIN_RUN))  # fmt: skip
    if not rows:
        rows = [_hardware(f"one query: {ASKED['sync']}", QUERY_US, None)]
    claim, own = (
        Claim(
            f"where most cells are asked at once, a cell's query by -EXT is cheaper than by "
            f"{ASKED[way]}",
            Sense.AT_LEAST,
            single(max(gains[way])[1]) if gains[way] else None,
            digits=1,
            told=", ".join(f"{gain:.1f} for {cells:,} cells" for cells, gain in sorted(gains[way])),
        )
        for way in ("sync", "batch")
    )
    return Table("Cost of a query", "sections 3.6 and 4", tuple(rows), (claim,), (own,))
