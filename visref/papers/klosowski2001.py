"""J. T. Klosowski, C. T. Silva: Efficient Conservative Visibility Culling Using the
Prioritized-Layered Projection Algorithm.

IEEE TVCG 7(4), 2001. Section 4, Tables 2 and 3, Figs. 6 to 8; section 1 for PLP alone.

Measured on `soda_hall` and `skyscraper`, laid out like the paper's models, which are not
available, and on `city`. Rounds, triangles and z-tests depend on the scene and compare in ratio
and trend; times (`visref.papers.klosowski2001_ways`) belong to machines of 2001. Back faces are
culled in both models, as the paper does in VF-BF and within cPLP.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from visref.papers.contents import (
    Basis,
    Claim,
    Curve,
    Estimate,
    Experiment,
    Figure,
    JudgedRun,
    Results,
    Row,
    Sense,
    SetUp,
    Size,
    Table,
    most,
    printed_curve,
    ratio_of,
    series,
)
from visref.papers.culler_frames import CullerFrames, culler_frames
from visref.papers.klosowski2001_views import (
    CITY,
    CITY_BUDGETS,
    FRUSTUM,
    ONE_VIEW,
    PATH,
    TOWER,
    depth_complexity,
    quality,
    sweep,
)
from visref.papers.klosowski2001_ways import (
    CULLERS,
    EXT,
    FASTEST_BUDGET,
    IB,
    LABELS,
    LEAF_TRIANGLES,
    preprocessing,
    primitives,
    queries,
    spec,
    times,
    value_of,
)
from visref.papers.printed.klosowski2001 import (
    FEWER_A_LEAF,
    FRAMES,
    LEAVES,
    MANY_TRIANGLES,
    OCTANE_PLP_S,
    SECONDS,
    TABLE_3,
)
from visref.run_folder.read import RunFolder

TITLE = (
    "J. T. Klosowski, C. T. Silva: Efficient Conservative Visibility Culling Using the "
    "Prioritized-Layered Projection Algorithm. IEEE TVCG 7(4), 2001"
)

SIZE: Size = (512, 512)

LEAST_TRIANGLES = 1_000_000
LEAST_BUDGET, MOST_BUDGET = min(TABLE_3), max(TABLE_3)

RUNS = (
    JudgedRun("soda-hall", "soda_hall", CULLERS, SIZE, cull_backfaces=True),
    JudgedRun("skyscraper", "skyscraper", tuple(TOWER.values()), SIZE, cull_backfaces=True),
    JudgedRun(
        "skyscraper-view",
        "skyscraper:frames=1",
        tuple(TOWER.values()),
        SIZE,
        cull_backfaces=True,
    ),
    JudgedRun("city", CITY, tuple(f"plp:budget={budget}" for budget in CITY_BUDGETS), SIZE),
)
FRONTS = {"soda-hall": "soda_hall", "city": CITY}
EXPERIMENTS = (
    Experiment("primitives", "plp-primitives"),
    Experiment("soda-hall-queries", "plp-queries", "soda_hall", SIZE, cull_backfaces=True),
    Experiment("preparation", "plp-preparation", "soda_hall", SIZE, cull_backfaces=True),
    Experiment("times", "plp-times", "soda_hall", SIZE, cull_backfaces=True),
    Experiment("city-queries", "plp-queries", CITY, SIZE),
    Experiment("city-quality", "plp-quality", CITY, SIZE),
    Experiment("city-leaves", "plp-leaves", CITY, SIZE),
)


def tables(results: Results) -> list[Table]:
    """Section 4's scene, Tables 2 and 3, Figs. 6 to 8, the cost of a query, and PLP alone."""
    run = results.run("soda-hall")
    by_budget = {} if run is None else {b: culler_frames(run, spec(EXT, b)) for b in TABLE_3}
    towers = {ONE_VIEW: results.run("skyscraper-view"), PATH: results.run("skyscraper")}
    return [
        _scene(run),
        preprocessing(results.experiment("preparation")),
        _table_3(by_budget, results.experiment("times")),
        times(run),
        primitives(results.experiment("primitives")),
        queries(results, FRONTS),
        depth_complexity(towers),
        quality(results.run("city"), results.experiment("city-quality")),
        sweep(results.experiment("city-leaves")),
    ]


