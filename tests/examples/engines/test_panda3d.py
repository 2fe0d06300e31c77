"""Panda3D's recorder tells what Panda3D drew, and docs/engines/panda3d.md says what came of it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.examples.engines.recorded import (
    ENGINES,
    city,
    colour_of,
    drawn_in,
    judged,
    recorded_cases,
    rows_of_a_rerun,
    status_and_sums,
)

pytestmark = pytest.mark.needs("panda3d")
RECORD = (sys.executable, str(ENGINES / "panda3d" / "record.py"))


def record(*words: str | Path) -> None:
    done = subprocess.run([*RECORD, *map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path]:
    return city(tmp_path_factory.mktemp("city"))


def test_its_frustum_culling_loses_nothing_of_a_city_and_leaves_out_most_of_it(files, tmp_path):
    record(*files, tmp_path / "r.jsonl")
    status, sums = status_and_sums(files[0], tmp_path)
    assert (status, sums["violations"]) == (0, 0)
    assert 0 < sums["visible"] < sums["drawn"] < 3 * 123 / 2


def test_without_culling_everything_is_drawn(files, tmp_path):
    record(*files, tmp_path / "r.jsonl", "--no-culling")
    assert [len(drawn) for drawn in drawn_in(tmp_path / "r.jsonl", files[0])] == [123] * 3


def test_a_picture_shows_the_objects_that_were_recorded_and_no_others(files, tmp_path):
    """In the frame buffer each object has its colour: what owns a pixel there was in the list."""
    record(*files, tmp_path / "r.jsonl", "--pictures", tmp_path, "--occluders", "300")
    for number, drawn in enumerate(drawn_in(tmp_path / "r.jsonl", files[0])):
        pixels = np.asarray(Image.open(tmp_path / f"{number:03}.png").convert("RGB"))
        shown = {tuple(colour) for colour in np.unique(pixels.reshape(-1, 3), axis=0).tolist()}
        assert len(shown) > 3
        assert shown <= {colour_of(node) for node in drawn} | {(0, 0, 0)}


def test_occluders_leave_out_more_and_lose_nothing(files, tmp_path):
    record(*files, tmp_path / "r.jsonl")
    _, without = status_and_sums(files[0], tmp_path)
    record(*files, tmp_path / "r.jsonl", "--occluders", "300")
    status, sums = status_and_sums(files[0], tmp_path)
    assert (status, sums["violations"]) == (0, 0)
    assert sums["visible"] <= sums["drawn"] < without["drawn"]


def problems(names: Sequence[str], folder: Path, *settings: str) -> dict[str, tuple[str, ...]]:
    suite, out = recorded_cases(names, folder)
    record("--suite", suite, out, *settings)
    return judged(names, out)


def test_it_passes_cases_of_the_suite_that_are_moved_shifted_parallel_and_of_two_views(tmp_path):
    names = ("sliding_door", "lens_shift_and_zoom", "picture_and_map", "appearing_and_vanishing")
    assert problems(names, tmp_path, "--occluders", "50") == dict.fromkeys(names, ())


def test_occluders_before_an_endless_far_plane_hide_what_is_before_them(tmp_path):
    name = "huge_depth_range"
    (tmp_path / "without").mkdir()
    assert problems([name], tmp_path / "without") == {name: ()}
    (tmp_path / "with").mkdir()
    told, *_ = problems([name], tmp_path / "with", "--occluders", "50")[name]
    assert told.startswith(
        "MISSED_OBJECT: frame 1 (64 x 48): 'near' (object 0) lost 144 of its 144"
    )


def test_the_shrunk_case_still_shows_it(tmp_path):
    case = ENGINES / "panda3d" / "endless"
    files = (case / "scene.glb", case / "path.json")
    record(*files, tmp_path / "r.jsonl", "--occluders", "50")
    status, sums = status_and_sums(files[0], tmp_path)
    assert (status, sums["visible"], sums["missed"]) == (1, 11, 10)
    record(*files, tmp_path / "r.jsonl")
    status, sums = status_and_sums(files[0], tmp_path)
    assert (status, sums["visible"], sums["missed"]) == (0, 11, 0)


def test_it_refuses_what_it_does_not_do(tmp_path):
    suite, out = recorded_cases(["bending_reeds", "cut_by_a_plane"], tmp_path)
    done = subprocess.run([*RECORD, "--suite", suite, out], capture_output=True, text=True)
    assert list(out.iterdir()) == []
    assert "cut_by_a_plane: clip planes are not tried" in done.stderr
    assert "bending_reeds/scene.glb is animated, and here it stands still" in done.stderr


@pytest.mark.slow
def test_the_page_has_the_figures_of_a_rerun(tmp_path):
    rows, unknown = rows_of_a_rerun("panda3d", tmp_path)
    assert (len(rows), unknown) == (6, [])
    assert json.loads((tmp_path / "panda3d-city" / "verdict.json").read_text())["exit_status"] == 0
