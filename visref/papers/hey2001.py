"""H. Hey, R. F. Tobler, W. Purgathofer: Real-Time Occlusion Culling With A Lazy Occlusion Grid.

TR-186-2-01-02, Vienna University of Technology, January 2001. Section 7 and Figs. 7 to 9.

Measured on `forest` and `city_large`, which have the paper's numbers of triangles; its models
and walkthroughs are not available. So triangles and queries compare in ratio and order alone,
and times, which belong to a GeForce2 and a 900 MHz Thunderbird, as ratios within one run.
The City is judged whole (`--large`), or it is not measured.
"""

from __future__ import annotations

from dataclasses import dataclass

from visref.papers.contents import (
    Basis,
    Claim,
    Estimate,
    Experiment,
    JudgedRun,
    Results,
    Row,
    Sense,
    SetUp,
    Size,
    Table,
    most,
    ratio_of,
    series,
)
from visref.papers.culler_frames import CullerFrames, culler_frames
from visref.papers.printed.hey2001 import (
    CELL_PX,
    FRAME_RATE_GAIN,
    NAMES,
    PIXEL_QUERIES,
    READBACK_SHARE,
    SCENE_TRIANGLES,
    TRIANGLES_A_BOX,
    TRIANGLES_DRAWN,
)

TITLE = (
    "H. Hey, R. F. Tobler, W. Purgathofer: Real-Time Occlusion Culling With A Lazy Occlusion "
    "Grid. Vienna University of Technology, 2001"
)

SIZES: tuple[Size, ...] = ((640, 480), (1280, 960))


def specs(scene: str) -> dict[str, str]:
    """The cullers to run: "lazy", "busy" and "none", as the paper set them up."""
    boxes = "" if scene == "forest" else f",boxes=triangles,leaf={TRIANGLES_A_BOX.value}"
    return {
        update: f"lazy-grid:update={update},cell={CELL_PX.value}{boxes}"
        for update in ("lazy", "busy", "none")
    }


def _key(scene: str, width: int) -> str:
    return f"{scene}-{width}"


