"""The common shape of a paper's module: what is run for it, and the tables made from that.

A module of `visref.papers` states

    TITLE: str                             authors, title, where it appeared
    RUNS: tuple[JudgedRun, ...]            judged runs along camera paths
    EXPERIMENTS: tuple[Experiment, ...]    measurements that are no judged run
    def tables(results: Results) -> list[Table]

and, where a single run may fill a table by itself, whoever asked for it,

    def tables_of_run(run: RunFolder) -> list[Table]

It measures nothing itself: every number of ours comes from a run folder or from the JSON that
an experiment left, so that a table can be made again from what is on disk.

What is published is printed somewhere (`visref.papers.published`); a bare number is refused. What
is claimed is a `Claim` (`visref.papers.claims`): a figure of ours, on one side of the published
one. A figure that comes from frames is an `Estimate` with an interval (`visref.papers.estimates`),
made of a culler's counters with `CullerFrames.series`; one that comes from an experiment is
`single`, or a `series` where the experiment returns a number per frame.

    LAZY = Printed(7_009, "Fig. 7", "forest, 640x480, lazy / busy")
    NONE = Printed(147_969, "Fig. 7", "forest, 640x480, no occlusion culling")

    drawn = {name: culler_frames(run, spec).series("triangles_drawn") for name, spec in ...}
    share = drawn["lazy"].mean() / drawn["none"].mean()

    Row("lazy over none", ratio_of(LAZY, NONE), share.value, "%", 2)
    Claim(
        "forest: lazy draws no more than 4.74 % of what none draws",
        Sense.AT_MOST,
        share,                   # None: not measured
        ratio_of(LAZY, NONE),    # left out: a claim of order alone, judged by `even`
        even=1.0,                # as much as without; None where no order is claimed
        unit="%",
    )

A paper's claims stand in `Table.claims` and are counted; ours in `Table.own`, and are not. A claim
about several scenes is a claim for each, or of `least(...)` or `most(...)` of them, and says so.
What was set up as printed, and is no measurement, stands in `Table.setup`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

from visref.papers.claims import Claim, Grade, Sense
from visref.papers.estimates import Estimate, Series, least, most, series, single
from visref.papers.published import (
    Derived,
    Printed,
    PrintedRange,
    PrintedWords,
    Published,
    checked,
    one_more,
    printed_numbers,
    product_of,
    ratio_of,
)
from visref.run_folder.read import RunFolder

__all__ = [
    "Basis",
    "Claim",
    "Curve",
    "Derived",
    "Estimate",
    "Experiment",
    "Figure",
    "Grade",
    "JudgedRun",
    "Printed",
    "PrintedRange",
    "PrintedWords",
    "Published",
    "Results",
    "Row",
    "Sense",
    "Series",
    "SetUp",
    "Size",
    "Table",
    "least",
    "most",
    "one_more",
    "printed_curve",
    "printed_numbers",
    "product_of",
    "ratio_of",
    "series",
    "single",
]

Size = tuple[int, int]


@dataclass(frozen=True)
class JudgedRun:
    """Cullers judged along a path: `visref run SCENE --culler …`, kept as a run folder.

    `key`: the folder's name, unique in its paper. `scene`: a generated scene's spec. `size`: the
    images' width and height, None for the path's own. `large`: only with `--large`. `stretch`: a
    sample of the path's frames comes in stretches of that many consecutive ones, for methods that
    remember the frame before; each stretch starts with a cut. `cull_backfaces`: as `visref run
    --cull-backfaces`, in the truth and for the cullers. `alone`: what it measures hangs on the
    other cores, so nothing else may be measured beside it.
    """

    key: str
    scene: str
    cullers: tuple[str, ...]
    size: Size | None = None
    large: bool = False
    stretch: int = 1
    cull_backfaces: bool = False
    alone: bool = False


@dataclass(frozen=True)
class Experiment:
    """A measurement behind the entry point `name` of the group `visref.experiments`.

    It is called as `experiment(scene, path)` with the scene, and its path of as many frames as are
    asked for, or with (None, None) where `scene` is None; it returns what JSON can hold: numbers,
    strings, lists and dictionaries, times in milliseconds with `_ms` in their names.
    """

    key: str
    name: str
    scene: str | None = None
    size: Size | None = None
    large: bool = False
    stretch: int = 1
    cull_backfaces: bool = False
    alone: bool = False


class Basis(StrEnum):
    """How a published number and ours can be compared."""

    INDEPENDENT = "machine-independent"  # in ratio and order
    HARDWARE = "hardware of its day"  # not at all: printed for reference
    WITHIN_RUN = "ratio within one run"  # both sides are ratios of times of one machine


@dataclass(frozen=True)
class Row:
    """One number: as published, and ours. None is "not published" and "not measured"; `note` says
    why there is none, or why the two differ. `unit` is "", "%", "ms", …; a share with unit "%" is
    given as a share of 1. `digits` after the point. Raises TypeError for a published number without
    a source."""

    quantity: str
    published: Published | None
    ours: float | None
    unit: str = ""
    digits: int = 0
    basis: Basis = Basis.INDEPENDENT
    note: str = ""

    def __post_init__(self) -> None:
        checked(self.published)

    @property
    def theirs(self) -> float | None:
        """The published number, None where none or no single one is."""
        return self.published.amount if isinstance(self.published, (Printed, Derived)) else None

    @property
    def ratio(self) -> float | None:
        """Ours over the published, where the two may be compared at all."""
        if self.basis is Basis.HARDWARE or not self.theirs:
            return None
        return self.ours / self.theirs if self.ours is not None else None


@dataclass(frozen=True)
class SetUp:
    """What is set here as the paper prints it, and so cannot differ."""

    quantity: str
    published: Printed
    unit: str = ""

    def __post_init__(self) -> None:
        checked(self.published)


@dataclass(frozen=True)
class Curve:
    """One line of a figure. `published` ones are made by `printed_curve`, and drawn dashed."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    points: tuple[Published, ...] = ()

    @property
    def published(self) -> bool:
        return bool(self.points)


def printed_curve(label: str, x: Sequence[float], y: Sequence[Printed | Derived]) -> Curve:
    """A line of the paper's: what it prints, at each x. Raises TypeError for a number without a
    source."""
    for point in y:
        checked(point)
    return Curve(label, tuple(x), tuple(point.amount for point in y), tuple(y))


@dataclass(frozen=True)
class Figure:
    """A figure drawn again: curves over one axis, which may be logarithmic."""

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True)
class Table:
    """One table or figure of a paper. `source`: its number and page or section there. `claims`: the
    paper's; `own`: claims that are ours, which no count of the paper's includes. `setup`: what is
    set as printed."""

    title: str
    source: str
    rows: tuple[Row, ...]
    claims: tuple[Claim, ...] = ()
    own: tuple[Claim, ...] = ()
    setup: tuple[SetUp, ...] = ()
    figure: Figure | None = None


class Results(Protocol):
    """What was run for a paper; None for what was left out (`--large`) or failed."""

    def run(self, key: str) -> RunFolder | None:
        """The run folder of the judged run `key`."""

    def experiment(self, key: str) -> Mapping[str, Any] | None:
        """What the experiment `key` returned."""
