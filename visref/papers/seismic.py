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
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

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
    Series,
    Table,
    least,
    most,
    series,
    single,
)
from visref.papers.culler_frames import CullerFrames, culler_frames
from visref.papers.printed.seismic import (
    PLACE,
    REDUCTION_WORKS,
    STALLS,
    WORKS,
    WORST_FILL,
)

TITLE = "Occlusion Culling: slides on the visualisation of seismic data (three passes)"

REDUCTION = int(WORKS.value)

SCENE = "seismic:scale=0.5"
# The same horizons, each one object, as a user's would be; and the tiles of `SCENE`.
WHOLE, TILE = "seismic:scale=0.5,tiled=false", 2048
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


def boxed(reduction: int) -> str:
    """The published mode with boxes asked in the second pass instead of stand-ins."""
    return f"{published(reduction)},ask=boxes"


def in_tiles(spec: str) -> str:
    """The same, of objects that the method divides."""
    return f"{spec},tile={TILE}"


CROSS = tuple(itertools.product(CROSSED, THRESHOLDS, SCALES))
_PUBLISHED = dict.fromkeys(
    [published(reduction) for reduction in REDUCTIONS]
    + [published(*at) for at in CROSS]
    + [boxed(reduction) for reduction in REDUCTIONS]
)
_UNDIVIDED = (published(REDUCTION), conservative(REDUCTION))
_FILLED = [FRUSTUM, published(1), *(published(REDUCTION, scale=scale) for scale in FILL_SCALES)]

RUNS = (
    JudgedRun("published", SCENE, (FRUSTUM, BOXES, *_PUBLISHED), size=SIZE),
    JudgedRun(
        "conservative",
        SCENE,
        tuple(conservative(*at) for at in itertools.product(CONSERVATIVE, SCALES)),
        size=SIZE,
    ),
    JudgedRun("undivided", WHOLE, (FRUSTUM, *_UNDIVIDED, *map(in_tiles, _UNDIVIDED)), size=SIZE),
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
        _precision(by_spec),
        _safe(runs["conservative"], by_spec),
        _undivided(runs["undivided"]),
        _dynamic(runs["dynamic"]),
        _prediction(results.experiment("prediction")),
    ]


def _measured(results: Results, judged: JudgedRun) -> dict[str, CullerFrames]:
    run = results.run(judged.key)
    return {} if run is None else {spec: culler_frames(run, spec) for spec in judged.cullers}


def _mean(by_spec: _ByCuller, spec: str, counter: str) -> Estimate | None:
    one = by_spec.get(spec)
    return None if one is None else one.series(counter).mean()


def _share(part: Estimate | None, whole: Estimate | None) -> Estimate | None:
    if part is None or whole is None or not whole.value:
        return None
    return part / whole


def _value(figure: Estimate | None) -> float | None:
    return None if figure is None else figure.value


def _missed(by_spec: _ByCuller, spec: str) -> Estimate | None:
    """Missed objects over visible ones."""
    return _share(_mean(by_spec, spec, "confirmed"), _mean(by_spec, spec, "visible"))


def _lost(by_spec: _ByCuller, spec: str) -> Estimate | None:
    """Samples lost over those of the image."""
    lost = _mean(by_spec, spec, "missed_pixels")
    return None if lost is None else lost / (SIZE[0] * SIZE[1])


def _wasted(by_spec: _ByCuller, spec: str) -> Estimate | None:
    """What is drawn for nothing, of what is drawn."""
    return _share(_mean(by_spec, spec, "superfluous"), _mean(by_spec, spec, "drawn"))


def _least_step(runs: Iterable[Sequence[Estimate | None]]) -> Estimate | None:
    """The least step from one figure to the next, over several sequences; None where a figure was
    not measured."""
    steps = []
    for figures in runs:
        for before, after in itertools.pairwise(figures):
            if before is None or after is None:
                return None
            steps.append(after - before)
    return least(*steps) if steps else None


def _never_less(statement: str, step: Estimate | None, **shown: Any) -> Claim:
    """A claim that a sequence does not fall, by its least step."""
    return Claim(f"{statement}: the least step", Sense.AT_LEAST, step, even=0.0, ties=True, **shown)


def _fills(fill: _ByCuller, spec: str) -> Series | None:
    """Each frame's depth tests over those of drawing what meets the frustum, where it has any."""
    ours, all_drawn = fill.get(_counted(spec)), fill.get(_counted(FRUSTUM))
    if ours is None or all_drawn is None:
        return None
    whole = dict(zip(all_drawn.frames, all_drawn.counts("depth_tests"), strict=True))
    tests = zip(ours.frames, ours.counts("depth_tests"), strict=True)
    fills = {frame: count / whole[frame] for frame, count in tests if whole[frame]}
    return series(list(fills.values()), list(fills), ours.walk) if fills else None


