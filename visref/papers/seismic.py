"""Slides on seismic visualisation, "Occlusion Culling": the three-pass method.

They publish two numbers, that a reduction of 1:100 works and that the fill is at worst three times
the picture's, and end with what they leave open: measures that predict occlusion errors. What they
do not give is measured here: misses, samples lost and cost against reduction, threshold and image
scale, and how well three predictors foretell the error.

Measured on `seismic`, horizons in tiles with faults and slices as the slides describe them, at half
a million triangles; their data are not available. That the method works for dynamic scenes, which
they say and do not show, is measured on `busy_street`, a street in motion.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from visref.papers.contents import (
    Basis,
    Curve,
    Experiment,
    Figure,
    JudgedRun,
    Results,
    Row,
    Table,
    Trend,
)
from visref.papers.culler_frames import CullerFrames, culler_frames

TITLE = "Occlusion Culling: slides on the visualisation of seismic data (three passes)"

REDUCTION = 100  # "1:100 reduction works"
WORST_FILL = 3.0  # "Worst case: requires three times the fill rate"
STALLS = 1  # "Stalls graphics pipe only once per frame"

SCENE = "seismic:scale=0.5"
SIZE = (384, 288)
# Frames in a row, for what happens from one to the next.
DYNAMIC, STRETCH = "busy_street", 5
# The faults have 252 triangles and stand in for themselves, a tile 2,048.
EXTRA = 500

REDUCTIONS = (1, 10, 30, 100, 300, 1000)
CROSSED = (10, 100, 1000)
THRESHOLDS = (0, 5, 20)
SCALES = (1, 4)
CONSERVATIVE = (1, 10, 100, 1000)
FILL_SCALES = (1, 2, 4)
FRUSTUM, BOXES = "frustum", "occlusion-query"
MEASURES = ("deviation", "displacement", "outline")


def published(reduction: int, threshold: int = 0, scale: int = 1) -> str:
    """The spec of the published mode."""
    return _spec(reduction=reduction, threshold=threshold, scale=scale)


def conservative(reduction: int, scale: int = 1) -> str:
    """The spec of the conservative mode."""
    return _spec(mode="conservative", reduction=reduction, scale=scale)


def _spec(**options: Any) -> str:
    values = ",".join(f"{key}={value}" for key, value in options.items())
    return f"three-pass:{values},extra={EXTRA}"


def _counted(spec: str) -> str:
    return f"{spec}{',' if ':' in spec else ':'}fragments=true"


CROSS = tuple(itertools.product(CROSSED, THRESHOLDS, SCALES))
_PUBLISHED = dict.fromkeys(
    [published(reduction) for reduction in REDUCTIONS] + [published(*at) for at in CROSS]
)
_FILLED = [FRUSTUM, published(1), *(published(REDUCTION, scale=scale) for scale in FILL_SCALES)]

RUNS = (
    JudgedRun("published", SCENE, (FRUSTUM, BOXES, *_PUBLISHED), size=SIZE),
    JudgedRun(
        "conservative",
        SCENE,
        tuple(conservative(*at) for at in itertools.product(CONSERVATIVE, SCALES)),
        size=SIZE,
    ),
    JudgedRun("fill", SCENE, tuple(map(_counted, _FILLED)), size=SIZE),
    JudgedRun(
        "dynamic",
        DYNAMIC,
        (FRUSTUM, BOXES, published(REDUCTION), conservative(REDUCTION)),
        size=SIZE,
        stretch=STRETCH,
    ),
)
EXPERIMENTS = (Experiment("prediction", "three-pass-prediction", scene=SCENE, size=SIZE),)

_ByCuller = Mapping[str, CullerFrames]


def tables(results: Results) -> list[Table]:
    """What the slides say, and what they leave open."""
    runs = {judged.key: _measured(results, judged) for judged in RUNS}
    by_spec, fill = runs["published"], runs["fill"]
    return [
        _claims(by_spec, fill),
        _misses(by_spec),
        _cost(by_spec),
        _safe(runs["conservative"], by_spec),
        _dynamic(runs["dynamic"]),
        _prediction(results.experiment("prediction")),
    ]


def _measured(results: Results, judged: JudgedRun) -> dict[str, CullerFrames]:
    run = results.run(judged.key)
    return {} if run is None else {spec: culler_frames(run, spec) for spec in judged.cullers}


def _sum(by_spec: _ByCuller, spec: str, counter: str) -> float | None:
    one = by_spec.get(spec)
    return None if one is None else one.mean(counter) * len(one.rows)


def _share(part: float | None, whole: float | None) -> float | None:
    return part / whole if part is not None and whole else None


def _missed(by_spec: _ByCuller, spec: str) -> float | None:
    """Missed objects over visible ones."""
    return _share(_sum(by_spec, spec, "confirmed"), _sum(by_spec, spec, "visible"))


def _lost(by_spec: _ByCuller, spec: str) -> float | None:
    """Samples lost over those of the image."""
    one = by_spec.get(spec)
    return None if one is None else one.mean("missed_pixels") / (SIZE[0] * SIZE[1])


def _ascending(values: Sequence[float | None]) -> bool | None:
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return None
    return all(a <= b for a, b in itertools.pairwise(known))


def _fills(fill: _ByCuller, spec: str) -> list[float]:
    """Each frame's depth tests over those of drawing what meets the frustum."""
    ours, all_drawn = fill.get(_counted(spec)), fill.get(_counted(FRUSTUM))
    if ours is None or all_drawn is None:
        return []
    whole = dict(zip(all_drawn.frames, all_drawn.counts("depth_tests"), strict=True))
    tests = zip(ours.frames, ours.counts("depth_tests"), strict=True)
    return [count / whole[frame] for frame, count in tests if whole[frame]]


