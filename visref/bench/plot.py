"""The plot: seconds against each error in a panel of its own, with its Pareto front.

Colours are Okabe and Ito's (2008), told apart by marker as well. An error of zero has no
logarithm: such points lie on a shelf of their own below the axis.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from visref.bench.subsets import ALL
from visref.bench.timing import Bench
from visref.bench.verdict import pareto

_INK, _SOFT = "#1b2026", "#59626c"
_STYLES = {
    "exact": ("#1b2026", "D"),
    "embree": ("#0072b2", "o"),
    "embree:robust=false": ("#d55e00", "v"),
    "open3d": ("#009e73", "s"),
    "gl:depth=24": ("#cc79a7", "X"),
    "gl:depth=32": ("#8a7a00", "P"),
    "jittered rays": ("#0072b2", "o"),
    "pixel centres": ("#1b2026", "D"),
    "centres, then aimed rays": ("#d55e00", "^"),
}


@dataclass(frozen=True)
class Point:
    """One measurement in a panel."""

    series: str
    label: str
    seconds: float
    error: float
    hollow: bool = False


@dataclass(frozen=True)
class Panel:
    """One error against seconds. `quantum`: the least error that could have been measured."""

    title: str
    axis: str
    points: list[Point]
    quantum: float
    join: bool = False


def panels(bench: Bench) -> list[Panel]:
    """What the plot shows."""
    whole = [row for row in bench.image if row.sixteenths == ALL]
    visible = {row.engine: row.visible for row in whole}
    names = {16: "1", 8: "1/2", 4: "1/4", 2: "1/8", 1: "1/16"}
    sampled = [row for row in bench.image if row.sampling_missed is not None]
    known = max(bench.objects_known, 1)
    bounded = [row for row in bench.geometric if row.bound is not None]

    def rays(number: int | None) -> str:
        return f"{number} a pixel" if number else ""

    found = [
        Panel(
            "Numeric error: all samples, against exact",
            "share of samples given to a wrong object",
            [Point(r.engine, r.engine, r.seconds, r.numeric_wrong_samples / bench.samples)
             for r in whole],
            1.0 / bench.samples,
        ),
        Panel(
            "Sampling error: fewer samples, against all of the same engine",
            "share of visible objects missed",
            [Point(r.engine, names[r.sixteenths], r.seconds,
                   (r.sampling_missed or 0) / max(visible[r.engine], 1)) for r in sampled],
            1.0 / max(*visible.values(), 1),
            join=True,
        ),
        Panel(
            "Definitional error: samples, against the continuous image",
            "share of the known visible objects missed",
            [Point(r.method, rays(r.rays_per_pixel) or r.method, r.seconds,
                   r.missed_of_known / known) for r in bench.geometric],
            1.0 / known,
        ),
        Panel(
            "What may still be unseen: jittered rays",
            "share of the image, at most (95 %, all looks)",
            [Point(r.method, rays(r.rays_per_pixel), r.seconds, r.bound or 0.0)
             for r in bounded],
            0.0,
            join=True,
        ),
    ]  # fmt: skip
    if len({row.sixteenths for row in sampled}) == 1:
        del found[1]
    return found


def draw(bench: Bench, title: str) -> Figure:
    """The figure of all panels."""
    shown = panels(bench)
    figure = Figure(figsize=(12.4, 4.6 * ((len(shown) + 1) // 2)), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, color=_SOFT)
    for index, panel in enumerate(shown):
        _draw_panel(figure.add_subplot((len(shown) + 1) // 2, 2, index + 1), panel)
    return figure


def _draw_panel(axes: Any, panel: Panel) -> None:
    errors = [point.error for point in panel.points if point.error > 0.0]
    floor = min([panel.quantum or min(errors, default=1.0), *errors])
    shelf = floor / 4.0
    top = max([*errors, floor * 10.0])
    axes.set_xscale("log")
    axes.set_yscale("log")

    def height(error: float) -> float:
        return error if error > 0.0 else shelf

    has_zero = any(point.error == 0.0 for point in panel.points)
    if has_zero:
        axes.axhspan(shelf / 2.2, shelf * 2.0, color="#f2f0ea", zorder=0)
        axes.text(0.995, shelf, "none", transform=axes.get_yaxis_transform(), ha="right",
                  va="center", fontsize=9, color=_SOFT)  # fmt: skip
    front = pareto(panel.points, lambda p: p.seconds, lambda p: p.error)
    axes.step([p.seconds for p in front], [height(p.error) for p in front], where="post",
              color="#d5d1c6", linewidth=5, zorder=1, solid_capstyle="round")  # fmt: skip
    for series in dict.fromkeys(point.series for point in panel.points):
        mine = [point for point in panel.points if point.series == series]
        colour, marker = _STYLES[series]
        x, y = [p.seconds for p in mine], [height(p.error) for p in mine]
        axes.plot(x, y, linestyle="-" if panel.join else "", linewidth=1.1, color=colour,
                  marker=marker, markersize=8, markeredgecolor="white", markeredgewidth=0.8,
                  label=series, zorder=3)  # fmt: skip
    _labels(axes, panel, height)
    seconds = [point.seconds for point in panel.points]
    axes.set_xlim(min(seconds) / 1.5, max(seconds) * 2.2)
    axes.set_ylim(shelf / 2.2 if has_zero else floor / 2.5, top * 3.5)
    axes.set_title(panel.title, loc="left", fontsize=11, fontweight="bold", color=_INK)
    axes.set_xlabel("seconds a frame", fontsize=9.5, color=_SOFT)
    axes.set_ylabel(panel.axis, fontsize=9.5, color=_SOFT)
    axes.grid(True, which="major", color="#e4e1d9", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=9, colors=_SOFT, which="both", length=0)
    axes.xaxis.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_locator(LogLocator(10.0))
    axes.yaxis.set_major_formatter(
        FuncFormatter(
            lambda value, _: "" if value < floor * 0.6 else f"{value:.0e}".replace("e-0", "e-")
        )
    )
    for side in axes.spines.values():
        side.set_visible(False)
    if panel.join and len({point.series for point in panel.points}) > 1:
        axes.legend(fontsize=9, frameon=False, loc="upper right", labelcolor=_INK)


def _labels(axes: Any, panel: Panel, height: Any) -> None:
    """A name beside each point; in a joined panel beside those of the first series alone. A
    label goes above its point, or below where the last one is in its way."""
    first = panel.points[0].series
    points = [point for point in panel.points if not panel.join or point.series == first]
    seconds = [point.seconds for point in panel.points]
    width = math.log(2.0 * max(seconds) / min(seconds))
    before, below = None, False
    for point in sorted(points, key=lambda point: point.seconds):
        close = (
            before is not None
            and math.log(point.seconds / before.seconds) < 0.03 * len(before.label) * width
            and 0.4 < height(point.error) / height(before.error) < 2.5
        )
        below = close and not below
        axes.annotate(point.label, (point.seconds, height(point.error)),
                      xytext=(7, -13 if below else 5), textcoords="offset points", fontsize=8.5,
                      color=_INK, zorder=4)  # fmt: skip
        before = point


def pictures(bench: Bench, title: str) -> tuple[str, bytes]:
    """The plot as SVG and as PNG; the same numbers give the same bytes."""
    import matplotlib

    figure = draw(bench, title)
    svg, png = io.BytesIO(), io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "visref", "svg.fonttype": "none"}):
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    figure.savefig(png, format="png", dpi=130, metadata={"Software": None})
    text = svg.getvalue().decode()
    return text[text.index("<svg") :], png.getvalue()
