"""What the README says of the papers' claims is what docs/tables.md measured."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from visref.papers import load_paper, paper_names

ROOT = Path(__file__).resolve().parent.parent.parent
TOOL = ROOT / "tools" / "tables-to-docs"
BEGIN, END = "<!-- claims: make tables -->\n", "<!-- end of claims -->\n"


def readme_block() -> str:
    return (ROOT / "README.md").read_text().partition(BEGIN)[2].partition(END)[0]


def test_readme_claims_are_those_of_the_documented_tables():
    block = readme_block()
    assert block.count("\n") > 3
    # A few words, and no table of its own.
    assert "|" not in block
    assert block in (ROOT / "docs" / "tables.md").read_text()


def test_every_paper_is_in_the_documented_tables():
    text = (ROOT / "docs" / "tables.md").read_text()
    for name in paper_names():
        assert f"## {load_paper(name).title}" in text.replace("\\", "")


def test_the_tool_replaces_the_block_and_nothing_else(tmp_path):
    tree, folder = tmp_path / "tree", tmp_path / "tables"
    for made in (tree / "tools", tree / "docs", folder):
        made.mkdir(parents=True)
    (tree / "tools" / TOOL.name).write_text(TOOL.read_text())
    (tree / "README.md").write_text(f"before\n{BEGIN}old \\1\n{END}after\n")
    (folder / "summary.md").write_text("new \\1\n")
    (folder / "tables.md").write_text("# Tables\n")
    command = [sys.executable, tree / "tools" / TOOL.name, folder]
    subprocess.run(command, check=True)
    assert (tree / "README.md").read_text() == f"before\n{BEGIN}new \\1\n{END}after\n"
    assert (tree / "docs" / "tables.md").read_text() == "# Tables\n"
    (tree / "README.md").write_text("no block\n")
    assert subprocess.run(command, capture_output=True).returncode == 1
