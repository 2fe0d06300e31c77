"""The exit status, from counts alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from visref.culler import Promise
from visref.judging.judge import Counts
from visref.judging.status import CullerOutcome, Exit, Status, decide, run_status, status_of

SEEN = Counts(visible=5, owned_samples=100, drawn=5)


@pytest.mark.parametrize(
    ("outcome", "expected"),
    [
        (CullerOutcome(replace(SEEN, drawn=9, superfluous=4), 3), Status.NO_VIOLATION_FOUND),
        (CullerOutcome(replace(SEEN, missed=1, confirmed=1, violations=1), 3), Status.VIOLATION),
        (CullerOutcome(replace(SEEN, missed=1, ties=1), 3), Status.NO_VIOLATION_FOUND),
        (CullerOutcome(Counts(), 0), Status.INCONCLUSIVE),
        (CullerOutcome(SEEN, 0), Status.INCONCLUSIVE),
        (CullerOutcome(Counts(drawn=7, superfluous=7), 3), Status.INCONCLUSIVE),
        (CullerOutcome(SEEN, 2, failed=True), Status.INCONCLUSIVE),
        (CullerOutcome(replace(SEEN, violations=1), 2, failed=True), Status.VIOLATION),
        # Exactly half may be undecided, one sample more may not.
        (CullerOutcome(replace(SEEN, undecided_samples=50), 3), Status.NO_VIOLATION_FOUND),
        (CullerOutcome(replace(SEEN, undecided_samples=51), 3), Status.INCONCLUSIVE),
        (CullerOutcome(replace(SEEN, undecided_samples=51, violations=1), 3), Status.VIOLATION),
        # A violation needs a promise.
        (
            CullerOutcome(replace(SEEN, missed=1, confirmed=1), 3, promise=Promise.APPROXIMATE),
            Status.MEASURED,
        ),
        (CullerOutcome(SEEN, 3, promise=Promise.APPROXIMATE), Status.MEASURED),
        (CullerOutcome(SEEN, 3, promise=Promise.AGGRESSIVE), Status.NO_VIOLATION_FOUND),
        (CullerOutcome(SEEN, 3, failed=True, promise=Promise.APPROXIMATE), Status.INCONCLUSIVE),
        (
            CullerOutcome(replace(SEEN, undecided_samples=51), 3, promise=Promise.APPROXIMATE),
            Status.INCONCLUSIVE,
        ),
        (CullerOutcome(Counts(drawn=7), 3, promise=Promise.APPROXIMATE), Status.INCONCLUSIVE),
    ],
)
def test_one_cullers_status(outcome, expected):
    assert status_of(outcome) is expected


@pytest.mark.parametrize(
    ("undecided", "allowed", "expected"),
    [
        (20, 0.2, Status.NO_VIOLATION_FOUND),
        (21, 0.2, Status.INCONCLUSIVE),
        (1, 0.0, Status.INCONCLUSIVE),
        (0, 0.0, Status.NO_VIOLATION_FOUND),
        (99, 1.0, Status.NO_VIOLATION_FOUND),
        # Whatever is allowed, nothing decided is nothing judged.
        (100, 1.0, Status.INCONCLUSIVE),
    ],
)
def test_more_undecided_than_allowed_is_inconclusive(undecided, allowed, expected):
    outcome = CullerOutcome(replace(SEEN, undecided_samples=undecided), 3)
    assert status_of(outcome, max_undecided=allowed) is expected


def test_statuses_exit_as_documented():
    assert {status: int(status.exit) for status in Status} == {
        Status.NO_VIOLATION_FOUND: 0,
        Status.MEASURED: 0,
        Status.VIOLATION: 1,
        Status.INCONCLUSIVE: 3,
    }


@pytest.mark.parametrize(
    ("statuses", "expected"),
    [
        ([], Status.NO_VIOLATION_FOUND),
        ([Status.MEASURED], Status.MEASURED),
        ([Status.MEASURED, Status.MEASURED], Status.MEASURED),
        ([Status.MEASURED, Status.NO_VIOLATION_FOUND], Status.NO_VIOLATION_FOUND),
        ([Status.MEASURED, Status.INCONCLUSIVE], Status.INCONCLUSIVE),
        ([Status.INCONCLUSIVE, Status.VIOLATION, Status.MEASURED], Status.VIOLATION),
    ],
)
def test_the_runs_word_is_measured_only_if_every_cullers_is(statuses, expected):
    assert run_status(statuses) is expected


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
