"""J. T. Klosowski, C. T. Silva: Efficient Conservative Visibility Culling Using the
Prioritized-Layered Projection Algorithm. IEEE TVCG 7(4), 2001.

What cPLP saves of the z-tests in a view (section 4, Fig. 7), and how much of a view PLP alone finds
(section 1). The paper's models are not available: `skyscraper` and `city` stand for them, and
figures compare in ratio and order.
"""

from __future__ import annotations

from collections.abc import Mapping
from statistics import fmean
from typing import Any

from visref.papers.contents import (
    Claim,
    Curve,
    Estimate,
    Figure,
    Published,
    Row,
    Sense,
    Series,
    Table,
    least,
    printed_curve,
    ratio_of,
    series,
    single,
)
from visref.papers.culler_frames import culler_frames
from visref.papers.klosowski2001_ways import FASTEST_BUDGET, LEAF_TRIANGLES, value_of
from visref.papers.printed.klosowski2001 import (
    DEPTH_COMPLEXITY,
    PLP_DRAWS,
    PLP_FINDS,
    PLP_WRONG,
)
from visref.run_folder.read import RunFolder

# The paper names no budget here. One beyond what shows draws, and tests, more than it saves.
TOWER_BUDGETS = (1_000, 10_000, FASTEST_BUDGET)
FRUSTUM = "frustum"
JUDGED = f"budget {FASTEST_BUDGET:,}"
TOWER = {
    FRUSTUM: "cplp:order=frustum,fragments=true",
    **{f"budget {budget:,}": f"cplp:budget={budget},fragments=true" for budget in TOWER_BUDGETS},
    f"{JUDGED}, solidity from primitive counts": (
        f"cplp:budget={FASTEST_BUDGET},solidity=count,fragments=true"
    ),
    f"{JUDGED}, back faces of boxes drawn too": (
        f"cplp:budget={FASTEST_BUDGET},backfaces=true,fragments=true"
    ),
}
ONE_VIEW, PATH = "one view", "along the path"

CITY = "city:scale=0.65"
CITY_BUDGETS = (10_000, 25_000, 50_000, 100_000)
TENTH = 50_000

# The sweep's solidities, in words; the second is the paper's.
SOLIDITIES = {"area": "solidity from areas", "count": "solidity from primitive counts"}
SMALL_LEAF = 2_500


def depth_complexity(runs: Mapping[str, RunFolder | None]) -> Table:
    """Z-tests a pixel, in one view as the paper has it and along the path. It does not say whether
    its own count the queries' boxes; the claim is judged with them."""
    before, after = DEPTH_COMPLEXITY
    saved = ratio_of(before, after)
    rows: list[Row] = []
    judged: dict[str, Estimate | None] = {}
    for where, run in runs.items():
        tests, asking = _tests(run)
        frustum = tests.get(FRUSTUM)
        note = ""
        if run is not None and not run.manifest.settings.get("cull_backfaces"):
            note = "back faces are drawn too: run with --cull-backfaces"
        rows.append(Row(f"{where}: VF-BF", before, value_of(frustum), digits=2, note=note))
        for name in TOWER:
            if name == FRUSTUM or (run is not None and name not in tests):
                continue
            both, asked = tests.get(name), asking.get(name)
            drawing = both - asked if both is not None and asked is not None else None
            at = f"{where}, {name}"
            rows += [
                Row(f"{at}: cPLP, drawing and queries", after, value_of(both), digits=2),
                Row(f"{at}: cPLP, drawing alone", after, value_of(drawing), digits=2),
                Row(f"{at}: VF-BF over drawing and queries", saved, value_of(_over(frustum, both)),
                    digits=2),
                Row(f"{at}: VF-BF over drawing alone", saved, value_of(_over(frustum, drawing)),
                    digits=2),
            ]  # fmt: skip
        judged[where] = _over(frustum, tests.get(JUDGED))
    claims = {
        where: Claim(
            f"{where}: cPLP needs {saved.amount:.2f} times fewer z-tests a pixel than VF-BF, its "
            f"queries' own among them, on a budget of {FASTEST_BUDGET:,}",
            Sense.AT_LEAST,
            ours,
            saved,
        )
        for where, ours in judged.items()
    }
    return Table(
        "Z-tests a pixel",
        "section 4, Fig. 7",
        tuple(rows),
        tuple(claim for where, claim in claims.items() if where == ONE_VIEW),
        own=tuple(claim for where, claim in claims.items() if where != ONE_VIEW),
    )


def _tests(run: RunFolder | None) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    """By `TOWER`'s names: z-tests a pixel, and those of the queries alone."""
    tests: dict[str, Estimate] = {}
    asking: dict[str, Estimate] = {}
    if run is not None:
        pixels = fmean(width * height for width, height in map(run.size, run.frame_numbers))
        for name, culler in TOWER.items():
            if culler in run.frames_of:
                one = culler_frames(run, culler)
                asking[name] = _mean(one.series("query_fragments")) / pixels
                tests[name] = _mean(one.series("depth_tests")) / pixels
    return tests, asking


def _mean(counted: Series) -> Estimate:
    """Over frames; of one view it is the count itself, which stands for no others."""
    mean = counted.mean()
    return mean if len(counted.frames) > 1 else single(mean.value)


def _over(one: Estimate | None, other: Estimate | None) -> Estimate | None:
    return one / other if one is not None and other is not None else None