def _claims(by_spec: _ByCuller, fill: _ByCuller) -> Table:
    usual = by_spec.get(published(REDUCTION))
    worst = max(_fills(fill, published(1)), default=None)
    at_scale = {scale: _fills(fill, published(REDUCTION, scale=scale)) for scale in FILL_SCALES}
    means = {scale: sum(all_) / len(all_) if all_ else None for scale, all_ in at_scale.items()}
    frustum = by_spec.get(FRUSTUM)
    gain = frustum.ms() / usual.ms() if frustum is not None and usual is not None else None
    precise = [
        _share(_sum(by_spec, spec, "superfluous"), _sum(by_spec, spec, "drawn"))
        for spec in (BOXES, published(REDUCTION), published(CROSSED[0]))
    ]
    rows = (
        Row("samples lost at a reduction of 1:100", "works", _lost(by_spec, published(REDUCTION)),
            "%", 3),
        Row("waits a frame", STALLS, None if usual is None else usual.mean("batches")),
        Row("worst fill, over drawing what is in the frustum", WORST_FILL, worst, "×", 2,
            note="three is reached where nothing is hidden and a stand-in covers what its object "
                 "does; ours is a reduction of 1:1, in the worst frame"),
        *(Row(f"mean fill at 1:100, an image of 1/{scale} the side", None, mean, "×", 2)
          for scale, mean in means.items()),
        Row("frame rate at 1:100 over frustum culling", None, gain, "", 1, Basis.WITHIN_RUN),
        Row("drawn for nothing: a query for each box, front to back", None, precise[0], "%", 1),
        Row("drawn for nothing: three passes, 1:100", None, precise[1], "%", 1),
        Row("drawn for nothing: three passes, 1:10", None, precise[2], "%", 1),
    )  # fmt: skip
    order = _ascending([means[scale] for scale in reversed(FILL_SCALES)])
    within = None if precise[0] is None or precise[1] is None else precise[1] < precise[0]
    trends = (
        Trend("the fill is at most three times the picture's",
              None if worst is None else worst <= WORST_FILL),
        Trend("a smaller image needs less fill", order),
        Trend("culling pays: a frame takes less time than with frustum culling alone",
              None if gain is None else gain > 1.0),
        Trend("stand-ins are more precise than bounding boxes: less is drawn for nothing", within,
              _imprecise(precise)),
    )  # fmt: skip
    return Table("What the slides say", "Conclusions and Future Work", rows, trends)


def _imprecise(shares: Sequence[float | None]) -> str:
    boxes, usual, fine = (f"{100 * share:.0f} %" if share else "nothing" for share in shares)
    return (
        f"drawn for nothing is {boxes} with boxes, {fine} with stand-ins of 1:10 and {usual} with "
        "those of 1:100: one that sticks out of what hides its object shows, and where occluders "
        "have shrunk more shows still; the boxes are asked one by one, against what is drawn"
    )


def _name(reduction: int, threshold: int, scale: int) -> str:
    image = "full image" if scale == 1 else f"1/{scale} the side"
    return f"1:{reduction}, threshold {threshold}, {image}"