def _claims(by_spec: _ByCuller, fill: _ByCuller) -> Table:
    usual = by_spec.get(published(REDUCTION))
    fills = _fills(fill, published(1))
    worst = None if fills is None else fills.most()
    at_scale = {scale: _fills(fill, published(REDUCTION, scale=scale)) for scale in FILL_SCALES}
    means = {scale: None if one is None else one.mean() for scale, one in at_scale.items()}
    frustum = by_spec.get(FRUSTUM)
    gain = None
    if frustum is not None and usual is not None:
        gain = frustum.ms_series().mean() / usual.ms_series().mean()
    boxes, coarse, fine = (
        _wasted(by_spec, spec) for spec in (BOXES, published(REDUCTION), published(CROSSED[0]))
    )
    rows = (
        Row("samples lost at a reduction of 1:100", REDUCTION_WORKS,
            _value(_lost(by_spec, published(REDUCTION))), "%", 3),
        Row("waits a frame", STALLS, None if usual is None else usual.mean("batches")),
        Row("worst fill, over drawing what is in the frustum", WORST_FILL, _value(worst), "×", 2,
            note="three is reached where nothing is hidden and a stand-in covers what its object "
                 "does; ours is a reduction of 1:1, in the worst frame"),
        *(Row(f"mean fill at 1:100, an image of 1/{scale} the side", None, _value(mean), "×", 2)
          for scale, mean in means.items()),
        Row("frame rate at 1:100 over frustum culling", None, _value(gain), "", 1,
            Basis.WITHIN_RUN),
        Row("drawn for nothing: a query for each box, front to back", None, _value(boxes), "%", 1),
        Row("drawn for nothing: three passes, 1:100", None, _value(coarse), "%", 1),
        Row("drawn for nothing: three passes, 1:10", None, _value(fine), "%", 1),
    )  # fmt: skip
    smaller = [
        _share(means[small], means[large]) for large, small in itertools.pairwise(FILL_SCALES)
    ]
    known = [one for one in smaller if one is not None]
    claims = (
        Claim(
            "the fill is at worst three times the picture's, in every frame",
            Sense.AT_MOST,
            worst,
            WORST_FILL,
            even=None,
        ),
        Claim(
            "a smaller image needs less fill: the greatest quotient from one size to the next",
            Sense.AT_MOST,
            most(*known) if len(known) == len(smaller) else None,
        ),
        Claim(
            "culling pays: frustum culling's time over that of three passes at 1:100",
            Sense.AT_LEAST,
            gain,
        ),
    )
    return Table("What the slides say", PLACE, rows, claims)


def _precision(by_spec: _ByCuller) -> Table:
    """Stand-ins against boxes in the same passes, against the same depth."""
    rows: list[Row] = []
    wasted: list[Estimate | None] = []
    missed: list[Estimate | None] = []
    for reduction in REDUCTIONS:
        shares = []
        for spec, asked in ((published(reduction), "stand-ins"), (boxed(reduction), "boxes")):
            shares.append((_wasted(by_spec, spec), _missed(by_spec, spec)))
            rows += [
                Row(f"1:{reduction}, {asked} asked: drawn for nothing", None,
                    _value(shares[-1][0]), "%", 1),
                Row(f"1:{reduction}, {asked} asked: visible objects missed", None,
                    _value(shares[-1][1]), "%", 2),
            ]  # fmt: skip
        (ours, our_misses), (boxes, box_misses) = shares
        wasted.append(_share(ours, boxes))
        missed.append(None if our_misses is None or box_misses is None else our_misses - box_misses)
    known = [one for one in wasted if one is not None]
    more = [one for one in missed if one is not None]
    claim = Claim(
        "stand-ins are more precise than bounding boxes, asked in the same passes, at every "
        "reduction: the most of what is drawn for nothing with them, over that with boxes",
        Sense.AT_MOST,
        most(*known) if len(known) == len(REDUCTIONS) else None,
    )
    own = Claim(
        "they miss more for it, or as much, at every reduction: the least difference in visible "
        "objects missed",
        Sense.AT_LEAST,
        least(*more) if len(more) == len(REDUCTIONS) else None,
        even=0.0,
        ties=True,
        unit="%",
    )
    return Table("Stand-ins against bounding boxes", PLACE, tuple(rows), (claim,), (own,))


