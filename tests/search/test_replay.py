"""A shrunk fault of each class replays from its folder alone, in a process that knows nothing else:
exit status 1, the same object, and the same cause where one is named."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.search.test_shrinking import BUILD, FAULTS
from tests.wrong_cullers import WRONG
from visref.plug_ins import Making
from visref.search import edits
from visref.search.case import Case
from visref.search.fault_folder import write_fault
from visref.search.holding import Holding, Wanted
from visref.search.judging import verdict_of
from visref.search.shrinking import shrink
from visref.search.suspects import suspect_of

# One without a cause and one with; the others take minutes.
QUICK = ("hidden-drawn-though-exact", "glass-occludes")


def shrunk_to_a_folder(name: str, folder: Path) -> None:
    """The first violation of a wrong culler, with what is named for it in the whole scene."""
    culler, (scene, _) = WRONG[name].culler, FAULTS[name]
    built = BUILD[scene](np.random.default_rng(0))
    whole = Case.of(built.scene, built.path)
    spec = f"{culler.__module__}:{culler.__qualname__}"
    with suspect_of(spec, Making(in_process=True)) as suspect:
        first = verdict_of(whole, suspect, explained=lambda _: True).violations[0]
        case = edits.only_frames(whole, range(first.frame + 1))
        holding = Holding(suspect, Wanted.of(first))
        assert holding.starts(case)
        write_fault(folder, shrink(case, holding), suspect)


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow)
             for name in FAULTS]
)  # fmt: skip
def test_a_shrunk_fault_of_each_class_replays_by_the_same_cause(name, tmp_path):
    made, alone, out = tmp_path / "made", tmp_path / "alone", tmp_path / "run"
    made.mkdir()
    shrunk_to_a_folder(name, made)
    shutil.copytree(made, alone)
    shutil.rmtree(made)
    expected = json.loads((alone / "expected.json").read_text())
    command = [sys.executable, "-m", "visref", *expected["run"], "--out", str(out)]
    done = subprocess.run(command, cwd=alone, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "")
    told = expected["violation"]
    (sums,) = json.loads((out / "verdict.json").read_text())["cullers"].values()
    assert sums["violations"] > 0
    if told["kind"] == "superfluous":
        assert told["cause"] == ""
        return
    files = sorted((out / "witnesses").iterdir())
    lines = [line for file in files for line in file.read_text().splitlines()]
    (witness,) = (
        one
        for one in map(json.loads, lines)
        if (one["frame"], one["object_name"], one["x"], one["y"])
        == (told["frame"], told["object_name"], told["witness"]["x"], told["witness"]["y"])
    )
    named = [one["cause"] for one in witness["causes"]]
    # Which others may be it, and which is likelier, hangs on what is left of the scene.
    assert not told["cause"] or told["cause"] in named
