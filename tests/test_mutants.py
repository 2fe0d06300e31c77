"""Every broken culler is caught where it should be, and the sound method passes there."""

from __future__ import annotations

from functools import cache

import pytest

from tests.bad_cullers import COMMON, COMMON_METHODS, MUTANTS, NOT_HERE, Method, accounted_for
from visref.conformance import CheckResult, Status, check_culler, conformance_checks

pytestmark = pytest.mark.gl

CHECKS = {check.name: check for check in conformance_checks()}
UNSAFE = [mutant for mutant in MUTANTS if mutant.caught_by]


@cache
def sound_result(name: str, check: str) -> CheckResult:
    method: Method = next(m.method for m in MUTANTS if m.method.name == name)
    return check_culler(method.make, checks=[CHECKS[check]])[0]


@pytest.mark.parametrize("mutant", UNSAFE, ids=str)
def test_unsafe_mutant_is_convicted_with_a_witness(mutant):
    (found,) = check_culler(mutant.make, checks=[CHECKS[mutant.caught_by]])
    assert found.status is Status.FAILED
    assert found.missed > 0
    assert "MISSED_OBJECT" in found.problems[0]
    assert "witness: pixel" in found.problems[0]


@pytest.mark.parametrize("mutant", UNSAFE, ids=str)
def test_sound_method_passes_where_its_mutant_fails(mutant):
    found = sound_result(mutant.method.name, mutant.caught_by)
    assert found.status is Status.PASSED, found.problems
    assert found.missed == 0


def test_every_common_mutant_is_tried_or_has_a_reason():
    assert accounted_for(COMMON, COMMON_METHODS) == []


def test_no_mutant_is_both_tried_and_excused():
    assert not {(m.id, m.method.name) for m in MUTANTS} & set(NOT_HERE)
