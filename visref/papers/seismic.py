"""Slides on seismic visualisation, "Occlusion Culling": the three-pass method.

They publish two numbers, that a reduction of 1:100 works and that the fill is at worst three times
the picture's, and end with what they leave open: measures that predict occlusion errors. What they
do not give is measured here: misses, samples lost and cost against reduction, threshold and image
scale, and how well three predictors foretell the error.

Measured on `seismic`, horizons in tiles with faults and slices as the slides describe them, at half
a million triangles; their data are not available. That the method works for dynamic scenes, which
they say and do not show, is measured on `busy_street`, a street in motion. Runs and the figures
taken from them stand in `visref.papers.seismic_figures`.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from visref.papers.contents import (
    Basis,
    Claim,
    Curve,
    Estimate,
    Experiment,
    Figure,
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
from visref.papers.printed.seismic import (
    PLACE,
    REDUCTION_WORKS,
    STALLS,
    WORST_FILL,
)
from visref.papers.seismic_figures import (
    BOXES,
    CONSERVATIVE,
    CROSS,
    CROSSED,
    FILL_SCALES,
    FRUSTUM,
    JUDGED,
    MEASURES,
    REDUCTION,
    REDUCTIONS,
    SCALES,
    SCENE,
    SIZE,
    THRESHOLDS,
    UNDIVIDED,
    ByCuller,
    boxed,
    conservative,
    counted,
    in_tiles,
    least_step,
    lost_of,
    mean_of,
    measured,
    missed_of,
    most_missed,
    never_less,
    nothing_missed,
    number,
    published,
    quotient,
    wasted_of,
)

TITLE = "Occlusion Culling: slides on the visualisation of seismic data (three passes)"


RUNS = JUDGED
EXPERIMENTS = (Experiment("prediction", "three-pass-prediction", scene=SCENE, size=SIZE),)


def tables(results: Results) -> list[Table]:
    """What the slides say, and what they leave open."""
    runs = {judged.key: measured(results, judged) for judged in RUNS}
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


def _fills(fill: ByCuller, spec: str) -> Series | None:
    """Each frame's depth tests over those of drawing what meets the frustum, where it has any."""
    ours, all_drawn = fill.get(counted(spec)), fill.get(counted(FRUSTUM))
    if ours is None or all_drawn is None:
        return None
    whole = dict(zip(all_drawn.frames, all_drawn.counts("depth_tests"), strict=True))
    tests = zip(ours.frames, ours.counts("depth_tests"), strict=True)
    fills = {frame: count / whole[frame] for frame, count in tests if whole[frame]}
    return series(list(fills.values()), list(fills), ours.walk) if fills else None


