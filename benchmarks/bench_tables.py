"""The longer tables, each of a module with a `TITLE` and a `run()` that returns its rows, a `dict`
from column heading to text each. `make bench BENCH="--only table"` measures them."""

from __future__ import annotations

import importlib
from typing import Any

import pytest


@pytest.mark.parametrize("name", ["exact", "motion", "lazy_grid", "occupancy_map"])
def test_table(name: str, benchmark: Any, quick: bool) -> None:
    if quick:
        pytest.skip("it has one size")
    module = importlib.import_module(f"benchmarks.{name}")
    rows = benchmark.pedantic(module.run, rounds=1)
    benchmark.extra_info.update(kind="table", name=module.TITLE, rows=rows)
