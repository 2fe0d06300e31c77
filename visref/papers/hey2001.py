"""H. Hey, R. F. Tobler, W. Purgathofer: Real-Time Occlusion Culling With A Lazy Occlusion Grid.

TR-186-2-01-02, Vienna University of Technology, January 2001. Section 7 and Figs. 7 to 9; the
variants and options of sections 3, 5 and 6, which the paper describes and does not measure.

Measured on `deep_forest` and `old_town`, which have the paper's numbers of triangles and were laid
out by its text before they were measured; its models and walkthroughs are not available. So
triangles and queries compare in ratio and order alone, and times, which belong to a GeForce2 and a
900 MHz Thunderbird, as ratios within one run.

The City is judged whole (`--large`), or it is not measured. An eighth of the town, of which the
walk sees no other end, has nearly as many triangles in the view; it stands under a name of its own,
and in no count of the paper's claims.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from visref.papers.contents import (
    Basis,
    Claim,
    Curve,
    Derived,
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
SCENES = {"forest": "deep_forest", "city": "old_town", "part": "old_town:scale=0.13"}
LARGE = "city"
# What is compared with the City's figures, under a name of its own.
PART, PART_NAME = "part", "an eighth of the City, beyond the walk"

# Options that no figure of the paper shows, at 640 by 480 in the forest.
VARIANTS = {
    "as in section 7": "",
    "cells of 8 × 8 pixels": "cell=8",
    "cells of 16 × 16 pixels": "cell=16",
    "cells of 64 × 64 pixels": "cell=64",
    "z-buffer variant (section 3.2)": "buffer=z",
    "occlusion queries by GL (section 5)": "query=gl",
    "z-buffer variant, queries by GL (section 5)": "buffer=z,query=gl",
    "occlusion buffer in software (section 3)": "query=software",
    "free where less than half is drawn over (section 6)": "probability=0.5",
    "border cells asked whole from half on (section 6)": "whole=0.5",
    "border cells as internal from 64² pixels on (section 6)": "large=4096",
}
EXTENSIONS = tuple(name for name in VARIANTS if "section 6" in name)


def specs(scene: str) -> dict[str, str]:
    """The cullers to run: "lazy", "busy" and "none", as the paper set them up."""
    boxes = "" if scene == "forest" else f",boxes=triangles,leaf={TRIANGLES_A_BOX.value}"
    return {
        update: f"lazy-grid:update={update},cell={CELL_PX.value}{boxes}"
        for update in ("lazy", "busy", "none")
    }


def _key(scene: str, width: int) -> str:
    return f"{scene}-{width}"


def variant(options: str) -> str:
    """The spec of the lazy grid with some options."""
    return "lazy-grid" + (f":{options}" if options else "")


RUNS = (
    *(
        JudgedRun(
            _key(scene, size[0]),
            spec,
            tuple(specs(scene).values()),
            size=size,
            large=scene == LARGE,
        )
        for scene, spec in SCENES.items()
        for size in SIZES
    ),
    JudgedRun("options", SCENES["forest"], tuple(map(variant, VARIANTS.values())), size=SIZES[0]),
)
EXPERIMENTS: tuple[Experiment, ...] = ()


def tables(results: Results) -> list[Table]:
    """Section 7's scenes, Figs. 7 to 9, the share of readbacks, and the options."""
    runs: _Runs = {
        (scene, width): run
        for scene in SCENES
        for width, _ in SIZES
        if (run := _measured(results, scene, width)) is not None
    }
    return [
        _scenes(runs),
        _figure_7(runs),
        _figure_8(runs),
        _figure_9(runs),
        *(_walk(at, run) for at, run in runs.items()),
        _options(results),
    ]


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
    return f"{NAMES.get(scene, PART_NAME)}, {width} × {dict(SIZES)[width]}"


