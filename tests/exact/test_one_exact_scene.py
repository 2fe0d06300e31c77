"""A scene is made ready for exact decisions once in a process, whoever asks for them."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from visref.cli.main import main
from visref.exact.scene import ExactScene

SCENE = "terrain_towers:scale=0.05,frames=2"


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file with a line for each `ExactScene` made, the process that made it."""
    log = tmp_path / "made"
    log.touch()
    make = ExactScene.__init__

    def counted(self: ExactScene, *given: object, **named: object) -> None:
        with log.open("a") as file:
            file.write(f"{os.getpid()}\n")
        make(self, *given, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(ExactScene, "__init__", counted)
    return log


def by_process(made: Path) -> list[int]:
    counts = Counter(made.read_text().split())
    made.write_text("")
    return sorted(counts.values())


def test_truth_makes_one_with_and_without_what_shows_between(made: Path, tmp_path: Path) -> None:
    truth = ["truth", SCENE, "--engine", "exact", "--out", str(tmp_path / "truth.parquet")]
    assert main(truth) == 0
    assert by_process(made) == [1]
    assert main([*truth, "--geometric", str(tmp_path / "between.parquet")]) == 0
    assert by_process(made) == [1]
