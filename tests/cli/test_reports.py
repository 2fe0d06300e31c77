"""What `run` and `check` write for CI servers: whatever ends them, and nowhere that it hurts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pytest

from tests.cli.test_cli import record, write_scene
from visref.cli import check
from visref.cli.main import main
from visref.cli.reports import STEP_SUMMARY_BYTES, wanted_of
from visref.errors import NothingToJudge
from visref.report.annotations import Annotation, annotation_lines, annotations_of
from visref.report.junit import REST, junit_of_failure, junit_xml
from visref.report.markdown import markdown_of_failure, markdown_summary
from visref.run_folder.read import read_run

GOOD = ["front", "beside"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a scene, a path, and a recording that forgets an object in its second frame."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path)
    record(tmp_path, GOOD, ["front"])
    return tmp_path


@pytest.fixture
def github(folder, monkeypatch):
    """The file that GitHub keeps for a step's summary, with something of an earlier command."""
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(folder / "step.md"))
    (folder / "step.md").write_text("earlier\n")
    return folder / "step.md"


def judge(*more, path="path.json", visible="drawn.jsonl"):
    given = ["check", "scene.glb", "--path", path, "--visible", visible, "--out", "run"]
    return main([*given, "--pictures", "0", *more])


def commands(capsys):
    return [line for line in capsys.readouterr().out.splitlines() if line.startswith("::")]


def cases(file):
    root = ET.parse(file).getroot()
    found = {}
    for case in root.iter("testcase"):
        outcome = next((one for one in case if one.tag != "system-out"), None)
        found[case.get("name")] = (
            ("passed", "", "")
            if outcome is None
            else (outcome.tag, outcome.get("type"), outcome.get("message"))
        )
    for suite in root.iter("testsuite"):
        for total, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
            assert int(suite.get(total)) == len(list(suite.iter(tag)))
    return found


def test_a_violation_is_a_failed_case_of_its_object_and_the_rest_is_one_that_passed(folder):
    assert judge("--junit", "j.xml", "--summary", "s.md") == 1
    found = cases("j.xml")
    assert set(found) == {"drawn.jsonl", "beside, object 2", REST}
    assert found["drawn.jsonl"][:2] == ("failure", "violation")
    assert found["beside, object 2"] == (
        "failure", "violation", "missed: 152 samples over 1 frame",
    )  # fmt: skip
    assert found[REST][0] == "passed"
    (text,) = [e.text for e in ET.parse("j.xml").iter("failure") if e.text]
    assert "witness: frame 1, pixel (" in text
    assert "explain it: visref explain run --frame 1 --object 2" in text
    summary = Path("s.md").read_text()
    assert summary.startswith("# visref: ✕ Violation\n")
    assert "visref explain run --frame 1 --object 2" in summary


def test_the_files_are_those_of_visref_report_but_for_where_commands_start(folder):
    judge("--junit", "j.xml", "--summary", "s.md")
    assert main(["report", "run", "--out", "."]) == 1
    assert Path("junit.xml").read_bytes() == Path("j.xml").read_bytes()
    assert Path("summary.md").read_bytes() == Path("s.md").read_bytes()


def test_a_pass_and_what_promises_nothing_are_told_apart(folder):
    record(folder, GOOD, GOOD)
    assert judge("--junit", "j.xml") == 0
    assert {name: case[0] for name, case in cases("j.xml").items()} == {
        "drawn.jsonl": "passed", REST: "passed",
    }  # fmt: skip
    assert judge("--junit", "j.xml", "--promise", "approximate") == 0
    assert {name: case[:2] for name, case in cases("j.xml").items()} == {
        "drawn.jsonl": ("skipped", "measured")
    }


def test_what_a_policy_accepts_is_skipped_as_what_it_is(folder, capsys):
    Path("visref.toml").write_text("min_samples = 1000\n")
    assert judge("--junit", "j.xml", "--annotate", "--policy", "visref.toml") == 0
    found = cases("j.xml")
    assert found["beside, object 2"] == (
        "skipped", "accepted", "accepted by the policy: 1 small",
    )  # fmt: skip
    assert found["drawn.jsonl"][0] == found[REST][0] == "passed"
    (notice,) = commands(capsys)
    assert notice.startswith("::notice title=visref%3A drawn.jsonl%2C accepted::1 small")


def raising(error):
    def raises(*_, **__):
        raise error

    return raises


