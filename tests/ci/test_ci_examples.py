"""The ready files for CI servers: nothing in them is wrong by the servers' own schemas and by a
linter, and their commands do what the files wait for."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import sysconfig
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from tests.cli.test_cli import record, write_scene
from visref.cli.main import _parser, main

EXAMPLES = Path(__file__).parent.parent.parent / "examples" / "ci"
SCHEMAS = {
    "github.yml": ["--builtin-schema", "vendor.github-workflows"],
    "gitlab.yml": ["--builtin-schema", "vendor.gitlab-ci", "--data-transform", "gitlab-ci"],
}
# Of actions of GitHub's own a tag will do, so that who copies the file can read which it is.
ZIZMOR = """
rules:
  unpinned-uses:
    config:
      policies:
        "actions/*": ref-pin
        "*": hash-pin
"""
# The engine that the files wait for: it draws what is visible but for one object in one frame.
ENGINE = '#!/bin/sh\ncp prepared.jsonl "$6"\n'


def text_of(name):
    return (EXAMPLES / name).read_text(encoding="utf-8")


def read(name):
    return YAML(typ="safe").load(text_of(name))


def by_schema(file, name):
    command = [sys.executable, "-m", "check_jsonschema", *SCHEMAS[name], str(file)]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_files_are_valid_by_the_servers_own_schema(name):
    ran = by_schema(EXAMPLES / name, name)
    assert ran.returncode == 0, ran.stdout


@pytest.mark.parametrize(
    ("name", "key"), [("github.yml", "runs-on"), ("github.yml", "steps"), ("gitlab.yml", "script")]
)
def test_the_schemas_would_notice_a_word_that_is_wrong(name, key, tmp_path):
    (tmp_path / name).write_text(text_of(name).replace(f" {key}:", f" x{key}:", 1))
    assert by_schema(tmp_path / name, name).returncode == 1


def linted(folder, text):
    """What zizmor says of a workflow, told nothing but what is in the file."""
    (folder / "zizmor.yml").write_text(ZIZMOR)
    (folder / "workflow.yml").write_text(text)
    program = Path(sysconfig.get_path("scripts")) / "zizmor"
    command = [program, "--offline", "--no-progress", "--config", "zizmor.yml", "workflow.yml"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_the_linter_of_workflows_finds_nothing_in_the_one_for_github(tmp_path):
    ran = linted(tmp_path, text_of("github.yml"))
    assert ran.returncode == 0, ran.stdout + ran.stderr


@pytest.mark.parametrize(
    ("here", "instead", "finding"),
    [
        ("actions/checkout@v6", "somebody/checkout@v6", "unpinned-uses"),
        ("./my_engine", "./my_engine ${{ github.event.pull_request.title }}", "template-injection"),
        ("permissions:\n  contents: read\n", "", "excessive-permissions"),
    ],
)
def test_the_linter_would_notice_what_is_not_safe(here, instead, finding, tmp_path):
    text = text_of("github.yml")
    assert here in text
    ran = linted(tmp_path, text.replace(here, instead, 1))
    assert ran.returncode >= 11  # findings, by how grave the worst is
    assert f"[{finding}]" in ran.stdout


def github_steps():
    return read("github.yml")["jobs"]["check"]["steps"]


def gitlab_lines():
    job = read("gitlab.yml")["check"]
    return [*job["before_script"], *job["script"], *job["after_script"]]


def visref_commands():
    """Every command of visref in the files, as it stands there."""
    lines = [step["run"] for step in github_steps() if "run" in step]
    words = [part.split() for line in [*lines, *gitlab_lines()] for part in re.split(r"\|\|", line)]
    return sorted({" ".join(one[1:]) for one in words if one[0] == "visref"})


def test_both_files_have_the_same_commands_and_visref_understands_them():
    commands = visref_commands()
    assert [command.split()[0] for command in commands] == ["check", "report", "truth"]
    for command in commands:
        asked = command.split()
        assert callable(_parser(asked[0]).parse_args(asked).command)


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A project's folder as the files expect it; the recording forgets one object in its last
    frame. Call it with a line, as a server's shell would run it; its status comes back."""
    write_scene(tmp_path, 4)
    (tmp_path / "path.json").rename(tmp_path / "walk.path.json")
    both = ["front", "beside"]
    record(tmp_path, both, both, both, ["front"])
    (tmp_path / "drawn.jsonl").rename(tmp_path / "prepared.jsonl")
    programs = {
        "my_engine": ENGINE,
        "bin/visref": f'#!/bin/sh\nexec "{sys.executable}" -m visref "$@"\n',
        "bin/python": '#!/bin/sh\n[ "$1 $2 $3" = "-m pip install" ]\n',
    }
    (tmp_path / "bin").mkdir()
    for name, text in programs.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=os.pathsep)

    def run(line):
        words = shlex.split(line)
        if words[0] == "visref" and "||" not in words:  # as a process, but for its start
            return main(words[1:])
        return subprocess.run(["bash", "-e", "-c", line]).returncode

    return run


def convicts(junit):
    """Whether the object that is forgotten is a failed test, and the only one beside the culler's
    verdict."""
    cases = ET.parse(junit).iter("testcase")
    failed = [case.get("name") for case in cases if case.find("failure") is not None]
    return failed == ["drawn.jsonl", "beside, object 2"]


@pytest.mark.parametrize("kept", [False, True])
def test_the_github_workflow_fails_and_leaves_verdict_page_and_annotations(
    kept, checkout, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "step.md"))
    # Where the truth was kept, it is there after the step that restores it.
    if kept:
        (cast,) = (step["run"] for step in github_steps() if "visref truth" in step.get("run", ""))
        assert checkout(cast) == 0
    holds = {
        "success()": lambda failed: not failed,
        "steps.truth.outputs.cache-hit != 'true'": lambda failed: not failed and not kept,
        "${{ !cancelled() }}": lambda failed: True,
    }
    statuses = {}
    for step in github_steps():
        if holds[step.get("if", "success()")](any(statuses.values())) and "run" in step:
            statuses[step["run"].split()[1]] = checkout(step["run"])
    assert statuses == {
        "-m": 0, **({} if kept else {"truth": 0}), "--scene": 0, "check": 1, "report": 1,
    }  # fmt: skip
    assert "::error title=visref%3A drawn.jsonl misses beside::" in capsys.readouterr().out
    assert (tmp_path / "step.md").read_text().count("# visref: ") == 1
    upload = github_steps()[-1]["with"]["path"].split()
    assert [name for name in upload if not (tmp_path / name).exists()] == []
    assert convicts(tmp_path / "junit.xml")
    assert (tmp_path / "page" / "report.html").is_file()


def test_the_gitlab_job_fails_and_leaves_verdict_and_page(checkout, tmp_path):
    job = read("gitlab.yml")["check"]
    assert [checkout(line) for line in job["before_script"]] == [0]
    assert [checkout(line) for line in job["script"]] == [0, 0, 1]
    assert [checkout(line) for line in job["after_script"]] == [1]
    assert [name for name in job["artifacts"]["paths"] if not (tmp_path / name).exists()] == []
    assert convicts(tmp_path / job["artifacts"]["reports"]["junit"])
    # The truth that the cache has kept is not cast again.
    cast = (tmp_path / "truth.parquet").stat().st_mtime_ns
    assert checkout(job["script"][0]) == 0
    assert (tmp_path / "truth.parquet").stat().st_mtime_ns == cast