def quality(run: RunFolder | None, found: Mapping[str, Any] | None) -> Table:
    """PLP alone by budget, as it is here: visible triangles found, from the experiment; wrong
    pixels, which are the samples missed, from the judged run."""
    shares: dict[int, Estimate] = {}
    if found is not None:
        shares = {
            budget: series(by_frame, range(len(by_frame)), CITY).mean()
            for budget, by_frame in zip(found["budgets"], found["found"], strict=True)
        }
    rows: list[Row] = []
    wrong: dict[int, Estimate] = {}
    for budget in CITY_BUDGETS:
        mean = None
        if run is not None:
            one = culler_frames(run, f"plp:budget={budget}")
            lost = [row.missed_pixels / run.samples_of(row) for row in one.rows]
            by_frame = series(lost, one.frames, CITY)
            mean, wrong[budget] = by_frame.mean(), by_frame.most()
        rows += _found_and_wrong(
            f"budget {budget:,}",
            shares.get(budget),
            wrong.get(budget),
            published=budget == TENTH,
        )
        average = f"budget {budget:,}: wrong pixels, on average"
        rows.append(Row(average, None, value_of(mean), "%", 2))
    return Table(
        f"PLP alone in a city of 500,000 triangles, {SOLIDITIES['area']}",
        "section 1",
        tuple(rows),
        own=_finds("PLP by areas", shares.get(TENTH), wrong.get(TENTH)),
    )


def _found_and_wrong(
    at: str, found: Estimate | None, wrong: Estimate | None, *, published: bool
) -> list[Row]:
    finds: Published | None = PLP_FINDS if published else None
    worst: Published | None = PLP_WRONG if published else None
    return [
        Row(f"{at}: visible triangles found", finds, value_of(found), "%", 1),
        Row(f"{at}: wrong pixels, at worst", worst, value_of(wrong), "%", 2),
    ]


def _finds(who: str, found: Estimate | None, wrong: Estimate | None) -> tuple[Claim, Claim]:
    return (
        Claim(
            f"on a tenth of the triangles {who} finds {PLP_FINDS.value:.0f} % of the visible",
            Sense.AT_LEAST,
            found,
            PLP_FINDS,
            even=PLP_DRAWS.amount,
            unit="%",
            digits=1,
        ),
        Claim(
            f"on a tenth of the triangles {who} gets {PLP_WRONG.value:.0f} % of a frame's pixels "
            "wrong at worst",
            Sense.AT_MOST,
            wrong,
            PLP_WRONG,
            even=None,
            unit="%",
        ),
    )


def sweep(found: Mapping[str, Any] | None) -> Table:
    """PLP alone on a tenth of the triangles, by its leaves and by what solidity is taken from. The
    paper does not say what leaves its figures had; those of its section 4 stand for them."""
    rows: list[Row] = []
    shares: dict[str, dict[int, Estimate]] = {}
    wrong: dict[str, dict[int, Estimate]] = {}
    for solidity, said in SOLIDITIES.items():
        swept: list[dict[str, Any]] = [{"leaf": LEAF_TRIANGLES}]
        if found is not None:
            swept = found["sweep"][solidity]
        shares[solidity], wrong[solidity] = {}, {}
        for one in swept:
            leaf = one["leaf"]
            if found is not None:
                frames = range(len(one["found"]))
                shares[solidity][leaf] = series(one["found"], frames, CITY).mean()
                wrong[solidity][leaf] = series(one["wrong"], frames, CITY).most()
            rows += _found_and_wrong(
                f"{said}, leaves under {leaf:,}",
                shares[solidity].get(leaf),
                wrong[solidity].get(leaf),
                published=leaf == LEAF_TRIANGLES,
            )
    paper, ours = shares["count"], shares["area"]
    small = [share for leaf, share in ours.items() if leaf <= SMALL_LEAF]
    own = Claim(
        f"on a tenth of the triangles PLP by areas finds {PLP_FINDS.value:.0f} % of the visible "
        f"at leaves under {SMALL_LEAF:,} and every smaller size tried",
        Sense.AT_LEAST,
        least(*small) if small else None,
        PLP_FINDS,
        even=PLP_DRAWS.amount,
        unit="%",
        digits=1,
    )
    return Table(
        "PLP alone by the size of its leaves",
        "section 1",
        tuple(rows),
        _finds(
            "PLP by primitive counts",
            paper.get(LEAF_TRIANGLES),
            wrong["count"].get(LEAF_TRIANGLES),
        ),
        own=(own,),
        figure=_sweep_figure(shares),
    )


def _sweep_figure(shares: Mapping[str, Mapping[int, Estimate]]) -> Figure | None:
    leaves = sorted({leaf for of in shares.values() for leaf in of})
    if len(leaves) < 2:
        return None
    curves = [
        Curve(
            SOLIDITIES[solidity],
            tuple(map(float, sorted(of))),
            tuple(of[leaf].value for leaf in sorted(of)),
        )
        for solidity, of in shares.items()
    ]
    ends = (float(leaves[0]), float(leaves[-1]))
    curves.append(printed_curve("paper, leaves not said", ends, [PLP_FINDS, PLP_FINDS]))
    return Figure(
        "triangles a leaf, fewer than",
        "share of the visible triangles",
        tuple(curves),
        log_x=True,
    )
