"""D. Staneker, D. Bartz, M. Meissner: Improving Occlusion Query Efficiency with Occupancy Maps.

PVG 2003. Sections 2, 3 and 5, Tables 1 to 5, Figs. 1 and 8 to 11.

Measured on `angio`, `boombox`, `formula_one` and `city_cars`, which have the paper's numbers of
shapes and polygons; its models and paths are not available. So pixels compare in ratio and
order, and frame rates, which belong to a GeForce4 and a VISUALIZE fx10, as ratios within one run.
Numbers of the document differ from one another: Table 3 prints 2,134 polygons a shape for the City,
where its own numbers make 2,136; the text gives the City the BoomBox' 37.9 frames a second, and
Table 4 is followed; its speed-ups of "35 % to 78 %" are over single queries without a map, those
of Table 5 over ones with a map.

The layouts of `boombox` and `formula_one` were revised with Table 2 in view. The table's claims are
judged on the layouts before that (`fitted=false`), and on maps that are marked by whole boxes, as
the paper is read; the fitted layouts, and marks by parts, stand beside and are named so.

Frame rates are of methods that take turns within a frame, the quickest of several rounds; they
are frames over the time of all frames. Processor time of all threads stands beside.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial

from visref.papers.contents import (
    Basis,
    Claim,
    Estimate,
    Experiment,
    JudgedRun,
    Results,
    Row,
    Sense,
    Size,
    Table,
    most,
    one_more,
    ratio_of,
)
from visref.papers.culler_frames import culler_frames
from visref.papers.printed.staneker2003 import (
    BOX_PIXELS,
    FRAME_RATE,
    FRAME_RATE_HP,
    MODELS,
    PIXELS_LEFT,
    SPEED_UP,
)
from visref.papers.staneker2003_options import (
    DETAILED,
    INSTANCED,
    MULTIPLE,
    OPTIONS,
    arranging_table,
    detail_table,
    options_table,
)
from visref.papers.staneker2003_paths import TURNS, path_tables
from visref.papers.staneker2003_queries import latency_table, map_table
from visref.papers.staneker2003_records import (
    PROCESSOR,
    Run,
    Runs,
    Turns,
    TurnsOf,
    of,
    value,
)

TITLE = (
    "D. Staneker, D. Bartz, M. Meissner: Improving Occlusion Query Efficiency with Occupancy "
    "Maps. PVG 2003"
)

# Our scene for each of the paper's models.
SCENES = {
    "Angio": "angio",
    "BoomBox": "boombox",
    "FormulaOne": "formula_one",
    "City": "city_cars",
}
# Those laid out before Table 2 was in view.
UNFITTED = {
    "Angio": "angio",
    "BoomBox": "boombox:fitted=false",
    "FormulaOne": "formula_one:fitted=false",
}
SMALL: Size = (876, 584)  # Tables 1 and 2
LARGE: Size = (1000, 900)  # Tables 4 and 5

SINGLE, MAP = "occlusion-query", "occupancy-map:maps=1"
COUNTED_SINGLE = f"{SINGLE}:fragments=true"
COUNTED_MAP = f"{MAP},fragments=true"
# Drawn shapes mark by their whole boxes.
COUNTED_BOXES = f"{MAP},parts=1,fragments=true"
COUNTED = (COUNTED_SINGLE, COUNTED_MAP, COUNTED_BOXES)

RUNS = (
    *(
        JudgedRun(f"{SCENES[model]}-876", SCENES[model], (*COUNTED, *OPTIONS), size=SMALL)
        for model in BOX_PIXELS
    ),
    *(
        JudgedRun(f"{SCENES[model]}-876-unfitted", scene, COUNTED, size=SMALL)
        for model, scene in UNFITTED.items()
        if scene != SCENES[model]
    ),
    *(
        JudgedRun(f"{scene}-1000", scene, (MAP, MULTIPLE, INSTANCED), size=LARGE)
        for scene in SCENES.values()
    ),
)
EXPERIMENTS = (
    Experiment("latency", "occupancy-map-latency"),
    Experiment("lookup", "occupancy-map-lookup"),
    Experiment("query-in-triangles", "occupancy-map-query-in-triangles"),
    *(
        Experiment(f"{SCENES[model]}-pair", "occupancy-map-pair", SCENES[model], SMALL)
        for model in FRAME_RATE_HP
    ),
    *(
        Experiment(f"{scene}-turns", "occupancy-map-turns", scene, LARGE, alone=True)
        for scene in SCENES.values()
    ),
    Experiment("detail", "occupancy-map-detail", SCENES[DETAILED], LARGE),
)


def tables(results: Results) -> list[Table]:
    """Fig. 1, the map, Tables 3, 1, 2, 4 and 5, Figs. 8 to 11, and the map's options."""
    fitted, unfitted = _counted(results, SCENES), _counted(results, UNFITTED)
    large = _runs(results, {model: f"{scene}-1000" for model, scene in SCENES.items()})
    turns = _taken(results, "turns", SCENES)
    pairs = _taken(results, "pair", FRAME_RATE_HP)
    return [
        _models(large),
        latency_table(results),
        map_table(results, turns),
        _table_1(pairs),
        _table_2(fitted, unfitted),
        _table_4(turns),
        _table_5(turns),
        *(table for model in MODELS for table in path_tables(model, turns.get(model))),
        options_table(fitted, large),
        arranging_table(turns),
        detail_table(results),
    ]


