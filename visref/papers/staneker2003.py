"""D. Staneker, D. Bartz, M. Meissner: Improving Occlusion Query Efficiency with Occupancy Maps.

PVG 2003. Sections 2, 3 and 5, Tables 1 to 5, Figs. 1 and 8 to 11.

Measured on `angio`, `boombox`, `formula_one` and `city_cars`, which have the paper's numbers of
shapes and polygons; its models and paths are not available. So pixels compare in ratio and
order, and frame rates, which belong to a GeForce4 and a VISUALIZE fx10, as ratios within one run.
Three numbers of the text differ from its own tables, which are followed: the City has 2,136
polygons a shape, not 2,134; 37.9 frames a second are the BoomBox', not the City's; and the
speed-ups of "35 % to 78 %" are over single queries without a map, Table 5's over those with one.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

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
SMALL: Size = (876, 584)  # Tables 1 and 2
LARGE: Size = (1000, 900)  # Tables 4 and 5

MODELS = {  # Table 3: shapes, polygons
    "Angio": (177, 419_639),
    "BoomBox": (530, 644_268),
    "FormulaOne": (306, 746_827),
    "City": (1_900, 4_059_195),
}
FRAME_RATE_HP = {"Angio": (7.0, 7.8), "BoomBox": (10.8, 11.1), "FormulaOne": (6.3, 6.5)}  # Table 1
BOX_PIXELS = {  # Table 2: of boxes that are not occluded, without a map and with one
    "Angio": (2_953_200, 382_450),
    "BoomBox": (3_469_702, 1_365_960),
    "FormulaOne": (1_217_297, 544_213),
}
FRAME_RATE = {  # Table 4: single queries, single with a map, multiple
    "Angio": (20.3, 22.8, 30.5),
    "BoomBox": (28.0, 28.4, 37.9),
    "FormulaOne": (17.7, 18.4, 24.9),
    "City": (17.2, 18.5, 30.7),
}
SPEED_UP = {  # Table 5: the map over none, multiple queries over single ones with a map, less 1
    "Angio": (0.12, 0.34),
    "BoomBox": (0.01, 0.33),
    "FormulaOne": (0.04, 0.35),
    "City": (0.08, 0.66),
}
FIGURES = {"Angio": 8, "FormulaOne": 9, "BoomBox": 10, "City": 11}
MAP_BYTES = 2_048  # section 3.1
LISTS = 5  # section 3.2
ALWAYS_VISIBLE = "5 to 10 %"  # section 2
QUERY_IN_TRIANGLES = 190  # section 2, after Severson
CULLED_SHARE = "about 0.5"  # section 2: a query's latency, back faces culled, over unculled
ORDERS = "orders of magnitude"  # section 3.1: a query's latency over a lookup's

# What the words must mean at least: "almost twice as fast" is nearer to twice than to once, as
# a ratio; "orders of magnitude" are two.
ALMOST_TWICE = 2.0**0.5
LEAST_ORDERS = 100.0

SINGLE, MAP, MULTIPLE = "occlusion-query", "occupancy-map:maps=1", "occupancy-map:maps=5"
METHODS = {"single": SINGLE, "single with OM": MAP, "multiple": MULTIPLE}
COUNTED_SINGLE = f"{SINGLE}:fragments=true"
COUNTED_MAP = f"{MAP},fragments=true"
# Drawn shapes mark by their whole boxes.
COUNTED_BOXES = f"{MAP},parts=1,fragments=true"

RUNS = (
    *(
        JudgedRun(f"{SCENES[model]}-876", SCENES[model],
                  (COUNTED_SINGLE, COUNTED_MAP, COUNTED_BOXES), size=SMALL)
        for model in BOX_PIXELS
    ),
    *(
        JudgedRun(f"{SCENES[model]}-1000", SCENES[model], tuple(METHODS.values()), size=LARGE)
        for model in MODELS
    ),
)  # fmt: skip
EXPERIMENTS = (
    Experiment("latency", "occupancy-map-latency"),
    Experiment("lookup", "occupancy-map-lookup"),
    Experiment("query-in-triangles", "occupancy-map-query-in-triangles"),
)


def tables(results: Results) -> list[Table]:
    """Fig. 1, the map, Tables 3, 1, 2, 4 and 5, and Figs. 8 to 11."""
    small, large = _measured(results, SMALL), _measured(results, LARGE)
    return [
        _models(large),
        _latency(results),
        _map(results, large),
        _table_1(small),
        _table_2(small),
        _table_4(large),
        _table_5(large),
        *(_along_the_path(model, large.get(model)) for model in MODELS),
    ]


@dataclass(frozen=True)
class _Run:
    """One model at one size: its shapes and triangles, and the frames by culler."""

    shapes: int
    triangles: int
    by_culler: dict[str, CullerFrames]

    def rate(self, culler: str) -> float:
        """Frames a second, of the median frame."""
        return 1e3 / self.by_culler[culler].ms()

    def gain(self, culler: str, over: str) -> float:
        """How many times as fast as another a culler is in the median frame. Both draw a frame
        one after the other, so that a disturbance of minutes meets both."""
        times, others = (self.by_culler[name].ms_of["frame"] for name in (culler, over))
        return statistics.median(others[frame] / ms for frame, ms in times.items())

    def box_pixels(self, culler: str) -> float:
        """Pixels of boxes that are not occluded, a frame."""
        return self.by_culler[culler].mean("query_fragments_passed")


_Runs = dict[str, _Run]  # by model, those that were measured
_T = TypeVar("_T")


def _measured(results: Results, size: Size) -> _Runs:
    found = {}
    for judged in RUNS:
        run = results.run(judged.key) if judged.size == size else None
        if run is not None:
            scene = run.manifest.scene
            by_culler = {culler: culler_frames(run, culler) for culler in judged.cullers}
            (model,) = (model for model, name in SCENES.items() if name == judged.scene)
            found[model] = _Run(scene.objects, scene.triangles, by_culler)
    return found


def _of(measured: _T | None, number: Callable[[_T], float]) -> float | None:
    """A number of what was measured, None for nothing."""
    return None if measured is None else number(measured)


def _models(runs: _Runs) -> Table:
    rows = []
    for model, (shapes, polygons) in MODELS.items():
        run = runs.get(model)
        note = "the text says 2,134" if model == "City" else ""
        rows += [
            Row(f"{model}: shapes", shapes, _of(run, lambda w: w.shapes)),
            Row(f"{model}: polygons", polygons, _of(run, lambda w: w.triangles)),
            Row(f"{model}: polygons a shape", polygons / shapes,
                _of(run, lambda w: w.triangles / w.shapes), note=note),
        ]  # fmt: skip
    return Table("Models", "Table 3", tuple(rows))


def _latency(results: Results) -> Table:
    found = results.experiment("latency")
    ratio = _of(found, lambda f: f["culled_ms"][-1] / f["unculled_ms"][-1])
    cost = _of(results.experiment("query-in-triangles"), lambda f: f["query_ms"] / f["triangle_ms"])
    rows = [
        Row("a query in triangles of 25 pixels", QUERY_IN_TRIANGLES, cost, basis=Basis.WITHIN_RUN),
        Row("largest box: back faces culled over not", CULLED_SHARE, ratio, digits=2,
            basis=Basis.WITHIN_RUN),
    ]  # fmt: skip
    growth = _of(found, lambda f: f["unculled_ms"][-1] / f["unculled_ms"][0])
    figure = None
    if found:
        area = tuple(px * px / 1e3 for px in found["sizes_px"])
        curves = tuple(
            Curve(f"{name} back-face culling", area, tuple(1e3 * ms for ms in found[key]))
            for name, key in (("without", "unculled_ms"), ("with", "culled_ms"))
        )
        figure = Figure("front face of the box, thousand pixels", "latency of a query, µs", curves)
        rows += [
            Row(f"a query of {px} × {px} pixels", None, ms, "ms", 3, Basis.HARDWARE)
            for px, ms in zip(found["sizes_px"], found["culled_ms"], strict=True)
        ]
    trends = (
        Trend("a query's latency grows with its box's pixels",
              None if growth is None else growth > 1.0,
              "" if growth is None else f"the largest takes {growth:.1f} times the smallest's"),
        Trend("back-face culling makes a large query almost twice as fast",
              None if ratio is None else ratio * ALMOST_TWICE < 1.0,
              "" if ratio is None else f"it takes {ratio:.2f} of the time"),
    )  # fmt: skip
    return Table(
        "Latency of an occlusion query", "section 2 and Fig. 1", tuple(rows), trends, figure
    )


def _map(results: Results, runs: _Runs) -> Table:
    lookup, latency = results.experiment("lookup"), results.experiment("latency")
    rows = [
        Row("a map, bytes", MAP_BYTES, _of(lookup, lambda f: f["map_bytes"])),
        Row("lists of queries", LISTS, _of(lookup, lambda f: f["lists"])),
    ]
    share = None
    if lookup:
        share = _of(latency, lambda f: min(f["culled_ms"]) / max(lookup["lookup_ms"]))
        rows += [
            Row(f"a lookup of {tiles} × {tiles} tiles", None, 1e6 * ms, "ns", 1, Basis.HARDWARE)
            for tiles, ms in zip(lookup["tiles"], lookup["lookup_ms"], strict=True)
        ]
    rows.append(Row("quickest query over dearest lookup", ORDERS, share, basis=Basis.WITHIN_RUN))
    rows += [
        Row(f"{model}: shapes in view that need no query", ALWAYS_VISIBLE,
            _of(runs.get(model), _unasked), "%", 1, note="theirs of geometry, by estimates")
        for model in MODELS
    ]  # fmt: skip
    stalls = [n for run in runs.values() for n in run.by_culler[MULTIPLE].counts("batches")]
    trends = (
        Trend("a lookup costs orders of magnitude less than a query",
              None if share is None else share > LEAST_ORDERS,
              "" if share is None else f"a query takes {share:.0f} times as long"),
        Trend("no frame waits for more than five multiple queries",
              max(stalls) <= LISTS if stalls else None,
              f"at most {max(stalls)}" if stalls else ""),
    )  # fmt: skip
    return Table("The map", "sections 2 and 3", tuple(rows), trends)


def _unasked(run: _Run) -> float:
    """The share of the shapes in view that the map alone shows to be visible."""
    with_map = run.by_culler[MAP]
    skipped = with_map.mean("tests_skipped")
    return skipped / (skipped + with_map.mean("queries"))


def _table_1(runs: _Runs) -> Table:
    rows = []
    for model, (without, with_map) in FRAME_RATE_HP.items():
        run = runs.get(model)
        rows += [
            Row(f"{model}: without OM", without, _of(run, lambda w: w.rate(COUNTED_SINGLE)),
                "fps", 1, Basis.HARDWARE),
            Row(f"{model}: with OM", with_map, _of(run, lambda w: w.rate(COUNTED_MAP)),
                "fps", 1, Basis.HARDWARE),
            Row(f"{model}: with over without", with_map / without,
                _of(run, lambda w: w.gain(COUNTED_MAP, COUNTED_SINGLE)), "", 2, Basis.WITHIN_RUN),
        ]  # fmt: skip
    return Table("Frame rates at 876 × 584", "Table 1", tuple(rows))


def _table_2(runs: _Runs) -> Table:
    rows = []
    note = "ours are front faces alone; whether theirs are is not said"
    for model, (without, with_map) in BOX_PIXELS.items():
        run = runs.get(model)
        rows += [
            Row(f"{model}: without OM", without, _of(run, lambda w: w.box_pixels(COUNTED_SINGLE)),
                "px", note=note),
            Row(f"{model}: with OM", with_map, _of(run, lambda w: w.box_pixels(COUNTED_MAP)),
                "px", note=note),
            Row(f"{model}: with over without", with_map / without, _of(run, _left), "%"),
            Row(f"{model}: the same, shapes marked by their whole boxes", None,
                _of(run, lambda w: w.box_pixels(COUNTED_BOXES) / w.box_pixels(COUNTED_SINGLE)),
                "%"),
        ]  # fmt: skip
    shares = {model: _left(runs[model]) for model in BOX_PIXELS if model in runs}
    told = ", ".join(f"{model} {100 * share:.0f} %" for model, share in shares.items())
    trend = Trend(
        "the map saves most on Angio and least on FormulaOne",
        None if len(shares) < len(BOX_PIXELS) else list(shares.values()) == sorted(shares.values()),
        f"what is left is {told}",
    )
    return Table("Pixels of boxes that are not occluded", "Table 2", tuple(rows), (trend,))


def _left(run: _Run) -> float:
    """The share of the boxes' pixels that a map does not save."""
    return run.box_pixels(COUNTED_MAP) / run.box_pixels(COUNTED_SINGLE)


