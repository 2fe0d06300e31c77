"""The guide names files and steps that exist, and its code is code."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest

from tests.mutants import common, harness
from tests.mutants.occupancy_map import contract, mutants
from visref_culling.method import GLCuller
from visref_culling.occupancy_map import OccupancyMapCulling

ROOT = Path(__file__).parent.parent.parent
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, flags=re.DOTALL)
PYTHON = [code for language, code in BLOCKS if language == "python"]


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`((?:\w+/)+[\w.]*)`", TEXT))))
def test_files_that_the_guide_names_exist(name):
    assert (ROOT / name).exists()


def test_its_python_parses_and_its_lines_are_those_in_pyproject():
    assert len(PYTHON) == 4
    for code in PYTHON:
        ast.parse(code)
    lines = [tomllib.loads(code) for language, code in BLOCKS if language == "toml"]
    assert len(lines) == 2
    real = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for line in lines:
        for group, points in line["project"]["entry-points"].items():
            assert points.items() <= real["project"]["entry-points"][group].items()


def test_its_mutants_and_its_contract_are_those_of_the_suite():
    for code in PYTHON:
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ClassDef) and node.name != "OccupancyMapCulling":
                real = getattr(mutants, node.name)
                (step,) = (part.name for part in node.body if isinstance(part, ast.FunctionDef))
                assert step in vars(real)
                assert " ".join(real.__doc__.split()) == ast.get_docstring(node)
            elif isinstance(node, ast.FunctionDef) and node.args.args[0].arg == "trace":
                assert node.name in contract.SUITE.contracts
    for name in ("COMMON", "common"):
        assert hasattr(common, name)
    for name in ("mutant", "not_here", "equivalent", "breaks"):
        assert hasattr(harness, name)
    for name in ("method", "scene", "contract", "kept_by"):
        assert hasattr(harness.Suite, name)


def test_steps_that_it_names_exist():
    for step in ("clear_maps", "rectangles", "left_out", "list_numbers", "mark_drawn"):
        assert f"`{step}`" in TEXT
        assert hasattr(OccupancyMapCulling, step)
    for step in ("draw", "query", "observe", "decide"):
        assert hasattr(GLCuller, step)
