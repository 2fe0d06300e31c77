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


def github_jobs(shard):
    """The steps of each job, for one shard."""
    for name, job in read("github.yml")["jobs"].items():
        commands = [
            {**step, "run": step["run"].replace("${{ matrix.shard }}", str(shard))}
            for step in job["steps"]
            if "run" in step
        ]
        yield name, commands


def gitlab_jobs(shard):
    """The lines of each job, for one shard: those before and in its script, and those after it."""
    text = text_of("gitlab.yml").replace("$CI_NODE_INDEX", str(shard))
    jobs = YAML(typ="safe").load(text.replace("$CI_NODE_TOTAL", "4"))
    for name in jobs["stages"]:
        script = [*jobs["default"]["before_script"], *jobs[name]["script"]]
        yield name, script, jobs[name].get("after_script", [])


def visref_commands():
    """Every command of visref in the files, as it stands there."""
    lines = [step["run"] for _, steps in github_jobs(1) for step in steps]
    lines += [line for _, script, after in gitlab_jobs(1) for line in [*script, *after]]
    words = [part.split() for line in lines for part in re.split(r"\|\|", line)]
    return sorted({" ".join(one[1:]) for one in words if one[0] == "visref"})


def test_visref_understands_the_commands_of_both_files():
    commands = visref_commands()
    # GitHub's has a summary, which is left to the whole.
    assert [command.split()[0] for command in commands] == [
        "check", "check", "merge", "report", "truth",
    ]  # fmt: skip
    for command in commands:
        asked = command.split()
        assert callable(_parser(asked[0]).parse_args(asked).command)


def test_what_one_job_keeps_the_next_one_takes_by_the_same_name():
    jobs = read("github.yml")["jobs"]
    shards = jobs["check"]["strategy"]["matrix"]["shard"]
    keeps, takes = (
        {
            name: [step["with"] for step in job["steps"] if kind in step.get("uses", "")]
            for name, job in jobs.items()
        }
        for kind in ("actions/upload-artifact", "actions/download-artifact")
    )
    assert keeps["record"][0]["name"] == takes["check"][0]["name"]
    assert keeps["check"][0]["name"] == keeps["check"][0]["path"] == "part-${{ matrix.shard }}"
    assert takes["verdict"] == [{"pattern": "part-*"}]
    (merge,) = (one for one in visref_commands() if one.startswith("merge"))
    assert merge.split()[1:-2] == [f"part-{shard}" for shard in shards]
    assert read("gitlab.yml")["check"]["parallel"] == len(shards)


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
        (cast,) = (one for one in visref_commands() if one.startswith("truth"))
        assert checkout(f"visref {cast}") == 0
    holds = {
        "success()": lambda failed: not failed,
        "steps.truth.outputs.cache-hit != 'true'": lambda failed: not failed and not kept,
        "${{ !cancelled() }}": lambda failed: True,
    }
    # The jobs of a server's machines all work in this folder: what is handed on is there.
    every = [next(github_jobs(1))]
    every += [job for shard in (1, 2, 3, 4) for job in github_jobs(shard) if job[0] == "check"]
    every += [job for job in github_jobs(1) if job[0] == "verdict"]
    found = []
    for name, steps in every:
        statuses = {}
        for step in steps:
            if holds[step.get("if", "success()")](any(statuses.values())):
                statuses[step["run"].split()[1]] = checkout(step["run"])
        found.append((name, {command: status for command, status in statuses.items() if status}))
    assert found == [
        ("record", {}), ("check", {}), ("check", {}), ("check", {}), ("check", {"check": 1}),
        ("verdict", {"merge": 1, "report": 1}),
    ]  # fmt: skip
    assert "::error title=visref%3A drawn.jsonl misses beside::" in capsys.readouterr().out
    assert (tmp_path / "step.md").read_text().count("# visref: ") == 1
    assert convicts(tmp_path / "page" / "junit.xml")
    assert (tmp_path / "page" / "report.html").is_file()


def test_the_gitlab_pipeline_fails_and_leaves_verdict_and_page(checkout, tmp_path):
    every = {
        (name, shard): (script, after)
        for shard in (1, 2, 3, 4)
        for name, script, after in gitlab_jobs(shard)
    }
    statuses = {}
    for name, shards in (("record", [1]), ("check", [1, 2, 3, 4]), ("verdict", [1])):
        for shard in shards:
            script, after = every[name, shard]
            statuses[name, shard] = [checkout(line) for line in script]
            statuses[name, shard] += [checkout(line) for line in after]
    assert statuses == {
        ("record", 1): [0, 0, 0], ("check", 1): [0, 0], ("check", 2): [0, 0], ("check", 3): [0, 0],
        ("check", 4): [0, 1], ("verdict", 1): [0, 1, 1],
    }  # fmt: skip
    job = read("gitlab.yml")["verdict"]["artifacts"]
    assert [name for name in job["paths"] if not (tmp_path / name).exists()] == []
    assert convicts(tmp_path / job["reports"]["junit"])
    # The truth that the cache has kept is not cast again.
    cast = (tmp_path / "truth.parquet").stat().st_mtime_ns
    assert checkout(read("gitlab.yml")["record"]["script"][0]) == 0
    assert (tmp_path / "truth.parquet").stat().st_mtime_ns == cast