RUNS = tuple(
    JudgedRun(
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


def tables(results: Results) -> list[Table]:
    """Section 7's scenes, Figs. 7 to 9, and the share of readbacks."""
    runs: _Runs = {
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

    def mean(self, counter: str) -> dict[str, Estimate]:
        return {update: one.series(counter).mean() for update, one in self.by_update.items()}

    def ms(self, phase: str = "frame") -> dict[str, Estimate]:
        return {update: one.ms_series(phase).mean() for update, one in self.by_update.items()}


_At = tuple[str, int]
_Runs = dict[_At, _Run]


def _measured(results: Results, scene: str, width: int) -> _Run | None:
    run = results.run(_key(scene, width))
    if run is None:
        return None
    by_update = {update: culler_frames(run, spec) for update, spec in specs(scene).items()}
    return _Run(run.manifest.scene.triangles, by_update)


def _named(scene: str, width: int) -> str:
    return f"{NAMES[scene]}, {width} × {dict(SIZES)[width]}"


def _note(at: _At, runs: _Runs) -> str:
    return "" if at in runs or at[0] != "city_large" else "not measured: needs --large"


def _scenes(runs: _Runs) -> Table:
    rows = []
    for scene, published in SCENE_TRIANGLES.items():
        at = (scene, SIZES[0][0])
        ours = runs[at].triangles if at in runs else None
        rows.append(Row(f"{NAMES[scene]}: triangles", published, ours, note=_note(at, runs)))
    setup = (
        SetUp("a cell's side", CELL_PX, "px"),
        SetUp("City: triangles a box, at most", TRIANGLES_A_BOX),
    )
    return Table("Scenes and set-up", "section 7", tuple(rows), setup=setup)


def _of(figures: dict[str, Estimate], update: str) -> float | None:
    return figures[update].value if figures else None


def _figure_7(runs: _Runs) -> Table:
    rows: list[Row] = []
    claims: list[Claim] = []
    for at, (published, everything) in TRIANGLES_DRAWN.items():
        drawn = runs[at].mean("triangles_drawn") if at in runs else {}
        name, note = _named(*at), _note(at, runs)
        share = drawn["lazy"] / drawn["none"] if drawn else None
        printed = ratio_of(published, everything)
        rows += [
            Row(f"{name}: lazy", published, _of(drawn, "lazy"), note=note),
            Row(f"{name}: busy", published, _of(drawn, "busy"), note=note),
            Row(f"{name}: no occlusion culling", everything, _of(drawn, "none"), note=note),
            Row(f"{name}: lazy over none", printed, share.value if share else None, "%", 2,
                note=note),
        ]  # fmt: skip
        claims.append(
            Claim(
                f"{name}: lazy draws {100 * printed.amount:.2f} % of what none draws",
                Sense.AT_MOST,
                share,
                printed,
                unit="%",
                told=_shown(runs[at]) if at in runs else note,
            )
        )
    apart = [_apart(run) for run in runs.values()]
    claims.append(
        Claim(
            "lazy draws as many triangles as busy, in every frame of every scene measured: the "
            "most by which they differ",
            Sense.AT_MOST,
            most(*apart) if apart else None,
            even=0.0,
            ties=True,
            digits=0,
        )
    )
    return Table("Triangles drawn a frame", "Fig. 7", tuple(rows), tuple(claims))


def _shown(run: _Run) -> str:
    """How much of what is drawn is really seen."""
    seen = 1.0 - (run.mean("superfluous")["lazy"] / run.mean("drawn")["lazy"]).value
    return f"of the boxes drawn {100 * seen:.0f} % own a sample"


def _apart(run: _Run) -> Estimate:
    """By how many triangles lazy and busy differ in a frame, at most."""
    lazy, busy = (run.by_update[update].series("triangles_drawn") for update in ("lazy", "busy"))
    return series(abs(lazy.values - busy.values).tolist(), lazy.frames, lazy.walk).most()


def _figure_8(runs: _Runs) -> Table:
    rows: list[Row] = []
    claims: list[Claim] = []
    gains: dict[_At, Estimate] = {}
    for at, (lazy, busy) in PIXEL_QUERIES.items():
        asked = runs[at].mean("queries") if at in runs else {}
        if asked:
            gains[at] = asked["busy"] / asked["lazy"]
        name, note = _named(*at), _note(at, runs)
        printed, gain = ratio_of(busy, lazy), gains.get(at)
        rows += [
            Row(f"{name}: lazy", lazy, _of(asked, "lazy"), note=note),
            Row(f"{name}: busy", busy, _of(asked, "busy"), note=note),
            Row(f"{name}: busy over lazy", printed, gain.value if gain else None, digits=2,
                note=note),
        ]  # fmt: skip
        claims.append(
            Claim(
                f"{name}: busy asks {printed.amount:.2f} times the queries of lazy",
                Sense.AT_LEAST,
                gain,
                printed,
                told=note,
            )
        )
    for scene, name in NAMES.items():
        low, high = (gains.get((scene, width)) for width, _ in SIZES)
        before, after = (
            ratio_of(busy, lazy)
            for lazy, busy in (PIXEL_QUERIES[scene, width] for width, _ in SIZES)
        )
        printed = ratio_of(after, before)
        claims.append(
            Claim(
                f"{name}: that factor grows {printed.amount:.2f} times with the resolution",
                Sense.AT_LEAST,
                high / low if low is not None and high is not None else None,
                printed,
                told=_note((scene, SIZES[0][0]), runs),
            )
        )
    return Table("Pixel-level queries a frame", "Fig. 8", tuple(rows), tuple(claims))


def _figure_9(runs: _Runs) -> Table:
    rows: list[Row] = []
    claims: list[Claim] = []
    for at in TRIANGLES_DRAWN:
        run = runs.get(at)
        ms = run.ms() if run is not None else {}
        asking = run.ms("query")["lazy"] / ms["lazy"] if run is not None else None
        name, note = _named(*at), _note(at, runs)
        rows += [
            Row(f"{name}: {update}", None, _of(ms, update), "ms", 1, Basis.HARDWARE, note)
            for update in ("lazy", "busy", "none")
        ]
        gain = ms["none"] / ms["lazy"] if ms else None
        rows += [
            Row(f"{name}: frame rate, lazy over none", FRAME_RATE_GAIN,
                gain.value if gain else None, "", 1, Basis.WITHIN_RUN, note),
            Row(f"{name}: queries' share of the time, lazy", READBACK_SHARE,
                asking.value if asking else None, "%", 0, Basis.WITHIN_RUN, note),
        ]  # fmt: skip
        claims.append(
            Claim(
                f"{name}: the frame rate is 1.9 times that without occlusion culling, or more",
                Sense.AT_LEAST,
                gain,
                FRAME_RATE_GAIN.low,
                told=note,
            )
        )
        if at[0] == "forest":
            claims.append(
                Claim(
                    f"{name}: the busy grid is slower than no occlusion culling: its time over "
                    "none's",
                    Sense.AT_LEAST,
                    ms["busy"] / ms["none"] if ms else None,
                    told="reading depth back is cheap where the image is in main memory",
                )
            )
    return Table("Time a frame", "Fig. 9 and section 7", tuple(rows), tuple(claims))
