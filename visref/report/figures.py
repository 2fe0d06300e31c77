"""Figures of papers drawn again, as SVG that stands alone or in a page.

A curve is told apart by its colour *and* by its marks; what was published is dashed and has
hollow marks. Colours are attributes, which a page's style overrides by class, so that the same
SVG follows a page's theme and is legible as a file of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

from visref.papers.contents import Curve, Figure
from visref.report.plots import short, ticks
from visref.wording import legible

WIDTH = 560
_PLOT_HEIGHT, _LEFT, _RIGHT, _BOTTOM = 250, 66, 18, 46
_LEGEND_ROW, _LEGEND_MARK = 18, 34
# About an 11 px sans-serif letter's mean width, in pixels: it decides where a legend wraps.
_LETTER = 5.8
_INK, _SOFT, _LINE = "#1b2026", "#59626c", "#dcd9d1"
# Okabe and Ito's, in the order of the page's s0…s7.
_COLOURS = ("#1b2026", "#0072b2", "#d55e00", "#009e73", "#b8568c", "#3c9ad6", "#c78500", "#8a7a00")
_DASH = "6 4"


@dataclass(frozen=True)
class _Axis:
    """Where a value lies between the ends of an axis, and which values are named."""

    low: float
    high: float
    marks: tuple[float, ...]
    log: bool

    def share(self, value: float) -> float:
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def figure_svg(figure: Figure) -> Markup:
    """The figure. A value that a logarithmic axis cannot show (zero or less) is left out, and
    the axis's label says how many were. The same figure gives the same bytes."""
    curves, left_out = _drawable(figure)
    x_axis = _axis([x for curve in curves for x in curve.x], log=figure.log_x)
    y_axis = _axis([y for curve in curves for y in curve.y], log=figure.log_y)
    labels = list(dict.fromkeys(curve.label for curve in curves))
    legend, top = _legend(curves, labels)
    foot = top + _PLOT_HEIGHT

    def x_of(value: float) -> float:
        return _LEFT + x_axis.share(value) * (WIDTH - _LEFT - _RIGHT)

    def y_of(value: float) -> float:
        return foot - y_axis.share(value) * _PLOT_HEIGHT

    middle = (_LEFT + WIDTH - _RIGHT) / 2
    unseen = f" ({left_out} at zero not shown)" if left_out else ""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="figure" '
        f'viewBox="0 0 {WIDTH} {foot + _BOTTOM}" role="img" '
        f'aria-label="{escape(legible(_spoken(figure)))}" '
        'font-family="system-ui, sans-serif" font-size="11">',
        legend,
        f'<g class="grid" fill="{_SOFT}" stroke-width="1">',
        *(_line(x_of(mark), top, x_of(mark), foot) for mark in x_axis.marks),
        *(_line(_LEFT, y_of(mark), WIDTH - _RIGHT, y_of(mark)) for mark in y_axis.marks),
        *(_text(x_of(mark), foot + 15, "middle", short(mark)) for mark in x_axis.marks),
        *(_text(_LEFT - 7, y_of(mark) + 3.5, "end", short(mark)) for mark in y_axis.marks),
        _text(middle, foot + 36, "middle", figure.x_label),
        f'<g transform="translate(13 {top + _PLOT_HEIGHT / 2:.1f}) rotate(-90)">',
        _text(0, 0, "middle", figure.y_label + unseen),
        "</g></g>",
        *(_curve(curve, labels.index(curve.label), x_of, y_of) for curve in curves),
        "</svg>",
    ]
    # Numbers and class names of ours; every text from outside is escaped.
    return Markup("".join(parts))


def _drawable(figure: Figure) -> tuple[list[Curve], int]:
    curves, left_out = [], 0
    for curve in figure.curves:
        points = [
            (x, y)
            for x, y in zip(curve.x, curve.y, strict=True)
            if (x > 0.0 or not figure.log_x) and (y > 0.0 or not figure.log_y)
        ]
        left_out += len(curve.x) - len(points)
        if points:
            x, y = zip(*points, strict=True)
            curves.append(Curve(curve.label, x, y, curve.points))
    return curves, left_out


