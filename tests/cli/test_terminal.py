"""What is printed: names that speak to terminals and CI servers, encodings that lack characters,
and outputs that nobody can write to."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import visref
from tests.cli.test_cli import record, write_scene
from visref.cli.main import main
from visref.cli.terminal import ERRORS, OUT, Printer
from visref.wording import shown

# A name for each thing that must not be obeyed. They are visible objects that a recording misses.
NAMES = [
    "annotates\n::error file=x.py::forged",
    "\n  ::error::forged after space",
    "::warning::forged",
    "azure\r##vso[task.complete result=Succeeded]",
    "##[error]forged",
    "clears\x1b[2J\x1b[31m\x07\x08",
    "c1\x9b31m\x85",
    "bidi\u202egnp.\u202c \u2066\u2069 \u200e\u200f\u061c",
    "lines\u2028two\u2029three",
    "zero\u200bwidth\u2060\ufeff",
    "`code` | cell <b>html</b> [link](x) $x$",
    "שלום",
    "\x0b\x0c\x1c\x1d tabs\t",
]
# Code points that terminals obey or nobody sees, written down here and not asked of a library.
UNSEEN = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff"
    "\ud800-\udfff\ufff9-\uffff]"
)


def obeyed(text: str) -> list[str]:
    """The lines in which a CI server finds a command, and those with characters that are obeyed."""
    return [
        line
        for line in re.split("\r\n|\r|\n", text)
        if line.lstrip().startswith("::")
        or "##[" in line
        or "##vso[" in line
        or UNSEEN.search(line)
    ]


def test_the_check_of_these_tests_sees_what_it_is_for():
    assert obeyed("a\n::error::b") == ["::error::b"]
    seen = [name for name in NAMES if obeyed(name)]
    assert seen == [name for name in NAMES if name not in ("שלום", NAMES[10])]


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A scene whose objects have these names, all in view, and a recording that misses them."""
    folder = tmp_path_factory.mktemp("hostile")
    _, path = write_scene(folder)
    scene = trimesh.Scene()
    for index in range(len(NAMES)):
        box = trimesh.creation.box((0.3, 0.3, 0.3))
        box.apply_translation((0.5 * index - 3.0, 0, 0))
        scene.add_geometry(box, node_name=f"NAME{index:02}", geom_name=f"NAME{index:02}")
    data = scene.export(file_type="glb")
    # The names go into the JSON chunk, whose length is given in the header.
    length = int.from_bytes(data[12:16], "little")
    text = data[20 : 20 + length].decode()
    for index, name in enumerate(NAMES):
        text = text.replace(f'"NAME{index:02}"', json.dumps(name))
    chunk = text.encode()
    chunk += b" " * (-len(chunk) % 4)
    rest = data[20 + length :]
    head = b"glTF" + np.array([2, 20 + len(chunk) + len(rest), len(chunk)], "<u4").tobytes()
    (folder / "scene.glb").write_bytes(head + data[16:20] + chunk + rest)
    return folder, str(folder / "scene.glb"), path, record(folder, [], [])


def visref_run(*arguments: str, **kwargs) -> subprocess.CompletedProcess[bytes]:
    environment = {**os.environ, **kwargs.pop("env", {})}
    return subprocess.run(
        [sys.executable, "-m", "visref", *arguments],
        env=environment,
        check=False,
        **({"capture_output": True} | kwargs),
    )


# Two command lines in one process, whose libraries are imported once: a "--" lies between them. Its
# status is theirs if they have the same.
BOTH = """
import sys
from visref.cli.entry import main
at, program = sys.argv.index("--"), sys.argv[0]
lines, statuses = (sys.argv[1:at], sys.argv[at + 1 :]), []
for line in lines:
    sys.argv = [program, *line]
    statuses.append(main())
sys.exit(statuses[0] if statuses[0] == statuses[1] else f"statuses {statuses}")
"""


def check_arguments(hostile, out: Path) -> list[str]:
    _, scene, path, visible = hostile
    return ["check", scene, "--path", path, "--visible", visible, "--pictures", "0",
            "--out", str(out)]  # fmt: skip


