"""J. T. Klosowski, C. T. Silva: Efficient Conservative Visibility Culling Using the
Prioritized-Layered Projection Algorithm.

IEEE TVCG 7(4), 2001. Section 4, Tables 2 and 3, Figs. 6 to 8; section 1 for PLP alone.

Measured on `soda_hall` and `skyscraper`, laid out like the paper's models, which are not
available, and on `city`. Rounds, triangles and z-tests depend on the scene and compare in ratio
and trend; times belong to machines of 2001 and compare as ratios within one run.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from statistics import fmean
from typing import Any

from visref.papers.contents import (
    Basis,
    Claim,
    Curve,
    Estimate,
    Experiment,
    Figure,
    JudgedRun,
    Published,
    Results,
    Row,
    Sense,
    SetUp,
    Size,
    Table,
    most,
    one_more,
    printed_curve,
    product_of,
    ratio_of,
    series,
    single,
)
from visref.papers.culler_frames import CullerFrames, culler_frames
from visref.papers.printed.klosowski2001 import (
    DEPTH_COMPLEXITY,
    EXT_OVER_HP,
    FASTER_THAN_VF_BF,
    FEWER_A_LEAF,
    FRAMES,
    HISTOGRAM_US,
    HP_HZ,
    LEAVES,
    MANY_TRIANGLES,
    PLP_DRAWS,
    PLP_FINDS,
    PLP_WRONG,
    QUERY_US,
    SECONDS,
    TABLE_2,
    TABLE_3,
)
from visref.run_folder.read import RunFolder

TITLE = (
    "J. T. Klosowski, C. T. Silva: Efficient Conservative Visibility Culling Using the "
    "Prioritized-Layered Projection Algorithm. IEEE TVCG 7(4), 2001"
)

SIZE: Size = (512, 512)

LEAF_TRIANGLES = int(FEWER_A_LEAF.value)
LEAST_TRIANGLES = 1_000_000
LEAST_BUDGET, MOST_BUDGET = min(TABLE_3), max(TABLE_3)
FASTEST_BUDGET = 25_000
CITY_BUDGETS = (10_000, 25_000, 50_000, 100_000)
TENTH = 50_000

LABELS = {
    "fragment-histogram": "cPLP-EXT",
    "occlusion-query": "cPLP-HP",
    "item-buffer": "cPLP-IB",
    "histogram": "cPLP-HG",
    "item-buffer,image=restore": "cPLP-IB, picture restored (3.5)",
    "histogram,image=restore": "cPLP-HG, picture restored (3.5)",
}
WAY_BUDGETS = {
    way: (FASTEST_BUDGET,) if "restore" in way else (1_000, FASTEST_BUDGET, 100_000)
    for way in LABELS
}
VF_BF = "cplp:order=frustum"
HP_ALONE = "cplp:order=front-to-back,query=occlusion-query"
EXT = "fragment-histogram"


def spec(way: str, budget: int) -> str:
    """cPLP that asks in one way of `LABELS`, with the paper's leaves."""
    return f"cplp:query={way},budget={budget},leaf={LEAF_TRIANGLES}"


# The paper names no budget here. One beyond what shows draws, and tests, more than it saves.
TOWER_BUDGETS = (1_000, 10_000, 25_000)
TOWER = {
    "frustum": "cplp:order=frustum,fragments=true",
    **{f"{budget:,}": f"cplp:budget={budget},fragments=true" for budget in TOWER_BUDGETS},
}
CITY = "city:scale=0.65"

RUNS = (
    JudgedRun("soda-hall", "soda_hall", tuple(spec(EXT, budget) for budget in TABLE_3), SIZE),
    JudgedRun(
        "soda-hall-ways",
        "soda_hall",
        (
            *(spec(way, budget) for way in LABELS for budget in WAY_BUDGETS[way]),
            HP_ALONE,
            VF_BF,
        ),
        SIZE,
    ),
    JudgedRun("skyscraper", "skyscraper", tuple(TOWER.values()), SIZE),
    JudgedRun("city", CITY, tuple(f"plp:budget={budget}" for budget in CITY_BUDGETS), SIZE),
)
FRONTS = {"soda-hall": "soda_hall", "city": CITY}
EXPERIMENTS = (
    Experiment("primitives", "plp-primitives"),
    Experiment("city-quality", "plp-quality", CITY, SIZE),
    *(Experiment(f"{key}-queries", "plp-queries", scene, SIZE) for key, scene in FRONTS.items()),
)


def tables(results: Results) -> list[Table]:
    """Section 4's scene, Tables 2 and 3, Figs. 6 to 8, the cost of a query, and PLP alone."""
    run = results.run("soda-hall")
    by_budget = {} if run is None else {b: culler_frames(run, spec(EXT, b)) for b in TABLE_3}
    return [
        _scene(run),
        _table_3(by_budget),
        _times(results.run("soda-hall-ways")),
        _primitives(results.experiment("primitives")),
        _queries(results),
        _depth_complexity(results.run("skyscraper")),
        _quality(results.run("city"), results.experiment("city-quality")),
    ]


