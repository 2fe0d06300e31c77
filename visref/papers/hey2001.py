"""H. Hey, R. F. Tobler, W. Purgathofer: Real-Time Occlusion Culling With A Lazy Occlusion Grid.

TR-186-2-01-02, Vienna University of Technology, January 2001. Section 7 and Figs. 7 to 9.

Measured on `forest` and `city_large`, which have the paper's numbers of triangles; its models
and walkthroughs are not available. So triangles and queries compare in ratio and order alone,
and times, which belong to a GeForce2 and a 900 MHz Thunderbird, as ratios within one run.
"""

from __future__ import annotations

from dataclasses import dataclass

from visref.papers.contents import Basis, Experiment, JudgedRun, Results, Row, Size, Table, Trend
from visref.papers.culler_frames import CullerFrames, culler_frames

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


# What stands in for a scene that is judged with --large alone.
STAND_IN = {"city_large": "city_large:scale=0.1"}
STAND_IN_NOTE = "a tenth of the City; the whole with --large"


def _key(scene: str, width: int) -> str:
    return f"{scene}-{width}"


def _stand_in_key(scene: str, width: int) -> str:
    return f"{scene}-tenth-{width}"


def _judged(key: str, spec: str, size: Size, *, large: bool = False) -> JudgedRun:
    cullers = tuple(specs(spec.partition(":")[0]).values())
    return JudgedRun(key, spec, cullers, size=size, large=large)


RUNS = tuple(
    run
    for scene in SCENE_TRIANGLES
    for size in SIZES
    for run in (
        _judged(_key(scene, size[0]), scene, size, large=scene in STAND_IN),
        *(
            [_judged(_stand_in_key(scene, size[0]), STAND_IN[scene], size)]
            if scene in STAND_IN
            else []
        ),
    )
)
EXPERIMENTS: tuple[Experiment, ...] = ()


def tables(results: Results) -> list[Table]:
    """Section 7's scenes, Figs. 7 to 9, and the share of readbacks."""
    runs = {
        (scene, width): run
        for scene in SCENE_TRIANGLES
        for width, _ in SIZES
        if (run := _measured(results, scene, width)) is not None
    }
    return [_scenes(runs), _figure_7(runs), _figure_8(runs), _figure_9(runs)]


@dataclass(frozen=True)
class _Run:
    """One scene and resolution: the scene's triangles, and the frames by update."""

    triangles: int
    by_update: dict[str, CullerFrames]
    note: str = ""

    def mean(self, counter: str) -> dict[str, float]:
        return {update: one.mean(counter) for update, one in self.by_update.items()}

    def ms(self, phase: str = "frame") -> dict[str, float]:
        return {update: one.ms(phase) for update, one in self.by_update.items()}


_Runs = dict[tuple[str, int], _Run]


def _measured(results: Results, scene: str, width: int) -> _Run | None:
    run, note = results.run(_key(scene, width)), ""
    if run is None and scene in STAND_IN:
        run, note = results.run(_stand_in_key(scene, width)), STAND_IN_NOTE
    if run is None:
        return None
    by_update = {update: culler_frames(run, spec) for update, spec in specs(scene).items()}
    return _Run(run.manifest.scene.triangles, by_update, note)


def _named(scene: str, width: int) -> str:
    name = {"forest": "Forest", "city_large": "City"}[scene]
    return f"{name}, {width} × {dict(SIZES)[width]}"


def _note(run: _Run | None) -> str:
    return run.note if run is not None else ""


def _scenes(runs: _Runs) -> Table:
    rows = []
    for scene, published in SCENE_TRIANGLES.items():
        run = runs.get((scene, SIZES[0][0]))
        ours = None if run is None else run.triangles
        name = "Forest" if scene == "forest" else "City"
        rows.append(Row(f"{name}: triangles", published, ours, note=_note(run)))
    rows.append(Row("a cell's side", CELL_PX, CELL_PX, "px"))
    rows.append(Row("City: triangles a box, at most", TRIANGLES_A_BOX, TRIANGLES_A_BOX))
    return Table("Scenes and set-up", "section 7", tuple(rows))


def _figure_7(runs: _Runs) -> Table:
    rows: list[Row] = []
    for at, (published, everything) in TRIANGLES_DRAWN.items():
        run = runs.get(at)
        drawn = run.mean("triangles_drawn") if run is not None else {}
        name, note = _named(*at), _note(run)
        share = drawn["lazy"] / drawn["none"] if drawn else None
        rows += [
            Row(f"{name}: lazy", published, drawn.get("lazy"), note=note),
            Row(f"{name}: busy", published, drawn.get("busy"), note=note),
            Row(f"{name}: no occlusion culling", everything, drawn.get("none"), note=note),
            Row(f"{name}: lazy over none", published / everything, share, "%", 2, note=note),
        ]
    same = [_same_drawn(run) for run in runs.values()]
    trends = [
        Trend("lazy draws as much as busy, in every frame", all(same) if same else None),
        *(_saving(scene, runs) for scene in SCENE_TRIANGLES),
    ]
    return Table("Triangles drawn a frame", "Fig. 7", tuple(rows), tuple(trends))


