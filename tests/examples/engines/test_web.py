"""The recorders of engines for the web tell what these drew: by their pictures, in which each
object has its colour, and by what visref says of it."""

from __future__ import annotations

import subprocess
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
    status_and_sums,
)

pytestmark = [pytest.mark.slow, pytest.mark.needs("node", "chromium|chromium-browser")]
EACH = [
    pytest.param(one, marks=pytest.mark.needs(one)) for one in ("three", "babylonjs", "playcanvas")
]


def record(engine: str, *words: str | Path) -> subprocess.CompletedProcess[str]:
    command = ["node", str(ENGINES / "web" / "record.mjs"), engine, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path]:
    return city(tmp_path_factory.mktemp("city"))


def assert_honest(recording: Path, scene: Path, pictures: Path) -> None:
    """What owns a pixel of a picture was in the list."""
    for number, drawn in enumerate(drawn_in(recording, scene)):
        pixels = np.asarray(Image.open(pictures / f"{number:03}.png").convert("RGB"))
        shown = {tuple(colour) for colour in np.unique(pixels.reshape(-1, 3), axis=0).tolist()}
        assert len(shown) > 3
        assert shown <= {colour_of(node) for node in drawn} | {(0, 0, 0)}


@pytest.mark.parametrize("engine", EACH)
def test_frustum_culling_loses_nothing_of_a_city_and_leaves_out_most_of_it(engine, files, tmp_path):
    done = record(engine, *files, tmp_path / "r.jsonl", f"--pictures={tmp_path}")
    assert done.returncode == 0, done.stderr
    status, sums = status_and_sums(files[0], tmp_path)
    assert (status, sums["violations"]) == (0, 0)
    assert 0 < sums["visible"] < sums["drawn"] < 3 * 123 / 2
    if engine != "playcanvas":  # its pictures are not in flat colours
        assert_honest(tmp_path / "r.jsonl", files[0], tmp_path)


@pytest.mark.needs("babylonjs")
def test_queries_of_babylon_js_are_told_as_they_were_acted_upon(files, tmp_path):
    queries = ("--occlusion=optimistic", "--occluders=20", f"--pictures={tmp_path}")
    done = record("babylonjs", *files, tmp_path / "r.jsonl", *queries)
    assert done.returncode == 0, done.stderr
    assert_honest(tmp_path / "r.jsonl", files[0], tmp_path)


@pytest.mark.needs("three")
def test_three_js_passes_cases_that_move_bend_and_repeat(tmp_path):
    names = ("bending_reeds", "instances_of_one_draw", "sliding_door", "lens_shift_and_zoom")
    suite, out = recorded_cases(names, tmp_path)
    done = record("three", "--suite", suite, out)
    assert done.stderr == ""
    assert judged(names, out) == dict.fromkeys(names, ())


def test_without_engines_it_says_what_to_do(tmp_path):
    copy = tmp_path / "web" / "record.mjs"
    copy.parent.mkdir()
    copy.write_text((ENGINES / "web" / "record.mjs").read_text(encoding="utf-8"), encoding="utf-8")
    command = ["node", str(copy), "three", "a.glb", "b.json", "c.jsonl"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "there are no engines; run: make engines\n")