def _axis(values: Sequence[float], *, log: bool) -> _Axis:
    if not log:
        marks = ticks(max(values, default=1.0), whole=False)
        return _Axis(0.0, marks[-1], tuple(marks), log=False)
    low, high = min(values, default=1.0), max(values, default=10.0)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    # Over few decades the powers of ten alone would leave the axis bare.
    steps = (1, 2, 5) if len(decades) <= 3 else (1,)
    marks = [step * 10.0**decade for decade in decades for step in steps]
    low = max((mark for mark in marks if mark <= low), default=low)
    high = min((mark for mark in marks if mark >= high and mark > low), default=10.0 * low)
    return _Axis(low, high, tuple(mark for mark in marks if low <= mark <= high), log=True)


def _curve(
    curve: Curve, style: int, x_of: Callable[[float], float], y_of: Callable[[float], float]
) -> str:
    points = [(x_of(x), y_of(y)) for x, y in zip(curve.x, curve.y, strict=True)]
    marks = "".join(_mark(x, y, style, hollow=curve.published) for x, y in points)
    return _joined(points, style, dashed=curve.published) + marks


def _joined(points: Sequence[tuple[float, float]], style: int, *, dashed: bool) -> str:
    style %= len(_COLOURS)
    dash = f' stroke-dasharray="{_DASH}"' if dashed else ""
    return (
        f'<polyline class="curve c{style}" fill="none" stroke="{_COLOURS[style]}" '
        f'stroke-width="1.8"{dash} points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}"/>'
    )


def _mark(x: float, y: float, style: int, *, hollow: bool) -> str:
    """A circle, square, triangle, diamond or triangle on its tip, by style."""
    corners = (
        (),
        ((-3.6, -3.6), (3.6, -3.6), (3.6, 3.6), (-3.6, 3.6)),
        ((0, -4.8), (4.4, 3.2), (-4.4, 3.2)),
        ((0, -5), (5, 0), (0, 5), (-5, 0)),
        ((0, 4.8), (4.4, -3.2), (-4.4, -3.2)),
    )[style % 5]
    style %= len(_COLOURS)
    kind = "hollow" if hollow else "solid"
    fill = "#ffffff" if hollow else _COLOURS[style]
    look = f'class="{kind} c{style}" fill="{fill}" stroke="{_COLOURS[style]}" stroke-width="1.5"'
    if not corners:
        return f'<circle {look} cx="{x:.1f}" cy="{y:.1f}" r="3.8"/>'
    points = " ".join(f"{x + dx:.1f},{y + dy:.1f}" for dx, dy in corners)
    return f'<polygon {look} points="{points}"/>'


def _legend(curves: Sequence[Curve], labels: Sequence[str]) -> tuple[str, int]:
    """The legend above the plot, and the y at which the plot begins."""
    parts = []
    x, row = float(_LEFT), 0
    for curve in curves:
        text = f"{curve.label} (published)" if curve.published else curve.label
        width = _LEGEND_MARK + _LETTER * len(text) + 14
        if x > _LEFT and x + width > WIDTH:
            x, row = float(_LEFT), row + 1
        y = 12.0 + row * _LEGEND_ROW
        style = labels.index(curve.label)
        parts.append(_joined([(x, y), (x + 28, y)], style, dashed=curve.published))
        parts.append(_mark(x + 14, y, style, hollow=curve.published))
        parts.append(_text(x + _LEGEND_MARK, y + 3.8, "start", text, _INK, "ink"))
        x += width
    return "".join(parts), 12 + (row + 1) * _LEGEND_ROW


def _line(x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<line stroke="{_LINE}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def _text(x: float, y: float, anchor: str, text: str, fill: str = _SOFT, name: str = "soft") -> str:
    return (
        f'<text class="{name}" stroke="none" fill="{fill}" text-anchor="{anchor}" '
        f'x="{x:.1f}" y="{y:.1f}">{escape(legible(text))}</text>'
    )


def _spoken(figure: Figure) -> str:
    """The figure for those who cannot see it."""
    said = [
        f"{curve.label}{' (published)' if curve.published else ''} from {short(curve.y[0])} to "
        f"{short(curve.y[-1])}"
        for curve in figure.curves
        if curve.y
    ]
    return f"{figure.y_label} by {figure.x_label}: {'; '.join(said)}"
