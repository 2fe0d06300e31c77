"""What the threat model names as its tests and its protection is there; every format is fuzzed."""

from __future__ import annotations

import re
from importlib.metadata import distribution, entry_points
from pathlib import Path

import pytest

from tests.fuzz.find import TARGETS
from visref.formats import known_extensions

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "threat-model.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`((?:tests|visref|docs)/[\w./-]+)`", TEXT)))
ROWS = [line.split("|") for line in TEXT.splitlines() if line.startswith("| ")][1:]

SCENE_FORMATS = "visref.scene_formats"
# Read as another that has a target is: by the same reader.
SAME_READER = {"vrm": "glb", "stl_ascii": "stl", "usd": "usdc"}
# Of these nobody here has a good file, nor can make one.
WITHOUT_TARGET = {"3dxml"}


@pytest.mark.parametrize("name", NAMED)
def test_what_it_names_exists(name):
    assert (ROOT / name).exists()


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\(([\w./-]+)\)", TEXT))))
def test_what_it_links_to_exists(link):
    assert (ROOT / "docs" / link).exists()


def test_each_line_names_its_protection_and_its_test():
    assert len(ROWS) >= 8
    for _, what, _, protection, tested, _ in ROWS:
        assert protection.strip(), what
        assert "fuzz" in tested or re.search(r"`tests/[\w/]+\.py`", tested), what


def test_the_targets_that_it_names_are_there():
    for tested in (row[4] for row in ROWS):
        fuzzed = re.search(r"fuzz: ([^;]*)", tested)
        for name in re.findall(r"`([\w-]+)`", fuzzed[1]) if fuzzed else ():
            assert name in TARGETS


def test_every_format_that_is_read_is_fuzzed():
    endings = {Path(target.file).suffix[1:] for target in TARGETS.values()}
    # Readers of others, as that of examples/engines/bsp, are theirs to try.
    ours = {one.name for one in distribution("visref").entry_points if one.group == SCENE_FORMATS}
    ours |= set(known_extensions()) - {one.name for one in entry_points(group=SCENE_FORMATS)}
    unfuzzed = ours - endings - WITHOUT_TARGET - set(SAME_READER)
    assert unfuzzed == set()
    assert set(SAME_READER.values()) <= endings
