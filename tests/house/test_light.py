"""`import visref` and `visref --help` import no more than they need, and every public name is
where a type checker is told that it is."""

from __future__ import annotations

import ast
import importlib
import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import visref
from visref.cli.main import COMMANDS

# What takes long to import, or much memory.
HEAVY = {
    "PIL",
    "embreex",
    "jinja2",
    "matplotlib",
    "moderngl",
    "numba",
    "open3d",
    "pyarrow",
    "rich",
    "trimesh",
}


def imported(program: str) -> set[str]:
    """The top-level modules that a program has imported by its end, in an interpreter of its own.

    `-S` and a given path, so that what an editable installation's `.pth` files import is not
    taken for ours.
    """
    told = f"{program}\nimport json, sys; print(json.dumps(sorted(sys.modules)), file=sys.stderr)"
    command = [sys.executable, "-S", "-c", f"import sys; sys.path[:] = {sys.path!r}\n{told}"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in json.loads(run.stderr)}


HELP = """
from visref.cli.main import main
try:
    main(["--help"])
except SystemExit as end:
    assert end.code == 0
"""


@pytest.mark.parametrize("program", ["import visref", "import visref\nvisref.__version__", HELP])
def test_the_package_and_its_help_import_no_library_at_all(program):
    names = imported(program)
    assert "visref" in names
    assert names & (HEAVY | {"numpy"}) == set()


@pytest.mark.parametrize("module", ["scene", "camera", "camera_path", "culler", "errors"])
def test_what_a_plug_in_imports_brings_numpy_at_most(module):
    assert imported(f"import visref.{module}") & HEAVY == set()


def test_a_heavy_import_would_be_noticed():
    assert imported("import visref\nvisref.Referee") >= {"numba", "numpy"}


def test_every_command_has_a_module_and_every_command_module_is_a_command():
    folder = Path(visref.__file__).parent / "cli"
    modules = {file.stem for file in folder.glob("*.py")} - {"__init__", "main"}
    loaded = {name: importlib.import_module(f"visref.cli.{name}") for name in modules}
    assert {name for name, module in loaded.items() if hasattr(module, "add_arguments")} == {
        *COMMANDS
    }
    assert all(callable(loaded[name].run) for name in COMMANDS)


def told_to_type_checkers() -> dict[str, str]:
    """Public name to module, as the imports under TYPE_CHECKING say it."""
    tree = ast.parse(Path(visref.__file__).read_text(encoding="utf-8"))
    (block,) = (
        node
        for node in tree.body
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
    )
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def test_public_names_are_what_a_type_checker_is_told():
    told = told_to_type_checkers()
    assert {*told, "__version__"} == {*visref.__all__}
    for name, module in told.items():
        assert getattr(visref, name) is getattr(importlib.import_module(module), name)


def test_no_public_name_hides_a_module():
    folder = Path(visref.__file__).parent
    modules = {entry.stem for entry in folder.iterdir() if entry.suffix in ("", ".py")}
    assert modules & {*visref.__all__} == set()


def test_the_version_is_the_installed_one():
    assert visref.__version__ == version("visref")


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing_of_ours'"):
        _ = visref.nothing_of_ours
