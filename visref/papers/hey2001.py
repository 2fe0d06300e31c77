"""H. Hey, R. F. Tobler, W. Purgathofer: Real-Time Occlusion Culling With A Lazy Occlusion Grid.

TR-186-2-01-02, Vienna University of Technology, January 2001. Section 7 and Figs. 7 to 9.

Measured on `forest` and `city_large`, which have the paper's numbers of triangles; its models
and walkthroughs are not available. So triangles and queries compare in ratio and order alone,
and times, which belong to a GeForce2 and a 900 MHz Thunderbird, as ratios within one run.
"""

from __future__ import annotations

from visref.papers.readings import Reading, reading
from visref.papers.table import Basis, Experiment, Records, Row, Size, Table, Trend, Walk
from visref.run_record import RunRecord

TITLE = (
    "H. Hey, R. F. Tobler, W. Purgathofer: Real-Time Occlusion Culling With A Lazy Occlusion "
    "Grid. Vienna University of Technology, 2001"
)

SCENE_TRIANGLES = {"forest": 1_694_426, "city_large": 34_034_176}
SIZES: tuple[Size, ...] = ((640, 480), (1280, 960))
CELL_PX = 32
TRIANGLES_A_BOX = 1500

# By scene and image width (640 by 480, 1280 by 960).
TRIANGLES_DRAWN = {  # Fig. 7: lazy and busy, no occlusion culling
    ("forest", 640): (7_009, 147_969),
    ("forest", 1280): (7_510, 147_969),
    ("city_large", 640): (11_981, 1_964_918),
    ("city_large", 1280): (11_775, 1_964_918),
}
PIXEL_QUERIES = {  # Fig. 8: lazy, busy
    ("forest", 640): (498, 2_394),
    ("forest", 1280): (650, 6_781),
    ("city_large", 640): (565, 1_332),
    ("city_large", 1280): (937, 4_227),
}
FRAME_RATE_GAIN = (1.9, 5.8)  # Fig. 9 and section 7: lazy over none, the least and the most
READBACK_SHARE = (0.38, 0.52)  # of the frame's time, lazy


def specs(scene: str) -> dict[str, str]:
    """The cullers to run: "lazy", "busy" and "none", as the paper set them up."""
    boxes = "" if scene == "forest" else f",boxes=triangles,leaf={TRIANGLES_A_BOX}"
    return {
        update: f"lazy-grid:update={update},cell={CELL_PX}{boxes}"
        for update in ("lazy", "busy", "none")
    }


def _key(scene: str, width: int) -> str:
    return f"{scene}-{width}"


WALKS = tuple(
    Walk(
        _key(scene, size[0]),
        scene,
        tuple(specs(scene).values()),
        size=size,
        large=scene == "city_large",
    )
    for scene in SCENE_TRIANGLES
    for size in SIZES
)
EXPERIMENTS: tuple[Experiment, ...] = ()


def tables(records: Records) -> list[Table]:
    """Section 7's scenes, Figs. 7 to 9, and the share of readbacks."""
    runs = {
        (scene, width): records.run(_key(scene, width))
        for scene in SCENE_TRIANGLES
        for width, _ in SIZES
    }
    walks = {at: _walks(run, at[0]) for at, run in runs.items() if run is not None}
    return [_scenes(runs), _figure_7(walks), _figure_8(walks), _figure_9(walks)]


Walks = dict[tuple[str, int], dict[str, Reading]]


def _walks(run: RunRecord, scene: str) -> dict[str, Reading]:
    return {update: reading(run, spec) for update, spec in specs(scene).items()}


def _named(scene: str, width: int) -> str:
    name = {"forest": "Forest", "city_large": "City"}[scene]
    return f"{name}, {width} × {width * 3 // 4}"


def _scenes(runs: dict[tuple[str, int], RunRecord | None]) -> Table:
    rows = []
    for scene, published in SCENE_TRIANGLES.items():
        run = runs[scene, SIZES[0][0]]
        ours = None if run is None else run.manifest["scene"]["triangles"]
        rows.append(Row(f"{scene}: triangles", published, ours, note=_left_out(ours)))
    rows.append(Row("cell, pixels a side", CELL_PX, CELL_PX))
    rows.append(Row("triangles a box in the City, at most", TRIANGLES_A_BOX, TRIANGLES_A_BOX))
    return Table("Scenes and set-up", "section 7", tuple(rows))


