"""CONTRIBUTING's guide, followed step by step with a method that nobody has seen before."""

from __future__ import annotations

from pathlib import Path

import pytest

import tests.mutants
from tests.mutants.common import COMMON
from tests.mutants.harness import Suite, suites, unaccounted
from tests.mutants.test_mutants import (
    test_sound_method_keeps_every_contract as keeps_every_contract,
)
from tests.mutants.test_mutants import (
    test_unsafe_mutant_is_convicted_and_the_sound_method_is_not as is_convicted,
)
from tests.mutants.test_mutants import (
    test_wasteful_mutant_breaks_its_contract_and_misses_nothing as breaks_its_contract,
)
from visref.cli.main import main
from visref.conformance import assert_conforms
from visref.registry import CULLERS, available, make_culler

pytestmark = pytest.mark.gl

# Step 1, the module.
MODULE = '''
"""An occlusion query per unit, where that may pay: no paper's."""

import numpy as np
from visref.culler import Option
from visref_culling.method import GL_OPTIONS, GLCuller


class LargeAskedCulling(GLCuller):
    name = "large-asked"
    summary = "front to back, an occlusion query for each unit of many triangles"
    options = {"least": Option(32, "triangles from which a unit is asked"), **GL_OPTIONS}
    notes_asked = True

    def __init__(self, *, least=32, depth=24, fragments=False):
        super().__init__(depth=depth, fragments=fragments)
        self.least = least

    def decide(self, frame):
        small = self.units.sizes[frame.ids] < self.least
        for place in np.arange(len(frame.ids)):
            places = place[None]
            if not (frame.sure | small)[place]:
                places = self.shown(places, self.query(frame, places))
            self.draw(frame, places)

    def shown(self, places, visible):
        return places[visible]
'''

# Step 3, the line.
LINE = """
[visref.cullers]
large-asked = large_asked_culling:LargeAskedCulling
"""

# Mutants, as first written: the list is there, and little of it is tried.
BEGUN = """
from large_asked_culling import LargeAskedCulling
from tests.mutants.common import common
from tests.mutants.harness import Suite, mutant, not_here

SUITE = Suite({"U1": "depth mask left on", "W2": "answers left out"}, watched=("crowd",))
LARGE = (SUITE.method("large-asked", LargeAskedCulling, least=0),)

common("G2 G9 G10 G12 G13", of=LARGE)
not_here("G1 G3 G4 G5 G6 G7", LARGE, "the rasteriser projects, rounds and compares the box")
not_here("G8", LARGE, "an object's own depth is not there when its box is asked")
not_here("G11", LARGE, "nothing is kept from one frame to the next")
"""

# The same, finished, with a contract.
FINISHED = (
    BEGUN
    + '''
common("G14 G15 M1 M2 M3 M4 M5 M6", of=LARGE)


@mutant("U1", of=LARGE, caught_by="stacks_of_sheets")
class DepthMaskLeftOn:
    """Query boxes write their depth, and hide the boxes asked after them."""

    def query_state(self, state):
        return super().query_state(state)._replace(depth_write=True)


@SUITE.contract
def what_was_asked_and_hidden_is_not_drawn(trace):
    for data in trace.of("query"):
        hidden = set(data["units"][data["samples"] == 0].tolist())
        if hidden & set(trace.drawn):
            yield f"units {sorted(hidden & set(trace.drawn))} are drawn"


SUITE.kept_by(*LARGE)
SUITE.kept_by(*LARGE, least=12)


@mutant("W2", of=LARGE, contract="what_was_asked_and_hidden_is_not_drawn")
class AnswersLeftOut:
    """All that was asked is drawn."""

    def shown(self, places, visible):
        return places
'''
)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The module and its line, as an installation has them; gives a folder that `tests/mutants/`
    goes on in."""
    (tmp_path / "large_asked_culling.py").write_text(MODULE)
    info = tmp_path / "large_asked-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: large-asked\nVersion: 1\n")
    (info / "entry_points.txt").write_text(LINE)
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "mutants"
    folder.mkdir()
    monkeypatch.setattr(tests.mutants, "__path__", [*tests.mutants.__path__, str(folder)])
    return folder


def open_ends() -> list[str]:
    """What `tests/mutants/test_mutants.py` would complain of."""
    registered = {name: point.load() for name, point in available(CULLERS).items()}
    return unaccounted(suites().values(), registered, COMMON)


@pytest.mark.slow
def test_method_by_the_guide_is_listed_runs_and_conforms(installed, capsys):
    assert main(["cullers"]) == 0
    assert (
        "front to back, an occlusion query for each unit of many triangles"
        in capsys.readouterr().out
    )
    assert_conforms(lambda: make_culler("large-asked:least=12"))


def test_method_without_mutants_fails_the_suite(installed):
    assert open_ends() == ["no mutants of large-asked"]


def test_list_that_is_begun_fails_the_suite(installed):
    (installed / "begun.py").write_text(BEGUN)
    moving = [f"M{number}" for number in range(1, 7)]
    assert open_ends() == [f"{id} of large-asked" for id in ("G14", "G15", *moving, "U1", "W2")]


def test_method_by_the_guide_has_its_mutants_caught_and_keeps_its_contract(installed):
    (installed / "finished.py").write_text(FINISHED)
    assert open_ends() == []
    made: Suite = suites()["tests.mutants.finished"]
    assert len(made.mutants) == 16
    for mutant in made.mutants:
        (is_convicted if mutant.caught_by else breaks_its_contract)(mutant)
    for method in made.keepers:
        keeps_every_contract(method)
