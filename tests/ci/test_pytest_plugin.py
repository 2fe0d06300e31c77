"""The plug-in as its users have it: pytest in a process of its own, on tests like theirs."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.test_cli import record, write_scene
from tests.house.test_light import HEAVY

pytest_plugins = ["pytester"]

# `pytester` gives each run a home of its own, in which every kernel would be compiled anew.
CACHE = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")

# Draws front and beside, both of which show; front alone; nothing that there is; with an error.
CULLERS = """
import numpy as np
from visref import Culler, DrawnSet, Promise

class Right(Culler):
    name = "right"
    summary = ""
    def prepare(self, scene):
        self.ids = [i for i, name in enumerate(scene.names) if name in self.names]
        return scene.object_units()
    names = ("front", "beside")
    def cull(self, camera):
        return DrawnSet(np.array(self.ids))

class Forgets(Right):
    name = "forgets"
    names = ("front",)

class PromisesNothing(Forgets):
    name = "promises-nothing"
    promise = Promise.APPROXIMATE

class Raises(Right):
    name = "raises"
    def cull(self, camera):
        raise ValueError("no depth buffer")

class Greedy(Right):
    name = "greedy"
    promise = Promise.EXACT
    names = ("front", "beside", "behind")
"""

HEADER = """
import pytest
import cullers
pytestmark = pytest.mark.visref_scene("scene.glb", path="path.json")
"""


@pytest.fixture
def project(pytester, monkeypatch):
    """A folder of somebody's with a scene, a path, and cullers."""
    for name in ("PYTEST_ADDOPTS", "PYTEST_XDIST_WORKER", "PYTEST_XDIST_WORKER_COUNT"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", CACHE)
    write_scene(pytester.path)
    pytester.makepyfile(cullers=CULLERS)
    pytester.makeini("[pytest]\naddopts = --strict-markers -p no:cacheprovider")
    return pytester


@pytest.mark.slow
def test_what_keeps_its_promise_passes_in_every_way_of_asking(project):
    good = record(project.path, ["front", "beside"], ["front", "beside"])
    project.makepyfile(
        HEADER
        + f"""
def test_object(visref_judge):
    judged = visref_judge(cullers.Right())
    judged.assert_no_violation()
    assert judged
    assert judged.row.counts.visible == 4

def test_class(visref_judge):
    assert visref_judge(cullers.Right)

def test_spec_of_ours(visref_judge):
    assert visref_judge("frustum").status == "no_violation_found"

def test_spec_of_theirs(visref_judge):
    visref_judge("cullers:Right").assert_no_violation()

def test_visible_sets(visref_judge):
    visref_judge(visible={good!r}).assert_no_violation()

@pytest.mark.visref_scene("city:scale=0.02,frames=1")
def test_the_nearest_marker_counts_and_a_generated_scene_has_its_path(visref_judge, visref_scene):
    assert visref_scene.inputs.scene.object_count > 100
    assert visref_judge("none")

def test_a_call_chooses_too(visref_judge, visref_scene):
    visref_scene("scene.glb", path="path.json", frames="0:1")
    assert visref_judge("none").row.frames == 1

def test_policy(visref_judge, tmp_path):
    policy = tmp_path / "visref.toml"
    policy.write_text("min_samples = 10000")
    judged = visref_judge(cullers.Forgets(), policy=policy)
    assert judged
    assert "accepted by the policy: 2 small" in judged.message

def test_two_in_one_test(visref_judge):
    assert visref_judge("none").folder != visref_judge("frustum").folder
"""
    )
    project.runpytest_subprocess().assert_outcomes(passed=9)


@pytest.mark.slow
def test_each_kind_of_failure_is_told_with_object_frame_pixel_and_command(project):
    bad = record(project.path, ["front", "beside"], ["front"])
    project.makepyfile(
        HEADER
        + f"""
def test_asserted(visref_judge):
    visref_judge(cullers.Forgets()).assert_no_violation()

def test_plain(visref_judge):
    assert visref_judge(visible={bad!r})

def test_hidden(visref_judge):
    visref_judge(cullers.Greedy()).assert_no_violation()

def test_raises(visref_judge):
    visref_judge(cullers.Raises()).assert_no_violation()

def test_promises_nothing(visref_judge):
    visref_judge(cullers.PromisesNothing()).assert_no_violation()

@pytest.mark.visref_scene("nowhere.glb", path="path.json")
def test_bad_input(visref_judge):
    visref_judge("none")

def test_no_such_culler(visref_judge):
    visref_judge("frustrum")

def test_nothing_given(visref_judge):
    visref_judge()
"""
    )
    project.makepyfile(
        test_unmarked="""
def test_no_scene(visref_judge):
    visref_judge("none")
"""
    )
    ran = project.runpytest_subprocess()
    ran.assert_outcomes(failed=9)
    told = re.split(r"^_{3,} (\w+) _{3,}$", "\n".join(ran.outlines), flags=re.MULTILINE)
    of = dict(zip(told[1::2], told[2::2], strict=True))
    asserted = of["test_asserted"]
    assert "forgets: Violation. Of 4 visible object-frames, 2 were missed" in asserted
    assert "beside, missed: 304 samples over 2 frames" in asserted
    assert "witness: frame 0, pixel (" in asserted
    assert "explain it: visref explain " in asserted
    # Once, and without this module's own code around it.
    assert asserted.count("explain it") == 1
    assert "raise AssertionError" not in asserted
    plain = of["test_plain"]
    assert "assert <visref: drawn.jsonl: Violation, misses 'beside'>" in plain
    assert "visref ---" in plain
    assert "beside, missed: 152 samples over 1 frame" in plain
    assert "witness: frame 1, pixel (" in plain
    assert plain.count("explain it: visref explain ") == 1
    assert "hidden at all" in of["test_hidden"]
    assert "raises: Inconclusive" in of["test_raises"]
    assert "CULLER_FAILED: ValueError: no depth buffer" in of["test_raises"]
    assert "It promises nothing" in of["test_promises_nothing"]
    assert "nowhere.glb: there is no such file" in of["test_bad_input"]
    assert "did you mean 'frustum'?" in of["test_no_such_culler"]
    assert "give one of: a culler, recording=, visible=" in of["test_nothing_given"]
    assert "mark the test with @pytest.mark.visref_scene(" in of["test_no_scene"]


@pytest.mark.slow
def test_the_command_of_a_message_replays_the_witness(project):
    project.makepyfile(
        HEADER
        + """
def test_it(visref_judge):
    visref_judge(cullers.Forgets()).assert_no_violation()
"""
    )
    # On a CI server pytest tells the whole message again in its summary.
    ran = project.runpytest_subprocess("-rN")
    (line,) = [line for line in ran.outlines if "explain it" in line]
    words = line.partition("visref ")[2].split()
    command = [sys.executable, "-m", "visref", *words]
    explained = subprocess.run(command, cwd=project.path, capture_output=True, text=True)
    assert explained.returncode == 0, explained.stderr
    assert "beside" in explained.stdout


@pytest.mark.slow
def test_workers_of_xdist_each_judge_and_report(project):
    project.makepyfile(
        HEADER
        + """
@pytest.mark.parametrize("spec", ["none", "frustum", "cullers:Forgets"])
def test_it(visref_judge, spec):
    assert visref_judge(spec)
"""
    )
    ran = project.runpytest_subprocess("-n", "2")
    ran.assert_outcomes(passed=2, failed=1)
    ran.stdout.fnmatch_lines(["*visref*", "cullers:Forgets: Violation.*", "*beside, missed*"])


@pytest.mark.slow
def test_a_recording_brings_its_own_cameras(project):
    scene = json.loads((project.path / "path.json").read_text())
    camera = {key: scene[key] for key in ("width", "height", "near", "far", "yfov")}
    lines = [{"format": "visref-recording", "version": 1, **camera}]
    drawn = {"visible": ["front", "beside"]}
    lines += [{"frame": at, **frame, **drawn} for at, frame in enumerate(scene["frames"])]
    (project.path / "r.jsonl").write_text("\n".join(map(json.dumps, lines)) + "\n")
    project.makepyfile(
        """
import pytest

@pytest.mark.visref_scene("scene.glb")
def test_it(visref_judge):
    assert visref_judge(recording="r.jsonl").row.frames == 2

@pytest.mark.visref_scene("scene.glb", path="path.json")
def test_two_paths(visref_judge):
    visref_judge(recording="r.jsonl")
"""
    )
    ran = project.runpytest_subprocess()
    ran.assert_outcomes(passed=1, failed=1)
    ran.stdout.fnmatch_lines(["*a recording has its cameras; leave the scene's path out*"])


STARTED = """
import json, sys
import pytest

class Tells:
    def pytest_sessionfinish(self):
        print("MODULES", json.dumps(sorted(sys.modules)))

raise SystemExit(pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[1:]], plugins=[Tells()]))
"""


def test_who_does_not_use_it_imports_nothing_for_it(project):
    project.makepyfile(test_other="def test_it(): pass")
    command = [sys.executable, "-c", STARTED, "-p", "no:dash", "-p", "no:hypothesispytest"]
    ran = subprocess.run(command, cwd=project.path, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    (line,) = [line for line in ran.stdout.splitlines() if "MODULES" in line]
    modules = json.loads(line.partition("MODULES")[2])
    assert {name for name in modules if name.split(".")[0] == "visref"} == {
        "visref", "visref.pytest_plugin",
    }  # fmt: skip
    assert {name.partition(".")[0] for name in modules} & (HEAVY | {"numpy"}) == set()