def _table_4(runs: _Runs) -> Table:
    rows = []
    for model, published in FRAME_RATE.items():
        for (name, culler), rate in zip(METHODS.items(), published, strict=True):
            ours = runs[model].rate(culler) if model in runs else None
            rows.append(Row(f"{model}: {name}", rate, ours, "fps", 1, Basis.HARDWARE))
    return Table("Frame rates at 1000 × 900", "Table 4", tuple(rows))


def _table_5(runs: _Runs) -> Table:
    rows = []
    for model, (with_map, multiple) in SPEED_UP.items():
        run = runs.get(model)
        single, _, many = FRAME_RATE[model]
        rows += [
            Row(f"{model}: single with OM over single", 1.0 + with_map,
                _of(run, lambda w: w.gain(MAP, SINGLE)), "", 2, Basis.WITHIN_RUN),
            Row(f"{model}: multiple over single with OM", 1.0 + multiple,
                _of(run, lambda w: w.gain(MULTIPLE, MAP)), "", 2, Basis.WITHIN_RUN),
            Row(f"{model}: multiple over single", many / single,
                _of(run, lambda w: w.gain(MULTIPLE, SINGLE)), "", 2, Basis.WITHIN_RUN,
                "by Table 4"),
        ]  # fmt: skip
    return Table("Speed-ups", "Table 5", tuple(rows), _speed_trends(runs))