def tables_of_run(run: RunFolder) -> list[Table]:
    """Table 3 from a run of cPLP on budgets through the Soda Hall, and the depth complexity from
    one of both `TOWER`'s through the skyscraper."""
    scene = PurePath(run.scene_name.partition(":")[0]).stem
    if scene == "skyscraper" and TOWER["frustum"] in run.frames_of:
        return [_depth_complexity(run)]
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
    return [_table_3(by_budget, way, note) for way, by_budget in found.items()]


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


def _table_3(by_budget: Mapping[int, CullerFrames], way: str = "", note: str = "") -> Table:
    """Rows for the paper's budgets and for any other that was run; those alone where only some
    of the paper's were."""
    budgets = sorted(by_budget) if by_budget else list(TABLE_3)
    rows: list[Row] = []
    for budget in budgets:
        rounds, extra, rate = TABLE_3.get(budget, (None, None, None))
        tests = beyond = frames_a_second = None
        if budget in by_budget:
            one = by_budget[budget]
            tests, beyond, frames_a_second = one.mean("iterations"), _extra(one), 1e3 / one.ms()
        at = f"budget {budget:,}"
        rows += [
            Row(f"{at}: tests", rounds, tests, digits=3, note=note),
            Row(f"{at}: extra triangles", extra, _value(beyond), note=note),
            Row(f"{at}: frame rate", rate, frames_a_second, "Hz", 1, Basis.HARDWARE, note),
        ]
    title = "Rounds of tests and extra triangles" + (f", {way}" if way else "")
    return Table(
        title,
        "Table 3",
        tuple(rows),
        _table_3_claims(by_budget),
        figure=_figure(by_budget),
    )


def _value(figure: Estimate | None) -> float | None:
    return None if figure is None else figure.value


def _table_3_claims(by_budget: Mapping[int, CullerFrames]) -> tuple[Claim, ...]:
    budgets = sorted(by_budget)
    rounds = [by_budget[budget].series("iterations").mean() for budget in budgets]
    extra = [_extra(by_budget[budget]) for budget in budgets]
    whole = set(TABLE_3) <= set(budgets)
    told_rounds = ", ".join(f"{one.value:.2f}" for one in rounds)
    told_extra = ", ".join(f"{one.value:,.0f}" for one in extra)
    few_rounds, few_extra, _ = TABLE_3[MOST_BUDGET]
    many_rounds, many_extra, _ = TABLE_3[LEAST_BUDGET]
    fewer, less = ratio_of(few_rounds, many_rounds), ratio_of(few_extra, many_extra)
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
            f"at {MOST_BUDGET:,} a frame takes {few_rounds.value} rounds",
            Sense.AT_MOST,
            rounds[-1] if whole else None,
            few_rounds,
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
            printed_curve("paper", theirs, [TABLE_3[budget][1] for budget in theirs]),
        ),
    )


def _times(run: RunFolder | None) -> Table:
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
        Row(f"{label}, budget {budget:,}", None, _value(ms.get(way, {}).get(budget)), "ms", 1,
            Basis.HARDWARE)
        for way, label in LABELS.items()
        for budget in WAY_BUDGETS[way]
    ]  # fmt: skip
    rows += [Row(f"{name}, no budget", None, _value(alone.get(name)), "ms", 1, Basis.HARDWARE)
             for name in ("HP", "VF-BF")]  # fmt: skip
    at_best = {way: times[FASTEST_BUDGET] for way, times in ms.items()} | alone
    for (machine, way), seconds in SECONDS.items():
        spent = at_best.get(way)
        name = f"{LABELS.get(way, way)} on the {machine}"
        ours = None if spent is None else spent.value / 1e3
        rows.append(Row(name, seconds, ours, "s", 3, Basis.HARDWARE))
    for way in FASTER_THAN_VF_BF:
        published = ratio_of(SECONDS["Octane", "VF-BF"], SECONDS["Octane", way])
        ratio = _value(_gain(at_best, way, "VF-BF"))
        rows.append(
            Row(f"VF-BF over {LABELS[way]}", published, ratio, "", 1, Basis.WITHIN_RUN)
        )  # fmt: skip
    curves = tuple(
        Curve(
            LABELS[way],
            tuple(map(float, times)),
            tuple(spent.value for spent in times.values()),
        )
        for way, times in ms.items()
        if len(times) > 1
    )
    figure = Figure("budget, triangles", "ms a frame", curves) if curves else None
    return Table(
        "Time a frame",
        "Figs. 6 and 8, section 4",
        tuple(rows),
        _time_claims(at_best),
        figure=figure,
    )


def _gain(ms: Mapping[str, Estimate], way: str, other: str) -> Estimate | None:
    """How many times as fast as another a way is."""
    return ms[other] / ms[way] if ms else None


