"""The papers: one module each, with the numbers it published and how they are measured here."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from visref.errors import InputError
from visref.papers.table import Experiment, Records, Table, Walk
from visref.run_folder.read import RunRecord


@dataclass(frozen=True)
class Paper:
    """A paper's module, as `visref.papers.table` describes it."""

    name: str
    title: str
    walks: tuple[Walk, ...]
    experiments: tuple[Experiment, ...]
    tables: Callable[[Records], list[Table]]
    tables_of_run: Callable[[RunRecord], list[Table]] = lambda record: []


def paper_names() -> list[str]:
    """The modules that are papers, sorted."""
    found = (f"{__name__}.{module.name}" for module in pkgutil.iter_modules(__path__))
    return sorted(
        name.rpartition(".")[2] for name in found if hasattr(importlib.import_module(name), "WALKS")
    )


def load_paper(name: str) -> Paper:
    """A paper by its module's name. Raises InputError naming the known ones."""
    known = paper_names()
    if name not in known:
        raise InputError(f"no paper is named '{name}'", fix=f"known are {', '.join(known)}")
    module = importlib.import_module(f"{__name__}.{name}")
    paper = Paper(name, module.TITLE, module.WALKS, module.EXPERIMENTS, module.tables)
    return replace(paper, tables_of_run=getattr(module, "tables_of_run", paper.tables_of_run))


@dataclass(frozen=True)
class _OneRun:
    """Records that hold a single run, as whichever walk it fits."""

    paper: Paper
    record: RunRecord

    def run(self, key: str) -> RunRecord | None:
        walk = next(walk for walk in self.paper.walks if walk.key == key)
        return self.record if _fits(walk, self.record) else None

    def experiment(self, key: str) -> Mapping[str, Any] | None:
        return None


def _fits(walk: Walk, record: RunRecord) -> bool:
    """Whether a run is the walk, over whatever frames."""
    sizes = {
        (record.manifest["samples"][frame]["width"], record.manifest["samples"][frame]["height"])
        for frame in record.frame_numbers
    }
    return (
        record.manifest["scene"]["source"] == walk.scene
        and set(walk.cullers) <= {culler for culler, rows in record.frames_of.items() if rows}
        and (walk.size is None or sizes == {walk.size})
    )


def tables_beside(record: RunRecord) -> list[tuple[Paper, list[Table]]]:
    """What a run fills of the papers' tables: as one of a paper's walks, or else by what the
    paper makes of any run."""
    found = []
    for paper in map(load_paper, paper_names()):
        if any(_fits(walk, record) for walk in paper.walks):
            tables = paper.tables(_OneRun(paper, record))
        else:
            tables = paper.tables_of_run(record)
        filled = [
            replace(
                table,
                rows=tuple(row for row in table.rows if row.ours is not None),
                trends=tuple(trend for trend in table.trends if trend.holds is not None),
            )
            for table in tables
        ]
        found.append((paper, [table for table in filled if table.rows]))
    return [(paper, tables) for paper, tables in found if tables]
