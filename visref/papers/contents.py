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
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

from visref.run_folder.read import RunFolder

Size = tuple[int, int]


@dataclass(frozen=True)
class JudgedRun:
    """Cullers judged along a path: `visref run SCENE --culler …`, kept as a run folder.

    `key`: the folder's name, unique in its paper. `scene`: a generated scene's spec. `size`: the
    images' width and height, None for the path's own. `large`: only with `--large`. `stretch`: a
    sample of the path's frames comes in stretches of that many consecutive ones, for methods that
    remember the frame before; each stretch starts with a cut. `cull_backfaces`: as `visref run
    --cull-backfaces`, in the truth and for the cullers.
    """

    key: str
    scene: str
    cullers: tuple[str, ...]
    size: Size | None = None
    large: bool = False
    stretch: int = 1
    cull_backfaces: bool = False


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


class Basis(StrEnum):
    """How a published number and ours can be compared."""

    INDEPENDENT = "machine-independent"  # in ratio and order
    HARDWARE = "hardware of its day"  # not at all: printed for reference
    WITHIN_RUN = "ratio within one run"  # both sides are ratios of times of one machine


@dataclass(frozen=True)
class Row:
    """One number: as published, and ours. None is "not published" and "not measured"; `note` says
    why there is none, or why the two differ. `unit` is "", "%", "ms", …; a share with unit "%" is
    given as a share of 1. `digits` after the point."""

    quantity: str
    published: float | str | None
    ours: float | None
    unit: str = ""
    digits: int = 0
    basis: Basis = Basis.INDEPENDENT
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """Ours over the published, where the two may be compared at all."""
        if self.basis is Basis.HARDWARE or not isinstance(self.published, (int, float)):
            return None
        return self.ours / self.published if self.ours is not None and self.published else None


@dataclass(frozen=True)
class Trend:
    """A claim of the paper's that ours must bear out; `holds` is None where it was not measured.
    `why`: what was measured where it does not hold."""

    claim: str
    holds: bool | None
    why: str = ""


@dataclass(frozen=True)
class Curve:
    """One line of a figure. `published` lines are drawn dashed."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    published: bool = False


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
    """One table or figure of a paper. `source`: its number and page or section there."""

    title: str
    source: str
    rows: tuple[Row, ...]
    trends: tuple[Trend, ...] = ()
    figure: Figure | None = None


class Results(Protocol):
    """What was run for a paper; None for what was left out (`--large`) or failed."""

    def run(self, key: str) -> RunFolder | None:
        """The run folder of the judged run `key`."""

    def experiment(self, key: str) -> Mapping[str, Any] | None:
        """What the experiment `key` returned."""
