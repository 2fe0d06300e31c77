"""J. T. Klosowski, C. T. Silva: Efficient Conservative Visibility Culling Using the
Prioritized-Layered Projection Algorithm.

IEEE TVCG 7(4), 2001. Section 4, Tables 2 and 3, Figs. 6 to 8; section 1 for PLP alone.

Measured on `soda_hall` and `skyscraper`, laid out like the paper's models, which are not
available, and on `city`. Rounds, triangles and z-tests depend on the scene and compare in ratio
and trend; times belong to machines of 2001 and compare as ratios within one run.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import PurePath
from statistics import fmean
from typing import Any

from visref.papers.contents import (
    Basis,
    Curve,
    Experiment,
    Figure,
    JudgedRun,
    Results,
    Row,
    Size,
    Table,
    Trend,
)
from visref.papers.culler_frames import CullerFrames, culler_frames
from visref.run_folder.read import RunFolder

TITLE = (
    "J. T. Klosowski, C. T. Silva: Efficient Conservative Visibility Culling Using the "
    "Prioritized-Layered Projection Algorithm. IEEE TVCG 7(4), 2001"
)

SIZE: Size = (512, 512)

# Section 4: the scene.
LEAF_TRIANGLES = 5_000
LEAVES = 1_429
FRAMES = 500
LEAST_TRIANGLES = 1_000_000

# Budget: average rounds of queries a frame ("# EXT tests"), triangles beyond the budget's, and
# frames a second, extrapolated for a Kayak.
TABLE_3 = {
    1_000: (4.688, 16_844, 22.7),
    10_000: (3.376, 10_978, 22.2),
    25_000: (2.426, 5_641, 18.9),
    50_000: (1.908, 2_796, 13.9),
    75_000: (1.630, 1_770, 10.4),
    100_000: (1.372, 1_247, 8.6),
}

# Microseconds to transfer and to scan an image of 64 x 64 and 512 x 512 pixels, by machine; and
# for the histogram of one, in one number.
TABLE_2 = {
    "Octane": {64: (217, 30), 512: (4_483, 2_300)},
    "Onyx": {64: (564, 20), 512: (7_733, 1_000)},
    "Kayak": {64: (375, 47), 512: (11_250, 3_430)},
}
HISTOGRAM_US = {"Octane": {64: 800, 512: 34_000}, "Onyx": {64: 690, 512: 13_500}}
QUERY_US = "100 to 1,000"  # one HP query, waited for

# Z-tests a pixel in the skyscraper: frustum and back-face culling, cPLP.
DEPTH_COMPLEXITY = (26.70, 7.97)

# Seconds a frame, at the fastest budget.
SECONDS = {
    ("Octane", "item-buffer"): 0.081,
    ("Octane", "histogram"): 0.164,
    ("Octane", "VF-BF"): 0.975,
    ("Onyx", "item-buffer"): 0.113,
    ("Onyx", "histogram"): 0.178,
    ("Kayak", "item-buffer"): 0.864,
    ("Kayak", "HP"): 0.157,
}
FASTEST_BUDGET = 25_000

# Section 1, a city of 500,000 triangles on a tenth of them: visible triangles found, on average,
# and wrong pixels at worst.
PLP_QUALITY = (0.90, 0.04)
CITY_BUDGETS = (10_000, 25_000, 50_000, 100_000)
TENTH = 50_000

# What makes the per-fragment histogram worth its hardware, where many cells are asked at once.
EXT_OVER_ONE_BY_ONE = 20.0
EXT_OVER_BATCH = 3.0

# "To near none": the paper's extra triangles fall to 7 % of those at the least budget.
NEAR_NONE = 0.1
NEAR_ONE = 1.5

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
        _times(results.run("soda-hall-ways"), by_budget),
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
            Row("triangles", f"over {LEAST_TRIANGLES:,}", triangles),
            Row("triangles a leaf, fewer than", LEAF_TRIANGLES, LEAF_TRIANGLES),
            Row("leaves", LEAVES, leaves),
            Row("frames of the path", FRAMES, frames),
        ),
    )


def _extra(one: CullerFrames) -> float:
    """Triangles drawn in addition to the estimate's, on average."""
    return one.mean("triangles_drawn") - one.mean("triangles_estimated")


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
            Row(f"{at}: extra triangles", extra, beyond, note=note),
            Row(f"{at}: frame rate", rate, frames_a_second, "Hz", 1, Basis.HARDWARE, note),
        ]
    title = "Rounds of tests and extra triangles" + (f", {way}" if way else "")
    return Table(title, "Table 3", tuple(rows), _table_3_trends(by_budget), _figure(by_budget))