def test_a_name_of_an_object_is_shown_and_never_obeyed(hostile, tmp_path):
    folder, scene, _, _ = hostile
    out = tmp_path / "run"
    checked = visref_run(*check_arguments(hostile, out))
    assert checked.returncode == 1, checked.stderr
    listed = visref_run("objects", scene)
    assert listed.returncode == 0
    explained = visref_run("explain", str(out), "--frame", "0", "--object", "0")
    wrong = visref_run("explain", str(out), "--frame", "0", "--object", NAMES[0])
    unknown = visref_run("objects", str(folder / NAMES[0].replace("/", "")))
    assert unknown.returncode == 2
    usage = visref_run("objects", scene, NAMES[0])
    assert usage.returncode == 2
    for done in (checked, listed, explained, wrong, unknown, usage):
        printed = done.stdout.decode() + done.stderr.decode()
        assert obeyed(printed) == []
    rows = listed.stdout.decode().splitlines()
    # A heading, and a row for each object: no name has made one more.
    assert len(rows) == 1 + len(NAMES)
    assert any(r"annotates\n::error file=x.py::forged" in row for row in rows)
    assert any(r"clears\x1b[2J\x1b[31m\x07\x08" in row for row in rows)
    assert any("שלום" in row for row in rows)
    assert r"annotates\n::error" in checked.stdout.decode()


def test_json_for_programs_has_the_exact_names_and_no_command(hostile):
    _, scene, _, _ = hostile
    listed = visref_run("objects", scene, "--json", env={"PYTHONIOENCODING": "ascii"})
    assert [row["name"] for row in json.loads(listed.stdout)] == NAMES
    assert obeyed(listed.stdout.decode("ascii")) == []


def test_reports_show_the_names_in_each_format(hostile, tmp_path):
    out, page = tmp_path / "run", tmp_path / "page"
    visref_run(*check_arguments(hostile, out))
    assert visref_run("report", str(out), "--out", str(page)).returncode == 1
    names = {"report.html": "", "summary.md": "", "junit.xml": ""}
    for name in names:
        (file,) = page.rglob(name)
        text = names[name] = file.read_text(encoding="utf-8")
        # A page is no log: what a CI server would obey matters in the other two.
        assert UNSEEN.search(text.replace("\t", "")) is None, name
        assert name == "report.html" or obeyed(text) == [], name
    root = ET.fromstring(names["junit.xml"])
    _, failure, *_ = root.iter("failure")
    assert r"annotates\n::error file=x.py::forged" in str(failure.text)
    assert "<b>html</b>" not in names["report.html"]
    # Worst first: of the names that Markdown would read, all that are listed are escaped.
    assert "<b>html" not in names["summary.md"]
    assert re.search(r"(?<!\\)\[link\]", names["summary.md"]) is None


@given(st.text(st.characters()))
def test_no_text_at_all_is_obeyed(text):
    line = shown(text)
    assert obeyed(line) == []
    assert len(line.splitlines()) <= 1
    assert shown(line) == line


@given(st.lists(st.text(st.sampled_from(":# [vsoab\n\r\x1b")), min_size=2, max_size=2))
def test_no_table_of_any_cells_is_obeyed(capsys_text, cells):
    printed = capsys_text(lambda: OUT.table(("a", "b"), [cells], left=("b",)))
    assert obeyed(printed) == []
    assert printed.count("\n") == 2


@pytest.fixture(scope="module")
def capsys_text():
    """What a function prints to standard output."""
    import contextlib
    import io

    def printed(function) -> str:
        stream = io.StringIO()
        with contextlib.redirect_stdout(stream):
            function()
        return stream.getvalue()

    return printed


def test_columns_are_aligned_by_what_a_terminal_shows(capsys_text):
    printed = capsys_text(
        lambda: OUT.table(("name", "n"), [("日本", "1"), ("é", "22")], left=("name",))
    )
    assert printed == "name   n\n日本   1\né     22\n"


