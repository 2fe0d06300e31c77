"""What docs/labels.md shows runs, and its table is that of the file."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from visref.cli.main import main
from visref.labels.table import SCHEMA

PAGE = (Path(__file__).parents[2] / "docs" / "labels.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.slow
def test_every_command_and_the_program_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    commands = [line for kind, text in BLOCKS if not kind for line in text.splitlines()]
    assert len(commands) == 4
    for command in commands:
        name, *arguments = shlex.split(command)
        assert name == "visref"
        assert main(arguments) == 0
    assert Path("merged-labels.parquet").read_bytes() == Path("labels.parquet").read_bytes()
    capsys.readouterr()
    (program,) = [text for kind, text in BLOCKS if kind == "python"]
    exec(program, {})
    assert "is hidden by [" in capsys.readouterr().out


def test_every_column_is_defined_with_its_type():
    section = PAGE.partition("## The table")[2].partition("\n## ")[0]
    named = [
        name
        for line in section.splitlines()
        if line.startswith("| `")
        for name in re.findall(r"`(\w+)`", line.split("|")[1])
    ]
    assert named == SCHEMA.names