def _saving(scene: str, runs: _Runs) -> Trend:
    """Whether the grid leaves about as little to draw as in the paper; and where it does not,
    how much of what it draws is really seen."""
    published = max(lazy / none for (name, _), (lazy, none) in TRIANGLES_DRAWN.items()
                    if name == scene)  # fmt: skip
    claim = f"{scene}: lazy draws no more than {100 * published:.1f} % of what none draws"
    found = [run for (name, _), run in runs.items() if name == scene]
    if not found:
        return Trend(claim, None)
    shares = [run.mean("triangles_drawn") for run in found]
    worst = max(drawn["lazy"] / drawn["none"] for drawn in shares)
    seen = [run.mean("superfluous")["lazy"] / run.mean("drawn")["lazy"] for run in found]
    why = (
        f"it is {100 * worst:.1f} %, and of the boxes drawn {100 * (1 - max(seen)):.0f} % own a "
        "sample: the generated scene shows more at once than the paper's"
    )
    return Trend(claim, worst <= published, why)


def _same_drawn(run: _Run) -> bool:
    """Whether lazy and busy drew the same number of triangles in every frame."""
    lazy, busy = (run.by_update[update].counts("triangles_drawn") for update in ("lazy", "busy"))
    return lazy == busy


def _figure_8(runs: _Runs) -> Table:
    rows: list[Row] = []
    gains: dict[tuple[str, int], float] = {}
    for at, (lazy, busy) in PIXEL_QUERIES.items():
        run = runs.get(at)
        asked = run.mean("queries") if run is not None else {}
        if asked:
            gains[at] = asked["busy"] / asked["lazy"]
        name, note = _named(*at), _note(run)
        rows += [
            Row(f"{name}: lazy", lazy, asked.get("lazy"), note=note),
            Row(f"{name}: busy", busy, asked.get("busy"), note=note),
            Row(f"{name}: busy over lazy", busy / lazy, gains.get(at), digits=2, note=note),
        ]
    trends = []
    for scene in SCENE_TRIANGLES:
        low, high = (gains.get((scene, width)) for width, _ in SIZES)
        holds = None if low is None or high is None else 1.0 < low < high
        why = f"busy over lazy is {low:.2f}, then {high:.2f}" if low and high else ""
        claim = f"{scene}: lazy beats busy, and by more at the higher resolution"
        trends.append(Trend(claim, holds, why))
    return Table("Pixel-level queries a frame", "Fig. 8", tuple(rows), tuple(trends))


def _figure_9(runs: _Runs) -> Table:
    rows: list[Row] = []
    low, high = FRAME_RATE_GAIN
    least, most = READBACK_SHARE
    for at in TRIANGLES_DRAWN:
        run = runs.get(at)
        ms = run.ms() if run is not None else {}
        asking = run.ms("query")["lazy"] / ms["lazy"] if run is not None else None
        name, note = _named(*at), _note(run)
        rows += [
            Row(f"{name}: {update}", None, ms.get(update), "ms", 1, Basis.HARDWARE, note)
            for update in ("lazy", "busy", "none")
        ]
        gain = ms["none"] / ms["lazy"] if ms else None
        published = f"{low} to {high}"
        shares = f"{least:.0%} to {most:.0%}".replace("%", " %")
        rows += [
            Row(f"{name}: frame rate, lazy over none", published, gain, "", 1,
                Basis.WITHIN_RUN, note),
            Row(f"{name}: queries' share of the time, lazy", shares, asking, "%", 0,
                Basis.WITHIN_RUN, note),
        ]  # fmt: skip
    return Table("Time a frame", "Fig. 9 and section 7", tuple(rows), _time_trends(runs))


def _time_trends(runs: _Runs) -> tuple[Trend, ...]:
    gains = {at: run.ms()["none"] / run.ms()["lazy"] for at, run in runs.items()}
    told = "; ".join(f"{_named(*at)}: {gain:.2f}" for at, gain in gains.items())
    faster = Trend(
        "the lazy grid is faster than no occlusion culling",
        min(gains.values()) > 1.0 if gains else None,
        f"frame rate, lazy over none, is {told}",
    )
    forests = {at: run.ms() for at, run in runs.items() if at[0] == "forest"}
    slower = [ms["busy"] > ms["none"] for ms in forests.values()]
    times = "; ".join(
        f"{_named(*at)}: busy {ms['busy']:.0f} ms, none {ms['none']:.0f} ms"
        for at, ms in forests.items()
    )
    busy = Trend(
        "in the forest the busy grid is slower than no occlusion culling",
        all(slower) if slower else None,
        f"reading depth back is cheap where the image is in main memory ({times})",
    )
    return (faster, busy)