@pytest.mark.parametrize(
    "words",
    [
        ["objects", "x.glb", "a\n::error::b"],
        ["objects", "x.glb", "--no\n::error::b"],
        ["check", "x.glb", "--threads", "a\n::error::b"],
        ["check", "x.glb", "--promise", "a\n::error::b"],
        ["a\n::error::b"],
    ],
)
def test_a_word_that_is_no_argument_stays_on_its_line(words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(words)
    said = capsys.readouterr().err
    assert stop.value.code == 2
    assert obeyed(said) == []
    assert not any(line.startswith("::") for line in said.splitlines())
    assert said.splitlines()[-1].startswith("visref")
    assert "::error::b" in said.splitlines()[-1]


def test_our_own_lines_stay(capsys_text):
    assert capsys_text(lambda: OUT.lines("a\n\nb\n")) == "a\n\nb\n"
    assert capsys_text(lambda: OUT.lines("a\n::error::b\n")) == "a\n\\x3a:error::b\n"


def prints_directly(source: str) -> list[int]:
    """The lines on which a module writes to a standard stream by itself."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in (
            "print",
            "Console",
            "traceback.print_exc",
        ):
            found.append(node.lineno)
        if isinstance(node, ast.Attribute) and ast.unparse(node) in (
            "sys.stdout", "sys.stderr", "sys.__stdout__", "sys.__stderr__",
        ):  # fmt: skip
            found.append(node.lineno)
    return found


def test_nothing_prints_but_through_the_terminal_module():
    root = Path(visref.__file__).parent
    # The terminal itself; what speaks where the terminal may be what failed, or flushes at the end,
    # in words of its own; what empties the buffers before a process is copied; and `python -m
    # visref.findings`, which makes a page of the documentation.
    last = {root / "cli" / f"{name}.py" for name in ("breakdown", "entry", "supervised")}
    mine = {root / "cli" / "terminal.py", root / "findings.py", root / "forked.py", *last}
    guilty = {
        str(file): lines
        for file in root.rglob("*.py")
        if file not in mine and (lines := prints_directly(file.read_text(encoding="utf-8")))
    }
    assert guilty == {}
    assert prints_directly("import sys\nprint(1)\nsys.stdout.write('')") == [2, 3]


@pytest.mark.parametrize(
    "environment",
    [
        {"PYTHONIOENCODING": "ascii"},
        {"PYTHONIOENCODING": "cp1252"},
        {"PYTHONIOENCODING": "latin-1"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "TERM": "dumb",
         "COLUMNS": "0", "NO_COLOR": "1"},
    ],
    ids=["ascii", "cp1252", "latin-1", "C", "POSIX"],
)  # fmt: skip
def test_an_encoding_that_lacks_characters_costs_no_verdict(hostile, tmp_path, environment):
    out, page = tmp_path / "run", tmp_path / "page"
    lines = [*check_arguments(hostile, out), "--", "report", str(out), "--out", str(page)]
    done = subprocess.run(
        [sys.executable, "-P", "-c", BOTH, *lines],
        env={**os.environ, **environment},
        check=False,
        capture_output=True,
    )
    assert done.returncode == 1, done.stderr
    assert b"x violation" in done.stdout
    assert done.stderr == b""
    # What is written to files does not depend on it.
    verdict = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    assert {NAMES[0], "שלום"} <= {finding["object"] for finding in verdict["findings"]}
    assert "✕" in (page / "summary.md").read_text(encoding="utf-8")


SINKS = ["full", "closed stdout", "closed stderr", "both closed", "reader gone"]


@pytest.mark.parametrize("sink", SINKS)
def test_an_output_that_cannot_be_written_costs_no_verdict(hostile, tmp_path, sink):
    out = tmp_path / "run"
    command = [sys.executable, "-m", "visref", *check_arguments(hostile, out)]
    redirection = {
        "full": ">/dev/full 2>&1",
        "closed stdout": ">&-",
        "closed stderr": "2>&-",
        "both closed": ">&- 2>&- <&-",
        "reader gone": "| true",
    }[sink]
    script = f'"$@" {redirection}; exit "${{PIPESTATUS[0]}}"'
    done = subprocess.run(
        ["bash", "-c", script, "bash", *command], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert json.loads((out / "verdict.json").read_text(encoding="utf-8"))["exit_status"] == 1


def test_a_listing_that_was_lost_is_no_success(hostile):
    _, scene, _, _ = hostile
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = visref_run(
            "objects", scene, stdout=full, stderr=subprocess.PIPE, capture_output=False
        )
    assert done.returncode == 2
    assert done.stderr == b"standard output: [Errno 28] No space left on device\n"


def test_a_stream_that_breaks_is_left_alone(monkeypatch, capsys):
    class Broken:
        encoding = "utf-8"

        def write(self, text: str) -> int:
            raise OSError(28, "No space left on device")

        def fileno(self) -> int:
            raise OSError

    printer = Printer("stdout")
    monkeypatch.setattr(sys, "stdout", Broken())
    printer.line("a")
    printer.line("b")
    assert not printer.whole
    assert capsys.readouterr().err.count("No space left") == 1
    monkeypatch.setattr(sys, "stderr", Broken())
    ERRORS.line("c")


@pytest.mark.parametrize("columns", [0, 1, 7])
def test_a_terminal_of_hardly_any_width_costs_no_verdict(hostile, tmp_path, columns):
    import fcntl
    import pty
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 1, columns, 0, 0))
    out = tmp_path / "run"
    process = subprocess.Popen(
        [sys.executable, "-m", "visref", *check_arguments(hostile, out)],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**os.environ, "COLUMNS": str(columns)},
    )
    os.close(theirs)
    printed = b""
    try:
        while chunk := os.read(ours, 65536):
            printed += chunk
    except OSError:
        # So a terminal ends whose other side was closed.
        pass
    os.close(ours)
    assert process.wait() == 1, printed
    assert b"Traceback" not in printed
