"""Why something is missed, where faults are shrunk and searched for: the cause that was named stays
named while a scene gets smaller, and makes one fault of violations."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from tests.search.test_fuzz import search, summary
from tests.search.test_shrink import expected, run_on, shrink_of, written
from tests.search.test_shrinking import Watched, suspect_of, violating
from visref.judging.causes import CODES
from visref.search.folder import Key
from visref.search.holding import Wanted
from visref.search.judging import Kind, Violation, verdict_of
from visref.search.shrinking import shrink

GLASS = "tests.wrong_cullers.materials:GlassOccludes"
MISS = Violation(Kind.MISSED, 0, "", 1, "b", 4, 9, 1, 1, 0, 2.0, cause="pivot", others=("flipped",))
UNTOLD = replace(MISS, cause="", others=())
OTHER = replace(MISS, cause="own-depth", others=())


def test_a_cause_holds_where_it_is_among_those_that_explain_a_miss():
    wanted = Wanted("b", left_out=True, cause="flipped")
    assert wanted.picked([OTHER, MISS]) == replace(MISS, cause="flipped", others=("pivot",))
    assert wanted.picked([OTHER, UNTOLD]) is None
    assert wanted.picked([OTHER, UNTOLD], untold=True) == UNTOLD
    assert wanted.picked([OTHER], untold=True) is None
    assert Wanted("b", left_out=True).picked([OTHER, MISS]) == OTHER


def test_violations_that_a_known_fault_s_cause_explains_are_that_fault():
    known = [Key("missed", "flipped"), Key("missed", "", "missed, few samples")]
    assert Key.among(MISS, known) == known[0]
    assert Key.among(OTHER, known) == Key("missed", "own-depth")
    # Without a cause they are told apart by how much is lost.
    assert Key.among(UNTOLD, known) == known[1]


def test_the_cause_that_was_named_is_named_after_every_step():
    name = "glass-occludes"
    case, wanted = violating(name, "glass")
    first = verdict_of(case, suspect_of(name), explained=lambda _: True).violations[0]
    assert "glass-solid" in first.causes
    holding = Watched(suspect_of(name), replace(wanted, cause="glass-solid"))
    left = shrink(case, holding)
    taken = [one for one, held in holding.asked if held]
    assert len(taken) > 5
    for one in taken[:: len(taken) // 5]:
        verdict = verdict_of(one, suspect_of(name), explained=lambda _: True)
        lost = [v for v in verdict.violations if v.name == wanted.name]
        assert any("glass-solid" in v.causes for v in lost)
    assert (left.violation.cause, left.first_cause) == ("glass-solid", "glass-solid")


def test_a_cause_that_is_not_named_at_first_is_dropped_unless_it_is_firm():
    name = "glass-occludes"
    case, wanted = violating(name, "glass")
    wrong = replace(wanted, cause="one-frame-late")
    firm = Watched(suspect_of(name), wrong, firm=True)
    assert not firm.starts(case)
    loose = Watched(suspect_of(name), wrong)
    assert loose.starts(case)
    assert loose.wanted.cause == ""
    assert loose.trials == 1


def test_causes_are_named_only_of_verdicts_that_are_asked_for():
    case, _ = violating("glass-occludes", "glass")
    asked = []
    verdict = verdict_of(
        case, suspect_of("glass-occludes"), explained=lambda one: bool(asked.append(one))
    )
    assert len(asked) == 1
    assert all(one.causes == () for one in verdict.violations)


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """A run of a culler for which glass is solid, and its worst miss."""
    folder = tmp_path_factory.mktemp("judged")
    written("glass", folder)
    assert run_on(folder, folder / "run", "--culler", GLASS, "--in-process") == 1
    worst = json.loads((folder / "run" / "verdict.json").read_text())["cullers"][GLASS]["worst"]
    return folder / "run", worst["frame"], worst["object_name"]


def test_shrink_keeps_the_run_s_cause_and_tells_it_everywhere(judged, tmp_path):
    out = tmp_path / "fault"
    assert shrink_of(*judged[:1], out, *judged[1:], "--culler", GLASS, "--in-process") == 0
    told = expected(out)
    assert (told["violation"]["cause"], told["first_cause"]) == ("glass-solid", "glass-solid")
    said = f"Cause, as visref names it: `glass-solid` ({CODES['glass-solid']})."
    assert said in (out / "REPORT.md").read_text()
    assert said in " ".join((out / "test_fault.py").read_text().split())


@pytest.mark.parametrize(
    ("cause", "said"),
    [
        ("glas-solid", "did you mean 'glass-solid'"),
        ("one-frame-late", "is not missed by the cause 'one-frame-late' in frame"),
    ],
)
def test_a_cause_that_is_none_or_not_named_there_is_one_line(cause, said, judged, tmp_path, capsys):
    run, frame, target = judged
    asked = ("--culler", GLASS, "--cause", cause)
    capsys.readouterr()
    assert shrink_of(run, tmp_path / "out", frame, target, *asked) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not (tmp_path / "out").exists()


def test_a_search_names_causes_and_has_one_fault_per_cause_and_structure(tmp_path):
    assert search(tmp_path / "out", trials=24) == 1
    told = summary(tmp_path / "out")
    faults = told["faults"]
    assert {one["cause"] for one in faults} & set(CODES)
    alike = [(one["kind"], one["cause"], one["structure"]) for one in faults]
    assert len(set(alike)) == len(alike)
    for one in faults:
        of_folder = json.loads((tmp_path / "out" / one["folder"] / "expected.json").read_text())
        # Named in the trial that it was found in, where the search looked for causes.
        assert of_folder["first_cause"] in (one["cause"], "")
        assert of_folder["violation"]["cause"] == one["violation"]["cause"]
