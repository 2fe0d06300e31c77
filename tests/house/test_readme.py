"""What the pages show in Python runs; what the README and the map of the code name exists."""

from __future__ import annotations

import importlib
import re
import tomllib
from pathlib import Path

import pytest

from tests.support.page_blocks import blocks
from visref.cli.main import COMMANDS

ROOT = Path(__file__).parent.parent.parent
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
GROUPS = PROJECT["entry-points"]
MAP = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
COMMAND_PAGE = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
CULLER, PYTHON = (
    [block.text for block in blocks((ROOT / "docs" / name).read_text("utf-8"))
     if block.language == "python"]
    for name in ("write-a-culler.md", "python.md")
)  # fmt: skip


def test_its_python_runs_from_the_first_block_to_the_last(capsys):
    assert len(PYTHON) == 2
    names: dict[str, object] = {}
    for code in PYTHON:
        exec(compile(code, "python.md", "exec"), names)
    seen, verdict = capsys.readouterr().out.splitlines()
    # By hand: the near triangle has legs of 1 at depth 3, in an image of 480 rows at which one unit
    # spans 240 / (3 tan 0.4) = 189.2 pixels, so 189.2^2 / 2 = 17,900 samples, give or take a row.
    found = re.fullmatch(r"\{'near': (\d+), 'far': (\d+)\}", seen)
    assert found is not None
    assert int(found[1]) == pytest.approx(17_900, abs=190)
    assert verdict == "no_violation_found 0"


def test_its_culler_conforms_by_its_own_test():
    names: dict[str, object] = {}
    for code in CULLER:
        exec(compile(code, "write-a-culler.md", "exec"), names)
    test = names["test_my_culler"]
    (parametrized,) = test.pytestmark
    checks = parametrized.args[1]
    assert len(checks) > 30
    test(next(check for check in checks if check.name == "peeking_by_a_pixel"))


def test_a_page_lists_every_command_and_no_other():
    listed = re.findall(r"^\| `visref (\w+)", COMMAND_PAGE, flags=re.MULTILINE)
    assert set(listed) == set(COMMANDS)


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\(([\w./-]+)\)", TEXT))))
def test_files_that_it_links_to_exist(link):
    assert (ROOT / link).exists()


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`((?:[\w.]+/)+[\w.]*)`", MAP))))
def test_folders_that_the_map_names_exist(name):
    assert (ROOT / name).exists()


def test_the_map_shows_every_folder_and_names_every_group():
    picture = MAP.partition("```")[2].partition("```")[0]
    folders = {file.parent.name for file in (ROOT / "visref").glob("*/__init__.py")}
    assert folders <= set(re.findall(r"\w+", picture))
    assert all(f"`{group}`" in MAP for group in GROUPS)


def test_modules_that_the_map_names_can_be_imported():
    named = set(re.findall(r"`(visref(?:\.\w+)+)`", MAP)) - {*GROUPS}
    assert len(named) > 3
    for name in named:
        importlib.import_module(name)
