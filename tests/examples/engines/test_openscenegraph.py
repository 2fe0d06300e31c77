"""OpenSceneGraph's recorder tells what its cull leaves for drawing, and
docs/engines/openscenegraph.md says what came of it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.examples.engines.recorded import (
    ENGINES,
    city,
    judged,
    recorded_cases,
    rows_of_a_rerun,
    status_and_sums,
)

pytestmark = [pytest.mark.slow, pytest.mark.needs("g++", "openscenegraph")]
RECORD = (sys.executable, str(ENGINES / "openscenegraph" / "record.py"))


def record(*words: str | Path) -> subprocess.CompletedProcess[str]:
    done = subprocess.run([*RECORD, *map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path]:
    return city(tmp_path_factory.mktemp("city"))


def drawn_in(recording: Path) -> list[set[int]]:
    lines = recording.read_text(encoding="utf-8").splitlines()[1:]
    return [set(json.loads(line)["visible"]) for line in lines]


def test_its_frustum_culling_loses_nothing_of_a_city_and_occluders_leave_out_more(files, tmp_path):
    record(*files, tmp_path / "r.jsonl")
    plain = drawn_in(tmp_path / "r.jsonl")
    status, sums = status_and_sums(files[0], tmp_path)
    assert (status, sums["violations"]) == (0, 0)
    assert 0 < sums["visible"] < sums["drawn"] < 3 * 123 / 2
    record(*files, tmp_path / "r.jsonl", "--occluders", "300")
    hidden = drawn_in(tmp_path / "r.jsonl")
    assert all(less <= more for less, more in zip(hidden, plain, strict=True))
    assert hidden != plain
    status, sums = status_and_sums(files[0], tmp_path)
    assert (status, sums["violations"]) == (0, 0)


def test_without_culling_everything_is_there(files, tmp_path):
    """But what lies behind the eye, which its near and far planes leave out."""
    record(*files, tmp_path / "r.jsonl", "--culling", "none", "--near-far", "own")
    assert drawn_in(tmp_path / "r.jsonl") == [set(range(123))] * 3


def problems(names: tuple[str, ...], folder: Path, *settings: str) -> dict[str, tuple[str, ...]]:
    folder.mkdir()
    suite, out = recorded_cases(names, folder)
    record("--suite", suite, out, *settings)
    return judged(names, out)


def test_small_features_are_left_out_unless_that_is_off(tmp_path):
    name = "objects_of_one_sample"
    told, *_ = problems((name,), tmp_path / "default")[name]
    assert told.startswith("MISSED_OBJECT: ")
    assert problems((name,), tmp_path / "off", "--small-feature", "0") == {name: ()}


def test_it_passes_cases_that_move_and_shift_and_have_several_views(tmp_path):
    names = ("sliding_door", "lens_shift_and_zoom", "picture_and_map", "appearing_and_vanishing")
    assert problems(names, tmp_path / "cases") == dict.fromkeys(names, ())


def test_the_shrunk_case_is_lost_below_its_occluders_and_not_beside_them(tmp_path):
    case = ENGINES / "openscenegraph" / "nested"
    files = (case / "scene.glb", case / "path.json")
    record(*files, tmp_path / "r.jsonl", "--occluders", "300", "--nested")
    status, sums = status_and_sums(files[0], tmp_path)
    assert (status, sums["visible"], sums["missed"]) == (1, 1, 1)
    record(*files, tmp_path / "r.jsonl", "--occluders", "300")
    status, sums = status_and_sums(files[0], tmp_path)
    assert (status, sums["visible"], sums["missed"]) == (0, 1, 0)


def test_it_refuses_what_it_does_not_do(tmp_path):
    suite, out = recorded_cases(["bending_reeds", "cut_by_a_plane"], tmp_path)
    done = record("--suite", suite, out)
    assert list(out.iterdir()) == []
    assert "cut_by_a_plane: clip planes are not tried" in done.stderr
    assert "bending_reeds: scenes with levels of detail, hidden nodes or animation" in done.stderr


def test_a_scene_that_is_none_ends_with_a_line(tmp_path):
    (tmp_path / "no.glb").write_bytes(b"nothing")
    words = [tmp_path / "no.glb", tmp_path / "no.json", tmp_path / "r.jsonl"]
    done = subprocess.run([*RECORD, *map(str, words)], capture_output=True, text=True, check=False)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert not (tmp_path / "r.jsonl").exists()


def test_the_page_has_the_figures_of_a_rerun(tmp_path):
    rows, unknown = rows_of_a_rerun("openscenegraph", tmp_path)
    assert (len(rows), unknown) == (7, [])
