"""visref and a brute force agree on small random cases, and disagree once a fault is planted."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.fuzz_verdicts import brute
from tests.fuzz_verdicts.cases import random_case
from tests.fuzz_verdicts.compare import compare
from tests.fuzz_verdicts.faults import FAULTS, engine_for

pytestmark = pytest.mark.slow

# Of the soak's cases; each batch a test, so that they run side by side.
BATCH, BATCHES = 25, 6


@pytest.mark.parametrize("batch", range(BATCHES))
def test_no_verdict_differs_from_the_brute_forces(batch: int, tmp_path: Path) -> None:
    pytest.importorskip("open3d")
    found = []
    for seed in range(batch * BATCH, (batch + 1) * BATCH):
        found += [
            f"case {seed}: {line}" for line in compare(random_case(seed), tmp_path).differences
        ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_found(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant, case = FAULTS[name]
    sound = compare(random_case(case), tmp_path, (engine_for(name),))
    assert not sound.differences
    plant(monkeypatch)
    assert compare(random_case(case), tmp_path, (engine_for(name),)).differences


def test_the_brute_force_is_short_and_stands_alone() -> None:
    text = Path(brute.__file__).read_text()
    imported = {
        node.module if isinstance(node, ast.ImportFrom) else node.names[0].name
        for node in ast.walk(ast.parse(text))
        if isinstance(node, (ast.Import, ast.ImportFrom))
    }
    assert imported == {"collections", "fractions", "math"}
    assert len([line for line in text.splitlines() if line.strip()]) < 150