@pytest.mark.parametrize(
    ("error", "status", "kind", "said"),
    [
        (NothingToJudge("no context"), 3, "nothing-judged", "could be judged: no context"),
        (KeyError("x\ny"), 70, "fault", "this is a bug in it: KeyError: 'x\\ny'"),
        (KeyboardInterrupt(), 130, "interrupted", "interrupted; nothing was written"),
        (OSError("disk full"), 2, "bad-input", "error: disk full"),
    ],
)
def test_whatever_ends_a_command_is_an_error_case_with_its_line(
    error, status, kind, said, github, monkeypatch, capsys
):
    monkeypatch.setattr(check, "inputs_of", raising(error))
    assert judge("--junit", "j.xml") == status
    ((name, case),) = cases("j.xml").items()
    assert (name, *case[:2]) == ("visref check", "error", kind)
    assert said in case[2]
    (command,) = commands(capsys)
    assert command.startswith("::error title=visref check::")
    assert said in command
    assert github.read_text().startswith("earlier\n\n# visref: ✕ no verdict\n\n`visref check`: ")


@pytest.mark.parametrize("wrong", [["--pth", "x"], ["--pictures", "few"], ["--frames"]])
def test_arguments_that_are_not_understood_are_bad_input_there_too(wrong, github, capsys):
    with pytest.raises(SystemExit) as left:
        judge("--junit", "j.xml", *wrong)
    assert left.value.code == 2
    assert cases("j.xml")["visref check"][:2] == ("error", "bad-input")
    assert len(commands(capsys)) == 1
    assert "no verdict" in github.read_text()
    with pytest.raises(SystemExit):
        judge("--no-annotate", "--no-summary", "--junit")
    # What is not understood asks for nothing.
    assert len(commands(capsys)) == 1


def test_bad_input_is_told_in_its_one_line(folder, capsys):
    assert judge("--junit", "j.xml", "--summary", "s.md", path="none.json") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert cases("j.xml")["visref check"] == ("error", "bad-input", line)
    assert "none.json" in Path("s.md").read_text()
    assert not Path("run").exists()


def test_a_library_that_cannot_be_imported_leaves_no_report_and_says_so(folder):
    Path("lib").mkdir()
    Path("lib/numba.py").write_text("raise RuntimeError('no locator')")
    program = "import sys; sys.path.insert(0, 'lib')\nfrom visref.cli.entry import main\n"
    given = ["check", "scene.glb", "--path", "path.json", "--visible", "drawn.jsonl"]
    command = [sys.executable, "-c", f"{program}sys.exit(main())", *given, "--out", "run"]
    ran = subprocess.run([*command, "--junit", "j.xml"], capture_output=True, text=True)
    assert ran.returncode == 70
    assert ran.stderr.splitlines()[-1] == "no report was written: RuntimeError: no locator"
    assert not Path("j.xml").exists()


def test_a_culler_that_ends_the_process_leaves_a_report_of_it(folder):
    Path("mine.py").write_text(
        "import os\nfrom visref import Culler\n"
        "class Ends(Culler):\n    name, summary = 'ends', ''\n"
        "    def prepare(self, scene): os._exit(0)\n    def cull(self, camera): pass\n"
    )
    command = [sys.executable, "-m", "visref", "run", "scene.glb", "--path", "path.json"]
    command += ["--culler", "mine:Ends", "--in-process", "--out", "run", "--junit", "j.xml"]
    ran = subprocess.run(command, capture_output=True, text=True)
    assert ran.returncode == 70
    case = cases("j.xml")["visref run"]
    assert case == ("error", "fault", "the process ended with status 0 before there was a verdict")


FLAGS = pytest.mark.parametrize("flag", ["--junit", "--summary"])


@FLAGS
@pytest.mark.parametrize(
    "file", ["scene.glb", "path.json", "drawn.jsonl", "visref.toml", "notes.txt", "link"]
)
def test_no_report_replaces_an_input_or_what_is_no_report(flag, file, folder, capsys):
    Path("visref.toml").write_text("# visref.toml\n")
    Path("notes.txt").write_text("mine")
    Path("link").symlink_to("drawn.jsonl")
    before = Path(file).read_bytes()
    assert judge(flag, file, "--policy", "visref.toml") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert file in line
    assert Path(file).read_bytes() == before
    assert not Path("run").exists()