def tables_of_run(run: RunFolder) -> list[Table]:
    """Table 3 from a run of cPLP on budgets through the Soda Hall, and the depth complexity from
    one of both `TOWER`'s through the skyscraper."""
    scene = PurePath(run.scene_name.partition(":")[0]).stem
    if scene == "skyscraper" and TOWER[FRUSTUM] in run.frames_of:
        return [depth_complexity({PATH: run})]
    if scene != "soda_hall":
        return []
    found: dict[str, dict[int, CullerFrames]] = {}
    for culler in run.cullers:
        name, _, text = culler.partition(":")
        options = dict(part.partition("=")[::2] for part in text.split(","))
        paper = options.get("leaf", str(LEAF_TRIANGLES)) == str(LEAF_TRIANGLES)
        rows = run.frames_of[culler]
        if name == "cplp" and paper and "budget" in options and rows:
            if any(row.triangles_estimated is None for row in rows):
                continue
            way = LABELS.get(options.get("query", EXT), "cPLP")
            found.setdefault(way, {})[int(options["budget"])] = culler_frames(run, culler)
    triangles = run.manifest.scene.triangles
    note = "" if triangles > LEAST_TRIANGLES else f"a scene of {triangles:,} triangles only"
    return [_table_3(by_budget, None, way, note) for way, by_budget in found.items()]


def _scene(run: RunFolder | None) -> Table:
    triangles = None if run is None else run.manifest.scene.triangles
    leaves = None if run is None else run.manifest.cullers[spec(EXT, 1_000)].units
    frames = None if run is None else len(run.frame_numbers)
    return Table(
        "Scene and set-up",
        "section 4",
        (
            Row("triangles", MANY_TRIANGLES, triangles),
            Row("leaves", LEAVES, leaves),
            Row("frames of the path", FRAMES, frames),
        ),
        setup=(SetUp("triangles a leaf, fewer than", FEWER_A_LEAF),),
    )


def _extra(one: CullerFrames) -> Estimate:
    """Triangles drawn in addition to the estimate's, on average."""
    return one.series("triangles_drawn").mean() - one.series("triangles_estimated").mean()


def _table_3(
    by_budget: Mapping[int, CullerFrames],
    timed: Mapping[str, Any] | None,
    way: str = "",
    note: str = "",
) -> Table:
    """Rows for the paper's budgets and for any other that was run; those alone where only some
    of the paper's were. `timed`: milliseconds of PLP alone, and of cPLP with it."""
    plp, whole = _timed(timed, "plp_ms"), _timed(timed, "cplp_ms")
    rows: list[Row] = []
    for budget in sorted(by_budget) if by_budget else list(TABLE_3):
        printed = TABLE_3.get(budget)
        alone = plp.get(budget)
        tests = beyond = ms = None
        if budget in by_budget:
            one = by_budget[budget]
            tests, beyond, ms = one.mean("iterations"), _extra(one), one.ms()
        at = f"budget {budget:,}"
        rows += [
            Row(f"{at}: tests", printed and printed.tests, tests, digits=3, note=note),
            Row(f"{at}: extra triangles", printed and printed.extra, value_of(beyond), note=note),
            Row(f"{at}: PLP time", printed and printed.plp_s,
                None if alone is None else alone.value / 1e3, "s", 3, Basis.HARDWARE, note),
            Row(f"{at}: average time", printed and printed.average_s,
                None if ms is None else ms / 1e3, "s", 3, Basis.HARDWARE, note),
            Row(f"{at}: PLP's part of it",
                printed and ratio_of(printed.plp_s, printed.average_s),
                None if alone is None else (alone / whole[budget]).value, "%", 0,
                Basis.WITHIN_RUN, note),
            Row(f"{at}: frame rate", printed and printed.hz, None if ms is None else 1e3 / ms,
                "Hz", 1, Basis.HARDWARE, note),
        ]  # fmt: skip
    octane = ratio_of(OCTANE_PLP_S, SECONDS["Octane", IB])
    if FASTEST_BUDGET in plp or not by_budget:
        part = plp[FASTEST_BUDGET] / whole[FASTEST_BUDGET] if FASTEST_BUDGET in plp else None
        rows.append(
            Row("PLP's part of it, cPLP-IB on the Octane", octane, value_of(part), "%", 0,
                Basis.WITHIN_RUN, f"here cPLP-EXT, budget {FASTEST_BUDGET:,}")
        )  # fmt: skip
    return Table(
        "Rounds of tests and extra triangles" + (f", {way}" if way else ""),
        "Table 3",
        tuple(rows),
        _table_3_claims(by_budget),
        figure=_figure(by_budget),
    )


