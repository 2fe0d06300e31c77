"""The papers: one module each, with the numbers it published and how they are measured here."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from visref.errors import InputError
from visref.papers.contents import Experiment, JudgedRun, Results, Table
from visref.run_folder.read import RunFolder

# How a table fails whose numbers are not there: a counter that was not counted, a division by zero,
# the mean of nothing.
NO_NUMBERS = (ArithmeticError, LookupError, ValueError)


@dataclass(frozen=True)
class Paper:
    """A paper's module, as `visref.papers.contents` describes it."""

    name: str
    title: str
    runs: tuple[JudgedRun, ...]
    experiments: tuple[Experiment, ...]
    tables: Callable[[Results], list[Table]]
    tables_of_run: Callable[[RunFolder], list[Table]] = lambda run: []


def paper_names() -> list[str]:
    """The modules that are papers, sorted."""
    found = (f"{__name__}.{module.name}" for module in pkgutil.iter_modules(__path__))
    return sorted(
        name.rpartition(".")[2] for name in found if hasattr(importlib.import_module(name), "RUNS")
    )


def load_paper(name: str) -> Paper:
    """A paper by its module's name. Raises InputError naming the known ones."""
    known = paper_names()
    if name not in known:
        raise InputError(f"no paper is named '{name}'", fix=f"known are {', '.join(known)}")
    module = importlib.import_module(f"{__name__}.{name}")
    paper = Paper(name, module.TITLE, module.RUNS, module.EXPERIMENTS, module.tables)
    return replace(paper, tables_of_run=getattr(module, "tables_of_run", paper.tables_of_run))


@dataclass(frozen=True)
class _OneRun:
    """Results that hold a single run folder, as whichever judged run it fits."""

    paper: Paper
    folder: RunFolder

    def run(self, key: str) -> RunFolder | None:
        judged = next(judged for judged in self.paper.runs if judged.key == key)
        return self.folder if _fits(judged, self.folder) else None

    def experiment(self, key: str) -> Mapping[str, Any] | None:
        return None


def _fits(judged: JudgedRun, run: RunFolder) -> bool:
    """Whether a run folder is the judged run, over whatever frames."""
    return (
        run.manifest.scene.source == judged.scene
        and set(judged.cullers) <= {culler for culler, rows in run.frames_of.items() if rows}
        and (judged.size is None or run.sizes == {judged.size})
    )


def tables_beside(run: RunFolder) -> list[tuple[Paper, list[Table]]]:
    """What a run folder fills of the papers' tables: as one of a paper's judged runs, or else by
    what the paper makes of any run.

    A run may fit by its names and yet lack a counter, or have a zero, that a paper's tables divide
    by: then it fills none of them.
    """
    found = []
    for paper in map(load_paper, paper_names()):
        try:
            if any(_fits(judged, run) for judged in paper.runs):
                tables = paper.tables(_OneRun(paper, run))
            else:
                tables = paper.tables_of_run(run)
        except NO_NUMBERS:
            continue
        filled = [
            replace(
                table,
                rows=tuple(row for row in table.rows if row.ours is not None),
                claims=tuple(claim for claim in table.claims if claim.ours is not None),
                own=tuple(claim for claim in table.own if claim.ours is not None),
            )
            for table in tables
        ]
        found.append((paper, [table for table in filled if table.rows]))
    return [(paper, tables) for paper, tables in found if tables]
