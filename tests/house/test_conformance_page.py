"""What docs/conformance.md shows runs, and its tables are complete."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from visref.cli.main import main
from visref.conformance.classes import CLASSES
from visref.conformance.declared import read_declared
from visref.conformance.files import written_cases
from visref.judging.status import Exit

PAGE = (Path(__file__).parent.parent.parent / "docs" / "conformance.md").read_text(encoding="utf-8")


def block(language):
    (found,) = re.findall(rf"^( *)```{language}\n(.*?)^\1```", PAGE, re.DOTALL | re.MULTILINE)
    return "\n".join(line.removeprefix(found[0]) for line in found[1].splitlines())


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
def test_its_engine_in_javascript_gets_a_green_table(tmp_path, capsys):
    suite, recordings, engine = (tmp_path / name for name in ("suite", "recordings", "engine.mjs"))
    assert main(["conformance", "--write", str(suite)]) == 0
    engine.write_text(block("js"))
    subprocess.run(["node", engine, suite, recordings], check=True, timeout=120)
    arguments = ["conformance", "--recordings", str(recordings), "--suite", str(suite)]
    arguments += ["--can", ",".join(name for name in CLASSES if name != "clusters")]
    results = tmp_path / "results.json"
    assert main([*arguments, "--json", str(results)]) == 0
    counts = json.loads(results.read_text())["counts"]
    assert counts["passed"] > 50
    assert counts["not run"] == 3
    assert counts["passed"] + 3 == len(written_cases())
    # Its pass is not for nothing: a node less, and cases fail.
    engine.write_text(block("js").replace("nodes.map", "nodes.slice(1).map"))
    subprocess.run(["node", engine, suite, recordings], check=True, timeout=120)
    capsys.readouterr()
    assert main(arguments) == 1
    assert "MISSED_OBJECT" in capsys.readouterr().out


def test_its_expectations_are_read(tmp_path):
    file = tmp_path / "engine.toml"
    file.write_text(block("toml"))
    declared = read_declared(file, [case.name for case in written_cases()])
    assert declared.can
    assert list(declared.reasons) == ["hole_of_a_pixel"]


def test_it_lists_every_class_and_every_exit_status():
    rows = dict(re.findall(r"^\| `([\w-]+)` \| (.*) \|$", PAGE, re.MULTILINE))
    assert {name: text for name, text in rows.items() if name in CLASSES} == CLASSES
    statuses = re.findall(r"^\| (\d+) \|", PAGE, re.MULTILINE)
    assert sorted(map(int, statuses)) == sorted(int(status) for status in Exit)
