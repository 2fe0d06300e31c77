"""The catalogue of known faults is whole, each is convicted, and a third of them is kept back."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import replace

import numpy as np
import pytest

from tests.causes import table
from tests.causes.catalogue import EVERY, FAULTS
from tests.causes.drawn import KEPT_BACK, SEED, drawn, is_later, part_of
from tests.causes.families import FAMILIES
from tests.causes.wrong import LABELS, LOSE_NOTHING, RECORDED_LABELS, RECORDED_ON
from tests.mutants.harness import suites
from tests.wrong_cullers import WRONG
from visref.culler import Culler
from visref.timeline import Timeline

OPEN = [fault for name, fault in FAULTS.items() if name not in KEPT_BACK]


def on_gl(fault):
    return fault.source == "mutant" and "/toy/" not in fault.name


# Some of what is not kept back, another share for another seed.
_RNG = np.random.Generator(np.random.PCG64(SEED + 1))
TRIED = [
    pytest.param(fault, marks=[pytest.mark.gl] if on_gl(fault) else [], id=str(fault))
    for part in (
        [fault for fault in OPEN if fault.source == "mutant"],
        [fault for fault in OPEN if fault.source == "wrong"],
        [fault for fault in OPEN if fault.source == "case"],
    )
    for fault in (part[i] for i in _RNG.permutation(len(part))[:2])
]


def test_names_are_unique():
    assert len(FAULTS) == len(EVERY)


def test_every_wrong_culler_that_loses_something_is_in_it():
    assert set(LABELS) == set(WRONG) - LOSE_NOTHING
    recorded = {name for names in RECORDED_ON.values() for name in names.split()}
    assert recorded <= set(LABELS)
    assert set(RECORDED_LABELS) <= recorded


def test_every_unsafe_mutant_of_a_culler_is_in_it():
    unsafe = {
        (mutant.culler.__name__, mutant.method.name, mutant.caught_by)
        for suite in suites().values()
        for mutant in suite.mutants
        if mutant.caught_by and issubclass(mutant.culler, Culler)
    }
    listed = [name for name in FAULTS if name.startswith("mutant/")]
    assert len(listed) == len(unsafe)


def test_every_family_is_used():
    assert {fault.family for fault in EVERY} == set(FAMILIES)


@pytest.mark.gl
@pytest.mark.parametrize("source", ["mutant", "wrong", "case"])
def test_every_fault_makes_its_input(source):
    """Those kept back too, which are not judged. Recordings are of the wrong cullers."""
    for fault in EVERY:
        if fault.source == source:
            given = fault.make()
            timeline = Timeline(given.scene, given.path)
            assert given.culler.moves or not timeline.moves, fault
            given.culler.close()


# The third that is kept back.


def test_a_third_of_the_mistakes_of_each_part_is_kept_back_with_all_their_variants():
    parts = defaultdict(set)
    for fault in EVERY:
        parts[part_of(fault.mistake)].add(fault.mistake)
    held = {fault.mistake for fault in EVERY if fault.name in KEPT_BACK}
    assert not held & {fault.mistake for fault in OPEN}
    for mistakes in parts.values():
        later = {one for one in mistakes if is_later(one)}
        assert later <= held
        assert len((mistakes - later) & held) == round(len(mistakes - later) / 3)


def test_about_a_third_of_each_source_is_kept_back():
    first = [fault for fault in EVERY if not is_later(fault.mistake)]
    whole = Counter(fault.source for fault in first)
    held = Counter(fault.source for fault in first if fault.name in KEPT_BACK)
    for source, count in whole.items():
        assert 0.28 < held[source] / count < 0.39, source


def test_what_is_kept_back_does_not_depend_on_the_order():
    assert drawn(EVERY) == drawn(reversed(EVERY)) == KEPT_BACK
    assert drawn(EVERY, SEED + 1) != KEPT_BACK


def test_table_refuses_what_is_kept_back(capsys):
    with pytest.raises(SystemExit) as left:
        table.main(["--only", sorted(KEPT_BACK)[0]])
    assert left.value.code == 2
    assert "1 of the other part (--kept-back)" in capsys.readouterr().err


# The table.


class AlwaysTheSame:
    """Stands in for what names causes."""

    class listener:
        on_truth = on_verdict = on_frame_done = staticmethod(lambda *told: None)

    def __init__(self, scene):
        self.scene = scene

    def find(self, outcome, run):
        return lambda frame, view, object_id: ["own-depth", "flipped"]


@pytest.mark.parametrize("fault", TRIED)
def test_fault_is_convicted(fault):
    row = table.judge(fault, AlwaysTheSame)
    assert row.convicted > 0
    assert not row.failed
    assert row.given == {"own-depth": row.convicted}


def rows():
    """Two faults: of one, two objects of four are right; of the other no cause is right."""
    first = replace(OPEN[0], family="distance for depth")
    known = table.Row("a", first.family, sorted(first.accepted))
    for causes in (["euclidean-depth"], ["flipped", "euclidean-depth"], [], ["flipped"]):
        known.add(causes)
    unknown = table.Row("b", "answers lost", [])
    unknown.add(["flipped"])
    unknown.add([])
    return [known, unknown]


def test_answer_is_right_if_any_cause_named_is():
    known, unknown = rows()
    assert (known.convicted, known.right, known.wrong, known.none) == (4, 2, 1, 1)
    assert known.first == 1
    assert (unknown.right, unknown.wrong, unknown.none) == (0, 1, 1)


def test_a_fact_is_right_where_it_is_why_and_says_nothing_elsewhere():
    why, elsewhere = table.Row("a", "", ["nothing-drawn"]), table.Row("b", "", ["flipped"])
    for row in (why, elsewhere):
        row.add(["nothing-drawn"])
        row.add(["nothing-drawn", "own-depth"])
    assert (why.right, why.wrong, why.none) == (2, 0, 0)
    assert (elsewhere.right, elsewhere.wrong, elsewhere.none) == (0, 1, 1)
    assert elsewhere.given == {"nothing-drawn": 2}


def test_shares_are_of_the_faults_that_a_cause_describes():
    known, each, unknown = table.totals(rows())
    assert "4 objects lost by 1 faults" in known
    assert "right 50.0 % (25.0 % by the cause named first), wrong 25.0 %, none 25.0 %" in known
    assert "right 50.0 %, wrong 25.0 %" in each
    assert "one is named for 50.0 %" in unknown


def test_confusion_table_has_a_line_per_family_with_what_was_given():
    lines = table.confusion(rows())
    (line,) = [one for one in lines if one.startswith("| distance for depth ")]
    assert line.endswith("| flipped 2, euclidean-depth 1, none 1 |")
    assert len(lines) == 4
