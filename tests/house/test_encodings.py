"""Files are UTF-8 whatever the locale: every text file is opened with its encoding named."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import visref
from tests.cli.test_cli import record, write_scene

ROOT = Path(visref.__file__).parent.parent
FOLDERS = (
    "visref",
    "culling",
    "datasets_gen",
    "experiments",
    "benchmarks",
    "examples",
    "recorders",
)
SCRIPTS = ("tools/cluster-costs", "tools/records", "tools/tables-to-docs")


def unnamed(text: str) -> list[int]:
    """The lines that open a text file, and do not say how it is encoded."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
        named = any(keyword.arg == "encoding" for keyword in node.keywords)
        modes = [a.value for a in node.args if isinstance(a, ast.Constant)]
        modes += [k.value.value for k in node.keywords if isinstance(k.value, ast.Constant)]
        binary = any(isinstance(mode, str) and "b" in mode and len(mode) <= 3 for mode in modes)
        plain_open = name == "open" and isinstance(called, ast.Name)
        # `path.open("w")`; `image.open(file)` and `archive.open(name)` have no mode.
        by_mode = name in ("open", "fdopen") and any(mode in ("r", "w", "a", "x") for mode in modes)
        read = name in ("read_text", "write_text", "TextIOWrapper")
        if (plain_open or by_mode or read) and not named and not binary:
            found.append(node.lineno)
    return found


def test_every_text_file_is_opened_with_its_encoding_named():
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")]
    files += [ROOT / script for script in SCRIPTS]
    assert len(files) > 150
    found = {str(file): lines for file in files if (lines := unnamed(file.read_text("utf-8")))}
    assert not found
    sample = "open(p)\np.open('w')\np.read_text()\nopen(p, 'rb')\nopen(p, encoding='utf-8')"
    assert unnamed(sample) == [1, 2, 3]


@pytest.mark.slow
def test_a_whole_check_asks_for_the_locale_s_encoding_nowhere(tmp_path):
    scene, path = write_scene(tmp_path)
    drawn = record(tmp_path, ["front"], ["front"])
    out, page = str(tmp_path / "run"), str(tmp_path / "page")
    strict = [sys.executable, "-X", "warn_default_encoding", "-W", "always::EncodingWarning"]
    for arguments in (
        ["check", scene, "--path", path, "--visible", drawn, "--out", out],
        ["report", out, "--out", page],
        ["explain", out, "--frame", "0", "--object", "beside"],
    ):
        command = [*strict, "-m", "visref", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8")
        assert done.returncode in (0, 1), done.stderr
        # Libraries may have their own.
        ours = [line for line in done.stderr.splitlines() if line.startswith(str(ROOT / "visref"))]
        assert not ours