def _timed(found: Mapping[str, Any] | None, key: str) -> dict[int, Estimate]:
    """By budget, from the experiment: milliseconds a frame, on average."""
    if found is None:
        return {}
    return {
        budget: series(by_frame, range(len(by_frame)), "soda_hall").mean()
        for budget, by_frame in zip(found["budgets"], found[key], strict=True)
    }


def _table_3_claims(by_budget: Mapping[int, CullerFrames]) -> tuple[Claim, ...]:
    budgets = sorted(by_budget)
    rounds = [by_budget[budget].series("iterations").mean() for budget in budgets]
    extra = [_extra(by_budget[budget]) for budget in budgets]
    whole = set(TABLE_3) <= set(budgets)
    told_rounds = ", ".join(f"{one.value:.2f}" for one in rounds)
    told_extra = ", ".join(f"{one.value:,.0f}" for one in extra)
    few, many = TABLE_3[MOST_BUDGET], TABLE_3[LEAST_BUDGET]
    fewer, less = ratio_of(few.tests, many.tests), ratio_of(few.extra, many.extra)
    span = f"from a budget of {LEAST_BUDGET:,} to one of {MOST_BUDGET:,}"
    return (
        Claim(
            "the rounds of tests fall as the budget grows: the greatest step",
            Sense.AT_MOST,
            _greatest_step(rounds),
            even=0.0,
            told=told_rounds,
        ),
        Claim(
            "the extra triangles fall as the budget grows: the greatest step",
            Sense.AT_MOST,
            _greatest_step(extra),
            even=0.0,
            digits=0,
            told=told_extra,
        ),
        Claim(
            f"{span} the rounds of tests fall to {100 * fewer.amount:.0f} %",
            Sense.AT_MOST,
            rounds[-1] / rounds[0] if whole else None,
            fewer,
            unit="%",
            digits=1,
        ),
        Claim(
            f"{span} the extra triangles fall to {100 * less.amount:.0f} %",
            Sense.AT_MOST,
            extra[-1] / extra[0] if whole else None,
            less,
            unit="%",
            digits=1,
        ),
        Claim(
            f"at {MOST_BUDGET:,} a frame takes {few.tests.value} rounds",
            Sense.AT_MOST,
            rounds[-1] if whole else None,
            few.tests,
            even=None,
        ),
    )


def _greatest_step(figures: Sequence[Estimate]) -> Estimate | None:
    steps = [after - before for before, after in itertools.pairwise(figures)]
    return most(*steps) if steps else None


def _figure(by_budget: Mapping[int, CullerFrames]) -> Figure | None:
    if len(by_budget) < 2:
        return None
    ours = tuple(sorted(by_budget))
    theirs = tuple(TABLE_3)
    return Figure(
        "budget, triangles",
        "extra triangles",
        (
            Curve("here", ours, tuple(_extra(by_budget[budget]).value for budget in ours)),
            printed_curve("paper", theirs, [TABLE_3[budget].extra for budget in theirs]),
        ),
    )
