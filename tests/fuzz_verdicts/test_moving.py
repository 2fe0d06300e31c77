"""visref and a brute force on baked scenes agree on small random scenes in motion, and disagree
once a fault is planted in how visref poses them."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from tests.fuzz_verdicts.moving_case import mixed_case, random_moving_case
from tests.fuzz_verdicts.moving_compare import compare_moving
from tests.fuzz_verdicts.moving_faults import MOVING_FAULTS
from tests.support import gltf_baking

pytestmark = pytest.mark.slow

# Of the soak's cases; each batch a test, so that they run side by side.
BATCH, BATCHES = 10, 5


@pytest.mark.parametrize("batch", range(BATCHES))
def test_no_verdict_on_a_moving_scene_differs_from_the_baked_ones(
    batch: int, tmp_path: Path
) -> None:
    pytest.importorskip("open3d")
    found = []
    for seed in range(batch * BATCH, (batch + 1) * BATCH):
        differences = compare_moving(mixed_case(seed), tmp_path).differences
        found += [f"case {seed}: {line}" for line in differences]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", MOVING_FAULTS)
def test_a_fault_planted_in_motion_is_found(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant, case = MOVING_FAULTS[name]
    sound = compare_moving(random_moving_case(case), tmp_path, ("exact",))
    assert not sound.differences
    plant(monkeypatch)
    assert compare_moving(random_moving_case(case), tmp_path, ("exact",)).differences


def test_exact_cases_are_exact_in_float32_wherever_they_stand() -> None:
    for seed in range(20):
        case = random_moving_case(seed)
        for frame in range(len(case.path["frames"])):
            for posed, _ in case.posed(frame):
                points = np.concatenate(posed.points)
                # Far out they are so about an origin, which is a whole number.
                about = points - np.round(points[0])
                assert np.array_equal(about.astype(np.float32).astype(float), about)


def test_the_baking_stands_alone() -> None:
    imported = {
        node.module if isinstance(node, ast.ImportFrom) else node.names[0].name
        for node in ast.walk(ast.parse(Path(gltf_baking.__file__).read_text()))
        if isinstance(node, (ast.Import, ast.ImportFrom))
    }
    known = {"__future__", "collections.abc", "dataclasses", "typing"}
    assert imported - known == {"json", "math", "struct", "numpy"}
