"""A short run of each target: every case is read or refused, and what was found once stays found.

`make fuzz` runs them for longer.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tests.fuzz.find import CORPUS, TARGETS, find, replay, run_case
from tests.fuzz.limits import Folders

pytestmark = pytest.mark.slow

# Point clouds and drawings of lines: a file of them is no scene.
NEVER_A_SCENE = ("xyz", "dxf")
# A texture that cannot be read leaves samples open, and is a finding; any name is a name.
NEVER_REFUSED = ("texture", "names")
REGRESSIONS = sorted(file for file in CORPUS.rglob("*") if file.is_file())
LARGEST = 64 * 1024


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    return Folders(tmp_path_factory.mktemp("fuzz"))


GOOD = {f"{t.name}-{name}": (t, name) for t in TARGETS.values() for name in t.seeds()}


@pytest.mark.parametrize(("target", "name"), GOOD.values(), ids=GOOD)
def test_a_good_file_is_read(target, name, folders):
    target.warm_up(folders)
    value, fault = target.run(target.seeds()[name], folders)
    assert fault is None
    assert (value is None) == (target.name in NEVER_A_SCENE)


@pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)
def test_a_spoilt_file_is_read_or_refused(target, folders):
    target.warm_up(folders)
    outcomes = Counter()

    def counted(target, case, folders):
        value, fault = run_case(target, case, folders)
        outcomes["refused" if value is None else "rewritten" if case.same_as else "read"] += 1
        return value, fault

    found = find(target, folders, seed=0, cases=target.cases, run=counted)
    assert not found, "\n".join(f"{kind}: {one.fault.detail}" for kind, one in found.items())
    # What reads or refuses everything tells nothing.
    assert outcomes["refused"] >= 3 or target.name in NEVER_REFUSED
    assert outcomes["read"] >= 1 or target.name in NEVER_A_SCENE
    assert outcomes["rewritten"] >= 3 or target.rewrite is None


@pytest.mark.parametrize("file", REGRESSIONS, ids=lambda file: str(file.relative_to(CORPUS)))
def test_what_was_found_once_is_not_found_again(file: Path, folders):
    assert file.stat().st_size <= LARGEST
    target = TARGETS[file.parent.name]
    assert file.suffix == target.suffix
    target.warm_up(folders)
    fault = replay(target, file, folders)
    assert fault is None, f"{fault.kind}\n{fault.detail}"