def _undivided(by_spec: _ByCuller) -> Table:
    """What tiles are for: horizons that come as one object each."""
    rows: list[Row] = []
    own: list[Claim] = []
    frustum = _mean(by_spec, FRUSTUM, "triangles_drawn")
    for spec, name in zip(_UNDIVIDED, ("published", "conservative"), strict=True):
        drawn = {}
        for one, how in ((spec, "whole"), (in_tiles(spec), "in tiles")):
            drawn[how] = _mean(by_spec, one, "triangles_drawn")
            rows += [
                Row(f"{name}, {how}: triangles drawn in full, of what is in the frustum", None,
                    _value(_share(drawn[how], frustum)), "%", 1),
                Row(f"{name}, {how}: visible objects missed", None, _value(_missed(by_spec, one)),
                    "%", 2),
                Row(f"{name}, {how}: samples lost", None, _value(_lost(by_spec, one)), "%", 3),
            ]  # fmt: skip
        own.append(
            Claim(
                f"{name}: in tiles of its own making less is drawn in full than of whole horizons: "
                "triangles over triangles",
                Sense.AT_MOST,
                _share(drawn["in tiles"], drawn["whole"]),
            )
        )
    own.append(
        _nothing_missed(
            "the conservative mode misses nothing in tiles of its own making",
            _most_missed(by_spec, [in_tiles(_UNDIVIDED[1])]),
        )
    )
    return Table("Horizons that come undivided", "Basic Algorithm: Preprocess", tuple(rows),
                 own=tuple(own))  # fmt: skip


def _name(reduction: int, threshold: int, scale: int) -> str:
    image = "full image" if scale == 1 else f"1/{scale} the side"
    return f"1:{reduction}, threshold {threshold}, {image}"


def _misses(by_spec: _ByCuller) -> Table:
    every = [*((reduction, 0, 1) for reduction in REDUCTIONS), *CROSS]
    rows = []
    for at in dict.fromkeys(every):
        spec = published(*at)
        rows += [
            Row(
                f"{_name(*at)}: visible objects missed",
                None,
                _value(_missed(by_spec, spec)),
                "%",
                2,
            ),
            Row(f"{_name(*at)}: samples lost", None, _value(_lost(by_spec, spec)), "%", 3),
        ]
    by_reduction = [_lost(by_spec, published(reduction)) for reduction in REDUCTIONS]
    with_threshold = [
        [_lost(by_spec, published(reduction, t, scale)) for t in THRESHOLDS]
        for reduction, scale in itertools.product(CROSSED, SCALES)
    ]
    with_scale = [
        [_missed(by_spec, published(reduction, t, scale)) for scale in SCALES]
        for reduction, t in itertools.product(CROSSED, THRESHOLDS)
    ]
    told = ", ".join(f"{100 * lost.value:.3f} %" for lost in by_reduction if lost is not None)
    own = (
        _never_less("the more reduced, the more samples are lost", _least_step([by_reduction]),
                    unit="%", digits=3, told=f"from 1:1 to 1:1000 it is {told}" if told else ""),
        _never_less("the higher the threshold, the more samples are lost",
                    _least_step(with_threshold), unit="%", digits=3),
        _never_less("the smaller image misses more objects", _least_step(with_scale), unit="%"),
    )  # fmt: skip
    return Table(
        "Misses against reduction, threshold and image scale",
        "not in the slides",
        tuple(rows),
        own=own,
        figure=_miss_figure(by_spec),
    )


