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

from dataclasses import dataclass

from visref.papers.readings import Reading, reading
from visref.papers.table import (
    Basis,
    Curve,
    Experiment,
    Figure,
    Records,
    Row,
    Size,
    Table,
    Trend,
    Walk,
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
SPEED_UP = {  # Table 5: the map over none, multiple queries over single ones with a map
    "Angio": (0.12, 0.34),
    "BoomBox": (0.01, 0.33),
    "FormulaOne": (0.04, 0.35),
    "City": (0.08, 0.66),
}
MAP_BYTES = 2_048  # section 3.1
LISTS = 5  # section 3.2
ALWAYS_VISIBLE = "5 to 10 %"  # section 2
QUERY_IN_TRIANGLES = 190  # section 2, after Severson
CULLED_SHARE = "about 0.5"  # section 2: a query's latency, back faces culled, over unculled

SINGLE, MAP, MULTIPLE = "occlusion-query", "occupancy-map:maps=1", "occupancy-map:maps=5"
COUNTED_SINGLE = f"{SINGLE}:fragments=true"
COUNTED_MAP = f"{MAP},fragments=true"
# Drawn shapes mark by their whole boxes.
COUNTED_BOXES = f"{MAP},parts=1,fragments=true"

WALKS = (
    *(
        Walk(f"{SCENES[model]}-876", SCENES[model], (COUNTED_SINGLE, COUNTED_MAP, COUNTED_BOXES),
             size=SMALL)
        for model in BOX_PIXELS
    ),
    *(
        Walk(f"{SCENES[model]}-1000", SCENES[model], (SINGLE, MAP, MULTIPLE), size=LARGE)
        for model in MODELS
    ),
)  # fmt: skip
EXPERIMENTS = (
    Experiment("latency", "occupancy-map-latency"),
    Experiment("lookup", "occupancy-map-lookup"),
    Experiment("query-in-triangles", "occupancy-map-query-in-triangles"),
)


def tables(records: Records) -> list[Table]:
    """Fig. 1, the map, Tables 3, 1, 2, 4 and 5, and Figs. 8 to 11."""
    small = {model: _measured(records, model, SMALL) for model in BOX_PIXELS}
    large = {model: _measured(records, model, LARGE) for model in MODELS}
    return [
        _models(large),
        _latency(records),
        _map(records, large),
        _table_1(small),
        _table_2(small),
        _table_4(large),
        _table_5(large),
        *(_along_the_path(model, walk) for model, walk in large.items()),
    ]


@dataclass(frozen=True)
class _Walk:
    """One model at one size: its shapes and triangles, and the readings by culler."""

    shapes: int
    triangles: int
    by_culler: dict[str, Reading]

    def rate(self, culler: str) -> float:
        """Frames a second, of the median frame."""
        return 1e3 / self.by_culler[culler].ms()


_Walks = dict[str, _Walk | None]


def _measured(records: Records, model: str, size: Size) -> _Walk | None:
    run = records.run(f"{SCENES[model]}-{size[0]}")
    if run is None:
        return None
    (cullers,) = (walk.cullers for walk in WALKS if walk.key == f"{SCENES[model]}-{size[0]}")
    scene = run.manifest["scene"]
    by_culler = {culler: reading(run, culler) for culler in cullers}
    return _Walk(scene["objects"], scene["triangles"], by_culler)


def _models(walks: _Walks) -> Table:
    rows = []
    for model, (shapes, polygons) in MODELS.items():
        walk = walks[model]
        ours = (walk.shapes, walk.triangles) if walk else None
        rows += [
            Row(f"{model}: shapes", shapes, ours and ours[0]),
            Row(f"{model}: polygons", polygons, ours and ours[1]),
            Row(f"{model}: polygons a shape", polygons / shapes, ours and ours[1] / ours[0],
                note="the text says 2,134" if model == "City" else ""),
        ]  # fmt: skip
    return Table("Models", "Table 3", tuple(rows))


def _latency(records: Records) -> Table:
    found = records.experiment("latency")
    triangles = records.experiment("query-in-triangles")
    ratio = found["culled_ms"][-1] / found["unculled_ms"][-1] if found else None
    cost = triangles["query_ms"] / triangles["triangle_ms"] if triangles else None
    rows = [
        Row("a query in triangles of 25 pixels", QUERY_IN_TRIANGLES, cost, basis=Basis.WITHIN_RUN),
        Row("largest box: back faces culled over not", CULLED_SHARE, ratio, digits=2,
            basis=Basis.WITHIN_RUN),
    ]  # fmt: skip
    grows: bool | None = None
    figure = None
    if found:
        area = tuple(px * px / 1e3 for px in found["sizes_px"])
        curves = [
            Curve(f"{name} back-face culling", area, tuple(1e3 * ms for ms in found[key]))
            for name, key in (("without", "unculled_ms"), ("with", "culled_ms"))
        ]
        figure = Figure("front face of the box, thousand pixels", "latency of a query, µs",
                        tuple(curves))  # fmt: skip
        grows = found["unculled_ms"][-1] > 2.0 * found["unculled_ms"][0]
        rows += [
            Row(f"latency of a query of {px} × {px} pixels", None, ms, "ms", 3, Basis.HARDWARE)
            for px, ms in zip(found["sizes_px"], found["culled_ms"], strict=True)
        ]
    trends = (
        Trend("a query's latency grows with the box's pixels", grows),
        Trend("back-face culling makes large queries almost twice as fast",
              None if ratio is None else ratio < 0.75,
              "" if ratio is None else f"it takes {ratio:.2f} of the time"),
    )  # fmt: skip
    return Table("Latency of an occlusion query", "section 2 and Fig. 1", tuple(rows), trends,
                 figure)  # fmt: skip


def _map(records: Records, walks: _Walks) -> Table:
    lookup, latency = records.experiment("lookup"), records.experiment("latency")
    rows = [
        Row("a map, bytes", MAP_BYTES, lookup and lookup["map_bytes"]),
        Row("lists of queries", LISTS, lookup and lookup["lists"]),
    ]
    share: float | None = None
    if lookup:
        rows += [
            Row(f"a lookup of {tiles} × {tiles} tiles", None, 1e6 * ms, "ns", 1, Basis.HARDWARE)
            for tiles, ms in zip(lookup["tiles"], lookup["lookup_ms"], strict=True)
        ]
        if latency:
            share = min(latency["culled_ms"]) / max(lookup["lookup_ms"])
    rows.append(Row("the quickest query over the dearest lookup", "orders of magnitude", share,
                    basis=Basis.WITHIN_RUN))  # fmt: skip
    for model, walk in walks.items():
        ours = None
        if walk:
            one = walk.by_culler[MAP]
            skipped = one.mean("tests_skipped")
            ours = skipped / (skipped + one.mean("queries"))
        rows.append(Row(f"{model}: shapes in view that need no query", ALWAYS_VISIBLE, ours, "%",
                        1, note="theirs of geometry, in various applications"))  # fmt: skip
    batches = [
        row["batches"] for walk in walks.values() if walk for row in walk.by_culler[MULTIPLE].rows
    ]
    trends = (
        Trend("a lookup costs orders of magnitude less than a query",
              None if share is None else share > 100.0,
              "" if share is None else f"a query takes {share:.0f} times as long"),
        Trend("no frame asks more than five times", max(batches) <= LISTS if batches else None),
    )  # fmt: skip
    return Table("The map", "sections 2 and 3", tuple(rows), trends)


def _table_1(walks: _Walks) -> Table:
    rows = []
    for model, published in FRAME_RATE_HP.items():
        walk = walks[model]
        ours = [walk.rate(culler) for culler in (COUNTED_SINGLE, COUNTED_MAP)] if walk else None
        rows += [
            Row(f"{model}: {name} OM", published[k], ours and ours[k], "fps", 1, Basis.HARDWARE)
            for k, name in enumerate(("without", "with"))
        ]
        rows.append(Row(f"{model}: with over without", published[1] / published[0],
                        ours and ours[1] / ours[0], "", 2, Basis.WITHIN_RUN))  # fmt: skip
    return Table("Frame rates at 876 × 584", "Table 1", tuple(rows))


def _table_2(walks: _Walks) -> Table:
    rows = []
    shares: dict[str, float] = {}
    note = "ours are front faces alone; whether theirs are is not said"
    for model, (without, with_map) in BOX_PIXELS.items():
        walk = walks[model]
        pixels = None
        if walk:
            pixels = [
                walk.by_culler[culler].mean("query_fragments_passed")
                for culler in (COUNTED_SINGLE, COUNTED_MAP, COUNTED_BOXES)
            ]
            shares[model] = pixels[1] / pixels[0]
        rows += [
            Row(f"{model}: without OM", without, pixels and pixels[0], "px", note=note),
            Row(f"{model}: with OM", with_map, pixels and pixels[1], "px", note=note),
            Row(f"{model}: with over without", with_map / without, shares.get(model), "%"),
            Row(f"{model}: the same, shapes marked by their whole box", None,
                pixels and pixels[2] / pixels[0], "%"),
        ]  # fmt: skip
    order = [shares.get(model) for model in BOX_PIXELS]
    measured = [share for share in order if share is not None]
    told = ", ".join(f"{model} {100 * share:.0f} %" for model, share in shares.items())
    trend = Trend(
        "the map saves most on Angio and least on FormulaOne",
        measured == sorted(measured) if len(measured) == len(order) else None,
        f"what is left is {told}",
    )
    return Table("Pixels of boxes that are not occluded", "Table 2", tuple(rows), (trend,))


def _table_4(walks: _Walks) -> Table:
    rows = []
    for model, published in FRAME_RATE.items():
        walk = walks[model]
        for name, culler, rate in zip(("single", "single with OM", "multiple"),
                                      (SINGLE, MAP, MULTIPLE), published, strict=True):  # fmt: skip
            rows.append(Row(f"{model}: {name}", rate, walk and walk.rate(culler), "fps", 1,
                            Basis.HARDWARE))  # fmt: skip
    return Table("Frame rates at 1000 × 900", "Table 4", tuple(rows))


def _table_5(walks: _Walks) -> Table:
    rows = []
    by_map: dict[str, float] = {}
    by_many: dict[str, float] = {}
    for model, (with_map, multiple) in SPEED_UP.items():
        walk = walks[model]
        if walk:
            by_map[model] = walk.rate(MAP) / walk.rate(SINGLE) - 1.0
            by_many[model] = walk.rate(MULTIPLE) / walk.rate(MAP) - 1.0
        single, _, many = FRAME_RATE[model]
        both = walk.rate(MULTIPLE) / walk.rate(SINGLE) - 1.0 if walk else None
        rows += [
            Row(f"{model}: single with OM over single", with_map, by_map.get(model), "%",
                basis=Basis.WITHIN_RUN),
            Row(f"{model}: multiple over single with OM", multiple, by_many.get(model), "%",
                basis=Basis.WITHIN_RUN),
            Row(f"{model}: multiple over single", many / single - 1.0, both, "%",
                basis=Basis.WITHIN_RUN, note="from Table 4"),
        ]  # fmt: skip
    return Table("Speed-ups", "Table 5", tuple(rows), _speed_trends(walks, by_map, by_many))


def _speed_trends(
    walks: _Walks, by_map: dict[str, float], by_many: dict[str, float]
) -> tuple[Trend, ...]:
    lists = ", ".join(f"{model} {100 * gain:+.0f} %" for model, gain in by_many.items())
    saved = "; ".join(_saved(model, walk) for model, walk in walks.items() if walk)
    return (
        Trend("multiple queries beat single ones, in every scene",
              min(by_many.values()) > 0.0 if by_many else None, lists),
        Trend("the map makes single queries faster, in every scene",
              min(by_map.values()) > 0.0 if by_map else None, saved),
        Trend("Angio gains most from the map",
              max(by_map, key=lambda model: by_map[model]) == "Angio" if by_map else None, saved),
    )  # fmt: skip


def _saved(model: str, walk: _Walk) -> str:
    """What the map saved in queries, and what keeping it costs."""
    single, with_map = walk.by_culler[SINGLE], walk.by_culler[MAP]
    asked, less = single.mean("queries"), with_map.mean("queries")
    return (
        f"{model}: {walk.rate(MAP) / walk.rate(SINGLE) - 1.0:+.0%} with {1 - less / asked:.0%} of "
        f"the queries saved; asking took {single.ms('query'):.1f} ms and takes "
        f"{with_map.ms('query'):.1f}, the map {with_map.ms('arrange'):.1f} ms of "
        f"{with_map.ms():.1f} a frame"
    ).replace("%", " %")


FIGURES = {"Angio": 8, "FormulaOne": 9, "BoomBox": 10, "City": 11}


def _along_the_path(model: str, walk: _Walk | None) -> Table:
    """Frame rates and polygons by frame: the paper's plots, whose values it does not print."""
    rows: list[Row] = []
    figure = None
    drawn = None
    if walk:
        curves = []
        for name, culler in (("single", SINGLE), ("single with OM", MAP), ("multiple", MULTIPLE)):
            times = walk.by_culler[culler].ms_of["frame"]
            frames = tuple(sorted(times))
            curves.append(Curve(name, tuple(map(float, frames)),
                                tuple(1e3 / times[frame] for frame in frames)))  # fmt: skip
        figure = Figure("frame", "frames a second", tuple(curves))
        drawn = walk.by_culler[SINGLE].mean("triangles_drawn") / walk.triangles
    rows.append(Row("polygons drawn, single", None, drawn, "%", note="plotted, not printed"))
    return Table(f"{model}: frame rates along the path", f"Fig. {FIGURES[model]}", tuple(rows),
                 figure=figure)  # fmt: skip