def _counted(results: Results, scenes: Mapping[str, str]) -> Runs:
    """The runs at 876 by 584 of these scenes."""
    return _runs(
        results,
        {
            model: f"{SCENES[model]}-876" + ("" if scene == SCENES[model] else "-unfitted")
            for model, scene in scenes.items()
            if model in BOX_PIXELS
        },
    )


def _runs(results: Results, keys: Mapping[str, str]) -> Runs:
    """By model, those that were measured."""
    found = {}
    for judged in RUNS:
        for model, key in keys.items():
            run = results.run(key) if key == judged.key else None
            if run is not None:
                scene = run.manifest.scene
                by_culler = {culler: culler_frames(run, culler) for culler in judged.cullers}
                found[model] = Run(scene.objects, scene.triangles, by_culler)
    return found


def _taken(results: Results, kind: str, models: Iterable[str]) -> TurnsOf:
    """By model, what methods that took turns took."""
    found = {model: results.experiment(f"{SCENES[model]}-{kind}") for model in models}
    return {model: Turns(SCENES[model], one) for model, one in found.items() if one is not None}


def _models(runs: Runs) -> Table:
    rows = []
    for model, (shapes, polygons, average) in MODELS.items():
        run = runs.get(model)
        note = "printed beside numbers that make 2,136" if model == "City" else ""
        rows += [
            Row(f"{model}: shapes", shapes, of(run, lambda w: w.shapes)),
            Row(f"{model}: polygons", polygons, of(run, lambda w: w.triangles)),
            Row(f"{model}: polygons a shape", average,
                of(run, lambda w: w.triangles / w.shapes), note=note),
        ]  # fmt: skip
    return Table("Models", "Table 3", tuple(rows))


def _table_1(pairs: TurnsOf) -> Table:
    rows = []
    claims = []
    for model, (without, with_map) in FRAME_RATE_HP.items():
        pair = pairs.get(model)
        gain = of(pair, lambda p: p.gain("map", "single"))
        published = ratio_of(with_map, without)
        rows += [
            Row(f"{model}: without OM", without, of(pair, lambda p: p.rate("single")),
                "fps", 1, Basis.HARDWARE),
            Row(f"{model}: with OM", with_map, of(pair, lambda p: p.rate("map")),
                "fps", 1, Basis.HARDWARE),
            Row(f"{model}: with over without", published, of(gain, value), "", 2,
                Basis.WITHIN_RUN),
            Row(f"{model}: the same by processor time", None,
                of(pair, lambda p: p.gain("map", "single", PROCESSOR).value), "", 2,
                Basis.WITHIN_RUN),
        ]  # fmt: skip
        claims.append(
            Claim(
                f"{model} at 876 × 584: a map gives {published.amount:.2f} times the frame rate",
                Sense.AT_LEAST,
                gain,
                published,
                told="" if pair is None else pair.spent("single", "map"),
            )
        )
    return Table("Frame rates at 876 × 584", "Table 1", tuple(rows), tuple(claims))