def _table_3_trends(by_budget: Mapping[int, CullerFrames]) -> tuple[Trend, ...]:
    budgets = sorted(by_budget)
    rounds = [by_budget[budget].mean("iterations") for budget in budgets]
    extra = [_extra(by_budget[budget]) for budget in budgets]
    several, whole = len(budgets) > 1, set(TABLE_3) <= set(budgets)

    def falls(values: list[float]) -> bool | None:
        return all(b < a for a, b in itertools.pairwise(values)) if several else None

    told_rounds = ", ".join(f"{value:.2f}" for value in rounds)
    told_extra = ", ".join(f"{value:,.0f}" for value in extra)
    return (
        Trend("the rounds of tests fall as the budget grows", falls(rounds), told_rounds),
        Trend("the extra triangles fall as the budget grows", falls(extra), told_extra),
        Trend(
            f"at {max(TABLE_3):,} a frame takes hardly more than one round",
            rounds[-1] <= NEAR_ONE if whole else None,
            told_rounds,
        ),
        Trend(
            f"at {max(TABLE_3):,} the extra triangles are less than a tenth of those at "
            f"{min(TABLE_3):,}",
            extra[-1] < NEAR_NONE * extra[0] if whole else None,
            told_extra,
        ),
    )


def _figure(by_budget: Mapping[int, CullerFrames]) -> Figure | None:
    if len(by_budget) < 2:
        return None
    ours = tuple(sorted(by_budget))
    theirs = tuple(TABLE_3)
    return Figure(
        "budget, triangles",
        "extra triangles",
        (
            Curve("here", ours, tuple(_extra(by_budget[budget]) for budget in ours)),
            Curve("paper", theirs, tuple(TABLE_3[b][1] for b in theirs), published=True),
        ),
    )


def _times(run: RunFolder | None, by_budget: Mapping[int, CullerFrames]) -> Table:
    ms: dict[str, dict[int, float]] = {}
    alone: dict[str, float] = {}
    if run is not None:
        ms = {
            way: {budget: culler_frames(run, spec(way, budget)).ms() for budget in WAY_BUDGETS[way]}
            for way in LABELS
        }
        alone = {name: culler_frames(run, culler).ms() for name, culler in
                 (("HP", HP_ALONE), ("VF-BF", VF_BF))}  # fmt: skip
    rows = [
        Row(f"{label}, budget {budget:,}", None, ms.get(way, {}).get(budget), "ms", 1,
            Basis.HARDWARE)
        for way, label in LABELS.items()
        for budget in WAY_BUDGETS[way]
    ]  # fmt: skip
    rows += [Row(f"{name}, no budget", None, alone.get(name), "ms", 1, Basis.HARDWARE)
             for name in ("HP", "VF-BF")]  # fmt: skip
    at_best = {way: times[FASTEST_BUDGET] for way, times in ms.items()} | alone
    for (machine, way), seconds in SECONDS.items():
        spent = at_best.get(way)
        name = f"{LABELS.get(way, way)} on the {machine}"
        ours = None if spent is None else spent / 1e3
        rows.append(Row(name, seconds, ours, "s", 3, Basis.HARDWARE))
    for way in ("item-buffer", "histogram"):
        published = SECONDS["Octane", "VF-BF"] / SECONDS["Octane", way]
        ratio = at_best["VF-BF"] / at_best[way] if at_best else None
        rows.append(
            Row(f"VF-BF over {LABELS[way]}", published, ratio, "", 1, Basis.WITHIN_RUN)
        )  # fmt: skip
    curves = tuple(
        Curve(LABELS[way], tuple(map(float, times)), tuple(times.values()))
        for way, times in ms.items()
        if len(times) > 1
    )
    trends = (
        _faster("cPLP by any way of asking is faster than VF-BF", at_best, LABELS, "VF-BF"),
        _faster("cPLP-EXT is faster than cPLP-HP", at_best, (EXT,), "occlusion-query"),
        _faster("cPLP-HP is faster than HP without PLP", at_best, ("occlusion-query",), "HP"),
    )
    figure = Figure("budget, triangles", "ms a frame", curves) if curves else None
    return Table("Time a frame", "Figs. 6 and 8, section 4", tuple(rows), trends, figure)


def _faster(claim: str, ms: Mapping[str, float], ways: Any, other: str) -> Trend:
    if not ms:
        return Trend(claim, None)
    told = ", ".join(f"{LABELS.get(way, way)} {ms[way]:.0f} ms" for way in (*ways, other))
    return Trend(claim, max(ms[way] for way in ways) < ms[other], told)


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


