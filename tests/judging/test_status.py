"""The exit status, from counts alone."""

from __future__ import annotations

import pytest

from visref.judging.judge import Counts
from visref.judging.status import CullerOutcome, Exit, decide, status_of


@pytest.mark.parametrize(
    ("outcome", "expected"),
    [
        (CullerOutcome(Counts(visible=5, drawn=9, superfluous=4), 3), Exit.NO_VIOLATION),
        (CullerOutcome(Counts(visible=5, missed=1, confirmed=1, violations=1), 3), Exit.VIOLATION),
        (CullerOutcome(Counts(visible=5, missed=1, confirmed=1), 3), Exit.NO_VIOLATION),
        (CullerOutcome(Counts(visible=5, missed=1, ties=1), 3), Exit.NO_VIOLATION),
        (CullerOutcome(Counts(), 0), Exit.NOTHING_JUDGED),
        (CullerOutcome(Counts(drawn=7, superfluous=7), 3), Exit.NOTHING_JUDGED),
        (CullerOutcome(Counts(visible=5, drawn=5), 2, failed=True), Exit.NOTHING_JUDGED),
        (CullerOutcome(Counts(visible=5, violations=1), 2, failed=True), Exit.VIOLATION),
    ],
)
def test_one_cullers_status(outcome, expected):
    assert status_of(outcome) is expected


@pytest.mark.parametrize(
    ("statuses", "expected"),
    [
        ([], Exit.NO_VIOLATION),  # no culler was asked for
        ([Exit.NO_VIOLATION], Exit.NO_VIOLATION),
        ([Exit.NO_VIOLATION, Exit.NOTHING_JUDGED], Exit.NOTHING_JUDGED),
        ([Exit.NOTHING_JUDGED, Exit.VIOLATION, Exit.NO_VIOLATION], Exit.VIOLATION),
        ([Exit.VIOLATION, Exit.BAD_INPUT], Exit.BAD_INPUT),
    ],
)
def test_over_several_cullers_bad_input_precedes_violation_precedes_nothing(statuses, expected):
    assert decide(statuses) is expected


def test_the_three_words_of_a_verdict():
    assert [e.status for e in Exit] == [
        "no_violation_found",
        "violation",
        "inconclusive",
        "inconclusive",
    ]
