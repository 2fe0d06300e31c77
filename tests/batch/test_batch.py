"""A batch's runs are those of single commands; a job's failure is its own, and what is finished is
not judged again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.test_cli import write_scene
from tests.support.same_bytes import differing
from visref.cli.main import main

pytestmark = pytest.mark.slow

CULLERS = ("none", "my_cullers:Leaves")
PLUG_IN = """
import os
import numpy as np
from visref.culler import Culler, DrawnSet

class Leaves(Culler):
    memory = 0

    def prepare(self, scene):
        self.count = scene.object_count
        return scene.object_units()

    def cull(self, camera):
        with open("asked.txt", "a") as asked:
            asked.write("x")
        if os.path.exists("kill"):
            os.unlink("kill")
            os.kill(int(open("pid").read()), 9)
        return DrawnSet(np.arange(1, self.count, dtype=np.int32))
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Two scenes, a path, a plug-in, and the runs of single commands."""
    folder = tmp_path_factory.mktemp("batch")
    for name in ("a", "b"):
        (folder / name).mkdir()
        write_scene(folder / name, frames=3)
    (folder / "my_cullers.py").write_text(PLUG_IN)
    cullers = json.dumps(CULLERS)
    (folder / "batch.toml").write_text(
        "[options]\npictures = 1\n[[matrix]]\n"
        f'scenes = ["a/scene.glb", "b/scene.glb"]\npaths = ["a/path.json"]\ncullers = {cullers}\n'
    )
    before = Path.cwd()
    os.chdir(folder)
    try:
        for name in ("a", "b"):
            given = [f"--culler={one}" for one in CULLERS]
            given += ["--path", "a/path.json", "--pictures", "1", "--out", f"single-{name}"]
            assert main(["run", f"{name}/scene.glb", *given]) == 1
    finally:
        os.chdir(before)
    return folder


def batch(place, out, *more):
    return main(["batch", str(place / "batch.toml"), "--out", str(out), *more])


def asked(place):
    return (place / "asked.txt").stat().st_size


def test_the_runs_of_a_batch_are_those_of_single_commands_and_stand_the_next_time(
    place, tmp_path, capsys
):
    out = tmp_path / "out"
    assert batch(place, out, "--workers", "1") == 1
    for name in ("a", "b"):
        assert differing(place / f"single-{name}", out / "runs" / f"{name}-scene-a-path") == []
        assert (out / "pages" / f"{name}-scene-a-path" / "report.html").is_file()
    said = capsys.readouterr().out
    assert "[2/2] " in said
    assert said.count("✕ violation") == 2
    page = (out / "index.html").read_text()
    assert 'href="pages/a-scene-a-path/report.html"' in page
    record, before = (out / "batch.json").read_bytes(), asked(place)
    assert batch(place, out, "--json") == 1
    assert asked(place) == before
    assert json.loads(capsys.readouterr().out) == json.loads(record)
    assert (out / "batch.json").read_bytes() == record


def test_a_batch_on_a_cluster_leaves_the_same(place, tmp_path):
    pytest.importorskip("distributed")
    out = tmp_path / "out"
    given = ["--dask", "local", "--workers", "2", "--dask-frames", "1"]
    assert batch(place, out, *given) == 1
    for name in ("a", "b"):
        assert differing(place / f"single-{name}", out / "runs" / f"{name}-scene-a-path") == []


def test_a_run_that_was_changed_since_is_judged_again(place, tmp_path):
    out = tmp_path / "out"
    assert batch(place, out, "--workers", "1") == 1
    verdict = out / "runs" / "a-scene-a-path" / "verdict.json"
    whole, before = verdict.read_bytes(), asked(place)
    verdict.write_bytes(whole.replace(b'"missed": 3', b'"missed": 2', 1))
    assert verdict.read_bytes() != whole
    assert batch(place, out, "--workers", "1") == 1
    assert verdict.read_bytes() == whole
    # Of three frames.
    assert asked(place) == before + 3


def test_a_job_that_fails_stops_no_other_and_the_worst_is_the_status(place, tmp_path, capsys):
    (place / "some.toml").write_text(
        '[[job]]\nname = "gone"\nscene = "gone.glb"\ncullers = ["none"]\n'
        '[[job]]\nname = "unknown"\nscene = "a/scene.glb"\npath = "a/path.json"\n'
        'cullers = ["nowhere"]\n'
        '[[job]]\nname = "there"\nscene = "a/scene.glb"\npath = "a/path.json"\ncullers = ["none"]\n'
    )
    out = tmp_path / "out"
    assert main(["batch", str(place / "some.toml"), "--out", str(out), "--jobs", "2"]) == 2
    record = json.loads((out / "batch.json").read_text())
    statuses = {job["name"]: (job["exit_status"], bool(job["cullers"])) for job in record["jobs"]}
    assert statuses == {"gone": (2, False), "unknown": (2, False), "there": (0, True)}
    assert "gone.glb" in record["jobs"][0]["error"]
    said = capsys.readouterr().out
    assert "2 runs came to no verdict" in said
    assert "nowhere" in (out / "logs" / "unknown.txt").read_text()
    assert "nowhere" in (out / "batch.md").read_text()


def test_a_batch_that_was_killed_goes_on(place, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "visref", "batch", "batch.toml", "--out", str(out)]
    (place / "kill").touch()
    # The plug-in kills the batch itself as it is first asked; the run that it is in ends with it.
    started = subprocess.Popen([*command, "--workers", "1"], cwd=place)
    (place / "pid").write_text(str(started.pid))
    assert started.wait(600) == -signal.SIGKILL
    assert not (out / "batch.json").exists()
    assert batch(place, out, "--workers", "1") == 1
    for name in ("a", "b"):
        assert differing(place / f"single-{name}", out / "runs" / f"{name}-scene-a-path") == []


def test_a_folder_of_others_is_not_written_to(place, tmp_path, capsys):
    (tmp_path / "mine.txt").touch()
    assert batch(place, tmp_path) == 2
    assert "holds what is no batch" in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["mine.txt"]


@pytest.mark.parametrize(
    ("more", "problem"),
    [(("--jobs", "0"), "--jobs is 0"), (("--workers", "0"), "--workers is 0"),
     (("--dask-scene", "send"), "--dask-scene is given"),
     (("--dask", "nonsense"), "--dask nonsense: this is no address")],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_before_anything_is_run(
    more, problem, place, tmp_path, capsys
):
    pytest.importorskip("distributed")
    assert batch(place, tmp_path / "out", *more) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert problem in line
    assert not (tmp_path / "out" / "runs").exists()


def test_a_wrong_file_is_named_in_a_line(tmp_path, capsys):
    file = tmp_path / "b.toml"
    file.write_text('[[job]]\nscene = "s.glb"\n')
    assert main(["batch", str(file), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"error: {file}: job[0].cullers: it is missing; see docs/cluster.md"
    assert not (tmp_path / "out").exists()
