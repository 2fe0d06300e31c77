"""How commands speak: to people, to people in a hurry, to programs, to shells."""

from __future__ import annotations

import argparse
import json
import os
import pty
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest

import visref
from tests.cli.test_cli import record, write_scene
from visref.cli.main import COMMANDS, main
from visref.cli.manners import MANNERS, coloured
from visref.cli.terminal import Printer
from visref.doing import doing, watched_by
from visref.registry import CULLERS, SCENES, available

VISREF = Path(sys.executable).parent / "visref"
# Its output is code for a shell.
WITHOUT_JSON = {"completion"}
COLOUR = re.compile(r"\x1b\[[\d;]*m")


@pytest.fixture
def arguments(tmp_path):
    """Of a check that convicts."""
    scene, path = write_scene(tmp_path)
    visible = record(tmp_path, ["front", "beside"], ["front"])
    out = str(tmp_path / "run")
    return ["check", scene, "--path", path, "--visible", visible, "--pictures", "0", "--out", out]


def test_the_version_is_said_alone(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out == f"visref {visref.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["tables", "--out", "x", "--shift", "nan"], "argument --shift: not a number: 'nan'"),
        (["warm", "--jobs", "1_0"], "argument --jobs: not a whole number: '1_0'"),
        (
            ["run", "x", "--out", "y", "--culler", "z", "--time-limit", "soon"],
            "argument --time-limit: not a number: 'soon'",
        ),
    ],
)
def test_a_number_that_is_none_is_told_in_words(arguments, told, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith(told)


def test_quiet_leaves_the_verdict_and_the_status(arguments, capsys):
    assert main([*arguments, "-q"]) == 1
    said = capsys.readouterr()
    heading, row = said.out.splitlines()
    assert heading.startswith("culler")
    assert row.endswith("violation")
    assert said.err == ""
    assert main(["-q", *arguments]) == 1
    assert capsys.readouterr().out == said.out


def test_verbose_says_every_finding_and_what_each_step_took(arguments, capsys):
    assert main(arguments) == 1
    plain = capsys.readouterr()
    assert main([*arguments, "-v"]) == 1
    said = capsys.readouterr()
    verdict = json.loads((Path(arguments[-1]) / "verdict.json").read_text())
    codes = {one["code"] for one in verdict["findings"]}
    assert codes <= set(re.findall(r"^([A-Z_]+):", said.out, re.MULTILINE))
    assert not codes <= set(re.findall(r"^([A-Z_]+):", plain.out, re.MULTILINE))
    assert re.search(r"^reading scene\.glb: \d+\.\d s$", said.err, re.MULTILINE)
    assert plain.err == ""


def test_quiet_and_verbose_exclude_each_other(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*arguments, "-q", "-v"])
    assert stop.value.code == 2


def test_the_last_line_says_where_to_look_next(arguments, capsys):
    main(arguments)
    last = capsys.readouterr().out.splitlines()[-1]
    (command,) = re.findall(r"Next: `visref (.*?)`", last)
    assert command == f"report {arguments[-1]} --out page"


def test_json_of_a_check_is_its_verdict_and_nothing_else(arguments, capsys, monkeypatch):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    assert main([*arguments, "--json"]) == 1
    said = capsys.readouterr()
    assert json.loads(said.out) == json.loads((Path(arguments[-1]) / "verdict.json").read_text())
    # What a CI server obeys is on the other stream.
    assert "::error" in said.err


