"""D. Staneker, D. Bartz, M. Meissner: Improving Occlusion Query Efficiency with Occupancy Maps.

PVG 2003. Sections 2, 3 and 5, Tables 1 to 5, Figs. 1 and 8 to 11.

Measured on `angio`, `boombox`, `formula_one` and `city_cars`, which have the paper's numbers of
shapes and polygons; its models and paths are not available. So pixels compare in ratio and
order, and frame rates, which belong to a GeForce4 and a VISUALIZE fx10, as ratios within one run.
Numbers of the document differ from one another: Table 3 prints 2,134 polygons a shape for the City,
where its own numbers make 2,136; the text gives the City the BoomBox' 37.9 frames a second, and
Table 4 is followed; its speed-ups of "35 % to 78 %" are over single queries without a map, those
of Table 5 over ones with a map.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

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
    Size,
    Table,
    most,
    one_more,
    ratio_of,
    single,
)
from visref.papers.culler_frames import CullerFrames, culler_frames
from visref.papers.printed.staneker2003 import (
    ALWAYS_VISIBLE,
    BOX_PIXELS,
    FRAME_RATE,
    FRAME_RATE_HP,
    LISTS,
    MAP_BYTES,
    MODELS,
    ORDERS,
    PIXELS_LEFT,
    QUERY_IN_TRIANGLES,
    SPEED_UP,
    TWICE,
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
SMALL: Size = (876, 584)  # Tables 1 and 2
LARGE: Size = (1000, 900)  # Tables 4 and 5


FIGURES = {"Angio": 8, "FormulaOne": 9, "BoomBox": 10, "City": 11}

# What "orders of magnitude" must mean at least: it is a plural.
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
        """Frames a second, on average: of all frames over their time."""
        return 1e3 / self.by_culler[culler].ms()

    def gain(self, culler: str, over: str) -> Estimate:
        """How many times as fast as another a culler is. Both draw a frame one after the other, so
        that a disturbance of minutes meets both."""
        ours, others = (self.by_culler[name].ms_series().mean() for name in (culler, over))
        return others / ours

    def box_pixels(self, culler: str) -> Estimate:
        """Pixels of boxes that are not occluded, a frame."""
        return self.by_culler[culler].series("query_fragments_passed").mean()

    def left(self, culler: str) -> Estimate:
        """The share of those pixels that a map does not save."""
        return self.box_pixels(culler) / self.box_pixels(COUNTED_SINGLE)


_Runs = dict[str, _Run]  # by model, those that were measured
_T = TypeVar("_T")
_U = TypeVar("_U")


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


def _of(measured: _T | None, number: Callable[[_T], _U]) -> _U | None:
    """What a function makes of what was measured, None of nothing."""
    return None if measured is None else number(measured)


def _models(runs: _Runs) -> Table:
    rows = []
    for model, (shapes, polygons, average) in MODELS.items():
        run = runs.get(model)
        note = "printed beside numbers that make 2,136" if model == "City" else ""
        rows += [
            Row(f"{model}: shapes", shapes, _of(run, lambda w: w.shapes)),
            Row(f"{model}: polygons", polygons, _of(run, lambda w: w.triangles)),
            Row(f"{model}: polygons a shape", average,
                _of(run, lambda w: w.triangles / w.shapes), note=note),
        ]  # fmt: skip
    return Table("Models", "Table 3", tuple(rows))


def _latency(results: Results) -> Table:
    found = results.experiment("latency")
    faster = _of(found, lambda f: f["unculled_ms"][-1] / f["culled_ms"][-1])
    cost = _of(results.experiment("query-in-triangles"), lambda f: f["query_ms"] / f["triangle_ms"])
    rows = [
        Row("a query in triangles of 25 pixels", QUERY_IN_TRIANGLES, cost, basis=Basis.WITHIN_RUN),
        Row("largest box: back faces drawn over culled", TWICE, faster, digits=2,
            basis=Basis.WITHIN_RUN, note="theirs is almost that"),
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
    claims = (
        Claim(
            "a query's latency grows with its box's pixels: the largest box's over the smallest's",
            Sense.AT_LEAST,
            _of(growth, single),
            digits=1,
        ),
        Claim(
            "back-face culling makes a query almost twice as fast, of the largest box",
            Sense.AT_LEAST,
            _of(faster, single),
            TWICE,
        ),
    )
    return Table(
        "Latency of an occlusion query",
        "section 2 and Fig. 1",
        tuple(rows),
        claims,
        figure=figure,
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
    claim = Claim(
        "a lookup costs orders of magnitude less than a query, at least two: the quickest query's "
        "time over the dearest lookup's",
        Sense.AT_LEAST,
        _of(share, single),
        even=LEAST_ORDERS,
        ties=True,
        digits=0,
    )
    return Table("The map", "sections 2 and 3", tuple(rows), (claim,))


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
            Row(f"{model}: with over without", ratio_of(with_map, without),
                _of(run, lambda w: w.gain(COUNTED_MAP, COUNTED_SINGLE).value), "", 2,
                Basis.WITHIN_RUN),
        ]  # fmt: skip
    return Table("Frame rates at 876 × 584", "Table 1", tuple(rows))


def _table_2(runs: _Runs) -> Table:
    rows = []
    note = "ours are front faces alone; whether theirs are is not said"
    for model, (without, with_map) in BOX_PIXELS.items():
        run = runs.get(model)
        rows += [
            Row(f"{model}: without OM", without,
                _of(run, lambda w: w.box_pixels(COUNTED_SINGLE).value), "px", note=note),
            Row(f"{model}: with OM", with_map,
                _of(run, lambda w: w.box_pixels(COUNTED_MAP).value), "px", note=note),
            Row(f"{model}: with over without", PIXELS_LEFT[model][0],
                _of(run, lambda w: w.left(COUNTED_MAP).value), "%"),
            Row(f"{model}: the same, shapes marked by their whole boxes", PIXELS_LEFT[model][0],
                _of(run, lambda w: w.left(COUNTED_BOXES).value), "%"),
        ]  # fmt: skip
    shares = {model: runs[model].left(COUNTED_MAP) for model in BOX_PIXELS if model in runs}
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
    ordered = None
    if len(shares) == len(BOX_PIXELS):
        ordered = most(
            shares["Angio"] / shares["BoomBox"], shares["BoomBox"] / shares["FormulaOne"]
        )
    claims.append(
        Claim(
            "the map saves most on Angio, then on BoomBox, least on FormulaOne: the greater of the "
            "quotients of what is left",
            Sense.AT_MOST,
            ordered,
        )
    )
    return Table("Pixels of boxes that are not occluded", "Table 2", tuple(rows), tuple(claims))


def _table_4(runs: _Runs) -> Table:
    rows = []
    for model, published in FRAME_RATE.items():
        for (name, culler), rate in zip(METHODS.items(), published, strict=True):
            ours = runs[model].rate(culler) if model in runs else None
            rows.append(Row(f"{model}: {name}", rate, ours, "fps", 1, Basis.HARDWARE))
    return Table("Frame rates at 1000 × 900", "Table 4", tuple(rows))


def _table_5(runs: _Runs) -> Table:
    rows = []
    claims = []
    for model, (with_map, multiple) in SPEED_UP.items():
        run = runs.get(model)
        single_rate, _, many_rate = FRAME_RATE[model]
        for name, culler, over, published, note in (
            ("single with OM over single", MAP, SINGLE, one_more(with_map), ""),
            ("multiple over single with OM", MULTIPLE, MAP, one_more(multiple), ""),
            ("multiple over single", MULTIPLE, SINGLE, ratio_of(many_rate, single_rate),
             "by Table 4"),
        ):  # fmt: skip
            gain = None if run is None else run.gain(culler, over)
            rows.append(
                Row(f"{model}: {name}", published, _of(gain, lambda g: g.value), "", 2,
                    Basis.WITHIN_RUN, note)
            )  # fmt: skip
            if not note:
                claims.append(
                    Claim(
                        f"{model}: {name}: {100 * (published.amount - 1):.0f} % faster",
                        Sense.AT_LEAST,
                        gain,
                        published,
                        told="" if run is None else _spent(run, over, culler),
                    )
                )
    return Table("Speed-ups", "Table 5", tuple(rows), (*claims, *_orders(runs)))


def _orders(runs: _Runs) -> tuple[Claim, ...]:
    gains = {model: run.gain(MAP, SINGLE) for model, run in runs.items()}
    others = [gain for model, gain in gains.items() if model != "Angio"]
    waits = [
        run.by_culler[MULTIPLE].series("batches").mean()
        / run.by_culler[MAP].series("batches").mean()
        for run in runs.values()
    ]
    return (
        Claim(
            "multiple queries wait less often than single ones with a map, in every scene: the "
            "greatest quotient of waits",
            Sense.AT_MOST,
            _greatest(waits),
            told=", ".join(
                f"{model} {run.by_culler[MULTIPLE].mean('batches'):.1f} of "
                f"{run.by_culler[MAP].mean('batches'):.1f}"
                for model, run in runs.items()
            ),
        ),
        Claim(
            "Angio gains most from the map: its gain over the greatest of the others'",
            Sense.AT_LEAST,
            gains["Angio"] / most(*others) if "Angio" in gains and others else None,
        ),
    )


def _greatest(figures: Iterable[Estimate]) -> Estimate | None:
    found = list(figures)
    return most(*found) if found else None


def _spent(run: _Run, before: str, after: str) -> str:
    """Where the time of a frame went before and after."""
    one, other = run.by_culler[before], run.by_culler[after]
    parts = ", ".join(
        f"{name} {one.ms(phase):.1f} to {other.ms(phase):.1f}"
        for name, phase in (("queries", "query"), ("drawing", "draw"), ("maps", "arrange"))
    )
    return (
        f"queries asked {one.mean('queries'):.0f} to {other.mean('queries'):.0f}; ms a frame: "
        f"{parts}"
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
