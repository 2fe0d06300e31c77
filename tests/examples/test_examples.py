"""The examples do what they say."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.support.truth_scenes import random_soup
from visref import (
    Camera,
    CameraPath,
    Promise,
    Referee,
    assert_conforms,
    conformance_checks,
    look_at,
    make_culler,
    make_engine,
)
from visref.cli.main import main

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
CITY = "city:scale=0.02,frames=3"


@pytest.fixture
def beside_the_examples(monkeypatch):
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.syspath_prepend(str(EXAMPLES))


def spheres(**options):
    from own_culler import SphereCulling

    return SphereCulling(**options)


@pytest.mark.parametrize("check", conformance_checks(moving=False), ids=str)
def test_the_examples_culler_conforms(check, beside_the_examples):
    assert_conforms(spheres, checks=[check])


def run_city(culler, out):
    status = main(["run", CITY, "--culler", culler, "--pictures", "0", "--out", str(out)])
    (sums,) = json.loads((out / "verdict.json").read_text())["cullers"].values()
    return status, sums


def test_the_examples_culler_is_named_on_the_command_line(beside_the_examples, tmp_path):
    status, sums = run_city("own_culler:SphereCulling", tmp_path / "all")
    assert (status, sums["missed"]) == (0, 0)
    assert 0 < sums["drawn"] < 3 * 123
    status, small = run_city("own_culler:SphereCulling:small_px=40", tmp_path / "large")
    assert (status, small["violations"]) == (0, 0)
    assert small["missed"] > 0
    assert small["drawn"] < sums["drawn"]


def test_the_examples_culler_would_be_convicted_if_it_promised_more(beside_the_examples):
    check = next(c for c in conformance_checks() if c.name == "objects_of_one_sample")

    def promises_too_much():
        culler = spheres(small_px=40.0)
        culler.promise = Promise.CONSERVATIVE
        return culler

    with pytest.raises(AssertionError, match="objects_of_one_sample"):
        assert_conforms(promises_too_much, checks=[check])


def test_the_judgement_from_arrays_prints_the_verdict(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / "judge_arrays.py"))
    # From straight ahead the front square alone shows; from the side, all three.
    assert capsys.readouterr().out.splitlines() == [
        "none: 6 drawn, 4 visible, no_violation_found",
        "frustum: 5 drawn, 4 visible, no_violation_found",
    ]
    verdict = json.loads((tmp_path / "run" / "verdict.json").read_text())
    assert verdict["status"] == "no_violation_found"


def scene_and_path():
    """Triangles of all sizes about (0, 0, -4), seen from within, from beside and in parallel."""
    centre = (0, 0, -4)
    eyes = ((0, 0, 0), (4, 5, -11))
    cameras = [Camera(look_at(eye, centre), 40, 30, near=0.1, yfov=0.9) for eye in eyes]
    parallel = Camera(look_at((0, 0, 5), centre), 40, 30, near=0.1, far=20.0, ymag=4.0)
    return random_soup(0), CameraPath((*cameras, parallel))


def numpy_engine(scene):
    from own_engine import NumPyEngine

    return NumPyEngine(scene)


def test_the_examples_engine_agrees_with_exact_arithmetic(beside_the_examples):
    scene, path = scene_and_path()
    engine, exact = numpy_engine(scene), make_engine("exact", scene)
    for camera in path:
        ours, truth = engine.frame(camera).buffer, exact.frame(camera).buffer
        assert np.array_equal(ours.triangle, truth.triangle)
        assert len(np.unique(truth.triangle)) > 5
        hit = truth.triangle >= 0
        np.testing.assert_allclose(ours.depth[hit], truth.depth[hit], rtol=1e-12)
        assert np.isinf(ours.depth[~hit]).all()


def test_the_referee_takes_the_examples_engine_without_registration(beside_the_examples):
    scene, path = scene_and_path()
    referee = Referee(scene, lambda: numpy_engine(scene))
    outcome = referee.run(path, range(len(path)), [("none", make_culler("none"))])
    (judged,) = outcome.cullers
    assert judged.totals.visible > 10
    assert outcome.exit == 0


def test_the_examples_engine_is_found_by_the_entry_point_it_names(
    beside_the_examples, tmp_path, monkeypatch
):
    folder = tmp_path / "somebodys-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: somebodys\nVersion: 1.0\n")
    text = (EXAMPLES / "own_engine.py").read_text(encoding="utf-8")
    group = '[project.entry-points."visref.engines"]'
    line = text.partition(group)[2].splitlines()[1].strip()
    (folder / "entry_points.txt").write_text(f"[visref.engines]\n{line.replace(chr(34), '')}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    out = tmp_path / "truth.parquet"
    scene, path = tmp_path / "triangle.obj", tmp_path / "path.json"
    scene.write_text("o triangle\nv -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n")
    camera = Camera(look_at((0, 0, 4), (0, 0, 0)), 16, 12, near=1.0, yfov=0.9)
    path.write_text(json.dumps(CameraPath((camera,)).to_json()))
    command = ["truth", str(scene), "--path", str(path), "--engine", "numpy", "--out", str(out)]
    assert main(command) == 0
    table = pq.read_table(out)
    assert json.loads(table.schema.metadata[b"visref"])["engine"] == "numpy"
    assert table["name"].to_pylist() == ["triangle"]