@pytest.mark.parametrize("command", ["cullers", "scenes"])
def test_listings_speak_json(command, capsys):
    assert main([command, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    group = {"cullers": CULLERS, "scenes": SCENES}[command]
    assert [row["name"] for row in rows] == list(available(group))


def test_scenes_are_listed_with_what_can_be_given_to_them(capsys):
    assert main(["scenes"]) == 0
    said = capsys.readouterr().out
    assert "city:seed=0,scale=1.0,frames=60\n    A city of any size" in said
    assert "Raises" not in said


def test_other_answers_for_programs(arguments, tmp_path, capsys):
    scene, path, out = arguments[1], arguments[3], arguments[-1]
    main(arguments)
    truth = str(tmp_path / "truth.parquet")
    for line, status, key in (
        (["truth", scene, "--path", path, "--out", truth], 0, "visible"),
        (["report", out, "--out", str(tmp_path / "page")], 1, "page"),
        (["report", out, "--tables", str(tmp_path / "tables")], 1, "tables"),
    ):
        capsys.readouterr()
        assert main([*line, "--json"]) == status
        assert json.loads(capsys.readouterr().out)[key]
    assert main(["explain", out, "--frame", "1", "--object", "beside", "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)
    assert one["holds"] is True
    assert Path(one["picture"]).is_file()


@pytest.mark.parametrize("command", ["scenes", "cullers", "completion bash"])
def test_a_listing_that_a_full_disk_takes_has_failed(command):
    with open("/dev/full", "w", encoding="utf-8") as full:
        asked = [VISREF, *command.split()]
        done = subprocess.run(asked, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert "standard output: [Errno 28] No space left on device" in done.stderr
    with subprocess.Popen(asked, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()  # As `head` does, when it has seen enough.
        assert process.wait() == 0


def test_the_demo_says_its_page_and_verdicts_to_programs(tmp_path, capsys, monkeypatch):
    from visref.cli import demo

    drawing = "tests.support.toy_culler:ToyCuller"
    monkeypatch.setattr(demo, "SCENE", "city:scale=0.01,frames=1")
    monkeypatch.setattr(demo, "SIZE", (32, 24))
    monkeypatch.setattr(demo, "CULLERS", (drawing,))
    assert main(["demo", "--out", str(tmp_path / "demo"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert Path(said["page"]).is_file()
    verdict = json.loads((Path(said["run"]) / "verdict.json").read_text())
    assert said["cullers"] == {drawing: verdict["cullers"][drawing]["status"]}


def test_every_command_is_quiet_or_verbose_and_says_json_where_a_program_may_read():
    for name in COMMANDS:
        module = __import__(f"visref.cli.{name}", fromlist=[name])
        parser = argparse.ArgumentParser()
        module.add_arguments(parser)
        options = {option for action in parser._actions for option in action.option_strings}
        subparsers = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
        assert ("--json" in options) == (name not in WITHOUT_JSON) or subparsers, name
        assert not options & {"-q", "-v", "--quiet", "--verbose", "--version"}, name


@pytest.mark.parametrize(
    ("terminal", "environment", "expected"),
    [
        (True, {"TERM": "xterm"}, True),
        (False, {"TERM": "xterm"}, False),
        (True, {"TERM": "dumb"}, False),
        (True, {}, False),
        (True, {"TERM": "xterm", "NO_COLOR": "1"}, False),
        (True, {"TERM": "xterm", "NO_COLOR": ""}, True),
        (False, {"FORCE_COLOR": "1"}, True),
        (True, {"TERM": "xterm", "FORCE_COLOR": "1", "NO_COLOR": "1"}, False),
    ],
)
def test_who_gets_colours(terminal, environment, expected):
    assert coloured(terminal, environment) is expected


def test_a_verdict_has_a_colour_and_no_name_has_one(arguments, capsys, monkeypatch):
    main(arguments)
    plain = capsys.readouterr().out
    monkeypatch.setenv("FORCE_COLOR", "1")
    main(arguments)
    said = capsys.readouterr().out
    assert COLOUR.sub("", said) == plain
    assert re.findall(r"\x1b\[1;31m(.*?)\x1b\[0m", said)[0] == "✕ violation"
    printer = Printer("stdout")
    printer.line("a\x1b[31mname", colour="31", of="a\x1b[31m")
    assert capsys.readouterr().out == "\x1b[1;31ma\\x1b[31m\x1b[0mname\n"


def test_steps_are_shown_to_who_watches_in_this_process_alone():
    seen = []

    def watcher(what, total):
        from contextlib import contextmanager

        @contextmanager
        def shown():
            seen.append((what, total))
            yield lambda done: seen.append(done)

        return shown()

    with doing("unseen") as reach:
        reach(1)
    with watched_by(watcher):
        with doing("seen", 2) as reach:
            reach(1)
        child = os.fork()
        if child == 0:
            with doing("in a copy"):
                os._exit(len(seen))
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 2
    with doing("unseen again"):
        pass
    assert seen == [("seen", 2), 1]


def on_a_terminal(command: list[str], **environment: str) -> str:
    """What a command writes to a terminal on which it runs."""
    ours, theirs = pty.openpty()
    env = {**os.environ, "TERM": "xterm", "COLUMNS": "150", **environment}
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=env)
    os.close(theirs)
    printed = b""
    try:
        while chunk := os.read(ours, 65536):
            printed += chunk
    except OSError:  # so a terminal ends whose other side was closed
        pass
    os.close(ours)
    process.wait()
    return printed.decode(errors="replace")


def test_progress_shows_reading_building_and_judging_on_a_terminal(arguments):
    shown = on_a_terminal([str(VISREF), *arguments])
    for step in ("reading scene.glb", "building embree", "judging"):
        assert step in shown, step
    assert "\x1b[1;31m✕ violation" in shown
    plain = on_a_terminal([str(VISREF), *arguments, "-q"], NO_COLOR="1")
    assert "judging" not in plain
    assert COLOUR.search(plain) is None


def test_help_takes_a_moment():
    """Under 0.3 s of CPU; the best of a few, since others may work here."""
    spent = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([VISREF, "--help"], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        if spent[-1] < 0.3:
            return
    pytest.fail(f"{min(spent):.2f} s")


def completed(line: str, tmp_path: Path) -> list[str]:
    """What visref offers for a command line, as argcomplete's shell code asks it."""
    answer = tmp_path / "answer"
    environment = {
        **os.environ,
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "_ARGCOMPLETE_IFS": "\n",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    subprocess.run([VISREF], env=environment, cwd=tmp_path, capture_output=True, check=False)
    return [word.rstrip() for word in answer.read_text().split("\n") if word]


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("visref che", ["check"]),
        ("visref run city --cull", ["--cull-backfaces", "--culler"]),
        ("visref run city --culler la", ["last-frame-hzb", "lazy-grid"]),
        ("visref run busy", ["busy_street"]),
        ("visref check my", ["my.glb"]),
        ("visref check x --promise e", ["exact"]),
        ("visref completion f", ["fish"]),
    ],
)
def test_completion_offers_what_there_is(line, offered, tmp_path):
    (tmp_path / "my.glb").touch()
    assert sorted(completed(line, tmp_path)) == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_code_for_visref(shell, capsys):
    assert main(["completion", shell]) == 0
    code = capsys.readouterr().out
    assert "_ARGCOMPLETE" in code
    assert re.search(r"\bvisref\b", code)


@pytest.mark.parametrize(
    "shell", [pytest.param(one, marks=pytest.mark.needs(one)) for one in ("bash", "zsh", "fish")]
)
def test_each_shell_itself_parses_its_code(shell, capsys, tmp_path):
    assert main(["completion", shell]) == 0
    (tmp_path / "code").write_text(capsys.readouterr().out)
    subprocess.run([shell, "-n", tmp_path / "code"], check=True, capture_output=True)
    # And says so of code that is none.
    (tmp_path / "code").write_text(")\n")
    broken = subprocess.run([shell, "-n", tmp_path / "code"], check=False, capture_output=True)
    assert broken.returncode != 0


def test_manners_are_those_of_the_command_that_runs(arguments):
    main([*arguments, "--json", "-q"])
    assert (MANNERS.json, MANNERS.quiet) == (True, True)
    main(["cullers", "-v"])
    assert (MANNERS.json, MANNERS.quiet, MANNERS.verbose) == (False, False, True)