@FLAGS
@pytest.mark.parametrize(
    "place", ["run", "run/junit.xml", "w.toml", ".", "folder", "file/x", "/dev/full"]
)
def test_no_report_goes_where_it_cannot_or_where_something_else_goes(flag, place, folder, capsys):
    Path("folder").mkdir()
    Path("file").write_text("")
    there = sorted(path.name for path in folder.iterdir())
    assert judge(flag, place, "--write-waivers", "w.toml") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert f"{place}: cannot write here: " in line
    assert sorted(path.name for path in folder.iterdir()) == there


def test_a_read_only_folder_is_said_before_anything_is_judged(folder, capsys):
    if os.geteuid() == 0:
        # Root writes anywhere but where nobody can.
        place = "/proc/j.xml"
    else:
        Path("closed").mkdir(mode=0o500)
        place = "closed/j.xml"
    assert judge("--junit", place) == 2
    assert f"error: {place}: cannot write here" in capsys.readouterr().err
    assert not Path("run").exists()


def test_two_reports_in_one_file_are_refused(folder, capsys):
    assert judge("--junit", "same", "--summary", "./same") == 2
    assert "--junit and --summary are the same file" in capsys.readouterr().err
    assert not Path("same").exists()


def test_one_report_that_is_refused_costs_the_other_nothing(folder, capsys):
    Path("folder").mkdir()
    assert judge("--junit", "folder", "--summary", "s.md") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "it is a folder" in line
    assert "it is a folder" in Path("s.md").read_text()


def test_reports_replace_earlier_ones_and_make_their_folder(folder):
    for path, status in (("none.json", 2), ("path.json", 1), ("none.json", 2)):
        assert judge("--junit", "new/j.xml", "--summary", "new/s.md", path=path) == status
        assert len(cases("new/j.xml")) == (1 if status == 2 else 3)
        assert ("no verdict" in Path("new/s.md").read_text()) == (status == 2)
    assert sorted(os.listdir("new")) == ["j.xml", "s.md"]


def test_without_a_flag_there_is_nothing_elsewhere_and_all_on_github(folder, capsys, monkeypatch):
    step = folder / "step.md"
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(step))
    for value in ("", "false"):
        monkeypatch.setenv("GITHUB_ACTIONS", value)
        assert judge() == 1
        assert commands(capsys) == []
        assert not step.exists()
    assert judge("--annotate") == 1
    (asked,) = commands(capsys)
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    assert judge() == 1
    assert commands(capsys) == [asked]
    assert step.read_text().count("# visref: ✕ Violation") == 1
    before = step.read_text()
    assert judge("--no-annotate", "--no-summary") == 1
    assert commands(capsys) == []
    assert step.read_text() == before
    # In a file of one's own, it is not in the job's.
    assert judge("--summary", "s.md") == 1
    assert step.read_text() == before
    assert Path("s.md").read_text() == before
    # Named by its own name, it is still added to.
    assert judge("--summary", str(step)) == 1
    assert step.read_text() == f"{before}\n{before}"


def test_the_jobs_summary_that_cannot_be_written_costs_no_status(github, capsys, monkeypatch):
    github.unlink()
    github.mkdir()
    assert judge() == 1
    assert "the job's summary was not written" in capsys.readouterr().err


def test_the_jobs_summary_stays_within_what_github_shows(github):
    github.write_text("x" * (STEP_SUMMARY_BYTES - 400) + "\n")
    before = github.read_text()
    assert judge() == 1
    text = github.read_text()
    assert text.startswith(f"{before}\n# visref: ✕ Violation\n")
    assert text.endswith("the rest is left out.*\n")
    assert len(text.encode()) <= STEP_SUMMARY_BYTES
    for _ in range(9):
        assert judge() == 1
        assert github.read_text().startswith(text)
        assert len(github.read_bytes()) <= STEP_SUMMARY_BYTES


def test_summary_and_no_summary_exclude_each_other(folder):
    with pytest.raises(SystemExit) as left:
        judge("--summary", "s.md", "--no-summary")
    assert left.value.code == 2


def test_a_run_folder_of_names_that_speak_to_the_runner_annotates_them_as_text(folder, capsys):
    lines = annotation_lines(
        [Annotation("error", "a:b,c%\r\nd", "50 % of\r\n::error::x\x1b[0m ##[error]y" + "z" * 9000)]
    )
    (line,) = lines
    assert line.startswith(
        r"::error title=a%3Ab%2Cc%25\r\nd::50 %25 of\r\n::error::x\x1b[0m \x23#[error]yzz"
    )
    assert "\n" not in line
    assert len(line) < 2200


