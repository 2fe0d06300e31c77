"""`--dask` as a user gives it."""

from __future__ import annotations

import os
import sys

import pytest

from tests.cli.test_cli import record, write_scene
from tests.support.same_bytes import differing
from visref.cli.main import main
from visref.cluster import connected

pytestmark = pytest.mark.slow

PLUG_IN = """
import numpy as np
from visref.culler import Culler, DrawnSet

class Leaves(Culler):
    memory = 1

    def prepare(self, scene):
        self.count = scene.object_count
        return scene.object_units()

    def cull(self, camera):
        return DrawnSet(np.arange(1, self.count, dtype=np.int32))
"""


@pytest.fixture(scope="module")
def address():
    pytest.importorskip("distributed")
    with connected("local", 2) as client:
        yield client.scheduler.address


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder to stand in, with a scene, a path of four frames, a recording and a plug-in."""
    write_scene(tmp_path, frames=4)
    record(tmp_path, *[["front", "beside"], ["front"]] * 2)
    (tmp_path / "my_culler.py").write_text(PLUG_IN)
    monkeypatch.chdir(tmp_path)
    return tmp_path


RUN = ("run", "scene.glb", "--path", "path.json", "--culler=frustum", "--culler=my_culler:Leaves")
CHECK = ("check", "scene.glb", "--path", "path.json", "--visible", "drawn.jsonl")


@pytest.mark.parametrize(("command", "scene"), [(RUN, "path"), (CHECK, "send"), (CHECK, "path")])
def test_a_command_leaves_on_a_cluster_what_it_leaves_here(command, scene, address, place):
    assert main([*command, "--out", "here", "--workers", "1"]) == 1
    given = ["--dask", address, "--dask-frames", "1", "--dask-scene", scene]
    assert main([*command, "--out", "there", *given]) == 1
    assert differing(place / "here", place / "there") == []


def test_a_cluster_of_the_command_s_own_leaves_the_same(place):
    pytest.importorskip("distributed")
    assert main([*CHECK, "--out", "here", "--workers", "1"]) == 1
    assert main([*CHECK, "--out", "there", "--dask", "local", "--workers", "1"]) == 1
    assert differing(place / "here", place / "there") == []


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        (("--dask", "local", "--shard", "1/2"), "--dask, with --shard"),
        (("--dask", "tcp://127.0.0.1:1"), "no scheduler answers there"),
        (("--dask", "tcp://127.0.0.1:1", "--workers", "2"), "--workers, with the address"),
        (("--dask", "here"), "this is no address"),
        (("--dask-scene", "send"), "--dask-scene is given, and no --dask"),
        (("--dask-frames", "2"), "--dask-frames is given, and no --dask"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(more, problem, place, capsys):
    pytest.importorskip("distributed")
    assert main([*CHECK, "--out", "out", *more]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert problem in line
    assert not (place / "out").exists()


def test_a_program_is_not_run_on_a_cluster(place, capsys):
    given = ["--command", "/bin/true {scene} {path} {visible}", "--dask", "local"]
    assert main([*RUN, "--out", "out", *given]) == 2
    assert "--dask, with --command" in capsys.readouterr().err


def test_a_stretch_of_no_frames_is_refused(address, place, capsys):
    assert main([*CHECK, "--out", "out", "--dask", address, "--dask-frames", "0"]) == 2
    assert "--dask-frames is 0" in capsys.readouterr().err


def test_a_part_that_ends_each_worker_is_told_in_a_line_with_a_status_of_no_verdict(
    address, place, capsys
):
    # A plug-in lives in a process of its own; this one ends the worker that asks it.
    kills = PLUG_IN.replace(
        "        return DrawnSet",
        "        import os\n        os.kill(os.getppid(), 9)\n        return DrawnSet",
    ).replace("memory = 1", "memory = 0")
    (place / "my_killer.py").write_text(kills)
    given = [*RUN[:-1], "--culler=my_killer:Leaves", "--dask", address, "--dask-frames", "4"]
    assert main([*given, "--out", "out", "--junit", "junit.xml"]) == 70
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("error: frames 0 to 3: each worker that judged this part ended by it")
    assert said.endswith("'my_killer:Leaves' is asked in frame 0")
    assert "each worker that judged this part" in (place / "junit.xml").read_text()
    assert "out" not in os.listdir(place)


def test_without_dask_its_extra_is_named(place, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main([*CHECK, "--out", "out", "--dask", "local"]) == 2
    assert "pip install 'visref[dask]'" in capsys.readouterr().err


def test_a_cluster_without_workers_is_refused_after_a_while(place, capsys, monkeypatch):
    pytest.importorskip("distributed")
    from visref.cluster import running

    monkeypatch.setattr(running, "_FIRST_WORKER_S", 0.5)
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0") as empty:
        address = empty.scheduler_address
        assert main([*CHECK, "--out", "out", "--dask", address]) == 2
    assert "has had no worker for 0.5 s; start some" in capsys.readouterr().err