def _claims(by_spec: ByCuller, fill: ByCuller) -> Table:
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
        wasted_of(by_spec, spec) for spec in (BOXES, published(REDUCTION), published(CROSSED[0]))
    )
    rows = (
        Row("samples lost at a reduction of 1:100", REDUCTION_WORKS,
            number(lost_of(by_spec, published(REDUCTION))), "%", 3),
        Row("waits a frame", STALLS, None if usual is None else usual.mean("batches")),
        Row("worst fill, over drawing what is in the frustum", WORST_FILL, number(worst), "×", 2,
            note="three is reached where nothing is hidden and a stand-in covers what its object "
                 "does; ours is a reduction of 1:1, in the worst frame"),
        *(Row(f"mean fill at 1:100, an image of 1/{scale} the side", None, number(mean), "×", 2)
          for scale, mean in means.items()),
        Row("frame rate at 1:100 over frustum culling", None, number(gain), "", 1,
            Basis.WITHIN_RUN),
        Row("drawn for nothing: a query for each box, front to back", None, number(boxes), "%", 1),
        Row("drawn for nothing: three passes, 1:100", None, number(coarse), "%", 1),
        Row("drawn for nothing: three passes, 1:10", None, number(fine), "%", 1),
    )  # fmt: skip
    smaller = [
        quotient(means[small], means[large]) for large, small in itertools.pairwise(FILL_SCALES)
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


def _precision(by_spec: ByCuller) -> Table:
    """Stand-ins against boxes in the same passes, against the same depth."""
    rows: list[Row] = []
    wasted: list[Estimate | None] = []
    missed: list[Estimate | None] = []
    for reduction in REDUCTIONS:
        shares = []
        for spec, asked in ((published(reduction), "stand-ins"), (boxed(reduction), "boxes")):
            shares.append((wasted_of(by_spec, spec), missed_of(by_spec, spec)))
            rows += [
                Row(f"1:{reduction}, {asked} asked: drawn for nothing", None,
                    number(shares[-1][0]), "%", 1),
                Row(f"1:{reduction}, {asked} asked: visible objects missed", None,
                    number(shares[-1][1]), "%", 2),
            ]  # fmt: skip
        (ours, our_misses), (boxes, box_misses) = shares
        wasted.append(quotient(ours, boxes))
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


def _undivided(by_spec: ByCuller) -> Table:
    """What tiles are for: horizons that come as one object each."""
    rows: list[Row] = []
    own: list[Claim] = []
    frustum = mean_of(by_spec, FRUSTUM, "triangles_drawn")
    for spec, name in zip(UNDIVIDED, ("published", "conservative"), strict=True):
        drawn = {}
        for one, how in ((spec, "whole"), (in_tiles(spec), "in tiles")):
            drawn[how] = mean_of(by_spec, one, "triangles_drawn")
            rows += [
                Row(f"{name}, {how}: triangles drawn in full, of what is in the frustum", None,
                    number(quotient(drawn[how], frustum)), "%", 1),
                Row(f"{name}, {how}: visible objects missed", None, number(missed_of(by_spec, one)),
                    "%", 2),
                Row(f"{name}, {how}: samples lost", None, number(lost_of(by_spec, one)), "%", 3),
            ]  # fmt: skip
        own.append(
            Claim(
                f"{name}: in tiles of its own making less is drawn in full than of whole horizons: "
                "triangles over triangles",
                Sense.AT_MOST,
                quotient(drawn["in tiles"], drawn["whole"]),
            )
        )
    own.append(
        nothing_missed(
            "the conservative mode misses nothing in tiles of its own making",
            most_missed(by_spec, [in_tiles(UNDIVIDED[1])]),
        )
    )
    return Table("Horizons that come undivided", "Basic Algorithm: Preprocess", tuple(rows),
                 own=tuple(own))  # fmt: skip


def _name(reduction: int, threshold: int, scale: int) -> str:
    image = "full image" if scale == 1 else f"1/{scale} the side"
    return f"1:{reduction}, threshold {threshold}, {image}"


def _misses(by_spec: ByCuller) -> Table:
    every = [*((reduction, 0, 1) for reduction in REDUCTIONS), *CROSS]
    rows = []
    for at in dict.fromkeys(every):
        spec = published(*at)
        rows += [
            Row(
                f"{_name(*at)}: visible objects missed",
                None,
                number(missed_of(by_spec, spec)),
                "%",
                2,
            ),
            Row(f"{_name(*at)}: samples lost", None, number(lost_of(by_spec, spec)), "%", 3),
        ]
    by_reduction = [lost_of(by_spec, published(reduction)) for reduction in REDUCTIONS]
    with_threshold = [
        [lost_of(by_spec, published(reduction, t, scale)) for t in THRESHOLDS]
        for reduction, scale in itertools.product(CROSSED, SCALES)
    ]
    with_scale = [
        [missed_of(by_spec, published(reduction, t, scale)) for scale in SCALES]
        for reduction, t in itertools.product(CROSSED, THRESHOLDS)
    ]
    told = ", ".join(f"{100 * lost.value:.3f} %" for lost in by_reduction if lost is not None)
    own = (
        never_less("the more reduced, the more samples are lost", least_step([by_reduction]),
                    unit="%", digits=3, told=f"from 1:1 to 1:1000 it is {told}" if told else ""),
        never_less("the higher the threshold, the more samples are lost",
                    least_step(with_threshold), unit="%", digits=3),
        never_less("the smaller image misses more objects", least_step(with_scale), unit="%"),
    )  # fmt: skip
    return Table(
        "Misses against reduction, threshold and image scale",
        "not in the slides",
        tuple(rows),
        own=own,
        figure=_miss_figure(by_spec),
    )


def _miss_figure(by_spec: ByCuller) -> Figure | None:
    curves = []
    for threshold, scale in itertools.product(THRESHOLDS, SCALES):
        first = (threshold, scale) == (0, 1)
        points = [
            (float(reduction), lost.value)
            for reduction in (REDUCTIONS if first else CROSSED)
            if (lost := lost_of(by_spec, published(reduction, threshold, scale))) is not None
        ]
        if points:
            x, y = zip(*points, strict=True)
            label = _name(1, threshold, scale).partition(", ")[2]
            curves.append(Curve(label, x, tuple(100.0 * value for value in y)))
    if not curves:
        return None
    return Figure("reduction", "samples lost, %", tuple(curves), log_x=True, log_y=True)


def _cost(by_spec: ByCuller) -> Table:
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
        drawn[spec] = mean_of(by_spec, spec, "triangles_drawn")
        rows += [
            Row(f"{name}: triangles drawn in full", None, number(drawn[spec])),
            Row(f"{name}: a frame", None, None if one is None else one.ms(), "ms", 1,
                Basis.HARDWARE),
        ]  # fmt: skip
    own = never_less(
        "up to 1:100, the more reduced, the more triangles are drawn in full",
        least_step([[drawn[published(reduction)] for reduction in REDUCTIONS[:4]]]),
        digits=0,
    )
    return Table("Cost", "not in the slides", tuple(rows), own=(own,))


def _safe(safe: ByCuller, by_spec: ByCuller) -> Table:
    rows = []
    frustum = mean_of(by_spec, FRUSTUM, "drawn")
    drawn: dict[tuple[int, int], Estimate | None] = {}
    for at in itertools.product(CONSERVATIVE, SCALES):
        spec, name = conservative(*at), _name(at[0], 0, at[1])
        one = safe.get(spec)
        drawn[at] = quotient(mean_of(safe, spec, "drawn"), frustum)
        rows += [
            Row(f"{name}: visible objects missed", None, number(missed_of(safe, spec)), "%", 2),
            Row(f"{name}: drawn, of what is in the frustum", None, number(drawn[at]), "%", 1),
            Row(f"{name}: a frame", None, None if one is None else one.ms(), "ms", 1,
                Basis.HARDWARE),
        ]  # fmt: skip
    own = (
        nothing_missed("the conservative mode misses nothing", most_missed(safe, RUNS[1].cullers)),
        never_less(
            "the more reduced, the less it culls, of what is in the frustum",
            least_step([drawn[r, scale] for r in CONSERVATIVE] for scale in SCALES),
            unit="%",
        ),
    )
    figure = None
    if all(value is not None for value in drawn.values()):
        curves = tuple(
            Curve(
                "full image" if scale == 1 else f"1/{scale} the side",
                tuple(float(reduction) for reduction in CONSERVATIVE),
                tuple(100.0 * (number(drawn[r, scale]) or 0.0) for r in CONSERVATIVE),
            )
            for scale in SCALES
        )
        figure = Figure("reduction", "drawn, of what is in the frustum, %", curves, log_x=True)
    return Table("Conservative mode", "not in the slides", tuple(rows), own=own, figure=figure)


def _dynamic(moving: ByCuller) -> Table:
    frustum = mean_of(moving, FRUSTUM, "triangles_drawn")
    rows, drawn = [], {}
    for spec, name in (
        (BOXES, "a query for each box"),
        (published(REDUCTION), f"1:{REDUCTION}"),
        (conservative(REDUCTION), f"1:{REDUCTION}, conservative mode"),
    ):
        drawn[spec] = quotient(mean_of(moving, spec, "triangles_drawn"), frustum)
        rows += [
            Row(f"{name}: visible objects missed", None, number(missed_of(moving, spec)), "%", 2),
            Row(f"{name}: samples lost", None, number(lost_of(moving, spec)), "%", 3),
            Row(f"{name}: triangles drawn in full, of what is in the frustum", None,
                number(drawn[spec]), "%", 1),
        ]  # fmt: skip
    claim = Claim(
        "works for dynamic scenes: three passes at 1:100 draw less in full than is in the frustum",
        Sense.AT_MOST,
        drawn[published(REDUCTION)],
        unit="%",
    )
    own = nothing_missed(
        "the conservative mode misses nothing in motion",
        most_missed(moving, [conservative(REDUCTION)]),
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
