"""Every broken culler is caught where it should be, and the sound method passes there.

`tests/mutants/harness.py` says what a suite is. These tests find the suites, so that a method
needs no line here, and ask for one of every culler that is registered.
"""

from __future__ import annotations

from typing import Any

import pytest

from tests.mutants.common import COMMON
from tests.mutants.harness import Method, Mutant, departures, suites, unaccounted
from tests.support.shares import share
from visref.conformance import CheckResult, Status, assert_conforms, check_culler
from visref.registry import CULLERS, available

pytestmark = [pytest.mark.gl, pytest.mark.slow]

SUITES = suites()
MUTANTS = [mutant for suite in SUITES.values() for mutant in suite.mutants]
BREAKERS = [mutant for suite in SUITES.values() for mutant in suite.breakers]
UNSAFE = [mutant for mutant in MUTANTS if mutant.caught_by]
WASTEFUL = [mutant for mutant in MUTANTS if mutant.contract]
METHODS = [method for suite in SUITES.values() for method in suite.methods]
KEEPERS = [method for suite in SUITES.values() for method in suite.keepers]


def test_every_registered_culler_has_each_mutant_tried_or_a_reason():
    registered: dict[str, Any] = {name: point.load() for name, point in available(CULLERS).items()}
    assert unaccounted(SUITES.values(), registered, COMMON) == []


def test_no_mutant_is_both_tried_and_excused():
    for suite in SUITES.values():
        tried = {(mutant.id, mutant.method.name) for mutant in suite.mutants}
        assert not tried & set(suite.reasons())
        assert not set(suite.equivalent) & set(suite.not_here)
        assert all(suite.reasons().values())


def test_oracle_is_the_one_that_the_mutants_letter_names():
    """Nothing convicts a method that promises nothing: there a contract sees the unsafe too."""
    for mutant in MUTANTS:
        if mutant.id in {*COMMON, *mutant.suite.ids} and mutant.sound.make().promise.convicts:
            assert bool(mutant.contract) == mutant.id.startswith("W"), mutant


RESULTS: dict[str, CheckResult] = {}


def sound_result(method: Method, name: str) -> CheckResult:
    """Of one check on a sound method, once for however many mutants."""
    key = f"{method.culler}{sorted(method.options.items())}{name}"
    if key not in RESULTS:
        (RESULTS[key],) = check_culler(method.make, checks=[method.suite.checks[name]])
    return RESULTS[key]


@pytest.mark.parametrize("mutant", UNSAFE, ids=str)
def test_unsafe_mutant_is_convicted_and_the_sound_method_is_not(mutant: Mutant):
    check = mutant.suite.checks[mutant.caught_by]
    (found,) = check_culler(mutant.make, checks=[check])
    assert found.status is Status.FAILED
    assert found.missed > 0
    for said in mutant.suite.says:
        assert said in found.problems[0]
    sound = sound_result(mutant.sound, mutant.caught_by)
    assert sound.status is Status.PASSED, sound.problems
    assert sound.missed == 0


@pytest.mark.parametrize("mutant", WASTEFUL, ids=str)
def test_wasteful_mutant_breaks_its_contract_and_misses_nothing(mutant: Mutant):
    broken = departures(mutant)
    assert mutant.contract in broken, f"only {list(broken)}"
    assert_conforms(mutant.make, checks=[mutant.suite.checks[n] for n in mutant.suite.watched])


@pytest.mark.parametrize("mutant", BREAKERS, ids=str)
def test_contract_sees_what_breaks_it(mutant: Mutant):
    broken = departures(mutant)
    assert mutant.contract in broken, f"only {list(broken)}"


@pytest.mark.parametrize("method", KEEPERS, ids=lambda m: f"{m}-{m.options}")
def test_sound_method_keeps_every_contract(method: Method):
    assert departures(method) == {}


def test_every_contract_can_be_broken_and_is_kept_by_a_sound_method():
    for module, suite in SUITES.items():
        broken = {mutant.contract for mutant in (*suite.mutants, *suite.breakers)} - {""}
        assert broken == set(suite.contracts), module
        assert bool(suite.contracts) == bool(suite.keepers), module


@pytest.mark.parametrize(
    "at", range(len(METHODS)), ids=[f"{m}-{m.culler.__name__}" for m in METHODS]
)
def test_sound_method_conforms(at: int):
    """To its share of the catalogue; an effect to its own scenes."""
    method = METHODS[at]
    checks = list(method.suite.checks.values())
    assert_conforms(method.make, checks=share(checks, at) or checks)