def _left_out(ours: float | None) -> str:
    return "asked for with --large" if ours is None else ""


def _figure_7(walks: Walks) -> Table:
    rows: list[Row] = []
    for at, (published, everything) in TRIANGLES_DRAWN.items():
        walk = walks.get(at)
        drawn = {name: one.mean("triangles_drawn") for name, one in (walk or {}).items()}
        note = _left_out(drawn.get("lazy"))
        name = _named(*at)
        rows += [
            Row(f"{name}: lazy", published, drawn.get("lazy"), note=note),
            Row(f"{name}: busy", published, drawn.get("busy"), note=note),
            Row(f"{name}: no occlusion culling", everything, drawn.get("none"), note=note),
            Row(
                f"{name}: lazy over none",
                published / everything,
                drawn["lazy"] / drawn["none"] if drawn else None,
                unit="%",
                digits=2,
                note=note,
            ),
        ]
    same = [_same_drawn(walk) for walk in walks.values()]
    trend = Trend("lazy draws as much as busy, in every frame", all(same) if same else None)
    return Table("Triangles drawn a frame", "Fig. 7", tuple(rows), (trend,))


def _same_drawn(walk: dict[str, Reading]) -> bool:
    """Whether lazy and busy drew the same number of triangles in every frame."""
    lazy, busy = ([row["triangles_drawn"] for row in walk[name].rows] for name in ("lazy", "busy"))
    return lazy == busy


def _figure_8(walks: Walks) -> Table:
    rows: list[Row] = []
    for at, (lazy, busy) in PIXEL_QUERIES.items():
        asked = {name: one.mean("queries") for name, one in walks.get(at, {}).items()}
        note = _left_out(asked.get("lazy"))
        name = _named(*at)
        rows += [
            Row(f"{name}: lazy", lazy, asked.get("lazy"), note=note),
            Row(f"{name}: busy", busy, asked.get("busy"), note=note),
            Row(f"{name}: busy over lazy", busy / lazy, _gain(asked), digits=2, note=note),
        ]
    trends = []
    for scene in SCENE_TRIANGLES:
        gains = [
            _gain({name: one.mean("queries") for name, one in walks.get((scene, w), {}).items()})
            for w, _ in SIZES
        ]
        low, high = gains
        holds = None if low is None or high is None else 1.0 < low < high
        trends.append(
            Trend(f"{scene}: lazy beats busy, and by more at the higher resolution", holds)
        )
    return Table("Pixel-level queries a frame", "Fig. 8", tuple(rows), tuple(trends))


def _gain(asked: dict[str, float]) -> float | None:
    return asked["busy"] / asked["lazy"] if asked else None


def _figure_9(walks: Walks) -> Table:
    rows: list[Row] = []
    low, high = FRAME_RATE_GAIN
    least, most = READBACK_SHARE
    for at in TRIANGLES_DRAWN:
        walk = walks.get(at)
        ms = {name: one.ms() for name, one in (walk or {}).items()}
        note = _left_out(ms.get("lazy"))
        name = _named(*at)
        rows += [
            *(
                Row(f"{name}: {update}", None, ms.get(update), "ms", 1, Basis.HARDWARE, note)
                for update in ("lazy", "busy", "none")
            ),
            Row(
                f"{name}: frame rate, lazy over none",
                f"{low} to {high}",
                ms["none"] / ms["lazy"] if ms else None,
                digits=1,
                basis=Basis.WITHIN_RUN,
                note=note,
            ),
            Row(
                f"{name}: queries' share of the time, lazy",
                f"{least:.0%} to {most:.0%}",
                walk["lazy"].ms("query") / ms["lazy"] if walk else None,
                unit="%",
                basis=Basis.WITHIN_RUN,
                note=note,
            ),
        ]
    gains = [walk["none"].ms() / walk["lazy"].ms() for walk in walks.values()]
    trend = Trend(
        "lazy occlusion culling is faster than none",
        min(gains) > 1.0 if gains else None,
        "drawing hidden triangles costs a software rasteriser little beside the queries",
    )
    return Table("Time a frame", "Fig. 9 and section 7", tuple(rows), (trend,))
