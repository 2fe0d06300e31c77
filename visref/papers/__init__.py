"""The papers: one module each, with the numbers it published and how they are measured here."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass

from visref.errors import InputError
from visref.papers.table import Experiment, Records, Table, Walk


@dataclass(frozen=True)
class Paper:
    """A paper's module, as `visref.papers.table` describes it."""

    name: str
    title: str
    walks: tuple[Walk, ...]
    experiments: tuple[Experiment, ...]
    tables: Callable[[Records], list[Table]]


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
        raise InputError(f"no paper is named '{name}'", mend=f"known are {', '.join(known)}")
    module = importlib.import_module(f"{__name__}.{name}")
    return Paper(name, module.TITLE, module.WALKS, module.EXPERIMENTS, module.tables)
