"""Every cause has a name and its words, and every name is some cause's; each hypothesis has a
test."""

from __future__ import annotations

from tests.causes import (
    test_answer_hypotheses,
    test_depth_hypotheses,
    test_held,
    test_points_and_shapes,
    test_view_hypotheses,
)
from tests.causes.families import FAMILIES
from visref.causes.evidence import Answers
from visref.causes.fitted import FITS
from visref.causes.lists import LISTS
from visref.causes.search import HYPOTHESES
from visref.conformance.building import box, camera, case
from visref.culler import Promise
from visref.judging.causes import CODES
from visref.judging.outcome import CullerRecord
from visref.run_folder.layout import CAUSE_CODE, CAUSES

UNITS = case([("box", box((-1, -1, -9), (1, 1, -8)))], [camera()]).scene.object_units()
LISTED = LISTS(Answers(UNITS), CullerRecord("one", Promise.CONSERVATIVE, "object", 1))
TRIED = {one.cause for one in HYPOTHESES} | {fit.cause for fit in FITS} | set(LISTED)


def test_every_hypothesis_has_a_code():
    assert set(CODES) >= TRIED


def test_every_code_can_be_named():
    assert set(CODES) <= TRIED


def test_every_cause_that_a_known_fault_accepts_has_a_code():
    accepted = {cause for causes in FAMILIES.values() for cause in causes}
    assert accepted <= set(CODES)


def test_codes_are_written_as_records_have_them():
    for code, text in CODES.items():
        assert CAUSE_CODE.fullmatch(code), code
        assert text
        assert not text.endswith(".")
    # objects.parquet has them in one column with those of what was drawn for nothing.
    assert not CODES.keys() & CAUSES


def test_words_are_no_other_cause_s():
    assert len(set(CODES.values())) == len(CODES)


def test_no_hypothesis_is_there_twice():
    every = [(one.cause, one.variant) for one in HYPOTHESES]
    assert len(every) == len(set(every))


def test_every_hypothesis_is_tried_on_a_scene_of_its_own():
    claims = [
        *test_view_hypotheses.CLAIMS,
        *test_depth_hypotheses.CLAIMS,
        *test_answer_hypotheses.CLAIMS,
        *test_held.CLAIMS,
        *test_points_and_shapes.CLAIMS,
    ]
    tried = {
        (claim.cause, variant)
        for claim in claims
        if claim.drops is not None
        for variant in claim.variants
    }
    tried.add(("ids-wrap", "65536"))
    # The others again with a unit's own depth among those asked, which some of them have tried.
    assert {(one.cause, one.variant) for one in HYPOTHESES if not one.own} <= tried
    assert any(one.own and (one.cause, one.variant) in tried for one in HYPOTHESES)