def _table_2(fitted: Runs, unfitted: Runs) -> Table:
    rows = []
    note = "ours are front faces alone; whether theirs are is not said"
    for model, (without, with_map) in BOX_PIXELS.items():
        layouts = {"": unfitted.get(model)}
        if UNFITTED[model] != SCENES[model]:
            layouts[", the layout fitted to this table"] = fitted.get(model)
        for layout, run in layouts.items():
            rows.append(
                Row(f"{model}{layout}: without OM", without,
                    of(run, lambda r: r.box_pixels(COUNTED_SINGLE).value), "px", note=note)
            )  # fmt: skip
            for marks, culler in (("whole boxes", COUNTED_BOXES), ("parts", COUNTED_MAP)):
                words = f"{model}{layout}: with OM, marked by {marks}"
                rows += [
                    Row(words, with_map, of(run, partial(_pixels, culler=culler)), "px",
                        note=note),
                    Row(f"{words}, over without", PIXELS_LEFT[model][0],
                        of(run, partial(_share, culler=culler)), "%"),
                ]  # fmt: skip
    shares = {model: _left(run, COUNTED_BOXES) for model, run in unfitted.items()}
    claims = [
        Claim(
            f"{model}: a map leaves {100 * printed.amount:.0f} % of the pixels",
            Sense.AT_MOST,
            shares.get(model),
            printed,
            unit="%",
            digits=1,
        )
        for model, (printed,) in PIXELS_LEFT.items()
    ]
    claims.append(
        Claim(
            "the map saves most on Angio, then on BoomBox, least on FormulaOne: the greater of the "
            "quotients of what is left",
            Sense.AT_MOST,
            _order(shares),
        )
    )
    return Table("Pixels of boxes that are not occluded", "Table 2", tuple(rows), tuple(claims))


def _pixels(run: Run, culler: str) -> float:
    return run.box_pixels(culler).value


def _share(run: Run, culler: str) -> float:
    return _left(run, culler).value


def _left(run: Run, culler: str) -> Estimate:
    """The share of the pixels that a map does not save."""
    return run.box_pixels(culler) / run.box_pixels(COUNTED_SINGLE)


def _order(shares: Mapping[str, Estimate]) -> Estimate | None:
    if len(shares) < len(BOX_PIXELS):
        return None
    return most(shares["Angio"] / shares["BoomBox"], shares["BoomBox"] / shares["FormulaOne"])


def _table_4(turns: TurnsOf) -> Table:
    rows = []
    for model, published in FRAME_RATE.items():
        for (words, name), rate in zip(TURNS.items(), published, strict=True):
            ours = of(turns.get(model), partial(Turns.rate, method=name))
            rows.append(Row(f"{model}: {words}", rate, ours, "fps", 1, Basis.HARDWARE))
    return Table("Frame rates at 1000 × 900", "Table 4", tuple(rows))


def _table_5(turns: TurnsOf) -> Table:
    rows = []
    claims = []
    for model, (with_map, multiple) in SPEED_UP.items():
        taken = turns.get(model)
        single_rate, _, many_rate = FRAME_RATE[model]
        for words, name, over, published, note in (
            ("single with OM over single", "map", "single", one_more(with_map), ""),
            ("multiple over single with OM", "multiple", "map", one_more(multiple), ""),
            ("multiple over single", "multiple", "single", ratio_of(many_rate, single_rate),
             "by Table 4"),
        ):  # fmt: skip
            gain = None if taken is None else taken.gain(name, over)
            by_processor = None if taken is None else taken.gain(name, over, PROCESSOR)
            rows += [
                Row(f"{model}: {words}", published, of(gain, value), "", 2, Basis.WITHIN_RUN, note),
                Row(f"{model}: {words}, by processor time", None, of(by_processor, value), "", 2,
                    Basis.WITHIN_RUN),
            ]  # fmt: skip
            if not note:
                claims.append(
                    Claim(
                        f"{model}: {words}: {100 * (published.amount - 1):.0f} % faster",
                        Sense.AT_LEAST,
                        gain,
                        published,
                        told="" if taken is None else taken.spent(over, name),
                    )
                )
    return Table("Speed-ups", "Table 5", tuple(rows), (*claims, *_orders(turns)))


def _orders(turns: TurnsOf) -> tuple[Claim, ...]:
    gains = {model: taken.gain("map", "single") for model, taken in turns.items()}
    others = [gain for model, gain in gains.items() if model != "Angio"]
    waits = [taken.gain("map", "multiple", "batches") for taken in turns.values()]
    return (
        Claim(
            "multiple queries wait less often than single ones with a map, in every scene: the "
            "greatest quotient of waits",
            Sense.AT_MOST,
            most(*waits) if waits else None,
            told=", ".join(
                f"{model} {taken.mean('multiple', 'batches'):.1f} of "
                f"{taken.mean('map', 'batches'):.1f}"
                for model, taken in turns.items()
            ),
        ),
        Claim(
            "Angio gains most from the map: its gain over the greatest of the others'",
            Sense.AT_LEAST,
            gains["Angio"] / most(*others) if "Angio" in gains and others else None,
        ),
    )