def _miss_figure(by_spec: _ByCuller) -> Figure | None:
    curves = []
    for threshold, scale in itertools.product(THRESHOLDS, SCALES):
        first = (threshold, scale) == (0, 1)
        points = [
            (float(reduction), lost.value)
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
        drawn[spec] = _mean(by_spec, spec, "triangles_drawn")
        rows += [
            Row(f"{name}: triangles drawn in full", None, _value(drawn[spec])),
            Row(f"{name}: a frame", None, None if one is None else one.ms(), "ms", 1,
                Basis.HARDWARE),
        ]  # fmt: skip
    own = _never_less(
        "up to 1:100, the more reduced, the more triangles are drawn in full",
        _least_step([[drawn[published(reduction)] for reduction in REDUCTIONS[:4]]]),
        digits=0,
    )
    return Table("Cost", "not in the slides", tuple(rows), own=(own,))


def _most_missed(by_spec: _ByCuller, specs: Iterable[str]) -> Estimate | None:
    """The most objects that any of several cullers misses in a frame."""
    found = [by_spec[spec].series("confirmed").most() for spec in specs if spec in by_spec]
    return most(*found) if found else None


def _nothing_missed(statement: str, missed: Estimate | None) -> Claim:
    return Claim(
        f"{statement}: the most objects in a frame",
        Sense.AT_MOST,
        missed,
        even=0.0,
        ties=True,
        digits=0,
    )


def _safe(safe: _ByCuller, by_spec: _ByCuller) -> Table:
    rows = []
    frustum = _mean(by_spec, FRUSTUM, "drawn")
    drawn: dict[tuple[int, int], Estimate | None] = {}
    for at in itertools.product(CONSERVATIVE, SCALES):
        spec, name = conservative(*at), _name(at[0], 0, at[1])
        one = safe.get(spec)
        drawn[at] = _share(_mean(safe, spec, "drawn"), frustum)
        rows += [
            Row(f"{name}: visible objects missed", None, _value(_missed(safe, spec)), "%", 2),
            Row(f"{name}: drawn, of what is in the frustum", None, _value(drawn[at]), "%", 1),
            Row(f"{name}: a frame", None, None if one is None else one.ms(), "ms", 1,
                Basis.HARDWARE),
        ]  # fmt: skip
    own = (
        _nothing_missed(
            "the conservative mode misses nothing", _most_missed(safe, RUNS[1].cullers)
        ),
        _never_less(
            "the more reduced, the less it culls, of what is in the frustum",
            _least_step([drawn[r, scale] for r in CONSERVATIVE] for scale in SCALES),
            unit="%",
        ),
    )
    figure = None
    if all(value is not None for value in drawn.values()):
        curves = tuple(
            Curve(
                "full image" if scale == 1 else f"1/{scale} the side",
                tuple(float(reduction) for reduction in CONSERVATIVE),
                tuple(100.0 * (_value(drawn[r, scale]) or 0.0) for r in CONSERVATIVE),
            )
            for scale in SCALES
        )
        figure = Figure("reduction", "drawn, of what is in the frustum, %", curves, log_x=True)
    return Table("Conservative mode", "not in the slides", tuple(rows), own=own, figure=figure)


def _dynamic(moving: _ByCuller) -> Table:
    frustum = _mean(moving, FRUSTUM, "triangles_drawn")
    rows, drawn = [], {}
    for spec, name in (
        (BOXES, "a query for each box"),
        (published(REDUCTION), f"1:{REDUCTION}"),
        (conservative(REDUCTION), f"1:{REDUCTION}, conservative mode"),
    ):
        drawn[spec] = _share(_mean(moving, spec, "triangles_drawn"), frustum)
        rows += [
            Row(f"{name}: visible objects missed", None, _value(_missed(moving, spec)), "%", 2),
            Row(f"{name}: samples lost", None, _value(_lost(moving, spec)), "%", 3),
            Row(f"{name}: triangles drawn in full, of what is in the frustum", None,
                _value(drawn[spec]), "%", 1),
        ]  # fmt: skip
    claim = Claim(
        "works for dynamic scenes: three passes at 1:100 draw less in full than is in the frustum",
        Sense.AT_MOST,
        drawn[published(REDUCTION)],
        unit="%",
    )
    own = _nothing_missed(
        "the conservative mode misses nothing in motion",
        _most_missed(moving, [conservative(REDUCTION)]),
    )
    source = f"{PLACE}: “Works for dynamic scenes”"
    return Table("A scene in motion", source, tuple(rows), (claim,), (own,))


def _over(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def _prediction(found: Mapping[str, Any] | None) -> Table:
    source = f"{PLACE}: “measures that predict potential occlusion errors”"
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
                _over(one["wrong"], sum(one["frame_outline"])), digits=2),
            Row(f"{name}: time of the offsets over the simplification's", None,
                _over(one["offsets_ms"], one["simplify_ms"]), digits=1, basis=Basis.WITHIN_RUN),
        ]  # fmt: skip
    for measure in MEASURES:
        pooled = found["pooled"][measure]
        rows_ += [
            Row(f"all reductions: {measure} and a frame's wrong pixels, Spearman", None,
                pooled["wrong_spearman"], digits=2),
            Row(f"all reductions: {measure} and a frame's missed pixels, Spearman", None,
                pooled["missed_spearman"], digits=2),
        ]  # fmt: skip
    leads = [
        single(one["outline"]["spearman"] - one[other]["spearman"])
        for one in found["reductions"]
        for other in MEASURES[:2]
        if None not in (one[measure]["spearman"] for measure in MEASURES)
    ]
    own = Claim(
        "of the three measures the outline's ranks tiles best, at every reduction: the least lead "
        "over the others' rank correlation",
        Sense.AT_LEAST,
        least(*leads) if leads else None,
        even=0.0,
    )
    x = tuple(float(one["reduction"]) for one in found["reductions"])
    frames = max(int(found["frames"]), 1)
    curves = (
        Curve("wrong pixels", x, tuple(one["wrong"] / frames for one in found["reductions"])),
        Curve("foretold by the outline", x,
              tuple(sum(one["frame_outline"]) / frames for one in found["reductions"])),
        Curve("missed pixels", x, tuple(one["missed"] / frames for one in found["reductions"])),
    )  # fmt: skip
    figure = Figure("reduction", "pixels a frame", curves, log_x=True, log_y=True)
    return Table("Predicting the error", source, tuple(rows_), own=(own,), figure=figure)