def _misses(by_spec: _ByCuller) -> Table:
    every = [*((reduction, 0, 1) for reduction in REDUCTIONS), *CROSS]
    rows = []
    for at in dict.fromkeys(every):
        spec = published(*at)
        rows += [
            Row(f"{_name(*at)}: visible objects missed", None, _missed(by_spec, spec), "%", 2),
            Row(f"{_name(*at)}: samples lost", None, _lost(by_spec, spec), "%", 3),
        ]
    by_reduction = [_lost(by_spec, published(reduction)) for reduction in REDUCTIONS]
    with_threshold = [
        _ascending([_lost(by_spec, published(reduction, t, scale)) for t in THRESHOLDS])
        for reduction, scale in itertools.product(CROSSED, SCALES)
    ]
    with_scale = [
        _ascending([_missed(by_spec, published(reduction, t, scale)) for scale in SCALES])
        for reduction, t in itertools.product(CROSSED, THRESHOLDS)
    ]
    told = ", ".join(f"{100 * value:.3f} %" for value in by_reduction if value is not None)
    trends = (
        Trend("the more reduced, the more samples are lost", _ascending(by_reduction),
              f"from 1:1 to 1:1000 it is {told}"),
        Trend("the higher the threshold, the more samples are lost", _all(with_threshold)),
        Trend("the smaller image misses more objects", _all(with_scale)),
    )  # fmt: skip
    return Table(
        "Misses against reduction, threshold and image scale",
        "not in the slides",
        tuple(rows),
        trends,
        _miss_figure(by_spec),
    )


def _all(holds: Sequence[bool | None]) -> bool | None:
    return None if not holds or None in holds else all(holds)


def _miss_figure(by_spec: _ByCuller) -> Figure | None:
    curves = []
    for threshold, scale in itertools.product(THRESHOLDS, SCALES):
        first = (threshold, scale) == (0, 1)
        points = [
            (float(reduction), lost)
            for reduction in (REDUCTIONS if first else CROSSED)
            if (lost := _lost(by_spec, published(reduction, threshold, scale))) is not None
        ]
        if points:
            x, y = zip(*points, strict=True)
            label = _name(1, threshold, scale).partition(", ")[2]
            curves.append(Curve(label, x, tuple(100.0 * value for value in y)))
    if not curves:
        return None
    return Figure("reduction", "samples lost, %", tuple(curves), log_x=True, log_y=True)


def _cost(by_spec: _ByCuller) -> Table:
    rows = []
    drawn = {}
    for spec, name in (
        (FRUSTUM, "frustum culling"),
        (BOXES, "a query for each box"),
        *((published(reduction), f"1:{reduction}") for reduction in REDUCTIONS),
        *((published(reduction, 0, SCALES[-1]), f"1:{reduction}, 1/{SCALES[-1]} the side")
          for reduction in CROSSED),
    ):  # fmt: skip
        one = by_spec.get(spec)
        drawn[spec] = None if one is None else one.mean("triangles_drawn")
        rows += [
            Row(f"{name}: triangles drawn in full", None, drawn[spec]),
            Row(f"{name}: a frame", None, None if one is None else one.ms(), "ms", 1,
                Basis.HARDWARE),
        ]  # fmt: skip
    more = _ascending([drawn[published(reduction)] for reduction in REDUCTIONS[:4]])
    trend = Trend("up to 1:100, the more reduced, the more is drawn in full", more)
    return Table("Cost", "not in the slides", tuple(rows), (trend,))


def _safe(safe: _ByCuller, by_spec: _ByCuller) -> Table:
    rows = []
    frustum = _sum(by_spec, FRUSTUM, "drawn")
    drawn: dict[tuple[int, int], float | None] = {}
    for at in itertools.product(CONSERVATIVE, SCALES):
        spec, name = conservative(*at), _name(at[0], 0, at[1])
        one = safe.get(spec)
        drawn[at] = _share(_sum(safe, spec, "drawn"), frustum)
        rows += [
            Row(f"{name}: visible objects missed", None, _missed(safe, spec), "%", 2),
            Row(f"{name}: drawn, of what is in the frustum", None, drawn[at], "%", 1),
            Row(f"{name}: a frame", None, None if one is None else one.ms(), "ms", 1,
                Basis.HARDWARE),
        ]  # fmt: skip
    missed = [_sum(safe, spec, "confirmed") for spec in RUNS[1].cullers]
    curves = tuple(
        Curve("full image" if scale == 1 else f"1/{scale} the side",
              tuple(float(reduction) for reduction in CONSERVATIVE),
              tuple(100.0 * (drawn[reduction, scale] or 0.0) for reduction in CONSERVATIVE))
        for scale in SCALES
    )  # fmt: skip
    trends = (
        Trend("the conservative mode misses nothing", None if None in missed else not any(missed)),
        Trend("the more reduced, the less it culls",
              _all([_ascending([drawn[r, scale] for r in CONSERVATIVE]) for scale in SCALES])),
    )  # fmt: skip
    figure = None
    if all(value is not None for value in drawn.values()):
        figure = Figure("reduction", "drawn, of what is in the frustum, %", curves, log_x=True)
    return Table("Conservative mode", "not in the slides", tuple(rows), trends, figure)