def _speed_trends(runs: _Runs) -> tuple[Trend, ...]:
    many = {model: run.gain(MULTIPLE, MAP) for model, run in runs.items()}
    one = {model: run.gain(MAP, SINGLE) for model, run in runs.items()}
    waits = {model: [run.by_culler[culler].mean("batches") for culler in (MAP, MULTIPLE)]
             for model, run in runs.items()}  # fmt: skip
    lists = "; ".join(_spent(model, run, MAP, MULTIPLE) for model, run in runs.items())
    maps = "; ".join(_spent(model, run, SINGLE, MAP) for model, run in runs.items())
    fewer = ", ".join(f"{model} {many:.1f} of {one:.1f}" for model, (one, many) in waits.items())
    return (
        Trend("multiple queries wait less often than single ones with a map, in every scene",
              all(many < one for one, many in waits.values()) if waits else None, fewer),
        Trend("multiple queries beat single ones with a map, in every scene",
              min(many.values()) > 1.0 if many else None, lists),
        Trend("the map makes single queries faster, in every scene",
              min(one.values()) > 1.0 if one else None, maps),
        Trend("Angio gains most from the map",
              max(one, key=lambda model: one[model]) == "Angio" if len(one) > 1 else None, maps),
    )  # fmt: skip


def _spent(model: str, run: _Run, before: str, after: str) -> str:
    """A gain in frame rate, and where the time of a frame went before and after."""
    one, other = run.by_culler[before], run.by_culler[after]
    parts = ", ".join(
        f"{name} {one.ms(phase):.1f} to {other.ms(phase):.1f}"
        for name, phase in (("queries", "query"), ("drawing", "draw"), ("maps", "arrange"))
    )
    return (
        f"{model}: {run.gain(after, before):.2f}, queries asked {one.mean('queries'):.0f} to "
        f"{other.mean('queries'):.0f}; ms a frame: {parts}"
    )


def _along_the_path(model: str, run: _Run | None) -> Table:
    """Frame rates and polygons by frame: the paper plots them and prints no values."""
    figure = None
    if run:
        curves = []
        for name, culler in METHODS.items():
            times = run.by_culler[culler].ms_of["frame"]
            frames = sorted(times)
            rates = tuple(1e3 / times[frame] for frame in frames)
            curves.append(Curve(name, tuple(map(float, frames)), rates))
        figure = Figure("frame", "frames a second", tuple(curves))
    drawn = _of(run, lambda w: w.by_culler[SINGLE].mean("triangles_drawn") / w.triangles)
    rows = (Row("polygons drawn, single", None, drawn, "%", note="plotted there, not printed"),)
    return Table(f"{model}: along the path", f"Fig. {FIGURES[model]}", rows, figure=figure)
