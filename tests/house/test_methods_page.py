"""The page of the culling methods has each one that is on board, with its options and promises."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from visref.registry import CULLERS, available

PAGE = (Path(__file__).parents[2] / "docs" / "methods.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if line.startswith("| [`")]


def missing(page: str, name: str, options: list[str]) -> list[str]:
    """What of a culler a page does not name."""
    wanted = [name, *options]
    return [one for one in wanted if not re.search(rf"`{re.escape(one)}(=[^`]*)?`", page)]


@pytest.mark.parametrize("name", sorted(available(CULLERS)))
def test_each_culler_is_on_the_page_with_its_options_and_its_promise(name):
    culler = available(CULLERS)[name].load()
    assert missing(PAGE, name, list(culler.options)) == []
    (row,) = [row for row in ROWS if f"`{name}`" in row]
    assert str(culler.promise) in row


def test_what_is_not_on_a_page_is_found():
    assert missing("`a` and `b=1`", "a", ["b", "c"]) == ["c"]
    assert missing("a", "a", []) == ["a"]