def _hardware(quantity: str, published: float | str | None, ms: float | None) -> Row:
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
    trends = tuple(
        _cheaper(f"where most cells are asked at once, -EXT is {least:.0f} times cheaper than "
                 f"{ASKED[way]}", gains[way], least)
        for way, least in (("sync", EXT_OVER_ONE_BY_ONE), ("batch", EXT_OVER_BATCH))
    )  # fmt: skip
    return Table("Cost of a query", "sections 3.6 and 4", tuple(rows), trends)


def _cheaper(claim: str, gains: list[tuple[int, float]], least: float) -> Trend:
    if not gains:
        return Trend(claim, None)
    told = ", ".join(f"{gain:.1f} for {cells:,} cells" for cells, gain in sorted(gains))
    return Trend(claim, max(gains)[1] >= least, told)


def _depth_complexity(run: RunFolder | None) -> Table:
    """Z-tests a pixel; the paper does not say whether its own count the queries' boxes."""
    before, after = DEPTH_COMPLEXITY
    tests: dict[str, float] = {}
    asking: dict[str, float] = {}
    if run is not None:
        pixels = fmean(width * height for width, height in map(run.size, run.frame_numbers))
        for name, culler in TOWER.items():
            if culler in run.frames_of:
                one = culler_frames(run, culler)
                asking[name] = one.mean("query_fragments") / pixels
                tests[name] = one.mean("depth_tests") / pixels
    frustum = tests.get("frustum")
    both_sides = "back faces are drawn too: triangles are two-sided here"
    rows = [Row("VF-BF", before, frustum, digits=2, note=both_sides)]
    factors: list[float] = []
    for name in TOWER:
        if name == "frustum" or (run is not None and name not in tests):
            continue
        asked = asking.get(name)
        drawing = tests[name] - asked if asked is not None else None
        factor = frustum / drawing if frustum is not None and drawing else None
        both = frustum / tests[name] if frustum is not None and name in tests else None
        factors += [] if factor is None else [factor]
        at = f"budget {name}"
        rows += [
            Row(f"{at}: cPLP, drawing", after, drawing, digits=2),
            Row(f"{at}: cPLP, its queries beside", None, asked, digits=2),
            Row(f"{at}: VF-BF over cPLP's drawing", before / after, factor, digits=2),
            Row(f"{at}: VF-BF over drawing and queries", None, both, digits=2),
        ]
    holds = max(factors) >= before / after if factors else None
    told = ", ".join(f"{factor:.2f}" for factor in factors)
    claim = f"at its best budget cPLP saves a factor of {before / after:.2f} or more"
    trend = Trend(claim, holds, told)
    return Table("Z-tests a pixel", "section 4, Fig. 7", tuple(rows), (trend,))


def _quality(run: RunFolder | None, found: Mapping[str, Any] | None) -> Table:
    """PLP alone by budget: visible triangles found, from the experiment; wrong pixels, which are
    the samples missed, from the judged run."""
    seen = dict(zip(found["budgets"], found["found"], strict=True)) if found is not None else {}
    rows: list[Row] = []
    wrong: dict[int, float] = {}
    for budget in CITY_BUDGETS:
        at = f"budget {budget:,}"
        share = fmean(seen[budget]) if budget in seen else None
        mean = worst = None
        if run is not None:
            lost = [
                row.missed_pixels / run.samples_of(row)
                for row in run.frames_of[f"plp:budget={budget}"]
            ]
            mean, worst = fmean(lost), max(lost)
            wrong[budget] = worst
        is_tenth = budget == TENTH
        rows += [
            Row(f"{at}: visible triangles found", PLP_QUALITY[0] if is_tenth else None, share,
                "%", 1),
            Row(f"{at}: wrong pixels, on average", None, mean, "%", 2),
            Row(f"{at}: wrong pixels, at worst", PLP_QUALITY[1] if is_tenth else None, worst,
                "%", 2),
        ]  # fmt: skip
    share = fmean(seen[TENTH]) if TENTH in seen else None
    worst = wrong.get(TENTH)
    trends = (
        Trend(
            f"on a tenth of the triangles PLP finds {100 * PLP_QUALITY[0]:.0f} % of the visible",
            None if share is None else share >= PLP_QUALITY[0],
            "" if share is None else f"it finds {100 * share:.1f} %",
        ),
        Trend(
            f"and gets {100 * PLP_QUALITY[1]:.0f} % of a frame's pixels wrong at worst",
            None if worst is None else worst <= PLP_QUALITY[1],
            "" if worst is None else f"it is {100 * worst:.2f} %",
        ),
    )
    title = "PLP alone in a city of 500,000 triangles"
    return Table(title, "section 1", tuple(rows), trends)
