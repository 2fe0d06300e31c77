"""The catalogue and its generated page."""

from __future__ import annotations

import ast
from pathlib import Path

from visref.findings import RULES, document

ROOT = Path(__file__).parent.parent


def test_the_documentation_is_the_catalogue():
    assert (ROOT / "docs" / "findings.md").read_text() == document()


def test_every_finding_that_the_code_makes_is_in_the_catalogue():
    codes = set()
    for file in (ROOT / "visref").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Finding":
                first = node.args[0]
                if isinstance(first, ast.Constant):
                    codes.add(first.value)
    assert codes
    assert codes <= set(RULES)