def _time_claims(ms: Mapping[str, Estimate]) -> tuple[Claim, ...]:
    """At the budget that is fastest in the paper."""
    at = f"at {FASTEST_BUDGET:,}"
    asked = "occlusion-query"
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
            _gain(ms, asked, "VF-BF"),
            digits=1,
        ),
        Claim(
            f"cPLP-EXT is {EXT_OVER_HP.value:.0f} % faster than cPLP-HP, {at}",
            Sense.AT_LEAST,
            _gain(ms, EXT, asked),
            one_more(EXT_OVER_HP),
            told="theirs is an estimate, each at its best budget",
        ),
        Claim(
            f"cPLP-HP is considerably faster than HP without PLP, 2.8 times, {at}",
            Sense.AT_LEAST,
            _gain(ms, asked, "HP"),
            product_of(HP_HZ, SECONDS["Kayak", "HP"]),
        ),
    )


def _primitives(found: Mapping[str, Any] | None) -> Table:
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


def _queries(results: Results) -> Table:
    """The cost of a query of each way, all cells of a front at once."""
    rows: list[Row] = []
    gains: dict[str, list[tuple[int, float]]] = {"sync": [], "batch": []}
    for key, scene in FRONTS.items():
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


def _depth_complexity(run: RunFolder | None) -> Table:
    """Z-tests a pixel; the paper does not say whether its own count the queries' boxes."""
    before, after = DEPTH_COMPLEXITY
    saved = ratio_of(before, after)
    tests: dict[str, Estimate] = {}
    asking: dict[str, Estimate] = {}
    if run is not None:
        pixels = fmean(width * height for width, height in map(run.size, run.frame_numbers))
        for name, culler in TOWER.items():
            if culler in run.frames_of:
                one = culler_frames(run, culler)
                asking[name] = one.series("query_fragments").mean() / pixels
                tests[name] = one.series("depth_tests").mean() / pixels
    frustum = tests.get("frustum")
    both_sides = "back faces are drawn too: triangles are two-sided here"
    rows = [Row("VF-BF", before, _value(frustum), digits=2, note=both_sides)]
    claims: list[Claim] = []
    for name in TOWER:
        if name == "frustum" or (run is not None and name not in tests):
            continue
        asked = asking.get(name)
        drawing = tests[name] - asked if asked is not None else None
        factor = frustum / drawing if frustum is not None and drawing is not None else None
        both = frustum / tests[name] if frustum is not None and name in tests else None
        at = f"budget {name}"
        rows += [
            Row(f"{at}: cPLP, drawing", after, _value(drawing), digits=2),
            Row(f"{at}: cPLP, its queries beside", None, _value(asked), digits=2),
            Row(f"{at}: VF-BF over cPLP's drawing", saved, _value(factor), digits=2),
            Row(f"{at}: VF-BF over drawing and queries", saved, _value(both), digits=2),
        ]
        if name == f"{FASTEST_BUDGET:,}":
            claims.append(
                Claim(
                    f"cPLP needs {saved.amount:.2f} times fewer z-tests a pixel than VF-BF, its "
                    f"queries' own among them, on a budget of {name}",
                    Sense.AT_LEAST,
                    both,
                    saved,
                )
            )
    return Table("Z-tests a pixel", "section 4, Fig. 7", tuple(rows), tuple(claims))


def _quality(run: RunFolder | None, found: Mapping[str, Any] | None) -> Table:
    """PLP alone by budget: visible triangles found, from the experiment; wrong pixels, which are
    the samples missed, from the judged run."""
    shares: dict[int, Estimate] = {}
    if found is not None:
        shares = {
            budget: series(by_frame, range(len(by_frame)), CITY).mean()
            for budget, by_frame in zip(found["budgets"], found["found"], strict=True)
        }
    rows: list[Row] = []
    wrong: dict[int, Estimate] = {}
    for budget in CITY_BUDGETS:
        at = f"budget {budget:,}"
        mean = None
        if run is not None:
            one = culler_frames(run, f"plp:budget={budget}")
            lost = [row.missed_pixels / run.samples_of(row) for row in one.rows]
            by_frame = series(lost, one.frames, CITY)
            mean, wrong[budget] = by_frame.mean(), by_frame.most()
        is_tenth = budget == TENTH
        rows += [
            Row(f"{at}: visible triangles found", PLP_FINDS if is_tenth else None,
                _value(shares.get(budget)), "%", 1),
            Row(f"{at}: wrong pixels, on average", None, _value(mean), "%", 2),
            Row(f"{at}: wrong pixels, at worst", PLP_WRONG if is_tenth else None,
                _value(wrong.get(budget)), "%", 2),
        ]  # fmt: skip
    claims = (
        Claim(
            f"on a tenth of the triangles PLP finds {PLP_FINDS.value:.0f} % of the visible",
            Sense.AT_LEAST,
            shares.get(TENTH),
            PLP_FINDS,
            even=PLP_DRAWS.amount,
            unit="%",
            digits=1,
        ),
        Claim(
            f"and gets {PLP_WRONG.value:.0f} % of a frame's pixels wrong at worst",
            Sense.AT_MOST,
            wrong.get(TENTH),
            PLP_WRONG,
            even=None,
            unit="%",
        ),
    )
    title = "PLP alone in a city of 500,000 triangles"
    return Table(title, "section 1", tuple(rows), claims)
