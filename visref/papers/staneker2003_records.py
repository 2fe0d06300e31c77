"""What was measured for Staneker, Bartz and Meissner 2003, by model of the paper."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from visref.papers.culler_frames import CullerFrames
from visref.papers.estimates import Estimate, Series, series

_T = TypeVar("_T")
_U = TypeVar("_U")

WALL, PROCESSOR = "frame_ms", "processor_ms"


@dataclass(frozen=True)
class Run:
    """One model at one size, judged: its shapes and triangles, and the frames by culler."""

    shapes: int
    triangles: int
    by_culler: dict[str, CullerFrames]

    def box_pixels(self, culler: str) -> Estimate:
        """Pixels of boxes that are not occluded, a frame."""
        return self.by_culler[culler].series("query_fragments_passed").mean()


@dataclass(frozen=True)
class Turns:
    """One model, by methods that took turns: what the experiments `occupancy-map-turns` and
    `-pair` found on the walk through `scene`."""

    scene: str
    found: Mapping[str, Any]

    @property
    def frames(self) -> int:
        return len(self.found["triangles_in_view"])

    def numbers(self, method: str, measure: str) -> list[float]:
        """A number a frame."""
        numbers: list[float] = self.found["methods"][method][measure]
        return numbers

    def series(self, method: str, measure: str) -> Series:
        return series(self.numbers(method, measure), range(self.frames), self.scene)

    def mean(self, method: str, measure: str) -> float:
        return statistics.fmean(self.numbers(method, measure))

    def rate(self, method: str) -> float:
        """Frames a second: all frames over their time."""
        return 1e3 / self.mean(method, WALL)

    def gain(self, method: str, over: str, measure: str = WALL) -> Estimate:
        """How many times less of something a method takes than another, over all frames."""
        return self.series(over, measure).mean() / self.series(method, measure).mean()

    def spent(self, before: str, after: str) -> str:
        """Where the time of a frame went before and after."""
        parts = ", ".join(
            f"{words} {self.mean(before, measure):.1f} to {self.mean(after, measure):.1f}"
            for words, measure in (
                ("queries", "query_ms"),
                ("drawing", "draw_ms"),
                ("maps", "arrange_ms"),
            )
        )
        asked = [self.mean(name, "queries") for name in (before, after)]
        return f"queries asked {asked[0]:.0f} to {asked[1]:.0f}; ms a frame: {parts}"


Runs = Mapping[str, Run]  # by model, those that were measured
TurnsOf = Mapping[str, Turns]


def of(measured: _T | None, number: Callable[[_T], _U]) -> _U | None:
    """What a function makes of what was measured, None of nothing."""
    return None if measured is None else number(measured)


def value(figure: Estimate) -> float:
    return figure.value