def _note(at: _At, runs: _Runs) -> str:
    return "" if at in runs or at[0] != LARGE else "not measured: needs --large"


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
        told = _shown(runs[at]) if at in runs else note
        claims.append(_share_claim(name, share, printed, told))
    own = []
    for width, _ in SIZES:
        at = (PART, width)
        drawn = runs[at].mean("triangles_drawn") if at in runs else {}
        share = drawn["lazy"] / drawn["none"] if drawn else None
        name, note = _named(*at), "the City's figures are those of all of it"
        rows += [
            Row(f"{name}: {update}", None, _of(drawn, update), note=note)
            for update in ("lazy", "none")
        ]
        rows.append(Row(f"{name}: lazy over none", None, share.value if share else None, "%", 2))
        told = _shown(runs[at]) if at in runs else ""
        printed = ratio_of(*TRIANGLES_DRAWN["city", width])
        own.append(_share_claim(name, share, printed, told))
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
    return Table("Triangles drawn a frame", "Fig. 7", tuple(rows), tuple(claims), tuple(own))


def _share_claim(name: str, share: Estimate | None, printed: Derived, told: str) -> Claim:
    return Claim(
        f"{name}: lazy draws {100 * printed.amount:.2f} % of what none draws",
        Sense.AT_MOST,
        share,
        printed,
        unit="%",
        told=told,
    )


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
    own = []
    for width, _ in SIZES:
        at = (PART, width)
        asked = runs[at].mean("queries") if at in runs else {}
        gain = asked["busy"] / asked["lazy"] if asked else None
        rows += [
            Row(f"{_named(*at)}: {update}", None, _of(asked, update)) for update in ("lazy", "busy")
        ]
        lazy, busy = PIXEL_QUERIES["city", width]
        printed = ratio_of(busy, lazy)
        statement = f"{_named(*at)}: busy asks {printed.amount:.2f} times the queries of lazy"
        own.append(Claim(statement, Sense.AT_LEAST, gain, printed))
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
    return Table("Pixel-level queries a frame", "Fig. 8", tuple(rows), tuple(claims), tuple(own))


def _figure_9(runs: _Runs) -> Table:
    rows: list[Row] = []
    claims: list[Claim] = []
    own: list[Claim] = []
    for at in (*TRIANGLES_DRAWN, *((PART, width) for width, _ in SIZES)):
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
        (own if at[0] == PART else claims).append(
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
    return Table("Time a frame", "Fig. 9 and section 7", tuple(rows), tuple(claims), tuple(own))


def _walk(at: _At, run: _Run) -> Table:
    """Fig. 9's curves: the paper's are drawn, and print no number."""
    times = {update: one.ms_series() for update, one in run.by_update.items()}
    rows = tuple(
        Row(f"slowest frame, {update}", None, series_.most().value, "ms", 1, Basis.HARDWARE)
        for update, series_ in times.items()
    )
    curves = tuple(
        Curve(
            update,
            tuple(float(frame) for frame in series_.frames),
            tuple(float(ms) for ms in series_.values),
        )
        for update, series_ in times.items()
    )
    figure = Figure("frame of the walk", "ms", curves)
    return Table(f"Time along the walk: {_named(*at)}", "Fig. 9", rows, figure=figure)


def _options(results: Results) -> Table:
    run = results.run("options")
    found = {
        name: culler_frames(run, variant(options)) for name, options in VARIANTS.items()
    } if run is not None else {}  # fmt: skip
    rows: list[Row] = []
    for name in VARIANTS:
        one = found.get(name)
        for counter, shown in (("triangles_drawn", "triangles"), ("queries", "queries")):
            ours = None if one is None else one.series(counter).mean().value
            rows.append(Row(f"{name}: {shown} a frame", None, ours))
        rows.append(Row(f"{name}: a frame", None, None if one is None else one.ms(), "ms", 1,
                        Basis.HARDWARE))  # fmt: skip
    missed = {name: one.series("confirmed").most() for name, one in found.items()}

    def missing(statement: str, names: Sequence[str]) -> Claim:
        return Claim(
            f"{statement}: the most objects missed in a frame",
            Sense.AT_MOST,
            most(*(missed[name] for name in names)) if missed else None,
            even=0.0,
            ties=True,
            digits=0,
        )

    claims = (missing("the extensions of section 6 do not violate conservatism", EXTENSIONS),)
    own = (missing("no variant and no cell size misses anything", tuple(VARIANTS)),)
    return Table(
        "Variants, options and cell sizes, in the forest",
        "sections 3, 5 and 6",
        tuple(rows),
        claims,
        own,
    )
