"""Line plots over frames as inline SVG: small, sharp in print, coloured by the page's theme.

A series is told apart by its colour *and* its dashes; both come from its place in the list.
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

from visref.wording import legible

WIDTH, HEIGHT = 440, 190
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 12, 26
# The palette and the dashes are classes s0…s15 of the page's style: eight colours, and each again
# with other dashes.
STYLES = 16
# With more points than this, dots would hide the line.
_DOTTED = 40


@dataclass(frozen=True)
class Series:
    """A line: its value by frame, and its place among the page's styles."""

    label: str
    values: Mapping[int, float]
    style: int


# A line as flat as this, so many times above all others, would squash them.
_OFF_SCALE = 2.0


def on_scale(series: Sequence[Series]) -> tuple[list[Series], str]:
    """The series without those that stay at one value far above all others, as no culling does,
    and a note that says so."""
    flat = [line for line in series if len(line.values) > 1 and len({*line.values.values()}) == 1]
    others = [value for line in series if line not in flat for value in line.values.values()]
    top = _OFF_SCALE * max(others, default=math.inf)
    off = [line for line in flat if next(iter(line.values.values())) > top]
    said = [f"{line.label} with {short(next(iter(line.values.values())))}" for line in off]
    note = f"Off the scale in every frame: {', '.join(said)}." if off else ""
    return [line for line in series if line not in off], note


@dataclass(frozen=True)
class Plot:
    """One panel. `area`, if given, is drawn as a filled background (label, values). `along`: what
    stands at the foot, of which values are given. `log`: heights are by the logarithm, for values
    above 0."""

    title: str
    unit: str
    series: Sequence[Series]
    area: tuple[str, Mapping[int, float]] | None = None
    note: str = ""
    along: str = "frame"
    log: bool = False

    @property
    def svg(self) -> Markup:
        return _svg(self)

    @property
    def data(self) -> str:
        """What the pointer reads out, as JSON: frames, and label, style, values of each line."""
        frames = _frames(self)
        lines = [] if self.area is None else [(self.area[0], -1, self.area[1])]
        lines += [(series.label, series.style, series.values) for series in self.series]
        return json.dumps(
            {
                "along": self.along,
                "frames": frames,
                "left": _LEFT,
                "right": WIDTH - _RIGHT,
                "lines": [
                    {"label": label, "style": style, "values": [values.get(f) for f in frames]}
                    for label, style, values in lines
                ],
            }
        )


def ticks(top: float, *, whole: bool) -> list[float]:
    """Three to six round values from 0 to at least `top`; whole numbers only, if asked."""
    if top <= 0.0:
        return [0.0, 1.0]
    raw = top / 4
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * m for m in (1, 2, 2.5, 5, 10) if power * m >= raw * 0.999999)
    if whole:
        step = max(1.0, math.ceil(step))
    return [step * i for i in range(math.ceil(top / step - 1e-9) + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Round values from at most `low` to at least `high`, both above 0: powers of ten, and where
    these are few, 2 and 5 times them."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    last = max(last, first + 1)
    steps = (1, 2, 5) if last - first <= 2 else (1,)
    marks = [m * 10.0**power for power in range(first, last + 1) for m in steps]
    below = max((mark for mark in marks if mark <= low), default=marks[0])
    above = min((mark for mark in marks if mark >= high), default=marks[-1])
    held = [mark for mark in marks if below <= mark <= above]
    return held if len(held) > 1 else marks[:2] if held[0] == marks[0] else [marks[0], *held]


# The highest value is so many times the usual one: by the value itself, one line lies at the top
# and all others on the ground.
_SPREAD = 12.0


def needs_log(series: Sequence[Series]) -> bool:
    """Whether one line stands so far above others that only a logarithm shows them all."""
    usual = [statistics.median(line.values.values()) for line in series if line.values]
    above = [value for value in usual if value > 0.0]
    positive = all(value > 0.0 for line in series for value in line.values.values())
    return positive and len(above) > 1 and max(above) > _SPREAD * min(above)


def _frames(plot: Plot) -> list[int]:
    every = {frame for series in plot.series for frame in series.values}
    if plot.area is not None:
        every |= set(plot.area[1])
    return sorted(every)


def _svg(plot: Plot) -> Markup:
    frames = _frames(plot)
    values = [value for series in plot.series for value in series.values.values()]
    if plot.area is not None:
        values += plot.area[1].values()
    whole = all(float(value).is_integer() for value in values)
    log = plot.log and bool(values)
    marks = (
        log_ticks(min(values), max(values)) if log else ticks(max(values, default=0.0), whole=whole)
    )
    first, last = (frames[0], frames[-1]) if frames else (0, 0)

    def x_of(frame: int) -> float:
        share = (frame - first) / (last - first) if last > first else 0.5
        return _LEFT + share * (WIDTH - _LEFT - _RIGHT)

    def y_of(value: float) -> float:
        share = value / marks[-1]
        if log:
            share = math.log(value / marks[0]) / math.log(marks[-1] / marks[0])
        return HEIGHT - _BOTTOM - share * (HEIGHT - _TOP - _BOTTOM)

    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="'
        f'{escape(legible(_spoken(plot)))}"><g class="grid">'
    ]
    for mark in marks:
        y = y_of(mark)
        parts.append(
            f'<line x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text x="{_LEFT - 6}" y="{y + 3.5:.1f}" class="end">{short(mark)}</text>'
        )
    parts += [
        f'<text x="{x_of(frame):.1f}" y="{HEIGHT - 8}" class="mid">{frame}</text>'
        for frame in _frame_marks(frames)
    ]
    parts.append("</g>")
    if plot.area is not None and frames:
        points = [(x_of(f), y_of(plot.area[1][f])) for f in frames if f in plot.area[1]]
        if len(points) == 1:
            points = [(_LEFT, points[0][1]), (WIDTH - _RIGHT, points[0][1])]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        foot = y_of(0.0)
        parts.append(
            f'<polygon class="area" points="{points[0][0]:.1f},{foot:.1f} {line} '
            f'{points[-1][0]:.1f},{foot:.1f}"/>'
        )
    for series in plot.series:
        points = [(x_of(f), y_of(series.values[f])) for f in frames if f in series.values]
        style = f"s{series.style % STYLES}"
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        parts.append(f'<polyline class="line {style}" points="{line}"/>')
        if len(points) <= _DOTTED:
            parts.append(f'<g class="dots {style}">')
            parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2"/>' for x, y in points]
            parts.append("</g>")
    parts.append(f'<line class="cursor" y1="{_TOP}" y2="{HEIGHT - _BOTTOM}"/></svg>')
    # Numbers and class names of ours; the one text from outside is escaped above.
    return Markup("".join(parts))


def _spoken(plot: Plot) -> str:
    """The plot for those who cannot see it."""
    said = [
        f"{series.label} from {short(min(series.values.values()))} to "
        f"{short(max(series.values.values()))}"
        for series in plot.series
        if series.values
    ]
    return f"{plot.title} ({plot.unit}) by {plot.along}: {'; '.join(said)}"


def _frame_marks(frames: Sequence[int]) -> list[int]:
    """Up to six frames to name below the axis, the first and the last among them."""
    if len(frames) <= 6:
        return list(frames)
    return [frames[round(i * (len(frames) - 1) / 5)] for i in range(6)]


def short(value: float) -> str:
    """A number for an axis: 1200000 as 1.2M."""
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= size * (10 if letter == "k" else 1):
            return f"{value / size:.4g}{letter}"
    return f"{value:.4g}"