def test_at_most_ten_of_each_kind_are_annotated_and_the_last_says_how_many_more():
    many = [Annotation("error", f"e{i}", "m") for i in range(1234)]
    many += [Annotation("warning", f"w{i}", "m") for i in range(10)]
    lines = annotation_lines(many)
    assert [sum(line.startswith(f"::{level} ") for line in lines) for level in
            ("error", "warning", "notice")] == [10, 10, 0]  # fmt: skip
    assert lines[8].startswith("::error title=e8::")
    assert "… and 1,225 more" in lines[9]
    assert lines[19].startswith("::warning title=w9::")


def test_a_culler_with_many_misses_hides_no_others(folder):
    names = [f"--culler=mine:C{i}" for i in range(3)]
    Path("mine.py").write_text(
        "import numpy as np\nfrom visref import Culler, DrawnSet\n"
        + "".join(
            f"class C{i}(Culler):\n    name, summary = 'c', ''\n"
            "    def prepare(self, scene): return scene.object_units()\n"
            f"    def cull(self, camera): return DrawnSet(np.arange({i}))\n"
            for i in range(3)
        )
    )
    ran = ["run", "scene.glb", "--path", "path.json", *names, "--out", "run", "--pictures", "0"]
    assert main(ran) == 1
    titles = [one.title for one in annotations_of(read_run(Path("run")), Path())]
    # The worst of each in turn, and then the next of the first.
    misses = [("C0", "beside"), ("C1", "beside"), ("C2", "beside"), ("C0", "front")]
    assert titles == [f"visref: mine:{culler} misses {name}" for culler, name in misses]


def test_causes_are_said_grouped_and_by_object(folder):
    judge()
    run = read_run(Path("run"))
    (name,) = run.cullers
    other = {"cause": "last-view", "text": "the frustum of the frame before"}
    cause = {"cause": "one-frame-late", "text": "answered one frame late", "alternatives": [other],
             "misses": 41, "examined": 57, "objects": 3, "score": 0.9}  # fmt: skip
    verdict = replace(run.verdict.cullers[name], causes=(cause,))
    rows = run.objects.to_pylist()
    for row in rows:
        if row["kind"] == "confirmed":
            row["cause"] = "one-frame-late"
    objects = pa.Table.from_pylist(rows, schema=run.objects.schema)
    told = replace(run, objects=objects, verdict=replace(run.verdict, cullers={name: verdict}))
    grouped = (
        "41 of 57 misses: answered one frame late, or: the frustum of the frame before (3 objects)"
    )
    markdown = markdown_summary([told], [], Path())
    assert f"- {grouped}" in markdown
    assert "depth 9): answered one frame late" in markdown
    junit = junit_xml([told], Path())
    assert grouped in junit
    assert "\ncause: answered one frame late\n" in junit
    (error,) = annotations_of(told, Path())
    assert "; cause: answered one frame late; visref explain" in error.message
    for text in (junit_xml([run], Path()), markdown_summary([run], [], Path())):
        assert "cause:" not in text
        assert "Why " not in text


def test_what_is_asked_for_hangs_on_the_arguments_and_on_github_alone():
    class Given:
        junit = summary = annotate = None
        no_summary = False

    assert wanted_of(Given, {}).nothing
    assert wanted_of(Given, {"GITHUB_STEP_SUMMARY": "s"}).nothing
    assert wanted_of(Given, {"GITHUB_ACTIONS": "true"}).annotate
    assert wanted_of(Given, {"GITHUB_ACTIONS": "true", "GITHUB_STEP_SUMMARY": "s"}).step == Path(
        "s"
    )


def test_the_files_of_a_failure_are_shown_as_text():
    line = "bad: </error> ]]> \x07 `code` ::error::x"
    (error,) = ET.fromstring(junit_of_failure("visref run", "fault", line).encode()).iter("error")
    assert error.get("message") == line.replace("\x07", r"\x07")
    text = markdown_of_failure("run", line)
    assert r"\</error\>" in text
    assert "\x07" not in text


def test_a_status_is_a_verdicts_though_the_report_breaks_down(folder, monkeypatch, capsys):
    from visref.report import junit

    monkeypatch.setattr(junit, "junit_xml", raising(RuntimeError("in the report")))
    assert judge("--junit", "j.xml") == 70
    assert json.loads(Path("run/verdict.json").read_text())["exit_status"] == 1
    assert "in the report" in cases("j.xml")["visref check"][2]