def _dynamic(moving: _ByCuller) -> Table:
    frustum = _sum(moving, FRUSTUM, "triangles_drawn")
    rows, drawn = [], {}
    for spec, name in (
        (BOXES, "a query for each box"),
        (published(REDUCTION), f"1:{REDUCTION}"),
        (conservative(REDUCTION), f"1:{REDUCTION}, conservative mode"),
    ):
        drawn[spec] = _share(_sum(moving, spec, "triangles_drawn"), frustum)
        rows += [
            Row(f"{name}: visible objects missed", None, _missed(moving, spec), "%", 2),
            Row(f"{name}: samples lost", None, _lost(moving, spec), "%", 3),
            Row(f"{name}: triangles drawn in full, of what is in the frustum", None, drawn[spec],
                "%", 1),
        ]  # fmt: skip
    missed = _sum(moving, conservative(REDUCTION), "confirmed")
    less = drawn[published(REDUCTION)]
    trends = (
        Trend("works for dynamic scenes: the conservative mode misses nothing in motion",
              None if missed is None else not missed),
        Trend("works for dynamic scenes: less is drawn in full than is in the frustum",
              None if less is None else less < 1.0),
    )  # fmt: skip
    source = "Conclusions and Future Work: “Works for dynamic scenes”"
    return Table("A scene in motion", source, tuple(rows), trends)


def _prediction(found: Mapping[str, Any] | None) -> Table:
    source = "Conclusions and Future Work: “measures that predict potential occlusion errors”"
    if found is None:
        rows = tuple(Row(f"{name}: Spearman", None, None) for name in MEASURES)
        return Table("Predicting the error", source, rows)
    rows_: list[Row] = []
    for one in found["reductions"]:
        name = f"1:{one['reduction']}"
        rows_ += [
            Row(f"{name}: {measure} and a tile's wrong pixels, Spearman", None,
                one[measure]["spearman"], digits=2)
            for measure in MEASURES
        ]  # fmt: skip
        rows_ += [
            Row(f"{name}: wrong pixels over those that the outline foretells", None,
                _share(one["wrong"], sum(one["frame_outline"])), digits=2),
            Row(f"{name}: time of the offsets over the simplification's", None,
                _share(one["offsets_ms"], one["simplify_ms"]), digits=1, basis=Basis.WITHIN_RUN),
        ]  # fmt: skip
    for measure in MEASURES:
        pooled = found["pooled"][measure]
        rows_ += [
            Row(f"all reductions: {measure} and a frame's wrong pixels, Spearman", None,
                pooled["wrong_spearman"], digits=2),
            Row(f"all reductions: {measure} and a frame's missed pixels, Spearman", None,
                pooled["missed_spearman"], digits=2),
        ]  # fmt: skip
    best = [
        all(one["outline"]["spearman"] > one[other]["spearman"] for other in MEASURES[:2])
        for one in found["reductions"]
        if None not in (one[measure]["spearman"] for measure in MEASURES)
    ]
    trend = Trend("of the three measures the outline's ranks tiles best, at every reduction",
                  _all(best))  # fmt: skip
    x = tuple(float(one["reduction"]) for one in found["reductions"])
    frames = max(int(found["frames"]), 1)
    curves = (
        Curve("wrong pixels", x, tuple(one["wrong"] / frames for one in found["reductions"])),
        Curve("foretold by the outline", x,
              tuple(sum(one["frame_outline"]) / frames for one in found["reductions"])),
        Curve("missed pixels", x, tuple(one["missed"] / frames for one in found["reductions"])),
    )  # fmt: skip
    figure = Figure("reduction", "pixels a frame", curves, log_x=True, log_y=True)
    return Table("Predicting the error", source, tuple(rows_), (trend,), figure)
